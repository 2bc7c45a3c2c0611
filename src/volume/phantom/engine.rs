//! The top of an engine with two cylinders in a row along x, valves up (+z).

use glam::Vec3;

use super::shape::Shape;
use super::{AIR, Layer, Plan, Tissue};

const CASING: Tissue = Tissue::new("casing", 500.0, 1100.0);
const BLOCK: Tissue = Tissue::new("block", 1600.0, 2400.0);
const VALVES: Tissue = Tissue::new("valves", 3000.0, 3800.0);

pub(super) const TISSUES: [Tissue; 3] = [CASING, BLOCK, VALVES];

/// Where the cylinders stand, and the valves beside their axis, mm.
const CYLINDERS: [f32; 2] = [-29.0, 29.0];
const VALVE_OFFSET: f32 = 10.5;

pub(super) fn plan() -> Plan {
    let hollow = |low: [f32; 3], high: [f32; 3], wall: f32| {
        let inner = |p: [f32; 3], by: f32| p.map(|x| x + by);
        [
            Layer::solid(CASING, Shape::block(low, high, 6.0)),
            Layer::hole(Shape::block(inner(low, wall), inner(high, -wall), 4.0)),
        ]
    };
    let mut layers = Vec::new();
    // Valve cover above, crank case below; the block covers their inner ends.
    layers.extend(hollow([-60.0, -32.0, 30.0], [60.0, 32.0, 70.0], 3.6));
    layers.extend(hollow([-66.0, -40.0, -70.0], [66.0, 40.0, -30.0], 3.6));
    layers.extend([
        Layer::solid(BLOCK, Shape::block([-62.0, -34.0, -48.0], [62.0, 34.0, 20.0], 4.0)),
        // Head, with its flange, and the lid of the crank case.
        Layer::solid(BLOCK, Shape::block([-66.0, -39.0, 12.0], [66.0, 39.0, 22.0], 2.0)),
        Layer::solid(BLOCK, Shape::block([-58.0, -30.0, 20.0], [58.0, 30.0, 40.0], 3.0)),
        Layer::solid(BLOCK, Shape::block([-70.0, -44.0, -52.0], [70.0, 44.0, -44.0], 2.0)),
    ]);
    for x in CYLINDERS {
        layers.extend([
            // Water jacket, cylinder wall, bore.
            Layer::hole(Shape::rod([x, 0.0, -32.0], [x, 0.0, 6.0], 28.0)),
            Layer::solid(BLOCK, Shape::rod([x, 0.0, -34.0], [x, 0.0, 8.0], 24.0)),
            Layer::hole(Shape::rod([x, 0.0, -60.0], [x, 0.0, 18.0], 20.0)),
            // Piston with its pin.
            Layer::solid(BLOCK, Shape::rod([x, 0.0, -24.0], [x, 0.0, -16.0], 18.6)),
            Layer::solid(BLOCK, Shape::rod([x - 14.0, 0.0, -30.0], [x + 14.0, 0.0, -30.0], 4.0)),
        ]);
        for (side, out) in [(-VALVE_OFFSET, -60.0), (VALVE_OFFSET, 60.0)] {
            let x = x + side;
            layers.extend([
                // Port to one side, the guide's clearance, seat.
                Layer::hole(Shape::tube([
                    ([x, 0.0, 18.0], 7.5),
                    ([x, 0.0, 27.0], 6.5),
                    ([x, out, 31.0], 6.5),
                ])),
                // Stem, disc, spring's plate.
                Layer::solid(VALVES, Shape::rod([x, 0.0, 18.0], [x, 0.0, 60.0], 3.4)),
                Layer::solid(VALVES, Shape::rod([x, 0.0, 12.5], [x, 0.0, 18.0], 9.0)),
                Layer::solid(VALVES, Shape::rod([x, 0.0, 52.0], [x, 0.0, 57.0], 7.0)),
            ]);
        }
    }
    // Cam shafts.
    for y in [-17.0, 17.0] {
        layers.push(Layer::solid(VALVES, Shape::rod([-52.0, y, 55.0], [52.0, y, 55.0], 6.0)));
    }
    for x in [-62.0, -20.5, 20.5, 62.0] {
        for y in [-36.0, 36.0] {
            layers.push(Layer::hole(Shape::rod([x, y, -56.0], [x, y, 26.0], 2.6)));
        }
    }
    for x in [-58.0, 0.0, 58.0] {
        layers.push(Layer::hole(Shape::rod([x, -50.0, 0.0], [x, 50.0, 0.0], 3.4)));
    }
    Plan {
        bounds: [Vec3::new(-76.0, -50.0, -76.0), Vec3::new(76.0, 50.0, 76.0)],
        air: AIR,
        noise: 20.0,
        labels: false,
        layers,
    }
}
