//! What a frame needs of the device's memory, by the settings that decide it: asked before anything
//! is made. A driver may promise what there is not, and a machine without memory takes long to say so.
//!
//! | part | bytes |
//! |---|---|
//! | photons | for each event of a photon a slot of 32 and marks of 1/4; for each photon 16 1/8 in lists |
//! | journal | as many slots again, at most 2^21, and 13 for each photon of them |
//! | fluence | 56 for each cell: three sums, two textures |
//! | points | 44 for each slot if all hold a photon, 52 with histories; 8 for each cell, at most 32 MiB |
//! | segments | 24 each, 32 from points, and 4 1/8 in lists |
//! | film | 16 for each pixel, and 44 on the host when the picture is read |

use super::anew::Parts;
use crate::device_scene::DeviceScene;
use crate::error::{Error, Result};
use crate::field::{fluence, points};
use crate::gpu::Gpu;
use crate::photon::{JOURNAL_SLOTS, SLOT_BYTES, SlotMarks};
use crate::scene::{Estimator, Scene, Weighting};
use crate::segment::segment_bytes;

/// What a part of a frame takes.
#[derive(Clone, Debug)]
pub(super) struct Need {
    /// The part.
    part: &'static str,
    /// How many, of what, and by which settings.
    what: String,
    /// Bytes in all.
    pub bytes: u64,
    /// The bytes of them that a kernel must see at once.
    piece: u64,
}

/// What is to be made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Making {
    /// Photons that get slots.
    pub photons: u64,
    /// Of the light field.
    pub estimator: Estimator,
    /// All else.
    pub parts: Parts,
}

/// Items of a work list, four bytes each, with their marks.
fn listed(items: u64) -> u64 {
    4 * items + items.div_ceil(8)
}

/// What making parts of a frame takes.
pub(super) fn needs(scene: &Scene, device: &DeviceScene, making: Making) -> Vec<Need> {
    let Making { photons, estimator, parts } = making;
    let (settings, events) = (&scene.settings, u64::from(scene.settings.max_events));
    let slots = photons * events;
    let mut needs = Vec::new();
    if photons > 0 {
        let what = format!("{photons} photons of {events} events (`photons`, `max_events`)");
        let marks = slots.div_ceil(32) * size_of::<SlotMarks>() as u64;
        let lists = 12 * photons + listed(photons);
        let bytes = slots * SLOT_BYTES + marks + lists;
        needs.push(Need { part: "photons", what, bytes, piece: events * SLOT_BYTES / 2 });
        let kept = photons.min((u64::from(JOURNAL_SLOTS) / events).max(1));
        let bytes = kept * events * SLOT_BYTES + 13 * kept;
        let what = format!("the old slots of {kept} of them");
        needs.push(Need { part: "journal", what, bytes, piece: 0 });
    }
    match estimator {
        Estimator::Fluence if parts.field => {
            let [x, y, z] = fluence::cells(device.params.size, settings.grid);
            let cells = [x, y, z].map(u64::from).iter().product::<u64>();
            let what = format!("{x}x{y}x{z} cells of fluence (`grid`)");
            needs.push(Need { part: "fluence grid", what, bytes: 56 * cells, piece: 8 * cells });
        }
        Estimator::Points if parts.field || photons > 0 => {
            let has_histories = settings.history && settings.weighting == Weighting::Even;
            let each = if has_histories { 52 } else { 44 };
            let buckets = points::buckets::most_bytes(points::are_hashed(device, settings), slots);
            let bytes = slots * each + if parts.field { buckets } else { 0 };
            let what = "points of the photons, at most (`photons`, `max_events`)".into();
            needs.push(Need { part: "points", what, bytes, piece: 0 });
        }
        _ => {}
    }
    if parts.bands {
        let [width, height, along] =
            [scene.camera.width, scene.camera.height, settings.segments].map(u64::from);
        let pixels = width * height;
        let each = segment_bytes(estimator);
        let what = format!(
            "{along} segments for each of {width}x{height} pixels (image size, `segments`; `rays` take \
             time alone)"
        );
        let bytes = pixels * along * each + listed(pixels * along) + pixels.div_ceil(8);
        needs.push(Need { part: "segments", what, bytes, piece: width * along * each });
        let what = format!("{width}x{height} pixels of film and picture (image size)");
        needs.push(Need { part: "film", what, bytes: 60 * pixels, piece: 16 * pixels });
    }
    needs
}

