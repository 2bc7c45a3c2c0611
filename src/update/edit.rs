//! How an edited scene is taken: what differs is noted, for the next update to find what that
//! touches.

use super::{PhotonFrame, Scope, light_field, light_ids, not_isotropic};
use crate::device_scene::lights::{Light, Lights};
use crate::error::{Error, Result};
use crate::field::LightField;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::history::Query;
use crate::photon::PhotonParams;
use crate::scene::{Estimator, Scene, Settings};
use crate::segment::SegmentMap;
use crate::split::Split;
use crate::transfer::Table;

impl PhotonFrame {
    /// Takes an edited scene; an update must follow. Materials, lights, camera and
    /// background may differ from what is shown.
    ///
    /// # Errors
    /// Something else differs, the scene is an impossible one, or the estimator does not suit
    /// it: nothing has happened then. Memory does not suffice or the device failed: the next update
    /// rebuilds everything.
    pub fn edit(&mut self, gpu: &Gpu, scene: &Scene, split: &Split) -> Result<Scope> {
        scene.check()?;
        if !self.source.settings.history {
            return Err(Error::setting("without histories (`history`) no edit can be applied"));
        }
        let size = |s: &Scene| (s.camera.width, s.camera.height);
        if (&scene.settings, &scene.volume, scene.filter, size(scene))
            != (&self.source.settings, &self.source.volume, self.source.filter, size(&self.source))
        {
            return Err(Error::setting(
                "an edit cannot change settings, volume, filter or image size: render anew",
            ));
        }
        let table = self.scene.table_of(scene);
        let chosen = match self.field {
            LightField::Fluence(_) => Estimator::Fluence,
            LightField::Points(_) => Estimator::Points,
        };
        if scene.settings.estimator.is_none()
            && table.is_isotropic() != (chosen == Estimator::Fluence)
        {
            return Err(Error::setting(
                "the edit asks for another estimator, since phase_g is 0 everywhere or not: name \
                 `estimator` in [settings]",
            ));
        }
        if chosen == Estimator::Fluence && !table.is_isotropic() {
            return Err(not_isotropic());
        }
        let lights = Lights::of(scene, &self.scene.local_from_world)?;
        scene.camera.rays(&self.scene.local_from_world)?;
        let result = self.apply(gpu, scene, (table, lights), split);
        if result.is_err() {
            (self.fresh, self.pending) = (true, true);
        }
        result
    }

    /// Has the next update estimate the light anew from the photons that there are. Of the
    /// settings, `estimator`, `weighting`, `radius`, `grid` and `rays` may differ.
    ///
    /// # Errors
    /// Another setting differs, memory does not suffice, or the estimator does not suit the
    /// scene: nothing has happened then.
    pub fn estimate(&mut self, gpu: &Gpu, settings: &Settings, split: &Split) -> Result<()> {
        let mut scene = self.source.clone();
        let own = &mut scene.settings;
        (own.estimator, own.weighting) = (settings.estimator, settings.weighting);
        (own.radius, own.grid, own.rays) = (settings.radius, settings.grid, settings.rays);
        if own != settings {
            return Err(Error::setting(
                "of a frame's settings only `estimator`, `weighting`, `radius`, `grid` and `rays` \
                 can change: render anew",
            ));
        }
        let (field, estimator, dirty) = light_field(gpu, &self.scene, settings, split)?;
        let segments = SegmentMap::new(gpu, &scene, &self.scene, &field, settings.rays, split)?;
        self.counters.clear(gpu)?;
        self.source = scene;
        (self.field, self.estimator, self.dirty) = (field, estimator, dirty);
        (self.segments, self.pending) = (segments, true);
        Ok(())
    }

    fn apply(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        (table, lights): (Table, Lights),
        split: &Split,
    ) -> Result<Scope> {
        self.count_anew(gpu)?;
        let suits = self.scene.suits(&table);
        let change =
            Query::between(&self.scene.table, &table, &self.scene.bins, self.scene.frame.majorant);
        let relit = self.relight(gpu, scene, &lights, split)?;
        self.query.add(&change);
        self.scene.edit(gpu, table, lights, &self.query)?;
        let before = std::mem::replace(&mut self.source, scene.clone());
        let repainted = scene.background != before.background;
        self.map.arrange(gpu, &self.scene.lights, &light_ids(scene))?;
        let moved = self.segments.look(scene, &self.scene)?;
        if !suits {
            self.restart();
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

    /// Applies edits of lights: the photons of those that moved or went are withdrawn, of
    /// those that only shine otherwise noted. Where most would be withdrawn, all is computed
    /// anew. Returns whether any light changed.
    fn relight(
        &mut self,
        gpu: &Gpu,
        scene: &Scene,
        lights: &Lights,
        split: &Split,
    ) -> Result<bool> {
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
            for i in 0..self.map.batches.len() {
                if self.map.batches[i].light_id != *id {
                    continue;
                }
                match stays {
                    Some(new) => self.map.batches[i].relit |= new.radiance != old.radiance,
                    None => withdrawn.push(i),
                }
            }
        }
        if self.fresh {
            return Ok(changed);
        }
        let photons = withdrawn.iter().map(|&i| u64::from(self.map.batches[i].photons));
        match 2 * photons.sum::<u64>() > u64::from(before.photons) {
            true => self.restart(),
            false => withdrawn.into_iter().try_for_each(|i| self.withdraw(gpu, i, split))?,
        }
        Ok(changed)
    }

    /// Takes the photons of a batch out of the light field, and forgets them.
    fn withdraw(&mut self, gpu: &Gpu, index: usize, split: &Split) -> Result<()> {
        self.map.batches[index].list_all(gpu, split.shuffle)?;
        let batch = &self.map.batches[index];
        match &self.field {
            LightField::Fluence(fluence) if fluence.current => {
                let params = PhotonParams { sign: -1, ..self.map.params(batch) };
                let slots = (params, self.map.live_bindings(batch));
                let silent = &mut Progress::silent();
                fluence.deposit(gpu, &self.scene, slots, &self.counters, silent)?;
            }
            // Sums that are not current begin anew; points are compared with those seen.
            LightField::Fluence(_) | LightField::Points(_) => {}
        }
        let batch = &mut self.map.batches[index];
        (batch.stale, batch.relit) = (true, false);
        batch.forget(gpu)
    }

    /// Has the next update compute everything.
    pub(super) fn restart(&mut self) {
        self.map.batches.iter_mut().for_each(|b| (b.stale, b.relit) = (true, false));
        self.segments.restart();
        (self.fresh, self.pending) = (true, true);
    }
}
