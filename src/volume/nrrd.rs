//! NRRD: attached data, three dimensions, raw or gzip, every scalar type.
//!
//! A text header of `field: value` lines, an empty line, the data. World
//! positions come from `space`, `space directions` and `space origin`; without
//! `space` the world is taken to be left-posterior-superior, without an origin
//! voxel 0 lies at 0.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::bufread::MultiGzDecoder;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};

use super::{Found, Kind, Volume, Voxels, read_elements, spacing_and_axes};
use crate::error::{Error, Result};
use crate::files::write_whole;

/// No honest header is longer, bytes.
const HEADER_LIMIT: u64 = 1 << 20;

/// Names of element types, first the one that is written.
const TYPES: [(Kind, &[&str]); 10] = [
    (Kind::I8, &["int8", "int8_t", "signed char"]),
    (Kind::U8, &["uint8", "uint8_t", "uchar", "unsigned char"]),
    (Kind::I16, &["int16", "int16_t", "short", "short int", "signed short", "signed short int"]),
    (Kind::U16, &["uint16", "uint16_t", "ushort", "unsigned short", "unsigned short int"]),
    (Kind::I32, &["int32", "int32_t", "int", "signed int"]),
    (Kind::U32, &["uint32", "uint32_t", "uint", "unsigned int"]),
    (
        Kind::I64,
        &[
            "int64",
            "int64_t",
            "longlong",
            "long long",
            "long long int",
            "signed long long",
            "signed long long int",
        ],
    ),
    (
        Kind::U64,
        &["uint64", "uint64_t", "ulonglong", "unsigned long long", "unsigned long long int"],
    ),
    (Kind::F32, &["float"]),
    (Kind::F64, &["double"]),
];

/// Reads an NRRD file.
///
/// # Errors
/// [`Error::Io`] where it cannot be read, [`Error::Volume`] where it is damaged,
/// unsupported, or refused by [`Volume::new`].
pub fn read(path: &Path) -> Result<Volume> {
    let io = |source| Error::Io { path: path.into(), action: "read", source };
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    parse(BufReader::new(file), length).map_err(|what| Error::volume(path, what))
}

fn parse(mut from: impl BufRead, length: u64) -> Found<Volume> {
    let header = Header::read(&mut from)?;
    if let Some((line, file)) = header.find("data file").or(header.find("datafile")) {
        return Err(format!(
            "line {line}: the data lie in another file ({file}); detached headers are not read: \
             attach the data (teem: `unu save -f nrrd`)"
        ));
    }
    for field in ["line skip", "lineskip", "byte skip", "byteskip"] {
        if let Some((line, count)) = header.find(field)
            && count != "0"
        {
            return Err(format!(
                "line {line}: {field} {count}; data are read only where they follow the header at once"
            ));
        }
    }
    let (line, dimension) = header.need("dimension")?;
    if dimension != "3" {
        return Err(format!(
            "line {line}: dimension {dimension}; only volumes of dimension 3 are read"
        ));
    }
    if let Some((line, kinds)) = header.find("kinds")
        && let Some(kind) = kinds
            .split_whitespace()
            .find(|k| !["domain", "space", "none", "???"].contains(&k.to_lowercase().as_str()))
    {
        return Err(format!("line {line}: an axis of kind {kind}; only scalar volumes are read"));
    }
    let kind = header.kind()?;
    let size = header.size()?;
    let (line, encoding) = header.need("encoding")?;
    let packed = match encoding.to_lowercase().as_str() {
        "raw" => false,
        "gzip" | "gz" => true,
        _ => return Err(format!("line {line}: encoding {encoding}; raw and gzip are read")),
    };
    let big_endian = match header.find("endian") {
        None if kind.bytes() == 1 => false,
        None => {
            return Err(format!(
                "the header has no `endian`, which {}-byte elements need",
                kind.bytes()
            ));
        }
        Some((_, endian)) if endian.eq_ignore_ascii_case("little") => false,
        Some((_, endian)) if endian.eq_ignore_ascii_case("big") => true,
        Some((line, endian)) => {
            return Err(format!("line {line}: endian {endian}; it is little or big"));
        }
    };
    let (spacing, axes, origin) = header.frame()?;
    let elements = if packed {
        read_elements(MultiGzDecoder::new(from), kind, size, big_endian, true, length)?
    } else {
        read_elements(from, kind, size, big_endian, false, length)?
    };
    Volume::new(size, spacing, axes, origin, elements).map_err(|e| e.to_string())
}

/// Fields by lower-case name, each with its line, counted from 1.
struct Header(HashMap<String, (usize, String)>);

