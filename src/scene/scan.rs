//! A scene for a volume that comes without one: materials that fit its values, two lights and a
//! camera on the patient's front.
//!
//! What the values mean is judged by [`ScanKind`]. Everything is judged by quantiles and counts,
//! since one damaged voxel must not decide what a scan is made of.
//!
//! Extinctions follow from the size of the volume: a material is given the mean free paths that
//! fit into its edge. So a large and a small object, or one that was resampled, look the same.

use glam::DVec3;

use super::read::preset;
use super::{
    Camera, CameraPlace, FilmSettings, Filter, Light, LightKind, Material, Scene, Settings,
    VolumeSource,
};
use crate::error::{Error, Result};
use crate::transfer::ramp_weight;
use crate::volume::Volume;

/// What the values of a volume are taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScanKind {
    /// CT in Hounsfield units: there is air at about -1000 and tissue about 0.
    Hounsfield,
    /// Whole numbers that name parts.
    Labels,
    /// Any others, such as those of MR: bright and dark.
    Grey,
}

impl std::fmt::Display for ScanKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Hounsfield => "CT in Hounsfield units",
            Self::Labels => "labels, a material each",
            Self::Grey => "no Hounsfield units: materials split the histogram",
        })
    }
}

/// Labels that are told apart, and distinct values that a histogram is taken of as they are.
const MOST_LABELS: usize = 64;

/// Shares of the voxels that count as outliers, at either end.
const OUTLIERS: f64 = 1e-4;

/// Share of the voxels below which a material is not worth having.
const LEAST_SHARE: f64 = 2e-4;

/// Mean free paths along an edge of the volume: what is seen through, and what has a surface.
const THIN: f64 = 0.5;
const SOLID: f64 = 150.0;

impl Scene {
    /// A scene that shows `volume`, which is that of `source`, and what its values were taken for.
    ///
    /// CT has the materials `skin`, `lung`, `soft tissue`, `vessels` and `bone`, as far as they are
    /// there; labels have `label-1` and so on; all else has `low`, `middle` and `high`.
    ///
    /// # Errors
    /// [`Error::Setting`] where all voxels have one value.
    pub fn for_volume(
        source: VolumeSource,
        name: impl Into<String>,
        volume: &Volume,
    ) -> Result<(Self, ScanKind)> {
        let [low, high] = volume.range();
        if low == high {
            return Err(Error::setting(format!(
                "all voxels have the value {low}: there is nothing to see; check the file"
            )));
        }
        let size = Size::of(volume);
        let (kind, materials) = match labels(volume, size) {
            Some(materials) => (ScanKind::Labels, materials),
            None if is_hounsfield(volume) => (ScanKind::Hounsfield, tissues(volume, size)?),
            None => (ScanKind::Grey, greys(volume, size)),
        };
        let scene = Self {
            name: name.into(),
            volume: source,
            filter: if kind == ScanKind::Labels { Filter::Nearest } else { Filter::Linear },
            camera: camera(volume),
            lights: lights(),
            materials,
            background: DVec3::ZERO,
            settings: Settings::default(),
            film: FilmSettings::default(),
            edits: Vec::new(),
        };
        Ok((scene, kind))
    }
}

/// Lengths of a volume that extinctions follow from, mm.
#[derive(Clone, Copy)]
struct Size {
    edge: f64,
    spacing: f64,
}

impl Size {
    fn of(volume: &Volume) -> Self {
        Self {
            edge: volume.extent().element_product().cbrt(),
            spacing: volume.spacing().min_element(),
        }
    }

    /// The extinction that has so many mean free paths along the edge, 1/mm, to two digits. Beyond
    /// two a voxel nothing looks denser, and photons take longer.
    fn extinction(self, paths: f64) -> f64 {
        two_digits((paths / self.edge).min(2.0 / self.spacing))
    }
}

fn two_digits(value: f64) -> f64 {
    rounded(value, value / 10.0)
}

