//! The demonstration: the hand phantom, then a bone edit and a vessel edit as updates.

use crate::error::Result;
use crate::film::Image;
use crate::gpu::Gpu;
use crate::gpu::Progress;
use crate::measure::{Measured, fresh, measure};
use crate::scene::{Scale, Scene, VolumeSource};
use crate::split::Split;
use crate::update::warm;
use crate::volume::phantom::Phantom;

/// One picture of the demonstration.
pub struct Shot {
    /// `before`, or the edit's name.
    pub name: String,
    /// The scene as shown.
    pub scene: Scene,
    /// The picture, one ray a pixel as in editing.
    pub image: Image,
    /// Photons traced.
    pub photons: u64,
    /// The edit that led to it, checked against a rebuild.
    pub measured: Option<Measured>,
}

/// The names of the pictures, in order.
///
/// # Errors
/// None: the scene is a part of the program.
pub fn names() -> Result<Vec<String>> {
    let edits = scene()?.edits.into_iter().map(|edit| edit.name);
    Ok(["before".to_owned()].into_iter().chain(edits).collect())
}

fn scene() -> Result<Scene> {
    Scene::parse(include_str!("../../data/scenes/hand.toml"), "hand.toml")
}

/// Renders the hand, and applies each of its edits.
///
/// # Errors
/// The device failed.
pub fn run(gpu: &Gpu, progress: &mut Progress) -> Result<Vec<Shot>> {
    let mut scene = scene()?;
    // A small picture of a finer phantom: a minute on two cores without a GPU is the limit.
    scene.scale(Scale::Small);
    scene.volume = VolumeSource::Phantom { phantom: Phantom::Hand, size: 128 };
    (scene.camera.width, scene.camera.height) = (384, 384);
    scene.settings.rays = 1;
    let volume = scene.volume.load()?;
    scene.settle(&volume);
    warm(gpu, &scene, &volume, progress)?;
    let mut frame = fresh(gpu, &scene, &volume)?;
    frame.rebuild(gpu, &Split::default(), progress)?;
    let image = frame.segments.image(gpu)?;
    let edits: Vec<_> = scene.edits.iter().map(|edit| edit.name.clone()).collect();
    let before = scene.clone();
    let photons = frame.scene.lights.photons.into();
    let mut shots = vec![Shot { name: "before".to_owned(), scene, image, photons, measured: None }];
    for name in edits {
        // Each edit is made to the first scene: the one before is undone, which is not measured.
        frame.edit(gpu, &before, &Split::default())?;
        frame.update(gpu, &Split::default(), progress)?;
        let scene = before.edited(&name)?;
        let measured = Some(measure(gpu, &mut frame, &scene, &volume, true, progress)?);
        let image = frame.segments.image(gpu)?;
        shots.push(Shot { name, scene, image, photons, measured });
    }
    Ok(shots)
}
