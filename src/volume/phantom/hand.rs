//! A left hand, raised, palm to the front (-y), fingers up (+z), thumb to -x.

use glam::Vec3;

use super::shape::Shape;
use super::{AIR, Layer, Plan, Tissue};

const SKIN: Tissue = Tissue::new("skin", -180.0, -20.0);
const SOFT: Tissue = Tissue::new("soft tissue", 0.0, 100.0);
const MARROW: Tissue = Tissue::new("marrow", 140.0, 230.0);
const VESSELS: Tissue = Tissue::new("vessels", 280.0, 480.0);
const BONE: Tissue = Tissue::new("bone", 700.0, 1500.0);

pub(super) const TISSUES: [Tissue; 5] = [SKIN, SOFT, MARROW, VESSELS, BONE];

/// Thickness of skin and of cortical bone, mm.
const SKIN_DEPTH: f32 = 2.2;
const CORTEX: f32 = 1.9;

/// Joints of a ray from its base at the wrist to its tip.
const RAYS: [&[[f32; 3]]; 5] = [
    &[[-22.0, -5.0, -50.0], [-41.0, -9.0, -20.0], [-51.0, -10.0, 9.0], [-56.0, -11.0, 30.0]],
    &[
        [-15.0, 0.0, -44.0],
        [-23.0, -1.0, 17.0],
        [-28.0, -1.0, 56.0],
        [-30.0, -4.0, 78.0],
        [-31.0, -7.0, 93.0],
    ],
    &[
        [-4.0, 1.0, -43.0],
        [-5.0, 0.0, 21.0],
        [-6.0, 0.0, 64.0],
        [-6.0, -3.0, 88.0],
        [-6.0, -6.0, 104.0],
    ],
    &[
        [6.0, 1.0, -44.0],
        [12.0, 0.0, 16.0],
        [16.0, 0.0, 56.0],
        [18.0, -3.0, 79.0],
        [19.0, -6.0, 95.0],
    ],
    &[
        [15.0, 0.0, -46.0],
        [27.0, -1.0, 8.0],
        [34.0, -1.0, 38.0],
        [37.0, -4.0, 55.0],
        [39.0, -6.0, 69.0],
    ],
];

/// Radii of the bones of a ray, at the ends and in the shaft, by segment from
/// the metacarpal; the thumb lacks the third.
const BONES: [[f32; 2]; 4] = [[6.2, 4.4], [5.6, 4.0], [4.8, 3.6], [4.0, 3.0]];

/// The carpal bones, centre and radii.
const CARPALS: [([f32; 3], [f32; 3]); 8] = [
    ([-14.0, -1.0, -66.0], [7.5, 6.5, 5.5]),
    ([-1.0, 0.0, -67.0], [6.0, 6.5, 5.5]),
    ([10.0, 0.0, -65.5], [5.5, 6.0, 5.0]),
    ([15.0, -7.0, -62.0], [4.0, 3.8, 4.5]),
    ([-21.0, -3.0, -57.0], [5.5, 5.5, 4.8]),
    ([-12.5, 0.0, -53.5], [4.8, 5.5, 5.0]),
    ([-2.0, 0.0, -54.5], [5.5, 6.5, 6.5]),
    ([9.5, 0.0, -54.0], [6.0, 6.0, 6.0]),
];

pub(super) fn plan() -> Plan {
    let mut layers = vec![Layer::shells(flesh(), [(0.0, SKIN), (SKIN_DEPTH, SOFT)])];
    layers.extend(vessels().map(|points| Layer::solid(VESSELS, Shape::tube(points))));
    layers.extend(
        bones().into_iter().map(|shape| Layer::shells(shape, [(0.0, BONE), (CORTEX, MARROW)])),
    );
    Plan {
        bounds: [Vec3::new(-72.0, -34.0, -116.0), Vec3::new(56.0, 30.0, 116.0)],
        air: AIR,
        noise: 8.0,
        labels: false,
        layers,
    }
}

