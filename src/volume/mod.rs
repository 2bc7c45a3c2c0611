//! Volumes: a regular grid of scalar values with its place in the world.
//!
//! Readers and phantoms make [`Values`]; [`Volume::new`] checks them and stores
//! them at their own precision. Indices are (i, j, k), i fastest in memory.

use std::borrow::Cow;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};

pub mod cells;
mod foreign;
mod nifti;
pub mod nrrd;
mod open;
pub mod phantom;
mod statistics;
pub mod texture;
mod values;

pub use values::{Elements, Kind, Values};

/// Greatest size along an axis: the limit of a 3D texture in WebGPU.
pub const MAX_SIZE: u32 = 2048;

/// How far from perpendicular (cosine) or from unit length axes may be before
/// they count as sheared; header files print few digits.
const AXES_TOLERANCE: f64 = 1e-3;

/// Spacings in mm that kernels can square in single precision, and any scan has.
const SPACINGS: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Stored voxels, i fastest, then j, then k, at the data's own precision.
#[derive(Clone, Debug, PartialEq)]
pub enum Voxels {
    /// Eight-bit data, least value stored as 0.
    U8(Vec<u8>),
    /// Sixteen-bit data, and wider integers whose range fits; least value stored as 0.
    U16(Vec<u16>),
    /// Floating-point data as they are, and integers of wider range (exact up to 2^24).
    F32(Vec<f32>),
}

impl Voxels {
    /// The stored type, as Rust names it.
    pub fn name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::U16(_) => "u16",
            Self::F32(_) => "f32",
        }
    }
}

/// The numbers that kernels are given for voxels: whole ones for integer data, from 0 on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Numbers {
    /// Physical value of the number 0, the least of the data.
    pub least: f64,
    /// Physical value for each unit.
    pub step: f64,
    /// The greatest.
    pub span: f64,
    /// Whether all are whole.
    pub are_whole: bool,
}

impl Numbers {
    /// Whether all are whole, and few enough that each can have a table entry of its own.
    pub fn are_few(&self) -> bool {
        self.are_whole && self.span < 4096.0
    }

    /// Least and greatest physical value.
    pub fn range(&self) -> [f64; 2] {
        [self.least, self.least + self.step * self.span]
    }
}

/// A scalar volume. World frame: millimetres, left-posterior-superior.
#[derive(Clone, Debug)]
pub struct Volume {
    size: [u32; 3],
    spacing: DVec3,
    axes: DMat3,
    origin: DVec3,
    voxels: Voxels,
    range: [f64; 2],
    step: f64,
    /// All numbers that kernels are given are whole.
    are_whole: bool,
    warnings: Vec<String>,
}

impl Volume {
    /// A volume of `size` voxels.
    ///
    /// `spacing` in mm between voxel centres; `axes` has the unit directions of
    /// i, j, k as its columns (a mirroring set is fine); `origin` is the centre
    /// of voxel (0, 0, 0) in mm; `values` run i fastest. Axes that are off
    /// orthonormal by rounding (1e-3) are replaced by the nearest that are.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size of 0 or over [`MAX_SIZE`], values that do
    /// not fill the size exactly, a spacing that is not from 1e-6 to 1e6 mm,
    /// sheared axes, an origin that is not finite, NaN or infinite values, and a
    /// range that single precision cannot hold.
    pub fn new(
        size: [u32; 3],
        spacing: DVec3,
        axes: DMat3,
        origin: DVec3,
        values: impl Into<Values>,
    ) -> Result<Self> {
        let values = values.into();
        let count = voxel_count(size)?;
        if count != values.elements.count() as u64 {
            return Err(Error::setting(format!(
                "{} values do not fill a size of {}: {count} are needed",
                values.elements.count(),
                by(size)
            )));
        }
        if !spacing.to_array().iter().all(|s| s.is_finite() && *s > 0.0) {
            return Err(Error::setting(format!(
                "spacing {spacing} mm: each must be positive and finite"
            )));
        }
        if !spacing.to_array().iter().all(|s| SPACINGS.contains(s)) {
            return Err(Error::setting(format!(
                "spacing {spacing} mm: each must be from {:e} to {:e} mm; correct the unit",
                SPACINGS.start(),
                SPACINGS.end()
            )));
        }
        if !origin.is_finite() {
            return Err(Error::setting(format!("origin {origin} mm: each must be finite")));
        }
        let axes = orthonormal(axes)?;
        let values::Stored { voxels, range, step } = values.store(size)?;
        let are_whole = match &voxels {
            Voxels::F32(data) => data.par_iter().all(|value| value.fract() == 0.0),
            Voxels::U8(_) | Voxels::U16(_) => true,
        };
        let warnings = Vec::new();
        Ok(Self { size, spacing, axes, origin, voxels, range, step, are_whole, warnings })
    }

