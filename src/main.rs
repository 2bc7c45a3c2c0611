//! The command line: parses and prints, and leaves the rest to the library.

use std::fmt::Write as _;
use std::io::{ErrorKind, IsTerminal, Write as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, ensure};
use clap::{Args, Parser, Subcommand};
use comfy_table::{CellAlignment, Table, presets};
use photogram::demo;
use photogram::film::{self, Format, Notes};
use photogram::gpu::{self, AdapterChoice, Gpu};
use photogram::measure::{self, Measured};
use photogram::render::{Progress, Rendered, Report, Split, render};
use photogram::scene::{Estimator, Method, Scale, Scene, VolumeSource, Weighting};
use photogram::transfer;
use photogram::volume::phantom::Phantom;
use photogram::volume::{self, Volume};

/// Globally lit pictures of CT and MR volumes, by photon mapping on the GPU.
#[derive(Parser)]
#[command(version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Adapter by index or part of its name (see `info --adapters`)
    #[arg(long, global = true, default_value = "", hide_default_value = true)]
    adapter: String,
}

#[derive(Subcommand)]
enum Command {
    /// Renders the hand phantom, then a bone edit and a vessel edit as updates
    Demo {
        /// Where the pictures go
        #[arg(long, default_value = "out/demo")]
        out: PathBuf,
        /// Writes the figures there
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Renders a scene to .exr (linear) or .png
    Render(Box<RenderArgs>),
    /// Applies named edits in order, each as an update and as a full rebuild
    Edit(Box<EditArgs>),
    /// Describes a volume, or lists the adapters
    Info {
        /// .nrrd, .nii or .nii.gz
        #[arg(required_unless_present = "adapters")]
        volume: Option<PathBuf>,
        /// Lists the adapters of this machine with the limits that matter
        #[arg(long)]
        adapters: bool,
        /// Writes the same as JSON there
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Writes a built-in phantom as NRRD
    Phantom {
        /// cornell, hand, engine, torso or kidneys
        name: String,
        /// Output file, .nrrd
        #[arg(short, long)]
        out: PathBuf,
        /// Voxels along the longest edge
        #[arg(long, default_value_t = 256)]
        size: u32,
    },
}

#[derive(Args)]
struct RenderArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Output image, .exr or .png
    #[arg(short, long)]
    out: PathBuf,
}

#[derive(Args)]
struct EditArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// The image after the last edit, one ray a pixel, .exr or .png
    #[arg(short, long)]
    out: Option<PathBuf>,
    /// Compares with a rebuild, slot by slot; `fresh`: the last image also with that of
    /// another process, which is given the final scene and nothing else
    #[arg(long, value_name = "fresh", num_args = 0..=1, default_missing_value = "process", value_parser = ["process", "fresh"])]
    verify: Option<String>,
}

#[derive(Args)]
struct SceneArgs {
    /// Scene file, .toml
    scene: PathBuf,
    /// Puts another volume in the scene
    #[arg(long)]
    volume: Option<PathBuf>,
    /// Applies a named edit of the scene first; may be repeated
    #[arg(long)]
    edit: Vec<String>,
    /// small, medium or full: shrinks photons, pixels and phantoms together
    #[arg(long)]
    scale: Option<Scale>,
    /// photon-map, mcvr or reference
    #[arg(long)]
    method: Option<Method>,
    /// points or fluence
    #[arg(long)]
    estimator: Option<Estimator>,
    /// What the points estimator blurs
    #[arg(long)]
    weighting: Option<Weighting>,
    /// Photons of a light of share 1
    #[arg(long, allow_negative_numbers = true)]
    photons: Option<u64>,
    /// Scattering events kept along a photon
    #[arg(long, allow_negative_numbers = true)]
    max_events: Option<u32>,
    /// Gather radius, mm
    #[arg(long, allow_negative_numbers = true)]
    radius: Option<f64>,
    /// Fluence cells per voxel along an axis
    #[arg(long, allow_negative_numbers = true)]
    grid: Option<f64>,
    /// Segments along a view ray
    #[arg(long, allow_negative_numbers = true)]
    segments: Option<u32>,
    /// Rays a pixel
    #[arg(long, allow_negative_numbers = true)]
    rays: Option<u32>,
    /// Samples a pixel of `reference` and `mcvr`
    #[arg(long, allow_negative_numbers = true)]
    samples: Option<u32>,
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Pixels, as WIDTHxHEIGHT
    #[arg(long, value_parser = image_size)]
    size: Option<(u32, u32)>,
    /// Stops of exposure added to the scene's
    #[arg(long, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Writes adapter, times, counts and bytes there
    #[arg(long)]
    json: Option<PathBuf>,
}