fn flesh() -> Shape {
    let mut parts = vec![
        // Forearm, flat, cut by the volume's end.
        Shape::tube([([-14.0, -1.0, -150.0], 17.5), ([-9.0, -2.0, -62.0], 15.0)]),
        Shape::tube([([10.0, -1.0, -150.0], 17.5), ([7.0, -2.0, -62.0], 14.0)]),
        // Balls of the thumb and of the little finger.
        Shape::ellipsoid([-25.0, -9.0, -36.0], [13.0, 10.0, 24.0]),
        Shape::ellipsoid([19.0, -7.0, -34.0], [11.0, 10.0, 24.0]),
    ];
    for (ray, joints) in RAYS.iter().enumerate() {
        let radii: &[f32] =
            if ray == 0 { &[12.0, 10.5, 10.0, 8.0] } else { &[12.5, 12.5, 9.2, 8.4, 6.6] };
        let slim = if ray == 4 { 0.86 } else { 1.0 };
        parts.push(Shape::tube(joints.iter().zip(radii).map(|(&p, &r)| (p, r * slim))));
    }
    Shape::Blend(parts, 7.0)
}

fn bones() -> Vec<Shape> {
    let mut shapes = vec![
        // Radius and ulna.
        Shape::tube([
            ([-13.0, 0.0, -150.0], 6.5),
            ([-13.0, 0.0, -92.0], 7.0),
            ([-12.0, 0.0, -82.0], 9.5),
        ]),
        Shape::tube([
            ([11.0, 0.0, -150.0], 5.5),
            ([11.0, 0.0, -86.0], 5.5),
            ([11.0, 0.0, -79.0], 6.5),
        ]),
    ];
    shapes.extend(CARPALS.map(|(centre, radii)| Shape::ellipsoid(centre, radii)));
    for (ray, joints) in RAYS.iter().enumerate() {
        let last = joints.len() - 2;
        for (segment, ends) in joints.windows(2).enumerate() {
            let [head, shaft] = BONES[if segment == last { 3 } else { segment }]
                .map(|r| r * if ray == 4 { 0.88 } else { 1.0 });
            shapes.push(bone(ends[0].into(), ends[1].into(), head, shaft, segment == last));
        }
    }
    shapes
}

/// A long bone between two joints: knuckle ends, a slim shaft, room for
/// cartilage. The last one of a finger ends in a tuft.
fn bone(from: Vec3, to: Vec3, head: f32, shaft: f32, last: bool) -> Shape {
    let along = (to - from).normalize();
    let tip = if last { 0.85 * shaft } else { 0.92 * head };
    let (base, end) = (from + (head + 0.4) * along, to - (tip + 0.4) * along);
    let at = |t: f32| base.lerp(end, t);
    Shape::Tube(vec![(base, head), (at(0.28), shaft), (at(0.72), 0.92 * shaft), (end, tip)])
}

/// Radial and ulnar artery, the arch between them, and two branches a finger.
fn vessels() -> impl Iterator<Item = Vec<([f32; 3], f32)>> {
    const DEEP: f32 = -9.5;
    let trunks = [
        vec![
            ([-17.0, -11.5, -150.0], 2.6),
            ([-17.0, -11.0, -72.0], 2.5),
            ([-22.0, -12.5, -40.0], 2.3),
            ([-17.0, DEEP, -12.0], 2.1),
            ([-4.0, DEEP, -4.0], 2.0),
            ([9.0, DEEP, -8.0], 2.1),
            ([17.0, -11.0, -28.0], 2.3),
            ([13.0, -11.0, -72.0], 2.5),
            ([13.0, -11.5, -150.0], 2.6),
        ],
        vec![
            ([-21.5, -12.0, -40.0], 2.1),
            ([-38.0, -16.0, -18.0], 1.8),
            ([-52.0, -16.0, 8.0], 1.7),
            ([-56.0, -15.5, 24.0], 1.4),
        ],
    ];
    // Where the branch to a finger leaves the arch.
    let roots = [[-17.0, DEEP, -12.0], [-6.0, DEEP, -5.0], [6.0, DEEP, -7.0], [13.0, DEEP, -15.0]];
    let branches = RAYS[1..].iter().zip(roots).flat_map(|(joints, root)| {
        [-1.0, 1.0].map(|side| {
            let beside = |at: usize, away: f32, front: f32| {
                let [x, y, z] = joints[at];
                [x + side * away, y - front, z]
            };
            let [x, y, z] = joints[1];
            vec![
                (root, 1.9),
                ([x, y - 9.0, z - 10.0], 1.8),
                (beside(1, 5.0, 7.0), 1.7),
                (beside(2, 4.6, 5.0), 1.6),
                (beside(3, 4.2, 4.2), 1.5),
                (beside(4, 2.4, 3.0), 1.3),
            ]
        })
    });
    trunks.into_iter().chain(branches.collect::<Vec<_>>())
}