    /// Voxels along i, j, k.
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// Distance between voxel centres along i, j, k in mm.
    pub fn spacing(&self) -> DVec3 {
        self.spacing
    }

    /// Unit directions of i, j, k as columns; orthonormal, the determinant may be -1.
    pub fn axes(&self) -> DMat3 {
        self.axes
    }

    /// Centre of voxel (0, 0, 0) in the world, mm.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Outer corner of voxel (0, 0, 0) in the world, mm.
    pub fn corner(&self) -> DVec3 {
        self.origin - self.axes * (0.5 * self.spacing)
    }

    /// Edge lengths of the whole volume along i, j, k in mm, outer corner to outer corner.
    pub fn extent(&self) -> DVec3 {
        DVec3::from(self.size.map(f64::from)) * self.spacing
    }

    /// Least and greatest physical value.
    pub fn range(&self) -> [f64; 2] {
        self.range
    }

    /// What was odd about the file that it was read from, a sentence each, with the file's name:
    /// to be told to whoever asked for it.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The stored voxels.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }

    /// Physical value for each unit of the numbers that a kernel is given, of which the least is 0.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The number at a memory index that a kernel is given. Far from zero single precision is
    /// coarser than the table, and what a kernel interpolates would leave the range of the
    /// voxels that it is of: floats, too, are given from the least on.
    fn given(&self, at: usize) -> f32 {
        match &self.voxels {
            Voxels::U8(data) => f32::from(data[at]),
            Voxels::U16(data) => f32::from(data[at]),
            Voxels::F32(data) => self.above_least(data[at]),
        }
    }

    fn above_least(&self, value: f32) -> f32 {
        (f64::from(value) - self.range[0]) as f32
    }

