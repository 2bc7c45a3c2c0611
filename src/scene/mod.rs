//! Scenes: everything a render needs, read from TOML and written back to it.
//!
//! A scene goes through three steps before a kernel sees it: [`Scene::load`] reads
//! and checks the file, [`Scene::settle`] resolves what is said relative to the
//! volume into world millimetres and freezes the majorant and the flux unit, and
//! [`Scene::apply`] makes an edit. Settle first, edit then: an edit never changes
//! what was frozen (law 4).
//!
//! Units: lengths in mm, extinction per mm, angles in degrees, radiance in
//! W/(sr mm²), irradiance in W/mm², intensity in W/sr. Colours are linear RGB.

mod camera;
mod check;
mod edit;
mod place;
mod read;
mod resolved;
mod scan;
mod set;
mod source;
mod toml_file;
mod write;

use std::path::PathBuf;

use glam::DVec3;

use crate::error::{Error, Result};
use crate::volume::phantom::Phantom;

pub use crate::transfer::Material;
pub use camera::{Camera, CameraPlace, Rays, View};
pub use edit::{CameraChange, Changes, Edit, LightChange, MaterialChange};
pub use place::{effective_majorant, extinction_limit, greatest_majorant};
pub use read::preset;
pub use scan::ScanKind;

/// Everything a render needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// For reports and file names; the file's stem where the file does not say.
    pub name: String,
    /// Where the data come from.
    pub volume: VolumeSource,
    /// How values between voxel centres are found.
    pub filter: Filter,
    /// Who looks.
    pub camera: Camera,
    /// What shines; ids and names are unique.
    pub lights: Vec<Light>,
    /// What the data are made of; names are unique, windows may overlap.
    pub materials: Vec<Material>,
    /// Radiance seen where a view ray leaves the volume, W/(sr mm²); it lights nothing.
    pub background: DVec3,
    /// How it is computed.
    pub settings: Settings,
    /// How the linear image becomes a picture.
    pub film: FilmSettings,
    /// Named edits, in file order.
    pub edits: Vec<Edit>,
}

/// An enum whose variants files and the command line know by their names.
pub trait Named: strum::VariantArray + std::fmt::Display + Copy {
    /// What it names, in messages.
    const WHAT: &'static str;

    /// The variant of this name.
    ///
    /// # Errors
    /// [`Error::Setting`] where there is none, with the names that there are.
    fn named(name: &str) -> Result<Self> {
        let found = Self::VARIANTS.iter().find(|v| v.to_string() == name);
        found.copied().ok_or_else(|| {
            let names: Vec<String> = Self::VARIANTS.iter().map(ToString::to_string).collect();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            Error::setting(edit::unknown(Self::WHAT, name, &names))
        })
    }
}

/// Lets a [`Named`] enum be parsed.
macro_rules! named {
    ($type:ident, $what:literal) => {
        impl Named for $type {
            const WHAT: &'static str = $what;
        }

        impl std::str::FromStr for $type {
            type Err = Error;

            fn from_str(name: &str) -> Result<Self> {
                Self::named(name)
            }
        }
    };
}

named!(Filter, "filter");
named!(Method, "method");
named!(Estimator, "estimator");
named!(Weighting, "weighting");
named!(Cache, "cache");
named!(Shadows, "kind of shadow rays");
named!(Spatial, "spatial test");
named!(Scale, "scale");
named!(Curve, "curve");
named!(Phantom, "phantom");

/// How values between voxel centres are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Filter {
    /// Piecewise constant: each voxel is a box of its own value.
    Nearest,
    /// Trilinear between voxel centres.
    Linear,
}

/// Where the volume comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VolumeSource {
    /// A file; the path is absolute once read (a relative one is relative to the scene file).
    File(PathBuf),
    /// A built-in phantom, computed.
    Phantom {
        /// Which.
        phantom: Phantom,
        /// Voxels along its longest edge, in [`SIZES`](crate::volume::phantom::SIZES).
        size: u32,
    },
}

