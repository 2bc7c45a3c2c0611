//! Edits measured: each applied as an update, beside full rebuilds of the edited scene.

use std::time::Instant;

use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::film::Image;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::clock::{Effort, Timing, milliseconds};
use crate::gpu::counter::Counters;
use crate::scene::Scene;
use crate::segment::Segment;
use crate::split::Split;
use crate::update::{Phases, PhotonFrame, Scope, Updated};
use crate::volume::Volume;

/// Time by stage.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Cost {
    /// Time in each kernel.
    pub stages: Vec<Timing>,
    /// Wall-clock time, ms.
    pub total: f64,
    /// What the host did for it.
    #[serde(flatten)]
    pub effort: Effort,
    /// The stages' times, summed by phase.
    #[serde(skip)]
    pub phases: Phases,
}

impl Cost {
    /// Time in all kernels, ms.
    pub fn kernels(&self) -> f64 {
        self.phases.photons + self.phases.light_field + self.phases.segments
    }

    /// Time in some kernels, ms.
    pub fn in_kernels(&self, names: &[&str]) -> f64 {
        self.stages.iter().filter(|row| names.contains(&row.stage)).map(|row| row.ms).sum()
    }
}

/// What an update left that a rebuild would not have: all zero, or a bug.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Mismatches {
    /// Photon slots that differ, histories aside.
    pub photon_mismatches: u64,
    /// Cells of the fluence, or points, that differ.
    pub field_mismatches: u64,
    /// Segments that differ, histories aside.
    pub segment_mismatches: u64,
    /// Pixels that differ.
    pub pixel_mismatches: u64,
}

impl Mismatches {
    /// All together.
    pub fn all(&self) -> u64 {
        self.of_light() + self.segment_mismatches + self.pixel_mismatches
    }

    /// Those of photons and of the light field, of which no setting leaves any.
    pub fn of_light(&self) -> u64 {
        self.photon_mismatches + self.field_mismatches
    }
}

/// An edit applied as an update.
#[derive(Clone, Debug)]
pub struct Update {
    /// What the edit could reach.
    pub scope: Scope,
    /// What the update did.
    pub done: Updated,
    /// What edit and update took.
    pub cost: Cost,
}

/// A rebuild of everything.
#[derive(Clone, Debug)]
pub struct Rebuild {
    /// What it did.
    pub done: Updated,
    /// What it took.
    pub cost: Cost,
}

/// One edit, as an update and as a full rebuild.
#[derive(Clone, Debug)]
pub struct Measured {
    /// The edit as an update.
    pub update: Update,
    /// What the full rebuild counted.
    pub full_counts: Counters,
    /// Table entries whose extinction the majorant clamps.
    pub entries_clamped: usize,
    /// The fastest full rebuild: no histories, no lists, no comparing.
    pub full: Cost,
    /// Against a rebuild by the same kernels, where that was asked for.
    pub mismatches: Option<Mismatches>,
}

/// Applies an edited scene to a frame, and measures that against full rebuilds.
///
/// # Errors
/// The edit does not suit the frame; memory does not suffice; the device failed.
pub fn measure(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    scene: &Scene,
    volume: &Volume,
    verify: bool,
    progress: &mut Progress,
) -> Result<Measured> {
    let update = update(gpu, frame, scene, progress)?;
    let mut plain = scene.clone();
    plain.settings.history = false;
    let mut fastest = fresh(gpu, &plain, volume)?;
    // A driver may compile a kernel when it first runs, and how long slices take is to be learned.
    rebuild(gpu, &mut fastest, progress)?;
    let full = rebuild(gpu, &mut fastest, progress)?;
    drop(fastest);

    let mismatches = match verify {
        false => None,
        true => {
            let mut rebuilt = fresh(gpu, scene, volume)?;
            rebuilt.rebuild(gpu, &Split::default(), progress)?;
            Some(compare(gpu, frame, &rebuilt)?)
        }
    };
    Ok(Measured {
        update,
        full_counts: full.done.counts,
        entries_clamped: frame.scene.table.clamped,
        full: full.cost,
        mismatches,
    })
}

