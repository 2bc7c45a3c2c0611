//! One frame, from scene to image: one function, one line a stage.

use std::time::{Duration, Instant};

use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::film::Image;
use crate::gpu::clock::{Timing, milliseconds};
use crate::gpu::counter::Counters;
use crate::gpu::{Gpu, Progress};
use crate::irradiance::grid::Cells;
use crate::irradiance::{IrradianceCache, Until};
use crate::photon::SLOT_BYTES;
use crate::reference::{Estimate, Reference};
use crate::scene::{Cache, Method, Scene};
use crate::split::Split;
use crate::update::PhotonFrame;
use crate::volume::Volume;

/// What a render cost and did.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Report {
    /// Adapter's name.
    pub adapter: String,
    /// What the stage times were taken with.
    pub clock: &'static str,
    /// Scene's name.
    pub scene: String,
    /// How the image was computed.
    pub method: &'static str,
    /// The light field, with its weighting.
    pub estimator: Option<&'static str>,
    /// Photons traced.
    pub photons: u64,
    /// Slots of each photon.
    pub max_events: u32,
    /// Gather radius, mm.
    pub radius_mm: Option<f32>,
    /// Cells of the fluence grid.
    pub grid: Option<[u32; 3]>,
    /// Rate of tentative collisions, 1/mm.
    pub majorant: f64,
    /// Table entries whose extinction was clamped to it.
    pub entries_clamped: usize,
    /// Segments of one ray a pixel.
    pub segments: u64,
    /// Rays a pixel, or samples of the reference.
    pub rays: u32,
    /// What the stages counted.
    pub counts: Counters,
    /// Bytes of a photon slot.
    pub slot_bytes: u64,
    /// Bytes of a segment.
    pub segment_bytes: u64,
    /// Bytes of each buffer.
    pub bytes: Vec<(&'static str, u64)>,
    /// Cells of the irradiance cache.
    pub cells: Option<Cells>,
    /// Time in each kernel.
    pub stages: Vec<Timing>,
    /// Wall-clock time from upload to image, ms.
    pub total_ms: f64,
}

/// An image, with what it cost.
pub struct Rendered {
    /// Linear radiance.
    pub image: Image,
    /// Standard error of each pixel, where the method knows it.
    pub error: Option<Image>,
    /// What it cost.
    pub report: Report,
}

/// Renders a settled scene, as its settings say.
///
/// # Errors
/// A setting that cannot be, memory that does not suffice, a device that failed.
pub fn render(
    gpu: &Gpu,
    scene: &Scene,
    volume: &Volume,
    split: &Split,
    progress: &mut Progress,
) -> Result<Rendered> {
    render_for(gpu, scene, volume, split, None, progress)
}

/// The same; for so long, if a time is given and the method goes on as long as one likes.
///
/// # Errors
/// As [`render`]; or the method does not go on.
pub fn render_for(
    gpu: &Gpu,
    scene: &Scene,
    volume: &Volume,
    split: &Split,
    time: Option<Duration>,
    progress: &mut Progress,
) -> Result<Rendered> {
    if time.is_some() && scene.settings.method != Method::IrradianceCache {
        return Err(Error::setting("a time is for `method = \"irradiance-cache\"` alone"));
    }
    let begun = Instant::now();
    gpu.take_timings()?;
    let device = DeviceScene::new(gpu, scene, volume)?;
    let mut report = Report {
        adapter: gpu.report().name.clone(),
        clock: if gpu.has_timestamps() { "device timestamps" } else { "host clock" },
        scene: scene.name.clone(),
        method: "photon-map",
        estimator: None,
        photons: 0,
        max_events: 0,
        radius_mm: None,
        grid: None,
        majorant: f64::from(device.params.majorant),
        entries_clamped: device.table.clamped,
        segments: 0,
        rays: scene.settings.rays,
        counts: Counters::default(),
        slot_bytes: SLOT_BYTES,
        segment_bytes: 0,
        bytes: device.bytes(),
        cells: None,
        stages: Vec::new(),
        total_ms: 0.0,
    };
    let (image, error) = if scene.settings.method == Method::IrradianceCache {
        let mut cache = IrradianceCache::new(gpu, scene, device)?;
        let until = time.map_or(Until::Passes(scene.settings.samples), Until::Time);
        cache.run(gpu, until, progress)?;
        let images = cache.images(gpu)?;
        report.method = "irradiance-cache";
        report.rays = cache.passes();
        report.counts = cache.counts(gpu)?;
        report.cells = cache.cells(gpu)?;
        report.bytes.extend(cache.bytes());
        // That of samples, where the cache is not blended in.
        let error = (scene.settings.cache == Cache::None).then_some(images.error);
        (images.blended, error)
    } else if scene.settings.method == Method::PhotonMap {
        let mut frame = PhotonFrame::new(gpu, scene, device, split)?;
        frame.rebuild(gpu, split, progress)?;
        fill(&frame, gpu, &mut report)?;
        (frame.segments.image(gpu)?, None)
    } else {
        let mut reference = Reference::new(gpu, scene, &device)?;
        reference.add(gpu, &device, scene.settings.samples, progress)?;
        report.method = if scene.settings.method == Method::Mcvr { "mcvr" } else { "reference" };
        report.rays = scene.settings.samples;
        report.bytes.push(("film", reference.bytes()));
        let Estimate { mean: image, error } = reference.image(gpu)?;
        (image, Some(error))
    };
    report.stages = gpu.take_timings()?.rows().to_vec();
    report.total_ms = milliseconds(begun.elapsed());
    Ok(Rendered { image, error, report })
}

fn fill(frame: &PhotonFrame, gpu: &Gpu, report: &mut Report) -> Result<()> {
    report.estimator = Some(frame.field.name());
    report.photons = frame.scene.lights.photons.into();
    report.max_events = frame.map.max_events;
    report.segments = frame.segments.count();
    report.segment_bytes = frame.segments.segment_bytes();
    report.counts = frame.counts(gpu)?;
    let lists = frame.list_bytes();
    report.bytes.extend([
        ("photon slots", frame.map.bytes()),
        ("segments", frame.segments.bytes()),
        ("photon lists", lists.photons),
        ("journal", lists.journal),
        ("segment lists", lists.segments),
    ]);
    report.radius_mm = frame.field.radius();
    report.grid = frame.field.grid();
    report.bytes.push(("light field", frame.field.bytes()));
    Ok(())
}
