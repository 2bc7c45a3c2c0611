//! The irradiance cache beside plain Monte-Carlo ray casting: errors at equal time, after the paper's
//! table 2. True errors, against a converged picture of another program part.

use std::path::Path;

use glam::DVec3;
use serde_json::json;

use super::{Chart, Effort, Report, Series, Sheet, Truth, built_in};
use crate::device_scene::DeviceScene;
use crate::error::Result;
use crate::film::Image;
use crate::gpu::{Gpu, Progress};
use crate::irradiance::{Images, IrradianceCache, Until};
use crate::scene::{Cache, Light, LightKind, Method, Scene, Shadows};
use crate::volume::Volume;

/// Frames after which errors are taken.
const FRAMES: [u32; 4] = [5, 20, 50, 200];
/// Samples a pixel of the converged picture.
const SAMPLES: u32 = 512;
/// Pixels across and down, at most.
const PIXELS: u32 = 96;

/// The paper's light setups, and surroundings: (name, lights).
fn setups() -> Vec<(&'static str, Vec<LightKind>)> {
    let around = |from: [f64; 3], distance, size| LightKind::RectangleAround {
        from: from.into(),
        distance,
        size,
    };
    vec![
        ("one small, distant", vec![around([-0.6, -1.0, 0.7], 6.0, 0.5)]),
        (
            "three large, close",
            vec![
                around([-1.0, -1.0, 0.5], 1.3, 1.2),
                around([1.0, -0.8, 0.2], 1.3, 1.2),
                around([0.0, -0.6, 1.2], 1.3, 1.2),
            ],
        ),
        (
            "four large, around",
            vec![
                around([-1.0, -1.0, 0.0], 2.5, 2.0),
                around([1.0, -1.0, 0.0], 2.5, 2.0),
                around([-1.0, 1.0, 0.3], 2.5, 2.0),
                around([1.0, 1.0, 0.3], 2.5, 2.0),
            ],
        ),
        ("surroundings", vec![LightKind::Surroundings]),
    ]
}

/// A scene in another light, of about the same brightness.
fn lit_by(scene: &Scene, kinds: &[LightKind]) -> Scene {
    let mut lit = scene.clone();
    lit.lights = (0..)
        .zip(kinds)
        .map(|(id, kind)| {
            // Radiances by what of the sky a light fills.
            let of_sky = match kind {
                LightKind::RectangleAround { distance, size, .. } => (size / distance).powi(2),
                _ => 12.0,
            };
            let emitted = DVec3::splat(12.0 / of_sky / kinds.len() as f64);
            Light { id, name: format!("light {id}"), kind: *kind, emitted, share: 1.0 }
        })
        .collect();
    lit.settings.flux_unit = None;
    lit
}

/// Measures the hand, the torso and a bonsai, if that is in the folder of scans.
///
/// # Errors
/// Memory does not suffice; the device failed.
pub fn run(gpu: &Gpu, effort: Effort, scans: &Path, progress: &mut Progress) -> Result<Report> {
    let mut report = Report::new(gpu, "table2", effort);
    let columns = [
        "scene",
        "lights",
        "frames",
        "ms",
        "relMSE",
        "samples",
        "cached",
        "one light",
        "all lights",
        "ratio one",
        "ratio all",
    ];
    let mut sheet = Sheet::new("table2", &columns);
    let mut scenes = ["hand", "torso"].map(built_in).into_iter().collect::<Result<Vec<_>>>()?;
    scenes.iter_mut().for_each(|scene| scene.scale(effort.scale));
    let mut all = Vec::new();
    for scene in scenes {
        let volume = scene.volume.load()?;
        all.push((scene, volume));
    }
    let bonsai = scans.join("bonsai.nrrd");
    match bonsai.exists() {
        true => {
            let source = crate::scene::VolumeSource::File(bonsai);
            let volume = source.load()?;
            let (mut scene, _) = Scene::for_volume(source, "bonsai", &volume)?;
            scene.scale(effort.scale);
            all.push((scene, volume));
        }
        false => report.notes.push(format!("bonsai is left out: there is no {}", bonsai.display())),
    }
    let cases = all.iter().flat_map(|case| setups().into_iter().map(move |setup| (case, setup)));
    for (i, ((scene, volume), (lights, kinds))) in cases.enumerate() {
        progress.at("table 2", i as u64, 4 * all.len() as u64);
        let mut scene = lit_by(scene, &kinds);
        scene.camera.width = scene.camera.width.min(PIXELS);
        scene.camera.height = scene.camera.height.min(PIXELS);
        scene.settings.method = Method::IrradianceCache;
        scene.materials.iter_mut().for_each(|material| material.phase_g = 0.0);
        scene.edits.clear();
        scene.settle(volume);
        measure(gpu, &scene, volume, lights, &mut report, &mut sheet)?;
    }
    report.sheets.push(sheet);
    Ok(report)
}

