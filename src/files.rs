//! Files that appear under their name only once they are whole.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::{Error, Result};

/// Refuses a path that could not be written, its folders made where they are missing.
/// Worth asking before long work; leaves nothing behind.
///
/// # Errors
/// [`Error::Io`] where it is a folder, or the nearest folder there is takes no files.
pub fn check_writable(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let failed = |source| Error::Io { path: path.into(), action: "write", source };
    if path.is_dir() {
        return Err(failed(ErrorKind::IsADirectory.into()));
    }
    let above = path.ancestors().skip(1);
    let folder = above.into_iter().find(|a| a.exists()).unwrap_or(Path::new(""));
    let probe = part_of(&folder.join("probe"));
    File::create(&probe).and_then(|_| fs::remove_file(&probe)).map_err(failed)
}

/// Where a path leads, by one name, whether a file is there or not.
pub fn place_of(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let found = path.canonicalize().ok();
    let beside = || Some(path.parent()?.canonicalize().ok()?.join(path.file_name()?));
    found.or_else(beside).unwrap_or(path)
}

/// Writes a file beside its place and moves it there when it is whole.
///
/// # Errors
/// [`Error::Io`], and what `write` says; the place is then as it was before.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<()>,
) -> Result<()> {
    let failed = |source| Error::Io { path: path.into(), action: "write", source };
    if path.file_name().is_none() {
        return Err(failed(ErrorKind::InvalidFilename.into()));
    }
    let part = part_of(path);
    let attempt = || {
        let mut file = BufWriter::new(File::create(&part).map_err(failed)?);
        write(&mut file)?;
        file.flush().and_then(|()| file.get_ref().sync_all()).map_err(failed)?;
        fs::rename(&part, path).map_err(failed)
    };
    attempt().inspect_err(|_| {
        // The first error is the one to tell.
        let _ = fs::remove_file(&part);
    })
}

/// A name beside `path` that nobody else uses.
fn part_of(path: &Path) -> PathBuf {
    static SERIAL: AtomicU32 = AtomicU32::new(0);
    let serial = SERIAL.fetch_add(1, Ordering::Relaxed);
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}-{serial}.part", std::process::id()));
    path.with_file_name(name)
}
