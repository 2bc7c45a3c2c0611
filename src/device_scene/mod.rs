//! The scene on the device: volume, transfer function, macro-cells, lights.

mod columns;
pub mod lights;

use std::sync::Arc;

use glam::{DAffine3, DVec3};

use self::columns::{column_texture, columns_of};
use self::lights::Lights;
use crate::bits::{hash, words};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::counter::CounterBuffer;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::resource::Bindings;
use crate::history::{Bins, LAYERS, MARK_CLASSES, Query};
use crate::scene::{Filter, Scene, effective_majorant, extinction_limit};
use crate::transfer::{CellEntries, Domain, TABLE_ENTRIES, Table, spans, sum_unit};
use crate::volume::cells::{CELL_EDGE, MacroCells};
use crate::volume::texture::{MAX_SQUARES, bytes_of_squares, upload};
use crate::volume::{Numbers, Volume, Voxels};

/// Tentative collisions across a volume beyond which a flight may not come to its end: the mean
/// step is then a few times the least that an `f32` can take there.
const MAX_COLLISIONS: f64 = (1 << 21) as f64;

shared_struct! {
    /// What every kernel may look at; lengths in mm along the volume's axes.
    pub struct SceneParams {
        /// Voxels.
        pub size: [u32; 3],
        /// Hashed seed.
        pub seed: u32,
        /// Extent of the bounds, mm.
        pub extent: [f32; 3],
        /// See [`EntryMap`](crate::transfer::EntryMap).
        pub gain: f32,
        /// Voxels per mm.
        pub per_voxel: [f32; 3],
        /// The scene's fixed rate of tentative collisions, 1/mm.
        pub majorant: f32,
        /// Macro-cells along each axis.
        pub cells: [u32; 3],
        /// Classes of marks in a photon's history (see [`Bins`]).
        pub mark_classes: u32,
        /// Edge of a macro-cell, mm.
        pub cell_mm: [f32; 3],
        /// March step under the linear filter, mm.
        pub step: f32,
        /// Bins with any extinction or emission.
        pub visible_bins: [u32; 2],
        /// See [`EntryMap`](crate::transfer::EntryMap).
        pub shift: f32,
        /// See [`Bins`], and so are the following.
        pub bin_scale: u32,
        /// Added to the bin.
        pub bin_after: i32,
        /// The least bin.
        pub bin_low: i32,
        /// The greatest bin.
        pub bin_high: i32,
        /// Of sums of extinction over table entries (see `columns_of`).
        pub unit: f32,
        /// Of sums of emission.
        pub glow_unit: f32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
        /// The same.
        pub pad2: u32,
    }
}

shared_struct! {
    /// What decides a collision at a table entry.
    pub struct Optics {
        /// 1/mm.
        pub extinction: f32,
        /// What the edit in progress changes, `CHANGE_` bits of [`crate::history`].
        pub changes: u32,
    }
}

shared_struct! {
    /// What a table entry looks like.
    pub struct Shading {
        /// Scatter times colour.
        pub albedo: [f32; 3],
        /// Henyey-Greenstein g.
        pub phase_g: f32,
        /// Emitted radiance per mm.
        pub emission: [f32; 3],
        /// 1/mm, as in [`Optics`].
        pub extinction: f32,
    }
}

shared_struct! {
    /// What a macro-cell can have, whatever the materials.
    pub struct CellRange {
        /// Least table entry.
        pub low: u32,
        /// Greatest.
        pub high: u32,
        /// History bits of all of them, with marks of the first layer.
        pub values: [u32; 2],
    }
}

shared_struct! {
    /// Layers of marks in a macro-cell (see `kernels/shared/flight.wgsl`).
    pub struct CellLayers {
        /// The first that can be real; [`LAYERS`] where none can.
        pub first: u32,
        /// A bit for each in which the edit in progress may have made something real.
        pub opened: u32,
        /// History bits of all values with the marks of the layers before the first.
        pub skipped: [u32; 2],
    }
}

/// What every stage works with.
#[derive(Clone, Copy)]
pub struct Context<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The scene.
    pub scene: &'a DeviceScene,
    /// What the stages count.
    pub counters: &'a CounterBuffer,
}

