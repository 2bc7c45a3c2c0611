//! `edit` and `demo`: edits as updates, beside full rebuilds.

use std::path::Path;

use anyhow::{Result, anyhow, ensure};
use comfy_table::{Table, presets};
use photogram::files;
use photogram::film::{self, Format};
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::measure::demo;
use photogram::measure::{self, Measured, Mismatches};
use photogram::scene::{Method, Scene, Spatial};
use photogram::split::Split;
use photogram::update::warm;

use super::edit_cache;
use super::{
    align_right, check_places, failed, make_folder, notes, say, warn_of_materials, warnings,
    with_progress, write_json,
};
use crate::{EditArgs, Prepared, prepare};

pub fn run_edit(adapter: &AdapterChoice, args: &EditArgs) -> Result<()> {
    let json = args.scene.json.as_deref();
    let format = args.out.as_deref().map(Format::of).transpose()?;
    let is_fresh = args.verify.as_deref() == Some("fresh");
    for path in args.scene.read().into_iter().flatten().filter(|_| is_fresh) {
        let is_pipe = path.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir());
        ensure!(
            !files::is_standard(path) && !is_pipe,
            "{}: another process cannot read this once more: leave `fresh` out, or save the volume \
             as a file",
            path.display()
        );
    }
    let written = [args.out.as_deref(), json];
    let prepared = prepare(&args.scene, &written, &args.changes, |settings| {
        settings.rays = 1;
        settings.method = args.method.unwrap_or(settings.method);
        settings.samples = args.passes.unwrap_or(settings.samples);
    })?;
    let Prepared { scene, volume, edits, told } = prepared;
    let has_cache = scene.settings.method == Method::IrradianceCache;
    ensure!(
        has_cache || scene.settings.method == Method::PhotonMap,
        "edits are of `photon-map` or `irradiance-cache`: the scene's `method` is another"
    );
    ensure!(scene.settings.history, "updates ask histories: `history` is false in the scene");
    ensure!(
        !is_fresh || scene.settings.spatial != Spatial::Off,
        "spatial = \"off\" leaves stale light, and another process would not: leave `fresh` out"
    );
    // All that can be refused is refused before the work.
    let mut scenes = vec![scene];
    for name in &edits {
        scenes.extend(scenes.last().map(|before| before.edited(name)).transpose()?);
    }
    let checked = scenes.iter().zip([""].into_iter().chain(edits.iter().map(String::as_str)));
    for (scene, edit) in checked {
        scene.check_against(&volume).map_err(|e| match edit {
            "" => e.into(),
            _ => anyhow!("after edit `{edit}`: {e}"),
        })?;
    }
    if has_cache {
        told.map_or(Ok(()), say)?;
        return edit_cache::run(adapter, args, (&scenes, &edits), &volume);
    }
    warn_of_materials(&scenes, &volume);
    let gpu = pollster::block_on(photogram::open(adapter))?;
    let mut frame = with_progress(|progress| {
        warm(&gpu, &scenes[0], &volume, progress)?;
        let mut frame = measure::fresh(&gpu, &scenes[0], &volume)?;
        frame.rebuild(&gpu, &Split::default(), progress)?;
        Ok(frame)
    })?;
    let mut done = Vec::new();
    for (name, scene) in edits.iter().zip(&scenes[1..]) {
        let measured = with_progress(|progress| {
            measure::measure(&gpu, &mut frame, scene, &volume, args.verify.is_some(), progress)
        })?;
        done.push((name.as_str(), measured));
    }
    let scene = &scenes[edits.len()];
    let done: Vec<_> = done.iter().map(|(name, m)| (*name, m)).collect();
    let image = frame.segments.image(&gpu)?;
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        let notes = notes(scene, &gpu.report().name, frame.scene.lights.photons.into());
        make_folder(out)?;
        match format {
            Format::Exr => image.write_exr(out, &[], &notes)?,
            Format::Png => image.write(out, scene.film, &notes)?,
        }
    }
    told.map_or(Ok(()), say)?;
    say(format_args!(
        "adapter {}, stage times by {}; {}\n{}",
        gpu.report().name,
        clock(&gpu),
        frame.field.name(),
        edit_table(&done)
    ))?;
    args.out.as_deref().map_or(Ok(()), |out| say(out.display()))?;
    let rows: Vec<_> = done.iter().map(|(name, m)| edit_json(&gpu, name, m)).collect();
    json.map_or(Ok(()), |path| write_json(path, &rows))?;
    if scene.settings.spatial == Spatial::Off {
        say(
            "spatial = \"off\" leaves stale light: mismatches of segments and pixels are expected",
        )?;
        none_differ(&done, Mismatches::of_light)?;
    } else {
        none_differ(&done, Mismatches::all)?;
    }
    if is_fresh {
        let differing = verify_fresh(scene, &image, &gpu)?;
        say(format_args!("another process, given the final scene: {differing} pixels differ"))?;
        ensure!(differing == 0, "the update differs from another process: this is a bug");
    }
    Ok(())
}

