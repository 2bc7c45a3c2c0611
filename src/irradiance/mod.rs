//! The irradiance cache: Monte-Carlo ray casting of single scattering, a ray a pixel and pass, whose light
//! comes from a cache that learns from the shadow rays that are taken anyway.
//!
//! The cache is a grid ([`grid`]). What it has is smoothed, so a pixel keeps two means: that of samples,
//! which are right on average whatever the cache has, and what cached light is more. A picture blends
//! them, block by block, by what is less wrong: the cache at first, the samples in the end.

pub mod grid;

use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use self::grid::{Cells, Grid};
use crate::bits::words;
use crate::device_scene::DeviceScene;
use crate::device_scene::lights::Lights;
use crate::error::{Error, Result};
use crate::film::Image;
use crate::gpu::counter::{Choice, CounterBuffer, Counters};
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::queue::Total;
use crate::gpu::resource::{Bindings, Bytes};
use crate::gpu::run::Stage;
use crate::gpu::turns::Told;
use crate::gpu::{Gpu, Progress};
use crate::history::{
    CHANGE_ALBEDO, CHANGE_EMISSION, CHANGE_FALLEN, CHANGE_PHASE, CHANGE_RISEN, Query,
};
use crate::scene::{Cache, Scene, Shadows};
use crate::segment::SegmentParams;

shared_struct! {
    /// What the kernels of the cache are told; lengths in the volume's frame.
    pub struct CacheParams {
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
        /// First item of this dispatch.
        pub first_item: u32,
        /// Down the whole image.
        pub down: [f32; 3],
        /// Items of this dispatch.
        pub items: u32,
        /// Radiance behind the volume.
        pub background: [f32; 3],
        /// Passes that began before this one.
        pub pass_number: u32,
        /// Cells of the coarsest level along each axis.
        pub grid: [u32; 3],
        /// Levels.
        pub levels: u32,
        /// Cells of the coarsest level for each mm.
        pub per_edge: [f32; 3],
        /// Slots of the hash table, a power of two.
        pub slots: u32,
        /// Scale of its sums.
        pub scale: f32,
        /// 1 / `scale`.
        pub per_sum: f32,
        /// Cells beyond which no fine ones are made.
        pub room: u32,
        /// The least chance of a light sample.
        pub least_chance: f32,
        /// Bins where an edit may have rays and shadow rays meet another collision.
        pub risen: [u32; 2],
        /// Bins of values that give other light.
        pub altered: [u32; 2],
        /// 1 where all pixels begin anew.
        pub restart: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
        /// The same.
        pub pad2: u32,
    }
}

shared_struct! {
    /// What is kept of a pixel: its samples S, and what cached light is more, D = C - S.
    pub struct Film {
        /// Mean of S.
        pub mean: [f32; 3],
        /// Samples.
        pub passes: u32,
        /// Mean of D.
        pub more: [f32; 3],
        /// Sum of squared deviations of D, all channels together.
        pub spread: f32,
        /// The same of S times D.
        pub covariance: f32,
        /// The same of S.
        pub deviation: f32,
        /// Historygram of the cells that its rays have crossed.
        pub own: [u32; 2],
        /// Of the values that gave light.
        pub events: [u32; 2],
        /// Of the cells that its shadow rays have crossed.
        pub shadow: [u32; 2],
    }
}

shared_struct! {
    /// A scatter event of a pass.
    pub struct Event {
        /// Where.
        pub place: [f32; 3],
        /// Its table entry.
        pub entry: u32,
        /// What its ray has gathered of cached and emitted light.
        pub seen: [f32; 3],
        /// The chance that a light sample is taken.
        pub chance: f32,
        /// What the cache has for it.
        pub cached: [f32; 3],
        /// A bit for each level that learns the sample; the highest: the cache has something.
        pub adds: u32,
    }
}

/// Pixels across a block, and down (`kernels/shared/cache.wgsl`).
const BLOCK: [u32; 2] = [16, 8];

