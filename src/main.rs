//! The command line: parses and prints, and leaves the rest to the library.

mod cli;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Result, anyhow, ensure};
use clap::{ArgGroup, Args, Parser, Subcommand, ValueEnum};
use photogram::gpu::AdapterChoice;
use photogram::scene::{Cache, Estimator, Method, Scale, Scene, Settings, VolumeSource, Weighting};
use photogram::volume::phantom::Phantom;
use photogram::volume::{self, Volume};

use cli::changes::{self, Changes};

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
        /// Writes the figures there; `-` is standard output
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Renders a scene or a scan to .exr (linear) or .png
    Render(Box<RenderArgs>),
    /// Applies edits in order, each as an update and as a full rebuild
    Edit(Box<EditArgs>),
    /// Writes the scene that a scan is rendered by, for editing
    Scene {
        /// A volume: .nrrd, .nii or .nii.gz
        scan: PathBuf,
        /// Output file, .toml
        #[arg(short, long)]
        out: PathBuf,
    },
    /// Measures edits: the tables and figures of the Historygrams paper, and more
    Bench(BenchArgs),
    /// Describes a volume, or lists the adapters
    Info {
        /// .nrrd, .nii or .nii.gz; `-` is standard input
        #[arg(required_unless_present = "adapters", conflicts_with = "adapters")]
        volume: Option<PathBuf>,
        /// Lists the adapters of this machine with the limits that matter
        #[arg(long)]
        adapters: bool,
        /// Writes the same as JSON there; `-` is standard output
        #[arg(long)]
        json: Option<PathBuf>,
    },
    /// Writes a built-in phantom as NRRD
    Phantom {
        /// cornell, hand, engine, torso or kidneys
        name: String,
        /// Output file, .nrrd; `-` is standard output
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
    #[command(flatten)]
    changes: Changes,
    /// photon-map, irradiance-cache, mcvr or reference
    #[arg(long)]
    method: Option<Method>,
    /// Rays a pixel
    #[arg(long, allow_negative_numbers = true)]
    rays: Option<u32>,
    /// Samples a pixel of `reference` and `mcvr`, passes of `irradiance-cache`
    #[arg(long, visible_alias = "passes", allow_negative_numbers = true)]
    samples: Option<u32>,
    /// Passes of `irradiance-cache` for so long, s, in place of a number of them
    #[arg(long, conflicts_with = "samples", value_parser = seconds)]
    time: Option<std::time::Duration>,
    /// Where `irradiance-cache` has light from beside samples: grid or none
    #[arg(long)]
    cache: Option<Cache>,
    /// Output image, .exr or .png
    #[arg(short, long)]
    out: PathBuf,
}

#[derive(Args)]
#[command(group(ArgGroup::new("changes").args(["edit", "set"]).required(true).multiple(true)))]
struct EditArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    changes: Changes,
    /// The image after the last edit, one ray a pixel, .exr or .png
    #[arg(short, long)]
    out: Option<PathBuf>,
    /// photon-map or irradiance-cache
    #[arg(long)]
    method: Option<Method>,
    /// Passes of `irradiance-cache` before and after each edit
    #[arg(long, allow_negative_numbers = true)]
    passes: Option<u32>,
    /// Compares with a rebuild, slot by slot; `fresh`: the last image also with that of
    /// another process, which is given the final scene and nothing else
    #[arg(long, value_name = "fresh", num_args = 0..=1, default_missing_value = "process", value_parser = ["process", "fresh"])]
    verify: Option<String>,
}

