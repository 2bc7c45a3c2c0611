//! A scene and its volume: loading it, shrinking both together, and whether they fit.

use super::resolved::met;
use super::{Method, Scale, Scene, VolumeSource};
use crate::error::{Error, Result};
use crate::transfer::Table;
use crate::volume::{self, Volume};

impl Scene {
    /// Shrinks the scene: its edges (image, phantom) to a half or a quarter, its photons
    /// with the area of the image, and rays and samples with its edge.
    pub fn scale(&mut self, scale: Scale) {
        let by = match scale {
            Scale::Small => 4,
            Scale::Medium => 2,
            Scale::Full => return,
        };
        let shrunk = |n: u32, least: u32| (n / by).max(least.min(n));
        self.camera.width = shrunk(self.camera.width, 64);
        self.camera.height = shrunk(self.camera.height, 64);
        if let VolumeSource::Phantom { size, .. } = &mut self.volume {
            *size = shrunk(*size, 32);
        }
        let settings = &mut self.settings;
        settings.photons = (settings.photons / u64::from(by * by)).max(1);
        settings.rays = shrunk(settings.rays, 1);
        settings.samples = shrunk(settings.samples, 1);
    }
}

impl VolumeSource {
    /// Reads the file, or builds the phantom.
    ///
    /// # Errors
    /// Those of the reader, or of the phantom.
    pub fn load(&self) -> Result<Volume> {
        match self {
            Self::File(path) => volume::load(path),
            Self::Phantom { phantom, size } => volume::phantom::build(*phantom, *size),
        }
    }
}

/// Collisions per smallest voxel spacing beyond which a photon would not arrive in good time.
const MAX_COLLISIONS_PER_VOXEL: f64 = 64.0;

/// March steps that a camera may be away: over 2^20 single precision places the samples of its
/// rays no better than to an eighth of a step.
const MAX_STEPS_AWAY: f64 = 1_048_576.0;

impl Scene {
    /// Refuses a scene that would show nothing of its volume, or take forever to.
    ///
    /// # Errors
    /// No material has extinction or emission anywhere in the data's range; the photon map
    /// has no light; the majorant, the gather radius or the distance of the camera is out of
    /// proportion to the volume; the camera is not placed yet.
    pub fn check_against(&self, volume: &Volume) -> Result<()> {
        let [low, high] = volume.range();
        let most = MAX_COLLISIONS_PER_VOXEL / volume.spacing().min_element();
        if let Some(majorant) = self.settings.majorant.filter(|&m| m > most) {
            return Err(Error::setting(format!(
                "`majorant` is {majorant} per mm: over {most} the voxels of this volume are opaque \
                 many times over; lower it, or leave it out"
            )));
        }
        if self.lights.is_empty() && self.settings.method == Method::PhotonMap {
            return Err(Error::setting(
                "the scene has no light, and the photon map starts from one: add a [[light]], of \
                 no power if need be, or use `--method reference`",
            ));
        }
        let diagonal = volume.extent().length();
        if let Some(radius) = self.settings.radius.filter(|&r| r > diagonal) {
            return Err(Error::setting(format!(
                "`radius` is {radius} mm: the whole volume measures {diagonal:.3} mm; lower it"
            )));
        }
        let eye = volume.local_from_world().transform_point3(self.camera.view()?.origin);
        let away = eye.distance(volume.extent() / 2.0);
        let farthest = MAX_STEPS_AWAY * self.settings.step * volume.spacing().min_element();
        if away > farthest {
            return Err(Error::setting(format!(
                "the camera is {away:.0} mm from the volume: over {farthest:.0} mm the samples along \
                 its rays cannot be told apart; move it nearer, or raise `fov_deg` or `step`"
            )));
        }
        self.check_labels(volume)?;
        let domain = self.domain(volume);
        let table = Table::build(&self.materials, &domain, None);
        if met(&domain, volume).any(|entry| !table.is_empty_entry(entry)) {
            return Ok(());
        }
        Err(Error::setting(format!(
            "the transfer function is empty: no material has extinction or emission over the \
             data's range of {low} to {high}; check the windows (`photogram info` shows the histogram)"
        )))
    }
}