/// How a scene lies on the device, beside what it says itself.
#[derive(Clone, Copy, Debug)]
pub struct Storage {
    /// The bins of histories; `None`: those that suit the table's domain.
    pub bins: Option<Bins>,
    /// Bytes that squares of voxels may take; a larger volume lies voxel by voxel.
    pub max_squares: u64,
}

impl Default for Storage {
    fn default() -> Self {
        Self { bins: None, max_squares: MAX_SQUARES }
    }
}

/// The scene on the device.
pub struct DeviceScene {
    /// What every kernel is told of it.
    pub params: SceneParams,
    /// From world mm to the volume's own frame.
    pub local_from_world: DAffine3,
    /// The transfer function.
    pub table: Table,
    /// How table entries map to bits of histories.
    pub bins: Bins,
    /// The lights.
    pub lights: Lights,
    /// The table entries that macro-cells can produce.
    pub cells: CellEntries,
    /// Layers that edits in progress have opened, by table entry.
    opened: Vec<u8>,
    /// Which values the table's entries stand for.
    pub domain: Domain,
    /// Bins that are compared; `None`: those that suit the domain.
    own_bins: Option<Bins>,
    grid: Grid,
    nearest: bool,
    squares: bool,
    float_voxels: bool,
    skip: bool,
    history: bool,
    params_buffer: wgpu::Buffer,
    volume: wgpu::TextureView,
    volume_bytes: u64,
    /// [`Optics`] of the table, then [`CellLayers`].
    tracking: wgpu::Buffer,
    shading: wgpu::Buffer,
    columns: wgpu::Texture,
    columns_view: wgpu::TextureView,
    masks: wgpu::Texture,
    cell_masks: wgpu::TextureView,
    cell_ranges: wgpu::Buffer,
    spans: wgpu::Buffer,
    find_layers: Arc<Kernel>,
    lights_buffer: wgpu::Buffer,
}

impl DeviceScene {
    /// Uploads a settled scene with its volume.
    ///
    /// # Errors
    /// The scene is not settled or an impossible one, or the device refuses.
    pub fn new(gpu: &Gpu, scene: &Scene, volume: &Volume) -> Result<Self> {
        Self::stored(gpu, scene, volume, &Storage::default())
    }

