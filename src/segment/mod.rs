//! View-ray segments, in screen bands.
//!
//! A ray is cut into V_n uniform segments between its entry to the volume's bounds and
//! its exit; each has its own light, transmittance and history. Its light is a colour, 24
//! bytes in all, or, from the points light field, integer sums, 32 bytes: what points gave
//! whose light changed is then taken out of them, and what they give is added, and nothing
//! else is gathered again.

pub mod composite;

use std::sync::Arc;

use self::composite::{Composite, CompositeParams};

use crate::bits::words;
use crate::device_scene::{Context, DeviceScene};
use crate::error::{Error, Result};
use crate::field::dirty::Dirty;
use crate::field::{LightField, Run, SegmentLight};
use crate::film::Image;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::queue::Total;
use crate::gpu::read::Words;
use crate::gpu::resource::Bytes;
use crate::gpu::run::Stage;
use crate::gpu::work::WorkList;
use crate::scene::{Estimator, Rays, Scene};
use crate::split::Split;

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
        pub begins: u32,
        /// First of the points that a dispatch gathers.
        pub points_begin: u32,
        /// The point before which it stops.
        pub points_end: u32,
        /// Segments that are listed: [`LIST_READ`], [`LIST_LIT`].
        pub which: u32,
        /// Bins of the entries that an edit changed.
        pub query: [u32; 2],
        /// Words of a segment.
        pub stride: u32,
        /// Pixels of the band.
        pub pixels: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
    }
}

/// Lists the segments that read an entry that changed.
pub const LIST_READ: u32 = 1;
/// Lists the others that see light that changed.
pub const LIST_LIT: u32 = 2;

/// Segments of a ray that one thread looks at, a bit each.
pub const SEGMENTS_AT_ONCE: u32 = 32;

/// Points that one thread tests in one dispatch, roughly, of the turns that an adapter lets it take.
const TESTS_PER_TURN: f64 = 0.75;

/// Parts in which the points are gathered, at most.
const MAX_PARTS: u32 = 1 << 12;

/// One segment, as the kernels keep it: light (red, green, blue), transmittance, history
/// (two words); with the points light field the light is the low words of integer sums, and
/// two more words hold what is above them.
pub type Segment = [u32; 8];

/// Bytes of a segment that takes its light from such a field.
pub fn segment_bytes(estimator: Estimator) -> u64 {
    match estimator {
        Estimator::Fluence => 24,
        Estimator::Points => 32,
    }
}

impl SegmentParams {
    /// The part of the camera; the rest is to be told yet.
    pub fn of(rays: Rays) -> Self {
        let Rays { origin, corner, right, down, size: [width, height] } = rays;
        Self { origin, corner, right, down, width, height, strata: [1, 1], ..Default::default() }
    }
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
    /// A bit for each pixel: one of its segments was listed since they were put together.
    touched: wgpu::Buffer,
    /// Nothing was computed since the camera moved.
    fresh: bool,
}

/// What segments are computed from.
#[derive(Clone, Copy)]
pub struct Sources<'a> {
    /// The light.
    pub field: &'a dyn LightField,
    /// Where it changed.
    pub dirty: &'a Dirty,
}

/// What an update computed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Computed {
    /// Segments computed again.
    pub segments: u64,
    /// Of them, those whose light alone was corrected by what changed.
    pub corrected: u64,
    /// Segments in all.
    pub total: u64,
}

/// A screen band, with one of the rays of each of its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BandRay {
    band: usize,
    ray: u32,
}

/// What an update asks of segments.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// What they are computed from.
    pub from: Sources<'a>,
    /// Bins of the entries that an edit changed.
    pub query: u64,
    /// How the work is cut.
    pub split: &'a Split,
}

/// How a gather begins.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Gather {
    /// With sums of zero.
    Anew,
    /// On top of the sums that are there.
    OnTop,
}

/// All segments of an image, and its film.
pub struct SegmentMap {
    params: SegmentParams,
    strata: [u32; 2],
    bands: Vec<Band>,
    composite: Composite,
    segment: Arc<Kernel>,
    query: Arc<Kernel>,
    /// By the magnitude of how many points there are: by that, what an item costs.
    paces: Vec<Pace>,
    /// Parts in which points are gathered, over those that they would need if they were spread evenly:
    /// more where the driver ended loops.
    more_parts: u32,
    /// Segments that an update lists, as far as the host knows; and as the device does, two words a
    /// band: those that see light that changed, and the others.
    known: u64,
    tally: wgpu::Buffer,
}

