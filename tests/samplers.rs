//! The samplers against their densities: free flight, phase function, emission, packing.

mod common;

use std::f64::consts::PI;

use common::{Judged, gauss, gpu, scene_over};
use glam::{DMat3, DVec3, dvec3};
use photogram::frame::DeviceScene;
use photogram::light::hash;
use photogram::probe::{ProbeParams, What, draw};
use photogram::scene::{Filter, LightKind, Scene};
use photogram::volume::{Values, Volume};

const DRAWS: u32 = 1 << 17;
const CAMERA: &str = "[camera]\nfrom = [0, -1, 0]\n";

fn vector(v: [f32; 4]) -> DVec3 {
    DVec3::from_array([v[0].into(), v[1].into(), v[2].into()])
}

fn draws(scene: &Scene, volume: &Volume, what: What, params: ProbeParams) -> [Vec<[f32; 4]>; 3] {
    let device = DeviceScene::new(gpu(), scene, volume).expect("uploads");
    draw(gpu(), &device, what, params).expect("draws")
}

/// The bin of a number in [0, 1].
fn bin(u: f64, bins: usize) -> usize {
    ((u * bins as f64) as usize).min(bins - 1)
}

/// Counts over `bins` x `bins` of pairs that are uniform over the unit square.
fn judge_uniform(
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
fn about(axis: DVec3, d: DVec3) -> (f64, f64) {
    let (u, v) = axis.normalize().any_orthonormal_pair();
    (d.dot(axis.normalize()), (d.dot(v).atan2(d.dot(u)) / (2.0 * PI)).rem_euclid(1.0))
}

/// Layers across x of given extinctions; values 0, 1, 2 ..., so that under either filter
/// the border is that of the voxels.
struct Layers {
    /// Ends in mm, and extinctions.
    layers: Vec<(f64, f64)>,
    majorant: f64,
}

impl Layers {
    const EXTENT: DVec3 = dvec3(20.0, 11.2, 16.0);

    /// In voxels of `EXTENT` / (40, 16, 16) times `edge`; bytes, or floats where these are not 1.
    fn volume(&self, edge: u32) -> Volume {
        let size = [40 / edge, 16 / edge, 16 / edge];
        let spacing = Self::EXTENT / DVec3::from(size.map(f64::from));
        let layer = |i: u32| {
            let x = (f64::from(i) + 0.5) * spacing.x;
            self.layers.iter().position(|&(end, _)| x < end).expect("layers fill the volume")
        };
        let count = size.iter().product::<u32>();
        let layers = (0..count).map(|i| layer(i % size[0]));
        let values: Values = match edge {
            1 => layers.map(|l| l as u8).collect::<Vec<_>>().into(),
            _ => layers.map(|l| l as f32).collect::<Vec<_>>().into(),
        };
        Volume::new(size, spacing, DMat3::IDENTITY, DVec3::ZERO, values).expect("sound")
    }

    fn scene(&self, volume: &Volume, filter: Filter, skip_empty: bool, seed: u64) -> Scene {
        let mut text = String::from(CAMERA);
        for (i, (_, extinction)) in self.layers.iter().enumerate() {
            text += &format!(
                "[[material]]\nname = \"{i}\"\nwindow = [{}, {}]\nextinction = {extinction}\nalbedo = 1\n",
                i as f64 - 0.5,
                i as f64 + 0.5
            );
        }
        let mut scene = scene_over(volume, &text);
        scene.filter = filter;
        scene.settings.majorant = Some(self.majorant);
        scene.settings.skip_empty = skip_empty;
        scene.settings.seed = seed;
        scene
    }

    /// Optical depth from `origin` to distance `t`.
    fn depth(&self, origin: DVec3, direction: DVec3, t: f64) -> f64 {
        let (a, b) = (origin.x, origin.x + direction.x * t);
        let (low, high) = (a.min(b), a.max(b));
        let mut begin = 0.0;
        let mut depth = 0.0;
        for &(end, extinction) in &self.layers {
            depth += extinction * (high.min(end) - low.max(begin)).max(0.0);
            begin = end;
        }
        depth / direction.x.abs()
    }

    fn is_empty_at(&self, x: f64) -> bool {
        self.layers.iter().find(|&&(end, _)| x < end).is_none_or(|&(_, e)| e == 0.0)
    }
}

fn exit(origin: DVec3, direction: DVec3, extent: DVec3) -> f64 {
    let wall = DVec3::select(direction.cmpgt(DVec3::ZERO), extent, DVec3::ZERO);
    ((wall - origin) / direction)
        .to_array()
        .into_iter()
        .filter(|t| t.is_finite())
        .fold(1e9, f64::min)
}

/// Flights through `medium`, judged by the density that `law` says they have.
fn judge_flights(
    judged: &mut Judged,
    name: &str,
    medium: &Layers,
    law: &Layers,
    case: (u32, Filter, bool, u64),
) {
    const BINS: usize = 64;
    let (edge, filter, skip, seed) = case;
    let volume = medium.volume(edge);
    let scene = medium.scene(&volume, filter, skip, seed);
    let rays = [
        (dvec3(0.0, 5.0, 7.0), DVec3::X),
        (dvec3(0.3, 0.2, 0.1), dvec3(0.8, 0.44, 0.6)),
        (dvec3(20.0, 9.7, 1.1), dvec3(-0.9, -0.3, 0.5)),
    ];
    for (ray, (origin, direction)) in rays.into_iter().enumerate() {
        let direction = direction.normalize();
        let params = ProbeParams {
            origin: origin.as_vec3().to_array(),
            direction: direction.as_vec3().to_array(),
            count: DRAWS,
            ..Default::default()
        };
        let far = exit(origin, direction, Layers::EXTENT);
        let collide = -(-law.depth(origin, direction, far)).exp_m1();
        let mut counts = [0; BINS + 1];
        for [distance, _, collided, _] in draws(&scene, &volume, What::Flight, params)[0].iter() {
            let t = f64::from(*distance);
            if *collided == 0.0 {
                assert!((t - far).abs() < 1e-5 * far, "{name}: left at {t} mm, not {far}");
                counts[BINS] += 1;
                continue;
            }
            let x = origin.x + direction.x * t;
            let around = [x - 1e-3, x + 1e-3];
            assert!(
                (0.0..=far).contains(&t) && !around.iter().all(|&x| medium.is_empty_at(x)),
                "{name}: a collision with nothing, {t} mm along ray {ray}"
            );
            counts[bin(-(-law.depth(origin, direction, t)).exp_m1() / collide, BINS)] += 1;
        }
        let mut shares = [collide / BINS as f64; BINS + 1];
        shares[BINS] = 1.0 - collide;
        let (n, left) = (f64::from(DRAWS), shares[BINS]);
        let error = (left * (1.0 - left) / n).sqrt();
        let name = format!("{name}, ray {ray}, {filter} filter, skip {skip}, cells {edge}");
        judged.estimate(format!("{name}, leaving"), counts[BINS] as f64 / n, error, left);
        judged.counts(name, &counts, &shares);
    }
}

const WAYS: [(Filter, bool); 4] = [
    (Filter::Nearest, false),
    (Filter::Nearest, true),
    (Filter::Linear, false),
    (Filter::Linear, true),
];

#[test]
fn flights_end_as_the_exponential_law_says_whatever_the_majorant() {
    let mut judged = Judged::default();
    for (i, (filter, skip)) in WAYS.into_iter().enumerate() {
        // Far below the majorant a flight without skips takes long.
        let headrooms = if skip { &[1.0, 1.7, 12.0, 300.0][..] } else { &[1.0, 1.7, 12.0] };
        for (j, headroom) in headrooms.iter().enumerate() {
            let layers = vec![(20.0, 0.08)];
            let medium = Layers { layers, majorant: 0.08 * headroom };
            let seed = 100 + 10 * i as u64 + j as u64;
            let name = format!("homogeneous, majorant x {headroom}");
            judge_flights(&mut judged, &name, &medium, &medium, (1, filter, skip, seed));
        }
    }
    assert!(judged.hold());
}

#[test]
fn flights_through_layers_follow_the_optical_depth_whatever_the_cells() {
    let two = || Layers { layers: vec![(6.0, 0.05), (20.0, 0.13)], majorant: 0.2 };
    let gap = || Layers { layers: vec![(6.0, 0.06), (14.0, 0.0), (20.0, 0.2)], majorant: 0.2 };
    let mut judged = Judged::default();
    for (i, (filter, skip)) in WAYS.into_iter().enumerate() {
        for (j, edge) in [1, 4].into_iter().enumerate() {
            let seed = 200 + 10 * i as u64 + j as u64;
            judge_flights(&mut judged, "two layers", &two(), &two(), (edge, filter, skip, seed));
            judge_flights(&mut judged, "a gap", &gap(), &gap(), (edge, filter, skip, seed + 5));
        }
    }
    assert!(judged.hold());
}

#[test]
fn two_per_cent_more_extinction_is_seen_in_the_flights() {
    let two = |by: f64| Layers { layers: vec![(6.0, 0.05 * by), (20.0, 0.13 * by)], majorant: 0.2 };
    let mut judged = Judged::default();
    let case = (1, Filter::Nearest, true, 300);
    judge_flights(&mut judged, "2 % too dense", &two(1.02), &two(1.0), case);
    assert!(!judged.hold());
}

/// Share of directions whose cosine with that of travel is below `cosine`.
fn henyey_greenstein(g: f64, cosine: f64) -> f64 {
    if g == 0.0 {
        return (1.0 + cosine) / 2.0;
    }
    let root = (1.0 + g * g - 2.0 * g * cosine).sqrt();
    (1.0 - g * g) / (2.0 * g) * (1.0 / root - 1.0 / (1.0 + g))
}

fn judge_phase(drawn: f64, judged_by: f64) -> Judged {
    let travels = [
        DVec3::Z,
        -DVec3::Z,
        DVec3::X,
        dvec3(1e-4, -3e-5, 1.0),
        dvec3(2e-4, 1e-4, -1.0),
        dvec3(1e-7, 0.0, -1.0),
        dvec3(-0.48, 0.6, 0.64),
        dvec3(0.3, -0.8, -1e-7),
    ];
    let medium = Layers { layers: vec![(20.0, 0.1)], majorant: 0.1 };
    let volume = medium.volume(4);
    let mut judged = Judged::default();
    for (i, travel) in travels.into_iter().enumerate() {
        let scene = medium.scene(&volume, Filter::Nearest, false, 400 + i as u64);
        let direction = travel.normalize().as_vec3();
        let params = ProbeParams {
            direction: direction.to_array(),
            g: drawn as f32,
            count: DRAWS,
            ..Default::default()
        };
        let directions: Vec<_> =
            draws(&scene, &volume, What::Phase, params)[0].iter().map(|&d| vector(d)).collect();
        assert!(directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-6));
        let name = format!("g {drawn} along {travel}");
        let local = || directions.iter().map(|&d| about(direction.as_dvec3(), d));
        let g = judged_by;
        judge_uniform(&mut judged, &name, 16, local().map(|(c, t)| [henyey_greenstein(g, c), t]));
        let n = f64::from(DRAWS);
        let mean = local().map(|(c, _)| c).sum::<f64>() / n;
        // The mean of the squared cosine is (1 + 2 g^2) / 3.
        let error = (((1.0 + 2.0 * g * g) / 3.0 - g * g) / n).sqrt();
        judged.estimate(format!("{name}, mean cosine"), mean, error, g);
    }
    judged
}

