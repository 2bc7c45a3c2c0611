//! The columns of the table that view rays integrate over, with their sums, as a texture.

use super::SceneParams;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::transfer::{TABLE_ENTRIES, Table};

/// Rows of the texture of columns.
const COLUMN_ROWS: u32 = 6;

/// Row by row a texel of each table entry: extinction times albedo, and extinction; the low words of
/// their sums over the entries below, in [`SceneParams::unit`]; the high words; then the same three of
/// emission, in [`SceneParams::glow_unit`].
pub(super) fn columns_of(table: &Table, params: &SceneParams) -> Vec<[u32; 4]> {
    let mut texels = vec![[0; 4]; COLUMN_ROWS as usize * TABLE_ENTRIES];
    let scattering = |e: usize| {
        let [r, g, b] = table.albedo(e).map(|albedo| albedo * table.extinction[e]);
        [r, g, b, table.extinction[e]]
    };
    let glow = |e: usize| {
        let [r, g, b] = table.emission[e];
        [r, g, b, 0.0]
    };
    let (first, last) = texels.split_at_mut(3 * TABLE_ENTRIES);
    fill_columns(first, params.unit, scattering);
    fill_columns(last, params.glow_unit, glow);
    texels
}

fn fill_columns(rows: &mut [[u32; 4]], unit: f32, of: impl Fn(usize) -> [f32; 4]) {
    let mut below = [0_u64; 4];
    for e in 0..TABLE_ENTRIES {
        let value = of(e);
        rows[e] = value.map(f32::to_bits);
        rows[TABLE_ENTRIES + e] = below.map(|sum| sum as u32);
        rows[2 * TABLE_ENTRIES + e] = below.map(|sum| (sum >> 32) as u32);
        for (sum, value) in below.iter_mut().zip(value) {
            *sum += (f64::from(value) / f64::from(unit)).round() as u64;
        }
    }
}

pub(super) fn column_texture(gpu: &Gpu) -> Result<wgpu::Texture> {
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("columns"),
        size: wgpu::Extent3d {
            width: TABLE_ENTRIES as u32,
            height: COLUMN_ROWS,
            depth_or_array_layers: 1,
        },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::Rgba32Uint,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.check("columns").map(|()| texture)
}
