//! The tables of points against the slots of all photons, each in the bucket of its cell.

mod common;

use common::gpu;
use common::world::{frame, update, world};
use photogram::field::points::Contents;
use photogram::measure::compare;
use photogram::scene::{Estimator, Filter, Scene, Weighting};
use photogram::split::Split;
use photogram::update::{PhotonFrame, Scope};

/// Gather radius, mm, of scenes whose cells are a bucket each; and of a scene whose cells are hashed.
const RADII: [f32; 2] = [7.5, 0.25];

/// Cells of this edge along each axis.
struct Grid {
    radius: f32,
    cells: [u32; 3],
}

impl Grid {
    fn of(frame: &PhotonFrame) -> Self {
        let points = frame.field.points().expect("points were asked for");
        let radius = points.radius;
        let cells = frame.scene.params.extent.map(|e| (e / radius).ceil() as u32);
        Self { radius, cells }
    }

    /// The cell of a point.
    fn cell(&self, place: &[u32; 4]) -> u32 {
        let at = |axis: usize| {
            let cell = (f32::from_bits(place[axis]) / self.radius).floor() as u32;
            cell.min(self.cells[axis] - 1)
        };
        (at(2) * self.cells[1] + at(1)) * self.cells[0] + at(0)
    }
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
fn fault(tables: &[Contents], expected: &[[u32; 4]], grid: &Grid) -> Option<&'static str> {
    let mut found = Vec::new();
    for Contents { places, lights, starts, cells, .. } in tables {
        if starts.len() != cells.len() + 1 || starts[0] != 0 {
            return Some("another number of buckets");
        }
        if lights.len() != places.len() || starts[cells.len()] as usize != places.len() {
            return Some("points beyond the last bucket");
        }
        let mut known = cells.iter().flatten().collect::<Vec<_>>();
        known.sort_unstable();
        if known.windows(2).any(|pair| pair[0] == pair[1]) {
            return Some("a cell with two buckets");
        }
        for (range, cell) in starts.windows(2).zip(cells) {
            let Some(inside) = places.get(range[0] as usize..range[1] as usize) else {
                return Some("a bucket that begins elsewhere");
            };
            if inside.iter().any(|place| Some(grid.cell(place)) != *cell) {
                return Some("a point in another bucket's place");
            }
        }
        found.extend_from_slice(places);
    }
    let mut expected = expected.to_vec();
    found.sort_unstable();
    expected.sort_unstable();
    (found != expected).then_some("other points")
}

fn check(frame: &PhotonFrame, what: &str) {
    let points = frame.field.points().expect("points were asked for");
    let tables = points.read(gpu()).expect("reads");
    assert_eq!(fault(&tables, &interactions(frame), &Grid::of(frame)), None, "{what}");
    assert!(points.count() > 100, "{what}: few points");
}

#[test]
fn tables_have_all_interactions_in_the_buckets_of_their_cells() {
    let plain = Split::default();
    let [radius, least] = RADII;
    let splits = [
        ("plain", radius, plain, 1),
        ("batches", radius, Split { batch_photons: Some(200), ..plain }, 1),
        ("tables", radius, Split { batch_photons: Some(200), table_slots: Some(2500), ..plain }, 3),
        (
            "a table for each",
            radius,
            Split { batch_photons: Some(600), table_slots: Some(1), ..plain },
            2,
        ),
        ("merged", radius, Split { anew: Some(false), ..plain }, 1),
        ("anew", radius, Split { anew: Some(true), ..plain }, 1),
        ("many cells", least, plain, 1),
        ("hashed", radius, Split { buckets: Some(1), ..plain }, 1),
        (
            "hashed tables",
            radius,
            Split { buckets: Some(1), batch_photons: Some(200), table_slots: Some(2500), ..plain },
            3,
        ),
        ("hashed, merged", radius, Split { buckets: Some(1), anew: Some(false), ..plain }, 1),
    ];
    for weighting in [Weighting::Plain, Weighting::Even] {
        for (how, radius, split, tables) in splits {
            let (mut scene, volume) = world(Estimator::Points, weighting, Filter::Linear);
            scene.settings.radius = Some(radius.into());
            let mut frame = frame(&scene, &volume, &split);
            check(&frame, how);
            let points = frame.field.points().expect("points were asked for");
            assert_eq!(points.tables(), tables, "{how}");
            let home = scene.clone();
            let mut edit = |scene: &Scene, what: &str| {
                let (scope, _) = update(&mut frame, scene, &split);
                check(&frame, &format!("{how}: {what}"));
                scope
            };
            scene.materials[1].extinction = 0.9;
            edit(&scene, "other extinction");
            // The sky has the fewer photons: the lamp's stay.
            let mut sky = scene.lights.remove(1);
            assert_eq!(edit(&scene, "a light that is gone"), Scope::Part);
            scene.lights.push(sky.clone());
            assert_eq!(edit(&scene, "a light that came"), Scope::Part);
            sky.share = 0.3;
            scene.lights[1] = sky;
            assert_eq!(edit(&scene, "a light of fewer photons"), Scope::Part);
            scene.lights.remove(0);
            edit(&scene, "most photons gone");
            edit(&home, "as it was");
        }
    }
}

