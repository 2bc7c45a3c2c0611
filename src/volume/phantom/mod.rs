//! Built-in phantoms: procedural volumes with the values, soft edges and noise
//! of CT, so that everything can be shown and tested without a scan.
//!
//! A phantom is a list of layers painted over one another, innermost last.
//! A voxel is covered by a shape as its signed distance says, over one voxel's
//! width; a slice is painted at a time, and only where a shape's bounds reach.
//! Each named structure has its own window of values; the edge between two
//! structures passes thinly through the windows between them, as in CT.

use glam::{DMat3, UVec3, Vec3};
use rayon::prelude::*;

use super::{Values, Volume};
use crate::error::{Error, Result};

mod cornell;
mod engine;
mod hand;
mod kidneys;
mod shape;
mod torso;

use shape::Shape;

/// Sizes that [`build`] takes, voxels along the longest axis.
pub const SIZES: std::ops::RangeInclusive<u32> = 16..=1024;

/// A built-in phantom. Displays as, and parses from, its name in lower case.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Phantom {
    /// A room open to the front, with a sphere, a transparent box and a thin
    /// medium: eight-bit labels with hard edges, for nearest filtering.
    Cornell,
    /// A left hand with forearm, palm to the front: skin, vessels, bones with marrow.
    Hand,
    /// Two cylinders of an engine with valves, bolt holes and a thin casing.
    Engine,
    /// A trunk with contrast-filled heart and aorta, lungs, ribs and spine.
    Torso,
    /// Aorta, renal arteries and two kidneys with contrast in their pelvis.
    Kidneys,
}

/// A structure and the window of physical values that its voxels have.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tissue {
    /// What it is, as scenes name it.
    pub name: &'static str,
    /// Least value: HU, labels in `cornell`.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
}

impl Tissue {
    const fn new(name: &'static str, low: f64, high: f64) -> Self {
        Self { name, low, high }
    }

    /// The value inside, noise aside: the middle of the window.
    pub fn plateau(&self) -> f64 {
        0.5 * (self.low + self.high)
    }
}

impl Phantom {
    /// Its structures by rising value, air aside.
    ///
    /// | phantom | tissue | window | plateau |
    /// |---|---|---|---|
    /// | `cornell` | `medium` | 24..40 | 32 |
    /// | | `box` | 56..72 | 64 |
    /// | | `red` | 88..104 | 96 |
    /// | | `green` | 120..136 | 128 |
    /// | | `white` | 152..168 | 160 |
    /// | | `sphere` | 184..200 | 192 |
    /// | `hand` | `skin` | -180..-20 | -100 |
    /// | | `soft tissue` | 0..100 | 50 |
    /// | | `marrow` | 140..230 | 185 |
    /// | | `vessels` | 280..480 | 380 |
    /// | | `bone` | 700..1500 | 1100 |
    /// | `engine` | `casing` | 500..1100 | 800 |
    /// | | `block` | 1600..2400 | 2000 |
    /// | | `valves` | 3000..3800 | 3400 |
    /// | `torso` | `lungs` | -900..-700 | -800 |
    /// | | `skin` | -180..-20 | -100 |
    /// | | `soft tissue` | 0..100 | 50 |
    /// | | `marrow` | 140..230 | 185 |
    /// | | `vessels` | 280..480 | 380 |
    /// | | `bone` | 700..1500 | 1100 |
    /// | `kidneys` | `tissue` | -150..-30 | -90 |
    /// | | `cortex` | 130..230 | 180 |
    /// | | `vessels` | 300..460 | 380 |
    /// | | `contents` | 600..800 | 700 |
    pub fn tissues(self) -> &'static [Tissue] {
        match self {
            Self::Cornell => &cornell::TISSUES,
            Self::Hand => &hand::TISSUES,
            Self::Engine => &engine::TISSUES,
            Self::Torso => &torso::TISSUES,
            Self::Kidneys => &kidneys::TISSUES,
        }
    }

    fn plan(self) -> Plan {
        match self {
            Self::Cornell => cornell::plan(),
            Self::Hand => hand::plan(),
            Self::Engine => engine::plan(),
            Self::Torso => torso::plan(),
            Self::Kidneys => kidneys::plan(),
        }
    }
}

/// What outside air has in CT, HU.
const AIR: f64 = -1000.0;

/// A phantom before it is cut into voxels. World frame, mm.
struct Plan {
    /// Outer corners of the volume.
    bounds: [Vec3; 2],
    /// Value outside every shape.
    air: f64,
    /// Standard deviation of the noise; it stays below 3.5 of them.
    noise: f32,
    /// Labels with hard edges, eight bits, rather than soft edges, sixteen.
    labels: bool,
    /// From the outermost to the innermost.
    layers: Vec<Layer>,
}

/// A shape painted in shells: each covers what lies deeper in it than its mm.
struct Layer {
    shape: Shape,
    shells: Vec<(f32, f64)>,
}

impl Layer {
    /// A shape of one value.
    fn solid(tissue: Tissue, shape: Shape) -> Self {
        Self::shells(shape, [(0.0, tissue)])
    }

