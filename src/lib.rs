//! Photogram renders volume data with global illumination by volumetric photon mapping
//! on the GPU.

pub mod bits;
pub mod device_scene;
pub mod error;
mod fault;
pub mod field;
pub mod files;
pub mod film;
pub mod gpu;
pub mod history;
pub mod kernels;
pub mod measure;
pub mod photon;
pub mod reference;
pub mod render;
pub mod scene;
pub mod segment;
pub mod split;
pub mod transfer;
pub mod update;
pub mod volume;

pub use error::{Error, Result};
pub use kernels::open;