/// A light. Its quota of photons depends on its `share` alone, never on its power.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Unique, and stable over edits: photons are known by (id, index).
    pub id: u32,
    /// Unique; edits name lights by it.
    pub name: String,
    /// Its photons over [`Settings::photons`], whatever the other lights have; > 0.
    pub share: f64,
    /// Linear RGB, >= 0. Point: intensity, W/sr. Directional: irradiance on a plane
    /// across the direction, W/mm². Rectangle and surroundings: radiance, W/(sr mm²).
    pub emitted: DVec3,
    /// Its shape and place.
    pub kind: LightKind,
}

/// Shape and place of a light; lengths in mm, in the world frame (LPS).
///
/// The `Around` kinds are relative to the volume's bounding sphere; [`Scene::place`]
/// turns them into the explicit ones, and only those reach a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightKind {
    /// Shines evenly in all directions.
    Point {
        /// World position.
        position: DVec3,
    },
    /// Parallel light from infinitely far away.
    Directional {
        /// Direction of travel; any length but zero.
        direction: DVec3,
    },
    /// A lambertian rectangle that emits to the side of `edge_u x edge_v` and is itself
    /// not seen. The edges need not be perpendicular.
    Rectangle {
        /// One corner.
        corner: DVec3,
        /// From the corner along one edge.
        edge_u: DVec3,
        /// From the corner along the other edge.
        edge_v: DVec3,
    },
    /// The same radiance from everywhere; not seen itself (that is the background).
    Surroundings,
    /// A point light yet to be placed.
    PointAround {
        /// Direction from the volume's centre towards the light; any length but zero.
        from: DVec3,
        /// From the centre, in radii of the bounding sphere; > 0.
        distance: f64,
    },
    /// A square facing the volume's centre, yet to be placed.
    RectangleAround {
        /// Direction from the volume's centre towards the light; any length but zero.
        from: DVec3,
        /// From the centre to the square's, in radii of the bounding sphere; > 0.
        distance: f64,
        /// Edge length, in radii of the bounding sphere; > 0.
        size: f64,
    },
}

/// How an image is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Method {
    /// Volumetric photon mapping: global illumination, edits are incremental.
    PhotonMap,
    /// Monte-Carlo ray casting: single scattering.
    Mcvr,
    /// The same with light from a cache that learns while it renders.
    IrradianceCache,
    /// The unbiased path tracer, all orders.
    Reference,
}

/// How much work a scene is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Scale {
    /// Seconds on two cores.
    Small,
    /// Between the two.
    Medium,
    /// As the scene says.
    Full,
}

/// The light field of the photon map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Estimator {
    /// Photons gathered from a spatial hash; any phase function.
    Points,
    /// Flights summed on a grid; isotropic scattering.
    Fluence,
}

/// What the `points` estimator blurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Weighting {
    /// Collision density, as in the paper; spills light across material borders.
    Plain,
    /// Fluence, which is smooth.
    Even,
}

/// How an update tells which segments see light that changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Spatial {
    /// By walking each segment through the blocks of changed light.
    Exact,
    /// By the paper's three axis historygrams of 64 bits: exact too, but coarser.
    Axes,
    /// Not at all, as the paper measured: stale light stays.
    Off,
}

/// Where single scattering has its light from, beside samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Cache {
    /// A grid that learns from the light samples.
    Grid,
    /// Nowhere: plain Monte-Carlo ray casting.
    None,
}

/// Which shadow rays an event casts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Shadows {
    /// One, to a light chosen by how much it may count; ratio tracking.
    One,
    /// One to each light; ratio tracking.
    All,
    /// One, to any light; delta tracking. As the irradiance cache's paper has it.
    Evenly,
}

