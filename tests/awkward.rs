//! Edits and moments that an update may get wrong, each by itself: it leaves what a rebuild
//! leaves all the same, and does no more than it must.

mod common;

use common::gpu;
use common::snapshot::{difference, snapshot};
use common::world::{WORLD, frame, update, world};
use glam::{DMat3, DVec3};
use photogram::gpu::AdapterChoice;
use photogram::gpu::Progress;
use photogram::measure;
use photogram::scene::{CameraPlace, Estimator, Filter, LightKind, Scene, Weighting};
use photogram::segment::Segment;
use photogram::split::Split;
use photogram::update::{Anew, Phases, Scope, Updated};
use photogram::volume::{Values, Volume};

/// Applies an edit to a fresh frame and checks it; returns what the update did.
fn check(estimator: Estimator, edit: impl Fn(&mut Scene)) -> (Scope, Updated) {
    let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    edit(&mut scene);
    let (scope, done) = update(&mut frame, &scene, &Split::default());
    assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    (scope, done)
}

fn check_both(edit: impl Fn(&mut Scene)) -> [Updated; 2] {
    [Estimator::Fluence, Estimator::Points].map(|estimator| check(estimator, &edit).1)
}

#[test]
fn an_edit_that_changes_no_entry_visits_nothing() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        // The window lies beyond all values; then nothing at all is edited.
        let beyond = |s: &mut Scene| {
            let mut m = s.materials[0].clone();
            (m.name, m.ramp) = ("beyond".into(), vec![[9000.0, 1.0], [9100.0, 1.0]]);
            s.materials.push(m);
        };
        for edit in [beyond as fn(&mut Scene), |_| ()] {
            let (scope, done) = check(estimator, edit);
            assert_eq!(scope, Scope::Nothing);
            assert_eq!((done.counts.visits(), done.listed, done.recomputed), (0, 0, 0));
        }
    }
}

/// Times of phases are those of the last update, even if that had nothing to do. On a device of its
/// own: other tests work on theirs.
#[test]
fn times_of_phases_begin_anew_with_every_update() {
    let gpu = pollster::block_on(photogram::open(&AdapterChoice::Best)).expect("an adapter");
    let (scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let mut frame = measure::fresh(&gpu, &scene, &volume).expect("fits");
    let mut times = |rebuilds| {
        let silent = &mut Progress::silent();
        let done = match rebuilds {
            true => frame.rebuild(&gpu, &Split::default(), silent),
            false => frame.update(&gpu, &Split::default(), silent),
        };
        assert!(done.expect("comes to its end").finished);
        let Phases { photons, light_field, segments } = Phases::of_last(&gpu).expect("a clock");
        [photons, light_field, segments]
    };
    assert!(times(true).iter().all(|&ms| ms > 0.0));
    assert_eq!(times(false), [0.0; 3]);
}

#[test]
fn a_colour_edit_makes_no_tentative_collision() {
    for done in check_both(|s| s.materials[2].colour = DVec3::new(0.3, 0.5, 0.9)) {
        assert!(done.counts.reweighed > 0 && done.recomputed > 0);
        let counts = done.counts;
        assert_eq!((counts.steps, counts.tentative, counts.invalid), (0, 0, 0));
    }
}

/// Where light alone changed, a gather looks at the points that changed, once at what was seen of
/// each and once at what it has now.
#[test]
fn a_colour_edit_gathers_what_changed_and_nothing_else() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Plain, Filter::Linear);
    scene.settings.max_events = 1;
    let mut frame = frame(&scene, &volume, &Split::default());
    let all = frame.rebuild(gpu(), &Split::default(), &mut Progress::silent()).expect("rebuilds");
    scene.materials[2].colour = DVec3::new(0.3, 0.5, 0.9);
    let (_, done) = update(&mut frame, &scene, &Split::default());
    assert_eq!(difference(&frame, &scene, &volume), None);
    assert!(done.points > 0 && 2 * done.points < all.points, "{} of {}", done.points, all.points);
    assert_eq!(done.corrected, done.recomputed);
    let [gathered, of] = [done, all].map(|u| u.counts.gathered);
    assert!(gathered > 0 && gathered < of, "{gathered} of {of}");
}

