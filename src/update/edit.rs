//! How an edited scene is taken: what differs is noted, for the next update to find what that
//! touches; what does not depend on other settings is kept.

use std::ops::Range;

use super::anew::{Anew, Parts};
use super::memory::{self, Making};
use super::{PhotonFrame, Scope, light_ids};
use crate::device_scene::Context;
use crate::device_scene::lights::{Light, Lights};
use crate::error::{Error, Result};
use crate::field;
use crate::field::dirty::Dirty;
use crate::gpu::Gpu;
use crate::history::Query;
use crate::photon::PhotonMap;
use crate::scene::Scene;
use crate::segment::SegmentMap;
use crate::split::Split;
use crate::transfer::Table;

impl PhotonFrame {
    /// Takes an edited scene; an update must follow. All but volume, filter and method may differ
    /// from what is shown. Where an edit raises extinction above the majorant, or names values
    /// beyond the table's domain, these grow, and all photons are traced anew.
    ///
    /// # Errors
    /// Something differs that cannot, the scene is an impossible one, or the estimator does not suit
    /// it: nothing has happened then. Memory does not suffice or the device failed: the next update
    /// rebuilds everything.
    pub fn edit(&mut self, gpu: &Gpu, scene: &Scene, split: &Split) -> Result<Scope> {
        scene.check()?;
        self.abandon(gpu, split)?;
        if !self.source.settings.history {
            return Err(Error::setting("without histories (`history`) no edit can be applied"));
        }
        if (&scene.volume, scene.filter, scene.settings.method)
            != (&self.source.volume, self.source.filter, self.source.settings.method)
        {
            return Err(Error::setting(
                "an edit cannot change volume, filter or method: render anew",
            ));
        }
        let table = self.scene.table_of(scene)?;
        let estimators = [self.field.estimator(), field::estimator(&scene.settings, &table)?];
        let mut parts = Parts::between(&self.source, scene, estimators);
        if !self.scene.collides_as(scene)? {
            (parts.constants, parts.paths) = (true, true);
        }
        let lights = Lights::of(scene, &self.scene.local_from_world)?;
        scene.camera.rays(&self.scene.local_from_world)?;
        // What the frame has stays until the new is there.
        let parts_to_make = self.missing.and(parts);
        let photons = self.photons_to_make(scene, &lights, parts_to_make);
        let making = Making { photons, estimator: estimators[1], parts: parts_to_make };
        if parts_to_make.any() {
            self.groups.clear();
            gpu.forget_idle();
        }
        memory::check(gpu, &memory::needs(scene, &self.scene, making))?;
        let result = self.apply(gpu, scene, table, lights, parts, split);
        if result.is_err() {
            (self.fresh, self.pending) = (true, true);
        }
        result
    }

    fn apply(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        table: Table,
        lights: Lights,
        parts: Parts,
        split: &Split,
    ) -> Result<Scope> {
        self.count_anew(gpu)?;
        self.missing = self.missing.and(parts);
        let suits = self.scene.suits(&table);
        let mut change = Query::default();
        let mut relit = false;
        if !parts.paths {
            let (bins, majorant) = (&self.scene.bins, self.scene.params.majorant);
            change = Query::between(&self.scene.table, &table, bins, majorant);
            relit = self.relight(gpu, scene, &lights)?;
        }
        if relit {
            // Photons of lights that are gone go, too.
            self.groups.clear();
        }
        self.query.add(&change);
        if parts.constants {
            self.scene.configure(gpu, scene, table, lights, &self.query)?;
        } else {
            self.scene.edit(gpu, table, lights, &self.query)?;
        }
        let repainted = scene.background != self.source.background;
        let respaced = scene.settings.spatial != self.source.settings.spatial;
        self.source = scene.clone();
        if parts.paths || !suits {
            self.restart();
        }
        self.make_missing(gpu, split)?;
        self.map.arrange(gpu, &self.scene.lights, &light_ids(&self.source), false)?;
        let moved = self.segments.look(&self.source, &self.scene)?;
        if parts.dirty || respaced {
            self.segments.restart();
        }
        if parts.any() {
            self.pending = true;
            return Ok(Scope::Anew(if self.fresh { Anew::EVERYTHING } else { parts.report() }));
        }
        if !suits {
            return Ok(Scope::Everything(
                "the scene is the first or the last with emission or anisotropic scattering: \
                 other kernels",
            ));
        }
        if self.fresh {
            return Ok(Scope::Everything(
                "most photons begin elsewhere, or nothing is computed yet",
            ));
        }
        let touched = relit || moved || repainted || !change.is_empty();
        self.pending |= touched;
        Ok(if touched { Scope::Part } else { Scope::Nothing })
    }

