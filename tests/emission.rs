//! Photons as lights emit them, against quadrature and densities.

mod common;

use std::f64::consts::PI;

use common::draws::{DRAWS, about, askew, bin, draws, judge_uniform, put, vector};
use common::{Judged, gauss};
use glam::{DVec3, dvec3};
use photogram::photon::probe::{ProbeParams, What};
use photogram::scene::{LightKind, Scene};
use photogram::volume::Volume;

const BOX: DVec3 = dvec3(8.0, 12.0, 14.0);

/// Position, direction and power in red of each photon.
fn emitted(scene: &Scene, volume: &Volume) -> Vec<(DVec3, DVec3, f64)> {
    let params = ProbeParams { count: DRAWS, ..Default::default() };
    let [positions, directions, powers] = draws(scene, volume, What::Emission, params);
    let share = scene.lights[0].emitted / scene.lights[0].emitted.x;
    let each = positions.into_iter().zip(directions).zip(powers);
    each.map(|((p, d), w)| {
        let (p, d, w) = (vector(p), vector(d), vector(w));
        assert!((d.length() - 1.0).abs() < 1e-6);
        assert!((w / share).abs_diff_eq(DVec3::splat(w.x), 1e-6 * w.x));
        (p, d, w.x)
    })
    .collect()
}

/// Irradiance that a light of unit emission throws on a face, by its outward normal.
fn irradiance(kind: &LightKind, at: DVec3, outward: DVec3) -> f64 {
    match *kind {
        LightKind::Point { position } => {
            let to = position - at;
            to.dot(outward).max(0.0) / to.length().powi(3)
        }
        LightKind::Directional { direction } => -direction.normalize().dot(outward).min(0.0),
        LightKind::Rectangle { corner, edge_u, edge_v } => {
            let normal = edge_u.cross(edge_v);
            let nodes = gauss(16);
            let mut sum = 0.0;
            for &(u, wu) in &nodes {
                for &(v, wv) in &nodes {
                    let to = corner + u * edge_u + v * edge_v - at;
                    let cosines = to.dot(outward).max(0.0) * (-to.dot(normal)).max(0.0);
                    sum += wu * wv * cosines / to.length_squared().powi(2);
                }
            }
            sum
        }
        _ => PI,
    }
}

/// Bins along a face's edges.
const PATCHES: usize = 4;
const FACES: usize = 6;

/// The outward normal of a face, numbered 2 * axis + (1 where it is the far one).
fn outward(face: usize) -> DVec3 {
    DVec3::AXES[face / 2] * if face % 2 == 1 { 1.0 } else { -1.0 }
}

/// Radiant flux through every patch of the box, for unit emission, by quadrature.
fn flux_by_quadrature(kind: &LightKind) -> Vec<f64> {
    let nodes = gauss(12);
    let mut patches = vec![0.0; FACES * PATCHES * PATCHES];
    for (i, flux) in patches.iter_mut().enumerate() {
        let (face, p, q) = (i / (PATCHES * PATCHES), i / PATCHES % PATCHES, i % PATCHES);
        let (a, b) = ((face / 2 + 1) % 3, (face / 2 + 2) % 3);
        let edge = BOX / PATCHES as f64;
        for &(u, wu) in &nodes {
            for &(v, wv) in &nodes {
                let mut at = outward(face).max(DVec3::ZERO) * BOX;
                at[a] = edge[a] * (p as f64 + u);
                at[b] = edge[b] * (q as f64 + v);
                *flux += wu * wv * edge[a] * edge[b] * irradiance(kind, at, outward(face));
            }
        }
    }
    patches
}

fn patch_of(at: DVec3, direction: DVec3) -> Option<usize> {
    let face = (0..FACES).find(|&f| {
        let wall = outward(f).max(DVec3::ZERO) * BOX;
        at[f / 2] == wall[f / 2] && direction.dot(outward(f)) < 0.0
    })?;
    let (a, b) = ((face / 2 + 1) % 3, (face / 2 + 2) % 3);
    Some((face * PATCHES + bin(at[a] / BOX[a], PATCHES)) * PATCHES + bin(at[b] / BOX[b], PATCHES))
}