/// A macro-cell that an edit empties tells a march of all its values. A segment whose light alone is
/// corrected has not read them: it is not computed a second time, now or by the next edit.
#[test]
fn a_correction_leaves_what_a_segment_has_read() {
    // Bone in some macro-cells, a bit of flesh in the next, and a ray crosses both.
    let (mut scene, volume) = few_values(Estimator::Points, 24, |at| {
        let within = |low: [u32; 3], high: u32| (0..3).all(|a| (low[a]..high).contains(&at[a]));
        2000 * u16::from(within([2, 2, 2], 14)) + 100 * u16::from(within([18, 4, 4], 22))
    });
    let mut bone = scene.materials[0].clone();
    (bone.name, bone.extinction) = ("bone".into(), 0.5);
    bone.ramp = vec![[1900.0, 1.0], [2100.0, 1.0]];
    scene.materials[0].ramp = vec![[50.0, 1.0], [150.0, 1.0]];
    scene.materials.push(bone);
    scene.materials[0].extinction = 0.1;
    scene.settings.segments = 2;
    let mut frame = frame(&scene, &volume, &Split::default());
    let (before, table) = (snapshot(gpu(), &frame), frame.scene.table.clone());
    scene.materials.remove(0);
    let (_, done) = update(&mut frame, &scene, &Split::default());
    let now = snapshot(gpu(), &frame);
    assert!(done.corrected > 5, "{done:?}");
    let differs = |e: &usize| table.extinction[*e] != frame.scene.table.extinction[*e];
    let changed = (0..4096).filter(differs).fold(0_u64, |mask, e| mask | 1 << (e / 64));
    let mask = |s: &Segment| u64::from(s[4]) | u64::from(s[5]) << 32;
    let pairs = before.segments.iter().zip(&now.segments);
    let (read, others): (Vec<_>, Vec<_>) = pairs.partition(|(old, _)| mask(old) & changed != 0);
    assert_eq!(done.recomputed - done.corrected, read.len() as u64);
    assert!(others.iter().all(|(old, new)| mask(old) == mask(new)), "more than was read");
}

/// Points get light again that are of another power or of a material of another colour, and no others.
#[test]
fn a_colour_edit_lights_again_what_may_be_of_another() {
    for weighting in [Weighting::Even, Weighting::Plain] {
        let (mut scene, volume) = world(Estimator::Points, weighting, Filter::Linear);
        let mut frame = frame(&scene, &volume, &Split::default());
        let silent = &mut Progress::silent();
        let all = frame.rebuild(gpu(), &Split::default(), silent).expect("rebuilds");
        let each = if weighting == Weighting::Even { 3 } else { 2 };
        assert_eq!((all.points_built, all.counts.refreshed), (each * all.points, 0));
        scene.materials[2].colour = DVec3::new(0.3, 0.5, 0.9);
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert_eq!(difference(&frame, &scene, &volume), None);
        assert!(done.counts.repowered > 0 && done.counts.moved == 0);
        let lit = done.counts.refreshed;
        assert!(lit >= done.points && lit < all.points, "{lit} of {}", all.points);
        // Lights that were seen and those of now are both taken.
        assert_eq!(done.points_built, lit + 2 * done.points);
    }
}

