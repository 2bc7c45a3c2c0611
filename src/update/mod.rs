//! The photon map of one scene on the device, and how an edit is applied to it.
//!
//! [`PhotonFrame::edit`] takes an edited scene and notes what that changes;
//! [`PhotonFrame::update`] then computes again what the change touches, and leaves every
//! slot, the light field, the segments and the image as a rebuild from nothing would,
//! bit for bit. A rebuild is an update of which everything was never computed.
//!
//! What an edit changes stays noted until an update has come to its end. An update may be
//! abandoned at any boundary of its stages, and another edit made: the next one asks for
//! what either changed, and that is all there is to clean up.

mod edit;

use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::field::LightField;
use crate::field::dirty::Dirty;
use crate::field::fluence::Fluence;
use crate::field::points::Points;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::gpu::counter::{CounterBuffer, Counters};
use crate::history::{CHANGE_EMISSION, CHANGE_FALLEN, CHANGE_RISEN, CHANGE_SCATTERING, Query};
use crate::photon::{PhotonMap, PhotonParams};
use crate::scene::{Estimator, Scene, Settings, Spatial, Weighting};
use crate::segment::{SegmentMap, SegmentStage};
use crate::split::Split;

/// What an edit can reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Scope {
    /// Nothing that anybody could see, beside what an update that was abandoned left over.
    Nothing,
    /// What its query finds.
    Part,
    /// Everything, and why.
    Everything(&'static str),
}

/// Bytes that updates need beside slots and segments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ListBytes {
    /// Tasks and work lists of photons.
    pub photons: u64,
    /// What bringing points up to date takes while an update runs, at most.
    pub points: u64,
    /// Old slots of the photons that are worked on.
    pub journal: u64,
    /// Work lists of segments, and marks of changed light.
    pub segments: u64,
}

/// Time in the kernels of an update, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Phases {
    /// Finding, tracing and weighing photons, and moving their flights in the fluence.
    pub photons: f64,
    /// Bringing the light field up to date.
    pub light_field: f64,
    /// Finding and computing segments, and the image.
    pub segments: f64,
}

impl Phases {
    /// What the last update took on this device, all work being done.
    ///
    /// # Errors
    /// The device failed.
    pub fn of_last(gpu: &Gpu) -> Result<Self> {
        let took = gpu.phase_ms()?;
        Ok(Self {
            photons: took[PHOTONS],
            light_field: took[LIGHT_FIELD],
            segments: took[SEGMENTS],
        })
    }
}

// What the device's clock sums the times of an update by.
const ELSEWHERE: usize = 0;
const PHOTONS: usize = 1;
const LIGHT_FIELD: usize = 2;
const SEGMENTS: usize = 3;