fn image_size(text: &str) -> std::result::Result<(u32, u32), String> {
    let wrong = || format!("`{text}` is no image size: write WIDTHxHEIGHT, such as 512x512");
    let (width, height) = text.split_once('x').ok_or_else(wrong)?;
    Ok((width.parse().map_err(|_| wrong())?, height.parse().map_err(|_| wrong())?))
}

/// Keeps Mesa's device-select layer from complaining where there is no display to ask.
fn without_display() {
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: called first in `main`, while there is one thread.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
}

fn main() -> ExitCode {
    without_display();
    match run(&Cli::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(cli: &Cli) -> Result<()> {
    let adapter = match cli.adapter.as_str() {
        "" => AdapterChoice::Best,
        text => text.parse().unwrap_or_default(),
    };
    match &cli.command {
        Command::Demo { out, json } => run_demo(&adapter, out, json.as_deref()),
        Command::Render(args) => run_render(&adapter, args),
        Command::Edit(args) => run_edit(&adapter, args),
        Command::Info { volume, adapters, json } => {
            check_places(&[json.as_deref()])?;
            if *adapters {
                list_adapters(json.as_deref())?;
            }
            volume.as_deref().map_or(Ok(()), |path| describe(path, json.as_deref()))
        }
        Command::Phantom { name, out, size } => {
            let phantom: Phantom = name.parse()?;
            check_places(&[Some(out)])?;
            let volume = volume::phantom::build(phantom, *size)?;
            make_folder(out)?;
            volume::nrrd::write(&volume, out)?;
            say(format_args!("{}: {phantom}, {}", out.display(), dimensions(&volume)))
        }
    }
}

/// The scene of a command, its settings overridden and settled, with its volume.
fn prepare(args: &SceneArgs) -> Result<(Scene, Volume)> {
    let mut scene = Scene::load(&args.scene)?;
    if let Some(path) = &args.volume {
        scene.volume = VolumeSource::File(path.clone());
    }
    if let Some(scale) = args.scale {
        scene.scale(scale);
    }
    if let Some((width, height)) = args.size {
        (scene.camera.width, scene.camera.height) = (width, height);
    }
    let settings = &mut scene.settings;
    settings.method = args.method.unwrap_or(settings.method);
    settings.estimator = args.estimator.or(settings.estimator);
    settings.weighting = args.weighting.unwrap_or(settings.weighting);
    settings.photons = args.photons.unwrap_or(settings.photons);
    settings.max_events = args.max_events.unwrap_or(settings.max_events);
    settings.radius = args.radius.or(settings.radius);
    settings.grid = args.grid.unwrap_or(settings.grid);
    settings.segments = args.segments.unwrap_or(settings.segments);
    settings.rays = args.rays.unwrap_or(settings.rays);
    settings.samples = args.samples.unwrap_or(settings.samples);
    settings.seed = args.seed.unwrap_or(settings.seed);
    scene.film.exposure += args.exposure.unwrap_or(0.0);
    scene.check()?;
    let volume = scene.volume.load()?;
    scene.settle(&volume);
    Ok((scene, volume))
}

fn run_render(adapter: &AdapterChoice, args: &RenderArgs) -> Result<()> {
    let format = Format::of(&args.out)?;
    let json = args.scene.json.as_deref();
    ensure!(json != Some(&args.out), "--json and -o name the same file");
    check_places(&[Some(&args.out), json])?;
    let (mut scene, volume) = prepare(&args.scene)?;
    for edit in &args.scene.edit {
        scene = scene.edited(edit)?;
    }
    scene.check_against(&volume)?;
    let gpu = Gpu::open(adapter)?;
    let rendered =
        with_progress(|progress| render(&gpu, &scene, &volume, &Split::default(), progress))?;
    let notes = Notes { scene: scene.to_toml(), provenance: provenance(&rendered.report) };
    make_folder(&args.out)?;
    match (format, &rendered.error) {
        (Format::Exr, Some(error)) => {
            rendered.image.write_exr(&args.out, &[("stderr", error)], &notes)?;
        }
        _ => rendered.image.write(&args.out, scene.film, &notes)?,
    }
    say(format_args!("{}{}", summary(&rendered), args.out.display()))?;
    json.map_or(Ok(()), |path| write_json(path, &rendered.report))
}

fn run_edit(adapter: &AdapterChoice, args: &EditArgs) -> Result<()> {
    let json = args.scene.json.as_deref();
    let format = args.out.as_deref().map(Format::of).transpose()?;
    ensure!(json.is_none() || json != args.out.as_deref(), "--json and -o name the same file");
    check_places(&[args.out.as_deref(), json])?;
    let (mut scene, volume) = prepare(&args.scene)?;
    ensure!(scene.settings.method == Method::PhotonMap, "edits are updates of the photon map");
    ensure!(!args.scene.edit.is_empty(), "no edit is named: add --edit NAME, once for each");
    scene.settings.rays = 1;
    scene.check_against(&volume)?;
    let gpu = Gpu::open(adapter)?;
    let mut frame = with_progress(|progress| {
        let mut frame = measure::fresh(&gpu, &scene, &volume)?;
        frame.rebuild(&gpu, &Split::default(), progress)?;
        Ok(frame)
    })?;
    let mut done = Vec::new();
    for name in &args.scene.edit {
        scene = scene.edited(name)?;
        let measured = with_progress(|progress| {
            measure::measure(&gpu, &mut frame, &scene, &volume, args.verify.is_some(), progress)
        })?;
        done.push((name.as_str(), measured));
    }
    let done: Vec<_> = done.iter().map(|(name, m)| (*name, m)).collect();
    let image = frame.segments.image(&gpu)?;
    if let Some((out, format)) = args.out.as_deref().zip(format) {
        let notes = Notes { scene: scene.to_toml(), ..Default::default() };
        make_folder(out)?;
        match format {
            Format::Exr => image.write_exr(out, &[], &notes)?,
            Format::Png => image.write(out, scene.film, &notes)?,
        }
    }
    let clock = if gpu.has_timestamps() { "device timestamps" } else { "host clock" };
    say(format_args!(
        "adapter {}, stage times by {clock}; {}\n{}",
        gpu.report().name,
        frame.estimator,
        edit_table(&done)
    ))?;
    let rows: Vec<_> = done.iter().map(|(name, m)| edit_json(name, m)).collect();
    json.map_or(Ok(()), |path| write_json(path, &rows))?;
    let wrong = done.iter().filter_map(|(_, m)| m.mismatches).any(|m| m != Default::default());
    ensure!(!wrong, "an update differs from a rebuild: this is a bug, please report it");
    if args.verify.as_deref() == Some("fresh") {
        let differing = verify_fresh(&scene, &image, &gpu)?;
        say(format_args!("another process, given the final scene: {differing} pixels differ"))?;
        ensure!(differing == 0, "the update differs from another process: this is a bug");
    }
    Ok(())
}

/// Renders the final scene in another process; returns how many pixels differ.
fn verify_fresh(scene: &Scene, image: &film::Image, gpu: &Gpu) -> Result<u64> {
    let folder = std::env::temp_dir().join(format!("photogram-{}", std::process::id()));
    std::fs::create_dir_all(&folder).map_err(|e| failed(&folder, "make", e))?;
    let (file, out) = (folder.join("final.toml"), folder.join("final.exr"));
    std::fs::write(&file, scene.to_toml()).map_err(|e| failed(&file, "write", e))?;
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
    let other = film::Image::read_exr(&out)?;
    std::fs::remove_dir_all(&folder).map_err(|e| failed(&folder, "remove", e))?;
    Ok(measure::differing_pixels(image, &other))
}

fn percent(part: u64, whole: u64) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn edit_table(done: &[(&str, &Measured)]) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "edit",
        "retraced %",
        "reweighed %",
        "changed %",
        "segments %",
        "full ms",
        "incremental ms",
        "speed-up",
        "mismatches",
    ]);
    for (name, m) in done {
        let (u, c) = (&m.updated, &m.updated.counts);
        let mismatches = m.mismatches.map(|m| {
            m.photon_mismatches + m.field_mismatches + m.segment_mismatches + m.pixel_mismatches
        });
        table.add_row([
            (*name).to_owned(),
            format!("{:.1}", percent(c.invalid, u.photons)),
            format!("{:.1}", percent(c.reweighed, u.photons)),
            format!("{:.1}", percent(c.changed, u.photons)),
            format!("{:.1}", percent(u.recomputed, u.segments)),
            format!("{:.1}", m.full.total),
            format!("{:.1}", m.incremental.total),
            format!("{:.2}", m.full.total / m.incremental.total),
            mismatches.map_or("-".to_owned(), |n| n.to_string()),
        ]);
    }
    align_right(&mut table);
    table
}

