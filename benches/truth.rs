//! The photon map against the truth scenes: relMSE, leak and energy over photons and
//! radius or grid, for the three estimators.
//!
//!     cargo bench --bench truth -- [--scene NAME]... [--photons N]... [--rays N] [--out FOLDER]
//!
//! Prints a table and writes `truth.csv` to the folder (default out/truth).

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Parser;
use photogram::film::Image;
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::metrics::Metrics;
use photogram::render::{Progress, Split, render};
use photogram::scene::{Estimator, Scene, Weighting};

#[derive(Parser)]
struct Args {
    #[arg(long, default_values = ["ball_single", "ball_multiple", "knuckle", "knuckle_bone_edit", "knuckle_vessel_edit", "cloud_forward"])]
    scene: Vec<String>,
    #[arg(long, default_values_t = [10_000, 100_000, 1_000_000])]
    photons: Vec<u64>,
    /// Gather radii, voxels
    #[arg(long, default_values_t = [4.0, 2.0, 1.0, 0.5])]
    radius: Vec<f64>,
    /// Fluence cells per voxel
    #[arg(long, default_values_t = [0.25, 0.5, 1.0])]
    grid: Vec<f64>,
    #[arg(long, default_value_t = 16)]
    rays: u32,
    #[arg(long)]
    max_events: Option<u32>,
    #[arg(long, default_value = "out/truth")]
    out: PathBuf,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let gpu = Gpu::open(&AdapterChoice::Best)?;
    println!("adapter: {}; {} rays a pixel", gpu.report().name, args.rays);
    println!(
        "scene               estimator     size  photons    relMSE    leak  energy  trace ms field ms gather ms"
    );
    let mut csv =
        "scene,estimator,size,photons,rel_mse,leak,energy,trace_ms,field_ms,gather_ms\n".to_owned();
    for name in &args.scene {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/truth");
        let mut scene = Scene::load(folder.join(format!("{name}.toml")))?;
        let truth = Image::read_exr(folder.join(format!("{name}.exr")))?;
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        scene.settings.rays = args.rays;
        scene.settings.max_events = args.max_events.unwrap_or(scene.settings.max_events);
        let isotropic = scene.materials.iter().all(|m| m.phase_g == 0.0);
        let mut variants = Vec::new();
        for (weighting, label) in
            [(Weighting::Plain, "points plain"), (Weighting::Even, "points even")]
        {
            variants.extend(args.radius.iter().map(|&r| (Estimator::Points, weighting, label, r)));
        }
        if isotropic {
            let even = Weighting::Even;
            variants.extend(args.grid.iter().map(|&g| (Estimator::Fluence, even, "fluence", g)));
        }
        for (estimator, weighting, label, size) in variants {
            for &photons in &args.photons {
                let s = &mut scene.settings;
                (s.estimator, s.weighting, s.photons) = (Some(estimator), weighting, photons);
                match estimator {
                    Estimator::Points => s.radius = Some(size * volume.spacing().min_element()),
                    Estimator::Fluence => s.grid = size,
                }
                let done =
                    render(&gpu, &scene, &volume, &Split::default(), &mut Progress::silent())?;
                let m = Metrics::of(&done.image, &truth)?;
                let ms = |test: &dyn Fn(&str) -> bool| -> f64 {
                    done.report.stages.iter().filter(|r| test(r.stage)).map(|r| r.ms).sum()
                };
                let (trace, gather) = (ms(&|s| s == "trace"), ms(&|s| s == "segment"));
                let field = ms(&|s| !["trace", "segment", "composite"].contains(&s));
                println!(
                    "{name:<20}{label:<13}{size:>5} {photons:>8} {:>9.5} {:>7.4} {:>7.4} {trace:>9.0} {field:>8.0} {gather:>9.0}",
                    m.rel_mse, m.leak, m.energy
                );
                writeln!(
                    csv,
                    "{name},{label},{size},{photons},{},{},{},{trace},{field},{gather}",
                    m.rel_mse, m.leak, m.energy
                )?;
            }
        }
    }
    std::fs::create_dir_all(&args.out)?;
    std::fs::write(args.out.join("truth.csv"), csv)?;
    Ok(())
}