impl SegmentMap {
    /// Room for the scene's segments, with as many rays a pixel as its settings say.
    ///
    /// # Errors
    /// One row of segments, or the film, does not fit a binding; the memory is refused.
    pub fn new(
        gpu: &Gpu,
        scene: &Scene,
        device: &DeviceScene,
        field: &dyn LightField,
        split: &Split,
    ) -> Result<Self> {
        let (camera, settings) = (&scene.camera, &scene.settings);
        let light = field.segment_light();
        let bytes = segment_bytes(field.estimator());
        let stride = bytes as usize / 4;
        let scale = match light {
            SegmentLight::Colour => 1.0,
            SegmentLight::Sums { scale } => scale,
        };
        let row = u64::from(camera.width) * u64::from(settings.segments);
        let fit = gpu.max_binding() / bytes / row;
        if fit == 0 {
            return Err(Error::capacity(
                "segments",
                format!(
                    "one row of {} pixels with {} segments takes {} bytes, and the adapter binds {}; \
                     lower `segments` or the image's width",
                    camera.width,
                    settings.segments,
                    row * bytes,
                    gpu.max_binding()
                ),
            ));
        }
        let rows = fit.min(split.band_rows.unwrap_or(u32::MAX).max(1).into()) as u32;
        let mut bands = Vec::new();
        for first_row in (0..camera.height).step_by(rows as usize) {
            let rows = rows.min(camera.height - first_row);
            let (count, pixels) = (rows * row as u32, rows * camera.width);
            let segments = gpu.buffer::<u32>("segments", count as usize * stride)?;
            bands.push(Band {
                first_row,
                rows,
                segments,
                list: WorkList::new(gpu, count)?,
                touched: gpu.buffer::<u32>("touched pixels", pixels.div_ceil(32) as usize)?,
                fresh: true,
            });
        }
        Ok(Self {
            params: SegmentParams {
                segments: settings.segments,
                scale,
                stride: stride as u32,
                ..SegmentParams::of(camera.rays(&device.local_from_world)?)
            },
            strata: strata(settings.rays),
            composite: Composite::new(gpu, scene, light)?,
            segment: segment_kernel(gpu, device, field)?,
            query: gpu.kernel("segment_query", &[])?,
            paces: (0..=u32::BITS).map(|_| Pace::new(gpu, 1 << 12)).collect(),
            more_parts: 1,
            known: 0,
            tally: gpu.buffer::<[u32; 2]>("listed segments", bands.len())?,
            bands,
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
        field: &dyn LightField,
    ) -> Result<()> {
        self.segment = segment_kernel(gpu, device, field)?;
        Ok(())
    }

    /// Looks from elsewhere, or at another background. Returns whether segments changed.
    ///
    /// # Errors
    /// The camera is not placed yet.
    pub fn look(&mut self, scene: &Scene, device: &DeviceScene) -> Result<bool> {
        self.composite.background = scene.background.as_vec3().to_array();
        let camera = SegmentParams::of(scene.camera.rays(&device.local_from_world)?);
        let SegmentParams { segments, scale, stride, .. } = self.params;
        let params = SegmentParams { segments, scale, stride, ..camera };
        let moved = params != self.params;
        if moved {
            self.params = params;
            self.restart();
        }
        Ok(moved)
    }

    /// Has the next update compute every segment.
    pub fn restart(&mut self) {
        self.bands.iter_mut().for_each(|band| band.fresh = true);
    }

    /// The rays of bands, each of which is computed on its own: all of the first ray, and so on.
    pub fn rays(&self) -> Vec<BandRay> {
        let rays = self.strata[0] * self.strata[1];
        let bands = 0..self.bands.len();
        (0..rays).flat_map(|ray| bands.clone().map(move |band| BandRay { band, ray })).collect()
    }

    /// Begins to count what is computed.
    ///
    /// # Errors
    /// The device failed.
    pub fn begin(&mut self, cx: Context) -> Result<()> {
        self.known = 0;
        let mut stage = cx.gpu.stage("segments");
        stage.clear(&self.tally);
        stage.finish()
    }

    /// Computes the segments of a ray of a band that read an entry of the query, or see light that
    /// changed, and their pixels.
    ///
    /// # Errors
    /// The device failed.
    pub fn compute(
        &mut self,
        cx: Context,
        at: BandRay,
        request: Request,
        progress: &mut Progress,
    ) -> Result<()> {
        let Request { from, query, split } = request;
        let rays = self.strata[0] * self.strata[1];
        // Between rays a band holds another ray's segments.
        let anew = self.bands[at.band].fresh || rays > 1;
        if anew {
            let list = &mut self.bands[at.band].list;
            list.fill(cx.gpu.stage("list"), split.shuffle)?;
            let all = u64::from(list.count);
            self.known += all;
            self.gather(cx, from, at, Total::Known(all), progress)?;
        } else if let Some(runs) = from.field.changes() {
            // Where nothing was read but light, light alone is corrected.
            if !runs.is_empty() {
                let total = self.list(cx, at, request, LIST_LIT)?;
                self.gather_runs(cx, from, at, &runs, Gather::OnTop, total, progress)?;
            }
            if query != 0 {
                let total = self.list(cx, at, request, LIST_READ)?;
                self.gather(cx, from, at, total, progress)?;
            }
        } else {
            let total = self.list(cx, at, request, LIST_READ | LIST_LIT)?;
            self.gather(cx, from, at, total, progress)?;
        }
        self.composite(cx.gpu, at, rays, self.composite.repaints() || anew)
    }

    /// Where the device has how many segments were listed.
    pub fn listed(&self) -> Words {
        Words { buffer: self.tally.clone(), range: 0..self.tally.size() / 4 }
    }

    /// All rays are computed; `listed` is what was asked for.
    pub fn end(&mut self, listed: &[u32]) -> Computed {
        self.bands.iter_mut().for_each(|band| band.fresh = false);
        self.composite.all_painted();
        let sum = |first: usize| listed.iter().skip(first).step_by(2).map(|&n| u64::from(n)).sum();
        let [corrected, others]: [u64; 2] = [sum(0), sum(1)];
        let total = u64::from(self.strata[0] * self.strata[1]) * self.count();
        Computed { segments: self.known + corrected + others, corrected, total }
    }

    /// Whether a driver that ended loops may not do so where fewer points are gathered at once, which
    /// all segments are then. Has the next update compute every segment.
    pub fn slow_down(&mut self, field: &dyn LightField) -> bool {
        self.restart();
        let are_summed = field.segment_light() != SegmentLight::Colour;
        let can = are_summed && self.more_parts < MAX_PARTS;
        self.more_parts *= if can { 4 } else { 1 };
        can
    }

    /// Parts in which to gather the points, so that no thread tests many more than an adapter lets
    /// it at a time if they are spread evenly. Sums of integers: no bit depends on it.
    fn parts(&self, cx: Context, field: &dyn LightField) -> u32 {
        let params = &cx.scene.params;
        let longest = params.extent.iter().map(|e| e * e).sum::<f32>().sqrt();
        let samples = f64::from(longest / params.step / self.params.segments as f32) + 1.0;
        let most = TESTS_PER_TURN * f64::from(cx.gpu.ways().turns);
        let parts = (samples * field.tests_per_sample() / most).ceil() as u32;
        parts.max(1).saturating_mul(self.more_parts).min(MAX_PARTS)
    }

    /// Lists the segments of a band that an edit touches: `LIST_` bits say which.
    fn list(&mut self, cx: Context, at: BandRay, request: Request, which: u32) -> Result<Total> {
        let band = &self.bands[at.band];
        let pixels = band.rows * self.params.width;
        let items = pixels * self.params.segments.div_ceil(SEGMENTS_AT_ONCE);
        let params = SegmentParams {
            first_row: band.first_row,
            pixels,
            items,
            strata: self.strata,
            query: words(request.query),
            which,
            ..self.params
        };
        let mut bindings = [cx.scene.bindings(), request.from.dirty.bindings()].concat();
        bindings.extend([
            ("segments", (&band.segments).into()),
            ("marks", (&band.list.marks).into()),
            ("pixels", (&band.touched).into()),
            ("counters", cx.counters.buffer().into()),
        ]);
        let mut stage = cx.gpu.stage("segment_query");
        band.list.unmark(&mut stage);
        stage.dispatch(&self.query, items.into(), &bindings, &params)?;
        band.list.record(stage)?;
        let word = 2 * at.band as u64 + u64::from(which != LIST_LIT);
        let mut stage = cx.gpu.stage("segment_query");
        let length = Bytes { size: 4, ..Bytes::all(&band.list.items) };
        stage.copy(length, &self.tally, 4 * word);
        stage.finish()?;
        band.list.shuffle(cx.gpu, request.split.shuffle)?;
        Ok(Total::Told(band.list.told()))
    }

    /// Computes the listed segments of a band from the whole light field.
    fn gather(
        &self,
        cx: Context,
        from: Sources,
        at: BandRay,
        total: Total,
        progress: &mut Progress,
    ) -> Result<()> {
        self.gather_runs(cx, from, at, &from.field.runs(), Gather::Anew, total, progress)
    }

    /// Gathers runs of points one after the other, each in parts.
    #[expect(clippy::too_many_arguments, reason = "each is of its own")]
    fn gather_runs(
        &self,
        cx: Context,
        from: Sources,
        at: BandRay,
        runs: &[Run],
        how: Gather,
        total: Total,
        progress: &mut Progress,
    ) -> Result<()> {
        let band = &self.bands[at.band];
        let parts = self.parts(cx, from.field);
        for (i, run) in runs.iter().enumerate() {
            let mut bindings = [cx.scene.bindings(), run.bindings.clone()].concat();
            bindings.extend([
                ("work", (&band.list.items).into()),
                ("segments", (&band.segments).into()),
                ("counters", cx.counters.buffer().into()),
            ]);
            let bound =
                |part: u32| (u64::from(run.points) * u64::from(part) / u64::from(parts)) as u32;
            let pace = self.pace(bound(1), &total);
            for part in 0..parts {
                let params = SegmentParams {
                    first_row: band.first_row,
                    pixels: band.rows * self.params.width,
                    strata: self.strata,
                    ray: at.ray,
                    begins: u32::from(how == Gather::Anew && i == 0 && part == 0),
                    points_begin: bound(part),
                    points_end: bound(part + 1),
                    ..self.params
                };
                let (kernel, bindings) = (self.segment.clone(), bindings.clone());
                let work = move |slice: &mut Stage, range: std::ops::Range<u64>| {
                    let (first_item, items) =
                        (range.start as u32, (range.end - range.start) as u32);
                    let params = SegmentParams { first_item, items, ..params };
                    slice.dispatch(&kernel, items.into(), &bindings, &params)
                };
                cx.gpu.sliced("segment", total.clone(), pace, work, progress)?;
            }
        }
        Ok(())
    }

    /// The pace of gathering so many points. What was never learned of a list whose length the device
    /// has is taken from what takes longer.
    fn pace(&self, points: u32, total: &Total) -> &Pace {
        let own = (u32::BITS - points.leading_zeros()) as usize;
        match total {
            Total::Known(_) => &self.paces[own],
            Total::Told(_) => {
                self.paces[own..].iter().find(|pace| pace.is_learned()).unwrap_or(&self.paces[own])
            }
        }
    }

    /// Puts the segments of a band's pixels together: of `all`, or of those that were touched.
    fn composite(&self, gpu: &Gpu, at: BandRay, rays: u32, all: bool) -> Result<()> {
        let band = &self.bands[at.band];
        let params = CompositeParams {
            pixels: band.rows * self.params.width,
            first_pixel: band.first_row * self.params.width,
            segments: self.params.segments,
            weight: 1.0 / rays as f32,
            fresh: u32::from(at.ray == 0),
            scale: self.params.scale,
            all: all.into(),
            ..Default::default()
        };
        self.composite.record(gpu, &band.segments, &band.touched, params)
    }

    /// The image as it stands.
    ///
    /// # Errors
    /// The device failed.
    pub fn image(&self, gpu: &Gpu) -> Result<Image> {
        self.composite.image(gpu)
    }

    /// Where the device has the segments of the last ray, band by band, and in a band layer upon
    /// layer: words as of [`Segment`], the last two only with `points`.
    pub fn buffers(&self) -> impl Iterator<Item = &wgpu::Buffer> {
        self.bands.iter().map(|band| &band.segments)
    }

    /// All segments of the last ray, row by row.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Segment>> {
        let stride = self.params.stride as usize;
        let mut all = Vec::new();
        for band in &self.bands {
            let words = gpu.read::<u32>("segments", &band.segments)?;
            let (pixels, layers) = (band.rows * self.params.width, self.params.segments);
            for (pixel, layer) in (0..pixels).flat_map(|p| (0..layers).map(move |l| (p, l))) {
                let at = stride * (layer * pixels + pixel) as usize;
                let mut segment = Segment::default();
                segment[..stride].copy_from_slice(&words[at..at + stride]);
                all.push(segment);
            }
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
        self.bands.iter().map(|band| band.list.bytes() + band.touched.size()).sum()
    }

    /// Bytes of a segment.
    pub fn segment_bytes(&self) -> u64 {
        4 * u64::from(self.params.stride)
    }

    /// Bytes of all segments.
    pub fn bytes(&self) -> u64 {
        self.bands.iter().map(|band| band.segments.size()).sum()
    }
}

fn segment_kernel(gpu: &Gpu, device: &DeviceScene, field: &dyn LightField) -> Result<Arc<Kernel>> {
    gpu.kernel("segment", &[device.flags(), field.segment_flags()].concat())
}