fn edit_json(name: &str, m: &Measured) -> serde_json::Value {
    let (u, c) = (&m.updated, &m.updated.counts);
    serde_json::json!({
        "edit": name,
        "scope": m.scope,
        "photons": {
            "total": u.photons,
            "invalid": c.invalid,
            "changed": c.changed,
            "reweighed": c.reweighed,
            "retraced_percent": percent(c.invalid, u.photons),
        },
        "segments": {
            "total": u.segments,
            "recomputed": u.recomputed,
            "recomputed_percent": percent(u.recomputed, u.segments),
        },
        "visits": { "full": m.full_visits, "incremental": c.visits() },
        "time_ms": { "full": m.full, "incremental": m.incremental },
        "speedup": m.full.total / m.incremental.total,
        "verify": m.mismatches,
    })
}

fn run_demo(adapter: &AdapterChoice, out: &Path, json: Option<&Path>) -> Result<()> {
    check_places(&[Some(&out.join("before.png")), json])?;
    let gpu = Gpu::open(adapter)?;
    say(format_args!("adapter: {} ({})", gpu.report().name, gpu.report().kind))?;
    let shots = with_progress(|progress| demo::run(&gpu, progress))?;
    for shot in &shots {
        let path = out.join(format!("{}.png", shot.name));
        let notes = Notes { scene: shot.scene.to_toml(), ..Default::default() };
        make_folder(&path)?;
        shot.image.write(&path, shot.scene.film, &notes)?;
        say(path.display())?;
    }
    let edits = shots.iter().filter_map(|s| Some((s.name.as_str(), s.measured.as_ref()?)));
    let edits: Vec<_> = edits.collect();
    say(format_args!("\n{}", edit_table(&edits)))?;
    for (name, m) in &edits {
        say(format_args!("\n{name}, ms by stage\n{}", stage_table(m)))?;
    }
    let rows: Vec<_> = edits.iter().map(|(name, m)| edit_json(name, m)).collect();
    json.map_or(Ok(()), |path| write_json(path, &rows))?;
    let wrong = edits.iter().filter_map(|(_, m)| m.mismatches).any(|m| m != Default::default());
    ensure!(!wrong, "an update differs from a rebuild: this is a bug, please report it");
    Ok(())
}

