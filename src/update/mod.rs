//! The photon map of one scene on the device, and how an edit is applied to it.
//!
//! [`PhotonFrame::edit`] takes an edited scene and notes what that changes;
//! [`PhotonFrame::update`] then computes again what the change touches, and leaves every
//! slot, the light field, the segments and the image as a rebuild from nothing would,
//! bit for bit. A rebuild is an update of which everything was never computed.
//!
//! An edit may change settings, too: what does not depend on them is kept ([`Anew`]).
//!
//! What an edit changes stays noted until an update has come to its end. An update may be
//! abandoned at any boundary of its stages, and another edit made: the next one asks for
//! what either changed, and that is all there is to clean up.

mod anew;
mod edit;
mod memory;
mod warm;

use self::anew::Parts;
use self::memory::Making;
use crate::device_scene::{Context, DeviceScene};
use crate::error::Result;
use crate::field::dirty::Dirty;
use crate::field::{self, Change, LightField, Request};
use crate::gpu::counter::{CounterBuffer, Counters};
use crate::gpu::{Gpu, Progress};
use crate::history::{CHANGE_EMISSION, CHANGE_SCATTERING, Query};
use crate::photon::PhotonMap;
use crate::scene::{Scene, Spatial};
use crate::segment::{Computed, SegmentMap, Sources};
use crate::split::Split;

pub use anew::Anew;
pub use warm::warm;

/// What an edit can reach.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Scope {
    /// Nothing that anybody could see, beside what an update that was abandoned left over.
    Nothing,
    /// What its query finds.
    Part,
    /// Settings changed: some stages are done anew as a whole, beside what its query finds.
    Anew(Anew),
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

impl Updated {
    /// Photons with a flight that was traced again, of all, in percent.
    pub fn retraced_percent(&self) -> f64 {
        100.0 * self.counts.invalid as f64 / self.photons.max(1) as f64
    }

    /// Segments computed again, of all, in percent.
    pub fn recomputed_percent(&self) -> f64 {
        100.0 * self.recomputed as f64 / self.segments.max(1) as f64
    }
}

/// Everything that the photon map of one scene keeps on the device.
pub struct PhotonFrame {
    /// The scene.
    pub scene: DeviceScene,
    /// Its photons.
    pub map: PhotonMap,
    /// Its light field.
    pub field: Box<dyn LightField>,
    /// Its view-ray segments.
    pub segments: SegmentMap,
    source: Scene,
    dirty: Dirty,
    counters: CounterBuffer,
    /// What changed since the last update that came to its end.
    query: Query,
    /// Something changed that the query does not tell.
    pending: bool,
    /// Nothing was ever computed, or an error left it in pieces.
    fresh: bool,
    /// What settings have changed and memory is still to be had for.
    missing: Parts,
}

/// What the query found among the photons.
struct Found {
    /// Photons to be worked on.
    listed: u64,
    /// Some of them have a flight that may be another.
    any_invalid: bool,
}

impl PhotonFrame {
    /// Room for everything; nothing is computed yet.
    ///
    /// # Errors
    /// Memory does not suffice, or the estimator does not suit the scene.
    pub fn new(gpu: &Gpu, scene: &Scene, device: DeviceScene, split: &Split) -> Result<Self> {
        let settings = &scene.settings;
        let estimator = field::estimator(settings, &device.table)?;
        let photons = device.lights.photons.into();
        let making = Making { photons, estimator, parts: Parts::all() };
        memory::check(gpu, &memory::needs(scene, &device, making))?;
        let field = field::new(gpu, &device, settings, split)?;
        Ok(Self {
            dirty: Dirty::new(gpu, &device, field.reach(), settings.spatial)?,
            map: PhotonMap::new(gpu, &device, &light_ids(scene), settings, split)?,
            segments: SegmentMap::new(gpu, scene, &device, &*field, split)?,
            counters: CounterBuffer::new(gpu)?,
            source: scene.clone(),
            query: Query::default(),
            pending: true,
            fresh: true,
            missing: Parts::default(),
            scene: device,
            field,
        })
    }

    /// The scene that was taken last.
    pub fn source(&self) -> &Scene {
        &self.source
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
        self.field.count_anew();
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
        let result = self.frame(gpu, split, progress);
        if result.is_err() {
            (self.fresh, self.pending) = (true, true);
        }
        result
    }

