//! A trunk from the collar to the hips, contrast in the left heart and aorta.

use glam::Vec3;

use super::shape::Shape;
use super::{AIR, Layer, Plan, Tissue};

const LUNGS: Tissue = Tissue::new("lungs", -900.0, -700.0);
const SKIN: Tissue = Tissue::new("skin", -180.0, -20.0);
const SOFT: Tissue = Tissue::new("soft tissue", 0.0, 100.0);
const MARROW: Tissue = Tissue::new("marrow", 140.0, 230.0);
const VESSELS: Tissue = Tissue::new("vessels", 280.0, 480.0);
const BONE: Tissue = Tissue::new("bone", 700.0, 1500.0);

pub(super) const TISSUES: [Tissue; 6] = [LUNGS, SKIN, SOFT, MARROW, VESSELS, BONE];

/// Skin with the fat beneath it, and cortical bone, mm.
const SKIN_DEPTH: f32 = 7.0;
const CORTEX: f32 = 3.2;

/// Half the size of the volume, mm.
const HALF: Vec3 = Vec3::new(176.0, 126.0, 210.0);

/// The chest's cage: half widths of an ellipsoid on which the ribs lie.
const CAGE: Vec3 = Vec3::new(134.0, 88.0, 250.0);
const CAGE_CENTRE: f32 = -30.0;

pub(super) fn plan() -> Plan {
    let body = Shape::Blend(
        vec![
            Shape::ellipsoid([0.0, 0.0, 60.0], [158.0, 110.0, 260.0]),
            Shape::ellipsoid([0.0, 4.0, -230.0], [164.0, 108.0, 190.0]),
        ],
        60.0,
    );
    let mut layers = vec![Layer::shells(body, [(0.0, SKIN), (SKIN_DEPTH, SOFT)])];
    for side in [-1.0, 1.0] {
        let x = |x: f32| side * x;
        layers.push(Layer::solid(
            LUNGS,
            Shape::Blend(
                vec![
                    Shape::ellipsoid([x(70.0), 8.0, 65.0], [48.0, 64.0, 78.0]),
                    Shape::ellipsoid([x(58.0), 8.0, 115.0], [38.0, 48.0, 72.0]),
                ],
                20.0,
            ),
        ));
    }
    layers.extend([
        // Heart: wall and chambers.
        Layer::shells(
            Shape::tube([([4.0, -16.0, 78.0], 42.0), ([36.0, -34.0, 36.0], 32.0)]),
            [(0.0, SOFT), (13.0, VESSELS)],
        ),
    ]);
    layers.extend(vessels().map(|points| Layer::solid(VESSELS, Shape::tube(points))));
    layers.extend((0..14).flat_map(|n| vertebra(-196.0 + 29.5 * n as f32)));
    layers.extend((0..11).flat_map(|n| [-1.0, 1.0].map(|side| Layer::solid(BONE, rib(n, side)))));
    layers.push(Layer::shells(
        Shape::block([-17.0, -92.0, 40.0], [17.0, -79.0, 168.0], 5.0),
        [(0.0, BONE), (CORTEX, MARROW)],
    ));
    for side in [-1.0, 1.0] {
        let x = |x: f32| side * x;
        // Crest of the hip bone, and collar bone.
        layers.push(Layer::shells(
            Shape::tube([
                ([x(26.0), 66.0, -178.0], 12.0),
                ([x(72.0), 62.0, -142.0], 9.0),
                ([x(108.0), 30.0, -128.0], 8.0),
                ([x(122.0), -14.0, -142.0], 8.5),
                ([x(112.0), -52.0, -172.0], 8.0),
                ([x(98.0), -60.0, -204.0], 9.0),
            ]),
            [(0.0, BONE), (CORTEX, MARROW)],
        ));
        layers.push(Layer::solid(
            BONE,
            Shape::tube([
                ([x(16.0), -80.0, 172.0], 8.0),
                ([x(60.0), -76.0, 184.0], 6.5),
                ([x(118.0), -46.0, 190.0], 7.0),
            ]),
        ));
    }
    Plan { bounds: [-HALF, HALF], air: AIR, noise: 8.0, labels: false, layers }
}

