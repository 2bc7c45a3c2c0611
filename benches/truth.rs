//! The photon map against the truth scenes: relMSE, leak and energy over photons and
//! radius or grid, for the three estimators.
//!
//!     cargo bench --bench truth -- [--scene NAME]... [--photons N]... [--rays N] [--out FOLDER]
//!
//! Prints a table, and writes `truth.csv` and a chart of each scene to the folder
//! (default out/truth).

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Parser;
use photogram::film::Image;
use photogram::film::metrics::Metrics;
use photogram::gpu::Progress;
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::render::render;
use photogram::scene::{Estimator, Method, Scene, Weighting};
use photogram::split::Split;
use photogram::volume::Volume;
use plotters::prelude::*;

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
    /// Rays a pixel; fewer where the radius makes gathers dear
    #[arg(long, default_value_t = 16)]
    rays: u32,
    /// Gathers dearer than this many photons in a ball of one voxel are left out
    #[arg(long, default_value_t = 1e7)]
    limit: f64,
    #[arg(long)]
    max_events: Option<u32>,
    #[arg(long, default_value = "out/truth")]
    out: PathBuf,
    /// Draws the charts again from the folder's `truth.csv`, and measures nothing
    #[arg(long)]
    redraw: bool,
    /// Given by cargo
    #[arg(long, hide = true)]
    bench: bool,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    if args.redraw {
        let csv = std::fs::read_to_string(args.out.join("truth.csv"))?;
        let rows: Vec<Row> = csv.lines().skip(1).map(Row::read).collect::<anyhow::Result<_>>()?;
        return charts(&args, &rows);
    }
    let gpu = pollster::block_on(photogram::open(&AdapterChoice::Best))?;
    println!("adapter: {}", gpu.report().name);
    println!(
        "scene               estimator     size  photons rays    relMSE    leak  energy  trace ms field ms gather ms"
    );
    let mut csv =
        "scene,estimator,size,photons,rays,rel_mse,leak,energy,trace_ms,field_ms,gather_ms\n"
            .to_owned();
    let mut rows = Vec::new();
    for name in &args.scene {
        let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/truth");
        let mut scene = Scene::load(folder.join(format!("{name}.toml")))?;
        let truth = Image::read_exr(folder.join(format!("{name}.exr")))?;
        let volume = scene.volume.load()?;
        scene.settle(&volume);
        scene.settings.max_events = args.max_events.unwrap_or(scene.settings.max_events);
        println!("{name}: 99 % of the energy within {} events", events_for(&gpu, &scene, &volume)?);
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
                let dear = size.max(1.0).powi(3);
                if dear * photons as f64 > args.limit {
                    continue;
                }
                s.rays = (args.rays / size.max(1.0).powi(2) as u32).max(1);
                let rays = s.rays;
                let done =
                    render(&gpu, &scene, &volume, &Split::default(), &mut Progress::silent())?;
                let m = Metrics::of(&done.image, &truth)?;
                let ms = |test: &dyn Fn(&str) -> bool| -> f64 {
                    done.report.stages.iter().filter(|r| test(r.stage)).map(|r| r.ms).sum()
                };
                let (trace, gather) = (ms(&|s| s == "trace"), ms(&|s| s == "segment"));
                let field = ms(&|s| !["trace", "segment", "composite"].contains(&s));
                println!(
                    "{name:<20}{label:<13}{size:>5} {photons:>8} {rays:>4} {:>9.5} {:>7.4} {:>7.4} {trace:>9.0} {field:>8.0} {gather:>9.0}",
                    m.rel_mse, m.leak, m.energy
                );
                let (scene, rel_mse) = (name.clone(), m.rel_mse);
                rows.push(Row { scene, label: label.to_owned(), size, photons, rel_mse });
                writeln!(
                    csv,
                    "{name},{label},{size},{photons},{rays},{},{},{},{trace},{field},{gather}",
                    m.rel_mse, m.leak, m.energy
                )?;
            }
        }
    }
    std::fs::create_dir_all(&args.out)?;
    std::fs::write(args.out.join("truth.csv"), csv)?;
    charts(&args, &rows)
}

