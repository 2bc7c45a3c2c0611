//! Light fields: what photons leave behind, for segments to look light up in.
//!
//! `fluence` sums flights on a grid, `points` keeps interactions in cells. What differs between them
//! is behind [`LightField`]: a stage of the frame asks it, and never which one it is.

pub mod dirty;
pub mod fluence;
pub mod points;

use self::dirty::Dirty;
use self::fluence::Fluence;
use self::points::Points;
use crate::device_scene::{Context, DeviceScene};
use crate::error::Result;
use crate::gpu::counter::Counters;
use crate::gpu::read::Words;
use crate::gpu::resource::Bindings;
use crate::gpu::{Gpu, Progress};
use crate::history::Query;
use crate::photon::{Flights, Follows, Part, PhotonMap};
use crate::scene::{Estimator, Settings};
use crate::split::Split;
use crate::transfer::Table;

/// Points that are gathered together.
pub struct Run {
    /// By the names that the segment kernel gives them.
    pub bindings: Bindings,
    /// How many points.
    pub points: u32,
}

/// What an update is about.
pub struct Request<'a> {
    /// What edits changed since the last update that came to its end.
    pub query: &'a Query,
    /// Everything is computed, whatever changed.
    pub is_rebuild: bool,
    /// Whether segments ask where light changed.
    pub asks_for_light: bool,
    /// How the work is cut.
    pub split: &'a Split,
}

/// How a segment keeps its light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SegmentLight {
    /// As a colour, computed at once.
    Colour,
    /// As integer sums of this scale, to which parts of the light field are added one by one.
    Sums {
        /// Units of a sum for each unit of radiance.
        scale: f32,
    },
}

/// Light in space, brought up to date by what photons changed.
pub trait LightField {
    /// For reports: the estimator with its weighting.
    fn name(&self) -> &'static str;

    /// Which estimator it is.
    fn estimator(&self) -> Estimator;

    /// What it wants to be told of photons that change.
    fn follows(&self) -> Follows;

    /// How far from a photon its light is read, mm, beside what its cells are wide.
    fn reach(&self) -> f32 {
        0.0
    }

    /// Takes the kernels that suit an edited scene.
    ///
    /// # Errors
    /// The device refuses them.
    fn respecialise(&mut self, _gpu: &Gpu, _scene: &DeviceScene) -> Result<()> {
        Ok(())
    }

    /// An edit or a rebuild begins: work is counted from here on.
    fn count_anew(&mut self) {}

    /// Photons with these flights are about to be forgotten.
    ///
    /// # Errors
    /// The device failed.
    fn withdraw(&mut self, _cx: Context, _flights: &Flights) -> Result<()> {
        Ok(())
    }

    /// Photons that are listed are about to be worked on.
    ///
    /// # Errors
    /// The device failed.
    fn begin(&mut self, cx: Context, map: &PhotonMap, request: &Request) -> Result<()>;

    /// A part of the photons was worked on; the journal has what they were.
    ///
    /// # Errors
    /// The device failed.
    fn take(
        &mut self,
        _cx: Context,
        _map: &PhotonMap,
        _part: &Part,
        _progress: &mut Progress,
    ) -> Result<()> {
        Ok(())
    }

    /// Finds out what it needs to know before the light is brought up to date: words to be read.
    ///
    /// # Errors
    /// The device failed.
    fn survey(&mut self, _cx: Context, _map: &PhotonMap, _request: &Request) -> Result<Vec<Words>> {
        Ok(Vec::new())
    }

    /// Brings the light up to date with all photons, and marks where it changed. `learned` is what was
    /// asked for. Returns how many points changed, if there are any.
    ///
    /// # Errors
    /// The device failed.
    fn build(
        &mut self,
        cx: Context,
        map: &mut PhotonMap,
        request: &Request,
        dirty: &Dirty,
        learned: &[u32],
        progress: &mut Progress,
    ) -> Result<u64>;

    /// What to do where the driver ended the loops of its kernels.
    fn remedy(&self) -> &'static str;

    /// All segments are computed from the light as it is.
    fn all_seen(&mut self) {}

    /// The columns of the table, `CHANGE_` bits, that a segment reads at its own samples.
    fn columns_read(&self) -> u32;

    /// How segments keep what they find in it.
    fn segment_light(&self) -> SegmentLight;

    /// The flags of the segment kernel that it sets.
    fn segment_flags(&self) -> Vec<&'static str>;

    /// All light, in runs.
    fn runs(&self) -> Vec<Run>;

    /// The light that changed since all segments were computed; `None` where all is to be
    /// gathered anew.
    fn changes(&self) -> Option<Vec<Run>> {
        None
    }

    /// Points that a look-up tests, if they are spread evenly.
    fn tests_per_sample(&self) -> f64 {
        0.0
    }

    /// Means, lights and places that points were given since work was counted anew.
    fn points_built(&self, _counts: &Counters) -> u64 {
        0
    }

    /// Gather radius, mm, where there is one.
    fn radius(&self) -> Option<f32> {
        None
    }

    /// Cells of a grid, where there is one.
    fn grid(&self) -> Option<[u32; 3]> {
        None
    }

    /// Bytes of the light.
    fn bytes(&self) -> u64;

    /// Bytes that an update takes beside, at most.
    fn update_bytes(&self) -> u64 {
        0
    }

    /// Bytes of histories in it.
    fn history_bytes(&self) -> u64 {
        0
    }

    /// How many cells or points differ from those of another one.
    ///
    /// # Errors
    /// The device failed.
    fn differing(&self, gpu: &Gpu, other: &dyn LightField) -> Result<u64>;

    /// The points, if it is made of them.
    fn points(&self) -> Option<&Points> {
        None
    }

    /// The grid of fluence, if it is one.
    fn fluence(&self) -> Option<&Fluence> {
        None
    }
}

/// The estimator that settings ask for: by default `fluence` where all scattering is isotropic.
///
/// # Errors
/// It does not suit the materials.
pub fn estimator(settings: &Settings, table: &Table) -> Result<Estimator> {
    let isotropic = table.is_isotropic();
    let fitting = if isotropic { Estimator::Fluence } else { Estimator::Points };
    match settings.estimator.unwrap_or(fitting) {
        Estimator::Fluence if !isotropic => Err(fluence::not_isotropic()),
        chosen => Ok(chosen),
    }
}

/// An empty light field for a scene.
///
/// # Errors
/// It does not suit the scene, or the adapter.
pub fn new(
    gpu: &Gpu,
    scene: &DeviceScene,
    settings: &Settings,
    split: &Split,
) -> Result<Box<dyn LightField>> {
    Ok(match estimator(settings, &scene.table)? {
        Estimator::Fluence => Box::new(Fluence::new(gpu, scene, settings)?),
        Estimator::Points => Box::new(Points::new(gpu, scene, settings, split)?),
    })
}