/// Stages of a full rebuild and of an update, side by side.
fn stage_table(m: &Measured) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(["stage", "full", "incremental"]);
    let (full, incremental) = (&m.full.stages, &m.incremental.stages);
    let mut names: Vec<_> = full.iter().chain(incremental).map(|t| t.stage).collect();
    let mut seen = std::collections::HashSet::new();
    names.retain(|name| seen.insert(*name));
    for name in names {
        let ms = |stages: &[photogram::gpu::run::Timing]| {
            let row = stages.iter().find(|t| t.stage == name);
            row.map_or(String::new(), |t| format!("{:.1}", t.ms))
        };
        table.add_row([name.to_owned(), ms(full), ms(incremental)]);
    }
    align_right(&mut table);
    table
}

fn align_right(table: &mut Table) {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

fn list_adapters(json: Option<&Path>) -> Result<()> {
    let adapters = gpu::adapters()?;
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "",
        "name",
        "kind",
        "backend",
        "driver",
        "buffer MiB",
        "binding MiB",
        "3D edge",
        "timestamps",
    ]);
    for a in &adapters {
        table.add_row([
            a.index.to_string(),
            a.name.clone(),
            a.kind.to_owned(),
            a.backend.clone(),
            a.driver.clone(),
            (a.max_buffer_size >> 20).to_string(),
            (a.max_binding_size >> 20).to_string(),
            a.max_texture_3d.to_string(),
            if a.timestamps { "yes" } else { "no" }.to_owned(),
        ]);
    }
    say(&table)?;
    json.map_or(Ok(()), |path| write_json(path, &adapters))
}

fn dimensions(volume: &Volume) -> String {
    let ([i, j, k], s) = (volume.size(), volume.spacing());
    format!("{i}x{j}x{k} voxels of {:.4}x{:.4}x{:.4} mm", s.x, s.y, s.z)
}

fn describe(path: &Path, json: Option<&Path>) -> Result<()> {
    let volume = volume::load(path)?;
    let [low, high] = volume.range();
    say(format_args!("{}: {}, {}", path.display(), dimensions(&volume), volume.voxels().name()))?;
    say(format_args!("origin {:.3} mm (left, posterior, superior)", volume.origin()))?;
    for (name, axis) in ["i", "j", "k"].iter().zip([0, 1, 2].map(|a| volume.axes().col(a))) {
        say(format_args!("{name} runs along {axis:.4}"))?;
    }
    say(format_args!("values {low} to {high}"))?;
    let counts = volume.histogram(32);
    let most = counts.iter().map(|&n| n as f64).fold(1.0, f64::max).ln_1p();
    for (i, &n) in counts.iter().enumerate() {
        let value =
            transfer::entry_value((2 * i + 1) * transfer::TABLE_ENTRIES / 64, volume.range());
        let bar = "#".repeat(((n as f64).ln_1p() / most * 40.0).round() as usize);
        say(format_args!("{value:>12.3} {n:>12} {bar}"))?;
    }
    json.map_or(Ok(()), |path| {
        write_json(
            path,
            &serde_json::json!({
                "size": volume.size(),
                "spacing_mm": volume.spacing().to_array(),
                "origin_mm": volume.origin().to_array(),
                "axes": volume.axes().to_cols_array_2d(),
                "stored_as": volume.voxels().name(),
                "range": volume.range(),
                "histogram": counts,
            }),
        )
    })
}

