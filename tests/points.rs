//! The tables of points against the slots of all photons, put in buckets by a sort on the host.

mod common;

use common::gpu;
use common::world::{frame, update, world};
use photogram::points::Contents;
use photogram::render::Split;
use photogram::scene::{Estimator, Filter, Weighting};
use photogram::segment::LightField;
use photogram::update::PhotonFrame;

/// Gather radius, mm: that of a test's scene.
const RADIUS: f32 = 7.5;

/// Cells along each axis.
fn grid(frame: &PhotonFrame) -> [u32; 3] {
    frame.scene.frame.extent.map(|e| (e / RADIUS).ceil() as u32)
}

/// The bucket of a point; there are few cells, and each is one.
fn bucket(place: &[u32; 4], grid: [u32; 3]) -> u32 {
    let at = |axis: usize| {
        let cell = (f32::from_bits(place[axis]) / RADIUS).floor() as u32;
        cell.min(grid[axis] - 1)
    };
    (at(2) * grid[1] + at(1)) * grid[0] + at(0)
}

/// Where the interactions of all photons are.
fn interactions(frame: &PhotonFrame) -> Vec<[u32; 4]> {
    let of = |batch: &photogram::photon::Batch| {
        let places = gpu().read::<[u32; 4]>("places", &batch.places).expect("reads");
        let states = gpu().read::<[u32; 4]>("states", &batch.states).expect("reads");
        let both = places.into_iter().zip(states);
        both.filter(|(_, state)| state[1] >> 30 == 1).map(|(place, _)| place).collect::<Vec<_>>()
    };
    frame.map.batches.iter().flat_map(of).collect()
}

/// What is wrong with the tables, if anything is.
fn fault(tables: &[Contents], expected: &[[u32; 4]], grid: [u32; 3]) -> Option<&'static str> {
    let mut found = Vec::new();
    for Contents { places, lights, starts } in tables {
        if starts.len() != grid.iter().product::<u32>() as usize + 1 {
            return Some("another number of buckets");
        }
        if lights.len() != places.len() || starts[starts.len() - 1] as usize != places.len() {
            return Some("points beyond the last bucket");
        }
        let mut sorted = places.clone();
        radsort::sort_by_key(&mut sorted, |place| bucket(place, grid));
        if places.iter().zip(&sorted).any(|(a, b)| bucket(a, grid) != bucket(b, grid)) {
            return Some("a point in another bucket's place");
        }
        let begin = |of: u32| sorted.partition_point(|place| bucket(place, grid) < of) as u32;
        if (0..).zip(starts).any(|(of, &start)| begin(of) != start) {
            return Some("a bucket that begins elsewhere");
        }
        found.extend(sorted);
    }
    let mut expected = expected.to_vec();
    found.sort_unstable();
    expected.sort_unstable();
    (found != expected).then_some("other points")
}

fn check(frame: &PhotonFrame, what: &str) {
    let LightField::Points(points) = &frame.field else { panic!("asked for points") };
    let tables = points.read(gpu()).expect("reads");
    assert_eq!(fault(&tables, &interactions(frame), grid(frame)), None, "{what}");
    assert!(points.count() > 100, "{what}: few points");
}

#[test]
fn tables_have_all_interactions_in_the_buckets_of_a_sort() {
    let plain = Split::default();
    let splits = [
        ("plain", plain, 1),
        ("batches", Split { batch_photons: Some(200), ..plain }, 1),
        ("tables", Split { batch_photons: Some(200), table_slots: Some(2500), ..plain }, 3),
        ("merged", Split { anew: Some(false), ..plain }, 1),
        ("anew", Split { anew: Some(true), ..plain }, 1),
    ];
    for weighting in [Weighting::Plain, Weighting::Even] {
        for (how, split, tables) in splits {
            let (mut scene, volume) = world(Estimator::Points, weighting, Filter::Linear);
            scene.settings.radius = Some(RADIUS.into());
            let mut frame = frame(&scene, &volume, &split);
            check(&frame, how);
            let LightField::Points(points) = &frame.field else { panic!("asked for points") };
            assert_eq!(points.tables(), tables, "{how}");
            let home = scene.clone();
            scene.materials[1].extinction = 0.9;
            update(&mut frame, &scene, &split);
            check(&frame, &format!("{how}: other extinction"));
            let lamp = scene.lights.remove(0);
            update(&mut frame, &scene, &split);
            check(&frame, &format!("{how}: a light that is gone"));
            scene.lights.push(lamp);
            update(&mut frame, &scene, &split);
            check(&frame, &format!("{how}: a light that came"));
            update(&mut frame, &home, &split);
            check(&frame, &format!("{how}: as it was"));
        }
    }
}

/// The check can fail.
#[test]
fn a_point_or_a_bucket_elsewhere_is_seen() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    scene.settings.radius = Some(RADIUS.into());
    let frame = frame(&scene, &volume, &Split::default());
    let LightField::Points(points) = &frame.field else { panic!("asked for points") };
    let (expected, grid) = (interactions(&frame), grid(&frame));
    let read = || points.read(gpu()).expect("reads");
    let mut swapped = read();
    let last = swapped[0].places.len() - 1;
    swapped[0].places.swap(0, last);
    assert_eq!(fault(&swapped, &expected, grid), Some("a point in another bucket's place"));
    let mut shifted = read();
    let at = shifted[0].starts.iter().position(|&start| start > 0).expect("some begin later");
    shifted[0].starts[at] -= 1;
    assert_eq!(fault(&shifted, &expected, grid), Some("a bucket that begins elsewhere"));
    let mut other = read();
    other[0].places[0][3] ^= 1;
    assert_eq!(fault(&other, &expected, grid), Some("other points"));
}
