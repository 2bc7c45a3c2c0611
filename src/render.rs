//! One frame, from scene to image: one function, one line a stage.

use std::time::Instant;

use crate::error::{Error, Result};
use crate::film::Image;
use crate::fluence::Fluence;
use crate::frame::DeviceScene;
use crate::gpu::Gpu;
use crate::gpu::run::{Timing, milliseconds};
use crate::light::hash;
use crate::photon::{CounterBuffer, Counters, PhotonMap, SLOT_BYTES};
use crate::points::Points;
use crate::reference::Reference;
use crate::scene::{Estimator, Method, Scene};
use crate::segment::{LightField, SEGMENT_BYTES, SegmentMap};
use crate::volume::Volume;

/// What a typical contribution to an integer sum is scaled to: 22 bits of precision,
/// and room for one a thousand times as large before 32 bits clamp it.
pub const CONTRIBUTION: f64 = (1 << 22) as f64;

/// Hears of the progress of long work.
#[derive(Default)]
pub struct Progress<'a>(Option<&'a mut dyn FnMut(&'static str, u64, u64)>);

impl<'a> Progress<'a> {
    /// Tells `hear` the stage, the items done, and the items in all.
    pub fn new(hear: &'a mut dyn FnMut(&'static str, u64, u64)) -> Self {
        Self(Some(hear))
    }

    /// Nobody hears.
    pub fn silent() -> Self {
        Self(None)
    }

    pub(crate) fn at(&mut self, stage: &'static str, done: u64, total: u64) {
        if let Some(hear) = &mut self.0 {
            hear(stage, done, total);
        }
    }
}

/// How the work is cut up. No choice here changes a bit of the result.
#[derive(Clone, Copy, Debug, Default)]
pub struct Split {
    /// Photons in a batch, at most; `None`: as many as a binding holds.
    pub batch_photons: Option<u32>,
    /// Rows of a screen band, at most; `None`: as many as a binding holds.
    pub band_rows: Option<u32>,
    /// Shuffles the work lists with this seed, to show that order does not matter.
    pub shuffle: Option<u64>,
}

impl Split {
    /// The items `0..count`, each once.
    pub(crate) fn work_list(&self, count: u32) -> Vec<u32> {
        let mut items: Vec<u32> = (0..count).collect();
        if let Some(seed) = self.shuffle {
            for i in (1..items.len()).rev() {
                let other = hash(seed ^ (i as u64) << 20) as usize % (i + 1);
                items.swap(i, other);
            }
        }
        items
    }
}

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
    let begun = Instant::now();
    gpu.take_timings();
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
        majorant: f64::from(device.frame.majorant),
        entries_clamped: device.table.clamped,
        segments: 0,
        rays: scene.settings.rays,
        counts: Counters::default(),
        slot_bytes: SLOT_BYTES,
        segment_bytes: SEGMENT_BYTES,
        bytes: device.bytes(),
        stages: Vec::new(),
        total_ms: 0.0,
    };
    let (image, error) = if scene.settings.method == Method::PhotonMap {
        let mut frame = PhotonFrame::new(gpu, scene, device, scene.settings.rays, split)?;
        frame.rebuild(gpu, split, progress)?;
        frame.fill(gpu, &mut report)?;
        (frame.segments.image(gpu)?, None)
    } else {
        let mut reference = Reference::new(gpu, scene, &device)?;
        reference.add(gpu, &device, scene.settings.samples, progress)?;
        report.method = if scene.settings.method == Method::Mcvr { "mcvr" } else { "reference" };
        report.rays = scene.settings.samples;
        report.bytes.push(("film", reference.bytes()));
        let (image, error) = reference.image(gpu)?;
        (image, Some(error))
    };
    report.stages = gpu.take_timings().rows().to_vec();
    report.total_ms = milliseconds(begun.elapsed());
    Ok(Rendered { image, error, report })
}

/// Everything that the photon map of one scene keeps on the device.
pub struct PhotonFrame {
    /// The scene.
    pub scene: DeviceScene,
    /// Its photons.
    pub map: PhotonMap,
    /// Its light field.
    pub field: LightField,
    /// Its view-ray segments.
    pub segments: SegmentMap,
    counters: CounterBuffer,
    estimator: &'static str,
}

impl PhotonFrame {
    /// Room for everything; nothing is computed yet.
    ///
    /// # Errors
    /// Memory does not suffice, or the estimator does not suit the scene.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        device: DeviceScene,
        rays: u32,
        split: &Split,
    ) -> Result<Self> {
        let settings = &scene.settings;
        let isotropic = device.table.is_isotropic();
        let chosen = settings.estimator.unwrap_or(match isotropic {
            true => Estimator::Fluence,
            false => Estimator::Points,
        });
        let map = PhotonMap::new(gpu, &device, settings, split)?;
        let (field, estimator) = match chosen {
            Estimator::Fluence if !isotropic => {
                return Err(Error::setting(
                    "the `fluence` estimator knows isotropic scattering only, and a material has \
                     phase_g other than 0: use `estimator = \"points\"`",
                ));
            }
            Estimator::Fluence => {
                (LightField::Fluence(Fluence::new(gpu, &device, settings)?), "fluence")
            }
            Estimator::Points => {
                let spacing = device.frame.per_voxel.map(|n| 1.0 / f64::from(n));
                let smallest = spacing.iter().copied().fold(f64::INFINITY, f64::min);
                let radius = settings.radius.unwrap_or(smallest);
                let name = match settings.weighting {
                    crate::scene::Weighting::Plain => "points plain",
                    crate::scene::Weighting::Even => "points even",
                };
                (LightField::Points(Points::new(gpu, &device, settings, radius)?), name)
            }
        };
        let segments = SegmentMap::new(gpu, scene, &device, &field, rays, split)?;
        let counters = CounterBuffer::new(gpu)?;
        Ok(Self { scene: device, map, field, segments, counters, estimator })
    }

    /// Computes everything: an edit that touches everything.
    ///
    /// # Errors
    /// The device failed.
    pub fn rebuild(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<()> {
        self.counters.clear(gpu);
        self.map.trace(gpu, &self.scene, &self.counters, split, progress)?;
        match &mut self.field {
            LightField::Points(points) => points.build(gpu, &self.scene, &self.map, progress)?,
            LightField::Fluence(fluence) => {
                fluence.build(gpu, &self.scene, &self.map, &self.counters, progress)?;
            }
        }
        self.segments.render(gpu, &self.scene, &self.field, &self.counters, progress)
    }

    /// What the stages counted since the last rebuild began.
    ///
    /// # Errors
    /// The device failed.
    pub fn counts(&self, gpu: &Gpu) -> Result<Counters> {
        self.counters.read(gpu)
    }

    fn fill(&self, gpu: &Gpu, report: &mut Report) -> Result<()> {
        report.estimator = Some(self.estimator);
        report.photons = self.scene.lights.photons.into();
        report.max_events = self.map.max_events;
        report.segments = self.segments.count();
        report.counts = self.counts(gpu)?;
        report
            .bytes
            .extend([("photon slots", self.map.bytes()), ("segments", self.segments.bytes())]);
        match &self.field {
            LightField::Points(points) => {
                report.radius_mm = Some(points.radius);
                report.bytes.push(("points", points.bytes()));
            }
            LightField::Fluence(fluence) => {
                report.grid = Some(fluence.grid);
                report.bytes.push(("fluence", fluence.bytes()));
            }
        }
        Ok(())
    }
}