fn charts(args: &Args, rows: &[Row]) -> anyhow::Result<()> {
    for name in &args.scene {
        let rows: Vec<_> = rows.iter().filter(|r| r.scene == *name).collect();
        chart(&args.out.join(format!("{name}.svg")), name, &rows)?;
    }
    Ok(())
}

/// Scattering orders that carry 99 % of the image's energy, by the reference: paths of
/// the same seed have the same beginning, so the share rises with the order.
fn events_for(gpu: &Gpu, scene: &Scene, volume: &Volume) -> anyhow::Result<u32> {
    let mut scene = scene.clone();
    (scene.settings.method, scene.settings.samples) = (Method::Reference, 64);
    let given = scene.settings.reference_events;
    let mut energy = |events| -> anyhow::Result<f64> {
        scene.settings.reference_events = events;
        let done = render(gpu, &scene, volume, &Split::default(), &mut Progress::silent())?;
        Ok(done.image.rgb.iter().flatten().map(|&x| f64::from(x)).sum())
    };
    let all = energy(given)?;
    let (mut low, mut high) = (1, 64);
    while low < high {
        let middle = (low + high) / 2;
        if energy(Some(middle))? >= 0.99 * all { high = middle } else { low = middle + 1 }
    }
    Ok(high)
}

struct Row {
    scene: String,
    label: String,
    size: f64,
    photons: u64,
    rel_mse: f64,
}

impl Row {
    fn read(line: &str) -> anyhow::Result<Self> {
        let cells: Vec<_> = line.split(',').collect();
        let [scene, label, size, photons, _, rel_mse, ..] = cells[..] else {
            anyhow::bail!("`{line}` is no row of truth.csv");
        };
        Ok(Self {
            scene: scene.to_owned(),
            label: label.to_owned(),
            size: size.parse()?,
            photons: photons.parse()?,
            rel_mse: rel_mse.parse()?,
        })
    }
}

/// Error over photons, a line for each estimator and size.
fn chart(path: &Path, title: &str, rows: &[&Row]) -> anyhow::Result<()> {
    let photons = |f: fn(u64, u64) -> u64| rows.iter().map(|r| r.photons).reduce(f).unwrap_or(1);
    let (few, many) = (photons(u64::min) as f64, photons(u64::max) as f64);
    let root = SVGBackend::new(path, (760, 460)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(format!("{title}: error over photons"), ("sans-serif", 18))
        .margin(10)
        .x_label_area_size(40)
        .y_label_area_size(60)
        .margin_right(160)
        .build_cartesian_2d((few..many).log_scale(), (1e-3..2.0).log_scale())?;
    chart.configure_mesh().x_desc("photons").y_desc("relMSE").draw()?;
    let mut lines: Vec<(&str, f64)> = rows.iter().map(|r| (r.label.as_str(), r.size)).collect();
    lines.dedup();
    for (label, size) in lines {
        // A colour for each estimator, paler where it is coarser.
        let (colour, unit, finest) = match label {
            "points plain" => (RGBColor(200, 60, 40), "r =", 0.5),
            "points even" => (RGBColor(40, 90, 200), "r =", 0.5),
            _ => (RGBColor(20, 140, 60), "grid", 1.0),
        };
        let coarser = if unit == "grid" { finest / size } else { size / finest };
        let style = colour.mix(1.0 / (1.0 + 0.35 * f64::log2(coarser))).stroke_width(2);
        let points: Vec<_> = rows
            .iter()
            .filter(|r| (r.label.as_str(), r.size) == (label, size))
            .map(|r| (r.photons as f64, r.rel_mse))
            .collect();
        let end = points[points.len() - 1];
        chart.draw_series(LineSeries::new(points.clone(), style))?;
        chart.draw_series(points.iter().map(|&p| Circle::new(p, 2, style.filled())))?;
        let text = format!("{label}, {unit} {size}");
        let font = ("sans-serif", 12).into_font().color(&colour);
        chart.plotting_area().draw(&(EmptyElement::at(end) + Text::new(text, (6, -6), font)))?;
    }
    root.present()?;
    Ok(())
}
