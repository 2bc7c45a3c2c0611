//! Volumes: a regular grid of scalar values with its place in the world.
//!
//! Readers and phantoms make [`Values`]; [`Volume::new`] checks them and stores
//! them at their own precision. Indices are (i, j, k), i fastest in memory.

use std::borrow::Cow;
use std::fs::File;
use std::io::Read;
use std::path::Path;

use glam::{DAffine3, DMat3, DVec3};

use crate::error::{Error, Result};

pub mod cells;
pub mod nifti;
pub mod nrrd;
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
        Ok(Self { size, spacing, axes, origin, voxels, range, step })
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

    /// The stored voxels.
    pub fn voxels(&self) -> &Voxels {
        &self.voxels
    }

    /// What takes the numbers that a kernel is given, of which the least is 0, to [0, 1]
    /// over the data's range (the greatest may land one rounding step off 1); 0 where all
    /// values are equal.
    pub fn gain(&self) -> f32 {
        let [low, high] = self.range;
        let span = match self.voxels {
            Voxels::F32(_) => high - low,
            Voxels::U8(_) | Voxels::U16(_) => ((high - low) / self.step).round(),
        };
        if span > 0.0 { (1.0 / span) as f32 } else { 0.0 }
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

    /// Value of voxel (i, j, k) in [0, 1] over the data's range, bit for bit as
    /// a kernel finds it with [`Self::gain`].
    ///
    /// # Panics
    /// Outside the volume.
    pub fn unit(&self, i: u32, j: u32, k: u32) -> f32 {
        self.given(self.index(i, j, k)) * self.gain()
    }

    /// How many voxels lie in each of `bins` equal parts of the range.
    pub fn histogram(&self, bins: usize) -> Vec<u64> {
        let gain = self.gain();
        let mut counts = vec![0; bins];
        for at in 0..self.size.iter().map(|&n| n as usize).product() {
            let v = self.given(at) * gain;
            counts[((v * bins as f32) as usize).min(bins - 1)] += 1;
        }
        counts
    }

    /// The rigid map from the world to mm along i, j, k from [`Self::corner`];
    /// it takes points, and directions as vectors.
    pub fn local_from_world(&self) -> DAffine3 {
        let turn = self.axes.transpose();
        DAffine3::from_mat3_translation(turn, -(turn * self.corner()))
    }
}

/// Reads a volume: NRRD (`.nrrd`) or NIfTI-1 (`.nii`, `.nii.gz`), told by its
/// first bytes, by its ending where these say nothing.
///
/// # Errors
/// [`Error::Io`] where the file cannot be read, [`Error::Volume`] where it is
/// damaged, unsupported, or refused by [`Volume::new`].
pub fn load(path: impl AsRef<Path>) -> Result<Volume> {
    let path = path.as_ref();
    let mut start = Vec::new();
    File::open(path)
        .and_then(|file| file.take(4).read_to_end(&mut start))
        .map_err(|source| Error::Io { path: path.into(), action: "read", source })?;
    let name = path.file_name().map(|n| n.to_string_lossy().to_lowercase()).unwrap_or_default();
    if start.starts_with(b"NRRD") || name.ends_with(".nrrd") {
        nrrd::read(path)
    } else if nifti::starts(&start) || name.ends_with(".nii") || name.ends_with(".nii.gz") {
        nifti::read(path)
    } else {
        Err(Error::volume(
            path,
            "not a volume that is read here: NRRD (.nrrd) and NIfTI-1 (.nii, .nii.gz) are; convert it to one of them",
        ))
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

/// Splits direction vectors, mm a voxel, into spacing and unit axes.
fn spacing_and_axes(directions: DMat3) -> (DVec3, DMat3) {
    let columns = [directions.x_axis, directions.y_axis, directions.z_axis];
    let spacing = DVec3::from(columns.map(DVec3::length));
    // A column of zeros has no direction: its spacing is what gets refused, with NaN here.
    (
        spacing,
        DMat3::from_cols(columns[0] / spacing.x, columns[1] / spacing.y, columns[2] / spacing.z),
    )
}

/// What a reader found wrong in a file, before the path is added.
type Found<T> = std::result::Result<T, String>;

/// Reads what is left, which must be `count` elements of `kind` and not a byte
/// more. `length` is the file's own, of which `packed` says that it is deflated.
fn read_elements(
    mut from: impl Read,
    kind: Kind,
    size: [u32; 3],
    big_endian: bool,
    packed: bool,
    length: u64,
) -> Found<Elements> {
    // Deflate shrinks by 1032 at most: what cannot be there is not waited for,
    // and no header makes this allocate beyond its file.
    const DEFLATE: u64 = 1032;
    let count = voxel_count(size).map_err(|e| e.to_string())?;
    let wanted = count * kind.bytes() as u64;
    let need = format!("{} voxels of {} bytes need {wanted} bytes", by(size), kind.bytes());
    if length.saturating_mul(if packed { DEFLATE } else { 1 }) < wanted {
        return Err(format!("truncated: {need}, and the whole file has {length}; get it again"));
    }
    let mut bytes = Vec::new();
    usize::try_from(wanted + 1)
        .map_err(|e| e.to_string())
        .and_then(|n| bytes.try_reserve_exact(n).map_err(|e| e.to_string()))
        .map_err(|e| {
            format!("{need}, more than there is memory for ({e}); crop or resample the volume")
        })?;
    from.by_ref().take(wanted + 1).read_to_end(&mut bytes).map_err(|e| {
        format!("damaged data after {} bytes ({e}); {need}; get it again", bytes.len())
    })?;
    match bytes.len() as u64 {
        n if n < wanted => Err(format!("truncated: {need}, and there are {n}; get it again")),
        n if n > wanted => Err(format!(
            "surplus data: {need}, and there are more; the header disagrees with the data"
        )),
        _ => Ok(kind.decode(&bytes, big_endian)),
    }
}

/// A size as people write it.
fn by(size: [u32; 3]) -> String {
    let [i, j, k] = size;
    format!("{i} x {j} x {k}")
}
