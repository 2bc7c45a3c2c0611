//! The camera: where it stands, and the rays through its pixels.

use glam::{DAffine3, DVec3, Vec3};

use crate::error::{Error, Result};

/// A pinhole camera. Pixels are square; image row 0 is the top and column 0 the left
/// as the viewer sees them; a pixel is the mean over its square.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Where it stands and looks.
    pub place: CameraPlace,
    /// Points upwards in the image; neither zero nor parallel to the view.
    pub up: DVec3,
    /// Horizontal field of view in degrees, in (0, 180).
    pub fov_deg: f64,
    /// Pixels, 1 to 16384.
    pub width: u32,
    /// Pixels, 1 to 16384.
    pub height: u32,
}

/// Where a camera stands and looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CameraPlace {
    /// In world mm.
    At {
        /// The pinhole.
        origin: DVec3,
        /// Seen in the middle of the image; not the origin.
        target: DVec3,
    },
    /// Looks at the volume's centre; [`Scene::place`](super::Scene::place) turns it into `At`.
    Around {
        /// Direction from the volume's centre towards the camera; any length but zero.
        from: DVec3,
        /// At 1 the bounding sphere just fits into the image, at 2 from half that distance; > 0.
        zoom: f64,
    },
}

/// The rays of a placed camera: through image point (x, y), in pixels from the top left
/// corner, goes `forward + (2x/width - 1) right + (2y/height - 1) down`, not normalised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The pinhole, mm.
    pub origin: DVec3,
    /// Unit vector to the middle of the image.
    pub forward: DVec3,
    /// From there to the middle of the right edge, at distance 1.
    pub right: DVec3,
    /// From there to the middle of the lower edge, at distance 1.
    pub down: DVec3,
}

/// The rays of a placed camera as kernels are told, in mm along the volume's axes: through image
/// point (x, y), in pixels, goes `corner + x/width right + y/height down`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rays {
    /// The pinhole.
    pub origin: [f32; 3],
    /// Direction of the image's upper left corner.
    pub corner: [f32; 3],
    /// Across the whole image.
    pub right: [f32; 3],
    /// Down the whole image.
    pub down: [f32; 3],
    /// Pixels across and down.
    pub size: [u32; 2],
}

impl Camera {
    /// The camera's rays in world space.
    ///
    /// # Errors
    /// [`Error::Setting`] where the camera is not placed yet.
    pub fn view(&self) -> Result<View> {
        let CameraPlace::At { origin, target } = self.place else {
            return Err(Error::setting(
                "the camera is given relative to the volume: place the scene first",
            ));
        };
        let forward = (target - origin).normalize();
        // The world frame is right-handed, so this is the viewer's right.
        let right = forward.cross(self.up).normalize();
        let half = (self.fov_deg.to_radians() / 2.0).tan();
        Ok(View {
            origin,
            forward,
            right: right * half,
            down: forward.cross(right) * half * f64::from(self.height) / f64::from(self.width),
        })
    }

    /// The camera's rays along the volume's axes, to which `local` leads from the world.
    ///
    /// # Errors
    /// [`Error::Setting`] where the camera is not placed yet.
    pub fn rays(&self, local: &DAffine3) -> Result<Rays> {
        let view = self.view()?;
        let vector = |v| local.transform_vector3(v).as_vec3();
        let (forward, right, down): (Vec3, Vec3, Vec3) =
            (vector(view.forward), vector(view.right), vector(view.down));
        Ok(Rays {
            origin: local.transform_point3(view.origin).as_vec3().to_array(),
            corner: (forward - right - down).to_array(),
            right: (2.0 * right).to_array(),
            down: (2.0 * down).to_array(),
            size: [self.width, self.height],
        })
    }
}