/// Flux of photons against a truth: each patch, and all together.
fn judge_flux(judged: &mut Judged, name: &str, photons: &[(DVec3, DVec3, f64)], truth: &[f64]) {
    let n = photons.len() as f64;
    let mut sums = vec![(0.0, 0.0); truth.len() + 1];
    for &(at, direction, power) in photons.iter().filter(|p| p.2 > 0.0) {
        let patch = patch_of(at, direction);
        let patch =
            patch.unwrap_or_else(|| panic!("{name}: {at} is on no face that faces {direction}"));
        for i in [patch, truth.len()] {
            sums[i] = (sums[i].0 + power, sums[i].1 + power * power);
        }
    }
    let all = truth.iter().sum();
    for (i, ((sum, squares), truth)) in sums.iter().zip(truth.iter().chain([&all])).enumerate() {
        let error = (squares - sum * sum / n).max(0.0).sqrt();
        judged.estimate(format!("{name}, patch {i}"), *sum, error, *truth);
    }
}

/// Lights outside the box, in its own frame.
fn outside() -> Vec<(&'static str, LightKind)> {
    let rectangle = |corner, edge_u, edge_v| LightKind::Rectangle { corner, edge_u, edge_v };
    vec![
        ("a point before a face", LightKind::Point { position: dvec3(3.0, -9.0, 5.0) }),
        ("a point near a face", LightKind::Point { position: dvec3(9.5, 4.0, 10.0) }),
        ("a point off a corner", LightKind::Point { position: dvec3(-6.0, 20.0, 40.0) }),
        ("a far point", LightKind::Point { position: dvec3(500.0, -900.0, 3.0) }),
        ("a sun askew", LightKind::Directional { direction: dvec3(0.5, -0.3, 0.8) }),
        ("a sun along an axis", LightKind::Directional { direction: -DVec3::Z }),
        (
            "a rectangle before a face",
            rectangle(dvec3(-4.0, 2.0, 3.0), 7.0 * DVec3::Y, 6.0 * DVec3::Z),
        ),
        (
            "a skewed rectangle off an edge",
            rectangle(dvec3(14.0, -12.0, 4.0), dvec3(-3.0, -4.0, 1.0), dvec3(0.0, 1.0, 6.0)),
        ),
        (
            "a rectangle that half the box lies behind",
            rectangle(dvec3(-5.0, 2.0, 3.0), 5.0 * DVec3::Y, dvec3(-4.0, 0.0, 0.5)),
        ),
        ("surroundings", LightKind::Surroundings),
    ]
}

#[test]
fn photons_carry_the_flux_of_their_light_to_every_patch_of_the_bounds() {
    let (volume, emission) = (askew(), dvec3(3.0, 1.5, 0.25));
    let mut judged = Judged::default();
    for (i, (name, kind)) in outside().into_iter().enumerate() {
        let photons = emitted(&put(kind, &volume, emission, 500 + i as u64), &volume);
        let truth: Vec<_> = flux_by_quadrature(&kind).iter().map(|f| f * emission.x).collect();
        assert!(truth.iter().sum::<f64>() > 0.0, "{name} misses the box");
        judge_flux(&mut judged, name, &photons, &truth);
    }
    assert!(judged.hold());
}

#[test]
fn a_flux_three_per_cent_off_is_seen() {
    let (volume, emission) = (askew(), DVec3::splat(3.09));
    for (i, (name, kind)) in outside().into_iter().enumerate() {
        let photons = emitted(&put(kind, &volume, emission, 500 + i as u64), &volume);
        let truth: Vec<_> = flux_by_quadrature(&kind).iter().map(|f| f * 3.0).collect();
        let mut judged = Judged::default();
        judge_flux(&mut judged, name, &photons, &truth);
        assert!(!judged.hold(), "{name}: a fault of 3 % went unseen");
    }
}