/// Refuses what does not fit the memory that is free, where that is known, or what an adapter binds.
///
/// # Errors
/// [`Error::Capacity`] of the part that takes most, with what all parts take and by which settings.
pub(super) fn check(gpu: &Gpu, needs: &[Need]) -> Result<()> {
    let needed: u64 = needs.iter().map(|need| need.bytes).sum();
    let largest = needs.iter().max_by_key(|need| need.bytes);
    let free = gpu.free_bytes().unwrap_or(u64::MAX);
    if let Some(largest) = largest.filter(|_| needed > free) {
        let mut sorted: Vec<_> = needs.iter().filter(|n| n.bytes > needed / 100).collect();
        sorted.sort_by_key(|need| std::cmp::Reverse(need.bytes));
        let each = sorted.iter().map(|n| format!("{} for {}", bytes(n.bytes), n.what));
        return Err(Error::capacity(
            largest.part,
            format!(
                "{} of memory are needed, and {} are free: {}; lower one of these settings",
                bytes(needed),
                bytes(free),
                each.collect::<Vec<_>>().join(", ")
            ),
        ));
    }
    match needs.iter().find(|need| need.piece > gpu.max_binding()) {
        None => Ok(()),
        Some(need) => Err(Error::capacity(
            need.part,
            format!(
                "{}: of these {} must lie in one piece, and {} binds at most {}; lower one of these \
                 settings, or use another adapter",
                need.what,
                bytes(need.piece),
                gpu.report().name,
                bytes(gpu.max_binding())
            ),
        )),
    }
}

/// Bytes as people write them.
fn bytes(n: u64) -> String {
    let mib = n as f64 / f64::from(1 << 20);
    if mib < 1024.0 { format!("{mib:.1} MiB") } else { format!("{:.1} GiB", mib / 1024.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::{AdapterChoice, Progress};
    use crate::split::Split;
    use crate::update::PhotonFrame;
    use crate::volume::Volume;

    const SCENE: &str = r#"
[volume]
phantom = "hand"
size = 32
[camera]
from = [0, -1, 0]
width = 120
height = 90
[[light]]
kind = "surroundings"
name = "sky"
radiance = 0.3
[[material]]
name = "all"
window = [-200, 1500]
extinction = 0.1
albedo = 0.9
[settings]
photons = 30000
max_events = 6
rays = 1
"#;

    fn settled(estimator: Estimator) -> (Scene, Volume) {
        let mut scene = Scene::parse(SCENE, "scene.toml").expect("it reads");
        scene.settings.estimator = Some(estimator);
        let volume = scene.volume.load().expect("it loads");
        scene.settle(&volume);
        (scene, volume)
    }

    #[test]
    fn what_is_foreseen_is_what_is_made() {
        let gpu = pollster::block_on(crate::open(&AdapterChoice::Best)).expect("an adapter");
        for estimator in [Estimator::Fluence, Estimator::Points] {
            let (scene, volume) = settled(estimator);
            let split = Split::default();
            let device = DeviceScene::new(&gpu, &scene, &volume).expect("uploads");
            let mut frame = PhotonFrame::new(&gpu, &scene, device, &split).expect("fits");
            frame.rebuild(&gpu, &split, &mut Progress::silent()).expect("rebuilds");
            let making = Making { photons: 30_000, estimator, parts: Parts::all() };
            let needs = needs(&scene, &frame.scene, making);
            let foreseen = |part: &str| -> f64 {
                let parts = needs.iter().filter(|need| need.part == part);
                parts.map(|need| need.bytes as f64).sum()
            };
            let lists = frame.list_bytes();
            let near = |part: &str, made: u64| {
                let ratio = made as f64 / foreseen(part);
                assert!((0.97..1.01).contains(&ratio), "{part}: {ratio} of what is foreseen");
            };
            near("photons", frame.map.bytes() + lists.photons);
            near("journal", lists.journal);
            near("segments", frame.segments.bytes() + lists.segments);
            match estimator {
                // Textures are not among the bytes that the field tells of.
                Estimator::Fluence => near("fluence grid", frame.field.bytes()),
                // Not every slot holds a point.
                Estimator::Points => {
                    let ratio = frame.field.bytes() as f64 / foreseen("points");
                    assert!(ratio < 1.0, "points: {ratio} of what is foreseen");
                }
            }
        }
    }

    #[test]
    fn what_is_refused_allocates_nothing() {
        let gpu = pollster::block_on(crate::open(&AdapterChoice::Best)).expect("an adapter");
        let Some(free) = gpu.free_bytes() else {
            return eprintln!("skipped: nobody knows what memory of this adapter is free");
        };
        let held = || gpu.device().generate_allocator_report().map(|r| r.total_allocated_bytes);
        let (mut scene, volume) = settled(Estimator::Points);
        // Each part fits for itself, and all of them do not.
        scene.settings.photons = free / 5 * 3 / (32 * 6);
        (scene.camera.width, scene.camera.height) = (2000, 2000);
        scene.settings.segments = (free / 5 * 2 / (32 * 4_000_000)) as u32 + 1;
        let device = DeviceScene::new(&gpu, &scene, &volume).expect("uploads");
        let before = held();
        let refused = PhotonFrame::new(&gpu, &scene, device, &Split::default());
        let error = refused.err().expect("it does not fit").to_string();
        assert!(error.contains("of memory are needed") && error.contains("points of"), "{error}");
        // The scene on the device is gone, at most.
        assert!(held() <= before);
    }

    #[test]
    fn bytes_are_told_in_their_unit() {
        assert_eq!(bytes(3 << 19), "1.5 MiB");
        assert_eq!(bytes(3 << 40), "3072.0 GiB");
    }
}