    /// The frame, one line a stage.
    fn frame(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<Updated> {
        let is_rebuild = self.begin(gpu, split)?;
        let mut done = self.nothing_done();
        if self.pending {
            gpu.enter(PHOTONS);
            let found = self.find_photons(gpu, split)?;
            done.listed = found.listed;
            let is_done = self.trace_photons(gpu, &found, split, progress)?;
            if !is_done || progress.stops("light field") {
                return Ok(done);
            }
            gpu.enter(LIGHT_FIELD);
            done.points = self.build_field(gpu, split, progress)?;
            if progress.stops("segments") {
                return Ok(done);
            }
            gpu.enter(SEGMENTS);
            let computed = self.compute_segments(gpu, split, progress)?;
            self.end(gpu, &mut done, computed)?;
            gpu.enter(ELSEWHERE);
        } else {
            done.counts = self.counts(gpu)?;
        }
        done.finished = true;
        if is_rebuild {
            (done.counts.invalid, done.counts.changed) = (done.photons, done.photons);
        }
        Ok(done)
    }

    fn nothing_done(&self) -> Updated {
        Updated {
            photons: self.scene.lights.photons.into(),
            segments: self.segments.count(),
            ..Default::default()
        }
    }

    /// Has memory and kernels that suit the scene. Returns whether everything is to be computed.
    fn begin(&mut self, gpu: &Gpu, split: &Split) -> Result<bool> {
        gpu.restart_phases();
        self.make_missing(gpu, split)?;
        let is_rebuild = self.pending && self.fresh;
        if is_rebuild {
            self.count_anew(gpu)?;
            self.map.arrange(gpu, &self.scene.lights, &light_ids(&self.source))?;
            self.segments.look(&self.source, &self.scene)?;
            self.map.respecialise(gpu, &self.scene)?;
            self.field.respecialise(gpu, &self.scene)?;
            self.segments.respecialise(gpu, &self.scene, &*self.field)?;
            self.restart();
        }
        Ok(is_rebuild)
    }

    /// Lists the photons that are to be traced or weighed again.
    fn find_photons(&mut self, gpu: &Gpu, split: &Split) -> Result<Found> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let scatters = self.query.changes.iter().any(|c| c & CHANGE_SCATTERING != 0);
        let is_blind = self.query.changes.iter().all(|c| c & !CHANGE_EMISSION == 0);
        let mut asked = Vec::new();
        for i in 0..self.map.batches.len() {
            let batch = &mut self.map.batches[i];
            asked.push(!self.fresh && (!is_blind || batch.relit || batch.stale));
            if self.fresh {
                batch.list_all(gpu, split.shuffle)?;
            } else if asked[i] {
                batch.any_altered |= scatters;
                self.map.list(cx, i, self.query.risen, self.field.follows())?;
            } else {
                batch.list.count = 0;
            }
        }
        let batches = self.map.batches.iter_mut().zip(asked).filter(|(_, is)| *is);
        let mut lists = batches.map(|(batch, _)| &mut batch.list).collect::<Vec<_>>();
        let mut any_invalid = false;
        if !lists.is_empty() {
            any_invalid = self.counters.read_with(gpu, &mut lists)?.invalid > 0;
            lists.iter().try_for_each(|list| list.shuffle(gpu, split.shuffle))?;
        }
        let listed = self.map.batches.iter().map(|batch| u64::from(batch.list.count)).sum();
        Ok(Found { listed, any_invalid })
    }

    /// Traces and weighs the photons that were found, part by part, and tells the light field.
    /// Returns false where it was abandoned.
    fn trace_photons(
        &mut self,
        gpu: &Gpu,
        found: &Found,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<bool> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let follows = self.field.follows();
        self.field.begin(&request(&self.query, self.fresh, &self.source, split), found.listed);
        for i in 0..self.map.batches.len() {
            self.map.batches[i].stale |= self.map.batches[i].list.count > 0;
            if self.fresh {
                if progress.stops("photons") {
                    return Ok(false);
                }
                self.map.trace_all(cx, i, progress)?;
                continue;
            }
            for part in self.map.parts(i) {
                if progress.stops("photons") {
                    return Ok(false);
                }
                let is_path_kept = !found.any_invalid && !self.map.batches[i].relit;
                let mut change = Change::Weighed;
                if !is_path_kept || !self.map.weigh(cx, &part, follows, progress)? {
                    change = Change::Traced;
                    self.map.keep(gpu, &part)?;
                    self.map.trace(cx, &part, progress)?;
                    self.map.compare(cx, &part, follows)?;
                }
                self.field.take(cx, &mut self.map, &part, change, progress)?;
            }
        }
        Ok(true)
    }

    /// Brings the light field up to date, and marks where light changed. Returns how many
    /// points changed.
    fn build_field(&mut self, gpu: &Gpu, split: &Split, progress: &mut Progress) -> Result<u64> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let request = request(&self.query, self.fresh, &self.source, split);
        self.field.build(cx, &mut self.map, &request, &self.dirty, progress)
    }

    /// Computes the segments that read what changed or see light that did, and the image.
    fn compute_segments(
        &mut self,
        gpu: &Gpu,
        split: &Split,
        progress: &mut Progress,
    ) -> Result<Computed> {
        let columns = match self.source.settings.spatial {
            // Without a spatial test a segment stands for the photons of its own values, too.
            Spatial::Off => u32::MAX,
            _ => self.field.columns_read(),
        };
        self.dirty.project(gpu, &self.scene)?;
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let from = Sources { field: &*self.field, dirty: &self.dirty };
        let query = self.query.mask(columns, &self.scene.bins);
        self.segments.update(cx, from, query, split, progress)
    }

    /// All is as the scene has it: nothing remains noted.
    fn end(&mut self, gpu: &Gpu, done: &mut Updated, computed: Computed) -> Result<()> {
        done.recomputed = computed.segments;
        done.corrected = computed.corrected;
        done.segments = computed.total;
        done.counts = computed.counts;
        done.points_built = self.field.points_built(&done.counts);
        done.counts.all_fitted()?;
        self.query = Query::default();
        self.field.all_seen();
        self.map.batches.iter_mut().for_each(|b| (b.relit, b.stale) = (false, false));
        (self.fresh, self.pending) = (false, false);
        self.dirty.clear(gpu)
    }

    /// What updates need beside slots and segments.
    pub fn list_bytes(&self) -> ListBytes {
        ListBytes {
            photons: self.map.list_bytes(),
            points: self.field.update_bytes(),
            journal: self.map.journal_bytes(),
            segments: self.segments.list_bytes() + self.dirty.bytes(),
        }
    }
}

fn request<'a>(
    query: &'a Query,
    is_rebuild: bool,
    source: &Scene,
    split: &'a Split,
) -> Request<'a> {
    let asks_for_light = source.settings.spatial != Spatial::Off;
    Request { query, is_rebuild, asks_for_light, split }
}

fn light_ids(scene: &Scene) -> Vec<u32> {
    scene.lights.iter().map(|light| light.id).collect()
}