/// Where on a rectangle a point of its plane lies, along its edges.
fn along_edges(corner: DVec3, edge_u: DVec3, edge_v: DVec3, at: DVec3) -> [f64; 2] {
    let normal = edge_u.cross(edge_v);
    let (to, scale) = (at - corner, normal.length_squared());
    [to.cross(edge_v).dot(normal) / scale, edge_u.cross(to).dot(normal) / scale]
}

#[test]
fn photons_come_from_where_their_light_is() {
    let volume = askew();
    let mut judged = Judged::default();
    for (i, (name, kind)) in outside().into_iter().enumerate() {
        let photons = emitted(&put(kind, &volume, DVec3::ONE, 600 + i as u64), &volume);
        let parallel = |way: DVec3, d: DVec3| way.normalize().abs_diff_eq(d, 1e-6);
        let holds = |&(at, d, power): &(DVec3, DVec3, f64)| match kind {
            LightKind::Point { position } => parallel(at - position, d),
            LightKind::Directional { direction } => parallel(direction, d),
            LightKind::Rectangle { corner, edge_u, edge_v } => {
                let normal = edge_u.cross(edge_v);
                let source = at - d * ((at - corner).dot(normal) / d.dot(normal));
                let on = along_edges(corner, edge_u, edge_v, source);
                power == 0.0 || on.iter().all(|t| (-1e-4..1.0001).contains(t))
            }
            _ => true,
        };
        let stray = photons.iter().find(|p| !holds(p));
        assert!(stray.is_none(), "{name}: {stray:?}");
        if kind == LightKind::Surroundings {
            for face in 0..FACES {
                let here = photons.iter().filter(|p| {
                    patch_of(p.0, p.1).is_some_and(|i| i / (PATCHES * PATCHES) == face)
                });
                let local = here.map(|p| about(-outward(face), p.1));
                let name = format!("{name}, directions at face {face}");
                judge_uniform(&mut judged, &name, 12, local.map(|(c, turn)| [c * c, turn]));
            }
        }
    }
    assert!(judged.hold());
}

#[test]
fn a_light_inside_the_bounds_shines_from_where_it_stands() {
    let volume = askew();
    let mut judged = Judged::default();
    let total = |photons: &[(DVec3, DVec3, f64)]| photons.iter().map(|p| p.2).sum::<f64>();

    let position = dvec3(2.0, 7.0, 11.0);
    let scene = put(LightKind::Point { position }, &volume, DVec3::splat(3.0), 700);
    let photons = emitted(&scene, &volume);
    assert!(photons.iter().all(|p| p.0.abs_diff_eq(position, 1e-4)));
    let local = photons.iter().map(|p| about(dvec3(0.2, -0.5, 0.7), p.1));
    judge_uniform(&mut judged, "a point inside", 16, local.map(|(c, t)| [(1.0 + c) / 2.0, t]));
    judged.estimate("a point's flux", total(&photons), 0.0, 4.0 * PI * 3.0);

    let (corner, edge_u, edge_v) =
        (dvec3(1.0, 3.0, 6.0), dvec3(4.0, 1.0, 0.0), dvec3(0.0, 2.0, 5.0));
    let kind = LightKind::Rectangle { corner, edge_u, edge_v };
    let photons = emitted(&put(kind, &volume, DVec3::splat(3.0), 701), &volume);
    let normal = edge_u.cross(edge_v);
    assert!(photons.iter().all(|p| (p.0 - corner).dot(normal.normalize()).abs() < 1e-4));
    let places = photons.iter().map(|p| along_edges(corner, edge_u, edge_v, p.0));
    judge_uniform(&mut judged, "places on a rectangle inside", 16, places);
    let local = photons.iter().map(|p| about(normal, p.1));
    assert!(local.clone().all(|(cosine, _)| cosine >= 0.0));
    judge_uniform(&mut judged, "directions from it", 16, local.map(|(c, turn)| [c * c, turn]));
    judged.estimate("a rectangle's flux", total(&photons), 0.0, PI * 3.0 * normal.length());
    assert!(judged.hold());
}
