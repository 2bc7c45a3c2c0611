//! The reference against Mitsuba's answers, by statistics: Welch's t on blocks of 4x4
//! pixels, corrected for their number, and z on the means of whole images.

mod common;

use common::{TRUTH, gpu, truth_image, truth_scene};
use photogram::device_scene::DeviceScene;
use photogram::film::Image;
use photogram::gpu::Progress;
use photogram::reference::Reference;
use photogram::scene::{Method, Scene};
use photogram::volume::Volume;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// Edge of a block, pixels.
const BLOCK: usize = 4;
/// Independent runs behind the truth's standard errors (see tests/truth/make_truth.py).
const TRUTH_RUNS: f64 = 16.0;
/// Chance that a right renderer fails one comparison of a scene.
const SIGNIFICANCE: f64 = 0.01;

fn reference(scene: &Scene, volume: &Volume, samples: u32) -> (Image, Image) {
    let device = DeviceScene::new(gpu(), scene, volume).expect("uploads");
    let mut reference = Reference::new(gpu(), scene, &device).expect("fits");
    reference.add(gpu(), &device, samples, &mut Progress::silent()).expect("traces");
    let estimate = reference.image(gpu()).expect("reads");
    (estimate.mean, estimate.error)
}

/// Mean and squared standard error over some pixels, and the sum that Welch and
/// Satterthwaite's degrees of freedom need.
struct Estimate {
    mean: f64,
    variance: f64,
    quartic: f64,
}

fn estimate(image: &Image, error: &Image, channel: usize, pixels: &[usize], runs: f64) -> Estimate {
    let n = pixels.len() as f64;
    let variance = |p: usize| f64::from(error.rgb[p][channel]).powi(2) / (n * n);
    Estimate {
        mean: pixels.iter().map(|&p| f64::from(image.rgb[p][channel])).sum::<f64>() / n,
        variance: pixels.iter().map(|&p| variance(p)).sum(),
        quartic: pixels.iter().map(|&p| variance(p).powi(2) / (runs - 1.0)).sum(),
    }
}

struct Comparison {
    /// Blocks compared.
    blocks: usize,
    /// The least p-value of a block times their number (Bonferroni).
    worst_block: f64,
    /// z of the whole image, in each channel.
    z: [f64; 3],
}

impl Comparison {
    fn agrees(&self) -> bool {
        self.worst_block > SIGNIFICANCE && self.z.iter().all(|z| z.abs() < 4.0)
    }
}

fn compare(ours: (&Image, &Image), samples: u32, truth: (&Image, &Image)) -> Comparison {
    let (width, height) = (ours.0.width as usize, ours.0.height as usize);
    let pair = |channel: usize, pixels: &[usize]| {
        let x = estimate(ours.0, ours.1, channel, pixels, f64::from(samples));
        let t = estimate(truth.0, truth.1, channel, pixels, TRUTH_RUNS);
        let variance = x.variance + t.variance;
        let freedom = variance * variance / (x.quartic + t.quartic);
        (x.mean - t.mean, variance.sqrt(), freedom, t.mean)
    };
    let mut p_values = Vec::new();
    for (bx, by) in (0..height / BLOCK).flat_map(|y| (0..width / BLOCK).map(move |x| (x, y))) {
        let pixels: Vec<_> = (0..BLOCK * BLOCK)
            .map(|i| (by * BLOCK + i / BLOCK) * width + bx * BLOCK + i % BLOCK)
            .collect();
        for channel in 0..3 {
            let (off, error, freedom, mean) = pair(channel, &pixels);
            if mean > 0.0 && error < 0.1 * mean {
                let t = StudentsT::new(0.0, 1.0, freedom).expect("freedom is positive");
                p_values.push(2.0 * t.cdf(-(off / error).abs()));
            }
        }
    }
    let all: Vec<_> = (0..width * height).collect();
    let z = [0, 1, 2].map(|channel| {
        let (off, error, _, _) = pair(channel, &all);
        off / error
    });
    let worst = p_values.iter().copied().fold(1.0, f64::min);
    Comparison { blocks: p_values.len(), worst_block: worst * p_values.len() as f64, z }
}

/// The image under a light that is brighter by a factor: radiance is linear in it.
fn lit(mut image: Image, factor: f32) -> Image {
    image.rgb.iter_mut().flatten().for_each(|x| *x *= factor);
    image
}

#[test]
fn the_reference_agrees_with_mitsuba_and_a_fault_of_one_per_cent_does_not() {
    for name in TRUTH {
        let samples = if name == "cloud_forward" { 768 } else { 512 };
        let (scene, volume) = truth_scene(name);
        let (mut image, mut error) = reference(&scene, &volume, samples);
        let (truth, truth_error) = truth_image(name);
        for factor in [1.0, 1.01] {
            (image, error) = (lit(image, factor), lit(error, factor));
            let c = compare((&image, &error), samples, (&truth, &truth_error));
            println!(
                "{name} x{factor}: {samples} samples, {} blocks, least p x blocks {:.3}, z {:.2?}",
                c.blocks, c.worst_block, c.z
            );
            assert!(c.blocks > 300, "{name}: only {} blocks are sharp enough", c.blocks);
            assert_eq!(c.agrees(), factor == 1.0, "{name}, x{factor}");
        }
    }
}

#[test]
fn monte_carlo_ray_casting_is_the_reference_stopped_at_one_event() {
    let (mut scene, volume) = truth_scene("ball_multiple");
    scene.settings.method = Method::Mcvr;
    let (image, error) = reference(&scene, &volume, 256);
    let (truth, truth_error) = truth_image("ball_single");
    assert!(compare((&image, &error), 256, (&truth, &truth_error)).agrees());
}
