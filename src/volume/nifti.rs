//! NIfTI-1 and NIfTI-2, single file.
//!
//! The `nifti` crate takes the header of NIfTI-1 apart; NIfTI-2 has the same fields, wider and
//! elsewhere. Every field that is used is checked here, and the voxels are read as they are, so
//! that integers stay integers. The world comes from the sform if there is one, else the qform,
//! turned from right-anterior-superior to left-posterior-superior. A file with
//! neither has no orientation: its axes are then taken as the world's, with
//! voxel 0 at 0.

use std::io::{self, Read};
use std::path::Path;

use ::nifti::{Endianness, NiftiHeader, NiftiType};
use glam::{DMat3, DQuat, DVec3};

use super::open::Source;
use super::{Found, Kind, Placement, Values, Volume, foreign, placement};

/// Bytes of the headers of NIfTI-1 and -2, which is also what their first field says.
const HEADERS: [usize; 2] = [348, 540];

/// What the header of NIfTI-2 says next; the end shows whether somebody changed line ends.
const SECOND: &[u8; 8] = b"n+2\0\r\n\x1a\n";

/// Whether a file's first bytes are those of NIfTI, 1 or 2.
pub(super) fn starts(bytes: &[u8]) -> bool {
    header_size(bytes).is_some()
}

fn header_size(bytes: &[u8]) -> Option<usize> {
    let first: [u8; 4] = *bytes.first_chunk()?;
    let sizes = [i32::from_le_bytes(first), i32::from_be_bytes(first)];
    HEADERS.into_iter().find(|&n| sizes.contains(&(n as i32)))
}

/// The fields that are used, of either version.
struct Header {
    big_endian: bool,
    /// How many sizes are used, then the sizes.
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    units: i32,
    qform_code: i32,
    sform_code: i32,
    quaternion: DVec3,
    offset: DVec3,
    rows: [[f64; 4]; 3],
}

/// Reads a volume up to its last voxel.
pub(super) fn parse(source: &mut Source) -> Found<Volume> {
    let second = header_size(source.peek(4)) == Some(HEADERS[1]);
    let version = if second { 2 } else { 1 };
    let mut bytes = vec![0; HEADERS[version - 1]];
    source.read_exact(&mut bytes).map_err(|e| {
        let size = bytes.len();
        format!("not a whole NIfTI-{version} header of {size} bytes ({e}); get the file again")
    })?;
    let header =
        if second { Header::second(&bytes, source)? } else { Header::first(&bytes, source)? };
    let size = header.size()?;
    let kind = header.kind()?;
    let (slope, intercept) = match (header.slope, header.intercept) {
        // The standard's word for "no scaling".
        (0.0, _) => (1.0, 0.0),
        (slope, intercept) if slope.is_finite() && intercept.is_finite() => (slope, intercept),
        (slope, intercept) => {
            return Err(format!(
                "scl_slope {slope} and scl_inter {intercept} map no value; set scl_slope to 0 for no scaling"
            ));
        }
    };
    let Placement { spacing, axes, origin } = header.placement()?;

    // Behind the header stands the extension flag.
    let least = (bytes.len() + 4) as f64;
    let start = if header.vox_offset == 0.0 { least } else { header.vox_offset };
    if !(start >= least && start.fract() == 0.0) {
        return Err(format!("vox_offset {start}: data start at a whole byte from {least} on"));
    }
    let skip = start as u64 - bytes.len() as u64;
    let skipped = io::copy(&mut source.by_ref().take(skip), &mut io::sink())
        .map_err(|e| format!("damaged data: {e}"))?;
    if skipped < skip {
        return Err(format!(
            "truncated: vox_offset {start} lies behind the end; get the file again"
        ));
    }
    let elements = source.elements(kind, size, header.big_endian)?;
    Volume::new(size, spacing, axes, origin, Values::from(elements).mapped(slope, intercept))
        .map_err(|e| e.to_string())
}