/// Applies an edited scene to a frame.
///
/// # Errors
/// The edit does not suit the frame; the device failed.
pub fn update(
    gpu: &Gpu,
    frame: &mut PhotonFrame,
    scene: &Scene,
    progress: &mut Progress,
) -> Result<Update> {
    gpu.take_timings()?;
    let begun = Begun::now(gpu);
    let scope = frame.edit(gpu, scene, &Split::default())?;
    let done = frame.update(gpu, &Split::default(), progress)?;
    Ok(Update { scope, done, cost: begun.cost(gpu)? })
}

/// Rebuilds a frame, its memory and kernels being there before the clock runs.
///
/// # Errors
/// The device failed.
pub fn rebuild(gpu: &Gpu, frame: &mut PhotonFrame, progress: &mut Progress) -> Result<Rebuild> {
    gpu.take_timings()?;
    let begun = Begun::now(gpu);
    let done = frame.rebuild(gpu, &Split::default(), progress)?;
    Ok(Rebuild { done, cost: begun.cost(gpu)? })
}

/// A frame of which nothing is computed yet.
///
/// # Errors
/// Memory does not suffice.
pub fn fresh(gpu: &Gpu, scene: &Scene, volume: &Volume) -> Result<PhotonFrame> {
    let device = DeviceScene::new(gpu, scene, volume)?;
    PhotonFrame::new(gpu, scene, device, &Split::default())
}

/// When a measurement began.
struct Begun {
    at: Instant,
    effort: Effort,
}

impl Begun {
    fn now(gpu: &Gpu) -> Self {
        Self { at: Instant::now(), effort: gpu.effort() }
    }

    /// What was spent since, all work being done.
    fn cost(self, gpu: &Gpu) -> Result<Cost> {
        let effort = gpu.effort().since(self.effort);
        gpu.wait("measure")?;
        let total = milliseconds(self.at.elapsed());
        let phases = Phases::of_last(gpu)?;
        Ok(Cost { stages: gpu.take_timings()?.rows().to_vec(), total, effort, phases })
    }
}

/// What differs between two frames of the same scene.
///
/// # Errors
/// The device failed.
pub fn compare(gpu: &Gpu, one: &PhotonFrame, other: &PhotonFrame) -> Result<Mismatches> {
    let mut found = Mismatches::default();
    let (a, b) = (one.map.read(gpu)?, other.map.read(gpu)?);
    let differ = |(a, b): &([[u32; 4]; 2], [[u32; 4]; 2])| a[0] != b[0] || a[1][..2] != b[1][..2];
    found.photon_mismatches += a.len().abs_diff(b.len()) as u64;
    found.photon_mismatches += a.into_iter().zip(b).filter(differ).count() as u64;
    found.field_mismatches = one.field.differing(gpu, &*other.field)?;
    let segments = |frame: &PhotonFrame| -> Result<Vec<Segment>> {
        let mut all = frame.segments.read(gpu)?;
        all.iter_mut().for_each(|s| s[4..6].fill(0));
        Ok(all)
    };
    found.segment_mismatches = differing(&segments(one)?, &segments(other)?);
    found.pixel_mismatches =
        differing_pixels(&one.segments.image(gpu)?, &other.segments.image(gpu)?);
    Ok(found)
}

/// How many pixels of two images differ in any bit.
pub fn differing_pixels(one: &Image, other: &Image) -> u64 {
    let bits = |image: &Image| image.rgb.iter().map(|p| p.map(f32::to_bits)).collect::<Vec<_>>();
    differing(&bits(one), &bits(other))
}

fn differing<T: PartialEq>(one: &[T], other: &[T]) -> u64 {
    let pairs = one.iter().zip(other).filter(|(a, b)| a != b).count();
    (pairs + one.len().abs_diff(other.len())) as u64
}
