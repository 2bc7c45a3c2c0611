//! Updates in steps, as a window makes them: they never wait for the device, may be abandoned or
//! superseded after any, and leave what a rebuild leaves. And updates that are made at once: how often
//! they wait.

mod common;

use std::time::Duration;

use common::snapshot::{rebuild, snapshot};
use common::world::world;
use common::{gpu, path, settled};
use photogram::device_scene::DeviceScene;
use photogram::gpu::read::Words;
use photogram::gpu::{AdapterChoice, Gpu, Progress, adapters};
use photogram::kernels::LIBRARY;
use photogram::scene::{Estimator, Filter, Scale, Scene, Weighting};
use photogram::split::Split;
use photogram::update::{PhotonFrame, Step, Updated};
use photogram::volume::Volume;

/// So short that all stages take many slices.
const BUDGET: Duration = Duration::from_micros(300);

const FIELDS: [Estimator; 2] = [Estimator::Fluence, Estimator::Points];

fn own_gpu() -> Gpu {
    pollster::block_on(photogram::open(&AdapterChoice::Best)).expect("an adapter")
}

/// So many photons and pixels that stages are longer than a step.
fn larger_world(estimator: Estimator) -> (Scene, Volume) {
    let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
    scene.settings.photons = 10_000;
    (scene.camera.width, scene.camera.height) = (60, 48);
    (scene, volume)
}

/// A frame of which nothing is computed yet.
fn begun(gpu: &Gpu, scene: &Scene, volume: &Volume) -> PhotonFrame {
    let device = DeviceScene::new(gpu, scene, volume).expect("uploads");
    PhotonFrame::new(gpu, scene, device, &Split::default()).expect("fits")
}

/// Goes on with an update, by at most so many steps; returns what it came to, if it did.
fn stepped(gpu: &Gpu, frame: &mut PhotonFrame, most: usize) -> (Option<Updated>, usize) {
    let mut done_before = 0.0;
    for step in 1..=most {
        if let Some(outlook) = frame.outlook() {
            assert!((done_before..=1.0).contains(&outlook.done), "{outlook:?}");
            done_before = outlook.done;
        }
        let progress = &mut Progress::silent();
        let came = frame.step(gpu, &Split::default(), BUDGET, progress).expect("steps");
        if let Step::Done(done) = came {
            return (Some(*done), step);
        }
    }
    (None, most)
}

#[test]
fn steps_never_wait_and_leave_what_a_rebuild_leaves() {
    let devices = [own_gpu as fn() -> Gpu, without_a_clock];
    for (estimator, device) in FIELDS.into_iter().flat_map(|f| devices.map(|device| (f, device))) {
        let own = device();
        let (mut scene, volume) = larger_world(estimator);
        let mut frame = begun(&own, &scene, &volume);
        own.wait("test").expect("waits");
        for round in 0..3 {
            let before = own.effort();
            let (done, steps) = stepped(&own, &mut frame, usize::MAX);
            let effort = own.effort().since(before);
            assert_eq!((effort.waits, effort.paced), (0, 0), "{estimator}");
            // Each stage is a step, at least.
            assert!(steps > 5, "{estimator}: {steps} steps");
            assert_eq!(frame.outlook(), None);
            let done = done.expect("it ended");
            assert!(done.finished && done.recomputed > 0, "{estimator}: {done:?}");
            let now = snapshot(&own, &frame).without_histories();
            let fresh = rebuild(gpu(), &scene, &volume, &Split::default()).without_histories();
            assert_eq!(now.difference(&fresh), None, "{estimator}, {round}");
            scene.materials[round].extinction *= 0.7;
            frame.edit(&own, &scene, &Split::default()).expect("applies");
        }
    }
}

#[test]
fn an_edit_supersedes_an_update_after_any_step() {
    for estimator in FIELDS {
        let own = own_gpu();
        let (home, volume) = larger_world(estimator);
        let (mut first, mut second) = (home.clone(), home.clone());
        first.materials[1].extinction *= 0.8;
        first.lights[0].emitted *= 0.5;
        second.materials[2].extinction = 0.7;
        second.lights.swap(0, 1);
        let mut frame = begun(&own, &home, &volume);
        stepped(&own, &mut frame, usize::MAX);
        let mut interrupted = 0;
        for steps in (0..).map(|doublings| 1 << doublings) {
            let applied = |frame: &mut PhotonFrame, scene: &Scene| {
                frame.edit(&own, scene, &Split::default()).expect("applies");
            };
            applied(&mut frame, &first);
            let (done, _) = stepped(&own, &mut frame, steps);
            interrupted += usize::from(frame.is_going());
            // The first edit stays, or is undone.
            let last = if interrupted % 2 == 0 { &first } else { &second };
            applied(&mut frame, last);
            assert!(stepped(&own, &mut frame, usize::MAX).0.is_some_and(|done| done.finished));
            let now = snapshot(&own, &frame).without_histories();
            let fresh = rebuild(gpu(), last, &volume, &Split::default()).without_histories();
            assert_eq!(now.difference(&fresh), None, "{estimator}, {steps} steps");
            applied(&mut frame, &home);
            stepped(&own, &mut frame, usize::MAX);
            if done.is_some() {
                break;
            }
        }
        assert!(interrupted > 2, "{estimator}: interrupted {interrupted} times");
    }
}

/// A device that cannot time its work, and that looks at the arguments of indirect dispatches for
/// itself.
fn without_a_clock() -> Gpu {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default()));
    let adapter = adapter.expect("an adapter");
    let device = pollster::block_on(adapter.request_device(&Default::default()));
    let (device, queue) = device.expect("a device");
    let name = adapter.get_info().name;
    let report = pollster::block_on(adapters())
        .expect("adapters")
        .into_iter()
        .find(|report| report.name == name);
    Gpu::from_device(device, queue, report.expect("it is listed"), &LIBRARY)
}

