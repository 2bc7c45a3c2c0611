//! What a scene may say. The reader adds the line to a fault, [`Scene::check`] the owner.

use std::collections::HashSet;

use glam::DVec3;

use super::VolumeSource;
use super::{Camera, CameraPlace, FilmSettings, Light, LightKind, Material, Scene, Settings};
use crate::error::{Error, Result};
use crate::volume::phantom::SIZES;

/// An impossible value: the TOML key it belongs to, and what is wrong with it.
pub(super) struct Fault {
    pub key: &'static str,
    pub what: String,
}

type Check = std::result::Result<(), Fault>;

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

impl Material {
    pub(super) fn check(&self) -> Check {
        ramp("ramp", &self.ramp)?;
        scalar("extinction", self.extinction, self.extinction >= 0.0, "it must be >= 0, per mm")?;
        let fraction = (0.0..=1.0).contains(&self.scatter);
        scalar("scatter", self.scatter, fraction, "it must be in [0, 1]")?;
        unit_range("colour", self.colour)?;
        non_negative("emission", self.emission)?;
        scalar("phase_g", self.phase_g, self.phase_g.abs() < 1.0, "it must be in (-1, 1)")
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
        count("rays", self.rays.into(), 1, 65_536)?;
        count("samples", self.samples.into(), 1, max)?;
        if let Some(events) = self.reference_events {
            count("reference_events", events.into(), 1, max)?;
        }
        positive("flux_unit", self.flux_unit, "in W")
    }
}

impl FilmSettings {
    pub(super) fn check(&self) -> Check {
        let stops = self.exposure.abs() <= 32.0;
        scalar("exposure", self.exposure, stops, "it must be in [-32, 32] stops")
    }
}

/// Below this a length is none, mm.
const TINY: f64 = 1e-9;

/// What is wrong with a number that no kernel can hold.
const SINGLE: &str = "it is beyond single precision, 3.4e38";

fn fault(key: &'static str, what: impl Into<String>) -> Check {
    Err(Fault { key, what: what.into() })
}

fn scalar(key: &'static str, value: f64, possible: bool, rule: &str) -> Check {
    match possible && value.is_finite() {
        true if (value as f32).is_finite() => Ok(()),
        true => fault(key, format!("`{key}` is {value}: {SINGLE}")),
        false => fault(key, format!("`{key}` is {value}: {rule}")),
    }
}

fn positive(key: &'static str, value: Option<f64>, unit: &str) -> Check {
    value.map_or(Ok(()), |v| scalar(key, v, v > 0.0, &format!("it must be > 0, {unit}")))
}

fn count(key: &'static str, value: u64, least: u64, most: u64) -> Check {
    match (least..=most).contains(&value) {
        true => Ok(()),
        false => fault(key, format!("`{key}` is {value}: it must be {least} to {most}")),
    }
}

fn finite(key: &'static str, v: DVec3) -> Check {
    vector(key, v, true, "it must be finite")
}

fn vector(key: &'static str, v: DVec3, possible: bool, rule: &str) -> Check {
    match possible && v.is_finite() {
        true if v.as_vec3().is_finite() => Ok(()),
        true => fault(key, format!("`{key}` is {v}: {SINGLE}")),
        false => fault(key, format!("`{key}` is {v}: {rule}")),
    }
}

fn direction(key: &'static str, v: DVec3) -> Check {
    vector(key, v, v.length() >= TINY, "it must have a length")
}

fn non_negative(key: &'static str, v: DVec3) -> Check {
    vector(key, v, v.min_element() >= 0.0, "each channel must be >= 0")
}

pub(super) fn unit_range(key: &'static str, v: DVec3) -> Check {
    let inside = v.min_element() >= 0.0 && v.max_element() <= 1.0;
    vector(key, v, inside, "each channel must be in [0, 1]")
}

fn askew(key: &'static str, a: DVec3, b: DVec3, other: &str) -> Check {
    match a.normalize().cross(b.normalize()).length() >= 1e-6 {
        true => Ok(()),
        false => fault(key, format!("`{key}` is {b}: it must not be parallel to {other}")),
    }
}

fn ramp(key: &'static str, ramp: &[[f64; 2]]) -> Check {
    let [first, .., last] = ramp else {
        return fault(key, format!("`{key}` has {} points: it takes two or more", ramp.len()));
    };
    if let Some([v, w]) = ramp.iter().find(|[v, w]| !v.is_finite() || !(0.0..=1.0).contains(w)) {
        return fault(key, format!("`{key}` has the point [{v}, {w}]: a weight is in [0, 1]"));
    }
    if let Some(pair) = ramp.windows(2).find(|p| p[0][0] > p[1][0]) {
        let (a, b) = (pair[0][0], pair[1][0]);
        return fault(key, format!("`{key}` descends from {a} to {b}: its values must ascend"));
    }
    if first[0] == last[0] {
        return fault(
            key,
            format!("`{key}` covers the value {} alone: it must cover a range", first[0]),
        );
    }
    Ok(())
}