#[derive(Args)]
struct BenchArgs {
    /// What is measured
    what: What,
    /// Size of the scenes: small takes minutes on two cores, full needs a graphics card
    #[arg(long, default_value = "small")]
    scale: Scale,
    /// Runs of each measurement, of which the median counts
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    /// Where scans are: `steps` also takes aorta_ct.nii.gz, `table2` bonsai.nrrd, if it is there
    #[arg(long, default_value = "scans")]
    scans: PathBuf,
    /// Where CSV, JSON and SVG files go
    #[arg(long, default_value = "out/bench")]
    out: PathBuf,
    /// Writes the JSON there too; `-` is standard output
    #[arg(long)]
    json: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum What {
    /// The paper's table 1 on phantoms, beside its figures
    Table1,
    /// The paper's figures 7 to 9: photons, events, segments
    Sweeps,
    /// Time of each stage over its visits, for edits of growing size
    Visits,
    /// Full rebuilds with and without histories
    Overhead,
    /// Kinds of bins of histories
    Bins,
    /// Points taken anew or merged, over how many moved
    Merging,
    /// The irradiance cache beside plain ray casting: the second paper's table 2
    Table2,
    /// Error and time of both light fields over the march step
    Steps,
}

#[derive(Args)]
struct SceneArgs {
    /// Scene file, .toml; or a volume, for which a scene is made
    scene: PathBuf,
    /// Puts another volume in the scene file's place; `-` is standard input
    #[arg(long)]
    volume: Option<PathBuf>,
    /// small, medium or full: shrinks photons, pixels and phantoms together
    #[arg(long)]
    scale: Option<Scale>,
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
    #[arg(long, allow_negative_numbers = true)]
    seed: Option<u64>,
    /// Pixels, as WIDTHxHEIGHT
    #[arg(long, value_parser = image_size)]
    size: Option<(u32, u32)>,
    /// Stops of exposure added to the scene's
    #[arg(long, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Writes adapter, times, counts and bytes there; `-` is standard output
    #[arg(long)]
    json: Option<PathBuf>,
}

fn seconds(text: &str) -> std::result::Result<std::time::Duration, String> {
    let seconds = text.parse::<f64>().ok().filter(|s| *s > 0.0);
    let duration = seconds.and_then(|s| std::time::Duration::try_from_secs_f64(s).ok());
    duration.ok_or_else(|| format!("`{text}` is no time: write seconds, such as 2.5"))
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
        Command::Demo { out, json } => cli::edit::run_demo(&adapter, out, json.as_deref()),
        Command::Render(args) => cli::render::run_render(&adapter, args),
        Command::Edit(args) => cli::edit::run_edit(&adapter, args),
        Command::Scene { scan, out } => cli::scene::run_scene(scan, out),
        Command::Bench(args) => cli::bench::run_bench(&adapter, args),
        Command::Info { volume, json, .. } => {
            cli::check_places(&[json.as_deref()], &[volume.as_deref()])?;
            match volume {
                Some(path) => cli::info::describe(path, json.as_deref()),
                None => cli::info::list_adapters(json.as_deref()),
            }
        }
        Command::Phantom { name, out, size } => {
            let phantom: Phantom = name.parse()?;
            cli::check_places(&[Some(out)], &[])?;
            let volume = volume::phantom::build(phantom, *size)?;
            cli::make_folder(out)?;
            volume::nrrd::write(&volume, out)?;
            let size = cli::info::dimensions(&volume);
            cli::say(format_args!("{}: {phantom}, {size}", out.display()))
        }
    }
}

impl SceneArgs {
    /// The files that are read.
    fn read(&self) -> [Option<&Path>; 2] {
        [Some(&self.scene), self.volume.as_deref()]
    }
}

/// What a command works on.
struct Prepared {
    /// Settled; what the command line sets is among its edits.
    scene: Scene,
    volume: Volume,
    /// Names of the edits to make, in order.
    edits: Vec<String>,
    /// What a scan was taken for, where it was given no scene.
    told: Option<String>,
}

/// The scene of a command, its settings overridden and settled, with its volume; `more` overrides
/// what other commands have no word for. Nothing that is read may be `written`.
fn prepare(
    args: &SceneArgs,
    written: &[Option<&Path>],
    changes: &Changes,
    more: impl FnOnce(&mut Settings),
) -> Result<Prepared> {
    cli::check_places(written, &args.read())?;
    let (mut scene, scan, told) = if cli::scene::is_scene(&args.scene) {
        (Scene::load(&args.scene)?, None, None)
    } else {
        ensure!(args.volume.is_none(), "--volume goes with a scene file: name one volume");
        let made = cli::scene::make(&args.scene)?;
        let told = made.told();
        (made.scene, Some(made.volume), Some(told))
    };
    // Nor the volume that is named there, whether another takes its place or not.
    if let VolumeSource::File(path) = &scene.volume {
        cli::check_unread(written, &[Some(path)])?;
    }
    if let Some(path) = &args.volume {
        let is_standard = photogram::files::is_standard(path);
        let path = if is_standard { path.clone() } else { std::path::absolute(path)? };
        scene.volume = VolumeSource::File(path);
    }
    if let Some(scale) = args.scale {
        scene.scale(scale);
    }
    if let Some((width, height)) = args.size {
        (scene.camera.width, scene.camera.height) = (width, height);
    }
    let settings = &mut scene.settings;
    settings.estimator = args.estimator.or(settings.estimator);
    settings.weighting = args.weighting.unwrap_or(settings.weighting);
    settings.photons = args.photons.unwrap_or(settings.photons);
    settings.max_events = args.max_events.unwrap_or(settings.max_events);
    settings.radius = args.radius.or(settings.radius);
    settings.grid = args.grid.unwrap_or(settings.grid);
    settings.segments = args.segments.unwrap_or(settings.segments);
    settings.seed = args.seed.unwrap_or(settings.seed);
    more(settings);
    scene.film.exposure += args.exposure.unwrap_or(0.0);
    scene.check()?;
    let edits = changes.add_to(&mut scene)?;
    let volume = match scan {
        Some(volume) => volume,
        None => scene.volume.load().map_err(|error| match &scene.volume {
            VolumeSource::File(path) if args.volume.is_none() && !path.exists() => {
                anyhow!("{error}; the scene names it: `--volume FILE` puts another in its place")
            }
            _ => error.into(),
        })?,
    };
    cli::warn_of(&volume);
    changes::settle(&mut scene, &edits, &volume);
    Ok(Prepared { scene, volume, edits, told })
}
