//! NRRD: attached data, raw or gzip, every scalar type, three axes in space and others of size 1.
//!
//! A text header of `field: value` lines, an empty line, the data. World
//! positions come from `space`, `space directions` and `space origin`; without
//! `space` the world is taken to be left-posterior-superior, without an origin
//! voxel 0 lies at 0, without units lengths are millimetres.

use std::collections::HashMap;
use std::fs::File;
use std::io::{self, BufRead, BufWriter, Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};

use super::open::Source;
use super::{Found, Kind, Placement, Volume, Voxels, placement};
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

/// Units of length, in mm, by their names in lower case. Nameless ones are mm in practice.
const UNITS: [(f64, &[&str]); 5] = [
    (1.0, &["mm", "millimeter", "millimeters", "millimetre", "millimetres", "", "???", "none"]),
    (10.0, &["cm", "centimeter", "centimeters", "centimetre", "centimetres"]),
    (1e3, &["m", "meter", "meters", "metre", "metres"]),
    (
        1e-3,
        &[
            "um",
            // The micro sign, and the Greek letter.
            "\u{b5}m",
            "\u{3bc}m",
            "micron",
            "microns",
            "micrometer",
            "micrometers",
            "micrometre",
            "micrometres",
        ],
    ),
    (1e-6, &["nm", "nanometer", "nanometers", "nanometre", "nanometres"]),
];

/// Kinds of axes that lie in space; `none` and `???` say nothing.
const SPATIAL: [&str; 4] = ["domain", "space", "none", "???"];

