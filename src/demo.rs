//! The demonstration: the hand phantom, before and after a bone edit and a vessel edit.

use crate::error::Result;
use crate::gpu::Gpu;
use crate::render::{Progress, Rendered, Split, render};
use crate::scene::{Scale, Scene, VolumeSource};
use crate::volume::phantom::Phantom;

/// One picture of the demonstration.
pub struct Shot {
    /// `before`, or the edit's name.
    pub name: String,
    /// The scene as rendered.
    pub scene: Scene,
    /// The picture and what it cost.
    pub rendered: Rendered,
}

/// Renders the hand before and after each of its edits, by full rebuilds.
///
/// # Errors
/// The device failed.
pub fn run(gpu: &Gpu, progress: &mut Progress) -> Result<Vec<Shot>> {
    let mut scene = Scene::parse(include_str!("../data/scenes/hand.toml"), "hand.toml")?;
    // A small picture of a finer phantom: a minute on two cores without a GPU is the limit.
    scene.scale(Scale::Small);
    scene.volume = VolumeSource::Phantom { phantom: Phantom::Hand, size: 128 };
    (scene.camera.width, scene.camera.height) = (384, 384);
    scene.settings.rays = 4;
    let volume = scene.volume.load()?;
    scene.settle(&volume);
    let edits: Vec<_> = scene.edits.iter().map(|edit| edit.name.clone()).collect();
    let mut shots = vec![("before".to_owned(), scene.clone())];
    for name in edits {
        let edited = scene.edited(&name)?;
        shots.push((name, edited));
    }
    let mut done = Vec::new();
    for (name, scene) in shots {
        let rendered = render(gpu, &scene, &volume, &Split::default(), progress)?;
        done.push(Shot { name, scene, rendered });
    }
    Ok(done)
}