#[test]
fn scattered_directions_follow_henyey_and_greenstein() {
    for g in [-0.7, 0.0, 0.3, 0.9] {
        assert!(judge_phase(g, g).hold(), "g {g}");
    }
}

#[test]
fn an_asymmetry_off_by_a_hundredth_is_seen() {
    assert!(!judge_phase(0.3, 0.31).hold());
}

/// A volume that stands askew and mirrored in the world.
fn askew() -> Volume {
    let turn = DMat3::from_rotation_z(0.7) * DMat3::from_rotation_x(-0.4);
    let mirrored = DMat3::from_cols(turn.x_axis, -turn.y_axis, turn.z_axis);
    let spacing = dvec3(0.5, 1.0, 2.0);
    let origin = dvec3(100.0, -50.0, 30.0) + mirrored * (spacing / 2.0);
    Volume::new([16, 12, 7], spacing, mirrored, origin, vec![0u8; 16 * 12 * 7]).expect("sound")
}

const BOX: DVec3 = dvec3(8.0, 12.0, 14.0);

/// A light in the box's own frame; a rectangle shines to the side of u x v there.
fn put(kind: LightKind, volume: &Volume, emitted: DVec3, seed: u64) -> Scene {
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

/// The hash of `kernels/shared/random.wgsl`, from its paper.
fn pcg4d(key: [u32; 4]) -> [u32; 4] {
    let mut v = key.map(|k| k.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    let mix = |v: &mut [u32; 4]| {
        for (to, a, b) in [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)] {
            v[to] = v[to].wrapping_add(v[a].wrapping_mul(v[b]));
        }
    };
    mix(&mut v);
    v = v.map(|x| x ^ x >> 16);
    mix(&mut v);
    v
}

#[test]
fn packing_keeps_directions_to_a_ten_thousandth_and_powers_to_14_bits() {
    const FOR_SCATTER: u32 = 0x30;
    let volume = askew();
    let scene = put(LightKind::Surroundings, &volume, DVec3::ONE, 800);
    let params = ProbeParams { count: DRAWS, ..Default::default() };
    let [directions, unpacked, powers] = draws(&scene, &volume, What::Packing, params);
    let (mut widest, mut worst): (f64, f64) = (0.0, 0.0);
    for (i, ((&d, &back), &power)) in directions.iter().zip(&unpacked).zip(&powers).enumerate() {
        let (d, back) = (vector(d), vector(back));
        widest = widest.max(d.cross(back).length().atan2(d.dot(back)));
        let words = pcg4d([hash(scene.settings.seed), i as u32, 0, FOR_SCATTER]);
        let u = words.map(|w| f64::from(w >> 8) / f64::from(1 << 24));
        assert_eq!(u[3], f64::from(power[3]), "the draws are not those of the paper's hash");
        let before = dvec3(u[0], u[1], u[2]) * (40.0 * (u[3] - 0.5)).exp2();
        let off = (vector(power) - before).abs().max_element() / before.max_element();
        worst = worst.max(off);
    }
    println!("directions within {widest:.2e} rad, powers within {worst:.2e} of the largest");
    assert!(widest < 1e-4);
    // exp2 on the device is itself good to some 4e-6.
    assert!(worst < 2f64.powi(-14) + 4e-6);
}

/// Integers all the way: what comes out is the exact product, rounded to 14 bits of the
/// largest channel.
#[test]
fn weighing_is_exact_to_14_bits() {
    let volume = askew();
    let scene = put(LightKind::Surroundings, &volume, DVec3::ONE, 802);
    let params = ProbeParams { count: DRAWS, ..Default::default() };
    let [powers, shares, weighed] = draws(&scene, &volume, What::Weighing, params);
    let (mut worst, mut black): (f64, u32) = (0.0, 0);
    for (i, ((&power, &share), &weighed)) in powers.iter().zip(&shares).zip(&weighed).enumerate() {
        let doublings = f64::from(i as u32 % 7);
        let exact = vector(power) * vector(share) * (doublings - 18.0).exp2();
        let largest = exact.max_element();
        if largest == 0.0 {
            assert_eq!(vector(weighed), DVec3::ZERO);
            black += 1;
            continue;
        }
        worst = worst.max((vector(weighed) - exact).abs().max_element() / largest);
    }
    println!("within {worst:.3e} of the largest; {black} black");
    assert!(black > 10);
    // Half a unit of the last of 14 bits, or a whole one where that would be the fifteenth.
    assert!(worst <= 2f64.powi(-14));
}

#[test]
fn a_channel_without_power_stays_without_it() {
    let medium = Layers { layers: vec![(20.0, 0.1)], majorant: 0.1 };
    let volume = medium.volume(1);
    let mut scene = medium.scene(&volume, Filter::Nearest, true, 801);
    let light = put(LightKind::Surroundings, &volume, dvec3(0.0, 2.0, 0.0), 801).lights.remove(0);
    scene.lights.push(light);
    scene.settings.photons = 20_000;
    scene.camera.width = 16;
    scene.camera.height = 16;
    let image = common::rendered(&scene, &volume).image;
    assert!(image.rgb.iter().all(|p| p[0] == 0.0 && p[2] == 0.0));
    assert!(common::mean(&image) > 0.01);
}
