//! The `fluence` light field: every flight's power times length, summed on a grid.
//!
//! Sums are 64-bit integers, so they have no order, and what was added can be taken out
//! with nothing left over. A resolve pass turns them into mean fluence for each cell, in
//! the one of two textures that does not hold what was there before, and marks the cells
//! that differ.

use std::ops::Range;
use std::sync::Arc;

use super::dirty::Dirty;
use super::{LightField, Request, Run, SegmentLight};
use crate::bits::CONTRIBUTION;
use crate::device_scene::{Context, DeviceScene};
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::counter::Choice;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::gpu::pace::Pace;
use crate::gpu::queue::Total;
use crate::gpu::resource::Bindings;
use crate::gpu::run::Stage;
use crate::gpu::turns::{Told, When};
use crate::gpu::work::clear_when;
use crate::photon::{Flights, Follows, Part, PhotonMap};
use crate::scene::{Estimator, Settings};

shared_struct! {
    /// What the resolve kernel is told.
    pub struct ResolveParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Fluence for each unit of a sum.
        pub per_sum: f32,
        /// Edge of a cell, mm.
        pub edge: [f32; 3],
        /// 1 where cells that differ are marked.
        pub marks: u32,
    }
}

/// What a deposit does with the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Deposit {
    /// Adds flights.
    Add,
    /// Takes flights out.
    Remove,
    /// Takes flights of the journal out, and adds them with the power that they have now.
    Replace,
}

shared_struct! {
    /// What the deposit kernel is told.
    pub struct DepositParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Scale of the sums.
        pub scale: f32,
        /// Slots of a photon.
        pub max_events: u32,
        /// One of [`Deposit`].
        pub mode: u32,
        /// First item of this dispatch.
        pub first_item: u32,
        /// Items of this dispatch.
        pub items: u32,
        /// Photons that are summed, where none are chosen.
        pub photons: u32,
        /// The first of them.
        pub first_photon: u32,
        /// Photons in the batch.
        pub stride: u32,
        /// 1 where the photons are those chosen of a part, not all.
        pub is_chosen: u32,
        /// 1 where the slots are those of the journal.
        pub in_journal: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
        /// The same.
        pub pad2: u32,
    }
}