/// Rounded to the power of ten at or below `fineness`, so that files read well.
fn rounded(value: f64, fineness: f64) -> f64 {
    let digits = -fineness.abs().log10().floor();
    let power = 10f64.powf(digits.abs());
    let result = if digits < 0.0 {
        (value / power).round() * power
    } else {
        (value * power).round() / power
    };
    if result.is_finite() { result } else { value }
}

/// From the front, a little from the patient's right, as near as the whole volume is seen.
fn camera(volume: &Volume) -> Camera {
    const FROM: DVec3 = DVec3::new(-0.4, -1.0, 0.1);
    const FOV_DEG: f64 = 24.0;
    // A body does not fill the corners of its volume.
    const NEARER: f64 = 1.08;
    let forward = -FROM.normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let half = (FOV_DEG / 2.0).to_radians();
    let mut away = 0f64;
    for corner in 0..8 {
        let sign = |axis: u32| f64::from(corner >> axis & 1) - 0.5;
        let local = DVec3::new(sign(0), sign(1), sign(2)) * volume.extent();
        let at = volume.axes() * local;
        let across = at.dot(right).abs().max(at.dot(down).abs());
        away = away.max(across / half.tan() - at.dot(forward));
    }
    let radius = volume.extent().length() / 2.0;
    let zoom = rounded(NEARER * radius / half.sin() / away, 0.01);
    Camera {
        place: CameraPlace::Around { from: FROM, zoom },
        up: DVec3::Z,
        fov_deg: FOV_DEG,
        width: 512,
        height: 512,
    }
}

/// A key light from the front, left and above in the picture, and a weak blue one against it.
/// They stand off in radii of the volume, so that it receives the same light at any size.
fn lights() -> Vec<Light> {
    let square = |id, name: &str, share, emitted, from, size| Light {
        id,
        name: name.into(),
        share,
        emitted,
        kind: LightKind::RectangleAround { from, distance: 3.0, size },
    };
    vec![
        square(0, "key", 1.0, DVec3::splat(50.0), DVec3::new(-1.1, -1.0, 0.9), 1.2),
        square(1, "fill", 0.3, DVec3::new(8.0, 10.0, 14.0), DVec3::new(1.0, -0.8, 0.0), 1.5),
    ]
}

// ---- CT in Hounsfield units

/// Whether there is air or what scanners pad with, tissue about water, and something denser.
fn is_hounsfield(volume: &Volume) -> bool {
    const LEAST: f64 = -3100.0;
    const AIR: f64 = -800.0;
    let count = |low, high| volume.counts([low, high], 1)[0] as f64;
    let all: f64 = volume.size().iter().map(|&n| f64::from(n)).product();
    let ends = volume.quantiles(&[0.001, 0.9999]);
    (LEAST..AIR).contains(&ends[0])
        && ends[1] >= 200.0
        && count(LEAST, AIR) >= 0.01 * all
        && count(-200.0, 200.0) >= 0.01 * all
        // In machine parts most is denser than bone.
        && count(1500.0, f64::MAX) <= 0.2 * count(-500.0, f64::MAX)
}

/// Presets of CT by the names that they get here, with mean free paths along the edge.
const TISSUES: [(&str, &str, f64); 5] = [
    ("ct-skin", "skin", 0.6 * THIN),
    ("ct-lung", "lung", 0.1 * THIN),
    ("ct-soft-tissue", "soft tissue", THIN),
    ("ct-vessels", "vessels", 0.6 * SOLID),
    ("ct-bone", "bone", SOLID),
];

