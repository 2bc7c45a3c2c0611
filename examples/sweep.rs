//! What an edit costs over its size: makes a material denser and thinner, and writes CSV to standard
//! output.
//!
//!     cargo run --release --example sweep -- [SCENE or SCAN] [MATERIAL] > sweep.csv
//!
//! Without arguments it takes a small hand and its bone. A row has the factor that the extinction was
//! multiplied by, which photons were retraced and which segments computed again, in percent, and the
//! time of the update and of a full rebuild, ms.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use photogram::gpu::{AdapterChoice, Progress};
use photogram::measure;
use photogram::scene::{Scale, Scene, VolumeSource};
use photogram::split::Split;
use photogram::update::warm;
use photogram::volume::{self, Volume, phantom};

const FACTORS: [f64; 7] = [0.1, 0.25, 0.5, 0.9, 1.1, 2.0, 4.0];

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (mut scene, volume) = match arguments.next() {
        Some(path) => of_file(Path::new(&path))?,
        None => small_hand()?,
    };
    let material = arguments.next().unwrap_or("bone".to_owned());
    let found = scene.materials.iter().find(|m| m.name == material);
    let extinction = found.with_context(|| format!("no material is called {material}"))?.extinction;

    // Edits that the scene knows before it is settled lie below its majorant: else those that make
    // something denser would have all photons traced anew.
    for factor in FACTORS {
        let edit = scene.edit_of(&format!("{material}.extinction={}", factor * extinction))?;
        scene.edits.push(edit);
    }
    scene.settle(&volume);

    let gpu = pollster::block_on(photogram::open(&AdapterChoice::Best))?;
    let silent = &mut Progress::silent();
    // Else the first update would wait for kernels to be compiled.
    warm(&gpu, &scene, &volume, silent)?;
    let mut frame = measure::fresh(&gpu, &scene, &volume)?;
    frame.rebuild(&gpu, &Split::default(), silent)?;

    let mut sheet = csv::Writer::from_writer(io::stdout());
    sheet.write_record(["factor", "retraced %", "segments %", "update ms", "full ms"])?;
    let own = scene.edits.len() - FACTORS.len();
    for (factor, edit) in FACTORS.iter().zip(&scene.edits[own..]) {
        let edited = scene.edited(&edit.name)?;
        let cost = measure::measure(&gpu, &mut frame, &edited, &volume, false, silent)?;
        let done = cost.update.done;
        let row = [
            *factor,
            done.retraced_percent(),
            done.recomputed_percent(),
            cost.update.cost.total,
            cost.full.total,
        ];
        sheet.write_record(row.map(|figure| format!("{figure:.2}")))?;
        sheet.flush()?;
        // Back to the scene as it was.
        measure::update(&gpu, &mut frame, &scene, silent)?;
    }
    Ok(())
}

/// A scene with its volume, or a scan with a scene that fits it.
fn of_file(path: &Path) -> Result<(Scene, Volume)> {
    if path.extension().is_some_and(|end| end == "toml") {
        let scene = Scene::load(path)?;
        let volume = scene.volume.load()?;
        return Ok((scene, volume));
    }
    let volume = volume::load(path)?;
    let source = VolumeSource::File(PathBuf::from(path));
    let (scene, _) = Scene::for_volume(source, "scan", &volume)?;
    Ok((scene, volume))
}

fn small_hand() -> Result<(Scene, Volume)> {
    let source = VolumeSource::Phantom { phantom: phantom::Phantom::Hand, size: 64 };
    let volume = source.load()?;
    let (mut scene, _) = Scene::for_volume(source, "hand", &volume)?;
    scene.scale(Scale::Small);
    Ok((scene, volume))
}
