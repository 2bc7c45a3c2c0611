//! A room that is open to the front (-y). Seen from there, +x is to the right.

use glam::Vec3;

use super::shape::Shape;
use super::{Layer, Plan, Tissue};

const MEDIUM: Tissue = Tissue::new("medium", 24.0, 40.0);
const BOX: Tissue = Tissue::new("box", 56.0, 72.0);
const RED: Tissue = Tissue::new("red", 88.0, 104.0);
const GREEN: Tissue = Tissue::new("green", 120.0, 136.0);
const WHITE: Tissue = Tissue::new("white", 152.0, 168.0);
const SPHERE: Tissue = Tissue::new("sphere", 184.0, 200.0);

pub(super) const TISSUES: [Tissue; 6] = [MEDIUM, BOX, RED, GREEN, WHITE, SPHERE];

/// Half the room within its walls, and with them, mm. Multiples of 8, so that
/// walls have whole voxels at every size that is a multiple of 16.
const ROOM: f32 = 48.0;
const WALL: f32 = 56.0;

pub(super) fn plan() -> Plan {
    let (r, w) = (ROOM, WALL);
    let block = |tissue, low, high| Layer::solid(tissue, Shape::block(low, high, 0.0));
    Plan {
        bounds: [Vec3::splat(-64.0), Vec3::splat(64.0)],
        air: 0.0,
        noise: 1.0,
        labels: true,
        layers: vec![
            // Into the walls, which cover it, so that nothing is left between.
            block(MEDIUM, [-w, -r, -w], [w, w, w]),
            // Floor, ceiling, back.
            block(WHITE, [-w, -r, -w], [w, w, -r]),
            block(WHITE, [-w, -r, r], [w, w, w]),
            block(WHITE, [-w, r, -w], [w, w, w]),
            block(RED, [-w, -r, -r], [-r, r, r]),
            block(GREEN, [r, -r, -r], [w, r, r]),
            Layer::solid(SPHERE, Shape::ellipsoid([-20.0, 12.0, -30.0], [18.0; 3])),
            block(BOX, [8.0, -24.0, -r], [40.0, 8.0, -8.0]),
        ],
    }
}