impl Header {
    fn first(bytes: &[u8], source: &Source) -> Found<Self> {
        check_first(bytes, &source.path)?;
        let h = NiftiHeader::from_reader(bytes).map_err(|e| format!("damaged header: {e}"))?;
        if h.sizeof_hdr != HEADERS[0] as i32 {
            return Err(format!(
                "damaged header: dim[0] and sizeof_hdr ({}) disagree in byte order",
                h.sizeof_hdr
            ));
        }
        let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
        Ok(Self {
            big_endian: h.endianness == Endianness::Big,
            // The crate reads sizes as unsigned; a negative one shows as such here.
            dim: h.dim.map(|d| (d as i16).into()),
            datatype: h.datatype,
            bitpix: h.bitpix,
            pixdim: h.pixdim.map(f64::from),
            vox_offset: h.vox_offset.into(),
            slope: h.scl_slope.into(),
            intercept: h.scl_inter.into(),
            units: h.xyzt_units.into(),
            qform_code: h.qform_code.into(),
            sform_code: h.sform_code.into(),
            quaternion: vector([h.quatern_b, h.quatern_c, h.quatern_d]),
            offset: vector([h.quatern_x, h.quatern_y, h.quatern_z]),
            rows: [h.srow_x, h.srow_y, h.srow_z].map(|row| row.map(f64::from)),
        })
    }

    fn second(bytes: &[u8], source: &Source) -> Found<Self> {
        match &bytes[4..12] {
            magic if magic == SECOND => {}
            [b'n', b'i', b'2', ..] => {
                return Err(foreign::pair(&source.path, "the header of a NIfTI-2 pair"));
            }
            _ => return Err("not a NIfTI-2 file: `n+2` does not follow sizeof_hdr".into()),
        }
        let big_endian = bytes[..4] == 540i32.to_be_bytes();
        let take = |at: usize, size: usize| {
            let mut field = [0; 8];
            field[..size].copy_from_slice(&bytes[at..at + size]);
            if big_endian {
                field[..size].reverse();
            }
            i64::from_le_bytes(field)
        };
        let short = |at| take(at, 2) as i16;
        let int = |at| take(at, 4) as i32;
        let double = |at| f64::from_bits(take(at, 8) as u64);
        let vector = |at| DVec3::new(double(at), double(at + 8), double(at + 16));
        let each = |n: usize| 8 * n;
        let dim: [i64; 8] = std::array::from_fn(|n| take(16 + each(n), 8));
        if !(1..=7).contains(&dim[0]) {
            return Err(format!("damaged header: dim[0] is {}, and must be from 1 to 7", dim[0]));
        }
        Ok(Self {
            big_endian,
            dim,
            datatype: short(12),
            bitpix: short(14),
            pixdim: std::array::from_fn(|n| double(104 + each(n))),
            vox_offset: take(168, 8) as f64,
            slope: double(176),
            intercept: double(184),
            units: int(500),
            qform_code: int(344),
            sform_code: int(348),
            quaternion: vector(352),
            offset: vector(376),
            rows: [400, 432, 464].map(|at| std::array::from_fn(|n| double(at + each(n)))),
        })
    }

    fn size(&self) -> Found<[u32; 3]> {
        let used = &self.dim[1..=self.dim[0].clamp(1, 7) as usize];
        match used {
            [i, j, k, rest @ ..] if used.iter().all(|&d| d > 0) => match rest {
                _ if rest.iter().all(|&d| d == 1) => {
                    // What is too large for a number of these is so for a volume.
                    Ok([*i, *j, *k].map(|d| u32::try_from(d).unwrap_or(u32::MAX)))
                }
                [1, more, ..] => Err(format!(
                    "sizes {used:?}: each voxel has {more} numbers, and only single volumes of one \
                     are read; extract one (nibabel: `image.slicer[:, :, :, :, 0]`)"
                )),
                _ => Err(format!(
                    "sizes {used:?}: {} volumes in one file, and only single volumes are read; \
                     extract one (FSL: `fslroi IN OUT 0 1`; nibabel: `image.slicer[..., 0]`)",
                    rest.iter().fold(1i64, |all, &d| all.saturating_mul(d))
                )),
            },
            _ => Err(format!("sizes {used:?}: three are needed, all positive")),
        }
    }