/// A run that goes on, with the time that its kernels took.
struct Run {
    cache: IrradianceCache,
    ms: f64,
}

impl Run {
    fn new(gpu: &Gpu, scene: &Scene, volume: &Volume, of: (Cache, Shadows)) -> Result<Self> {
        let mut scene = scene.clone();
        (scene.settings.cache, scene.settings.shadows) = of;
        // Kernels are compiled when they first run.
        let begun = || -> Result<IrradianceCache> {
            let device = DeviceScene::new(gpu, &scene, volume)?;
            IrradianceCache::new(gpu, &scene, device)
        };
        begun()?.run(gpu, Until::Passes(2), &mut Progress::silent())?;
        Ok(Self { cache: begun()?, ms: 0.0 })
    }

    fn pass(&mut self, gpu: &Gpu) -> Result<()> {
        gpu.take_timings()?;
        self.cache.pass(gpu, &mut Progress::silent())?;
        self.ms += gpu.take_timings()?.rows().iter().map(|row| row.ms).sum::<f64>();
        Ok(())
    }

    fn images(&self, gpu: &Gpu) -> Result<Images> {
        self.cache.images(gpu)
    }
}

fn measure(
    gpu: &Gpu,
    scene: &Scene,
    volume: &Volume,
    lights: &str,
    report: &mut Report,
    sheet: &mut Sheet,
) -> Result<()> {
    let mut single = scene.clone();
    single.settings.reference_events = Some(1);
    let truth = Truth::of(gpu, &single, volume, SAMPLES, &mut Progress::silent())?;
    let error = |image: &Image| truth.error_of(image);
    let mut cached = Run::new(gpu, scene, volume, (Cache::Grid, scene.settings.shadows))?;
    let mut plain = [Shadows::Evenly, Shadows::All]
        .map(|shadows| Run::new(gpu, scene, volume, (Cache::None, shadows)))
        .into_iter()
        .collect::<Result<Vec<_>>>()?;
    let mut chart = Chart {
        name: format!("table2-{}-{}", scene.name, lights.replace(", ", "-").replace(' ', "-")),
        title: format!("{}, {lights}: error over time", scene.name),
        axes: ["time, ms".to_owned(), "relMSE".to_owned()],
        log_x: true,
        series: Vec::new(),
    };
    let mut points = vec![Vec::new(); 3];
    for frames in FRAMES {
        while cached.cache.passes() < frames {
            cached.pass(gpu)?;
        }
        let images = cached.images(gpu)?;
        let own = error(&images.blended)?;
        points[0].push((cached.ms, own));
        let mut others = Vec::new();
        for (run, points) in plain.iter_mut().zip(&mut points[1..]) {
            while run.ms < cached.ms {
                run.pass(gpu)?;
            }
            // The last pass may end later: error falls as time grows.
            let other = error(&run.images(gpu)?.samples)? * run.ms / cached.ms;
            points.push((cached.ms, other));
            others.push(other);
        }
        sheet.rows.push(vec![
            json!(scene.name),
            json!(lights),
            json!(frames),
            json!(cached.ms),
            json!(own),
            json!(error(&images.samples)?),
            json!(error(&images.cached)?),
            json!(others[0]),
            json!(others[1]),
            json!(others[0] / own),
            json!(others[1] / own),
        ]);
    }
    let names = ["grid", "plain, one light", "plain, all lights"];
    for (name, points) in names.into_iter().zip(points) {
        chart.series.push(Series { name: name.to_owned(), points, joined: true });
    }
    report.charts.push(chart);
    Ok(())
}
