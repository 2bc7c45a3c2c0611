//! The reference: an unbiased path tracer on the device, progressive, with the standard
//! error of every pixel. Stopped at one event it is Monte-Carlo ray casting (`mcvr`).

use std::ops::Range;
use std::sync::Arc;

use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::film::Image;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::counter::{CounterBuffer, Counters};
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::queue::Total;
use crate::gpu::run::Stage;
use crate::scene::{Method, Scene};
use crate::segment::SegmentParams;

shared_struct! {
    /// What the reference kernel is told beside the camera.
    pub struct ReferenceParams {
        /// Radiance behind the volume.
        pub background: [f32; 3],
        /// Samples that each pixel has already.
        pub first_sample: u32,
        /// Samples that this dispatch adds.
        pub samples: u32,
        /// Scattering orders.
        pub max_events: u32,
        /// First event after which a roulette on the weight runs.
        pub roulette_from: u32,
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

/// Events at most, where all orders are asked for; a roulette ends paths long before.
const ALL_EVENTS: u32 = 100_000;

/// Samples that one dispatch adds to each pixel.
const SAMPLES_AT_ONCE: u32 = 8;

/// What the samples so far say of an image.
pub struct Estimate {
    /// Their mean.
    pub mean: Image,
    /// The standard error of each pixel of it.
    pub error: Image,
}

/// A reference image in the making.
pub struct Reference {
    params: SegmentParams,
    path: ReferenceParams,
    majorants: wgpu::Buffer,
    means: wgpu::Buffer,
    deviations: wgpu::Buffer,
    counters: CounterBuffer,
    kernel: Arc<Kernel>,
    pace: Pace,
}

impl Reference {
    /// Begins an image of a settled scene.
    ///
    /// # Errors
    /// The film does not fit the adapter.
    pub fn new(gpu: &Gpu, scene: &Scene, device: &DeviceScene) -> Result<Self> {
        let pixels = scene.camera.width as usize * scene.camera.height as usize;
        let max_events = match scene.settings.method {
            Method::Mcvr => 1,
            _ => scene.settings.reference_events.unwrap_or(ALL_EVENTS),
        };
        // Where only emission is, one look per macro-cell edge suffices on average.
        let glow_rate = 1.0 / device.params.cell_mm.iter().copied().fold(f32::INFINITY, f32::min);
        Ok(Self {
            params: SegmentParams::of(scene.camera.rays(&device.local_from_world)?),
            path: ReferenceParams {
                background: scene.background.as_vec3().to_array(),
                max_events,
                roulette_from: 4,
                ..Default::default()
            },
            majorants: gpu
                .upload("majorants", &device.cells.majorants(&device.table, glow_rate))?,
            means: gpu.buffer::<[f32; 4]>("reference means", pixels)?,
            deviations: gpu.buffer::<[f32; 4]>("reference deviations", pixels)?,
            counters: CounterBuffer::new(gpu)?,
            kernel: gpu.kernel("reference", &device.flags())?,
            pace: Pace::new(gpu, 1 << 13),
        })
    }

    /// Adds `samples` samples to every pixel.
    ///
    /// # Errors
    /// The device failed.
    pub fn add(
        &mut self,
        gpu: &Gpu,
        device: &DeviceScene,
        samples: u32,
        progress: &mut Progress,
    ) -> Result<()> {
        let film =
            (gpu.read("reference means", &self.means)?, gpu.read("reference", &self.deviations)?);
        let first = self.path.first_sample;
        // Few at a time, fewer still where the driver ends the loops of a long path.
        for each in [SAMPLES_AT_ONCE, 1] {
            self.path.first_sample = first;
            self.counters.clear(gpu)?;
            gpu.write::<[f32; 4]>(&self.means, &film.0)?;
            gpu.write::<[f32; 4]>(&self.deviations, &film.1)?;
            self.add_in_steps(gpu, device, samples, each, progress)?;
            if self.counters.read(gpu)?.unfinished == 0 {
                return Ok(());
            }
        }
        let items = self.counters.read(gpu)?.unfinished;
        let remedy = "lower the extinctions, or the volume's resolution";
        Err(Counters::unfinished_error(items, "reference", remedy))
    }

    fn add_in_steps(
        &mut self,
        gpu: &Gpu,
        device: &DeviceScene,
        samples: u32,
        each: u32,
        progress: &mut Progress,
    ) -> Result<()> {
        let pixels = u64::from(self.params.width) * u64::from(self.params.height);
        let mut bindings = device.bindings();
        bindings.extend([
            ("majorants", (&self.majorants).into()),
            ("means", (&self.means).into()),
            ("deviations", (&self.deviations).into()),
            ("counters", self.counters.buffer().into()),
        ]);
        let steps = samples.div_ceil(each);
        for step in 0..steps {
            let now = each.min(samples - step * each);
            let path = gpu.upload("path", &[ReferenceParams { samples: now, ..self.path }])?;
            let mut bindings = bindings.clone();
            bindings.push(("path", (&path).into()));
            let (kernel, all) = (self.kernel.clone(), self.params);
            let work = move |stage: &mut Stage, range: Range<u64>| {
                let (first_item, items) = (range.start as u32, range.end - range.start);
                let params = SegmentParams { first_item, items: items as u32, ..all };
                stage.dispatch(&kernel, items, &bindings, &params)
            };
            progress.set_part(step.into(), steps.into());
            gpu.sliced("reference", Total::Known(pixels), &self.pace, work, progress)?;
            self.path.first_sample += now;
        }
        Ok(())
    }

    /// The mean so far, and the standard error of each pixel of it.
    ///
    /// # Errors
    /// The device failed.
    pub fn image(&self, gpu: &Gpu) -> Result<Estimate> {
        let means = gpu.read::<[f32; 4]>("reference means", &self.means)?;
        let deviations = gpu.read::<[f32; 4]>("reference deviations", &self.deviations)?;
        let n = f64::from(self.path.first_sample);
        let error = |sum: f32| (f64::from(sum) / (n - 1.0).max(1.0) / n.max(1.0)).sqrt() as f32;
        let (width, height) = (self.params.width, self.params.height);
        let rgb = |data: Vec<[f32; 4]>, f: &dyn Fn(f32) -> f32| -> Vec<[f32; 3]> {
            data.into_iter().map(|[r, g, b, _]| [f(r), f(g), f(b)]).collect()
        };
        Ok(Estimate {
            mean: Image { width, height, rgb: rgb(means, &|x| x) },
            error: Image { width, height, rgb: rgb(deviations, &error) },
        })
    }

    /// Bytes of its film.
    pub fn bytes(&self) -> u64 {
        self.means.size() + self.deviations.size()
    }
}
