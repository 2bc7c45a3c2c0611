//! What other programs write: units, other formats, more axes, more bytes.

use super::*;

/// The ramp under a header with these fields besides.
fn with(fields: &str, data: &[u8]) -> Vec<u8> {
    let fields = format!("type: uint8\nencoding: raw\n{fields}");
    [nrrd_header(&fields), data.to_vec()].concat()
}

#[test]
fn units_are_converted() {
    let folder = Folder::new();
    let mut units = vec![("\"\"", 1.0), ("\"???\"", 1.0), ("???", 1.0), ("none", 1.0)];
    for (names, mm) in [
        (&["mm", "MM", "millimeter", "millimeters", "millimetre", "millimetres"][..], 1.0),
        (&["cm", "centimeter", "centimetres"], 10.0),
        (&["m", "meter", "meters", "metre", "metres"], 1e3),
        (&["um", "\u{b5}m", "\u{3bc}m", "micron", "microns", "Micrometer", "micrometres"], 1e-3),
        (&["nm", "nanometer", "nanometres"], 1e-6),
    ] {
        units.extend(names.iter().map(|&name| (name, mm)));
    }
    let grid = "dimension: 3\nsizes: 5 4 3";
    let placed = "space: RAS\nspace directions: (0,20,0) (40,0,0) (0,0,60)\nspace origin: (1,2,3)";
    for (name, mm) in units {
        for unit in [name.to_owned(), format!("\"{}\"", name.trim_matches('"'))] {
            let three = [unit.as_str(); 3].join(" ");
            for (field, frame) in [
                ("space units", placed),
                ("units", placed),
                ("units", "spacings: 20 40 60\nspace: RAS\nspace origin: (1,2,3)"),
            ] {
                let file = with(&format!("{grid}\n{frame}\n{field}: {three}"), &bytes());
                let volume = load(folder.file("a.nrrd", &file)).expect(&three);
                is_ramp(&volume, &three);
                near(volume.spacing() / mm, [20.0, 40.0, 60.0], &three);
                near(volume.origin() / mm, [-1.0, -2.0, 3.0], &three);
            }
        }
    }
    // Latin-1, as older programs write it.
    let mut latin =
        with(&format!("{grid}\nspacings: 20 20 20\nunits: \"?m\" \"?m\" \"?m\""), &bytes());
    latin.iter_mut().filter(|b| **b == b'?').for_each(|b| *b = 0xb5);
    near(load(folder.file("a.nrrd", &latin)).unwrap().spacing(), [0.02; 3], "Latin-1");
    // Of a microscope's slices.
    let file = with(&format!("{grid}\nspacings: 500 500 2\nunits: um um mm"), &bytes());
    near(load(folder.file("a.nrrd", &file)).unwrap().spacing(), [0.5, 0.5, 2.0], "mixed");
    let world = "space: LPS\nspace directions: (0,2,0) (500,0,0) (0,0,1)\nspace units: um mm cm";
    let volume = load(folder.file("a.nrrd", &with(&format!("{grid}\n{world}"), &bytes()))).unwrap();
    near(volume.spacing(), [2.0, 0.5, 10.0], "mixed, of the world");
    for (field, says) in [
        ("space units: ell mm mm", "units of ell; mm, cm, m, um and nm are read: convert"),
        ("space units: \"light years\" mm mm", "units of light years"),
        ("units: mm mm um", "they differ"),
        ("space units: mm um", "one is needed for each axis"),
    ] {
        let error =
            folder.refusal("a.nrrd", &with(&format!("{grid}\n{placed}\n{field}"), &bytes()));
        assert!(error.starts_with("line 10: ") && error.contains(says), "{error}");
    }
}

/// Zeros with pieces at their offsets.
fn pieces(length: usize, all: &[(usize, &[u8])]) -> Vec<u8> {
    let mut file = vec![0; length];
    for (at, piece) in all {
        file[*at..at + piece.len()].copy_from_slice(piece);
    }
    file
}