shared_struct! {
    /// What is told of how many photons change.
    pub struct ChoiceParams {
        /// Photons in all.
        pub photons: u32,
        /// 1 where a batch has listed its photons, 0 where a part of them was worked on.
        pub lists: u32,
        /// 1 where those were traced, whatever is chosen.
        pub is_traced: u32,
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

shared_struct! {
    /// What a fetch needs to know.
    pub struct FluenceParams {
        /// Cells along each axis.
        pub grid: [u32; 3],
        /// Keeps the size a multiple of 16.
        pub pad: u32,
    }
}

/// The fluence grid.
pub struct Fluence {
    /// Cells along each axis.
    pub grid: [u32; 3],
    scale: f32,
    per_sum: f32,
    edge: [f32; 3],
    /// Whether the sums are those of the slots; else all is summed again.
    /// The device may have chosen since to sum all anew.
    current: bool,
    /// The sums: red, green, blue. Side by side in one buffer they were no faster.
    pub sums: [wgpu::Buffer; 3],
    field: wgpu::Buffer,
    before: wgpu::TextureView,
    view: wgpu::TextureView,
    deposit: Arc<Kernel>,
    choice: Arc<Kernel>,
    resolve: Arc<Kernel>,
    pace: Pace,
    chosen_pace: Pace,
}

fn texture(gpu: &Gpu, grid: [u32; 3]) -> wgpu::Texture {
    let [width, height, depth_or_array_layers] = grid;
    gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("fluence"),
        size: wgpu::Extent3d { width, height, depth_or_array_layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format: wgpu::TextureFormat::Rgba32Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::STORAGE_BINDING,
        view_formats: &[],
    })
}

/// Cells along each axis, for so many voxels and cells for each.
pub fn cells(size: [u32; 3], per_voxel: f64) -> [u32; 3] {
    size.map(|n| ((f64::from(n) * per_voxel).round() as u32).max(1))
}

impl Fluence {
    /// An empty grid for a scene.
    ///
    /// # Errors
    /// The grid does not fit the adapter.
    pub fn new(gpu: &Gpu, scene: &DeviceScene, settings: &Settings) -> Result<Self> {
        let grid = cells(scene.params.size, settings.grid);
        let cells: u64 = grid.iter().map(|&n| u64::from(n)).product();
        let bytes = cells * 8;
        gpu.fits("fluence grid", bytes).map_err(|_| {
            Error::capacity(
                "fluence grid",
                format!(
                    "{}x{}x{} cells take {bytes} bytes a channel, and the adapter binds {}; lower \
                     `grid` (now {})",
                    grid[0],
                    grid[1],
                    grid[2],
                    gpu.max_binding(),
                    settings.grid
                ),
            )
        })?;
        let extent = scene.params.extent;
        let edge: [f64; 3] = std::array::from_fn(|i| f64::from(extent[i]) / f64::from(grid[i]));
        let typical = settings.flux_unit.unwrap_or(1.0) / settings.photons as f64
            * edge.iter().copied().fold(f64::INFINITY, f64::min);
        let scale = CONTRIBUTION / typical;
        let textures = [texture(gpu, grid), texture(gpu, grid)];
        gpu.check("fluence grid")?;
        let [before, view] = textures.map(|t| t.create_view(&Default::default()));
        let sum = || gpu.buffer::<u64>("fluence sums", cells as usize);
        Ok(Self {
            grid,
            scale: scale as f32,
            per_sum: (1.0 / (scale * edge.iter().product::<f64>())) as f32,
            edge: edge.map(|e| e as f32),
            current: false,
            sums: [sum()?, sum()?, sum()?],
            field: gpu.upload("fluence field", &[FluenceParams { grid, pad: 0 }])?,
            before,
            view,
            deposit: gpu.kernel("deposit", &[])?,
            choice: gpu.kernel("deposit_choice", &[])?,
            resolve: gpu.kernel("resolve", &[])?,
            pace: Pace::new(gpu, 1 << 17),
            chosen_pace: Pace::new(gpu, 1 << 18),
        })
    }

    /// Sums the flights of all photons, from nothing; or only where that was chosen.
    fn sum_all(
        &self,
        cx: Context,
        map: &PhotonMap,
        when: Option<&When>,
        progress: &mut Progress,
    ) -> Result<()> {
        let mut stage = cx.gpu.stage("deposit");
        for sum in &self.sums {
            match when {
                Some(when) => clear_when(&mut stage, sum, when)?,
                None => stage.clear(sum),
            }
        }
        stage.finish()?;
        for batch in &map.batches {
            let slots = batch.photons * map.max_events;
            let total = match when {
                Some(when) => Total::Told(Told::known(slots, when.clone())),
                None => Total::Known(slots.into()),
            };
            let flights = map.flights(batch, 0..batch.photons);
            self.deposit(cx, &flights, Deposit::Add, total, progress)?;
        }
        let mut stage = cx.gpu.stage("deposit");
        cx.counters.unchoose(&mut stage, &[Choice::Anew]);
        stage.finish()
    }

    /// Adds so many flights to the sums, or takes them out.
    ///
    /// # Errors
    /// The device failed.
    pub fn deposit(
        &self,
        cx: Context,
        flights: &Flights,
        mode: Deposit,
        total: Total,
        progress: &mut Progress,
    ) -> Result<()> {
        let own = flights.bindings.clone();
        let mut bindings = [cx.scene.bindings(), own, self.sum_bindings()].concat();
        bindings.push(("counters", cx.counters.buffer().into()));
        let all = DepositParams {
            grid: self.grid,
            scale: self.scale,
            max_events: flights.max_events,
            mode: mode as u32,
            photons: flights.photons.len() as u32,
            first_photon: flights.photons.start,
            stride: flights.stride,
            in_journal: flights.in_journal.into(),
            is_chosen: flights.chosen.is_some().into(),
            ..Default::default()
        };
        let kernel = self.deposit.clone();
        let work = move |stage: &mut Stage, range: Range<u64>| {
            let items = range.end - range.start;
            let params =
                DepositParams { first_item: range.start as u32, items: items as u32, ..all };
            stage.dispatch(&kernel, items, &bindings, &params)
        };
        // Fewer of the chosen photons' slots are empty.
        let pace = if flights.chosen.is_some() { &self.chosen_pace } else { &self.pace };
        cx.gpu.sliced("deposit", total, pace, work, progress)
    }

    /// Tells the device's choice of a list that there is, or of a part that was worked on.
    fn tell_choice(&self, cx: Context, lengths: &wgpu::Buffer, params: ChoiceParams) -> Result<()> {
        let photons = cx.scene.lights.photons;
        let bindings = [("lengths", lengths.into()), ("counters", cx.counters.buffer().into())];
        let mut stage = cx.gpu.stage("deposit_choice");
        stage.dispatch(&self.choice, 1, &bindings, &ChoiceParams { photons, ..params })?;
        stage.finish()
    }

    /// Turns sums into fluence, and marks the cells that differ from before, if anybody `asks`.
    fn resolve(&mut self, cx: Context, dirty: &Dirty, asks: bool) -> Result<()> {
        let is_far = dirty.is_far(self.edge.map(|edge| 2.0 * edge));
        if asks && is_far {
            dirty.mark_all(cx.gpu)?;
        }
        std::mem::swap(&mut self.before, &mut self.view);
        let mut stage = cx.gpu.stage("resolve");
        let cells = self.grid.iter().map(|&n| u64::from(n)).product();
        let (grid, per_sum, edge) = (self.grid, self.per_sum, self.edge);
        let mut bindings = [self.sum_bindings(), dirty.bindings()].concat();
        bindings.extend([("before", (&self.before).into()), ("fluence", (&self.view).into())]);
        bindings.push(("counters", cx.counters.buffer().into()));
        let params = ResolveParams { grid, per_sum, edge, marks: (asks && !is_far).into() };
        stage.dispatch(&self.resolve, cells, &bindings, &params)?;
        stage.finish()
    }

    /// Whether the sums are those of the slots, unless the device chose otherwise ([`Choice::Anew`]);
    /// else all is to be summed again.
    pub fn is_current(&self) -> bool {
        self.current
    }

    /// The sums as they are: red, green, blue.
    ///
    /// # Errors
    /// The device failed.
    pub fn read(&self, gpu: &Gpu) -> Result<[Vec<u64>; 3]> {
        let [r, g, b] = &self.sums;
        let read = |sum| gpu.read("fluence sums", sum);
        Ok([read(r)?, read(g)?, read(b)?])
    }

    fn sum_bindings(&self) -> Bindings {
        let [r, g, b] = &self.sums;
        vec![("red", r.into()), ("green", g.into()), ("blue", b.into())]
    }
}

impl LightField for Fluence {
    fn name(&self) -> &'static str {
        "fluence"
    }

    fn estimator(&self) -> Estimator {
        Estimator::Fluence
    }

    fn follows(&self) -> Follows {
        Follows::Photons
    }

    fn withdraw(&mut self, cx: Context, flights: &Flights) -> Result<()> {
        // Sums that are not current begin anew.
        if !self.current {
            return Ok(());
        }
        let slots = flights.photons.len() as u64 * u64::from(flights.max_events);
        let progress = &mut Progress::silent();
        self.deposit(cx, flights, Deposit::Remove, Total::Known(slots), progress)
    }

    fn begin(&mut self, cx: Context, map: &PhotonMap, request: &Request) -> Result<()> {
        self.current &= !request.is_rebuild;
        if !self.current {
            return Ok(());
        }
        let mut stage = cx.gpu.stage("deposit_choice");
        cx.counters.unchoose(&mut stage, &[Choice::Listed, Choice::Seen, Choice::Moved]);
        stage.finish()?;
        for batch in map.batches.iter().filter(|batch| batch.is_listed) {
            let told = ChoiceParams { lists: 1, ..Default::default() };
            self.tell_choice(cx, &batch.list.items, told)?;
        }
        Ok(())
    }

    /// Old flights leave the sums, new ones come to them; or, where they are many, all is summed anew
    /// in the end.
    fn take(
        &mut self,
        cx: Context,
        map: &PhotonMap,
        part: &Part,
        progress: &mut Progress,
    ) -> Result<()> {
        if !self.current {
            return Ok(());
        }
        map.choose(cx.gpu, part)?;
        let (chosen, old) = (map.chosen_flights(part), map.journaled_flights(part));
        let relit = map.batches[part.batch].is_relit();
        let told = ChoiceParams { is_traced: relit.into(), ..Default::default() };
        self.tell_choice(cx, map.chosen(), told)?;
        let mut deposit = |flights: Flights, mode, some: &[Choice], none: &[Choice]| {
            let flights = flights.when(cx.counters.when(some, none));
            let Some(told) = flights.chosen.clone() else { return Ok(()) };
            self.deposit(cx, &flights, mode, Total::Told(told), progress)
        };
        let lost = [Choice::Invalid, Choice::Woken];
        if !relit {
            let none = [Choice::Invalid, Choice::Woken, Choice::Anew];
            deposit(old.clone(), Deposit::Replace, &[], &none)?;
        }
        let some = if relit { &[][..] } else { &lost };
        deposit(old, Deposit::Remove, some, &[Choice::Anew])?;
        deposit(chosen, Deposit::Add, some, &[Choice::Anew])
    }

    fn build(
        &mut self,
        cx: Context,
        map: &mut PhotonMap,
        request: &Request,
        dirty: &Dirty,
        _learned: &[u32],
        progress: &mut Progress,
    ) -> Result<u64> {
        let when = cx.counters.when(&[Choice::Anew], &[]);
        self.sum_all(cx, map, Some(&when).filter(|_| self.current), progress)?;
        self.current = true;
        // All segments of a rebuild are computed, whatever is marked.
        self.resolve(cx, dirty, !request.is_rebuild)?;
        Ok(0)
    }

    fn remedy(&self) -> &'static str {
        "change `grid`"
    }

    fn columns_read(&self) -> u32 {
        u32::MAX
    }

    fn segment_light(&self) -> SegmentLight {
        SegmentLight::Colour
    }

    fn segment_flags(&self) -> Vec<&'static str> {
        vec!["fluence"]
    }

    /// The resolved field, by the names that the segment kernel gives it.
    fn runs(&self) -> Vec<Run> {
        let bindings = vec![("field", (&self.field).into()), ("fluence", (&self.view).into())];
        vec![Run { bindings, points: 0 }]
    }

    fn grid(&self) -> Option<[u32; 3]> {
        Some(self.grid)
    }

    fn bytes(&self) -> u64 {
        // Both textures have 16 bytes a cell, the sums 8 a channel.
        self.sums.iter().map(wgpu::Buffer::size).sum::<u64>() + self.sums[0].size() * 4
    }

    fn differing(&self, gpu: &Gpu, other: &dyn LightField) -> Result<u64> {
        let Some(other) = other.fluence() else { return Ok(u64::MAX) };
        let (own, others) = (self.read(gpu)?, other.read(gpu)?);
        let of_channel = |(a, b): (&Vec<u64>, &Vec<u64>)| {
            let pairs = a.iter().zip(b).filter(|(a, b)| a != b).count();
            (pairs + a.len().abs_diff(b.len())) as u64
        };
        Ok(own.iter().zip(&others).map(of_channel).max().unwrap_or(0))
    }

    fn fluence(&self) -> Option<&Fluence> {
        Some(self)
    }
}

/// Why a grid of fluence cannot be.
pub(super) fn not_isotropic() -> Error {
    Error::setting(
        "the `fluence` estimator knows isotropic scattering only, and a material has phase_g other \
         than 0: use `estimator = \"points\"`",
    )
}