/// Edits of a light, of the camera and of the background leave the photons of others alone.
#[test]
fn photons_of_others_stay() {
    for done in check_both(|s| s.lights[0].emitted *= 0.5) {
        // The lamp has two thirds.
        assert!(done.listed > 0 && done.listed <= done.photons * 2 / 3, "{done:?}");
        assert_eq!(done.counts.invalid, 0);
    }
    let moved = |s: &mut Scene| match &mut s.lights[0].kind {
        LightKind::Point { position } => *position *= 1.1,
        other => panic!("{other:?}"),
    };
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        // Where most photons are another light's, they are not all traced anew.
        scene.lights[0].share = 0.1;
        let mut frame = frame(&scene, &volume, &Split::default());
        moved(&mut scene);
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert!(done.listed > 0 && done.listed <= done.photons / 6 + 1, "{done:?}");
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
    let views: [fn(&mut Scene); 4] = [
        |s| s.camera.fov_deg *= 0.9,
        |s| s.camera.up = DVec3::new(0.5, 0.0, 1.0),
        |s| match &mut s.camera.place {
            CameraPlace::At { origin, .. } => *origin *= 1.2,
            other => panic!("{other:?}"),
        },
        |s| match &mut s.camera.place {
            CameraPlace::At { target, .. } => *target += DVec3::X,
            other => panic!("{other:?}"),
        },
    ];
    for done in views.into_iter().flat_map(check_both) {
        assert_eq!((done.listed, done.counts.steps, done.counts.deposits), (0, 0, 0));
        assert_eq!(done.recomputed, done.segments);
    }
}

#[test]
fn a_transparent_value_made_opaque_stops_what_had_flown_through_and_left() {
    // Nothing but bone at first: photons leave through flesh without a collision there.
    let bone_alone = |s: &mut Scene| s.materials.retain(|m| m.name == "bone");
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut scene = home.clone();
        bone_alone(&mut scene);
        let mut frame = frame(&scene, &volume, &Split::default());
        // Skipped macro-cells, too: much of the volume was empty.
        let (_, done) = update(&mut frame, &home, &Split::default());
        assert!(done.counts.changed > 0);
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

#[test]
fn an_edit_that_changes_every_entry_is_exact() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut frame = frame(&scene, &volume, &Split::default());
        let before = frame.scene.table.extinction.clone();
        let mut all = scene.materials[0].clone();
        (all.name, all.ramp) = ("all".into(), vec![[-3000.0, 1.0], [9000.0, 1.0]]);
        scene.materials.push(all);
        let (_, done) = update(&mut frame, &scene, &Split::default());
        let after = &frame.scene.table.extinction;
        assert!(before.iter().zip(after).all(|(a, b)| a < b), "an entry stays");
        assert!(done.counts.changed > done.photons / 2, "{done:?}");
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
}

#[test]
fn awkward_edits_are_exact() {
    type Edit = (&'static str, fn(&mut Scene), fn(&Updated) -> bool);
    let edits: [Edit; 7] = [
        ("all is removed", |s| s.materials.clear(), |done| 10 * done.counts.changed > done.photons),
        (
            "what scattered only absorbs",
            |s| s.materials[1].scatter = 0.0,
            |done| done.counts.reweighed > 0 && done.counts.invalid == 0,
        ),
        (
            "emission comes",
            |s| s.materials[2].emission = DVec3::new(0.1, 0.0, 0.0),
            |done| done.recomputed > 0,
        ),
        ("a light goes", |s| drop(s.lights.remove(0)), |done| done.recomputed > 0),
        ("all lights go", |s| s.lights.clear(), |done| done.recomputed > 0),
        (
            "a light goes out",
            |s| s.lights[0].emitted = DVec3::ZERO,
            |done| done.counts.reweighed > 0 && done.counts.changed > 0,
        ),
        ("the background", |s| s.background = DVec3::ONE, |done| done.counts.visits() == 0),
    ];
    for (what, edit, expected) in edits {
        for done in check_both(edit) {
            assert!(expected(&done), "{what}: {done:?}");
        }
    }
}

/// Bone in the shadow of a slab of flesh: segments that read bone alone see the slab go.
#[test]
fn a_shadow_goes_with_what_cast_it() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = few_values(estimator, 24, |[_, j, _]| match j {
            4..8 => 100,
            14.. => 2000,
            _ => 0,
        });
        scene.materials[0].extinction = 0.5;
        scene.materials[0].ramp = vec![[50.0, 1.0], [150.0, 1.0]];
        let mut bone = scene.materials[0].clone();
        (bone.name, bone.ramp) = ("bone".into(), vec![[1900.0, 1.0], [2100.0, 1.0]]);
        scene.materials.push(bone);
        let mut frame = frame(&scene, &volume, &Split::default());
        let before = snapshot(gpu(), &frame).segments;
        scene.materials.remove(0);
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert!(done.counts.invalid > 0 && done.counts.changed > 0, "{done:?}");
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
        // What let some light through, and lets as much through, is bone.
        let after = snapshot(gpu(), &frame).segments;
        let lit = before
            .iter()
            .zip(&after)
            .filter(|(a, b)| a[3] == b[3] && a[3] != 1.0_f32.to_bits() && a[..3] != b[..3]);
        assert!(lit.count() > 10, "{estimator}: no bone was in the shadow");
    }
}

