//! What several tests share.
#![allow(dead_code)]

pub mod draws;
pub mod oracle;
pub mod snapshot;
pub mod world;

use std::path::PathBuf;
use std::sync::OnceLock;

use photogram::film::Image;
use photogram::gpu::Progress;
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::render::{Rendered, render};
use photogram::scene::Scene;
use photogram::split::Split;
use photogram::volume::Volume;

/// The adapter that all tests of a program share.
pub fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| {
        pollster::block_on(photogram::open(&AdapterChoice::Best))
            .unwrap_or_else(|e| panic!("no adapter to test on: {e}"))
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

/// A scene of this text over a volume made by the test, settled. The text needs
/// no `[volume]`.
pub fn scene_over(volume: &Volume, text: &str) -> Scene {
    let text = format!("{text}\n[volume]\nfile = \"made by the test\"\n");
    let mut scene = Scene::parse(&text, "test.toml").expect("the scene reads");
    scene.settle(volume);
    scene
}

/// Comparisons of draws or estimates with what must be, judged together.
#[derive(Default)]
pub struct Judged(Vec<(String, f64)>);

impl Judged {
    /// Chance that a right program fails one test, however many comparisons it makes.
    pub const SIGNIFICANCE: f64 = 1e-3;

    /// Pearson's chi-square: counts against the shares that they must have; bins of
    /// fewer than ten are judged as one.
    pub fn counts(&mut self, name: impl Into<String>, observed: &[u64], shares: &[f64]) {
        use statrs::distribution::{ChiSquared, ContinuousCDF};
        assert_eq!(observed.len(), shares.len());
        let total = observed.iter().sum::<u64>() as f64 / shares.iter().sum::<f64>();
        let (mut chi, mut bins, mut rest) = (0.0, 0, (0.0, 0.0));
        let mut add = |o: f64, e: f64| {
            chi += (o - e).powi(2) / e;
            bins += 1;
        };
        for (&o, &share) in observed.iter().zip(shares) {
            let (o, e) = (o as f64, share * total);
            match e < 10.0 {
                true => rest = (rest.0 + o, rest.1 + e),
                false => add(o, e),
            }
        }
        if rest.0 + rest.1 > 0.0 {
            add(rest.0, rest.1);
        }
        let law = ChiSquared::new(f64::from(bins - 1)).expect("there are two bins or more");
        self.0.push((format!("{}: chi-square {chi:.1} of {bins} bins", name.into()), law.sf(chi)));
    }

    /// An estimate with its standard error; a millionth is left to rounding.
    pub fn estimate(&mut self, name: impl Into<String>, mean: f64, error: f64, truth: f64) {
        use statrs::distribution::{ContinuousCDF, Normal};
        let z = (mean - truth) / error.hypot(1e-6 * truth.abs()).max(f64::MIN_POSITIVE);
        let p = 2.0 * Normal::standard().cdf(-z.abs());
        self.0.push((format!("{}: {mean:.6} for {truth:.6}, z {z:.2}", name.into()), p));
    }

    /// Whether all hold, corrected for their number (Bonferroni).
    pub fn hold(&self) -> bool {
        let worst = self.0.iter().min_by(|a, b| a.1.total_cmp(&b.1)).expect("something is judged");
        let p = (worst.1 * self.0.len() as f64).min(1.0);
        println!("{} comparisons, the worst {} (p x number {p:.2e})", self.0.len(), worst.0);
        p > Self::SIGNIFICANCE
    }
}

/// Nodes and weights of Gauss and Legendre on [0, 1].
pub fn gauss(n: usize) -> Vec<(f64, f64)> {
    let node = |i: usize| {
        let mut x = (std::f64::consts::PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
        let mut slope = 0.0;
        for _ in 0..20 {
            let (mut before, mut p) = (1.0, x);
            for k in 2..=n {
                let k = k as f64;
                (before, p) = (p, ((2.0 * k - 1.0) * x * p - (k - 1.0) * before) / k);
            }
            slope = n as f64 * (x * p - before) / (x * x - 1.0);
            x -= p / slope;
        }
        ((1.0 + x) / 2.0, 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..n).map(node).collect()
}
