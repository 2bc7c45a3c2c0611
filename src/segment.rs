//! View-ray segments, in screen bands, and their composite.
//!
//! A ray is cut into V_n uniform segments between its entry to the volume's bounds and
//! its exit; each has its own colour, transmittance and history, 24 bytes.

use std::sync::Arc;

use glam::{DAffine3, Vec3};

use crate::dirty::Dirty;
use crate::error::{Error, Result};
use crate::film::Image;
use crate::fluence::Fluence;
use crate::frame::{DeviceScene, words};
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::{Bindings, Stage};
use crate::photon::CounterBuffer;
use crate::points::Points;
use crate::render::{CONTRIBUTION, Progress, Split};
use crate::scene::{Camera, Scene};
use crate::work::{WorkList, fill};

shared_struct! {
    /// What the segment kernel is told; lengths in the volume's frame.
    pub struct SegmentParams {
        /// The pinhole.
        pub origin: [f32; 3],
        /// Pixels across.
        pub width: u32,
        /// Direction of the image's upper left corner.
        pub corner: [f32; 3],
        /// Pixels down.
        pub height: u32,
        /// Across the whole image.
        pub right: [f32; 3],
        /// Segments of a ray.
        pub segments: u32,
        /// Down the whole image.
        pub down: [f32; 3],
        /// First row of the band.
        pub first_row: u32,
        /// First item of this dispatch.
        pub first_item: u32,
        /// Items of this dispatch.
        pub items: u32,
        /// Rays a pixel, across and down.
        pub strata: [u32; 2],
        /// Which of them.
        pub ray: u32,
        /// Scale of the integer sums.
        pub scale: f32,
        /// 1 where sums begin at zero.
        pub batch_first: u32,
        /// 1 where the colour is finished.
        pub batch_last: u32,
        /// First of the sorted points that a dispatch gathers.
        pub points_begin: u32,
        /// The point before which it stops.
        pub points_end: u32,
        /// Bins of the entries that an edit changed.
        pub query: [u32; 2],
    }
}

shared_struct! {
    /// A computed segment.
    pub struct Segment {
        /// Radiance leaving it towards the viewer.
        pub red: f32,
        /// Green.
        pub green: f32,
        /// Blue.
        pub blue: f32,
        /// Through the whole segment, in [0, 1].
        pub transmittance: f32,
        /// Bins 0 to 31 of its history.
        pub history_low: u32,
        /// Bins 32 to 63.
        pub history_high: u32,
    }
}

shared_struct! {
    /// What the composite kernel is told.
    pub struct CompositeParams {
        /// Radiance behind the volume.
        pub background: [f32; 3],
        /// Pixels of the band.
        pub pixels: u32,
        /// The band's first pixel in the film.
        pub first_pixel: u32,
        /// Segments of a ray.
        pub segments: u32,
        /// Weight of this ray in the film.
        pub weight: f32,
        /// 1 where the film begins with this ray.
        pub fresh: u32,
    }
}

/// A segment that was never computed: its transmittance is -1, its history all ones.
const NEVER: [u32; 6] = [0, 0, 0, 0xbf80_0000, u32::MAX, u32::MAX];

/// Parts in which the points are gathered, at most.
const MAX_PARTS: u32 = 1 << 12;

/// Bytes of a segment.
pub const SEGMENT_BYTES: u64 = size_of::<Segment>() as u64;

/// The light field that segments read.
pub enum LightField {
    /// Sorted photons.
    Points(Points),
    /// The fluence grid.
    Fluence(Box<Fluence>),
}

/// The camera's part of the parameters, in the volume's frame.
///
/// # Errors
/// The camera is not placed yet.
pub fn camera_params(camera: &Camera, local: &DAffine3) -> Result<SegmentParams> {
    let view = camera.view()?;
    let vector = |v| local.transform_vector3(v).as_vec3();
    let (forward, right, down): (Vec3, Vec3, Vec3) =
        (vector(view.forward), vector(view.right), vector(view.down));
    Ok(SegmentParams {
        origin: local.transform_point3(view.origin).as_vec3().to_array(),
        width: camera.width,
        height: camera.height,
        corner: (forward - right - down).to_array(),
        right: (2.0 * right).to_array(),
        down: (2.0 * down).to_array(),
        strata: [1, 1],
        ..Default::default()
    })
}

