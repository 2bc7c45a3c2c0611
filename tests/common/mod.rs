//! What several tests share.
#![allow(dead_code)]

use std::path::PathBuf;
use std::sync::OnceLock;

use photogram::film::Image;
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::render::{Progress, Rendered, Split, render};
use photogram::scene::Scene;
use photogram::volume::Volume;

/// The adapter that all tests of a program share.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| {
        Gpu::open(&AdapterChoice::Best).unwrap_or_else(|e| panic!("no adapter to test on: {e}"))
    })
}

pub fn path(relative: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(relative)
}

/// The scenes with an answer beside them.
pub const TRUTH: [&str; 6] = [
    "ball_single",
    "ball_multiple",
    "knuckle",
    "knuckle_bone_edit",
    "knuckle_vessel_edit",
    "cloud_forward",
];

/// A scene with a truth, settled, with its volume.
pub fn truth_scene(name: &str) -> (Scene, Volume) {
    settled(Scene::load(path(&format!("tests/truth/{name}.toml"))).expect("the scene reads"))
}

/// Its answer, and the standard error of that.
pub fn truth_image(name: &str) -> (Image, Image) {
    let read = |suffix: &str| {
        Image::read_exr(path(&format!("tests/truth/{name}{suffix}.exr"))).expect("the truth reads")
    };
    (read(""), read(".stderr"))
}

pub fn settled(mut scene: Scene) -> (Scene, Volume) {
    let volume = scene.volume.load().expect("the volume loads");
    scene.settle(&volume);
    (scene, volume)
}

pub fn rendered(scene: &Scene, volume: &Volume) -> Rendered {
    render(gpu(), scene, volume, &Split::default(), &mut Progress::silent()).expect("it renders")
}

/// Mean over pixels and channels.
pub fn mean(image: &Image) -> f64 {
    image.rgb.iter().flatten().map(|&x| f64::from(x)).sum::<f64>() / (3 * image.rgb.len()) as f64
}