#[test]
fn a_device_without_a_clock_gives_the_same_bits() {
    let own = without_a_clock();
    assert!(!own.has_timestamps() && own.report().timestamps);
    for estimator in FIELDS {
        let (mut scene, volume) = larger_world(estimator);
        let mut frame = begun(&own, &scene, &volume);
        let silent = &mut Progress::silent();
        frame.rebuild(&own, &Split::default(), silent).expect("rebuilds");
        own.take_timings().expect("a clock");
        scene.materials[1].extinction *= 0.7;
        frame.edit(&own, &scene, &Split::default()).expect("applies");
        frame.update(&own, &Split::default(), silent).expect("updates");
        let timings = own.take_timings().expect("a clock");
        for kernel in ["photon_query", "trace", "segment"] {
            let row = timings.rows().iter().find(|row| row.stage == kernel);
            assert!(row.is_some_and(|row| row.ms > 0.0), "{estimator}: {kernel} took no time");
        }
        let now = snapshot(&own, &frame).without_histories();
        let fresh = rebuild(gpu(), &scene, &volume, &Split::default()).without_histories();
        assert_eq!(now.difference(&fresh), None, "{estimator}");
    }
}

/// Nor is any time known then; slices are as long as they were.
#[test]
fn a_device_that_times_nothing_gives_the_same_bits() {
    let own = own_gpu();
    for estimator in FIELDS {
        let (mut scene, volume) = larger_world(estimator);
        let mut frame = begun(&own, &scene, &volume);
        let silent = &mut Progress::silent();
        frame.rebuild(&own, &Split::default(), silent).expect("rebuilds");
        assert!(!own.take_timings().expect("a clock").rows().is_empty());
        own.set_timed(false);
        scene.materials[1].extinction *= 0.7;
        frame.edit(&own, &scene, &Split::default()).expect("applies");
        // As a browser would: nobody is blocked.
        let (split, before) = (Split::default(), own.effort());
        let updated = frame.updated(&own, &split, BUDGET, silent);
        let done = pollster::block_on(updated).expect("updates");
        let effort = own.effort().since(before);
        assert!(done.finished && done.counts.changed > 0, "{estimator}: {done:?}");
        assert_eq!((effort.waits, effort.paced), (0, 0), "{estimator}");
        assert!(own.take_timings().expect("a clock").rows().is_empty());
        own.set_timed(true);
        let batch = &frame.map.batches[0];
        let asked = own.ask("test", &[Words::first(&batch.states)]).expect("asks");
        let answer = pollster::block_on(own.answer::<u32>(asked)).expect("answers");
        assert_eq!(answer, own.read::<u32>("test", &batch.states).expect("reads")[..1]);
        let now = snapshot(&own, &frame).without_histories();
        let fresh = rebuild(gpu(), &scene, &volume, &split).without_histories();
        assert_eq!(now.difference(&fresh), None, "{estimator}");
    }
}

#[test]
fn updates_of_a_kind_make_no_buffers_but_the_first() {
    for estimator in FIELDS {
        let own = own_gpu();
        let (home, volume) = larger_world(estimator);
        let mut edited = home.clone();
        edited.materials[1].extinction *= 0.8;
        edited.materials[2].colour *= 0.5;
        let mut frame = begun(&own, &home, &volume);
        let (split, silent) = (&Split::default(), &mut Progress::silent());
        frame.rebuild(&own, split, silent).expect("rebuilds");
        let mut made = Vec::new();
        for scene in [&edited, &home].into_iter().cycle().take(8) {
            let before = own.effort();
            frame.edit(&own, scene, split).expect("applies");
            let done = frame.update(&own, split, silent).expect("updates");
            assert!(done.counts.changed > 0, "{estimator}: {done:?}");
            made.push(own.effort().since(before).buffers);
        }
        assert_eq!(made[4..], [0; 4], "{estimator}: {made:?}");
    }
}

#[test]
fn an_update_waits_once_or_twice() {
    let own = own_gpu();
    for name in ["cornell", "engine", "hand", "kidneys", "torso"] {
        for estimator in FIELDS {
            let mut scene =
                Scene::load(path(&format!("data/scenes/{name}.toml"))).expect("the scene reads");
            scene.scale(Scale::Small);
            scene.settings.estimator = Some(estimator);
            (scene.settings.photons, scene.settings.rays) = (20_000, 1);
            (scene.camera.width, scene.camera.height) = (40, 30);
            let edits = scene.edits.iter().map(|edit| edit.name.clone()).collect::<Vec<_>>();
            assert!(!edits.is_empty(), "{name}");
            let (mut scene, volume) = settled(scene);
            let device = DeviceScene::new(&own, &scene, &volume).expect("uploads");
            let split = &Split::default();
            let mut frame = PhotonFrame::new(&own, &scene, device, split).expect("fits");
            let silent = &mut Progress::silent();
            let before = own.effort();
            frame.rebuild(&own, split, silent).expect("rebuilds");
            let most = if estimator == Estimator::Fluence { 1 } else { 2 };
            let rebuilt = own.effort().since(before).waits;
            assert!(rebuilt <= most, "{name}, {estimator}: a rebuild waits {rebuilt} times");
            for edit in edits {
                scene = scene.edited(&edit).expect("the edit applies");
                let before = own.effort();
                frame.edit(&own, &scene, split).expect("applies");
                let done = frame.update(&own, split, silent).expect("updates");
                let effort = own.effort().since(before);
                assert!(done.recomputed > 0, "{name}, {edit}: {done:?}");
                assert!(effort.waits <= most, "{name}, {estimator}, {edit}: {effort:?}");
            }
        }
    }
}