/// Renders the final scene in another process; returns how many pixels differ.
fn verify_fresh(scene: &Scene, image: &film::Image, gpu: &Gpu) -> Result<u64> {
    let folder = tempfile::Builder::new().prefix("photogram-").tempdir();
    let folder = folder.map_err(|e| failed(&std::env::temp_dir(), "make a folder in", e))?;
    let (file, out) = (folder.path().join("final.toml"), folder.path().join("final.exr"));
    std::fs::write(&file, scene.without_edits().to_toml())
        .map_err(|e| failed(&file, "write", e))?;
    let adapter = gpu.report().index.to_string();
    let exe = std::env::current_exe().map_err(|e| failed(Path::new("this program"), "find", e))?;
    let run = std::process::Command::new(&exe)
        .args(["--adapter", &adapter, "render"])
        .arg(&file)
        .arg("-o")
        .arg(&out)
        .output()
        .map_err(|e| failed(&exe, "start", e))?;
    let said = String::from_utf8_lossy(&run.stderr);
    ensure!(run.status.success(), "the other process failed: {said}");
    Ok(measure::differing_pixels(image, &film::Image::read_exr(&out)?))
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

/// The figures of each edit, and what they warn of.
fn edit_table(done: &[(&str, &Measured)]) -> String {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "edit",
        "retraced %",
        "reweighed %",
        "changed %",
        "precision",
        "segments %",
        "full ms",
        "incremental ms",
        "speed-up",
        "mismatches",
    ]);
    for (name, m) in done {
        let (u, c) = (&m.update.done, &m.update.done.counts);
        table.add_row([
            (*name).to_owned(),
            format!("{:.1}", percent(c.invalid, u.photons)),
            format!("{:.1}", percent(c.reweighed, u.photons)),
            format!("{:.1}", percent(c.changed, u.photons)),
            format!("{:.2}", c.changed as f64 / u.listed.max(1) as f64),
            format!("{:.1}", percent(u.recomputed, u.segments)),
            format!("{:.1}", m.full.total),
            format!("{:.1}", m.update.cost.total),
            format!("{:.2}", m.full.total / m.update.cost.total),
            m.mismatches.map_or("-".to_owned(), |m| m.all().to_string()),
        ]);
    }
    align_right(&mut table);
    let warned = done.iter().map(|(name, m)| {
        warnings(&format!("after `{name}` "), m.full_counts.clamped, m.entries_clamped)
    });
    format!("{table}\n{}", warned.collect::<String>())
}

/// By what the times of stages are.
fn clock(gpu: &Gpu) -> &'static str {
    if gpu.has_timestamps() { "device timestamps" } else { "host clock" }
}

fn edit_json(gpu: &Gpu, name: &str, m: &Measured) -> serde_json::Value {
    let (u, c) = (&m.update.done, &m.update.done.counts);
    serde_json::json!({
        "edit": name,
        "adapter": gpu.report().name,
        "clock": clock(gpu),
        "scope": m.update.scope,
        "photons": {
            "total": u.photons,
            "invalid": c.invalid,
            "changed": c.changed,
            "reweighed": c.reweighed,
            "retraced_percent": percent(c.invalid, u.photons),
            "precision": c.changed as f64 / u.listed.max(1) as f64,
        },
        "segments": {
            "total": u.segments,
            "recomputed": u.recomputed,
            "recomputed_percent": percent(u.recomputed, u.segments),
        },
        "visits": { "full": m.full_counts.visits(), "incremental": c.visits() },
        "counts": { "full": m.full_counts, "incremental": c },
        "time_ms": { "full": m.full, "incremental": m.update.cost },
        "entries_clamped": m.entries_clamped,
        "speedup": m.full.total / m.update.cost.total,
        "verify": m.mismatches,
    })
}

pub fn run_demo(adapter: &AdapterChoice, out: &Path, json: Option<&Path>) -> Result<()> {
    let pictures: Vec<_> =
        demo::names()?.iter().map(|name| out.join(format!("{name}.png"))).collect();
    let written: Vec<_> = pictures.iter().map(|path| Some(path.as_path())).chain([json]).collect();
    check_places(&written, &[])?;
    let gpu = pollster::block_on(photogram::open(adapter))?;
    say(format_args!("adapter: {} ({})", gpu.report().name, gpu.report().kind))?;
    let shots = with_progress(|progress| demo::run(&gpu, progress))?;
    for (shot, path) in shots.iter().zip(&pictures) {
        let notes = notes(&shot.scene, &gpu.report().name, shot.photons);
        make_folder(path)?;
        shot.image.write(path, shot.scene.film, &notes)?;
        say(path.display())?;
    }
    let edits = shots.iter().filter_map(|s| Some((s.name.as_str(), s.measured.as_ref()?)));
    let edits: Vec<_> = edits.collect();
    say(format_args!("\n{}", edit_table(&edits)))?;
    for (name, m) in &edits {
        say(format_args!("\n{name}, ms by stage\n{}", stage_table(m)))?;
    }
    let rows: Vec<_> = edits.iter().map(|(name, m)| edit_json(&gpu, name, m)).collect();
    json.map_or(Ok(()), |path| write_json(path, &rows))?;
    none_differ(&edits, Mismatches::all)
}

fn none_differ(edits: &[(&str, &Measured)], which: fn(&Mismatches) -> u64) -> Result<()> {
    let wrong: u64 = edits.iter().filter_map(|(_, m)| m.mismatches.as_ref()).map(which).sum();
    ensure!(wrong == 0, "an update differs from a rebuild: this is a bug, please report it");
    Ok(())
}

/// Stages of a full rebuild and of an update, side by side.
fn stage_table(m: &Measured) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(["stage", "full", "incremental"]);
    let (full, incremental) = (&m.full.stages, &m.update.cost.stages);
    let mut names: Vec<_> = full.iter().chain(incremental).map(|t| t.stage).collect();
    let mut seen = std::collections::HashSet::new();
    names.retain(|name| seen.insert(*name));
    for name in names {
        let ms = |stages: &[photogram::gpu::clock::Timing]| {
            let row = stages.iter().find(|t| t.stage == name);
            row.map_or(String::new(), |t| format!("{:.1}", t.ms))
        };
        table.add_row([name.to_owned(), ms(full), ms(incremental)]);
    }
    align_right(&mut table);
    table
}