    /// The same, stored otherwise, to compare.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn stored(gpu: &Gpu, scene: &Scene, volume: &Volume, storage: &Storage) -> Result<Self> {
        scene.check()?;
        let grid = Grid {
            size: volume.size(),
            extent: volume.extent(),
            spacing: volume.spacing(),
            numbers: volume.numbers(),
            cells: MacroCells::of(volume),
        };
        let local_from_world = volume.local_from_world();
        let lights = Lights::of(scene, &local_from_world)?;
        let setup = Setup::of(scene, &grid, storage.bins)?;
        let nearest = scene.filter == Filter::Nearest;
        let squares = !nearest && bytes_of_squares(volume) <= storage.max_squares;
        let bytes = bytes_of_squares(volume);
        gpu.has_room("volume", if squares { bytes } else { bytes / 4 })?;
        let uploaded = upload(gpu, volume, squares)?;
        let query = Query::default();
        // What each cell has is found below.
        let mut tracking = optics_of(&setup.table, &query);
        let per_cell = size_of::<CellLayers>() / size_of::<Optics>();
        tracking.resize(TABLE_ENTRIES + per_cell * setup.ranges.len(), Optics::default());
        let masks = mask_texture(gpu, grid.cells.counts)?;
        let columns = column_texture(gpu)?;
        let device = Self {
            params_buffer: gpu.upload("scene", &[setup.params])?,
            tracking: gpu.upload("tracking", &tracking)?,
            shading: gpu.upload("shading", &shading_of(&setup.table))?,
            cell_masks: masks.create_view(&Default::default()),
            masks,
            columns_view: columns.create_view(&Default::default()),
            columns,
            cell_ranges: gpu.upload("cell ranges", &setup.ranges)?,
            spans: gpu
                .upload("layers", &layers_of_spans(&setup.table, &query, setup.params.majorant))?,
            find_layers: gpu.kernel("layers", &[])?,
            lights_buffer: gpu.upload("lights", &[lights])?,
            volume: uploaded.view,
            volume_bytes: uploaded.bytes,
            nearest,
            squares,
            float_voxels: matches!(volume.voxels(), Voxels::F32(_)),
            skip: scene.settings.skip_empty,
            history: scene.settings.history,
            local_from_world,
            lights,
            opened: query.opened,
            own_bins: storage.bins,
            params: setup.params,
            domain: setup.domain,
            table: setup.table,
            bins: setup.bins,
            cells: setup.cells,
            grid,
        };
        device.write_masks(gpu)?;
        device.write_columns(gpu, &device.table)?;
        device.find_layers(gpu)?;
        gpu.check("scene").map(|()| device)
    }

    /// Takes a scene of other constants: its majorant, seed, step, the table's domain, and what is
    /// compiled in. All but the volume is as if it were new. `query` is that of [`Self::edit`].
    ///
    /// # Errors
    /// The majorant is out of proportion, or the device failed.
    pub fn configure(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        table: Table,
        lights: Lights,
        query: &Query,
    ) -> Result<()> {
        let setup = Setup::of(scene, &self.grid, self.own_bins)?;
        (self.params, self.domain, self.bins) = (setup.params, setup.domain, setup.bins);
        self.cells = setup.cells;
        (self.skip, self.history) = (scene.settings.skip_empty, scene.settings.history);
        gpu.write(&self.cell_ranges, &setup.ranges)?;
        self.write_masks(gpu)?;
        // What the layers are of is told anew.
        self.opened.clear();
        self.edit(gpu, table, lights, query)
    }

    /// Whether another scene has its photons meet the same tentative collisions: its majorant and the
    /// values that its table's entries stand for are those of this one.
    ///
    /// # Errors
    /// The scene is not settled.
    pub fn collides_as(&self, scene: &Scene) -> Result<bool> {
        let Constants { majorant, domain, .. } = Constants::of(scene, &self.grid)?;
        Ok(majorant as f32 == self.params.majorant && domain == self.domain)
    }

    fn write_masks(&self, gpu: &Gpu) -> Result<()> {
        let masks = self.bins.masks(&self.cells).into_iter().map(words).collect::<Vec<_>>();
        gpu.write_texture(&self.masks, &masks)
    }

    fn write_columns(&self, gpu: &Gpu, table: &Table) -> Result<()> {
        gpu.write_texture(&self.columns, &columns_of(table, &self.params))
    }

    /// Finds the layers of marks in each macro-cell.
    fn find_layers(&self, gpu: &Gpu) -> Result<()> {
        let bindings: Bindings = vec![
            ("scene", (&self.params_buffer).into()),
            ("cell_ranges", (&self.cell_ranges).into()),
            ("spans", (&self.spans).into()),
            ("tracked", (&self.tracking).into()),
        ];
        let mut stage = gpu.stage("layers");
        stage.dispatch(&self.find_layers, self.cells.ranges.len() as u64, &bindings, &())?;
        stage.finish()
    }

    /// The table of an edited scene.
    ///
    /// # Errors
    /// The scene is not settled.
    pub fn table_of(&self, scene: &Scene) -> Result<Table> {
        Constants::of(scene, &self.grid).map(|constants| constants.table)
    }

    /// Takes another table and other lights. `query` says what that changes, and what
    /// edits before it changed that are not yet applied.
    ///
    /// # Errors
    /// The device failed.
    pub fn edit(&mut self, gpu: &Gpu, table: Table, lights: Lights, query: &Query) -> Result<()> {
        self.params.visible_bins = words(self.bins.opaque_mask(&table));
        self.params.glow_unit = sum_unit(table.max_emission());
        if (&table.extinction, &query.opened) != (&self.table.extinction, &self.opened) {
            gpu.write(&self.spans, &layers_of_spans(&table, query, self.params.majorant))?;
            self.find_layers(gpu)?;
            self.opened.clone_from(&query.opened);
        }
        gpu.write(&self.params_buffer, &[self.params])?;
        gpu.write(&self.tracking, &optics_of(&table, query))?;
        gpu.write(&self.shading, &shading_of(&table))?;
        self.write_columns(gpu, &table)?;
        gpu.write(&self.lights_buffer, &[lights])?;
        (self.table, self.lights) = (table, lights);
        Ok(())
    }

    /// Whether kernels compiled for this scene also suit another table.
    pub fn suits(&self, table: &Table) -> bool {
        specialisation(&self.table) == specialisation(table)
    }

    /// The scene's resources, by the names that the kernels give them.
    pub fn bindings(&self) -> Bindings {
        vec![
            ("scene", (&self.params_buffer).into()),
            ("volume", (&self.volume).into()),
            ("tracking", (&self.tracking).into()),
            ("shading", (&self.shading).into()),
            ("columns", (&self.columns_view).into()),
            ("cell_masks", (&self.cell_masks).into()),
            ("lights", (&self.lights_buffer).into()),
        ]
    }

    /// The flags of kernels that this scene sets.
    pub fn flags(&self) -> Vec<&'static str> {
        let [anisotropic, emission] = specialisation(&self.table);
        let all = [
            ("nearest", self.nearest),
            ("squares", self.squares),
            ("float_voxels", self.float_voxels),
            ("skip", self.skip),
            ("history", self.history),
            ("anisotropic", anisotropic),
            ("emission", emission),
        ];
        all.iter().filter(|(_, on)| *on).map(|(flag, _)| *flag).collect()
    }

    /// Bytes of the volume and of the macro-cells.
    pub fn bytes(&self) -> Vec<(&'static str, u64)> {
        vec![
            ("volume", self.volume_bytes),
            ("macro-cells", self.cells.ranges.len() as u64 * CELL_BYTES),
        ]
    }
}