    fn kind(&self) -> Found<Kind> {
        let code = self.datatype;
        let known = NiftiHeader { datatype: code, ..NiftiHeader::default() };
        let kind = match known.data_type() {
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
            Ok(colour @ (NiftiType::Rgb24 | NiftiType::Rgba32)) => {
                return Err(format!(
                    "datatype {code} ({colour:?}): colours, and only one number a voxel is read; take \
                     a channel (nibabel: `numpy.asarray(image.dataobj)[\"R\"]`) and save it"
                ));
            }
            Ok(other) => {
                return Err(format!(
                    "datatype {code} ({other:?}): integers of 8 to 64 bits, float and double are \
                     read; convert it (nibabel: `image.get_fdata()`, its real part or magnitude)"
                ));
            }
            Err(_) => return Err(format!("datatype {code} is none of NIfTI's")),
        };
        if usize::try_from(self.bitpix) != Ok(8 * kind.bytes()) {
            return Err(format!(
                "bitpix {} disagrees with datatype {code}, which has {}",
                self.bitpix,
                8 * kind.bytes()
            ));
        }
        Ok(kind)
    }

    /// Spacing, axes and origin in millimetres, left-posterior-superior.
    fn placement(&self) -> Found<Placement> {
        let unit = match self.units & 7 {
            // Unknown is millimetres in practice.
            0 | 2 => 1.0,
            1 => 1e3,
            3 => 1e-3,
            other => return Err(format!("xyzt_units {other} is no unit of length")),
        };
        let pixdim = self.pixdim;
        let spacing = DVec3::new(pixdim[1], pixdim[2], pixdim[3]);
        let (directions, origin) = if self.sform_code > 0 {
            let column = |c: usize| DVec3::from(self.rows.map(|row| row[c]));
            (DMat3::from_cols(column(0), column(1), column(2)), column(3))
        } else if self.qform_code > 0 {
            let imaginary = self.quaternion;
            // Single precision leaves half turns a little over 1.
            if imaginary.is_nan() || imaginary.length_squared() > 1.0 + 1e-4 {
                return Err(format!(
                    "quaternion {imaginary}: it must be finite and no longer than 1"
                ));
            }
            let real = (1.0 - imaginary.length_squared()).max(0.0).sqrt();
            let turn = DMat3::from_quat(DQuat::from_vec4(imaginary.extend(real)).normalize());
            let flip = if pixdim[0] < 0.0 { -1.0 } else { 1.0 };
            // A negative or empty pixdim must reach the check of the spacing, not pass as a direction.
            if spacing.min_element() > 0.0 {
                (turn * DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, flip)), self.offset)
            } else {
                let axes = DMat3::IDENTITY;
                return Ok(Placement { spacing, axes, origin: self.offset });
            }
        } else {
            let (spacing, axes) = (unit * spacing, DMat3::IDENTITY);
            return Ok(Placement { spacing, axes, origin: DVec3::ZERO });
        };
        let to_lps = unit * DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0));
        Ok(placement(to_lps * directions, to_lps * origin))
    }
}

/// Refuses what is not a single-file NIfTI-1, before the crate guesses at it.
fn check_first(bytes: &[u8], path: &Path) -> Found<()> {
    match &bytes[344..] {
        b"n+1\0" => {}
        b"ni1\0" => return Err(foreign::pair(path, "the header of a NIfTI-1 pair")),
        [0, 0, 0, 0] if starts(bytes) => {
            let what = "the header of an ANALYZE 7.5 pair, which does not tell left from right";
            return Err(foreign::pair(path, what));
        }
        _ => return Err("not a NIfTI-1 file: the header does not end in `n+1`".into()),
    }
    let order = [i16::from_le_bytes, i16::from_be_bytes].map(|f| f([bytes[40], bytes[41]]));
    if !starts(bytes) || !order.iter().any(|n| (1..=7).contains(n)) {
        return Err(format!(
            "damaged header: sizeof_hdr must be {}, dim[0] from 1 to 7, in either byte order",
            HEADERS[0]
        ));
    }
    Ok(())
}