#[test]
fn other_formats_are_named() {
    let folder = Folder::new();
    let mut first = Nifti::new(2, 1, false);
    first.bytes[345] = b'i';
    let first = first.with(&[]);
    let second = pieces(544, &[(0, &540i32.to_le_bytes()), (4, b"ni2\0\r\n\x1a\n")]);
    let analyze = pieces(348, &[(0, &348i32.to_be_bytes()), (38, b"r"), (40, &4i16.to_be_bytes())]);
    let mgh = pieces(300, &[(3, &[1]), (7, &[8]), (11, &[8]), (15, &[8]), (19, &[1])]);
    let thrice = gzip(&gzip(&gzip(&scan())));
    let all: [(&str, &[u8], &[&str]); 26] = [
        ("a.hdr", &first, &["NIfTI-1 pair", "a.hdr and a.img", "fslchfiletype NIFTI_GZ a"]),
        ("a.hdr.gz", &gzip(&first), &["NIfTI-1 pair", "a.img"]),
        ("b.hdr", &second, &["NIfTI-2 pair", "b.img", "nibabel.load(\"b.hdr\")"]),
        ("c.hdr", &analyze, &["ANALYZE", "left from right", "c.img"]),
        ("d.img", &[9; 4096], &["voxels of an ANALYZE or NIfTI pair", "d.hdr and d.img"]),
        ("e.img.gz", &gzip(&[9; 4096]), &["pair", "e.hdr and e.img"]),
        ("a.dcm", &pieces(400, &[(128, b"DICM")]), &["DICOM", "dcm2niix"]),
        ("slice", &pieces(400, &[(0, b"\x08\0\x05\0\x0a")]), &["DICOM", "dcm2niix"]),
        ("named.nrrd", &pieces(400, &[(128, b"DICM")]), &["DICOM", "dcm2niix"]),
        ("a.mgz", &gzip(&mgh), &["FreeSurfer", "mri_convert"]),
        ("a.mgh", &mgh, &["FreeSurfer", "mri_convert"]),
        ("a.mnc", b"\x89HDF\r\n\x1a\n", &["HDF5", "MINC", "mnc2nii"]),
        ("old.mnc", b"CDF\x01", &["NetCDF", "mnc2nii"]),
        ("a.tif", b"II*\0", &["TIFF", "SimpleITK"]),
        ("b.tif", b"MM\0*", &["TIFF"]),
        ("c.tif", b"II+\0", &["BigTIFF"]),
        ("a.png", b"\x89PNG\r\n\x1a\n", &["PNG", "SimpleITK"]),
        ("a.jpg", b"\xff\xd8\xff\xe0", &["JPEG"]),
        ("a.mha", b"ObjectType = Image\n", &["MetaImage", "SimpleITK"]),
        ("a.vti", b"<VTKFile", &["VTK"]),
        ("a.npy", b"\x93NUMPY", &["NumPy", "pynrrd"]),
        ("a.zip", b"PK\x03\x04", &["zip", "unpack it"]),
        ("a.nii.bz2", b"BZh91AY", &["bzip2", "unpack it"]),
        ("a.nii.xz", b"\xfd7zXZ\0", &["xz", "unpack it"]),
        ("a.tar", &pieces(600, &[(257, b"ustar")]), &["tar archive", "unpack it"]),
        ("a.nrrd.gz", &thrice, &["gzip within gzip within gzip", "unpack it"]),
    ];
    for (name, file, says) in all {
        let error = folder.refusal(name, file);
        for part in says {
            assert!(error.contains(part), "{name}: `{error}` does not say `{part}`");
        }
    }
    let folder = load(folder.0.path()).unwrap_err().to_string();
    assert!(folder.contains("a folder") && folder.contains("dcm2niix"), "{folder}");
}