/// What kernels are specialised for: any anisotropic scattering, any emission.
fn specialisation(table: &Table) -> [bool; 2] {
    [!table.is_isotropic(), table.emission.iter().any(|e| *e != [0.0; 3])]
}

/// Bytes of a macro-cell: its mask, range and layers.
const CELL_BYTES: u64 = 8 + (size_of::<CellRange>() + size_of::<CellLayers>()) as u64;

fn optics_of(table: &Table, query: &Query) -> Vec<Optics> {
    let optics = |(&extinction, &changes)| Optics { extinction, changes };
    table.extinction.iter().zip(&query.changes).map(optics).collect()
}

fn shading_of(table: &Table) -> Vec<Shading> {
    let shading = |e: usize| Shading {
        albedo: table.albedo(e),
        phase_g: table.phase_g[e],
        emission: table.emission[e],
        extinction: table.extinction[e],
    };
    (0..TABLE_ENTRIES).map(shading).collect()
}

/// Writes all texels of a texture.
/// Room for the bins of each macro-cell: a texture takes none of the few storage buffers of a kernel.
fn mask_texture(gpu: &Gpu, cells: [u32; 3]) -> Result<wgpu::Texture> {
    let [width, height, depth_or_array_layers] = cells;
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("cell masks"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rg32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.check("cell masks").map(|()| texture)
}

/// What is known of the volume when its voxels are on the device.
struct Grid {
    size: [u32; 3],
    extent: DVec3,
    spacing: DVec3,
    numbers: Numbers,
    cells: MacroCells,
}

/// What decides tentative collisions, and the table.
struct Constants {
    majorant: f64,
    domain: Domain,
    table: Table,
}

impl Constants {
    fn of(scene: &Scene, grid: &Grid) -> Result<Self> {
        let settled = scene.settings.majorant;
        let settled =
            settled.ok_or_else(|| Error::setting("the scene has no majorant: settle it first"))?;
        let domain = Domain::fitting(scene.settings.range, &grid.numbers, &scene.materials);
        let limit = extinction_limit(settled, grid.spacing);
        let table = Table::build(&scene.materials, &domain, Some(limit));
        let greatest = table.max_extinction().into();
        let majorant = effective_majorant(settled, greatest, grid.spacing);
        Ok(Self { majorant, domain, table })
    }
}

/// What a scene makes of a volume.
struct Setup {
    params: SceneParams,
    domain: Domain,
    table: Table,
    bins: Bins,
    cells: CellEntries,
    ranges: Vec<CellRange>,
}

impl Setup {
    fn of(scene: &Scene, grid: &Grid, own_bins: Option<Bins>) -> Result<Self> {
        let settings = &scene.settings;
        let Constants { majorant, domain, table } = Constants::of(scene, grid)?;
        let longest = grid.extent.length();
        if majorant * longest > MAX_COLLISIONS {
            return Err(Error::setting(format!(
                "`majorant` is {majorant} per mm: across {longest} mm collisions come closer than \
                 single precision tells places apart; lower it, or leave it out"
            )));
        }
        let map = domain.map(&grid.numbers);
        let bins = own_bins.unwrap_or_else(|| Bins::of(&domain, MARK_CLASSES));
        let cells = CellEntries::of(&grid.cells, map);
        let spacing = grid.spacing.as_vec3();
        let params = SceneParams {
            size: grid.size,
            seed: hash(settings.seed),
            extent: grid.extent.as_vec3().to_array(),
            gain: map.gain,
            per_voxel: spacing.recip().to_array(),
            majorant: majorant as f32,
            cells: grid.cells.counts,
            mark_classes: bins.mark_classes,
            cell_mm: (spacing * CELL_EDGE as f32).to_array(),
            step: spacing.min_element() * settings.step as f32,
            visible_bins: words(bins.opaque_mask(&table)),
            shift: map.shift,
            bin_scale: bins.scale,
            bin_after: bins.after,
            bin_low: bins.low,
            bin_high: bins.high,
            unit: sum_unit(majorant as f32),
            glow_unit: sum_unit(table.max_emission()),
            ..Default::default()
        };
        let cell_values = cells.fold(|e| bins.tentative_bit(e, 0), |a, b| a | b);
        let range = |(&[low, high], values): (&[u16; 2], u64)| CellRange {
            low: low.into(),
            high: high.into(),
            values: words(values),
        };
        let ranges = cells.ranges.iter().zip(cell_values).map(range).collect();
        Ok(Self { params, domain, table, bins, cells, ranges })
    }
}

/// The layers of marks of 2^k neighbouring table entries, for all k (`kernels/layers.wgsl`).
fn layers_of_spans(table: &Table, query: &Query, majorant: f32) -> Vec<u32> {
    let of = |e: usize| (first_layer(table.extinction[e], majorant), query.opened[e]);
    let join = |a: (u32, u8), b: (u32, u8)| (a.0.min(b.0), a.1 | b.1);
    let mut all = Vec::new();
    for (k, level) in spans(of, join).into_iter().enumerate() {
        all.extend(level.into_iter().map(|(first, opened)| first | u32::from(opened) << 8));
        all.resize((k + 1) * TABLE_ENTRIES, 0);
    }
    all
}

/// The first layer of marks that can be real where extinction is at most `greatest`:
/// layers before k have marks of 2^-k and above. [`LAYERS`] where none can.
fn first_layer(greatest: f32, majorant: f32) -> u32 {
    if greatest <= 0.0 {
        return LAYERS;
    }
    let holds = |k: &u32| greatest <= majorant * 0.5_f32.powi(*k as i32);
    (1..LAYERS).take_while(holds).last().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Segments rely on no entry below the two that they look at.
    #[test]
    fn differences_of_sums_do_not_tell_what_lies_below_both() {
        let mut thin = Table::build(&[], &Domain::over([0.0, 1.0]), None);
        thin.extinction[3000..3100].fill(1e-4);
        let mut dense = thin.clone();
        dense.extinction[..2000].fill(3.7);
        let unit = sum_unit(4.0);
        let params = SceneParams { unit, glow_unit: 1.0, ..Default::default() };
        let difference = |table: &Table| {
            let texels = columns_of(table, &params);
            let sum = |e: usize| {
                let [low, high] = [1, 2].map(|row| texels[row * TABLE_ENTRIES + e][3]);
                u64::from(low) | u64::from(high) << 32
            };
            sum(3100) - sum(3000)
        };
        assert_eq!(difference(&thin), difference(&dense));
        let depth = difference(&dense) as f64 * f64::from(unit);
        assert!((depth / (100.0 * f64::from(1e-4_f32)) - 1.0).abs() < 1e-6, "{depth}");
    }
}