fn provenance(report: &Report) -> std::collections::BTreeMap<String, String> {
    let of = |key: &str, value: String| (key.to_owned(), value);
    [
        of("program", concat!("photogram ", env!("CARGO_PKG_VERSION")).to_owned()),
        of("adapter", report.adapter.clone()),
        of("method", report.method.to_owned()),
        of("photons", report.photons.to_string()),
        of("rays", report.rays.to_string()),
    ]
    .into()
}

fn summary(rendered: &Rendered) -> String {
    let r = &rendered.report;
    let mut text = format!("adapter {}, times by {}\n", r.adapter, r.clock);
    if r.photons > 0 {
        let _ = writeln!(
            text,
            "{} photons, up to {} events, {} interactions; {} segments; {} rays a pixel; {}",
            r.photons,
            r.max_events,
            r.counts.interactions,
            r.segments,
            r.rays,
            r.estimator.unwrap_or_default()
        );
        let _ =
            writeln!(text, "{} bytes a photon slot, {} a segment", r.slot_bytes, r.segment_bytes);
    }
    let bytes = r.bytes.iter().map(|(name, n)| format!("{name} {:.1}", *n as f64 / 1048576.0));
    let _ = writeln!(text, "MiB: {}", bytes.collect::<Vec<_>>().join(", "));
    if r.counts.clamped > 0 {
        let _ = writeln!(text, "warning: {} contributions were clamped", r.counts.clamped);
    }
    if r.entries_clamped > 0 {
        let _ = writeln!(
            text,
            "warning: the extinction of {} table entries was clamped at the majorant, {} per mm",
            r.entries_clamped, r.majorant
        );
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(["stage", "ms", "dispatches"]);
    for row in &r.stages {
        table.add_row([row.stage.to_owned(), format!("{:.2}", row.ms), row.dispatches.to_string()]);
    }
    table.add_row(["total".to_owned(), format!("{:.0}", r.total_ms), String::new()]);
    align_right(&mut table);
    let _ = writeln!(text, "{table}");
    text
}

fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    make_folder(path)?;
    Ok(film::write_whole(path, |file| {
        writeln!(file, "{text}").map_err(|e| failed(path, "write", e))
    })?)
}

/// Refuses, before the work, output paths that it could not be written to after it.
fn check_places(paths: &[Option<&Path>]) -> Result<()> {
    Ok(paths.iter().flatten().try_for_each(film::check_writable)?)
}

fn make_folder(file: &Path) -> Result<()> {
    let folder = file.parent().unwrap_or(Path::new(""));
    Ok(std::fs::create_dir_all(folder).map_err(|e| failed(folder, "make", e))?)
}

fn failed(path: &Path, action: &'static str, source: std::io::Error) -> photogram::Error {
    photogram::Error::Io { path: path.into(), action, source }
}

/// Prints to standard output; a reader that has heard enough is no error.
fn say(text: impl std::fmt::Display) -> Result<()> {
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        said => Ok(said.map_err(|e| failed(Path::new("standard output"), "write", e))?),
    }
}

/// Shows a bar on a terminal, and nothing in a pipe.
fn with_progress<T>(work: impl FnOnce(&mut Progress) -> photogram::Result<T>) -> Result<T> {
    if !std::io::stderr().is_terminal() {
        return Ok(work(&mut Progress::silent())?);
    }
    let bar = indicatif::ProgressBar::new(0);
    if let Ok(style) =
        indicatif::ProgressStyle::with_template("{msg:>10} {wide_bar} {percent:>3}% {elapsed}")
    {
        bar.set_style(style);
    }
    let mut hear = |stage: &'static str, done: u64, total: u64| {
        bar.set_message(stage);
        bar.set_length(total);
        bar.set_position(done);
    };
    let result = work(&mut Progress::new(&mut hear));
    bar.finish_and_clear();
    Ok(result?)
}
