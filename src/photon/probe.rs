//! Samplers laid open: free flight, phase function, emission, packing and weighing, just as the
//! stages draw them, for the tests that judge them by their densities.

use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::Gpu;
use crate::gpu::layout::shared_struct;

shared_struct! {
    /// What the probe kernel is told; lengths in the volume's frame.
    pub struct ProbeParams {
        /// Where a flight begins.
        pub origin: [f32; 3],
        /// One of [`What`].
        pub what: u32,
        /// Direction of travel.
        pub direction: [f32; 3],
        /// Draws.
        pub count: u32,
        /// Henyey-Greenstein g.
        pub g: f32,
        /// Which light emits.
        pub light: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// Keeps the size a multiple of 16.
        pub pad1: u32,
    }
}

/// What is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum What {
    /// (distance, entry, collided, tentative collisions), (history words as bits).
    Flight = 0,
    /// (direction).
    Phase = 1,
    /// (position), (direction), (power).
    Emission = 2,
    /// (direction), (the same packed and unpacked), (power packed and unpacked; its draw).
    Packing = 3,
    /// (power), (share of 2^18), (the one times the other and 2^(i mod 7)).
    Weighing = 4,
}

/// Draws `params.count` samples; what the three vectors of each are, [`What`] tells.
///
/// # Errors
/// The device failed.
pub fn draw(
    gpu: &Gpu,
    scene: &DeviceScene,
    what: What,
    params: ProbeParams,
) -> Result<[Vec<[f32; 4]>; 3]> {
    let kernel = gpu.kernel("probe", &scene.flags())?;
    let buffer = || gpu.buffer::<[f32; 4]>("probe", params.count as usize);
    let (first, second, third) = (buffer()?, buffer()?, buffer()?);
    let mut bindings = scene.bindings();
    bindings.extend([
        ("first", (&first).into()),
        ("second", (&second).into()),
        ("third", (&third).into()),
    ]);
    let mut stage = gpu.stage("probe");
    let params = ProbeParams { what: what as u32, ..params };
    stage.dispatch(&kernel, params.count.into(), &bindings, &params)?;
    stage.finish()?;
    Ok([gpu.read("probe", &first)?, gpu.read("probe", &second)?, gpu.read("probe", &third)?])
}