/// Rib `n` from the spine, round the cage, towards the breast bone.
fn rib(n: u32, side: f32) -> Shape {
    const POINTS: u32 = 12;
    let back = 178.0 - 24.0 * n as f32;
    // The lower ones end early and fall less.
    let (reach, fall) = if n < 8 { (0.93, 48.0) } else { (0.93 - 0.16 * (n - 7) as f32, 44.0) };
    let points = (0..=POINTS).map(|step| {
        let t = step as f32 / POINTS as f32;
        // From the back (+y) round the side to the front.
        let (sin, cos) = f32::sin_cos((0.09 + t * (reach - 0.09)) * std::f32::consts::PI);
        let z = back - fall * (t * reach) * (2.0 - t * reach);
        let height = (z - CAGE_CENTRE) / CAGE.z;
        let scale = (1.0 - height * height).max(0.1).sqrt();
        // Narrower again at the collar, as a barrel is.
        (Vec3::new(side * CAGE.x * scale * sin, CAGE.y * scale.max(0.8) * cos, z), 4.6 + 0.8 * t)
    });
    Shape::Tube(points.collect())
}

/// A vertebra: body, arch, and processes around the canal.
fn vertebra(z: f32) -> Vec<Layer> {
    let mut layers = vec![Layer::shells(
        // Tilted: an end plate in the plane of the voxels would be one sheet of partial volume.
        Shape::rod([0.0, 50.8, z - 11.5], [0.0, 53.2, z + 11.5], 19.0),
        [(0.0, BONE), (CORTEX, MARROW)],
    )];
    let arch = [
        Shape::tube([
            ([-12.0, 66.0, z], 4.2),
            ([-12.0, 80.0, z - 2.0], 4.2),
            ([0.0, 88.0, z - 4.0], 4.5),
        ]),
        Shape::tube([
            ([12.0, 66.0, z], 4.2),
            ([12.0, 80.0, z - 2.0], 4.2),
            ([0.0, 88.0, z - 4.0], 4.5),
        ]),
        Shape::tube([([0.0, 88.0, z - 4.0], 4.5), ([0.0, 99.0, z - 12.0], 3.6)]),
        Shape::tube([([-12.0, 78.0, z], 4.2), ([-31.0, 83.0, z + 2.0], 3.8)]),
        Shape::tube([([12.0, 78.0, z], 4.2), ([31.0, 83.0, z + 2.0], 3.8)]),
    ];
    layers.extend(arch.map(|shape| Layer::solid(BONE, shape)));
    layers
}

/// Aorta with arch, its branches, and the iliac arteries.
fn vessels() -> impl Iterator<Item = Vec<([f32; 3], f32)>> {
    let aorta = vec![
        ([6.0, -14.0, 90.0], 14.0),
        ([-4.0, -26.0, 120.0], 14.0),
        ([-2.0, -20.0, 142.0], 13.5),
        ([8.0, 0.0, 152.0], 13.0),
        ([18.0, 16.0, 142.0], 12.0),
        ([18.0, 22.0, 110.0], 11.5),
        ([14.0, 18.0, 20.0], 10.5),
        ([6.0, 16.0, -60.0], 9.5),
        ([3.0, 16.0, -112.0], 9.0),
    ];
    let mirrored = [-1.0, 1.0].into_iter().flat_map(|side| {
        let x = |x: f32| side * x;
        [
            // Iliac, its inner branch, renal.
            vec![
                ([3.0, 16.0, -110.0], 7.5),
                ([x(22.0), 14.0, -138.0], 6.8),
                ([x(44.0), 6.0, -166.0], 6.2),
                ([x(68.0), -24.0, -230.0], 5.6),
            ],
            vec![
                ([x(36.0), 9.0, -156.0], 4.6),
                ([x(42.0), 34.0, -184.0], 4.2),
                ([x(36.0), 40.0, -230.0], 3.8),
            ],
            vec![
                ([8.0, 17.0, -30.0], 4.6),
                ([x(36.0), 26.0, -36.0], 4.2),
                ([x(66.0), 36.0, -32.0], 3.8),
            ],
            // Carotid and subclavian.
            vec![
                ([4.0, -8.0, 152.0], 5.5),
                ([x(16.0), -8.0, 178.0], 5.0),
                ([x(24.0), -2.0, 230.0], 4.6),
            ],
            vec![
                ([x(18.0), -6.0, 172.0], 4.8),
                ([x(52.0), -18.0, 192.0], 4.8),
                ([x(104.0), -10.0, 178.0], 4.4),
            ],
        ]
    });
    let front = [
        vec![([11.0, 14.0, 2.0], 4.6), ([8.0, -10.0, 0.0], 4.4), ([34.0, -18.0, 8.0], 3.8)],
        vec![([9.0, 14.0, -14.0], 4.6), ([6.0, -12.0, -34.0], 4.2), ([-4.0, -18.0, -84.0], 3.6)],
        vec![([8.0, -10.0, 0.0], 4.2), ([-30.0, -16.0, 6.0], 3.8), ([-52.0, -20.0, 20.0], 3.4)],
    ];
    std::iter::once(aorta).chain(mirrored.collect::<Vec<_>>()).chain(front)
}
