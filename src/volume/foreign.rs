//! What a file is that is no volume for us, and what makes it one.

use std::path::Path;

/// Offset of what tells, what tells, what it is, what to do.
const KINDS: [(usize, &[u8], &str, &str); 28] = [
    (128, b"DICM", "a DICOM file", DICOM),
    (0, b"\x02\0\0\0UL", "a DICOM file without its preamble", DICOM),
    (0, b"\x08\0\x05\0", "a DICOM file without its preamble", DICOM),
    (0, b"\x89HDF\r\n\x1a\n", "an HDF5 file, as MINC 2 and NetCDF 4 are", MINC),
    (0, b"CDF\x01", "a NetCDF file, as MINC 1 is", MINC),
    (0, b"CDF\x02", "a NetCDF file, as MINC 1 is", MINC),
    (0, b"\0\0\0\x01\0\0", "a FreeSurfer file (.mgh, .mgz)", "`mri_convert IN OUT.nii.gz`"),
    (0, b"ObjectType", "a MetaImage header (.mha, .mhd)", ITK),
    (0, b"NDims", "a MetaImage header (.mha, .mhd)", ITK),
    (0, b"# vtk DataFile", "a VTK file", ITK),
    (0, b"<VTKFile", "a VTK file", ITK),
    (0, b"<?xml", "an XML file, as VTK's are", ITK),
    (0, b"II*\0", "a TIFF image", ITK),
    (0, b"MM\0*", "a TIFF image", ITK),
    (0, b"II+\0", "a BigTIFF image", ITK),
    (0, b"MM\0+", "a BigTIFF image", ITK),
    (0, b"\x89PNG", "a PNG image", ITK),
    (0, b"\xff\xd8\xff", "a JPEG image", ITK),
    (0, b"\x76\x2f\x31\x01", "an OpenEXR image", ITK),
    (0, b" BDV", "an OpenVDB grid", ITK),
    (
        0,
        b"\x93NUMPY",
        "a NumPy array",
        "`nrrd.write(\"OUT.nrrd\", array)` of pynrrd, with its spacings",
    ),
    (0, b"PK\x03\x04", "a zip archive", UNPACK),
    (0, b"BZh", "compressed by bzip2", UNPACK),
    (0, b"\xfd7zXZ\0", "compressed by xz", UNPACK),
    (0, b"\x28\xb5\x2f\xfd", "compressed by zstd", UNPACK),
    (0, b"7z\xbc\xaf\x27\x1c", "a 7-Zip archive", UNPACK),
    (0, b"\x1f\x8b\x08", "gzip within gzip within gzip", UNPACK),
    (257, b"ustar", "a tar archive", UNPACK),
];

const DICOM: &str = "`dcm2niix -z y FOLDER` makes one file of a folder of slices";
const MINC: &str = "`mnc2nii IN OUT.nii`, or `nibabel.save(nibabel.load(\"IN\"), \"OUT.nii\")`";
const ITK: &str = "3D Slicer, or SimpleITK: `WriteImage(ReadImage(\"IN\"), \"OUT.nrrd\")`";
const UNPACK: &str = "unpack it, and give the volume that is in it";

/// Bytes from the front that tell.
pub(super) const START: usize = 264;

/// What a file is by its first bytes, and what to do about it.
pub(super) fn name(start: &[u8]) -> Option<String> {
    let is = |&&(at, magic, ..): &&(usize, &[u8], _, _)| {
        start.get(at..).is_some_and(|s| s.starts_with(magic))
    };
    let (_, _, what, remedy) = KINDS.iter().find(is)?;
    Some(match *remedy {
        UNPACK => format!("{what}; {remedy}"),
        _ => format!("{what}, which is not read here; convert it to .nrrd or .nii.gz: {remedy}"),
    })
}

/// What is said of a header whose voxels lie in a file beside it, or of that file.
pub(super) fn pair(path: &Path, what: &str) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let stem = ["hdr", "img"].iter().find_map(|end| {
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        plain.strip_suffix(end)?.strip_suffix('.')
    });
    let stem = stem.unwrap_or("IN");
    format!(
        "{what}: header and voxels are two files, {stem}.hdr and {stem}.img; pairs are not read: \
         make them one, with FSL: `fslchfiletype NIFTI_GZ {stem}`, or nibabel: \
         `nibabel.save(nibabel.load(\"{stem}.hdr\"), \"{stem}.nii.gz\")`"
    )
}
