//! Fitting a scene to its volume: places in world mm, the frozen majorant and flux unit.

use std::f64::consts::PI;

use glam::DVec3;

use super::{Camera, CameraPlace, Light, LightKind, Scene};
use crate::transfer::{Domain, Table};
use crate::volume::{Numbers, Volume};

/// Mean free paths per smallest voxel spacing beyond which extinction is clamped.
const MAX_PATHS_PER_VOXEL: f64 = 4.0;

/// The greatest majorant that is derived for voxels of a spacing, 1/mm.
pub fn greatest_majorant(spacing: DVec3) -> f64 {
    MAX_PATHS_PER_VOXEL / spacing.min_element()
}

/// What a majorant grows by until an edited extinction fits below it: rarely, for all photons are
/// traced anew then.
const HEADROOM: f64 = 1.25;

/// Where extinction is clamped, 1/mm: at the settled majorant, or at four mean free paths per voxel if
/// that is more.
pub fn extinction_limit(settled: f64, spacing: DVec3) -> f64 {
    settled.max(greatest_majorant(spacing))
}

/// The rate of tentative collisions, 1/mm: the settled majorant while the `greatest` extinction fits
/// below it, else as many times a quarter more as it takes. It depends on the scene as it stands and
/// on nothing before, so that an edit that is undone leaves no trace.
pub fn effective_majorant(settled: f64, greatest: f64, spacing: DVec3) -> f64 {
    // Kernels compare in single precision.
    if greatest as f32 <= settled as f32 {
        return settled;
    }
    let steps = (greatest / settled).log(HEADROOM).ceil().max(1.0);
    (settled * HEADROOM.powf(steps)).min(extinction_limit(settled, spacing))
}

/// The majorant of a scene without extinction, 1/mm: a Poisson process needs a rate.
const MIN_MAJORANT: f64 = 1e-6;

/// The sphere about a volume's bounds, mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sphere {
    centre: DVec3,
    radius: f64,
}

impl Sphere {
    fn about(volume: &Volume) -> Self {
        let half = volume.extent() / 2.0;
        Self { centre: volume.corner() + volume.axes() * half, radius: half.length() }
    }
}

impl Scene {
    /// Puts the camera and lights that are given relative to the volume, those in edits
    /// too, where they belong in world mm. What is explicit stays.
    pub fn place(&mut self, volume: &Volume) {
        let sphere = Sphere::about(volume);
        self.camera.place = self.camera.placed(sphere);
        for edit in &mut self.edits {
            let changes = &mut edit.changes;
            if changes.camera.place.is_some() {
                let mut camera = self.camera.clone();
                changes.camera.apply(&mut camera);
                changes.camera.place = Some(camera.placed(sphere));
            }
            for kind in changes.lights.iter_mut().filter_map(|l| l.kind.as_mut()) {
                *kind = kind.placed(sphere);
            }
            for light in &mut changes.add_lights {
                light.kind = light.kind.placed(sphere);
            }
        }
        for light in &mut self.lights {
            light.kind = light.kind.placed(sphere);
        }
    }

    /// Fits the scene to its volume: [places](Self::place) it, and fills the majorant, the range and
    /// the flux unit where they are not given. From then on they are frozen.
    ///
    /// The range, which whole numbers that span at most 4095 need not have, is that of the data but
    /// for a ten thousandth at either end and for padding far off, joined with what materials and
    /// edits name.
    ///
    /// The majorant is the greatest extinction of the scene, of each of its edits, and of
    /// all of them made in order, at most four mean free paths per smallest spacing. The
    /// flux unit is the radiant flux of the lights, of the greatest channel: through the
    /// bounding sphere for lights without a place.
    pub fn settle(&mut self, volume: &Volume) {
        self.place(volume);
        let numbers = volume.numbers();
        if self.settings.range.is_none() && !numbers.are_few() {
            self.settings.range = self.derived_range(volume);
        }
        if self.settings.majorant.is_none() {
            let cap = greatest_majorant(volume.spacing());
            let greatest = self.greatest_extinction(&numbers);
            self.settings.majorant = Some(greatest.min(cap).max(MIN_MAJORANT));
        }
        if self.settings.flux_unit.is_none() {
            let sphere = Sphere::about(volume);
            let flux: f64 = self.lights.iter().map(|l| l.flux(sphere)).sum();
            let usable = flux.is_finite() && flux > 0.0;
            self.settings.flux_unit = Some(if usable { flux } else { 1.0 });
        }
    }

    /// The domain of the table of a settled scene.
    pub fn domain(&self, volume: &Volume) -> Domain {
        Domain::fitting(self.settings.range, &volume.numbers(), &self.materials)
    }

    fn greatest_extinction(&self, numbers: &Numbers) -> f64 {
        let greatest = |scene: &Self| {
            let domain = Domain::fitting(scene.settings.range, numbers, &scene.materials);
            f64::from(Table::build(&scene.materials, &domain, None).max_extinction())
        };
        let mut all = self.clone();
        let mut result = greatest(self);
        for edit in &self.edits {
            // An edit may rest on an earlier one; alone it then does not apply.
            if let Ok(alone) = self.edited(&edit.name) {
                result = result.max(greatest(&alone));
            }
            if all.apply(edit).is_ok() {
                result = result.max(greatest(&all));
            }
        }
        result
    }
}

impl Camera {
    fn placed(&self, sphere: Sphere) -> CameraPlace {
        let CameraPlace::Around { from, zoom } = self.place else {
            return self.place;
        };
        let across = (self.fov_deg.to_radians() / 2.0).tan();
        let least = across * (f64::from(self.height) / f64::from(self.width)).min(1.0);
        let distance = sphere.radius / least.atan().sin() / zoom;
        CameraPlace::At {
            origin: sphere.centre + from.normalize() * distance,
            target: sphere.centre,
        }
    }
}

impl LightKind {
    fn placed(self, sphere: Sphere) -> Self {
        match self {
            Self::PointAround { from, distance } => Self::Point {
                position: sphere.centre + from.normalize() * distance * sphere.radius,
            },
            Self::RectangleAround { from, distance, size } => {
                let inwards = -from.normalize();
                let upright = if inwards.z.abs() < 0.9 { DVec3::Z } else { DVec3::Y };
                let edge_u = upright.cross(inwards).normalize() * size * sphere.radius;
                let edge_v = inwards.cross(edge_u);
                let middle = sphere.centre - inwards * distance * sphere.radius;
                Self::Rectangle { corner: middle - (edge_u + edge_v) / 2.0, edge_u, edge_v }
            }
            _ => self,
        }
    }
}

impl Light {
    /// Radiant flux, W, of the greatest channel: all of it, or what meets the sphere.
    fn flux(&self, sphere: Sphere) -> f64 {
        let disc = PI * sphere.radius * sphere.radius;
        let per_emitted = match self.kind.placed(sphere) {
            LightKind::Point { .. } => 4.0 * PI,
            LightKind::Directional { .. } => disc,
            LightKind::Rectangle { edge_u, edge_v, .. } => PI * edge_u.cross(edge_v).length(),
            // Every point of the sphere is met with pi times the radiance.
            _ => 4.0 * PI * disc,
        };
        per_emitted * self.emitted.max_element()
    }
}