    /// A shape with tissues from given depths on.
    fn shells(shape: Shape, shells: impl IntoIterator<Item = (f32, Tissue)>) -> Self {
        let shells = shells.into_iter().map(|(depth, tissue)| (depth, tissue.plateau())).collect();
        Self { shape, shells }
    }

    /// A hole.
    fn hole(shape: Shape) -> Self {
        Self { shape, shells: vec![(0.0, AIR)] }
    }
}

/// Builds a phantom, `size` voxels along its longest axis, its extent in mm
/// being fixed. The same voxels every time.
///
/// # Errors
/// [`Error::Setting`] for a size outside [`SIZES`].
pub fn build(phantom: Phantom, size: u32) -> Result<Volume> {
    if !SIZES.contains(&size) {
        let (least, most) = (SIZES.start(), SIZES.end());
        return Err(Error::setting(format!(
            "phantom size {size}: it goes from {least} to {most} voxels"
        )));
    }
    let plan = phantom.plan();
    let extent = plan.bounds[1] - plan.bounds[0];
    let counts = (extent * (size as f32 / extent.max_element())).round().as_uvec3().max(UVec3::ONE);
    let grid = Grid { low: plan.bounds[0], spacing: extent / counts.as_vec3(), counts };
    let values: Values = if plan.labels {
        paint(&plan, &grid, |value| value as u8).into()
    } else {
        paint(&plan, &grid, |value| value as i16).into()
    };
    let spacing = extent.as_dvec3() / counts.as_dvec3();
    let origin = grid.low.as_dvec3() + 0.5 * spacing;
    Volume::new(counts.to_array(), spacing, DMat3::IDENTITY, origin, values)
}

struct Grid {
    low: Vec3,
    spacing: Vec3,
    counts: UVec3,
}

impl Grid {
    fn centre(&self, voxel: UVec3) -> Vec3 {
        self.low + (voxel.as_vec3() + 0.5) * self.spacing
    }

    /// Voxels, half-open, that a shape within `bounds` can cover in part.
    fn reach(&self, bounds: [Vec3; 2]) -> [UVec3; 2] {
        let voxel = |p: Vec3| (p - self.low) / self.spacing;
        let cut = |v: Vec3| v.max(Vec3::ZERO).as_uvec3().min(self.counts);
        [cut(voxel(bounds[0]).floor() - 1.0), cut(voxel(bounds[1]).ceil() + 1.0)]
    }
}

/// Paints slice by slice on all cores; `store` narrows a rounded value.
fn paint<T: Copy + Default + Send>(
    plan: &Plan,
    grid: &Grid,
    store: impl Fn(f32) -> T + Sync,
) -> Vec<T> {
    let slice = (grid.counts.x * grid.counts.y) as usize;
    let mut voxels = vec![T::default(); slice * grid.counts.z as usize];
    let reaches: Vec<_> =
        plan.layers.iter().map(|layer| grid.reach(layer.shape.bounds())).collect();
    let width = grid.spacing.element_sum() / 3.0;
    let paint_slice = |values: &mut Vec<f32>, (k, out): (usize, &mut [T])| {
        let k = k as u32;
        values.fill(plan.air as f32);
        for (layer, [low, high]) in plan.layers.iter().zip(&reaches) {
            if !(low.z..high.z).contains(&k) {
                continue;
            }
            for (i, j) in (low.y..high.y).flat_map(|j| (low.x..high.x).map(move |i| (i, j))) {
                let value = &mut values[(i + grid.counts.x * j) as usize];
                let distance = layer.shape.distance(grid.centre(UVec3::new(i, j, k)));
                for &(depth, plateau) in &layer.shells {
                    // A shell thinner than a voxel would never reach its plateau.
                    let depth = if depth > 0.0 { depth.max(width) } else { 0.0 };
                    let inside = 0.5 - (distance + depth) / width;
                    let cover =
                        if plan.labels { f32::from(inside >= 0.5) } else { inside.clamp(0.0, 1.0) };
                    *value += cover * (plateau as f32 - *value);
                }
            }
        }
        for (at, (out, value)) in (0..).zip(out.iter_mut().zip(values.iter())) {
            let voxel = UVec3::new(at % grid.counts.x, at / grid.counts.x, k);
            let grain = if plan.labels && *value == plan.air as f32 { 0.0 } else { noise(voxel) };
            *out = store((value + plan.noise * grain).round());
        }
    };
    let slices = voxels.par_chunks_mut(slice).enumerate();
    slices.for_each_init(|| vec![0.0; slice], paint_slice);
    voxels
}

/// Nearly normal noise of variance 1, below 3.5 in size: the sum of a hash's four bytes.
fn noise(voxel: UVec3) -> f32 {
    let sum: u32 =
        hash(voxel.x, hash(voxel.y, hash(voxel.z, 0))).to_le_bytes().map(u32::from).iter().sum();
    (sum as f32 - 510.0) / 147.8
}

/// A well-mixed hash of two words (Wellons' `lowbias32`).
fn hash(word: u32, seed: u32) -> u32 {
    let mut x = word ^ seed.wrapping_mul(0x9e37_79b9).wrapping_add(0x85eb_ca6b);
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

#[cfg(test)]
mod tests;