/// Nobody sees the colour of what scatters nothing.
#[test]
fn the_colour_of_what_only_absorbs_is_no_edit() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = world(estimator, Weighting::Even, Filter::Linear);
        scene.materials[1].scatter = 0.0;
        let mut frame = frame(&scene, &volume, &Split::default());
        scene.materials[1].colour = DVec3::new(0.3, 0.5, 0.9);
        let (scope, done) = update(&mut frame, &scene, &Split::default());
        assert_eq!(scope, Scope::Nothing);
        assert_eq!((done.counts.visits(), done.listed, done.recomputed), (0, 0, 0));
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
}

/// A scene over few voxels, seen with the nearest filter, of one thin tissue.
fn few_values<T>(estimator: Estimator, size: u32, value: impl Fn([u32; 3]) -> T) -> (Scene, Volume)
where
    Values: From<Vec<T>>,
{
    let mut values = Vec::new();
    for at in 0..size.pow(3) {
        values.push(value([at % size, at / size % size, at / size / size]));
    }
    let volume = Volume::new([size; 3], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values)
        .expect("a sound volume");
    let text = &WORLD[WORLD.find("[camera]").expect("a camera")..];
    let mut scene = common::scene_over(&volume, text);
    (scene.filter, scene.settings.estimator) = (Filter::Nearest, Some(estimator));
    scene.materials.truncate(1);
    scene.materials[0].ramp = vec![[0.0, 1.0], [5000.0, 1.0]];
    (scene, volume)
}

/// Values on the edges of bins, the top value, and windows that no value lies in. With a
/// range of 4096 each value is an entry, and 64 of them are a bin.
#[test]
fn values_on_the_edge_are_met_and_no_others() {
    const VALUES: [u16; 8] = [0, 1022, 1023, 1024, 1025, 2111, 2113, 4096];
    let edits = [
        (1023.0, true),
        (1024.0, true),
        (1026.0, false),
        (2048.0, false),
        (2112.0, false),
        (4095.0, true),
        (4096.0, false),
        (-200.0, false),
    ];
    for estimator in [Estimator::Fluence, Estimator::Points] {
        for (low, is_met) in edits {
            let (mut scene, volume) =
                few_values(estimator, 8, |[i, j, k]| VALUES[((i ^ j ^ k) % 8) as usize]);
            let mut frame = frame(&scene, &volume, &Split::default());
            let mut new = scene.materials[0].clone();
            (new.name, new.extinction) = ("new".into(), 0.5);
            new.ramp = vec![[low, 1.0], [low + 1.0, 1.0]];
            scene.materials.push(new);
            let (_, done) = update(&mut frame, &scene, &Split::default());
            assert_eq!(done.counts.changed > 0, is_met, "{estimator}, {low}: {done:?}");
            assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}, {low}");
        }
    }
}

