//! Macro-cells: the values that a block of voxels can have, whatever the materials.
//!
//! Each cell of [`CELL_EDGE`]³ voxels knows the closed range of values that the volume
//! filter can produce in it: from the least to the greatest of its voxels and of those one
//! around it. It depends on the data alone.

use rayon::prelude::*;

use super::Volume;

/// Voxels along the edge of a macro-cell.
pub const CELL_EDGE: u32 = 8;

/// The macro-cells of a volume, x fastest.
#[derive(Clone, Debug)]
pub struct MacroCells {
    /// Cells along each axis.
    pub counts: [u32; 3],
    /// Least and greatest of each cell, as [`Volume::number`] gives them.
    pub ranges: Vec<[f32; 2]>,
}

impl MacroCells {
    /// Looks at every voxel once, and at those on borders again.
    pub fn of(volume: &Volume) -> Self {
        let counts = volume.size().map(|n| n.div_ceil(CELL_EDGE));
        let total: usize = counts.iter().map(|&n| n as usize).product();
        let ranges = (0..total).into_par_iter().map(|cell| range(volume, counts, cell));
        Self { counts, ranges: ranges.collect() }
    }
}

fn range(volume: &Volume, counts: [u32; 3], cell: usize) -> [f32; 2] {
    let (nx, ny) = (counts[0] as usize, counts[1] as usize);
    let at = [cell % nx, cell / nx % ny, cell / (nx * ny)].map(|c| c as u32 * CELL_EDGE);
    let span = |axis: usize| {
        at[axis].saturating_sub(1)..(at[axis] + CELL_EDGE + 1).min(volume.size()[axis])
    };
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for k in span(2) {
        for j in span(1) {
            for i in span(0) {
                let v = volume.number(i, j, k);
                low = low.min(v);
                high = high.max(v);
            }
        }
    }
    [low, high]
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    fn volume(size: [u32; 3], value: impl Fn(u32, u32, u32) -> u16) -> Volume {
        let mut values = Vec::new();
        for k in 0..size[2] {
            for j in 0..size[1] {
                for i in 0..size[0] {
                    values.push(value(i, j, k));
                }
            }
        }
        Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).expect("a sound volume")
    }

    #[test]
    fn a_cell_sees_its_voxels_and_one_around_them() {
        // One bright voxel just outside cell 0, two in from the start of cell 1.
        for (x, seen) in [(7, true), (8, true), (9, false)] {
            let v = volume([20, 9, 8], |i, j, k| if (i, j, k) == (x, 0, 0) { 4095 } else { 0 });
            let cells = MacroCells::of(&v);
            assert_eq!(cells.counts, [3, 2, 1]);
            assert_eq!(cells.ranges[0] == [0.0, 4095.0], seen, "voxel {x}");
            assert_eq!(cells.ranges[1], [0.0, 4095.0]);
            assert_eq!(cells.ranges[5], [0.0, 0.0]);
        }
    }
}