/// Reads a volume up to its last voxel.
pub(super) fn parse(source: &mut Source) -> Found<Volume> {
    let header = Header::read(source)?;
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
    let kind = header.kind()?;
    let axes = header.axes()?;
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
    let Placement { spacing, axes: directions, origin } = header.placement(&axes)?;
    if packed {
        source.gunzip();
    }
    let size = axes.space.map(|axis| axes.sizes[axis]);
    let elements = source.elements(kind, size, big_endian)?;
    Volume::new(size, spacing, directions, origin, elements).map_err(|e| e.to_string())
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

    /// The axes, and which of them lie in space. Others must have a size of 1.
    fn axes(&self) -> Found<Axes> {
        let (dimension_line, dimension) = self.need("dimension")?;
        let count = dimension.parse().unwrap_or(0);
        // NRRD has 16 at most.
        if !(3..=16).contains(&count) {
            return Err(format!(
                "line {dimension_line}: dimension {dimension}; a volume has 3, or more of which the \
                 others have a size of 1"
            ));
        }
        let (line, text) = self.need("sizes")?;
        let size = |n: &str| {
            n.parse::<u32>()
                .map_err(|e| format!("line {line}: size {n}: {e}; sizes are whole and positive"))
        };
        let sizes = text.split_whitespace().map(size).collect::<Found<Vec<_>>>()?;
        if sizes.len() != count {
            return Err(format!(
                "line {line}: sizes {text}: {count} are needed, as of dimension {count} on line \
                 {dimension_line}"
            ));
        }
        let kinds: Vec<_> = self.find("kinds").map_or("", |(_, k)| k).split_whitespace().collect();
        let kind_of = |axis: usize| kinds.get(axis).copied().unwrap_or("???");
        let directions = self.directions(count)?;
        let spacings = self.spacings(count)?;
        let in_space = |&axis: &usize| {
            SPATIAL.contains(&kind_of(axis).to_lowercase().as_str())
                && directions.as_ref().is_none_or(|d| d[axis].is_some())
                && spacings.as_ref().is_none_or(|s| !s[axis].is_nan())
        };
        let (mut space, mut others): (Vec<_>, Vec<_>) = (0..count).partition(in_space);
        // Where nothing tells them apart, those of size 1 are left out, from the last on.
        while space.len() > 3
            && let Some(one) = space.iter().rposition(|&axis| sizes[axis] == 1)
        {
            others.push(space.remove(one));
        }
        let space = match <[usize; 3]>::try_from(space) {
            Ok(space) if others.iter().all(|&axis| sizes[axis] == 1) => space,
            Ok(_) => {
                let axis = others.into_iter().find(|&axis| sizes[axis] != 1).unwrap_or(0);
                return Err(self.many(axis, sizes[axis], kind_of(axis)));
            }
            Err(space) if space.len() > 3 => {
                let axis = (0..count).min_by_key(|&axis| sizes[axis]).unwrap_or(0);
                return Err(self.many(axis, sizes[axis], kind_of(axis)));
            }
            Err(_) => {
                let axis = others[0];
                if let Some((line, text)) = self.find("spacings")
                    && spacings.is_some_and(|s| s[axis].is_nan())
                {
                    return Err(format!(
                        "line {line}: spacings {text}: unknown ones cannot be placed; write mm"
                    ));
                }
                let what = self.many(axis, sizes[axis], kind_of(axis));
                return Err(format!("{what}; fewer than 3 axes lie in space, which need (x,y,z)"));
            }
        };
        Ok(Axes { sizes, space, directions, spacings })
    }

    /// What to do about an axis that is none of a volume's.
    fn many(&self, axis: usize, size: u32, kind: &str) -> String {
        let fields = ["kinds", "space directions", "spacings", "sizes"];
        let line = fields.into_iter().find_map(|f| self.find(f)).map_or(0, |(line, _)| line);
        let series = ["list", "time", "???", "none", "domain", "space"];
        let (what, remedy) = match series.contains(&kind.to_lowercase().as_str()) {
            true => ("several volumes in one file", ""),
            false => ("several numbers for each voxel", "; their mean: `unu project -m mean`"),
        };
        format!(
            "line {line}: axis {axis} of kind {kind} has a size of {size}: {what}, and one scalar \
             volume is read; take one of them (teem: `unu slice -a {axis} -p 0 -i IN.nrrd -o \
             OUT.nrrd`{remedy})"
        )
    }

    /// The vector of each axis, none for those that do not lie in space.
    fn directions(&self, count: usize) -> Found<Option<Vec<Option<DVec3>>>> {
        let Some((line, text)) = self.find("space directions") else { return Ok(None) };
        let all = vectors(line, text)?;
        match all.len() == count {
            true => Ok(Some(all)),
            false => Err(format!("line {line}: `{text}` is not {count} of (x,y,z)")),
        }
    }

    fn spacings(&self, count: usize) -> Found<Option<Vec<f64>>> {
        let Some((line, text)) = self.find("spacings") else { return Ok(None) };
        let all = numbers(line, text.split_whitespace())?;
        match all.len() == count {
            true => Ok(Some(all)),
            false => Err(format!("line {line}: {} numbers where {count} are needed", all.len())),
        }
    }

    /// Spacing, axes and origin in millimetres, left-posterior-superior.
    fn placement(&self, axes: &Axes) -> Found<Placement> {
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
        let directions = if let Some(all) = &axes.directions {
            let [i, j, k] = axes.space.map(|axis| all[axis].unwrap_or(DVec3::NAN));
            DMat3::from_cols(i, j, k)
        } else if let Some(all) = &axes.spacings {
            DMat3::from_diagonal(axes.space.map(|axis| all[axis]).into())
        } else {
            return Err("the header has neither `space directions` nor `spacings`: how large a voxel is, is \
                        unknown; add `spacings: x y z` in mm"
                .into());
        };
        let origin = match self.find("space origin") {
            Some((line, text)) => match vectors(line, text)?[..] {
                [Some(origin)] => origin,
                _ => return Err(format!("line {line}: `{text}` is not one (x,y,z)")),
            },
            None => DVec3::ZERO,
        };
        // Units are of the world's axes: with `spacings`, these are the volume's.
        let to_lps = to_lps * DMat3::from_diagonal(self.units(axes)?);
        // Signs of spacings go to the axes, as those of directions do.
        Ok(placement(to_lps * directions, to_lps * origin))
    }

    /// Millimetres in the unit of each axis of the world.
    fn units(&self, axes: &Axes) -> Found<DVec3> {
        let (line, text, of_world) = match (self.find("space units"), self.find("units")) {
            (Some((line, text)), _) => (line, text, true),
            (None, Some((line, text))) => (line, text, false),
            (None, None) => return Ok(DVec3::ONE),
        };
        let scale = |name: &String| {
            let plain = name.trim().to_lowercase();
            let found = UNITS.iter().find(|(_, names)| names.contains(&plain.as_str()));
            found.map(|(mm, _)| *mm).ok_or_else(|| {
                format!(
                    "line {line}: units of {name}; mm, cm, m, um and nm are read: convert the spacing \
                     and the origin to mm, or correct the unit"
                )
            })
        };
        let names = words(text);
        let count = axes.sizes.len();
        // An axis that does not lie in space may have any unit.
        let heard: Vec<_> = match of_world || names.len() != count {
            true => names.iter().collect(),
            false => axes.space.iter().map(|&axis| &names[axis]).collect(),
        };
        let all = heard.into_iter().map(scale).collect::<Found<Vec<_>>>()?;
        match all[..] {
            [first, ..] if all.iter().all(|&mm| mm == first) => Ok(DVec3::splat(first)),
            [x, y, z] if of_world || axes.directions.is_none() => Ok(DVec3::new(x, y, z)),
            [_, _, _] => Err(format!(
                "line {line}: units {text}: they differ, and `space directions` mix the axes; \
                 convert the directions and the origin to mm"
            )),
            _ => Err(format!("line {line}: units {text}: one is needed for each axis")),
        }
    }
}