/// Floats that single precision tells apart in steps of four table entries, since they are far
/// from zero: what is interpolated between equal ones is not to leave the range of their cell.
#[test]
fn floats_far_from_zero_are_exact() {
    const MOST: f32 = 101_324.0;
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (mut scene, volume) = few_values(estimator, 24, |at| match at {
            [0, 0, 0] => MOST - 4.0,
            [23, 23, 23] => MOST + 4.0,
            _ => MOST,
        });
        scene.filter = Filter::Linear;
        let most = f64::from(MOST);
        scene.materials[0].ramp = vec![[most - 0.002, 1.0], [most + 0.002, 1.0]];
        let mut frame = frame(&scene, &volume, &Split::default());
        let mut beside = scene.materials[0].clone();
        (beside.name, beside.extinction) = ("beside".into(), 1.5);
        beside.ramp = vec![[most + 0.003, 1.0], [most + 0.02, 1.0]];
        scene.materials.push(beside);
        let (_, done) = update(&mut frame, &scene, &Split::default());
        assert!(10 * done.counts.changed < done.photons, "{done:?}");
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
    }
}

#[test]
fn an_edit_inside_a_skipped_macro_cell_is_found() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        // Flesh in one corner; bone in the middle of nothing, two macro-cells away.
        let (mut scene, volume) = few_values(estimator, 40, |at| {
            let within = |low, high| at.iter().all(|x| (low..high).contains(x));
            2000 * u16::from(within(26, 30)) + 100 * u16::from(within(0, 6))
        });
        scene.materials[0].ramp = vec![[50.0, 1.0], [150.0, 1.0]];
        let mut bone = scene.materials[0].clone();
        (bone.name, bone.extinction) = ("bone".into(), 1.5);
        bone.ramp = vec![[1900.0, 1.0], [2100.0, 1.0]];
        let mut both = scene.clone();
        both.materials.push(bone);
        let mut frame = frame(&scene, &volume, &Split::default());
        for scene in [&both, &scene, &both] {
            let (_, done) = update(&mut frame, scene, &Split::default());
            assert!(done.counts.changed > 0 && done.counts.changed < done.photons / 2, "{done:?}");
            assert!(done.recomputed > 0);
            assert_eq!(difference(&frame, scene, &volume), None, "{estimator}");
        }
    }
}

/// The mean extinction around a point depends on what its ball reaches in the next macro-cell.
#[test]
fn a_ball_reaches_into_the_next_macro_cell() {
    // Flesh in one macro-cell, bone in the next, and nothing between.
    let (mut scene, volume) = few_values(Estimator::Points, 16, |[i, _, _]| match i {
        0..8 => 100,
        8 => 0,
        _ => 2000,
    });
    scene.settings.radius = Some(2.5);
    scene.materials[0].extinction = 0.2;
    scene.materials[0].ramp = vec![[50.0, 1.0], [150.0, 1.0]];
    let mut bone = scene.materials[0].clone();
    (bone.name, bone.extinction) = ("bone".into(), 0.1);
    bone.ramp = vec![[1900.0, 1.0], [2100.0, 1.0]];
    scene.materials.push(bone);
    let mut frame = frame(&scene, &volume, &Split::default());
    scene.materials[1].extinction = 0.11;
    let (_, done) = update(&mut frame, &scene, &Split::default());
    assert!(done.counts.changed > 0 && done.counts.changed < done.photons / 2, "{done:?}");
    assert_eq!(difference(&frame, &scene, &volume), None);
}

#[test]
fn lights_come_into_the_dark() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut dark = home.clone();
        dark.lights.clear();
        let split = Split { batch_photons: Some(300), ..Split::default() };
        let mut frame = frame(&dark, &volume, &split);
        let mut boundaries = Vec::new();
        frame.edit(gpu(), &home, &split).expect("applies");
        let mut never = |boundary: &str| {
            boundaries.push(boundary.to_owned());
            false
        };
        frame.update(gpu(), &split, &mut Progress::until(&mut never)).expect("updates");
        assert!(boundaries.len() < 10, "the journal has no room: {} parts", boundaries.len());
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

