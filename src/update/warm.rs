//! Warming: what updates of a scene will run is compiled and run once beforehand, on a thumbnail of
//! its volume, so that the first edit takes as long as the second.
//!
//! Drivers compile a kernel when it is first asked for, or when it first runs. Kernels outlive the
//! frame that asked for them.

use super::PhotonFrame;
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::gpu::{Gpu, Progress};
use crate::scene::Scene;
use crate::split::Split;
use crate::volume::Volume;

/// Voxels along the edges of the thumbnail, pixels of its image, and photons.
const VOXELS: u32 = 16;
const PIXELS: u32 = 8;
const PHOTONS: u64 = 256;

/// Runs all kernels that updates of a settled scene need.
///
/// # Errors
/// The device failed.
pub fn warm(gpu: &Gpu, scene: &Scene, volume: &Volume, progress: &mut Progress) -> Result<()> {
    let small = volume.thumbnail(VOXELS);
    let mut home = scene.clone();
    (home.camera.width, home.camera.height) = (PIXELS, PIXELS);
    let settings = &mut home.settings;
    (settings.photons, settings.rays) = (PHOTONS.min(settings.photons), 1);
    // No more cells than a thumbnail needs.
    let coarsest = small.spacing().min_element();
    settings.radius = settings.radius.map(|radius| radius.max(coarsest));
    let (mut thinner, mut darker, mut dimmer) = (home.clone(), home.clone(), home.clone());
    thinner.materials.iter_mut().for_each(|m| m.extinction *= 0.5);
    darker.materials.iter_mut().for_each(|m| m.colour *= 0.5);
    dimmer.lights.iter_mut().for_each(|light| light.emitted *= 0.5);
    let split = Split { anew: Some(false), ..Default::default() };
    let device = DeviceScene::new(gpu, &home, &small)?;
    let mut frame = PhotonFrame::new(gpu, &home, device, &split)?;
    let (silent, edits) = (&mut Progress::silent(), [&thinner, &home, &darker, &dimmer]);
    let total = edits.len() as u64 + 1;
    progress.at("kernels", 0, total);
    frame.rebuild(gpu, &split, silent)?;
    for (done, edited) in (1..).zip(edits) {
        progress.at("kernels", done, total);
        frame.edit(gpu, edited, &split)?;
        frame.update(gpu, &split, silent)?;
    }
    progress.at("kernels", total, total);
    gpu.wait("kernels")?;
    // What this took is nobody's.
    gpu.take_timings().map(|_| ())
}
