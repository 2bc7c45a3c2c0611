//! NIfTI-1, single file, plain or gzip.
//!
//! The `nifti` crate takes the header apart; every field that is used is
//! checked here, and the voxels are read as they are, so that integers stay
//! integers. The world comes from the sform if there is one, else the qform,
//! turned from right-anterior-superior to left-posterior-superior. A file with
//! neither has no orientation: its axes are then taken as the world's, with
//! voxel 0 at 0.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

use ::nifti::{Endianness, NiftiHeader, NiftiType};
use flate2::bufread::MultiGzDecoder;
use glam::{DMat3, DQuat, DVec3};

use super::{Found, Kind, Values, Volume, read_elements, spacing_and_axes};
use crate::error::{Error, Result};

/// Bytes of the header, which is also what its first field says.
const HEADER: usize = 348;

/// Where data may start: behind the header and the extension flag.
const DATA_START: f32 = 352.0;

const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Whether a file's first bytes are those of NIfTI (1 or 2) or of gzip.
pub(super) fn starts(bytes: &[u8]) -> bool {
    let size = bytes.first_chunk().map(|b| [i32::from_le_bytes(*b), i32::from_be_bytes(*b)]);
    bytes.starts_with(&GZIP) || size.is_some_and(|s| s.contains(&348) || s.contains(&540))
}

/// Reads a NIfTI-1 file.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, [`Error::Volume`] where it is damaged,
/// unsupported, or refused by [`Volume::new`].
pub fn read(path: &Path) -> Result<Volume> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let mut file = BufReader::new(file);
    let packed = file.fill_buf().map_err(io)?.starts_with(&GZIP);
    let volume = if packed {
        parse(MultiGzDecoder::new(file), true, length)
    } else {
        parse(file, false, length)
    };
    volume.map_err(|what| Error::volume(path, what))
}

fn parse(mut from: impl Read, packed: bool, length: u64) -> Found<Volume> {
    let mut bytes = [0; HEADER];
    from.read_exact(&mut bytes).map_err(|e| {
        format!("not a whole NIfTI-1 header of {HEADER} bytes ({e}); get the file again")
    })?;
    check_start(&bytes)?;
    let header =
        NiftiHeader::from_reader(bytes.as_slice()).map_err(|e| format!("damaged header: {e}"))?;
    if header.sizeof_hdr != HEADER as i32 {
        return Err(format!(
            "damaged header: dim[0] and sizeof_hdr ({}) disagree in byte order",
            header.sizeof_hdr
        ));
    }
    let size = size(&header)?;
    let kind = kind(&header)?;
    let (slope, intercept) = match (header.scl_slope, header.scl_inter) {
        // The standard's word for "no scaling".
        (0.0, _) => (1.0, 0.0),
        (slope, intercept) if slope.is_finite() && intercept.is_finite() => {
            (slope.into(), intercept.into())
        }
        (slope, intercept) => {
            return Err(format!(
                "scl_slope {slope} and scl_inter {intercept} map no value; set scl_slope to 0 for no scaling"
            ));
        }
    };
    let (spacing, axes, origin) = frame(&header)?;

    let start = if header.vox_offset == 0.0 { DATA_START } else { header.vox_offset };
    if !(start >= DATA_START && start.fract() == 0.0) {
        return Err(format!("vox_offset {start}: data start at a whole byte from {DATA_START} on"));
    }
    let skip = start as u64 - HEADER as u64;
    let skipped = io::copy(&mut from.by_ref().take(skip), &mut io::sink())
        .map_err(|e| format!("damaged data: {e}"))?;
    if skipped < skip {
        return Err(format!(
            "truncated: vox_offset {start} lies behind the end; get the file again"
        ));
    }
    let big_endian = header.endianness == Endianness::Big;
    let elements = read_elements(from, kind, size, big_endian, packed, length)?;
    Volume::new(size, spacing, axes, origin, Values::from(elements).mapped(slope, intercept))
        .map_err(|e| e.to_string())
}

/// Refuses what is not a single-file NIfTI-1, before the crate guesses at it.
fn check_start(bytes: &[u8; HEADER]) -> Found<()> {
    match &bytes[344..] {
        b"n+1\0" => {}
        b"ni1\0" => {
            return Err("the data lie in an .img file beside it; save it as one .nii file".into());
        }
        _ if [bytes[0], bytes[3]].contains(&28) && bytes[4..7] == *b"n+2" => {
            return Err("NIfTI-2, which is not read; save it as NIfTI-1".into());
        }
        _ => return Err("not a NIfTI-1 file: the header does not end in `n+1`".into()),
    }
    let order = [i16::from_le_bytes, i16::from_be_bytes].map(|f| f([bytes[40], bytes[41]]));
    if !starts(bytes) || bytes.starts_with(&GZIP) || !order.iter().any(|n| (1..=7).contains(n)) {
        return Err(format!(
            "damaged header: sizeof_hdr must be {HEADER}, dim[0] from 1 to 7, in either byte order"
        ));
    }
    Ok(())
}