/// The axes of the data, fastest first.
struct Axes {
    sizes: Vec<u32>,
    /// Those that lie in space.
    space: [usize; 3],
    directions: Option<Vec<Option<DVec3>>>,
    spacings: Option<Vec<f64>>,
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
        // What is not UTF-8 is Latin-1, whose bytes are the first characters of Unicode.
        let line = String::from_utf8(line)
            .unwrap_or_else(|e| e.into_bytes().into_iter().map(char::from).collect());
        Ok(Some(line.trim_end_matches('\r').to_string()))
    }
}

/// Vectors as `(x,y,z) none (x,y,z)`.
fn vectors(line: usize, text: &str) -> Found<Vec<Option<DVec3>>> {
    let wrong = || format!("line {line}: `{text}` is not (x,y,z), or several");
    let (mut all, mut rest) = (Vec::new(), text.trim());
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            all.push(None);
            rest = after.trim_start();
            continue;
        }
        let (inner, after) =
            rest.strip_prefix('(').and_then(|r| r.split_once(')')).ok_or_else(wrong)?;
        let values = numbers(line, inner.split(',').map(str::trim))?;
        let vector = <[f64; 3]>::try_from(values)
            .map_err(|v| format!("line {line}: {} numbers where three are needed", v.len()))?;
        all.push(Some(vector.into()));
        rest = after.trim_start();
    }
    Ok(all)
}

fn numbers<'a>(line: usize, texts: impl Iterator<Item = &'a str>) -> Found<Vec<f64>> {
    let each =
        |text: &str| text.parse().map_err(|_| format!("line {line}: `{text}` is not a number"));
    texts.map(each).collect()
}

/// Words between blanks; what stands in quotes is one, or none, whatever is in it.
fn words(text: &str) -> Vec<String> {
    let mut all = Vec::new();
    let mut rest = text.trim_start();
    while !rest.is_empty() {
        let (word, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => rest.split_once(char::is_whitespace).unwrap_or((rest, "")),
        };
        all.push(word.to_owned());
        rest = after.trim_start();
    }
    all
}

/// Writes a volume with gzip encoding. The file appears whole or not at all.
///
/// Physical values are written: whole numbers as integers, which [`super::load`] stores
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
