//! View-ray segments, in screen bands.
//!
//! A ray is cut into V_n uniform segments between its entry to the volume's bounds and
//! its exit; each has its own light, transmittance and history. Its light is a colour, 24
//! bytes in all, or, from the points light field, integer sums, 32 bytes: what points gave
//! whose light changed is then taken out of them, and what they give is added, and nothing
//! else is gathered again.

pub mod composite;

use std::cell::Cell;
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
use crate::gpu::counter::Counters;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::{Pace, Stage};
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

/// Points that one thread tests in one dispatch, roughly: some drivers lose patience after a
/// second or two, or after 65 535 turns of its loops.
const TESTS_AT_ONCE: f64 = 49_152.0;

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
    /// What the stages counted so far.
    pub counts: Counters,
}

/// A screen band, with one of the rays of each of its pixels.
#[derive(Clone, Copy)]
struct BandRay {
    band: usize,
    ray: u32,
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
    paces: [Pace; 33],
    /// What was counted, if an update has read it.
    counted: Cell<Option<Counters>>,
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
            bands,
            composite: Composite::new(gpu, scene, light)?,
            segment: segment_kernel(gpu, device, field)?,
            query: gpu.kernel("segment_query", &[])?,
            paces: std::array::from_fn(|_| Pace::new(1 << 12)),
            counted: Cell::default(),
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

