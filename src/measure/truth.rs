//! What pictures are judged by.

use crate::error::Result;
use crate::film::Image;
use crate::film::metrics::Metrics;
use crate::gpu::{Gpu, Progress};
use crate::render::render;
use crate::scene::{Method, Scene};
use crate::split::Split;
use crate::volume::Volume;

/// A path-traced picture, and what its noise adds to an error.
pub(super) struct Truth {
    image: Image,
    noise: f64,
}

impl Truth {
    /// Traced with so many samples a pixel.
    pub fn of(
        gpu: &Gpu,
        scene: &Scene,
        volume: &Volume,
        samples: u32,
        progress: &mut Progress,
    ) -> Result<Self> {
        let mut traced = scene.clone();
        (traced.settings.method, traced.settings.samples) = (Method::Reference, samples);
        let rendered = render(gpu, &traced, volume, &Split::default(), progress)?;
        let image = rendered.image;
        // What a picture that is one standard error off would have.
        let mut off = image.clone();
        for (pixel, error) in off.rgb.iter_mut().zip(rendered.error.iter().flat_map(|e| &e.rgb)) {
            pixel.iter_mut().zip(error).for_each(|(value, error)| *value += error);
        }
        let noise = Metrics::of(&off, &image)?.rel_mse;
        Ok(Self { image, noise })
    }

    /// The relMSE of an image, less what the noise of this one adds.
    pub fn error_of(&self, image: &Image) -> Result<f64> {
        Ok(Metrics::of(image, &self.image)?.rel_mse - self.noise)
    }
}
