//! The composite of segments, H(4): the light of a ray's segments, each seen through those before
//! it, and behind them the background.

use std::sync::Arc;

use crate::error::Result;
use crate::field::SegmentLight;
use crate::film::Image;
use crate::gpu::Gpu;
use crate::gpu::kernel::Kernel;
use crate::gpu::layout::shared_struct;
use crate::scene::Scene;

shared_struct! {
    /// What the composite kernel is told.
    pub struct CompositeParams {
        /// Radiance behind the volume.
        pub background: [f32; 3],
        /// Pixels of the band.
        pub pixels: u32,
        /// The band's first pixel in the film.
        pub first_pixel: u32,
        /// Segments of a ray.
        pub segments: u32,
        /// Weight of this ray in the film.
        pub weight: f32,
        /// 1 where the film begins with this ray.
        pub fresh: u32,
        /// Scale of the integer sums.
        pub scale: f32,
        /// 1 where all pixels are put together, not only those that were touched.
        pub all: u32,
        /// Keeps the size a multiple of 16.
        pub pad0: u32,
        /// The same.
        pub pad1: u32,
    }
}

/// The film, and what puts segments together there.
pub struct Composite {
    size: [u32; 2],
    film: wgpu::Buffer,
    /// Radiance behind the volume.
    pub background: [f32; 3],
    /// The background that the film has.
    painted: Option<[f32; 3]>,
    kernel: Arc<Kernel>,
}

impl Composite {
    /// An empty film of the scene's size, for segments that keep their light so.
    ///
    /// # Errors
    /// The film does not fit a binding; the memory is refused.
    pub fn new(gpu: &Gpu, scene: &Scene, light: SegmentLight) -> Result<Self> {
        let size = [scene.camera.width, scene.camera.height];
        let pixels = size.iter().map(|&n| n as usize).product();
        let flags: &[_] = match light {
            SegmentLight::Sums { .. } => &["points"],
            SegmentLight::Colour => &[],
        };
        Ok(Self {
            size,
            film: gpu.buffer::<[f32; 4]>("film", pixels)?,
            background: scene.background.as_vec3().to_array(),
            painted: None,
            kernel: gpu.kernel("composite", flags)?,
        })
    }

    /// Whether the film has another background, or none.
    pub fn repaints(&self) -> bool {
        self.painted != Some(self.background)
    }

    /// All pixels have the background that there is.
    pub fn all_painted(&mut self) {
        self.painted = Some(self.background);
    }

    /// Puts the segments of a band's pixels together, and marks none of these as touched.
    ///
    /// # Errors
    /// The device failed.
    pub fn record(
        &self,
        gpu: &Gpu,
        segments: &wgpu::Buffer,
        touched: &wgpu::Buffer,
        params: CompositeParams,
    ) -> Result<()> {
        let params = CompositeParams { background: self.background, ..params };
        let bindings = [
            ("segments", segments.into()),
            ("film", (&self.film).into()),
            ("touched", touched.into()),
        ];
        let mut stage = gpu.stage("composite");
        stage.dispatch(&self.kernel, params.pixels.into(), &bindings, &params)?;
        stage.clear(touched);
        stage.finish()
    }

    /// The image as it stands.
    ///
    /// # Errors
    /// The device failed.
    pub fn image(&self, gpu: &Gpu) -> Result<Image> {
        let film = gpu.read::<[f32; 4]>("film", &self.film)?;
        let [width, height] = self.size;
        Ok(Image { width, height, rgb: film.into_iter().map(|[r, g, b, _]| [r, g, b]).collect() })
    }
}