fn tissues(volume: &Volume, size: Size) -> Result<Vec<Material>> {
    let values = Histogram::of(volume, [-1100.0, 4100.0], 1040);
    let contrast = values.contrast();
    let mut materials = Vec::new();
    for (source, name, paths) in TISSUES {
        let mut material =
            Material { name: name.into(), extinction: size.extinction(paths), ..preset(source)? };
        // Spongy bone shares the values of contrast agent. Where there is an agent, its peak is told
        // apart from what is denser; else all that is dense is bone.
        match (name, contrast) {
            ("vessels", None) => continue,
            ("vessels", Some([peak, half])) => {
                let at = |halves: f64| (peak + halves * half).round();
                material.ramp =
                    vec![[at(-3.0), 0.0], [at(-2.0), 1.0], [at(1.2), 1.0], [at(2.0), 0.0]];
            }
            ("bone", Some([peak, half])) => {
                let at = |halves: f64| (peak + halves * half).round();
                material.ramp = vec![[at(1.2), 0.0], [at(2.5), 1.0], [4096.0, 1.0]];
            }
            _ => {}
        }
        let least = match name {
            // The values of lung are also those between any tissue and the air beside it: lung has
            // more voxels than its neighbours among these.
            "lung" => (3.0 * values.share(&[[-450.0, 1.0], [-250.0, 1.0]])).max(0.02),
            _ => LEAST_SHARE,
        };
        if values.share(&material.ramp) >= least {
            materials.push(material);
        }
    }
    make_one_solid(&mut materials, size);
    Ok(materials)
}

/// The densest has a surface where nothing else has.
fn make_one_solid(materials: &mut [Material], size: Size) {
    let solid = size.extinction(0.6 * SOLID);
    if materials.iter().all(|m| m.extinction < solid)
        && let Some(last) = materials.last_mut()
    {
        last.extinction = size.extinction(SOLID);
    }
}

/// How many voxels have which values.
struct Histogram {
    /// Value and voxels, values ascending.
    levels: Vec<(f64, f64)>,
    /// Of the volume.
    voxels: f64,
}

impl Histogram {
    fn of(volume: &Volume, [low, high]: [f64; 2], bins: usize) -> Self {
        let middle = |bin: usize| low + (high - low) * (bin as f64 + 0.5) / bins as f64;
        let counts = volume.counts([low, high], bins).into_iter().enumerate();
        Self {
            levels: counts.map(|(bin, n)| (middle(bin), n as f64)).collect(),
            voxels: volume.size().iter().map(|&n| f64::from(n)).product(),
        }
    }

    /// Share of the voxels that a material has.
    fn share(&self, ramp: &[[f64; 2]]) -> f64 {
        self.levels.iter().map(|(v, n)| n * ramp_weight(ramp, *v)).sum::<f64>() / self.voxels
    }

    /// The peak of contrast agent, HU, and half of its width where it has half of its height.
    ///
    /// Without an agent the counts fall all the way from muscle to dense bone; with it there is a
    /// valley between.
    fn contrast(&self) -> Option<[f64; 2]> {
        const STEP: f64 = 25.0;
        /// Steps to where the peak has fallen on both sides.
        const AROUND: usize = 5;
        let count = |value: f64| {
            let near = |(v, _): &&(f64, f64)| (v - value).abs() < STEP;
            // Weights fall to both sides: one voxel more or less moves no peak.
            self.levels.iter().filter(near).map(|(v, n)| n * (1.0 - (v - value).abs() / STEP)).sum()
        };
        let counts: Vec<(f64, f64)> = (0..40)
            .map(|i| 100.0 + STEP * f64::from(i))
            .map(|value| (value, count(value)))
            .collect();
        let mut best: Option<(usize, f64)> = None;
        for at in AROUND..counts.len() - AROUND {
            let (value, n) = counts[at];
            // Bone makes a hump as well, in scans with little noise: a low or a broad one.
            let around = &counts[at - AROUND..=at + AROUND];
            let is_top = around.iter().all(|(_, other)| *other <= n);
            let is_narrow = around[0].1.max(around[2 * AROUND].1) <= 0.6 * n;
            let is_much = n >= (LEAST_SHARE * self.voxels).max(8.0);
            let is_agent = (225.0..=650.0).contains(&value) && is_top && is_narrow && is_much;
            if is_agent && best.is_none_or(|(_, most)| n > most) {
                best = Some((at, n));
            }
        }
        let (at, most) = best?;
        let half = counts[at..].iter().find(|(_, n)| *n < most / 2.0)?.0 - counts[at].0;
        Some([counts[at].0, half])
    }
}

