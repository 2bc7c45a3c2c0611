//! Histories against an oracle: a plain computation on the host of what each flight and
//! each segment relied on, sharing no code with the kernels. Whatever the edits before, a
//! mask must contain it; by how much it exceeds it is printed.

mod common;

use common::gpu;
use common::oracle::Oracle;
use common::snapshot::snapshot;
use common::world::{CLASSES, Dice, frame, random_edit, random_world, update, world};
use photogram::field::points::Points;
use photogram::scene::{Estimator, Filter, LightKind, Weighting};
use photogram::split::Split;

const VARIANTS: [(Estimator, Filter); 4] = [
    (Estimator::Fluence, Filter::Linear),
    (Estimator::Fluence, Filter::Nearest),
    (Estimator::Points, Filter::Linear),
    (Estimator::Points, Filter::Nearest),
];

#[test]
fn histories_contain_what_was_relied_on() {
    for (seed, (estimator, filter)) in (1..).zip(VARIANTS) {
        let (home, volume) = world(estimator, Weighting::Even, filter);
        let mut frame = frame(&home, &volume, &Split::default());
        let mut scene = home.clone();
        let mut dice = Dice(seed);
        for edit in 0..25 {
            let found = Oracle::new(&volume, &scene, &frame).judge(&snapshot(gpu(), &frame));
            assert_eq!(
                found.missing,
                [0, 0],
                "{estimator}, {filter}, after {edit} edits: {found:?}"
            );
            // Edits of settings have fewer photons and pixels.
            assert!(found.relied_on.iter().all(|&n| n > 30), "{estimator}, {filter}: {found:?}");
            if let Some(points) = frame.field.points() {
                let means = means(points);
                let found =
                    Oracle::new(&volume, &scene, &frame).judge_means(&means, points.radius.into());
                assert_eq!(found.missing[0], 0, "{filter}, after {edit} edits: {found:?}");
                assert!(found.relied_on[0] > 100, "{filter}: {found:?}");
                if edit == 24 {
                    println!(
                        "a mean's mask has {:.2} times the bits that it needs",
                        found.excess()[0]
                    );
                }
            }
            if edit == 0 || edit == 24 {
                let [slots, segments] = found.excess();
                println!(
                    "{estimator}, {filter}, after {edit} edits: a slot's mask has {slots:.2} times \
                     the bits that it needs, a segment's {segments:.2}; {found:?}"
                );
            }
            random_edit(&mut scene, CLASSES[edit % CLASSES.len()], &mut dice, &home);
            update(&mut frame, &scene, &Split::default());
        }
    }
}

/// The same of random worlds: volumes of all kinds, several batches, lights and settings as they
/// come, with and without skipping of empty space.
#[test]
fn histories_of_random_worlds_contain_what_was_relied_on() {
    let split = Split { batch_photons: Some(300), band_rows: Some(7), ..Split::default() };
    let mut judged = [0; 2];
    for seed in 0..12 {
        let mut dice = Dice(100 + seed);
        let (mut home, volume) = random_world(&mut dice);
        // The oracle knows rays through the middle of pixels, and photons that come from outside.
        home.settings.rays = 1;
        for light in &mut home.lights {
            if let LightKind::Point { position } = &mut light.kind {
                *position *= 100.0;
            }
        }
        let mut frame = frame(&home, &volume, &split);
        let mut scene = home.clone();
        for edit in 0..6 {
            let found = Oracle::new(&volume, &scene, &frame).judge(&snapshot(gpu(), &frame));
            assert_eq!(found.missing, [0, 0], "world {seed}, after {edit} edits: {found:?}");
            for (sum, n) in judged.iter_mut().zip(found.relied_on) {
                *sum += n;
            }
            let class = CLASSES[dice.below(CLASSES.len())];
            if class != "light moved" {
                random_edit(&mut scene, class, &mut dice, &home);
            }
            update(&mut frame, &scene, &split);
        }
    }
    assert!(judged.iter().all(|&n| n > 20_000), "{judged:?}");
}

/// The historygrams of the means around points, with the points' places.
fn means(points: &Points) -> Vec<([u32; 4], u64)> {
    let tables = points.read(gpu()).expect("reads").into_iter();
    tables.flat_map(|table| table.places.into_iter().zip(table.mean_histories)).collect()
}

/// The oracle can fail: points that have another's mean are seen, and one bit less is.
#[test]
fn means_of_others_are_seen() {
    let (scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let frame = frame(&scene, &volume, &Split::default());
    let points = frame.field.points().expect("points were asked for");
    let oracle = Oracle::new(&volume, &scene, &frame);
    let (whole, radius) = (means(points), points.radius.into());
    let judged = oracle.judge_means(&whole, radius);
    assert_eq!(judged.missing[0], 0);
    assert!(judged.needed[0].count_ones() > 10, "{judged:x?}");
    let mut shifted = whole.clone();
    for i in 1..whole.len() {
        shifted[i].1 = whole[i - 1].1;
    }
    assert!(oracle.judge_means(&shifted, radius).missing[0] > 0);
    for bit in (0..64).filter(|bit| judged.needed[0] >> bit & 1 == 1) {
        let less: Vec<_> = whole.iter().map(|(p, mask)| (*p, mask & !(1 << bit))).collect();
        assert!(oracle.judge_means(&less, radius).missing[0] > 0, "bit {bit}");
    }
}

/// The oracle can fail: one bit less is seen.
#[test]
fn one_bit_less_is_seen() {
    let (scene, volume) = world(Estimator::Fluence, Weighting::Even, Filter::Linear);
    let frame = frame(&scene, &volume, &Split::default());
    let oracle = Oracle::new(&volume, &scene, &frame);
    let whole = snapshot(gpu(), &frame);
    let needed = oracle.judge(&whole).needed;
    assert!(needed.iter().all(|bits| bits.count_ones() > 10), "{needed:x?}");
    for bit in 0..64 {
        let word = bit / 32;
        let mut less = whole.clone();
        less.slots.iter_mut().for_each(|[_, state]| state[2 + word] &= !(1 << (bit % 32)));
        less.segments.iter_mut().for_each(|s| s[4 + word] &= !(1 << (bit % 32)));
        let missing = oracle.judge(&less).missing;
        for (bits, missing) in needed.into_iter().zip(missing) {
            assert_eq!(missing > 0, bits >> bit & 1 == 1, "bit {bit}");
        }
    }
    assert_eq!(oracle.judge(&whole).missing, [0, 0]);
}