#[test]
fn what_is_in_gzip_is_told_by_content() {
    let folder = Folder::new();
    let nifti = Nifti::new(2, 1, false).with(&bytes());
    for (name, file) in [
        ("a.nrrd.gz", gzip(&scan())),
        ("a.nii", gzip(&nifti)),
        ("a.nrrd", nifti.clone()),
        ("a.nii.gz", scan()),
        ("none", gzip(&scan())),
    ] {
        let volume = load(folder.file(name, &file)).expect(name);
        is_ramp(&volume, name);
        assert_eq!(volume.warnings(), [""; 0], "{name}");
    }
    for file in [gzip(&gzip(&nifti)), gzip(&gzip(&scan()))] {
        let volume = load(folder.file("twice.gz", &file)).expect("twice");
        is_ramp(&volume, "twice");
        let [warning] = volume.warnings() else { panic!("{:?}", volume.warnings()) };
        assert!(warning.contains("twice.gz: it is compressed twice"), "{warning}");
    }
}

#[test]
fn nifti_2_is_read() {
    let folder = Folder::new();
    for case in cases() {
        for big in [false, true] {
            let data = case.bytes(big);
            let element = data.len() / COUNT;
            let int = |x: i64, size: usize| {
                if big {
                    x.to_be_bytes()[8 - size..].to_vec()
                } else {
                    x.to_le_bytes()[..size].to_vec()
                }
            };
            let real = |x: f64| int(x.to_bits() as i64, 8);
            let mut header = vec![0; 544];
            let mut put = |at: usize, field: Vec<u8>| {
                header[at..at + field.len()].copy_from_slice(&field);
            };
            put(0, int(540, 4));
            put(4, b"n+2\0\r\n\x1a\n".to_vec());
            put(12, int(case.nifti.into(), 2));
            put(14, int(8 * element as i64, 2));
            for (n, d) in [4, 5, 4, 3, 1, 1, 1, 1].into_iter().enumerate() {
                put(16 + 8 * n, int(d, 8));
            }
            for (n, p) in [1.0, 9.0, 9.0, 9.0].into_iter().enumerate() {
                put(104 + 8 * n, real(p));
            }
            put(168, int(544, 8));
            put(176, real(1.0));
            put(348, int(1, 4));
            let rows = [[-1.0, 0.0, 0.0, 100.0], [0.0, -2.0, 0.0, 50.0], [0.0, 0.0, 3.0, 7.0]];
            for (n, x) in rows.into_iter().flatten().enumerate() {
                put(400 + 8 * n, real(x));
            }
            // Micrometres.
            put(500, int(3, 4));
            let file = [header.clone(), data].concat();
            let what = format!("{}, big {big}", case.nrrd[0]);
            for file in [file.clone(), gzip(&file)] {
                let volume = load(folder.file("a.nii", &file)).expect(&what);
                case.check(&volume, &what);
                near(1e3 * volume.spacing(), [1.0, 2.0, 3.0], &what);
                near(1e3 * volume.origin(), [-100.0, -50.0, 7.0], &what);
            }
            // Line ends that somebody changed.
            header.remove(8);
            assert!(folder.refusal("b.nii", &header).contains("NIfTI-2"));
        }
    }
}