/// The images of a film.
#[derive(Clone, Debug)]
pub struct Images {
    /// What is shown: samples and cached light, blended.
    pub blended: Image,
    /// Samples alone: no bias.
    pub samples: Image,
    /// Cached light alone, as far as the cache had any.
    pub cached: Image,
    /// The standard error of each pixel of `samples`, its channels together.
    pub error: Image,
}

/// How long passes are added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Until {
    /// So many.
    Passes(u32),
    /// As long as it takes to pass this time.
    Time(Duration),
}

/// What an edit touched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Touched {
    /// Pixels in all.
    pub pixels: u64,
    /// Those that begin anew.
    pub restarted: u64,
    /// Whether cells are kept as they are; else what they have counts as little.
    pub cells_stand: bool,
}

/// An image in the making, with its cache.
pub struct IrradianceCache {
    /// The scene on the device.
    pub scene: DeviceScene,
    source: Scene,
    params: CacheParams,
    grid: Option<Grid>,
    majorants: wgpu::Texture,
    majorants_view: wgpu::TextureView,
    film: wgpu::Buffer,
    events: wgpu::Buffer,
    found: wgpu::Buffer,
    shares: wgpu::Buffer,
    image: wgpu::Buffer,
    counters: CounterBuffer,
    rays: Arc<Kernel>,
    light: Arc<Kernel>,
    pool: Arc<Kernel>,
    blend: Arc<Kernel>,
    restart: Arc<Kernel>,
    forget: Arc<Kernel>,
    ray_pace: Pace,
    light_pace: Pace,
}

