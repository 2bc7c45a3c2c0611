//! Two kidneys on the aorta, contrast in arteries and in the renal pelvis.

use glam::Vec3;

use super::shape::Shape;
use super::{AIR, Layer, Plan, Tissue, hash};

const TISSUE: Tissue = Tissue::new("tissue", -150.0, -30.0);
const CORTEX: Tissue = Tissue::new("cortex", 130.0, 230.0);
const VESSELS: Tissue = Tissue::new("vessels", 300.0, 460.0);
const CONTENTS: Tissue = Tissue::new("contents", 600.0, 800.0);

pub(super) const TISSUES: [Tissue; 4] = [TISSUE, CORTEX, VESSELS, CONTENTS];

/// Heights on the kidney of the five segments that its artery feeds, mm.
const SEGMENTS: [f32; 5] = [26.0, 13.0, 0.0, -13.0, -26.0];

pub(super) fn plan() -> Plan {
    let mut layers =
        vec![Layer::solid(TISSUE, Shape::ellipsoid([0.0, 9.0, 0.0], [114.0, 68.0, 130.0]))];
    for side in [-1.0, 1.0] {
        layers.push(Layer::solid(CORTEX, bean(side)));
    }
    let aorta = Shape::tube([
        ([0.0, 12.0, -130.0], 9.5),
        ([2.0, 10.0, -40.0], 10.0),
        ([0.0, 12.0, 130.0], 11.0),
    ]);
    let front = [
        vec![([0.0, 12.0, 44.0], 4.6), ([2.0, -6.0, 46.0], 4.2), ([-26.0, -10.0, 52.0], 3.4)],
        vec![([2.0, -6.0, 46.0], 3.8), ([30.0, -8.0, 56.0], 3.2), ([52.0, 0.0, 58.0], 2.6)],
        vec![
            ([1.0, 12.0, 26.0], 4.4),
            ([2.0, -8.0, 6.0], 4.0),
            ([-4.0, -12.0, -46.0], 3.2),
            ([-14.0, -12.0, -74.0], 2.4),
        ],
    ];
    layers.push(Layer::solid(VESSELS, aorta));
    layers.extend(front.map(|points| Layer::solid(VESSELS, Shape::tube(points))));
    for side in [-1.0, 1.0] {
        layers.push(Layer::solid(CONTENTS, pelvis(side)));
        layers.extend(arteries(side).into_iter().map(|shape| Layer::solid(VESSELS, shape)));
    }
    Plan {
        bounds: [Vec3::new(-102.0, -18.0, -70.0), Vec3::new(102.0, 62.0, 64.0)],
        air: AIR,
        noise: 8.0,
        labels: false,
        layers,
    }
}

/// The kidney at one side, +1 left, which sits the higher: a bent tube, its
/// hollow towards the aorta.
fn place(side: f32, [x, y, z]: [f32; 3]) -> [f32; 3] {
    [side * x, y, z + 5.0 * side]
}

fn bean(side: f32) -> Shape {
    let points = [
        ([52.0, 27.0, 40.0], 19.0),
        ([66.0, 29.0, 24.0], 24.0),
        ([72.0, 30.0, 0.0], 25.0),
        ([70.0, 31.0, -24.0], 24.0),
        ([60.0, 31.0, -41.0], 19.0),
    ];
    Shape::tube(points.map(|(p, r)| (place(side, p), r)))
}

/// Renal pelvis with calyces, and the ureter.
fn pelvis(side: f32) -> Shape {
    let tube =
        |points: &[([f32; 3], f32)]| Shape::tube(points.iter().map(|&(p, r)| (place(side, p), r)));
    let mut parts = vec![
        tube(&[
            ([34.0, 30.0, -130.0], 2.6),
            ([36.0, 32.0, -40.0], 2.6),
            ([42.0, 33.0, -14.0], 3.6),
            ([54.0, 32.0, -2.0], 8.0),
        ]),
        tube(&[([54.0, 32.0, -2.0], 8.0), ([58.0, 31.0, 16.0], 4.0), ([56.0, 29.0, 32.0], 5.2)]),
        tube(&[([54.0, 32.0, -2.0], 8.0), ([60.0, 32.0, -20.0], 4.0), ([61.0, 32.0, -34.0], 5.2)]),
    ];
    for (y, z) in [(22.0, 20.0), (38.0, 12.0), (22.0, -4.0), (40.0, -8.0), (24.0, -24.0)] {
        parts.push(tube(&[
            ([57.0, 31.0, 0.7 * z], 3.4),
            ([68.0, y, z], 3.0),
            ([73.0, y + 0.2 * (y - 31.0), z], 4.8),
        ]));
    }
    Shape::Blend(parts, 4.0)
}

/// The renal artery, five segments from it, and two generations of twigs.
fn arteries(side: f32) -> Vec<Shape> {
    let at = |p: [f32; 3]| Vec3::from(place(side, p));
    let (hilum, start) = (at([42.0, 24.0, 2.0]), Vec3::new(0.0, 12.0, 8.0));
    let mut tubes = vec![Shape::Tube(vec![
        (start, 4.8),
        (start.lerp(hilum, 0.5) - Vec3::Y, 4.2),
        (hilum, 3.8),
    ])];
    for (n, height) in (0..).zip(SEGMENTS) {
        let front = if n % 2 == 0 { 21.0 } else { 41.0 };
        let (middle, end) =
            (at([53.0, 0.5 * (front + 26.0), 0.5 * height]), at([66.0, front, height]));
        tubes.push(Shape::Tube(vec![(hilum, 3.0), (middle, 2.5), (end, 2.1)]));
        grow(
            &mut tubes,
            end,
            (end - middle).normalize(),
            2.0,
            2,
            hash(n, 1 + u32::from(side > 0.0)),
        );
    }
    tubes
}

/// Two twigs from a point, bent apart, each with its own two.
fn grow(tubes: &mut Vec<Shape>, from: Vec3, along: Vec3, radius: f32, generations: u32, seed: u32) {
    let random = |n| hash(n, seed) as f32 / u32::MAX as f32 - 0.5;
    let across =
        along.cross(Vec3::new(random(0), random(1), random(2) + 1.0)).normalize_or(Vec3::X);
    for (n, bend) in [(3, 0.75), (4, -0.75)] {
        let turned = (along + (bend + 0.4 * random(n)) * across).normalize();
        let to = from + (9.5 - 2.5 * (2 - generations) as f32) * turned;
        let thinner = 0.8 * radius;
        tubes.push(Shape::Tube(vec![(from, radius), (to, thinner)]));
        if generations > 1 {
            grow(tubes, to, turned, thinner, generations - 1, hash(n, seed));
        }
    }
}