/// A look-up in a hash table tests the points of its cells, and no others.
#[test]
fn as_many_points_are_tested_where_cells_are_hashed() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    let plain = Split::default();
    for radius in [2.0, 7.5] {
        scene.settings.radius = Some(radius);
        let tested = [plain, Split { buckets: Some(1), ..plain }].map(|split| {
            let frame = frame(&scene, &volume, &split);
            frame.counts(gpu()).expect("reads").gathered
        });
        assert!(tested[0] > 50 && tested[0] == tested[1], "{tested:?}");
    }
}

/// What differs between tables is counted, in whatever order their points are.
#[test]
fn points_that_differ_are_counted() {
    let (scene, volume) = world(Estimator::Points, Weighting::Plain, Filter::Linear);
    let [one, again] = [(); 2].map(|()| frame(&scene, &volume, &Split::default()));
    assert_eq!(compare(gpu(), &one, &again).expect("reads").field_mismatches, 0);
    let points = one.field.points().expect("points were asked for");
    let all = points.sorted(gpu()).expect("reads");
    let mut brighter = scene.clone();
    brighter.materials[1].colour *= 0.5;
    let brighter = frame(&brighter, &volume, &Split::default());
    let points = brighter.field.points().expect("points were asked for");
    let others = points.sorted(gpu()).expect("reads");
    let differ = all.iter().filter(|point| !others.contains(point)).count() as u64;
    assert!(differ > 0 && differ < all.len() as u64);
    assert_eq!(compare(gpu(), &one, &brighter).expect("reads").field_mismatches, differ);
}

/// The check can fail.
#[test]
fn a_point_or_a_bucket_elsewhere_is_seen() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Even, Filter::Linear);
    scene.settings.radius = Some(RADII[0].into());
    let frame = frame(&scene, &volume, &Split::default());
    let points = frame.field.points().expect("points were asked for");
    let (expected, grid) = (interactions(&frame), Grid::of(&frame));
    let read = || points.read(gpu()).expect("reads");
    let mut swapped = read();
    let last = swapped[0].places.len() - 1;
    swapped[0].places.swap(0, last);
    assert_eq!(fault(&swapped, &expected, &grid), Some("a point in another bucket's place"));
    let mut shifted = read();
    let at = shifted[0].starts.iter().position(|&start| start > 0).expect("some begin later");
    shifted[0].starts[at] -= 1;
    assert_eq!(fault(&shifted, &expected, &grid), Some("a point in another bucket's place"));
    let mut other = read();
    other[0].places[0][3] ^= 1;
    assert_eq!(fault(&other, &expected, &grid), Some("other points"));
}

/// Near paper size: 32 million cells, of which most are empty, and about a million points. More would not
/// fit a binding here, where each has a bucket of its own.
#[test]
fn a_million_points_in_many_cells_lie_in_their_own() {
    let (mut scene, volume) = world(Estimator::Points, Weighting::Plain, Filter::Linear);
    let longest = volume.extent().max_element();
    scene.settings.radius = Some(longest / 470.0);
    scene.settings.photons = 1_100_000;
    (scene.camera.width, scene.camera.height) = (6, 5);
    let split = Split { salt: Some(0x5eed), ..Split::default() };
    let [one, other] = [Split::default(), split].map(|split| frame(&scene, &volume, &split));
    check(&one, "a million points");
    let points = one.field.points().expect("points were asked for");
    assert!(points.count() > 1_000_000, "{} points", points.count());
    // Another hash has the same points, tests as many, and gives the same light.
    check(&other, "another hash");
    let tested = [&one, &other].map(|frame| frame.counts(gpu()).expect("reads").gathered);
    assert!(tested[0] > 0 && tested[0] == tested[1], "{tested:?}");
    assert_eq!(compare(gpu(), &one, &other).expect("reads").all(), 0);
    // And as many as where each cell has a bucket of its own.
    let dense = Split { buckets: Some(u32::MAX), ..Split::default() };
    let both = [frame(&scene, &volume, &dense), one];
    let tested = both.each_ref().map(|frame| frame.counts(gpu()).expect("reads").gathered);
    assert!(tested[0] > 0 && tested[0] == tested[1], "{tested:?}");
    let buckets = both.each_ref().map(|frame| {
        let points = frame.field.points().expect("points were asked for");
        points.read(gpu()).expect("reads")[0].cells.len()
    });
    assert!(buckets[0] > 2 * buckets[1], "{buckets:?}: both are hashed, or none is");
}