#[test]
fn a_light_that_goes_out_shines_again() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut dark = home.clone();
        dark.lights[0].emitted = DVec3::ZERO;
        let mut frame = frame(&dark, &volume, &Split::default());
        update(&mut frame, &home, &Split::default());
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

/// Photons that ended without power go on where they never flew: a flight each, though no
/// history tells.
#[test]
fn what_only_absorbed_scatters_again() {
    for estimator in [Estimator::Fluence, Estimator::Points] {
        let (home, volume) = world(estimator, Weighting::Even, Filter::Linear);
        let mut black = home.clone();
        black.materials[1].scatter = 0.0;
        let mut frame = frame(&black, &volume, &Split::default());
        let (_, done) = update(&mut frame, &home, &Split::default());
        assert!(done.counts.invalid == 0 && done.counts.tentative > 0, "{:?}", done.counts);
        assert_eq!(difference(&frame, &home, &volume), None, "{estimator}");
    }
}

/// Of an invalid flight only the marks are drawn that the edit can have made real.
#[test]
fn a_flight_is_flown_only_where_it_may_be_stopped() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    // One flight a photon through thin tissue alone, all of whose marks a rebuild draws.
    scene.settings.max_events = 1;
    scene.materials.truncate(1);
    scene.settings.skip_empty = false;
    let mut frame = frame(&scene, &volume, &Split::default());
    let full = frame.counts(gpu()).expect("reads");
    scene.materials[0].extinction *= 1.5;
    let (_, done) = update(&mut frame, &scene, &Split::default());
    let now = done.counts;
    assert!(now.invalid > 50, "{now:?}");
    let each = |tentative: u64, photons: u64| tentative as f64 / photons as f64;
    let [full, now] = [each(full.tentative, done.photons), each(now.tentative, now.invalid)];
    assert!(4.0 * now < 3.0 * full, "{now} tentative collisions a photon, in a rebuild {full}");
    assert_eq!(difference(&frame, &scene, &volume), None);
}

/// Another estimate of the light needs no other photons, and edits go on from there.
#[test]
fn photons_stay_where_the_light_is_estimated_anew() {
    let (mut scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let split = Split::default();
    let mut frame = frame(&scene, &volume, &split);
    for (estimator, weighting, size) in [
        (Estimator::Points, Weighting::Plain, 1.5_f64),
        (Estimator::Points, Weighting::Even, 2.0),
        (Estimator::Fluence, Weighting::Even, 0.5),
    ] {
        let settings = &mut scene.settings;
        (settings.estimator, settings.weighting) = (Some(estimator), weighting);
        (settings.radius, settings.grid) = (Some(size), size.min(1.0));
        let (scope, done) = update(&mut frame, &scene, &split);
        let anew = Anew { photons: false, light_field: true, segments: true };
        assert_eq!(scope, Scope::Anew(anew));
        assert_eq!((done.listed, done.counts.steps, done.counts.tentative), (0, 0, 0));
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}");
        scene.materials[1].extinction *= 0.8;
        let (_, done) = update(&mut frame, &scene, &split);
        assert!(done.counts.changed > 0);
        assert_eq!(difference(&frame, &scene, &volume), None, "{estimator}, edited");
    }
}

/// A g that is zero in single precision may have a sign, and bits that a gather is given.
#[test]
fn a_phase_of_less_than_single_precision_is_zero() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let mut frame = frame(&scene, &volume, &Split::default());
    for g in [-1e-60, 0.0, 1e-60] {
        scene.materials.iter_mut().for_each(|m| m.phase_g = g);
        update(&mut frame, &scene, &Split::default());
        assert_eq!(difference(&frame, &scene, &volume), None, "{g}");
    }
}
