//! What a scene may say. The reader adds the line to a fault, [`Scene::check`] the owner.

use std::collections::HashSet;

use super::VolumeSource;
use super::{Camera, CameraPlace, FilmSettings, Light, LightKind, Scene, Settings};
use crate::error::{Error, Result};
use crate::fault::{
    Check, TINY, askew, count, direction, fault, finite, non_negative, positive, scalar,
};
use crate::volume::phantom::SIZES;

impl Scene {
    /// Checks a scene that was made or changed in code; the reader has checked its own.
    ///
    /// # Errors
    /// [`Error::Setting`] for the first value that is impossible, or name given twice.
    pub fn check(&self) -> Result<()> {
        let owned = |owner: &str, check: Check| {
            check.map_err(|f| Error::setting(format!("{owner}: {}", f.what)))
        };
        owned("scene", non_negative("background", self.background))?;
        owned("volume", self.volume.check())?;
        owned("camera", self.camera.check())?;
        owned("settings", self.settings.check())?;
        owned("film", self.film.check())?;
        for m in &self.materials {
            owned(&format!("material `{}`", m.name), m.check())?;
        }
        for l in &self.lights {
            owned(&format!("light `{}`", l.name), l.check())?;
        }
        unique("material", self.materials.iter().map(|m| m.name.as_str()))?;
        unique("light", self.lights.iter().map(|l| l.name.as_str()))?;
        unique("light id", self.lights.iter().map(|l| l.id))?;
        unique("edit", self.edits.iter().map(|e| e.name.as_str()))
    }
}

fn unique<T: std::hash::Hash + Eq + std::fmt::Display + Copy>(
    kind: &str,
    mut names: impl Iterator<Item = T>,
) -> Result<()> {
    let mut seen = HashSet::new();
    match names.find(|&name| !seen.insert(name)) {
        Some(name) => Err(Error::setting(format!("two have the {kind} `{name}`: rename one"))),
        None => Ok(()),
    }
}

impl VolumeSource {
    pub(super) fn check(&self) -> Check {
        match *self {
            Self::File(_) => Ok(()),
            Self::Phantom { size, .. } => {
                count("size", size.into(), (*SIZES.start()).into(), (*SIZES.end()).into())
            }
        }
    }
}

impl Light {
    pub(super) fn check(&self) -> Check {
        scalar("share", self.share, self.share > 0.0, "it must be > 0")?;
        non_negative(self.kind.emitted_key(), self.emitted)?;
        self.kind.check()
    }
}

impl LightKind {
    /// `kind` in a scene file.
    pub(super) fn shape(&self) -> &'static str {
        match self {
            Self::Point { .. } | Self::PointAround { .. } => "point",
            Self::Directional { .. } => "directional",
            Self::Rectangle { .. } | Self::RectangleAround { .. } => "rectangle",
            Self::Surroundings => "surroundings",
        }
    }

    /// What a scene file calls [`Light::emitted`] of this shape.
    pub(super) fn emitted_key(&self) -> &'static str {
        match self {
            Self::Point { .. } | Self::PointAround { .. } => "intensity",
            Self::Directional { .. } => "irradiance",
            _ => "radiance",
        }
    }

    pub(super) fn check(&self) -> Check {
        let apart = |distance: f64| {
            let what = "it must be > 0, in radii of the bounding sphere";
            scalar("distance", distance, distance > 0.0, what)
        };
        match *self {
            Self::Point { position } => finite("position", position),
            Self::Directional { direction: d } => direction("direction", d),
            Self::Rectangle { corner, edge_u, edge_v } => {
                finite("corner", corner)?;
                direction("edge_u", edge_u)?;
                direction("edge_v", edge_v)?;
                askew("edge_v", edge_u, edge_v, "`edge_u`")
            }
            Self::Surroundings => Ok(()),
            Self::PointAround { from, distance } => {
                direction("from", from)?;
                apart(distance)
            }
            Self::RectangleAround { from, distance, size } => {
                direction("from", from)?;
                apart(distance)?;
                scalar("size", size, size > 0.0, "it must be > 0, in radii of the bounding sphere")
            }
        }
    }
}

impl Camera {
    pub(super) fn check(&self) -> Check {
        let view = match self.place {
            CameraPlace::At { origin, target } => {
                finite("origin", origin)?;
                finite("target", target)?;
                let view = target - origin;
                if view.length() < TINY {
                    return fault(
                        "target",
                        "`target` is the `origin`: the camera must look somewhere",
                    );
                }
                view
            }
            CameraPlace::Around { from, zoom } => {
                direction("from", from)?;
                scalar(
                    "zoom",
                    zoom,
                    zoom > 0.0,
                    "it must be > 0; 1 fits the volume into the image",
                )?;
                from
            }
        };
        direction("up", self.up)?;
        askew("up", view, self.up, "the view")?;
        let open = self.fov_deg > 0.0 && self.fov_deg < 180.0;
        scalar("fov_deg", self.fov_deg, open, "it must be in (0, 180) degrees")?;
        count("width", self.width.into(), 1, 16384)?;
        count("height", self.height.into(), 1, 16384)
    }
}

impl Settings {
    pub(super) fn check(&self) -> Check {
        let max = u32::MAX.into();
        count("photons", self.photons, 1, max)?;
        count("max_events", self.max_events.into(), 1, 64)?;
        count("roulette_from", self.roulette_from.into(), 1, max)?;
        let up_to_one = |v: f64| v > 0.0 && v <= 1.0;
        let survival = self.roulette_survival;
        scalar("roulette_survival", survival, up_to_one(survival), "it must be in (0, 1]")?;
        positive("radius", self.radius, "in mm")?;
        scalar("grid", self.grid, up_to_one(self.grid), "it must be in (0, 1] cells per voxel")?;
        count("segments", self.segments.into(), 1, 1024)?;
        let step = (1e-3..=4.0).contains(&self.step);
        scalar("step", self.step, step, "it must be in [0.001, 4] smallest spacings")?;
        positive("majorant", self.majorant, "per mm")?;
        if let Some([low, high]) = self.range {
            let ascends = low < high && (high - low).is_finite();
            scalar("range", high, ascends, &format!("it must ascend, from {low} on"))?;
        }
        count("rays", self.rays.into(), 1, 65_536)?;
        count("samples", self.samples.into(), 1, max)?;
        if let Some(events) = self.reference_events {
            count("reference_events", events.into(), 1, max)?;
        }
        let chance = self.least_chance;
        scalar("least_chance", chance, up_to_one(chance), "it must be in (0, 1]")?;
        positive("cache_mib", Some(self.cache_mib), "in MiB")?;
        positive("flux_unit", self.flux_unit, "in W")
    }
}

impl FilmSettings {
    pub(super) fn check(&self) -> Check {
        let stops = self.exposure.abs() <= 32.0;
        scalar("exposure", self.exposure, stops, "it must be in [-32, 32] stops")
    }
}
