//! Photogram renders volume data with global illumination by volumetric photon mapping
//! on the GPU.
//!
//! Data go through the modules in this order: [`volume`] and [`transfer`] make a
//! [`scene`]; [`photon`] traces its light; [`points`] or [`fluence`] turn it into a
//! light field; [`segment`] looks at that along view rays; [`film`] writes the picture.
//! [`render()`](render::render) is that, one line a stage. [`mod@reference`] is the unbiased path
//! tracer that everything is judged by, with [`metrics`].

pub mod bench;
pub mod composite;
pub mod counter;
pub mod demo;
pub mod dirty;
pub mod error;
pub mod files;
pub mod film;
pub mod fluence;
pub mod frame;
pub mod gpu;
pub mod light;
pub mod light_field;
pub mod measure;
pub mod metrics;
pub mod photon;
pub mod points;
pub mod probe;
pub mod query;
pub mod reference;
pub mod render;
pub mod scene;
pub mod segment;
pub mod transfer;
pub mod update;
pub mod volume;
pub mod work;

pub use error::{Error, Result};