#[test]
fn an_axis_of_size_1_is_left_out() {
    let folder = Folder::new();
    let [x, y, z] = ["(2,0,0)", "(0,3,0)", "(0,0,4)"];
    let all = [
        format!(
            "sizes: 1 5 4 3\nkinds: list domain domain domain\nspace directions: none {x} {y} {z}"
        ),
        format!(
            "sizes: 5 4 3 1\nkinds: domain domain domain list\nspace directions: {x} {y} {z} none"
        ),
        format!("sizes: 5 1 4 3\nspace directions: {x} none {y} {z}"),
        "sizes: 1 5 4 3\nkinds: vector space space space\nspacings: nan 2 3 4".to_owned(),
        "sizes: 5 4 3 1\nspacings: 2 3 4 nan\nunits: mm mm mm s".to_owned(),
        "sizes: 5 4 3 1\nspacings: 2 3 4 1".to_owned(),
        "sizes: 1 5 4 3\nspacings: 1 2 3 4\nkinds: scalar domain domain domain".to_owned(),
        "sizes: 1 5 4 3\nspacings: 1 2 3 4".to_owned(),
        "sizes: 1 5 4 3\nspacings: 1 .2 .3 .4\nunits: s cm cm cm".to_owned(),
    ];
    for fields in all {
        let file = with(&format!("dimension: 4\n{fields}"), &bytes());
        let volume = load(folder.file("a.nrrd", &file)).expect(&fields);
        is_ramp(&volume, &fields);
        near(volume.spacing(), [2.0, 3.0, 4.0], &fields);
    }
    let five = "dimension: 5\nsizes: 1 5 4 3 1\nspacings: nan 2 3 4 nan";
    is_ramp(&load(folder.file("a.nrrd", &with(five, &bytes()))).unwrap(), five);
    let mut nifti = Nifti::new(2, 1, false);
    is_ramp(&load(folder.file("a.nii", &nifti.i16(40, 5).with(&bytes()))).unwrap(), "NIfTI");
}

#[test]
fn more_axes_are_refused_with_the_remedy() {
    let folder = Folder::new();
    for (fields, says) in [
        (
            "sizes: 2 5 4 3\nkinds: list domain domain domain\nspacings: nan 1 1 1",
            &["axis 0 of kind list", "size of 2", "several volumes", "unu slice -a 0 -p 0"][..],
        ),
        (
            "sizes: 5 4 3 2\nkinds: domain domain domain time\nspacings: 1 1 1 1",
            &["axis 3 of kind time", "several volumes", "unu slice -a 3 -p 0"],
        ),
        ("sizes: 5 4 3 2\nspacings: 1 1 1 1", &["size of 2", "unu slice -a 3 -p 0"]),
        (
            "sizes: 3 5 4 3\nkinds: RGB-color domain domain domain\nspacings: nan 1 1 1",
            &[
                "RGB-color",
                "several numbers for each voxel",
                "unu slice -a 0",
                "unu project -m mean",
            ],
        ),
        (
            "sizes: 1 1 4 3\nkinds: list list domain domain\nspacings: nan nan 1 1",
            &["spacings nan nan 1 1"],
        ),
        (
            "sizes: 1 1 4 3\nkinds: list list domain domain\nspacings: 1 1 1 1",
            &["fewer than 3 axes"],
        ),
        ("sizes: 1 5 4 3\nspacings: 1 1 1", &["3 numbers where 4 are needed"]),
        ("sizes: 1 5 4 3\nspace directions: none (1,0,0) (0,1,0)", &["is not 4 of (x,y,z)"]),
    ] {
        let data = bytes().repeat(3);
        let error = folder.refusal("a.nrrd", &with(&format!("dimension: 4\n{fields}"), &data));
        for part in says {
            assert!(error.contains(part), "{fields}: `{error}` does not say `{part}`");
        }
    }
    type Spoil = fn(&mut Nifti);
    let spoils: [(Spoil, &[&str]); 3] = [
        (|h| _ = h.i16(40, 4).i16(48, 2), &["2 volumes", "fslroi IN OUT 0 1"]),
        (|h| _ = h.i16(40, 5).i16(50, 3), &["each voxel has 3 numbers", "slicer"]),
        (|h| _ = h.i16(70, 128).i16(72, 24), &["Rgb24", "take a channel", "[\"R\"]"]),
    ];
    for (spoil, says) in spoils {
        let mut header = Nifti::new(2, 1, false);
        spoil(&mut header);
        let error = folder.refusal("a.nii", &header.with(&bytes().repeat(3)));
        for part in says {
            assert!(error.contains(part), "`{error}` does not say `{part}`");
        }
    }
}

