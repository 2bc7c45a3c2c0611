//! The scene on the device: volume, transfer function, macro-cells, lights.

pub mod lights;

use std::sync::Arc;

use glam::DAffine3;

use self::lights::Lights;
use crate::bits::{hash, words};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::run::Bindings;
use crate::history::{Bins, LAYERS, MARK_CLASSES, Query};
use crate::scene::{Filter, Scene};
use crate::transfer::{CellEntries, TABLE_ENTRIES, Table, spans};
use crate::volume::cells::{CELL_EDGE, MacroCells};
use crate::volume::texture::{MAX_SQUARES, bytes_of_squares, upload};
use crate::volume::{Volume, Voxels};

/// Tentative collisions across a volume beyond which a flight may not come to its end: the mean
/// step is then a few times the least that an `f32` can take there.
const MAX_COLLISIONS: f64 = (1 << 21) as f64;

shared_struct! {
    /// What every kernel may look at; lengths in mm along the volume's axes.
    pub struct Frame {
        /// Voxels.
        pub size: [u32; 3],
        /// Hashed seed.
        pub seed: u32,
        /// Extent of the bounds, mm.
        pub extent: [f32; 3],
        /// A voxel's number times this is in [0, 1].
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
        /// Keeps the size a multiple of 16.
        pub pad: [u32; 2],
    }
}

