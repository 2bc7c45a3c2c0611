//! Draws of the kernels' samplers, and how they are judged.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, dvec3};
use photogram::device_scene::DeviceScene;
use photogram::photon::probe::{ProbeParams, What, draw};
use photogram::scene::{LightKind, Scene};
use photogram::volume::Volume;

use super::{Judged, gpu, scene_over};

pub const DRAWS: u32 = 1 << 17;
pub const CAMERA: &str = "[camera]\nfrom = [0, -1, 0]\n";

pub fn vector(v: [f32; 4]) -> DVec3 {
    DVec3::from_array([v[0].into(), v[1].into(), v[2].into()])
}

pub fn draws(
    scene: &Scene,
    volume: &Volume,
    what: What,
    params: ProbeParams,
) -> [Vec<[f32; 4]>; 3] {
    let device = DeviceScene::new(gpu(), scene, volume).expect("uploads");
    draw(gpu(), &device, what, params).expect("draws")
}

/// The bin of a number in [0, 1].
pub fn bin(u: f64, bins: usize) -> usize {
    ((u * bins as f64) as usize).min(bins - 1)
}

/// Counts over `bins` x `bins` of pairs that are uniform over the unit square.
pub fn judge_uniform(
    judged: &mut Judged,
    name: &str,
    bins: usize,
    pairs: impl Iterator<Item = [f64; 2]>,
) {
    let mut counts = vec![0; bins * bins];
    pairs.for_each(|[u, v]| counts[bin(u, bins) * bins + bin(v, bins)] += 1);
    judged.counts(name, &counts, &vec![1.0; bins * bins]);
}

/// Cosine with an axis, and the turn about it in [0, 1).
pub fn about(axis: DVec3, d: DVec3) -> (f64, f64) {
    let (u, v) = axis.normalize().any_orthonormal_pair();
    (d.dot(axis.normalize()), (d.dot(v).atan2(d.dot(u)) / (2.0 * PI)).rem_euclid(1.0))
}

/// A volume that stands askew and mirrored in the world.
pub fn askew() -> Volume {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-0.4);
    let mirrored = DMat3::from_cols(turn.x_axis, -turn.y_axis, turn.z_axis);
    let spacing = dvec3(0.5, 1.0, 2.0);
    let origin = dvec3(100.0, -50.0, 30.0) + mirrored * (spacing / 2.0);
    Volume::new([16, 12, 7], spacing, mirrored, origin, vec![0u8; 16 * 12 * 7]).expect("sound")
}

/// A light in the box's own frame; a rectangle shines to the side of u x v there.
pub fn put(kind: LightKind, volume: &Volume, emitted: DVec3, seed: u64) -> Scene {
    let point = |p: DVec3| volume.corner() + volume.axes() * p;
    let turned = |d: DVec3| volume.axes() * d;
    let kind = match kind {
        LightKind::Point { position } => LightKind::Point { position: point(position) },
        LightKind::Directional { direction } => {
            LightKind::Directional { direction: 3.0 * turned(direction) }
        }
        // A mirror turns the product round: the edges change places.
        LightKind::Rectangle { corner, edge_u, edge_v } => LightKind::Rectangle {
            corner: point(corner),
            edge_u: turned(edge_v),
            edge_v: turned(edge_u),
        },
        other => other,
    };
    let text = format!("{CAMERA}[[light]]\nkind = \"surroundings\"\nradiance = 1\n");
    let mut scene = scene_over(volume, &text);
    scene.lights[0].kind = kind;
    scene.lights[0].emitted = emitted;
    scene.settings.photons = DRAWS.into();
    scene.settings.seed = seed;
    scene
}
