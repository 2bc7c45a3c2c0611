//! What the commands print and write; the library does the work.

pub mod bench;
pub mod changes;
pub mod edit;
mod edit_cache;
pub mod info;
pub mod render;
pub mod scene;

use std::io::{ErrorKind, IsTerminal, Write as _};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, ensure};
use comfy_table::{CellAlignment, Table};
use photogram::files;
use photogram::film::Notes;
use photogram::gpu::Progress;
use photogram::scene::{Method, Scene};
use photogram::volume::Volume;

/// Whether an output has standard output for itself: people are then told on standard error.
static STDOUT_TAKEN: AtomicBool = AtomicBool::new(false);

pub fn align_right(table: &mut Table) {
    for column in table.column_iter_mut().skip(1) {
        column.set_cell_alignment(CellAlignment::Right);
    }
}

pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value)?;
    make_folder(path)?;
    Ok(files::write_whole(path, |file| {
        writeln!(file, "{text}").map_err(|e| failed(path, "write", e))
    })?)
}

/// Refuses, before the work, output paths that it could not be written to after it: two at one
/// place, or over a file that is read, among them.
pub fn check_places(written: &[Option<&Path>], read: &[Option<&Path>]) -> Result<()> {
    check_unread(written, read)?;
    let written: Vec<_> = written.iter().flatten().collect();
    for (i, path) in written.iter().enumerate() {
        files::check_writable(path)?;
        let (what, place) = (path.display(), files::place_of(path));
        for other in &written[..i] {
            let (one, there) = (other.display(), files::place_of(other));
            ensure!(
                !files::is_same(path, other),
                "{what} is written already, as {one}: name another file"
            );
            ensure!(
                place == there || !place.starts_with(&there) && !there.starts_with(&place),
                "{what} and {one} cannot both be: one is the other's folder; name another file"
            );
        }
        if files::is_stdout(path) {
            STDOUT_TAKEN.store(true, Ordering::Relaxed);
        }
    }
    Ok(())
}

/// Refuses output paths that lead to what is read, by whatever name.
pub fn check_unread(written: &[Option<&Path>], read: &[Option<&Path>]) -> Result<()> {
    for written in written.iter().flatten() {
        for read in read.iter().flatten() {
            let (out, from) = (written.display(), read.display());
            ensure!(
                !files::is_read(written, read),
                "{out} would be written over {from}, which is read: name another file"
            );
        }
    }
    Ok(())
}

/// Tells what was odd about a volume's file.
pub fn warn_of(volume: &Volume) {
    for warning in volume.warnings() {
        // Without standard error there is nobody to tell.
        let _ = writeln!(std::io::stderr(), "warning: {warning}");
    }
}

/// Warns of materials that cannot look as they are meant to, each once.
pub fn warn_of_materials<'a>(scenes: impl IntoIterator<Item = &'a Scene>, volume: &Volume) {
    let mut told = std::collections::HashSet::new();
    for warning in scenes.into_iter().flat_map(|scene| scene.unresolved(volume)) {
        if told.insert(warning.clone()) {
            let _ = writeln!(std::io::stderr(), "warning: {warning}");
        }
    }
}

/// What was clamped: light that a sum has no room for, and extinction. A line each, of `whom`.
pub fn warnings(whom: &str, contributions: u64, entries: usize) -> String {
    let mut text = String::new();
    if contributions > 0 {
        text += &format!("warning: {whom}{contributions} contributions were clamped\n");
    }
    if entries > 0 {
        text += &format!(
            "note: {whom}the extinction of {entries} table entries is above four mean free paths a \
             voxel, and counts as that\n"
        );
    }
    text
}

/// What a picture tells of how it came to be.
pub fn notes(scene: &Scene, adapter: &str, photons: u64) -> Notes {
    let of = |key: &str, value: String| (key.to_owned(), value);
    let settings = &scene.settings;
    let rays = match settings.method {
        Method::PhotonMap => settings.rays,
        Method::Mcvr | Method::Reference | Method::IrradianceCache => settings.samples,
    };
    let provenance = [
        of("program", concat!("photogram ", env!("CARGO_PKG_VERSION")).to_owned()),
        of("adapter", adapter.to_owned()),
        of("method", settings.method.to_string()),
        of("photons", photons.to_string()),
        of("rays", rays.to_string()),
    ];
    Notes { scene: scene.without_edits().to_toml(), provenance: provenance.into() }
}

pub fn make_folder(file: &Path) -> Result<()> {
    // The folder of what a link leads to, if it is one.
    let place = files::place_of(file);
    let folder = place.parent().unwrap_or(Path::new("/"));
    Ok(std::fs::create_dir_all(folder).map_err(|e| failed(folder, "make", e))?)
}

pub fn failed(path: &Path, action: &'static str, source: std::io::Error) -> photogram::Error {
    photogram::Error::Io { path: path.into(), action, source }
}

/// Prints to standard output, or to standard error where an output has that for itself; a reader
/// that has heard enough is no error.
pub fn say(text: impl std::fmt::Display) -> Result<()> {
    if STDOUT_TAKEN.load(Ordering::Relaxed) {
        // Nobody may listen there, which does not matter to the output.
        let _ = writeln!(std::io::stderr(), "{text}");
        return Ok(());
    }
    match writeln!(std::io::stdout(), "{text}") {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        said => Ok(said.map_err(|e| failed(Path::new("standard output"), "write", e))?),
    }
}

/// Shows a bar on a terminal, and nothing in a pipe.
pub fn with_progress<T>(work: impl FnOnce(&mut Progress) -> photogram::Result<T>) -> Result<T> {
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