    /// The numbers of slab k that a kernel is given, as bytes of their type.
    pub(crate) fn slab(&self, k: usize) -> Cow<'_, [u8]> {
        let [ni, nj, _] = self.size.map(|n| n as usize);
        let within = ni * nj * k..ni * nj * (k + 1);
        match &self.voxels {
            Voxels::U8(data) => Cow::Borrowed(&data[within]),
            Voxels::U16(data) => Cow::Borrowed(bytemuck::cast_slice(&data[within])),
            Voxels::F32(data) => {
                let given = data[within].iter().map(|&value| self.above_least(value));
                Cow::Owned(given.flat_map(f32::to_ne_bytes).collect())
            }
        }
    }

    /// Where voxel (i, j, k) lies in [`Self::voxels`].
    ///
    /// # Panics
    /// Outside the volume.
    pub fn index(&self, i: u32, j: u32, k: u32) -> usize {
        let [ni, nj, nk] = self.size;
        assert!(i < ni && j < nj && k < nk, "voxel {:?} outside {}", [i, j, k], by(self.size));
        i as usize + ni as usize * (j as usize + nj as usize * k as usize)
    }

    /// Physical value of voxel (i, j, k): the file's number under its slope and intercept.
    ///
    /// # Panics
    /// Outside the volume.
    pub fn value(&self, i: u32, j: u32, k: u32) -> f64 {
        let at = self.index(i, j, k);
        match &self.voxels {
            Voxels::F32(data) => data[at].into(),
            Voxels::U8(_) | Voxels::U16(_) => self.range[0] + self.step * f64::from(self.given(at)),
        }
    }

    /// What the numbers of all voxels have in common.
    pub fn numbers(&self) -> Numbers {
        let [least, greatest] = self.range;
        let (span, are_whole) = match &self.voxels {
            Voxels::F32(_) => (greatest - least, self.are_whole),
            Voxels::U8(_) | Voxels::U16(_) => (((greatest - least) / self.step).round(), true),
        };
        Numbers { least, step: self.step, span, are_whole }
    }

    /// The number of voxel (i, j, k) that a kernel is given: its value is the least of the data plus
    /// so many [steps](Self::step).
    ///
    /// # Panics
    /// Outside the volume.
    pub fn number(&self, i: u32, j: u32, k: u32) -> f32 {
        self.given(self.index(i, j, k))
    }

    /// The same bounds with at most `most` voxels along an axis, each one of those that there are. Its
    /// numbers mean what they mean here.
    pub(crate) fn thumbnail(&self, most: u32) -> Self {
        let size = self.size.map(|n| n.min(most));
        let from = |at: u32, axis: usize| at * self.size[axis] / size[axis];
        let places = (0..size[2])
            .flat_map(|k| (0..size[1]).flat_map(move |j| (0..size[0]).map(move |i| [i, j, k])));
        let places = places.map(|[i, j, k]| self.index(from(i, 0), from(j, 1), from(k, 2)));
        let voxels = match &self.voxels {
            Voxels::U8(data) => Voxels::U8(places.map(|at| data[at]).collect()),
            Voxels::U16(data) => Voxels::U16(places.map(|at| data[at]).collect()),
            Voxels::F32(data) => Voxels::F32(places.map(|at| data[at]).collect()),
        };
        let spacing = self.extent() / DVec3::from(size.map(f64::from));
        let origin = self.corner() + self.axes * (0.5 * spacing);
        Self { size, spacing, origin, voxels, ..self.clone() }
    }

    /// How many voxels lie in each of `bins` equal parts of the range.
    pub fn histogram(&self, bins: usize) -> Vec<u64> {
        // Shares large enough that a histogram each costs nothing.
        const SHARE: usize = 1 << 18;
        let span = (self.range[1] - self.range[0]) / self.step;
        let per_number = if span > 0.0 { (bins as f64 / span) as f32 } else { 0.0 };
        let none = || vec![0; bins];
        let count = |mut counts: Vec<u64>, at| {
            counts[((self.given(at) * per_number) as usize).min(bins - 1)] += 1;
            counts
        };
        let sum = |a: Vec<u64>, b: Vec<u64>| a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let total: usize = self.size.iter().map(|&n| n as usize).product();
        (0..total).into_par_iter().with_min_len(SHARE).fold(none, count).reduce(none, sum)
    }

    /// The rigid map from the world to mm along i, j, k from [`Self::corner`];
    /// it takes points, and directions as vectors.
    pub fn local_from_world(&self) -> DAffine3 {
        let turn = self.axes.transpose();
        DAffine3::from_mat3_translation(turn, -(turn * self.corner()))
    }
}

/// Reads a volume: NRRD (`.nrrd`) or NIfTI (`.nii`), either in gzip too, told by its first
/// bytes, by its ending where these say nothing. It may come from a pipe; `-` is standard input.
///
/// What was odd about the file, but did not keep it from being read, is in
/// [`Volume::warnings`].
///
/// # Errors
/// [`Error::Io`] where the file cannot be read, [`Error::Volume`] where it is
/// damaged, unsupported, or refused by [`Volume::new`].
pub fn load(path: impl AsRef<Path>) -> Result<Volume> {
    let mut source = open::Source::open(path.as_ref())?;
    let read = read(&mut source);
    let open::Source { path, warnings, .. } = source;
    let mut volume = read.map_err(|what| Error::volume(&path, what))?;
    volume.warnings = warnings.iter().map(|w| format!("{}: {w}", path.display())).collect();
    Ok(volume)
}

