//! Photogram renders volumes, such as CT and MR scans, with global illumination by volumetric photon
//! mapping on the GPU. After an edit of the materials it computes only the light that the edit
//! touched; the picture equals one rendered from nothing bit for bit.
//!
//! ```
//! use photogram::{film, gpu, measure, scene, split, volume};
//! use photogram::volume::phantom::Phantom;
//!
//! # fn main() -> photogram::Result<()> {
//! // A small built-in hand. For a scan: `VolumeSource::File("scan.nii.gz".into())`.
//! let source = scene::VolumeSource::Phantom { phantom: Phantom::Hand, size: 48 };
//! let volume: volume::Volume = source.load()?;
//! // Materials that fit the values; `Scene::load` reads a scene file instead.
//! let (mut scene, _kind) = scene::Scene::for_volume(source, "hand", &volume)?;
//! scene.scale(scene::Scale::Small);
//! scene.settle(&volume);
//!
//! // Opening is `async`, for browsers; any executor will do.
//! let gpu = pollster::block_on(photogram::open(&gpu::AdapterChoice::Best))?;
//! let mut frame = measure::fresh(&gpu, &scene, &volume)?;
//! frame.rebuild(&gpu, &split::Split::default(), &mut gpu::Progress::silent())?;
//!
//! let edit = scene.edit_of("bone.albedo=0.9,0.6,0.2")?;
//! scene.apply(&edit)?;
//! let update = measure::update(&gpu, &mut frame, &scene, &mut gpu::Progress::silent())?;
//! println!("{:.1} % of the photons retraced", update.done.retraced_percent());
//! println!("{:.1} % of the segments computed again", update.done.recomputed_percent());
//! println!("{:.1} ms", update.cost.total);
//! # assert_eq!(update.done.retraced_percent(), 0.0);
//! # assert!((0.1..100.0).contains(&update.done.recomputed_percent()));
//!
//! let picture = std::env::temp_dir().join("edited.png");
//! frame.segments.image(&gpu)?.write(&picture, scene.film, &film::Notes::default())?;
//! # Ok(())
//! # }
//! ```
//!
//! A [`scene::Scene`] says everything that a render needs. [`render::render`] makes one picture.
//! [`update::PhotonFrame`] keeps the light of a scene and takes edits of it; [`measure`] does so with
//! a clock. The modules are listed in the order of the data's way in `ARCHITECTURE.md`.

pub mod bits;
pub mod device_scene;
pub mod error;
mod fault;
pub mod field;
pub mod files;
pub mod film;
pub mod gpu;
pub mod history;
pub mod irradiance;
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