fn size(header: &NiftiHeader) -> Found<[u32; 3]> {
    // The crate reads dims as unsigned; a negative one shows as such here.
    let dims = header.dim.map(|d| d as i16);
    let used = &dims[1..=dims[0].clamp(1, 7) as usize];
    match used {
        [_, _, _, rest @ ..] if used.iter().all(|&d| d > 0) && rest.iter().all(|&d| d == 1) => {
            Ok([dims[1], dims[2], dims[3]].map(|d| d as u32))
        }
        [_, _, _, ..] if used.iter().all(|&d| d > 0) => Err(format!(
            "sizes {used:?}: only single volumes are read; extract one (fsl: `fslroi`)"
        )),
        _ => Err(format!("sizes {used:?}: three are needed, all positive")),
    }
}

fn kind(header: &NiftiHeader) -> Found<Kind> {
    let code = header.datatype;
    let kind = match header.data_type() {
        Ok(NiftiType::Int8) => Kind::I8,
        Ok(NiftiType::Uint8) => Kind::U8,
        Ok(NiftiType::Int16) => Kind::I16,
        Ok(NiftiType::Uint16) => Kind::U16,
        Ok(NiftiType::Int32) => Kind::I32,
        Ok(NiftiType::Uint32) => Kind::U32,
        Ok(NiftiType::Int64) => Kind::I64,
        Ok(NiftiType::Uint64) => Kind::U64,
        Ok(NiftiType::Float32) => Kind::F32,
        Ok(NiftiType::Float64) => Kind::F64,
        Ok(other) => {
            return Err(format!(
                "datatype {code} ({other:?}): integers of 8 to 64 bits, float and double are read"
            ));
        }
        Err(_) => return Err(format!("datatype {code} is none of NIfTI-1's")),
    };
    if usize::try_from(header.bitpix) != Ok(8 * kind.bytes()) {
        return Err(format!(
            "bitpix {} disagrees with datatype {code}, which has {}",
            header.bitpix,
            8 * kind.bytes()
        ));
    }
    Ok(kind)
}

/// Spacing, axes and origin in millimetres, left-posterior-superior.
fn frame(header: &NiftiHeader) -> Found<(DVec3, DMat3, DVec3)> {
    let unit = match header.xyzt_units & 7 {
        // Unknown is millimetres in practice.
        0 | 2 => 1.0,
        1 => 1e3,
        3 => 1e-3,
        other => return Err(format!("xyzt_units {other} is no unit of length")),
    };
    let pixdim = header.pixdim.map(f64::from);
    let spacing = DVec3::new(pixdim[1], pixdim[2], pixdim[3]);
    let (directions, origin) = if header.sform_code > 0 {
        let rows = [header.srow_x, header.srow_y, header.srow_z].map(|row| row.map(f64::from));
        let column = |c: usize| DVec3::from(rows.map(|row| row[c]));
        (DMat3::from_cols(column(0), column(1), column(2)), column(3))
    } else if header.qform_code > 0 {
        let imaginary =
            DVec3::new(header.quatern_b.into(), header.quatern_c.into(), header.quatern_d.into());
        // Single precision leaves half turns a little over 1.
        if imaginary.is_nan() || imaginary.length_squared() > 1.0 + 1e-4 {
            return Err(format!("quaternion {imaginary}: it must be finite and no longer than 1"));
        }
        let real = (1.0 - imaginary.length_squared()).max(0.0).sqrt();
        let turn = DMat3::from_quat(DQuat::from_vec4(imaginary.extend(real)).normalize());
        let flip = if pixdim[0] < 0.0 { -1.0 } else { 1.0 };
        let origin =
            DVec3::new(header.quatern_x.into(), header.quatern_y.into(), header.quatern_z.into());
        // A negative or empty pixdim must reach the check of the spacing, not pass as a direction.
        if spacing.min_element() > 0.0 {
            (turn * DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, flip)), origin)
        } else {
            return Ok((spacing, DMat3::IDENTITY, origin));
        }
    } else {
        return Ok((unit * spacing, DMat3::IDENTITY, DVec3::ZERO));
    };
    let to_lps = unit * DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
    let (spacing, axes) = spacing_and_axes(to_lps * directions);
    Ok((spacing, axes, to_lps * origin))
}