impl Header {
    fn read(from: &mut impl BufRead) -> Found<Self> {
        let mut lines = Lines { from: from.by_ref().take(HEADER_LIMIT), number: 0 };
        let magic = lines.next_line()?.unwrap_or_default();
        if !matches!(magic.strip_prefix("NRRD000"), Some("1" | "2" | "3" | "4" | "5")) {
            return Err(
                "not an NRRD file of version 1 to 5: it does not start with NRRD0001 to NRRD0005"
                    .into(),
            );
        }
        let mut fields = HashMap::new();
        loop {
            let line = lines
                .next_line()?
                .ok_or("the header does not end: no empty line, no data follow it")?;
            let number = lines.number;
            if line.is_empty() {
                return Ok(Self(fields));
            }
            if line.starts_with('#') {
                continue;
            }
            let (name, value) = line
                .split_once(':')
                .ok_or_else(|| format!("line {number}: `{line}` is not `field: value`"))?;
            // `key:=value` is the writer's own note.
            if !value.starts_with('=') {
                let name = name.trim().to_lowercase();
                if let Some((before, _)) =
                    fields.insert(name.clone(), (number, value.trim().to_string()))
                {
                    return Err(format!(
                        "line {number}: `{name}` again, which line {before} gave already"
                    ));
                }
            }
        }
    }

    fn find(&self, name: &str) -> Option<(usize, &str)> {
        self.0.get(name).map(|(line, value)| (*line, value.as_str()))
    }

    fn need(&self, name: &str) -> Found<(usize, &str)> {
        self.find(name).ok_or_else(|| format!("the header has no `{name}`"))
    }

    fn kind(&self) -> Found<Kind> {
        let (line, name) = self.need("type")?;
        let plain = name.to_lowercase();
        TYPES
            .iter()
            .find(|(_, names)| names.contains(&plain.as_str()))
            .map(|(kind, _)| *kind)
            .ok_or_else(|| {
                format!(
                    "line {line}: type {name}; integers of 8 to 64 bits, float and double are read"
                )
            })
    }

    fn size(&self) -> Found<[u32; 3]> {
        let (line, text) = self.need("sizes")?;
        let sizes: Vec<u32> = text
            .split_whitespace()
            .map(|n| {
                n.parse().map_err(|e| {
                    format!("line {line}: size {n}: {e}; sizes are whole and positive")
                })
            })
            .collect::<Found<_>>()?;
        sizes.try_into().map_err(|_| format!("line {line}: sizes {text}: three are needed"))
    }

    /// Spacing, axes and origin in millimetres, left-posterior-superior.
    fn frame(&self) -> Found<(DVec3, DMat3, DVec3)> {
        let to_lps = DMat3::from_diagonal(match self.find("space") {
            None => DVec3::ONE,
            Some((line, space)) => match space.to_lowercase().as_str() {
                "left-posterior-superior" | "lps" => DVec3::ONE,
                "left-anterior-superior" | "las" => DVec3::new(1.0, -1.0, 1.0),
                "right-anterior-superior" | "ras" => DVec3::new(-1.0, -1.0, 1.0),
                _ => {
                    return Err(format!(
                        "line {line}: space {space}; left-posterior-superior, right-anterior-superior and \
                         left-anterior-superior are read"
                    ));
                }
            },
        });
        if let Some((line, space)) = self.find("space dimension")
            && space != "3"
        {
            return Err(format!("line {line}: space dimension {space}; it must be 3"));
        }
        if let Some((line, units)) = self.find("space units").or(self.find("units"))
            && let Some(unit) =
                units.split('"').skip(1).step_by(2).find(|u| !["mm", "", "???"].contains(u))
        {
            return Err(format!(
                "line {line}: units of {unit}; only mm are read: convert the spacing"
            ));
        }
        let directions = if let Some((line, text)) = self.find("space directions") {
            let [i, j, k] = vectors(line, text)?;
            DMat3::from_cols(i, j, k)
        } else if let Some((line, text)) = self.find("spacings") {
            let spacings = numbers(line, &text.split_whitespace().collect::<Vec<_>>())?;
            if spacings.is_nan() {
                return Err(format!(
                    "line {line}: spacings {text}: unknown ones cannot be placed; write mm"
                ));
            }
            DMat3::from_diagonal(spacings)
        } else {
            return Err("the header has neither `space directions` nor `spacings`: how large a voxel is, is \
                        unknown; add `spacings: x y z` in mm"
                .into());
        };
        let origin = match self.find("space origin") {
            Some((line, text)) => {
                let [origin] = vectors(line, text)?;
                origin
            }
            None => DVec3::ZERO,
        };
        // Signs of spacings go to the axes, as those of directions do.
        let (spacing, axes) = spacing_and_axes(to_lps * directions);
        Ok((spacing, axes, to_lps * origin))
    }
}

/// Header lines without their ends.
struct Lines<R> {
    from: io::Take<R>,
    number: usize,
}