    /// Computes the segments that read an entry of `query`, or see light that changed, and
    /// the image, ray after ray.
    ///
    /// # Errors
    /// The device failed.
    pub fn update(
        &mut self,
        cx: Context,
        from: Sources,
        query: u64,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<Computed> {
        let rays = self.strata[0] * self.strata[1];
        let rows = u64::from(rays) * u64::from(self.params.height);
        let mut parts = self.parts(cx, from.field);
        let mut done = Computed { total: u64::from(rays) * self.count(), ..Default::default() };
        let repaints = self.composite.repaints();
        for ray in 0..rays {
            for band in 0..self.bands.len() {
                let at = BandRay { band, ray };
                // Between rays a band holds another ray's segments.
                let anew = self.bands[band].fresh || rays > 1;
                if anew {
                    self.bands[band].list.fill(cx.gpu.stage("list"), split.shuffle)?;
                    done.segments += self.gather(cx, from, at, &mut parts)?;
                } else if let Some(runs) = from.field.changes() {
                    // Where nothing was read but light, light alone is corrected.
                    if !runs.is_empty() {
                        self.list(cx, from, band, query, LIST_LIT, split)?;
                        done.corrected += self.correct(cx, from, at, &runs, &mut parts)?;
                    }
                    if query != 0 {
                        self.list(cx, from, band, query, LIST_READ, split)?;
                        done.segments += self.gather(cx, from, at, &mut parts)?;
                    }
                } else {
                    self.list(cx, from, band, query, LIST_READ | LIST_LIT, split)?;
                    done.segments += self.gather(cx, from, at, &mut parts)?;
                }
                self.composite(cx.gpu, at, rays, repaints || anew)?;
                let band = &self.bands[band];
                let row = u64::from(ray * self.params.height + band.first_row + band.rows);
                progress.at("segment", row, rows);
            }
        }
        self.bands.iter_mut().for_each(|band| band.fresh = false);
        self.composite.all_painted();
        done.segments += done.corrected;
        done.counts = self.counted.take().map_or_else(|| cx.counters.read(cx.gpu), Ok)?;
        Ok(done)
    }

    /// Parts in which to gather the points, so that no thread tests many more than
    /// `TESTS_AT_ONCE` at a time if they are spread evenly.
    fn parts(&self, cx: Context, field: &dyn LightField) -> u32 {
        let params = &cx.scene.params;
        let longest = params.extent.iter().map(|e| e * e).sum::<f32>().sqrt();
        let samples = f64::from(longest / params.step / self.params.segments as f32) + 1.0;
        let parts = samples * field.tests_per_sample() / TESTS_AT_ONCE;
        (parts.ceil() as u32).clamp(1, MAX_PARTS)
    }

    /// Lists the segments of a band that an edit touches: `LIST_` bits say which.
    fn list(
        &mut self,
        cx: Context,
        from: Sources,
        band: usize,
        query: u64,
        which: u32,
        split: &Split,
    ) -> Result<()> {
        let band = &mut self.bands[band];
        let pixels = band.rows * self.params.width;
        let items = pixels * self.params.segments.div_ceil(SEGMENTS_AT_ONCE);
        let params = SegmentParams {
            first_row: band.first_row,
            pixels,
            items,
            strata: self.strata,
            query: words(query),
            which,
            ..self.params
        };
        let mut bindings = [cx.scene.bindings(), from.dirty.bindings()].concat();
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
        let after = cx.counters.read_with(cx.gpu, &mut [&mut band.list])?;
        self.counted.set(Some(after));
        band.list.shuffle(cx.gpu, split.shuffle)?;
        after.all_finished("segment_query", "raise `segments`")
    }

    /// Computes the listed segments of a band from the whole light field. Where the driver
    /// ends the loops of a long gather, the points are taken in more `parts`: sums of
    /// integers, so no bit depends on it. Returns how many there are.
    fn gather(&self, cx: Context, from: Sources, at: BandRay, parts: &mut u32) -> Result<u64> {
        let listed = self.bands[at.band].list.count.into();
        if listed == 0 {
            return Ok(0);
        }
        cx.counters.save(cx.gpu)?;
        let most = match from.field.segment_light() {
            SegmentLight::Sums { .. } => MAX_PARTS,
            SegmentLight::Colour => 1,
        };
        let runs = from.field.runs();
        loop {
            self.gather_runs(cx, at, &runs, *parts, Gather::Anew)?;
            let after = cx.counters.read(cx.gpu)?;
            self.counted.set(Some(after));
            if after.unfinished == 0 {
                return Ok(listed);
            }
            if *parts >= most {
                after.all_finished("segment", "raise `segments`, or lower `radius`")?;
            }
            cx.counters.restore(cx.gpu)?;
            *parts *= 4;
        }
    }

    /// Takes the light that points had out of the listed segments of a band, and adds what they
    /// have now. Returns how many segments there are.
    fn correct(
        &self,
        cx: Context,
        from: Sources,
        at: BandRay,
        runs: &[Run],
        parts: &mut u32,
    ) -> Result<u64> {
        let listed = self.bands[at.band].list.count;
        if listed == 0 {
            return Ok(0);
        }
        cx.counters.save(cx.gpu)?;
        self.gather_runs(cx, at, runs, *parts, Gather::OnTop)?;
        let after = cx.counters.read(cx.gpu)?;
        self.counted.set(Some(after));
        if after.unfinished == 0 {
            return Ok(listed.into());
        }
        // Half-corrected sums are of no use: all is gathered.
        cx.counters.restore(cx.gpu)?;
        self.gather(cx, from, at, parts)
    }

    /// Gathers runs of points one after the other, each in `parts`.
    fn gather_runs(
        &self,
        cx: Context,
        at: BandRay,
        runs: &[Run],
        parts: u32,
        how: Gather,
    ) -> Result<()> {
        let band = &self.bands[at.band];
        let count = u64::from(band.list.count);
        for (i, run) in runs.iter().enumerate() {
            let mut bindings = [cx.scene.bindings(), run.bindings.clone()].concat();
            bindings.extend([
                ("work", (&band.list.items).into()),
                ("segments", (&band.segments).into()),
                ("counters", cx.counters.buffer().into()),
            ]);
            let bound =
                |part: u32| (u64::from(run.points) * u64::from(part) / u64::from(parts)) as u32;
            let pace = &self.paces[(u32::BITS - bound(1).leading_zeros()) as usize];
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
                let work = |slice: &mut Stage, range: std::ops::Range<u64>| {
                    let (first_item, items) =
                        (range.start as u32, (range.end - range.start) as u32);
                    let params = SegmentParams { first_item, items, ..params };
                    slice.dispatch(&self.segment, items.into(), &bindings, &params)
                };
                cx.gpu.sliced("segment", count, pace, work, &mut |_| ())?;
            }
        }
        Ok(())
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