// ---- Labels

/// A material for each label but the background's, which is 0 or else the commonest.
fn labels(volume: &Volume, size: Size) -> Option<Vec<Material>> {
    let levels = volume.levels(MOST_LABELS)?;
    if levels.iter().any(|(v, _)| v.fract() != 0.0) || levels.len() < 2 {
        return None;
    }
    let common = levels.iter().max_by_key(|(_, n)| *n)?.0;
    let background = if levels.iter().any(|(v, _)| *v == 0.0) { 0.0 } else { common };
    if is_noisy(volume, background) {
        return None;
    }
    let inside: u64 = levels.iter().filter(|(v, _)| *v != background).map(|(_, n)| n).sum();
    let gap = |a: usize| (levels[a + 1].0 - levels[a].0) / 2.0;
    let last = levels.len() - 1;
    let mut materials = Vec::new();
    for (at, &(value, n)) in levels.iter().enumerate().filter(|(_, (v, _))| *v != background) {
        let below = gap(if at > 0 { at - 1 } else { at });
        let above = gap(if at < last { at } else { at - 1 });
        // What makes up most of a body is around the rest, and must let it be seen.
        let is_hull = 2 * n > inside && last > 1;
        materials.push(Material {
            ramp: vec![[value - below, 1.0], [value + above, 1.0]],
            colour: hue(materials.len()),
            ..material(
                format!("label-{value}"),
                size.extinction(if is_hull { 4.0 * THIN } else { SOLID }),
            )
        });
    }
    Some(materials)
}

/// Whether neighbours mostly differ where there is something. Few whole values alone make no labels:
/// a coarse picture with noise has few, too.
fn is_noisy(volume: &Volume, background: f64) -> bool {
    let [ni, nj, nk] = volume.size();
    let (mut pairs, mut differing) = (0u64, 0u64);
    for k in 0..nk {
        for j in 0..nj {
            let mut before = volume.value(0, j, k);
            for i in 1..ni {
                let value = volume.value(i, j, k);
                let counts = value != background || before != background;
                pairs += u64::from(counts);
                differing += u64::from(counts && value != before);
                before = value;
            }
        }
    }
    2 * differing > pairs
}

/// The n-th of colours of which no two near ones are alike.
fn hue(n: usize) -> DVec3 {
    const GOLDEN: f64 = 0.618_033_988_75;
    let turn = (0.08 + GOLDEN * n as f64).fract() * 6.0;
    let channel = |at: f64| {
        let away = (turn - at).rem_euclid(6.0);
        let near = (2.0 - away.min(6.0 - away)).clamp(0.0, 1.0);
        rounded(0.3 + 0.65 * near, 0.01)
    };
    DVec3::new(channel(0.0), channel(2.0), channel(4.0))
}

// ---- All other values

/// Names, albedos and mean free paths along the edge of what is told apart, by rising value. The
/// background, which comes before them, is nothing.
const GREYS: [(&str, [f64; 3], f64); 3] = [
    ("low", [0.9, 0.66, 0.54], 1.2 * THIN),
    ("middle", [0.93, 0.3, 0.2], 0.15 * SOLID),
    ("high", [0.96, 0.9, 0.78], SOLID),
];