impl<R: BufRead> Lines<R> {
    fn next_line(&mut self) -> Found<Option<String>> {
        let mut line = Vec::new();
        self.number += 1;
        self.from.read_until(b'\n', &mut line).map_err(|e| format!("line {}: {e}", self.number))?;
        if line.pop() != Some(b'\n') {
            return Ok(None);
        }
        Ok(Some(String::from_utf8_lossy(&line).trim_end_matches('\r').to_string()))
    }
}

/// `N` vectors as `(x,y,z) (x,y,z)`.
fn vectors<const N: usize>(line: usize, text: &str) -> Found<[DVec3; N]> {
    let wrong = || format!("line {line}: `{text}` is not {N} of (x,y,z)");
    let (body, rest) = text.rsplit_once(')').ok_or_else(wrong)?;
    if !rest.trim().is_empty() {
        return Err(wrong());
    }
    let each = |vector: &str| -> Found<DVec3> {
        let inner = vector.trim().strip_prefix('(').ok_or_else(wrong)?;
        numbers(line, &inner.split(',').map(str::trim).collect::<Vec<_>>())
    };
    body.split(')').map(each).collect::<Found<Vec<_>>>()?.try_into().map_err(|_| wrong())
}

/// Three numbers.
fn numbers(line: usize, texts: &[&str]) -> Found<DVec3> {
    let each = |text: &&str| {
        text.parse::<f64>().map_err(|_| format!("line {line}: `{text}` is not a number"))
    };
    let values: Vec<f64> = texts.iter().map(each).collect::<Found<_>>()?;
    <[f64; 3]>::try_from(values)
        .map(DVec3::from)
        .map_err(|v| format!("line {line}: {} numbers where three are needed", v.len()))
}

/// Writes a volume with gzip encoding. The file appears whole or not at all.
///
/// Physical values are written: whole numbers as integers, which [`read`] stores
/// as they are stored here; all else, a fractional slope among it, as `float`.
///
/// # Errors
/// [`Error::Io`] where it cannot be written; an existing file is then as it was.
pub fn write(volume: &Volume, path: &Path) -> Result<()> {
    let failed = |source| Error::Io { path: path.into(), action: "write", source };
    write_whole(path, |file| write_to(volume, file).map_err(failed))
}

fn write_to(volume: &Volume, file: &mut BufWriter<File>) -> io::Result<()> {
    let integer = integer_kind(volume);
    let kind = integer.map_or(Kind::F32, |(kind, _)| kind);
    let (_, names) = TYPES.iter().find(|(k, _)| *k == kind).expect("every kind has a name");
    let [ni, nj, nk] = volume.size();
    let vector = |v: DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let columns = volume.axes() * DMat3::from_diagonal(volume.spacing());
    write!(
        file,
        "NRRD0004\ntype: {}\ndimension: 3\nspace: left-posterior-superior\nsizes: {ni} {nj} {nk}\n\
         space directions: {} {} {}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\
         space origin: {}\n\n",
        names[0],
        vector(columns.x_axis),
        vector(columns.y_axis),
        vector(columns.z_axis),
        vector(volume.origin()),
    )?;
    let mut out = GzEncoder::new(file, Compression::default());
    let mut row = Vec::new();
    for k in 0..nk {
        for j in 0..nj {
            row.clear();
            for i in 0..ni {
                match integer {
                    // Two's complement: the low bytes of a wider integer are the narrower one.
                    Some((kind, low)) => {
                        let whole = low + i64::from(volume.given(volume.index(i, j, k)) as i32);
                        row.extend_from_slice(&whole.to_le_bytes()[..kind.bytes()]);
                    }
                    None => row.extend_from_slice(&(volume.value(i, j, k) as f32).to_le_bytes()),
                }
            }
            out.write_all(&row)?;
        }
    }
    out.finish().map(|_| ())
}

/// The integer type that gives the volume's storage back when it is read, with
/// the value of stored 0; none where values are not whole.
fn integer_kind(volume: &Volume) -> Option<(Kind, i64)> {
    const EXACT: f64 = (1u64 << 53) as f64;
    let [low, high] = volume.range();
    let kinds = match volume.voxels() {
        Voxels::U8(_) => 0,
        Voxels::U16(_) => 2,
        Voxels::F32(_) => return None,
    };
    if volume.step != 1.0 || low.fract() != 0.0 || low.abs().max(high.abs()) > EXACT {
        return None;
    }
    let holds = |(kind, _): &&(Kind, &[&str])| {
        let bits = 8 * kind.bytes() as i32;
        match kind {
            Kind::U8 | Kind::U16 | Kind::U32 => low >= 0.0 && high < 2f64.powi(bits),
            _ => low >= -2f64.powi(bits - 1) && high < 2f64.powi(bits - 1),
        }
    };
    TYPES[kinds..7].iter().find(holds).map(|(kind, _)| (*kind, low as i64))
}