impl IrradianceCache {
    /// Begins an image of a settled scene.
    ///
    /// # Errors
    /// A material scatters anisotropically, or film and cache do not fit the adapter.
    pub fn new(gpu: &Gpu, scene: &Scene, device: DeviceScene) -> Result<Self> {
        refuse_anisotropic(&device.table)?;
        let settings = &scene.settings;
        let grid = match settings.cache {
            Cache::None => None,
            Cache::Grid => Some(Grid::new(gpu, &device, scene)?),
        };
        let counts = device.params.cells;
        let majorants = gpu.device().create_texture(&wgpu::TextureDescriptor {
            label: Some("majorants"),
            size: wgpu::Extent3d {
                width: counts[0],
                height: counts[1],
                depth_or_array_layers: counts[2],
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format: wgpu::TextureFormat::R32Float,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let pixels = scene.camera.width as usize * scene.camera.height as usize;
        let [rays, light] = kernels(gpu, scene, &device)?;
        let mut cache = Self {
            params: CacheParams::default(),
            majorants_view: majorants.create_view(&Default::default()),
            majorants,
            film: gpu.buffer::<Film>("film", pixels)?,
            events: gpu.buffer::<Event>("events", pixels)?,
            found: gpu.buffer::<u32>("events found", pixels + 1)?,
            shares: gpu.buffer::<f32>("shares", blocks(scene) as usize)?,
            image: gpu.buffer::<[f32; 4]>("image", pixels)?,
            counters: CounterBuffer::new(gpu)?,
            rays,
            light,
            pool: gpu.kernel("cache_pool", &[])?,
            blend: gpu.kernel("cache_image", &[])?,
            restart: gpu.kernel("cache_restart", &[])?,
            forget: gpu.kernel("cache_forget", &[])?,
            ray_pace: Pace::new(gpu, 1 << 15),
            light_pace: Pace::new(gpu, 1 << 15),
            source: scene.clone(),
            scene: device,
            grid,
        };
        cache.look()?;
        cache.write_majorants(gpu)?;
        Ok(cache)
    }

    /// Takes camera, background and settings of the scene.
    fn look(&mut self) -> Result<()> {
        let camera = SegmentParams::of(self.source.camera.rays(&self.scene.local_from_world)?);
        let own = self.grid.as_ref().map(Grid::params).unwrap_or_default();
        self.params = CacheParams {
            origin: camera.origin,
            width: camera.width,
            corner: camera.corner,
            height: camera.height,
            right: camera.right,
            down: camera.down,
            background: self.source.background.as_vec3().to_array(),
            pass_number: self.params.pass_number,
            least_chance: self.source.settings.least_chance as f32,
            ..own
        };
        Ok(())
    }

    fn write_majorants(&self, gpu: &Gpu) -> Result<()> {
        // Where only emission is, one look per macro-cell edge suffices on average.
        let edges = self.scene.params.cell_mm;
        let glow_rate = 1.0 / edges.iter().copied().fold(f32::INFINITY, f32::min);
        let all = self.scene.cells.majorants(&self.scene.table, glow_rate);
        gpu.write_texture(&self.majorants, &all)
    }

    fn pixels(&self) -> u64 {
        u64::from(self.params.width) * u64::from(self.params.height)
    }

    fn bindings(&self) -> Bindings {
        let mut bindings = self.scene.bindings();
        bindings.extend([
            ("majorants", (&self.majorants_view).into()),
            ("film", (&self.film).into()),
            ("events", (&self.events).into()),
            ("found", (&self.found).into()),
            ("shares", (&self.shares).into()),
            ("image", (&self.image).into()),
            ("counters", self.counters.buffer().into()),
        ]);
        bindings.extend(self.grid.iter().map(|grid| ("table", (&grid.table).into())));
        bindings
    }

    /// Adds a sample to every pixel, and to the cache what was learned on the way. Nobody waits.
    ///
    /// # Errors
    /// The device failed.
    pub fn pass(&mut self, gpu: &Gpu, progress: &mut Progress) -> Result<()> {
        let all = self.params;
        let bindings = self.bindings();
        let mut stage = gpu.stage("cache_rays");
        stage.clear_bytes(Bytes { size: 4, ..Bytes::all(&self.found) });
        stage.finish()?;
        let over = |kernel: &Arc<Kernel>| {
            let (kernel, bindings) = (kernel.clone(), bindings.clone());
            move |stage: &mut Stage, range: Range<u64>| {
                let (first_item, items) = (range.start as u32, (range.end - range.start) as u32);
                let params = CacheParams { first_item, items, ..all };
                stage.dispatch(&kernel, items.into(), &bindings, &params)
            }
        };
        let items = u64::from(blocks(&self.source)) * u64::from(BLOCK[0] * BLOCK[1]);
        let total = Total::Known(items);
        gpu.sliced("cache_rays", total, &self.ray_pace, over(&self.rays), progress)?;
        // As many as there are pixels, at most.
        let total = Total::Told(Told::of(&self.found, self.pixels() as u32));
        gpu.sliced("cache_light", total, &self.light_pace, over(&self.light), progress)?;
        self.params.pass_number += 1;
        Ok(())
    }

    /// Adds passes: so many, or for so long, one at least.
    ///
    /// # Errors
    /// The device failed.
    pub fn run(&mut self, gpu: &Gpu, until: Until, progress: &mut Progress) -> Result<()> {
        let begun = Instant::now();
        for pass in 0_u32.. {
            let (done, of) = match until {
                Until::Passes(passes) => (u64::from(pass), u64::from(passes)),
                Until::Time(time) => {
                    (begun.elapsed().as_millis() as u64, time.as_millis().max(1) as u64)
                }
            };
            progress.at("passes", done.min(of), of);
            if done >= of && pass > 0 {
                break;
            }
            self.pass(gpu, &mut Progress::silent())?;
            if matches!(until, Until::Time(_)) {
                gpu.wait("pass")?;
            }
        }
        gpu.wait("pass")
    }

    /// Passes that each pixel would have had without edits.
    pub fn passes(&self) -> u32 {
        self.params.pass_number
    }

    /// What is shown, and what it is made of.
    ///
    /// # Errors
    /// The device failed, or its driver ended loops of rays.
    pub fn images(&self, gpu: &Gpu) -> Result<Images> {
        self.check(gpu)?;
        let mut stage = gpu.stage("cache_image");
        let blocks = blocks(&self.source);
        let params = CacheParams { items: blocks, ..self.params };
        stage.dispatch(&self.pool, blocks.into(), &self.bindings(), &params)?;
        let params = CacheParams { items: self.pixels() as u32, ..self.params };
        stage.dispatch(&self.blend, self.pixels(), &self.bindings(), &params)?;
        stage.finish()?;
        let film = self.film(gpu)?;
        let blended = gpu.read::<[f32; 4]>("image", &self.image)?;
        let (width, height) = (self.params.width, self.params.height);
        let image = |rgb: Vec<[f32; 3]>| Image { width, height, rgb };
        let each = |f: &dyn Fn(&Film) -> [f32; 3]| image(film.iter().map(f).collect());
        let error = |f: &Film| {
            let n = f64::from(f.passes);
            let variance = f64::from(f.deviation) / (n - 1.0).max(1.0) / n.max(1.0) / 3.0;
            [variance.sqrt() as f32; 3]
        };
        Ok(Images {
            blended: image(blended.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()),
            samples: each(&|f| f.mean),
            cached: each(&|f| std::array::from_fn(|i| f.mean[i] + f.more[i])),
            error: each(&error),
        })
    }

    /// What is kept of each pixel, row by row.
    ///
    /// # Errors
    /// The device failed.
    pub fn film(&self, gpu: &Gpu) -> Result<Vec<Film>> {
        gpu.read("film", &self.film)
    }

    /// What was counted since the beginning.
    ///
    /// # Errors
    /// The device failed.
    pub fn counts(&self, gpu: &Gpu) -> Result<Counters> {
        self.counters.read(gpu)
    }

    fn check(&self, gpu: &Gpu) -> Result<()> {
        match self.counts(gpu)?.unfinished {
            0 => Ok(()),
            items => {
                let remedy = "lower the extinctions, or the volume's resolution";
                Err(Counters::unfinished_error(items, "cache_rays", remedy))
            }
        }
    }

    /// The cells of the cache, by level; `None` without one.
    ///
    /// # Errors
    /// The device failed.
    pub fn cells(&self, gpu: &Gpu) -> Result<Option<Cells>> {
        let Some(grid) = &self.grid else { return Ok(None) };
        let counted = [Choice::Cells, Choice::Refused].map(|sum| self.counters.sum(gpu, sum));
        let [made, refused] = counted;
        Ok(Some(Cells { made: made?, refused: refused?, ..grid.cells(gpu)? }))
    }

    /// The slots of the hash table, [`grid::SLOT_WORDS`] words each; `None` without a grid.
    ///
    /// # Errors
    /// The device failed.
    pub fn table(&self, gpu: &Gpu) -> Result<Option<Vec<u32>>> {
        self.grid.as_ref().map(|grid| gpu.read("irradiance cache", &grid.table)).transpose()
    }

    /// The level of the cell that has a key, from the coarsest on.
    pub fn level_of(&self, key: u32) -> Option<u32> {
        self.grid.as_ref().and_then(|grid| grid.level_of(key))
    }

    /// Takes an edited scene: materials, lights, camera and background may differ. Pixels whose samples
    /// it may change begin anew. Cells stay; where their light may be another they count as little.
    ///
    /// # Errors
    /// Something differs that cannot, or the scene is an impossible one: nothing has happened then; or the
    /// device failed.
    pub fn edit(&mut self, gpu: &Gpu, scene: &Scene) -> Result<Touched> {
        scene.check()?;
        let same = |s: &Scene| {
            let Scene { volume, filter, settings, camera, .. } = s.clone();
            (volume, filter, settings, camera.width, camera.height)
        };
        if same(scene) != same(&self.source) {
            return Err(Error::setting(
                "an edit of the irradiance cache changes materials, lights, camera and background: \
                 render anew for other settings, sizes and volumes",
            ));
        }
        let table = self.scene.table_of(scene)?;
        refuse_anisotropic(&table)?;
        if !self.scene.collides_as(scene)? {
            return Err(Error::setting(
                "the edit names values beyond the table's domain, or raises extinction above the \
                 majorant: render anew",
            ));
        }
        let lights = Lights::of(scene, &self.scene.local_from_world)?;
        let suits = self.scene.suits(&table);
        let bins = self.scene.bins;
        let query = Query::between(&self.scene.table, &table, &bins, self.scene.params.majorant);
        let extinction = CHANGE_RISEN | CHANGE_FALLEN;
        let dims = query.mask(extinction, &bins) != 0;
        let relit = lights != self.scene.lights;
        let moved =
            scene.camera != self.source.camera || scene.background != self.source.background;
        self.scene.edit(gpu, table, lights, &query)?;
        self.source = scene.clone();
        self.look()?;
        self.write_majorants(gpu)?;
        if !suits {
            [self.rays, self.light] = kernels(gpu, scene, &self.scene)?;
        }
        let cells_stand = !relit && !dims;
        let params = CacheParams {
            // Emission moves majorants, too, where nothing else is.
            risen: words(query.mask(extinction | CHANGE_EMISSION, &bins)),
            altered: words(query.mask(CHANGE_ALBEDO | CHANGE_EMISSION | CHANGE_PHASE, &bins)),
            restart: (relit || moved || !self.source.settings.history).into(),
            items: self.pixels() as u32,
            ..self.params
        };
        let before = self.counts(gpu)?.changed;
        let mut stage = gpu.stage("cache_restart");
        stage.dispatch(&self.restart, self.pixels(), &self.bindings(), &params)?;
        if !cells_stand && self.grid.is_some() {
            stage.dispatch(&self.forget, params.slots.into(), &self.bindings(), &params)?;
        }
        stage.finish()?;
        let restarted = self.counts(gpu)?.changed - before;
        Ok(Touched { pixels: self.pixels(), restarted, cells_stand })
    }

    /// Bytes of film and cache, by name.
    pub fn bytes(&self) -> Vec<(&'static str, u64)> {
        let film = [&self.film, &self.events, &self.found, &self.shares, &self.image];
        let mut bytes = vec![("film", film.iter().map(|buffer| buffer.size()).sum())];
        bytes.extend(self.grid.iter().map(|grid| ("cache", grid.table.size())));
        bytes
    }
}

/// Blocks of pixels.
fn blocks(scene: &Scene) -> u32 {
    scene.camera.width.div_ceil(BLOCK[0]) * scene.camera.height.div_ceil(BLOCK[1])
}

fn refuse_anisotropic(table: &crate::transfer::Table) -> Result<()> {
    match table.is_isotropic() {
        true => Ok(()),
        false => Err(Error::setting(
            "the irradiance cache knows isotropic scattering only, and a material has phase_g other \
             than 0: use `method = \"mcvr\"`",
        )),
    }
}

fn kernels(gpu: &Gpu, scene: &Scene, device: &DeviceScene) -> Result<[Arc<Kernel>; 2]> {
    let settings = &scene.settings;
    let mut flags = device.flags();
    let more = [
        ("grid", settings.cache == Cache::Grid),
        ("gather", settings.cache == Cache::Grid && settings.gather),
        ("all_lights", settings.shadows == Shadows::All),
        ("evenly", settings.shadows == Shadows::Evenly),
    ];
    flags.extend(more.iter().filter(|(_, on)| *on).map(|(flag, _)| *flag));
    Ok([gpu.kernel("cache_rays", &flags)?, gpu.kernel("cache_light", &flags)?])
}
