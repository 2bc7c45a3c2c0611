//! Lights as the kernels see them: in the volume's frame, each with its quota of photons.

use glam::{DAffine3, DVec3};

use crate::bits::{hash, hash_wide};
use crate::error::{Error, Result};
use crate::gpu::layout::shared_struct;
use crate::scene::{LightKind, Scene};

/// Lights that a scene may have.
pub const MAX_LIGHTS: usize = 16;

/// Kind of a point light, in [`Light::kind`].
pub const LIGHT_POINT: u32 = 0;
/// Kind of a directional light.
pub const LIGHT_DIRECTIONAL: u32 = 1;
/// Kind of a rectangle.
pub const LIGHT_RECTANGLE: u32 = 2;
/// Kind of constant surroundings.
pub const LIGHT_SURROUNDINGS: u32 = 3;

shared_struct! {
    /// One light; lengths in mm along the volume's axes from its corner.
    pub struct Light {
        /// W/sr (point), W/mm² (directional), W/(sr mm²) (rectangle, surroundings).
        pub radiance: [f32; 3],
        /// One of the `LIGHT_` kinds.
        pub kind: u32,
        /// A point light's place, a rectangle's corner.
        pub position: [f32; 3],
        /// Hash of seed and stable id: the light's own randomness.
        pub stream: u32,
        /// Direction of travel, or a rectangle's normal.
        pub direction: [f32; 3],
        /// Keeps the layout.
        pub pad: u32,
        /// Edge of a rectangle.
        pub edge_u: [f32; 3],
        /// Its quota of photons.
        pub photons: u32,
        /// Edge of a rectangle.
        pub edge_v: [f32; 3],
        /// Area of a rectangle, mm².
        pub area: f32,
    }
}

shared_struct! {
    /// All lights of a scene.
    pub struct Lights {
        /// How many.
        pub count: u32,
        /// Photons of all together.
        pub photons: u32,
        /// Keeps the array aligned.
        pub pad0: u32,
        /// Keeps the array aligned.
        pub pad1: u32,
        /// The lights; beyond `count` they are zero.
        pub all: [Light; MAX_LIGHTS],
    }
}

impl Lights {
    /// The lights of a placed scene. Each owns `photons * share`, whatever the others do.
    ///
    /// # Errors
    /// Too many lights, too many photons, or a light that is not placed yet.
    pub fn of(scene: &Scene, local_from_world: &DAffine3) -> Result<Self> {
        if scene.lights.len() > MAX_LIGHTS {
            return Err(Error::setting(format!(
                "{} lights: at most {MAX_LIGHTS} are supported",
                scene.lights.len()
            )));
        }
        let mut lights = Self { count: scene.lights.len() as u32, ..Default::default() };
        let mut all = 0_u64;
        for (light, record) in scene.lights.iter().zip(&mut lights.all) {
            let quota = (scene.settings.photons as f64 * light.share).round().max(1.0) as u64;
            record.photons = quota as u32;
            all = all.saturating_add(quota);
            record.stream = hash(scene.settings.seed ^ hash_wide(u64::from(light.id) + 1));
            record.radiance = light.emitted.as_vec3().to_array();
            place(record, &light.kind, local_from_world)?;
        }
        lights.photons = u32::try_from(all).map_err(|_| {
            Error::setting(format!("{all} photons in all: at most {} are supported", u32::MAX))
        })?;
        Ok(lights)
    }
}

fn place(record: &mut Light, kind: &LightKind, local: &DAffine3) -> Result<()> {
    let point = |p: &DVec3| local.transform_point3(*p).as_vec3().to_array();
    let vector = |v: DVec3| local.transform_vector3(v).as_vec3().to_array();
    match kind {
        LightKind::Point { position } => {
            record.kind = LIGHT_POINT;
            record.position = point(position);
        }
        LightKind::Directional { direction } => {
            record.kind = LIGHT_DIRECTIONAL;
            record.direction = vector(direction.normalize());
        }
        LightKind::Rectangle { corner, edge_u, edge_v } => {
            // The normal is taken in the world: the volume's axes may mirror.
            let normal = edge_u.cross(*edge_v);
            record.kind = LIGHT_RECTANGLE;
            record.position = point(corner);
            record.direction = vector(normal.normalize());
            record.edge_u = vector(*edge_u);
            record.edge_v = vector(*edge_v);
            record.area = normal.length() as f32;
        }
        LightKind::Surroundings => record.kind = LIGHT_SURROUNDINGS,
        LightKind::PointAround { .. } | LightKind::RectangleAround { .. } => {
            return Err(Error::setting(
                "a light is given relative to the volume: settle the scene first",
            ));
        }
    }
    Ok(())
}