/// How the scene is computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// How the image is computed.
    pub method: Method,
    /// `None`: fluence where all scattering is isotropic, else points.
    pub estimator: Option<Estimator>,
    /// Weighting of the `points` estimator.
    pub weighting: Weighting,
    /// Photons of a light of share 1; 1 to 2^32 - 1.
    pub photons: u64,
    /// Scattering events kept along a photon (S_n of the paper), 1 to 64.
    pub max_events: u32,
    /// Event from which the roulette runs, >= 1.
    pub roulette_from: u32,
    /// Probability to survive the roulette, in (0, 1].
    pub roulette_survival: f64,
    /// Gather radius in mm, > 0; `None`: the smallest spacing.
    pub radius: Option<f64>,
    /// Fluence cells per voxel along an axis, in (0, 1].
    pub grid: f64,
    /// Segments along a view ray (V_n of the paper), 1 to 1024.
    pub segments: u32,
    /// March step over the smallest spacing, in [0.001, 4].
    pub step: f64,
    /// Rate of tentative collisions, 1/mm, > 0; more where an extinction is greater. `None`: derived by
    /// [`Scene::settle`].
    pub majorant: Option<f64>,
    /// Data values that the transfer function's table resolves, ascending; `None`: derived by
    /// [`Scene::settle`], or every whole number of integer data that span at most 4095.
    pub range: Option<[f64; 2]>,
    /// View rays a pixel of a final picture, >= 1.
    pub rays: u32,
    /// Samples a pixel of the reference and of Monte-Carlo ray casting; passes of the irradiance cache;
    /// >= 1.
    pub samples: u32,
    /// Scattering orders of the reference, >= 1; `None`: all.
    pub reference_events: Option<u32>,
    /// All randomness follows from it.
    pub seed: u64,
    /// Radiant flux in W that the integer sums take as one, > 0. `None`: derived by
    /// [`Scene::settle`].
    pub flux_unit: Option<f64>,
    /// Whether rays and photons skip macro-cells that hold nothing.
    pub skip_empty: bool,
    /// Whether histories are kept; without them no edit is incremental.
    pub history: bool,
    /// Which segments an update recomputes because light changed.
    pub spatial: Spatial,
    /// Where single scattering has its light from.
    pub cache: Cache,
    /// Whether one of the tentative collisions of a view ray asks the cache, beside the real one.
    pub gather: bool,
    /// Which shadow rays an event casts, with or without a cache.
    pub shadows: Shadows,
    /// The least chance of a light sample where the cache is sure, in (0, 1].
    pub least_chance: f64,
    /// Memory of the cache, MiB, > 0; as much as a binding holds, at most.
    pub cache_mib: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            method: Method::PhotonMap,
            estimator: None,
            weighting: Weighting::Even,
            photons: 1_000_000,
            max_events: 16,
            roulette_from: 8,
            roulette_survival: 0.8,
            radius: None,
            grid: 0.5,
            segments: 16,
            step: 0.5,
            majorant: None,
            range: None,
            rays: 4,
            samples: 256,
            reference_events: None,
            seed: 1,
            flux_unit: None,
            skip_empty: true,
            history: true,
            spatial: Spatial::Exact,
            cache: Cache::Grid,
            gather: true,
            shadows: Shadows::All,
            least_chance: 0.25,
            cache_mib: 64.0,
        }
    }
}

/// How the linear image becomes a picture; an EXR holds the linear image itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilmSettings {
    /// In stops: the image is multiplied by 2^exposure; -32 to 32.
    pub exposure: f64,
    /// The curve from linear light to the picture.
    pub curve: Curve,
}

impl Default for FilmSettings {
    fn default() -> Self {
        Self { exposure: 0.0, curve: Curve::Filmic }
    }
}

/// The curve from linear light to the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display, strum::VariantArray)]
#[strum(serialize_all = "kebab-case")]
pub enum Curve {
    /// Highlights roll off softly (see [`crate::film`]), then sRGB.
    Filmic,
    /// sRGB alone; what is above one clips.
    Srgb,
}