fn greys(volume: &Volume, size: Size) -> Vec<Material> {
    const BINS: usize = 256;
    let all: f64 = volume.size().iter().map(|&n| f64::from(n)).product();
    // In a small volume one voxel is more than that share.
    let cut = OUTLIERS.max(2.0 / all);
    let ends = volume.quantiles(&[cut, 1.0 - cut]);
    let [low, high] = if ends[0] < ends[1] { [ends[0], ends[1]] } else { volume.range() };
    let levels = match volume.levels(BINS) {
        Some(levels) => levels.into_iter().map(|(v, n)| (v, n as f64)).collect(),
        None => Histogram::of(volume, [low, high], BINS).levels,
    };
    let inside = |(v, n): &(f64, f64)| *n > 0.0 && (low..=high).contains(v);
    let levels: Vec<_> = levels.into_iter().filter(inside).collect();
    let mut edges: Vec<f64> = thresholds(&levels, GREYS.len() + 1);
    let fineness = (high - low) / 100.0;
    edges.iter_mut().for_each(|t| *t = rounded(*t, fineness));
    // Beyond the last there is nothing but outliers, which are as dense.
    edges.push(rounded(2.0 * high - low, fineness));
    // With fewer levels than materials, the dense ones are there.
    let first = GREYS.len() + 1 - edges.len();
    let mut materials = Vec::new();
    for ((name, albedo, paths), edge) in GREYS[first..].iter().zip(edges.windows(2)) {
        let soft = |at: f64| rounded(at, fineness / 10.0);
        let width = 0.15 * (edge[1].min(high) - edge[0]);
        let is_last = edge[1] > high;
        let mut ramp = vec![[soft(edge[0] - width), 0.0], [soft(edge[0] + width), 1.0]];
        match is_last {
            true => ramp.push([edge[1], 1.0]),
            false => ramp.extend([[soft(edge[1] - width), 1.0], [soft(edge[1] + width), 0.0]]),
        }
        let albedo = DVec3::from(*albedo);
        let scatter = albedo.max_element();
        materials.push(Material {
            ramp,
            scatter,
            colour: albedo / scatter,
            ..material((*name).into(), size.extinction(*paths))
        });
    }
    materials
}

fn material(name: String, extinction: f64) -> Material {
    Material {
        name,
        ramp: Vec::new(),
        extinction,
        scatter: 0.95,
        colour: DVec3::ONE,
        emission: DVec3::ZERO,
        phase_g: 0.0,
    }
}

/// Where to cut ascending levels, each with its weight, into at most `classes` classes of least
/// variance within: Otsu's method with several thresholds, by dynamic programming.
fn thresholds(levels: &[(f64, f64)], classes: usize) -> Vec<f64> {
    let count = levels.len();
    let classes = classes.min(count);
    // Sums of weight and of weighted value before each level. What a class [a, b) adds to the
    // variance between the classes is the square of its sum over its weight.
    let mut sums = vec![(0.0, 0.0)];
    for (value, weight) in levels {
        let (weights, values) = sums[sums.len() - 1];
        sums.push((weights + weight, values + weight * (value - levels[0].0)));
    }
    let between = |a: usize, b: usize| {
        let (weight, value) = (sums[b].0 - sums[a].0, sums[b].1 - sums[a].1);
        value * value / weight
    };
    // The best for the first `b` levels in one class, two, and so on, and where its last one begins.
    let mut best: Vec<f64> = (0..=count).map(|b| if b > 0 { between(0, b) } else { 0.0 }).collect();
    let mut begins = Vec::new();
    for class in 1..classes {
        let mut next = vec![f64::NEG_INFINITY; count + 1];
        let mut begin = vec![0; count + 1];
        for b in class + 1..=count {
            for (a, before) in best.iter().enumerate().take(b).skip(class) {
                let total = before + between(a, b);
                if total > next[b] {
                    (next[b], begin[b]) = (total, a);
                }
            }
        }
        best = next;
        begins.push(begin);
    }
    let mut at = count;
    let mut cuts = Vec::new();
    for begin in begins.iter().rev() {
        at = begin[at];
        cuts.push((levels[at - 1].0 + levels[at].0) / 2.0);
    }
    cuts.reverse();
    cuts
}