    /// Photons that there are no slots for yet.
    fn photons_to_make(&self, scene: &Scene, lights: &Lights, parts: Parts) -> u64 {
        let has = |id: u32, photons: u32| !parts.slots && self.map.has(id, photons);
        let all = scene.lights.iter().zip(&lights.all);
        all.filter(|(light, record)| !has(light.id, record.photons))
            .map(|(_, record)| u64::from(record.photons))
            .sum()
    }

    /// Has room for what other settings need. What cannot be had stays missing.
    pub(super) fn make_missing(&mut self, gpu: &Gpu, split: &Split) -> Result<()> {
        let (scene, settings) = (&self.source, &self.source.settings);
        if self.missing.slots {
            self.map = PhotonMap::new(gpu, &self.scene, &light_ids(scene), settings, split)?;
            (self.missing.slots, self.fresh, self.pending) = (false, true, true);
        }
        if self.missing.field {
            self.field = field::new(gpu, &self.scene, settings, split)?;
            self.missing.field = false;
        }
        if self.missing.dirty {
            self.dirty = Dirty::new(gpu, &self.scene, self.field.reach(), settings.spatial)?;
            self.missing.dirty = false;
        }
        if self.missing.bands {
            self.segments = SegmentMap::new(gpu, scene, &self.scene, &*self.field, split)?;
            self.missing.bands = false;
        }
        self.missing = Parts::default();
        Ok(())
    }

    /// Applies edits of lights: the photons of those that moved or went are withdrawn, of
    /// those that only shine otherwise noted. Where most would be withdrawn, all is computed
    /// anew. Returns whether any light changed.
    fn relight(&mut self, gpu: &Gpu, scene: &Scene, lights: &Lights) -> Result<bool> {
        let before = self.scene.lights;
        let ids = light_ids(&self.source);
        let mut changed = light_ids(scene) != ids;
        let mut withdrawn = Vec::new();
        for (id, old) in ids.iter().zip(&before.all) {
            let at = scene.lights.iter().position(|light| light.id == *id);
            let new = at.map(|at| lights.all[at]);
            let stays = new.filter(|new| {
                let same_place = Light { radiance: old.radiance, ..*new };
                same_place == *old
            });
            changed |= new != Some(*old);
            for (i, batch) in self.map.batches.iter_mut().enumerate() {
                let own =
                    batch.quotas.iter_mut().filter(|q| q.light.is_some() && q.light_id == *id);
                for quota in own {
                    match stays {
                        Some(new) => quota.relit |= new.radiance != old.radiance,
                        None => withdrawn.push((i, quota.photons.clone())),
                    }
                }
            }
        }
        if self.fresh {
            return Ok(changed);
        }
        let photons = withdrawn.iter().map(|(_, photons)| photons.len() as u64);
        match 2 * photons.sum::<u64>() > u64::from(before.photons) {
            true => self.restart(),
            false => withdrawn.into_iter().try_for_each(|(i, of)| self.withdraw(gpu, i, of))?,
        }
        Ok(changed)
    }

    /// Takes photons of a batch out of the light field, and forgets them.
    fn withdraw(&mut self, gpu: &Gpu, index: usize, photons: Range<u32>) -> Result<()> {
        let cx = Context { gpu, scene: &self.scene, counters: &self.counters };
        let batch = &mut self.map.batches[index];
        batch.stale = true;
        batch.quotas.iter_mut().filter(|q| q.photons == photons).for_each(|q| q.relit = false);
        let batch = &self.map.batches[index];
        self.field.withdraw(cx, &self.map.flights(batch, photons.clone()))?;
        batch.forget(gpu, photons)
    }

    /// Has the next update compute everything.
    pub(super) fn restart(&mut self) {
        for batch in &mut self.map.batches {
            batch.calm();
            batch.stale = true;
        }
        self.segments.restart();
        (self.fresh, self.pending) = (true, true);
    }
}
