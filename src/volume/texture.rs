//! A volume as the texture that kernels look it up in: its size is not bound by a binding's.
//!
//! Under linear filtering a look-up wants eight voxels, which is what most of the time of tracing
//! would go to. So each texel holds a square of four, and two do. Pairs of voxels take half of that
//! memory and were slower.

use std::borrow::Cow;

use super::{Volume, Voxels};
use crate::error::{Error, Result};
use crate::gpu::Gpu;

/// Bytes that squares of voxels may take; a larger volume lies voxel by voxel, in a quarter of
/// them.
pub const MAX_SQUARES: u64 = 1 << 30;

/// Bytes of a volume whose texels are squares.
pub(crate) fn bytes_of_squares(volume: &Volume) -> u64 {
    let bytes = match volume.voxels() {
        Voxels::U8(all) => size_of_val(&all[..]),
        Voxels::U16(all) => size_of_val(&all[..]),
        Voxels::F32(all) => size_of_val(&all[..]),
    };
    4 * bytes as u64
}

/// A volume on the device.
pub(crate) struct Uploaded {
    /// As kernels see it.
    pub view: wgpu::TextureView,
    /// How many bytes it takes.
    pub bytes: u64,
}

/// Uploads a volume, voxel by voxel or in squares.
///
/// # Errors
/// It is too large for the adapter.
pub(crate) fn upload(gpu: &Gpu, volume: &Volume, squares: bool) -> Result<Uploaded> {
    let [width, height, depth] = volume.size();
    if volume.size().iter().any(|&n| n > gpu.max_edge()) {
        return Err(Error::capacity(
            "volume",
            format!(
                "a volume of {width}x{height}x{depth} voxels exceeds the adapter's limit of {} along \
                 an axis; resample it",
                gpu.max_edge()
            ),
        ));
    }
    let format = match (volume.voxels(), squares) {
        (Voxels::U8(_), false) => wgpu::TextureFormat::R8Uint,
        (Voxels::U16(_), false) => wgpu::TextureFormat::R16Uint,
        (Voxels::F32(_), false) => wgpu::TextureFormat::R32Float,
        (Voxels::U8(_), true) => wgpu::TextureFormat::Rgba8Uint,
        (Voxels::U16(_), true) => wgpu::TextureFormat::Rgba16Uint,
        (Voxels::F32(_), true) => wgpu::TextureFormat::Rgba32Float,
    };
    let layer = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
    let texture = gpu.device().create_texture(&wgpu::TextureDescriptor {
        label: Some("volume"),
        size: wgpu::Extent3d { depth_or_array_layers: depth, ..layer },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D3,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    gpu.check("volume")?;
    let mut bytes = 0;
    for z in 0..depth {
        let mut slab = volume.slab(z as usize);
        if squares {
            slab = Cow::Owned(squared(&slab, [width, height].map(|n| n as usize)));
        }
        bytes += slab.len() as u64;
        gpu.queue().write_texture(
            wgpu::TexelCopyTextureInfo {
                texture: &texture,
                mip_level: 0,
                origin: wgpu::Origin3d { x: 0, y: 0, z },
                aspect: wgpu::TextureAspect::All,
            },
            &slab,
            wgpu::TexelCopyBufferLayout {
                offset: 0,
                bytes_per_row: Some((slab.len() / height as usize) as u32),
                rows_per_image: None,
            },
            layer,
        );
    }
    gpu.check("volume")?;
    Ok(Uploaded { view: texture.create_view(&Default::default()), bytes })
}

/// Each voxel of a slab with those at x + 1, at y + 1 and at both, or the last there is.
fn squared(slab: &[u8], [width, height]: [usize; 2]) -> Vec<u8> {
    let bytes = slab.len() / (width * height);
    let mut squares = Vec::with_capacity(4 * slab.len());
    for y in 0..height {
        for x in 0..width {
            for [dx, dy] in [[0, 0], [1, 0], [0, 1], [1, 1]] {
                let [x, y] = [(x + dx).min(width - 1), (y + dy).min(height - 1)];
                let at = (y * width + x) * bytes;
                squares.extend_from_slice(&slab[at..at + bytes]);
            }
        }
    }
    squares
}

#[cfg(test)]
mod tests {
    use super::squared;

    #[test]
    fn squares_end_with_the_slab() {
        // Voxels of two bytes: 3 x 2 of them.
        let slab: Vec<u8> = (0..6).flat_map(|v| [v, 10 + v]).collect();
        let squares = squared(&slab, [3, 2]);
        let texel =
            |i: usize| squares[8 * i..8 * i + 8].iter().step_by(2).copied().collect::<Vec<_>>();
        assert_eq!(texel(0), [0, 1, 3, 4]);
        assert_eq!(texel(2), [2, 2, 5, 5]);
        assert_eq!(texel(5), [5, 5, 5, 5]);
        assert!(squares.chunks(2).all(|v| v[1] == v[0] + 10));
    }
}