#[test]
fn bytes_after_the_data_are_told_of() {
    let folder = Folder::new();
    let nrrd = |encoding: &str, data: &[u8]| nrrd_file("uint8", "little", encoding, data);
    let after = |data: &[u8], more: &[u8]| [data, more].concat();
    let nifti = Nifti::new(2, 1, false).with(&bytes());
    let halves = |whole: &[u8]| [gzip(&whole[..30]), gzip(&[]), gzip(&whole[30..])].concat();
    let mut short = Nifti::new(2, 1, false);
    let one_slice_more = [bytes(), vec![0; 20]].concat();
    for (what, name, file, count) in [
        ("newline", "a.nrrd", nrrd("raw", &after(&bytes(), b"\n")), 1),
        ("newline after gzip", "a.nrrd", nrrd("gzip", &after(&gzip(&bytes()), b"\n")), 1),
        ("newline in gzip", "a.nrrd", nrrd("gzip", &gzip(&after(&bytes(), b"\n"))), 1),
        ("both", "a.nrrd", nrrd("gzip", &after(&gzip(&after(&bytes(), b"\n")), b"\n")), 2),
        ("half a magic number", "a.nrrd", nrrd("gzip", &after(&gzip(&bytes()), b"\x1f\x8b")), 2),
        ("zeros", "a.nii", after(&nifti, &[0; 168]), 168),
        ("zeros in gzip", "a.nii.gz", gzip(&after(&nifti, &[0; 168])), 168),
        ("padding", "a.nii.gz", after(&gzip(&nifti), &[0; 512]), 512),
        ("garbage", "a.nii.gz", after(&gzip(&nifti), b"what is this?"), 13),
        ("members, padding", "a.nii.gz", after(&halves(&nifti), &[0; 512]), 512),
        ("a slice more", "a.nii", short.with(&one_slice_more), 20),
        ("a bomb", "a.nrrd", nrrd("gzip", &gzip(&after(&bytes(), &vec![0; 9_000_000]))), 9_000_000),
    ] {
        let volume = load(folder.file(name, &file)).expect(what);
        is_ramp(&volume, what);
        let [warning] = volume.warnings() else { panic!("{what}: {:?}", volume.warnings()) };
        let says = match count {
            1 => "1 byte follows the data and is not read".to_owned(),
            _ => format!("{count} bytes follow the data and are not read"),
        };
        assert!(warning.contains(&says) && warning.contains(name), "{what}: {warning}");
    }
    for (what, name, file) in [
        ("members", "a.nii.gz", halves(&nifti)),
        ("members of NRRD", "a.nrrd", nrrd("gzip", &halves(&bytes()))),
        ("exact", "a.nii", nifti.clone()),
    ] {
        let volume = load(folder.file(name, &file)).expect(what);
        is_ramp(&volume, what);
        assert!(volume.warnings().is_empty(), "{what}: {:?}", volume.warnings());
    }
    // What is short or changed is still refused, padded or not.
    let mut changed = gzip(&nifti);
    let checksum = changed.len() - 8;
    changed[checksum] ^= 1;
    let cut = gzip(&bytes());
    for (name, file, says) in [
        ("a.nrrd", nrrd("raw", &bytes()[1..]), "truncated"),
        ("a.nrrd", nrrd("gzip", &gzip(&bytes()[1..])), "truncated"),
        ("a.nrrd", nrrd("gzip", &after(&gzip(&bytes()[1..]), &[0; 512])), "truncated"),
        ("a.nrrd", nrrd("gzip", &cut[..cut.len() - 3]), "damaged data"),
        ("a.nii.gz", changed.clone(), "damaged data"),
        ("a.nii.gz", after(&changed, &[0; 512]), "damaged data"),
        ("a.nii", short.i16(46, 4).with(&bytes()), "truncated"),
    ] {
        let error = folder.refusal(name, &file);
        assert!(error.contains(says), "{name}: `{error}` does not say `{says}`");
    }
}