shared_struct! {
    /// What decides a collision, and the bin of a table entry.
    pub struct Optics {
        /// 1/mm.
        pub extinction: f32,
        /// Historygram bin, 0 to 63.
        pub bin: u32,
        /// What the edit in progress changes, `CHANGE_` bits of [`crate::query`].
        pub changes: u32,
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

/// The scene on the device.
pub struct DeviceScene {
    /// Constants of the scene.
    pub frame: Frame,
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
    range: [f64; 2],
    nearest: bool,
    squares: bool,
    float_voxels: bool,
    skip: bool,
    history: bool,
    frame_buffer: wgpu::Buffer,
    volume: wgpu::TextureView,
    volume_bytes: u64,
    optics: wgpu::Buffer,
    scattering: wgpu::Buffer,
    emission: wgpu::Buffer,
    cell_masks: wgpu::Buffer,
    cell_ranges: wgpu::Buffer,
    cell_layers: wgpu::Buffer,
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
        Self::with(gpu, scene, volume, (Bins::uniform(MARK_CLASSES), MAX_SQUARES))
    }

    /// The same with other bins of histories, or with `max_squares` bytes for the volume's squares
    /// of voxels instead of [`MAX_SQUARES`], to compare them.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with(
        gpu: &Gpu,
        scene: &Scene,
        volume: &Volume,
        (bins, max_squares): (Bins, u64),
    ) -> Result<Self> {
        scene.check()?;
        let settings = &scene.settings;
        let majorant = settings
            .majorant
            .ok_or_else(|| Error::setting("the scene has no majorant: settle it first"))?;
        let longest = volume.extent().length();
        if majorant * longest > MAX_COLLISIONS {
            return Err(Error::setting(format!(
                "`majorant` is {majorant} per mm: across {longest} mm collisions come closer than \
                 single precision tells places apart; lower it, or leave it out"
            )));
        }
        let table = Table::build(&scene.materials, volume.range(), Some(majorant));
        let macro_cells = MacroCells::of(volume);
        let cells = CellEntries::of(&macro_cells);
        let local_from_world = volume.local_from_world();
        let lights = Lights::of(scene, &local_from_world)?;
        let spacing = volume.spacing().as_vec3();
        let frame = Frame {
            size: volume.size(),
            seed: hash(settings.seed),
            extent: volume.extent().as_vec3().to_array(),
            gain: volume.gain(),
            per_voxel: spacing.recip().to_array(),
            majorant: majorant as f32,
            cells: macro_cells.counts,
            mark_classes: bins.mark_classes,
            cell_mm: (spacing * CELL_EDGE as f32).to_array(),
            step: spacing.min_element() * settings.step as f32,
            visible_bins: words(bins.opaque_mask(&table)),
            pad: [0; 2],
        };
        let query = Query::default();
        let columns = Columns::of(&table, &bins, &query);
        let cell_values = cells.fold(|e| bins.tentative_bit(e, 0), |a, b| a | b);
        let ranges = cells.ranges.iter().zip(cell_values);
        let range = |(&[low, high], values): (&[u16; 2], u64)| CellRange {
            low: low.into(),
            high: high.into(),
            values: words(values),
        };
        let ranges = ranges.map(range).collect::<Vec<_>>();
        let masks = bins.masks(&cells).into_iter().map(words).collect::<Vec<_>>();
        let nearest = scene.filter == Filter::Nearest;
        let squares = !nearest && bytes_of_squares(volume) <= max_squares;
        let (volume_view, volume_bytes) = upload(gpu, volume, squares)?;
        let device = Self {
            frame_buffer: gpu.upload("frame", &[frame])?,
            optics: gpu.upload("optics", &columns.optics)?,
            scattering: gpu.upload("scattering", &columns.scattering)?,
            emission: gpu.upload("emission", &columns.emission)?,
            cell_masks: gpu.upload("cell masks", &masks)?,
            cell_layers: gpu.buffer::<CellLayers>("cell layers", ranges.len())?,
            cell_ranges: gpu.upload("cell ranges", &ranges)?,
            spans: gpu.upload("layers", &layers_of_spans(&table, &query, frame.majorant))?,
            find_layers: gpu.kernel("layers", &[])?,
            lights_buffer: gpu.upload("lights", &[lights])?,
            volume: volume_view,
            volume_bytes,
            range: volume.range(),
            nearest,
            squares,
            float_voxels: matches!(volume.voxels(), Voxels::F32(_)),
            skip: settings.skip_empty,
            history: settings.history,
            frame,
            local_from_world,
            table,
            bins,
            lights,
            cells,
            opened: query.opened,
        };
        device.find_layers(gpu)?;
        Ok(device)
    }

    /// Finds the layers of marks in each macro-cell.
    fn find_layers(&self, gpu: &Gpu) -> Result<()> {
        let bindings: Bindings = vec![
            ("frame", (&self.frame_buffer).into()),
            ("cell_ranges", (&self.cell_ranges).into()),
            ("spans", (&self.spans).into()),
            ("layers", (&self.cell_layers).into()),
        ];
        let mut stage = gpu.stage("layers");
        stage.dispatch(&self.find_layers, self.cells.ranges.len() as u64, &bindings, &())?;
        stage.finish()
    }

    /// The table of an edited scene, over the same values.
    pub fn table_of(&self, scene: &Scene) -> Table {
        Table::build(&scene.materials, self.range, scene.settings.majorant)
    }

    /// Takes another table and other lights. `query` says what that changes, and what
    /// edits before it changed that are not yet applied.
    ///
    /// # Errors
    /// The device failed.
    pub fn edit(&mut self, gpu: &Gpu, table: Table, lights: Lights, query: &Query) -> Result<()> {
        self.frame.visible_bins = words(self.bins.opaque_mask(&table));
        let columns = Columns::of(&table, &self.bins, query);
        if (&table.extinction, &query.opened) != (&self.table.extinction, &self.opened) {
            gpu.write(&self.spans, &layers_of_spans(&table, query, self.frame.majorant));
            self.find_layers(gpu)?;
            self.opened.clone_from(&query.opened);
        }
        gpu.write(&self.frame_buffer, &[self.frame]);
        gpu.write(&self.optics, &columns.optics);
        gpu.write(&self.scattering, &columns.scattering);
        gpu.write(&self.emission, &columns.emission);
        gpu.write(&self.lights_buffer, &[lights]);
        (self.table, self.lights) = (table, lights);
        Ok(())
    }

    /// Whether kernels compiled for this scene also suit another table.
    pub fn suits(&self, table: &Table) -> bool {
        specialisation(&self.table) == specialisation(table)
    }

    /// The scene's resources, by the names that the kernels give them.
    pub fn bindings(&self) -> Bindings<'_> {
        vec![
            ("frame", (&self.frame_buffer).into()),
            ("volume", (&self.volume).into()),
            ("optics", (&self.optics).into()),
            ("scattering", (&self.scattering).into()),
            ("emission", (&self.emission).into()),
            ("cell_masks", (&self.cell_masks).into()),
            ("cell_layers", (&self.cell_layers).into()),
            ("lights", (&self.lights_buffer).into()),
        ]
    }

    /// The flags of a kernel that this scene sets, among those that it knows.
    pub fn flags(&self, known: &[&'static str]) -> Vec<&'static str> {
        let [anisotropic, emission] = specialisation(&self.table);
        let all = [
            ("nearest", self.nearest),
            ("squares", self.squares),
            ("float_voxels", self.float_voxels),
            ("skip", self.skip),
            ("history", self.history),
            ("anisotropic", anisotropic),
            ("emission", emission),
            ("listed_bins", self.bins != Bins::uniform(self.bins.mark_classes)),
        ];
        all.iter().filter(|(flag, on)| *on && known.contains(flag)).map(|(flag, _)| *flag).collect()
    }

    /// Bytes of the volume and of the macro-cells.
    pub fn bytes(&self) -> Vec<(&'static str, u64)> {
        vec![
            ("volume", self.volume_bytes),
            (
                "macro-cells",
                self.cell_masks.size() + self.cell_ranges.size() + self.cell_layers.size(),
            ),
        ]
    }
}

/// What kernels are specialised for: any anisotropic scattering, any emission.
fn specialisation(table: &Table) -> [bool; 2] {
    [!table.is_isotropic(), table.emission.iter().any(|e| *e != [0.0; 3])]
}

/// The table as the kernels see it.
struct Columns {
    optics: Vec<Optics>,
    scattering: Vec<[f32; 4]>,
    emission: Vec<[f32; 4]>,
}

impl Columns {
    fn of(table: &Table, bins: &Bins, query: &Query) -> Self {
        let optics = |e: usize| Optics {
            extinction: table.extinction[e],
            bin: bins.bin_of_entry[e],
            changes: query.changes[e],
        };
        let scattering = |e: usize| {
            let [r, g, b] = table.albedo(e);
            [r, g, b, table.phase_g[e]]
        };
        Self {
            optics: (0..TABLE_ENTRIES).map(optics).collect(),
            scattering: (0..TABLE_ENTRIES).map(scattering).collect(),
            emission: table.emission.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect(),
        }
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