/// What an update did.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Updated {
    /// Whether it came to its end; else it was abandoned.
    pub finished: bool,
    /// Photons in all.
    pub photons: u64,
    /// Photons that were traced or weighed again.
    pub listed: u64,
    /// Points whose light changed, those that went and those that came among them; 0 where
    /// segments do not ask for light.
    pub points: u64,
    /// Means, lights and places in the table that points were given, each on its own; those found
    /// again and the same count, too.
    pub points_built: u64,
    /// Segments computed again.
    pub recomputed: u64,
    /// Of them, those whose light alone was corrected by the points that changed.
    pub corrected: u64,
    /// Segments in all.
    pub segments: u64,
    /// What the stages counted, from the edit on. A rebuild compares nothing: all its photons
    /// count as invalid and as changed.
    pub counts: Counters,
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
    /// The light field, with its weighting.
    pub estimator: &'static str,
    source: Scene,
    dirty: Dirty,
    counters: CounterBuffer,
    /// What changed since the last update that came to its end.
    query: Query,
    /// Something changed that the query does not tell.
    pending: bool,
    /// Nothing was ever computed, or an error left it in pieces.
    fresh: bool,
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
        let (field, estimator, dirty) = light_field(gpu, &device, settings, split)?;
        let map = PhotonMap::new(gpu, &device, &light_ids(scene), settings, split)?;
        let segments = SegmentMap::new(gpu, scene, &device, &field, rays, split)?;
        Ok(Self {
            dirty,
            counters: CounterBuffer::new(gpu)?,
            source: scene.clone(),
            query: Query::default(),
            pending: true,
            fresh: true,
            scene: device,
            map,
            field,
            segments,
            estimator,
        })
    }

    /// Computes everything: an edit that touches everything.
    ///
    /// # Errors
    /// The device failed.
    pub fn rebuild(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<Updated> {
        (self.fresh, self.pending) = (true, true);
        self.update(gpu, split, progress)
    }

    /// Begins to count, as an edit or a rebuild begins.
    fn count_anew(&mut self, gpu: &Gpu) -> Result<()> {
        if let LightField::Points(points) = &mut self.field {
            points.built = 0;
        }
        self.counters.clear(gpu)
    }

    /// What the stages counted since the last edit or rebuild began.
    ///
    /// # Errors
    /// The device failed.
    pub fn counts(&self, gpu: &Gpu) -> Result<Counters> {
        self.counters.read(gpu)
    }

    /// Computes what edits have touched since the last update that came to its end, unless
    /// `progress` has it abandoned on the way.
    ///
    /// # Errors
    /// The device failed; the next update rebuilds everything.
    pub fn update(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<Updated> {
        let result = self.stages(gpu, split, progress);
        if result.is_err() {
            (self.fresh, self.pending) = (true, true);
        }
        result
    }

    fn stages(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<Updated> {
        let mut done = Updated {
            photons: self.scene.lights.photons.into(),
            segments: self.segments.count(),
            ..Default::default()
        };
        let rebuilds = self.pending && self.fresh;
        gpu.restart_phases();
        if self.pending {
            if rebuilds {
                self.count_anew(gpu)?;
                self.suit(gpu)?;
                self.restart();
            }
            gpu.enter(PHOTONS);
            let found = self.list_photons(gpu, split)?;
            done.listed = self.map.batches.iter().map(|batch| u64::from(batch.list.count)).sum();
            if !self.photons(gpu, (done.listed, found), progress)? || progress.stops("light field")
            {
                return Ok(done);
            }
            gpu.enter(LIGHT_FIELD);
            done.points = self.light_field(gpu, split, progress)?;
            if progress.stops("segments") {
                return Ok(done);
            }
            gpu.enter(SEGMENTS);
            let (segments, counts) = self.view(gpu, split, progress)?;
            ([done.recomputed, done.corrected, done.segments], done.counts) = (segments, counts);
            if let LightField::Points(points) = &self.field {
                done.points_built = points.built + done.counts.refreshed;
            }
            done.counts.all_fitted()?;
            self.settle(gpu)?;
            gpu.enter(ELSEWHERE);
        } else {
            done.counts = self.counts(gpu)?;
        }
        done.finished = true;
        if rebuilds {
            (done.counts.invalid, done.counts.changed) = (done.photons, done.photons);
        }
        Ok(done)
    }

    /// Has batches for every light, the view and the kernels that suit the scene: an edit may have
    /// failed before it saw to them.
    fn suit(&mut self, gpu: &Gpu) -> Result<()> {
        self.map.arrange(gpu, &self.scene.lights, &light_ids(&self.source))?;
        self.segments.look(&self.source, &self.scene)?;
        self.map.respecialise(gpu, &self.scene)?;
        if let LightField::Points(points) = &mut self.field {
            points.respecialise(gpu, &self.scene)?;
        }
        self.segments.respecialise(gpu, &self.scene, &self.field)
    }

    /// Lists the photons that are to be traced or weighed again; returns what that counted.
    fn list_photons(&mut self, gpu: &Gpu, split: &Split) -> Result<Counters> {
        let mut queried = Vec::new();
        let points = matches!(self.field, LightField::Points(_));
        let scatters = self.query.changes.iter().any(|c| c & CHANGE_SCATTERING != 0);
        let blind = self.query.changes.iter().all(|c| c & !CHANGE_EMISSION == 0);
        for i in 0..self.map.batches.len() {
            let batch = &mut self.map.batches[i];
            queried.push(!self.fresh && (!blind || batch.relit || batch.stale));
            match (self.fresh, queried[i]) {
                (true, _) => batch.list_all(gpu, split.shuffle)?,
                (_, true) => {
                    batch.any_relit |= scatters;
                    let asked = (i, self.query.risen, points);
                    self.map.list(gpu, &self.scene, &self.counters, asked)?;
                }
                _ => batch.list.count = 0,
            }
        }
        let batches = self.map.batches.iter_mut().zip(queried).filter(|(_, is)| *is);
        let mut lists = batches.map(|(batch, _)| &mut batch.list).collect::<Vec<_>>();
        if lists.is_empty() {
            return Ok(Counters::default());
        }
        let found = self.counters.read_with(gpu, &mut lists)?;
        lists.iter().try_for_each(|list| list.shuffle(gpu, split.shuffle))?;
        Ok(found)
    }

    /// Traces and weighs the photons that were `found` and listed. Flights that changed leave the
    /// fluence and come back to it part by part, or, where they are many, all is summed anew in
    /// the end.
    fn photons(
        &mut self,
        gpu: &Gpu,
        (listed, found): (u64, Counters),
        progress: &mut Progress,
    ) -> Result<bool> {
        if let LightField::Fluence(fluence) = &mut self.field {
            fluence.current &= !self.fresh;
        }
        let (mut seen, mut changed, mut known) = (0, 0, found);
        for i in 0..self.map.batches.len() {
            let count = self.map.batches[i].list.count;
            self.map.batches[i].stale |= count > 0;
            if self.fresh {
                if progress.stops("photons") {
                    return Ok(false);
                }
                let batch = &self.map.batches[i];
                let all = (batch, 0..count, false);
                self.map.trace(gpu, &self.scene, &self.counters, all, progress)?;
                continue;
            }
            for part in self.map.parts(&self.map.batches[i]) {
                let batch = &self.map.batches[i];
                if progress.stops("photons") {
                    return Ok(false);
                }
                let (scene, counters) = (&self.scene, &self.counters);
                let points = matches!(self.field, LightField::Points(_));
                let again = (batch, &part, points);
                let weighed = found.invalid == 0
                    && !batch.relit
                    && self.map.weigh(gpu, scene, counters, again, progress)?;
                if !weighed {
                    self.map.copy(gpu, batch, &part, 1)?;
                    let again = (batch, part.clone(), true);
                    self.map.trace(gpu, scene, counters, again, progress)?;
                    self.map.compare(gpu, batch, (&part, points), counters)?;
                }
                match &mut self.field {
                    LightField::Points(_) => {
                        let (after, batch) = (self.counters.read(gpu)?, &mut self.map.batches[i]);
                        batch.any_moved |= after.moved > known.moved;
                        batch.any_relit |= after.repowered > known.repowered;
                        known = after;
                    }
                    LightField::Fluence(fluence) if fluence.current => {
                        let chosen = self.map.choose(gpu, i, &part)?;
                        // As many of the others will change as of those that were seen.
                        seen += u64::from(part.end - part.start);
                        changed += u64::from(chosen.listed);
                        let photons = u64::from(self.scene.lights.photons);
                        fluence.current = weighed || 2 * changed * listed <= photons * seen;
                        if fluence.current {
                            self.move_flights(gpu, (i, chosen, weighed), progress)?;
                        }
                    }
                    LightField::Fluence(_) => {}
                }
            }
        }
        Ok(true)
    }

    /// Takes the old flights of the chosen photons of a batch out of the fluence, and adds the
    /// new ones: at once where they are the same but for their power (`weighed`).
    fn move_flights(
        &self,
        gpu: &Gpu,
        (batch, chosen, weighed): (usize, PhotonParams, bool),
        progress: &mut Progress,
    ) -> Result<()> {
        let LightField::Fluence(fluence) = &self.field else { return Ok(()) };
        let batch = &self.map.batches[batch];
        let sign = if weighed { 0 } else { -1 };
        let old = (PhotonParams { sign, ..chosen }, self.map.journal_bindings(batch));
        fluence.deposit(gpu, &self.scene, old, &self.counters, progress)?;
        if weighed {
            return Ok(());
        }
        let new = (PhotonParams { journal: 0, ..chosen }, self.map.live_bindings(batch));
        fluence.deposit(gpu, &self.scene, new, &self.counters, progress)
    }

    /// Brings the light field up to date, and marks where light changed. Returns how many
    /// points changed.
    fn light_field(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<u64> {
        match &mut self.field {
            LightField::Points(points) => {
                if self.fresh {
                    points.forget();
                }
                let with = (&self.query, split, &self.counters);
                points.build(gpu, &self.scene, &mut self.map, with, progress)?;
                if self.fresh {
                    points.ignore();
                    return Ok(points.count());
                }
                if self.source.settings.spatial == Spatial::Off {
                    points.ignore();
                    return Ok(0);
                }
                points.compare(gpu, &self.dirty, &self.counters)
            }
            LightField::Fluence(fluence) => {
                if !fluence.current {
                    let map = &mut self.map;
                    fluence.sum_all(gpu, &self.scene, map, &self.counters, progress)?;
                }
                // All segments of a rebuild are computed, whatever is marked.
                let dirty = (&self.dirty, !self.fresh);
                fluence.resolve(gpu, dirty, &self.counters).map(|()| 0)
            }
        }
    }

    /// Computes the segments that read what changed or see light that did, and the image.
    /// Returns what [`SegmentMap::update`] does.
    fn view(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<([u64; 3], Counters)> {
        let read = match self.field {
            LightField::Points(_) if self.source.settings.spatial != Spatial::Off => {
                CHANGE_RISEN | CHANGE_FALLEN | CHANGE_EMISSION
            }
            // Without a spatial test a segment stands for the photons of its own values, too.
            _ => u32::MAX,
        };
        self.dirty.project(gpu, &self.scene)?;
        let stage = SegmentStage {
            gpu,
            device: &self.scene,
            field: &self.field,
            dirty: &self.dirty,
            counters: &self.counters,
        };
        let query = self.query.mask(read, &self.scene.bins);
        self.segments.update(&stage, query, split, progress)
    }

    /// All is as the scene has it: nothing remains noted.
    fn settle(&mut self, gpu: &Gpu) -> Result<()> {
        self.query = Query::default();
        if let LightField::Points(points) = &mut self.field {
            points.settle();
        }
        self.map.batches.iter_mut().for_each(|b| (b.relit, b.stale) = (false, false));
        (self.fresh, self.pending) = (false, false);
        self.dirty.clear(gpu)
    }

    /// What updates need beside slots and segments.
    pub fn list_bytes(&self) -> ListBytes {
        ListBytes {
            photons: self.map.list_bytes(),
            points: match &self.field {
                LightField::Points(points) => points.update_bytes(),
                LightField::Fluence(_) => 0,
            },
            journal: self.map.journal_bytes(),
            segments: self.segments.list_bytes() + self.dirty.bytes(),
        }
    }
}

/// An empty light field, its name, and the marks of where it changes.
fn light_field(
    gpu: &Gpu,
    device: &DeviceScene,
    settings: &Settings,
    split: &Split,
) -> Result<(LightField, &'static str, Dirty)> {
    let chosen = settings.estimator.unwrap_or(match device.table.is_isotropic() {
        true => Estimator::Fluence,
        false => Estimator::Points,
    });
    suits(chosen, device)?;
    let (field, name, reach) = match chosen {
        Estimator::Fluence => {
            let fluence = Box::new(Fluence::new(gpu, device, settings)?);
            (LightField::Fluence(fluence), "fluence", 0.0)
        }
        Estimator::Points => {
            let spacing = device.frame.per_voxel.map(|n| 1.0 / f64::from(n));
            let smallest = spacing.iter().copied().fold(f64::INFINITY, f64::min);
            let radius = settings.radius.unwrap_or(smallest);
            let name = match settings.weighting {
                Weighting::Plain => "points plain",
                Weighting::Even => "points even",
            };
            let points = Box::new(Points::new(gpu, device, (settings, radius), split)?);
            (LightField::Points(points), name, radius as f32)
        }
    };
    Ok((field, name, Dirty::new(gpu, device, reach, settings.spatial)?))
}

fn light_ids(scene: &Scene) -> Vec<u32> {
    scene.lights.iter().map(|light| light.id).collect()
}

fn not_isotropic() -> Error {
    Error::setting(
        "the `fluence` estimator knows isotropic scattering only, and a material has phase_g other \
         than 0: use `estimator = \"points\"`",
    )
}

fn suits(estimator: Estimator, device: &DeviceScene) -> Result<()> {
    match estimator {
        Estimator::Fluence if !device.table.is_isotropic() => Err(not_isotropic()),
        _ => Ok(()),
    }
}