fn read(source: &mut open::Source) -> Found<Volume> {
    let name = source.path.file_name().map(|n| n.to_string_lossy().to_lowercase());
    let name = name.unwrap_or_default();
    let named = |ends: &[&str]| {
        let plain = name.strip_suffix(".gz").unwrap_or(&name);
        ends.iter().any(|end| plain.ends_with(end))
    };
    let start = source.peek(foreign::START);
    let is_empty = start.is_empty();
    if start.starts_with(b"NRRD") {
        nrrd::parse(source)
    } else if nifti::starts(start) {
        nifti::parse(source)
    } else if let Some(what) = foreign::name(start) {
        Err(what)
    } else if named(&[".img"]) {
        Err(foreign::pair(&source.path, "the voxels of an ANALYZE or NIfTI pair, by its name"))
    } else if named(&[".nrrd"]) {
        nrrd::parse(source)
    } else if named(&[".nii", ".hdr"]) {
        nifti::parse(source)
    } else if is_empty {
        Err("empty: not a byte is in it; get it again".into())
    } else {
        Err("not a volume that is read here: NRRD (.nrrd) and NIfTI (.nii, .nii.gz) are; \
             convert it to one of them"
            .into())
    }
}

/// Voxels in a size, if it can be one.
fn voxel_count(size: [u32; 3]) -> Result<u64> {
    if size.contains(&0) {
        return Err(Error::setting(format!("size {}: no side may be 0", by(size))));
    }
    if size.iter().any(|&n| n > MAX_SIZE) {
        return Err(Error::setting(format!(
            "size {}: a 3D texture holds at most {MAX_SIZE} voxels along an axis; crop or resample the volume",
            by(size)
        )));
    }
    // At most 2^33: no overflow.
    Ok(size.iter().map(|&n| u64::from(n)).product())
}

/// The nearest orthonormal axes, if that is near enough to be rounding.
fn orthonormal(mut axes: DMat3) -> Result<DMat3> {
    let gram = axes.transpose() * axes;
    // Stated so that NaN fails.
    if !gram.abs_diff_eq(DMat3::IDENTITY, AXES_TOLERANCE) {
        let [i, j, k] = [axes.x_axis, axes.y_axis, axes.z_axis];
        return Err(Error::setting(format!(
            "axes {i}, {j}, {k} are sheared or not of unit length; sheared volumes are refused: \
             resample onto perpendicular axes"
        )));
    }
    // Newton's iteration for the polar decomposition; quadratic, so that three
    // steps take 1e-3 to rounding. Exact axes stay exact.
    for _ in 0..3 {
        axes = axes * (3.0 * DMat3::IDENTITY - axes.transpose() * axes) * 0.5;
    }
    Ok(axes)
}

/// Where a volume is: what [`Volume::new`] asks for.
struct Placement {
    spacing: DVec3,
    axes: DMat3,
    origin: DVec3,
}

/// Splits direction vectors, mm a voxel, into spacing and unit axes.
fn placement(directions: DMat3, origin: DVec3) -> Placement {
    let columns = [directions.x_axis, directions.y_axis, directions.z_axis];
    let spacing = DVec3::from(columns.map(DVec3::length));
    // A column of zeros has no direction: its spacing is what gets refused, with NaN here.
    let axes =
        DMat3::from_cols(columns[0] / spacing.x, columns[1] / spacing.y, columns[2] / spacing.z);
    Placement { spacing, axes, origin }
}

/// What a reader found wrong in a file, before the path is added.
type Found<T> = std::result::Result<T, String>;

/// A size as people write it.
fn by(size: [u32; 3]) -> String {
    let [i, j, k] = size;
    format!("{i} x {j} x {k}")
}