/// Rays a pixel, across and down: as square as the number allows.
fn strata(rays: u32) -> [u32; 2] {
    let down = (1..=rays.isqrt()).rev().find(|d| rays.is_multiple_of(*d)).unwrap_or(1);
    [rays / down, down]
}

struct Band {
    first_row: u32,
    rows: u32,
    segments: wgpu::Buffer,
    list: WorkList,
    /// Nothing was computed since the camera moved.
    fresh: bool,
}

/// What segments are computed from.
pub struct SegmentStage<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene.
    pub device: &'a DeviceScene,
    /// Its light.
    pub field: &'a LightField,
    /// Where light changed.
    pub dirty: &'a Dirty,
    /// What is counted.
    pub counters: &'a CounterBuffer,
}

/// All segments of an image, and its film.
pub struct SegmentMap {
    params: SegmentParams,
    background: [f32; 3],
    strata: [u32; 2],
    bands: Vec<Band>,
    film: wgpu::Buffer,
    segment: Arc<Kernel>,
    query: Arc<Kernel>,
    composite: Arc<Kernel>,
}

impl SegmentMap {
    /// Room for the scene's segments, with `rays` rays a pixel.
    ///
    /// # Errors
    /// One row of segments, or the film, does not fit a binding; the memory is refused.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        device: &DeviceScene,
        field: &LightField,
        rays: u32,
        split: &Split,
    ) -> Result<Self> {
        let (camera, settings) = (&scene.camera, &scene.settings);
        let row = u64::from(camera.width) * u64::from(settings.segments);
        let fit = gpu.max_binding() / SEGMENT_BYTES / row;
        if fit == 0 {
            return Err(Error::capacity(
                "segments",
                format!(
                    "one row of {} pixels with {} segments takes {} bytes, and the adapter binds {}; \
                     lower `segments` or the image's width",
                    camera.width,
                    settings.segments,
                    row * SEGMENT_BYTES,
                    gpu.max_binding()
                ),
            ));
        }
        let rows = fit.min(split.band_rows.unwrap_or(u32::MAX).max(1).into()) as u32;
        let mut bands = Vec::new();
        for first_row in (0..camera.height).step_by(rows as usize) {
            let rows = rows.min(camera.height - first_row);
            let count = rows * row as u32;
            let segments = gpu.buffer::<Segment>("segments", count as usize)?;
            fill(gpu, "forget", &segments, &NEVER)?;
            bands.push(Band {
                first_row,
                rows,
                segments,
                list: WorkList::new(gpu, count)?,
                fresh: true,
            });
        }
        let spacing = 1.0 / device.frame.per_voxel.iter().copied().fold(0.0, f32::max);
        let mut scale = 1.0;
        if let LightField::Points(points) = field {
            let photon = settings.flux_unit.unwrap_or(1.0) / settings.photons as f64;
            let ball = 4.0 / 3.0 * std::f64::consts::PI * f64::from(points.radius).powi(3);
            let typical = photon / ball / (4.0 * std::f64::consts::PI) * f64::from(spacing);
            scale = (CONTRIBUTION / typical) as f32;
        }
        let pixels = camera.width as usize * camera.height as usize;
        Ok(Self {
            params: SegmentParams {
                segments: settings.segments,
                scale,
                ..camera_params(camera, &device.local_from_world)?
            },
            background: scene.background.as_vec3().to_array(),
            strata: strata(rays),
            bands,
            film: gpu.buffer::<[f32; 4]>("film", pixels)?,
            segment: segment_kernel(gpu, device, field)?,
            query: gpu.kernel("segment_query", &[])?,
            composite: gpu.kernel("composite", &[])?,
        })
    }

    /// Takes the kernels that suit an edited scene.
    ///
    /// # Errors
    /// The device refuses them.
    pub fn respecialise(
        &mut self,
        gpu: &Gpu,
        device: &DeviceScene,
        field: &LightField,
    ) -> Result<()> {
        self.segment = segment_kernel(gpu, device, field)?;
        Ok(())
    }

    /// Looks from elsewhere, or at another background. Returns whether segments changed.
    ///
    /// # Errors
    /// The camera is not placed yet; the device failed.
    pub fn look(&mut self, gpu: &Gpu, scene: &Scene, device: &DeviceScene) -> Result<bool> {
        self.background = scene.background.as_vec3().to_array();
        let camera = camera_params(&scene.camera, &device.local_from_world)?;
        let (segments, scale) = (self.params.segments, self.params.scale);
        let params = SegmentParams { segments, scale, ..camera };
        if params == self.params {
            return Ok(false);
        }
        self.params = params;
        self.forget(gpu)?;
        Ok(true)
    }

    /// Marks every segment as never computed.
    ///
    /// # Errors
    /// The device failed.
    pub fn forget(&mut self, gpu: &Gpu) -> Result<()> {
        for band in &mut self.bands {
            fill(gpu, "forget", &band.segments, &NEVER)?;
            band.fresh = true;
        }
        Ok(())
    }

    /// Computes the segments that read an entry of `query`, or see light that changed, and
    /// the image, ray after ray. Returns how many segments were computed of how many.
    ///
    /// # Errors
    /// The device failed.
    pub fn update(
        &mut self,
        stage: &SegmentStage,
        query: u64,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<[u64; 2]> {
        let (gpu, counters) = (stage.gpu, stage.counters);
        let rays = self.strata[0] * self.strata[1];
        let total = u64::from(rays) * u64::from(self.params.height);
        let mut parts = 1;
        let mut recomputed = 0;
        for ray in 0..rays {
            for i in 0..self.bands.len() {
                // Between rays a band holds another ray's segments.
                if self.bands[i].fresh || rays > 1 {
                    self.bands[i].list.fill(gpu, split.shuffle);
                } else {
                    self.list(stage, i, query)?;
                    self.bands[i].list.compact(gpu, split.shuffle)?;
                    counters.read(gpu)?.all_finished("segment_query", "raise `segments`")?;
                }
                let band = &self.bands[i];
                recomputed += u64::from(band.list.count);
                if band.list.count > 0 {
                    parts = self.gather(stage, (band, ray), parts)?;
                }
                self.composite(gpu, band, ray, rays)?;
                let rows = u64::from(ray * self.params.height + band.first_row + band.rows);
                progress.at("segment", rows, total);
            }
        }
        self.bands.iter_mut().for_each(|band| band.fresh = false);
        Ok([recomputed, u64::from(rays) * self.count()])
    }

    fn list(&self, stage: &SegmentStage, band: usize, query: u64) -> Result<()> {
        let band = &self.bands[band];
        let items = band.rows * self.params.width * self.params.segments;
        let params = SegmentParams {
            first_row: band.first_row,
            items,
            strata: self.strata,
            query: words(query),
            ..self.params
        };
        let mut bindings = [stage.device.bindings(), stage.dirty.bindings()].concat();
        bindings.extend([
            ("segment_words", (&band.segments).into()),
            ("marks", (&band.list.marks).into()),
            ("counters", stage.counters.buffer().into()),
        ]);
        let mut dispatch = stage.gpu.stage("segment_query");
        dispatch.dispatch(&self.query, u64::from(items) + 1, &bindings, &params)?;
        dispatch.finish()
    }

    /// Computes the segments of a band. Where the driver ends the loops of a long gather,
    /// the points are taken in more parts: sums of integers, so no bit depends on it.
    /// Returns the parts that sufficed.
    fn gather(
        &self,
        stage: &SegmentStage,
        (band, ray): (&Band, u32),
        mut parts: u32,
    ) -> Result<u32> {
        let (gpu, counters) = (stage.gpu, stage.counters);
        let before = counters.read(gpu)?;
        let most = match stage.field {
            LightField::Fluence(_) => 1,
            LightField::Points(_) => MAX_PARTS,
        };
        loop {
            self.gather_parts(stage, (band, ray), parts)?;
            let after = counters.read(gpu)?;
            if after.unfinished == 0 {
                return Ok(parts);
            }
            if parts >= most {
                after.all_finished("segment", "raise `segments`, or lower `radius`")?;
            }
            counters.restore(gpu, &before);
            parts *= 4;
        }
    }

    fn gather_parts(
        &self,
        stage: &SegmentStage,
        (band, ray): (&Band, u32),
        parts: u32,
    ) -> Result<()> {
        let batches: Vec<(Bindings, u32)> = match stage.field {
            LightField::Fluence(fluence) => vec![(fluence.bindings(), 0)],
            LightField::Points(points) => points.bindings(),
        };
        let count = u64::from(band.list.count);
        let last = batches.len() as u32 * parts - 1;
        for (i, (batch, points)) in (0..).zip(&batches) {
            let mut bindings = [stage.device.bindings(), batch.clone()].concat();
            bindings.extend([
                ("work", (&band.list.items).into()),
                ("segment_words", (&band.segments).into()),
                ("counters", stage.counters.buffer().into()),
            ]);
            let bound =
                |part: u32| (u64::from(*points) * u64::from(part) / u64::from(parts)) as u32;
            for part in 0..parts {
                let run = i * parts + part;
                let params = SegmentParams {
                    first_row: band.first_row,
                    strata: self.strata,
                    ray,
                    batch_first: u32::from(run == 0),
                    batch_last: u32::from(run == last),
                    points_begin: bound(part),
                    points_end: bound(part + 1),
                    ..self.params
                };
                let work = |slice: &mut Stage, range: std::ops::Range<u64>| {
                    let (first_item, items) =
                        (range.start as u32, (range.end - range.start) as u32);
                    let params = SegmentParams { first_item, items, ..params };
                    slice.dispatch(&self.segment, items.into(), &bindings, &params)
                };
                stage.gpu.sliced("segment", count, 1 << 12, work, &mut |_| ())?;
            }
        }
        Ok(())
    }

    fn composite(&self, gpu: &Gpu, band: &Band, ray: u32, rays: u32) -> Result<()> {
        let params = CompositeParams {
            background: self.background,
            pixels: band.rows * self.params.width,
            first_pixel: band.first_row * self.params.width,
            segments: self.params.segments,
            weight: 1.0 / rays as f32,
            fresh: u32::from(ray == 0),
        };
        let bindings = [("segments", (&band.segments).into()), ("film", (&self.film).into())];
        let mut stage = gpu.stage("composite");
        stage.dispatch(&self.composite, params.pixels.into(), &bindings, &params)?;
        stage.finish()
    }

    /// The image as it stands.
    ///
    /// # Errors
    /// The device failed.
    pub fn image(&self, gpu: &Gpu) -> Result<Image> {
        let film = gpu.read::<[f32; 4]>("film", &self.film)?;
        Ok(Image {
            width: self.params.width,
            height: self.params.height,
            rgb: film.into_iter().map(|[r, g, b, _]| [r, g, b]).collect(),
        })
    }

    /// All segments of the last ray, row by row.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Segment>> {
        let mut all = Vec::new();
        for band in &self.bands {
            all.extend(gpu.read::<Segment>("segments", &band.segments)?);
        }
        Ok(all)
    }

    /// Segments of one ray a pixel.
    pub fn count(&self) -> u64 {
        u64::from(self.params.width)
            * u64::from(self.params.height)
            * u64::from(self.params.segments)
    }

    /// Bytes of the work lists.
    pub fn list_bytes(&self) -> u64 {
        self.bands.iter().map(|band| band.list.bytes()).sum()
    }

    /// Bytes of all segments.
    pub fn bytes(&self) -> u64 {
        self.bands.iter().map(|band| band.segments.size()).sum()
    }
}

fn segment_kernel(gpu: &Gpu, device: &DeviceScene, field: &LightField) -> Result<Arc<Kernel>> {
    let mut flags =
        device.flags(&["nearest", "float_voxels", "anisotropic", "emission", "history", "skip"]);
    match field {
        LightField::Fluence(_) => flags.push("fluence"),
        LightField::Points(points) => flags.extend(points.even.then_some("even")),
    }
    gpu.kernel("segment", &flags)
}
