//! Where output goes: into what is there, or as a file that appears under its name only once it
//! is whole.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Seek as _, Write as _};
use std::path::{Component, Path, PathBuf};

use same_file::Handle;
use tempfile::NamedTempFile;

use crate::error::{Error, Result};

/// What a path leads to as an output.
enum Destination {
    /// Standard output.
    Standard,
    /// A device, a pipe or a file that is open already: it is written into.
    Into(PathBuf),
    /// A regular file, there or not: it is replaced whole, and keeps its permissions.
    Whole(PathBuf, Option<fs::Permissions>),
}

impl Destination {
    fn of(path: &Path) -> io::Result<Self> {
        if is_stdout(path) {
            return Ok(Self::Standard);
        }
        if path.file_name().is_none() {
            return Err(ErrorKind::InvalidFilename.into());
        }
        let place = place_of(path);
        match fs::metadata(path) {
            Ok(found) if found.is_dir() => Err(ErrorKind::IsADirectory.into()),
            // The folder of descriptors: what is behind one is held open by somebody.
            Ok(found) if !found.is_file() || place.starts_with("/proc") => {
                Ok(Self::Into(path.into()))
            }
            Ok(found) => Ok(Self::Whole(place, Some(found.permissions()))),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(Self::Whole(place, None)),
            Err(error) => Err(error),
        }
    }
}

/// Whether a path means standard input, or standard output.
pub fn is_standard(path: &Path) -> bool {
    path == Path::new("-")
}

/// Whether an output goes to standard output, by whatever name.
pub fn is_stdout(path: &Path) -> bool {
    let own = format!("/proc/{}/fd/1", std::process::id());
    is_standard(path) || [Path::new("/dev/fd/1"), Path::new(&own)].contains(&&*place_of(path))
}

/// Refuses a path that could not be written, its folders made where they are missing.
/// Worth asking before long work; leaves nothing behind.
///
/// # Errors
/// [`Error::Io`] where it is a folder, may not be written, or the nearest folder there is takes
/// no files.
pub fn check_writable(path: impl AsRef<Path>) -> Result<()> {
    let path = path.as_ref();
    let probe = || match Destination::of(path)? {
        Destination::Standard => Ok(()),
        Destination::Into(path) => {
            // To open a pipe is to wait for its reader.
            if is_pipe(&path) { Ok(()) } else { open(&path).map(drop) }
        }
        Destination::Whole(place, there) => {
            if there.is_some() {
                open(&place)?;
            }
            let folder = place.ancestors().skip(1).find(|a| a.exists());
            part_in(folder.unwrap_or(Path::new("."))).map(drop)
        }
    };
    probe().map_err(|source| Error::Io { path: path.into(), action: "write", source })
}

/// Where a path leads, by one name, whether a file is there or not; links are followed.
pub fn place_of(path: &Path) -> PathBuf {
    let mut path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    // As many as Linux follows.
    for _ in 0..40 {
        path = plain(&path);
        match fs::read_link(&path) {
            // The descriptors of a process are links that lead to no path.
            Ok(to) if !path.starts_with("/proc") => {
                path = path.parent().unwrap_or(Path::new("/")).join(to);
            }
            _ => break,
        }
    }
    path
}

/// With the folders above by their one name; of those that are not there yet, `..` takes one away.
fn plain(path: &Path) -> PathBuf {
    let (Some(above), Some(name)) = (path.parent(), path.components().next_back()) else {
        return path.into();
    };
    let above = above.canonicalize().unwrap_or_else(|_| plain(above));
    match name {
        Component::ParentDir => above.parent().map(Path::to_path_buf).unwrap_or(above),
        name => above.join(name),
    }
}

/// Whether what is written to one path would go where the other leads too: by links, hard links
/// among them, and by another spelling. Devices take more than one output.
pub fn is_same(written: &Path, other: &Path) -> bool {
    if is_stdout(written) && is_stdout(other) {
        return true;
    }
    let files = regular(written, Handle::stdout).zip(regular(other, Handle::stdout));
    files.is_some_and(|(a, b)| a == b) || place_of(written) == place_of(other) && !is_device(other)
}

/// Whether what is written to one path would change what is read from the other.
pub fn is_read(written: &Path, read: &Path) -> bool {
    let files = regular(written, Handle::stdout).zip(regular(read, Handle::stdin));
    let named = !is_standard(written) && !is_standard(read);
    files.is_some_and(|(a, b)| a == b)
        || named && place_of(written) == place_of(read) && !is_device(read)
}

/// The regular file that a path leads to. To look at another kind might be to wait for it.
fn regular(path: &Path, standard: fn() -> io::Result<Handle>) -> Option<Handle> {
    let is_file = |found: fs::Metadata| found.is_file();
    if is_standard(path) {
        return standard().ok().filter(|h| h.as_file().metadata().is_ok_and(is_file));
    }
    fs::metadata(path).is_ok_and(is_file).then(|| Handle::from_path(path).ok()).flatten()
}

#[cfg(unix)]
fn is_device(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    fs::metadata(path).is_ok_and(|found| found.file_type().is_char_device())
}

#[cfg(not(unix))]
fn is_device(_: &Path) -> bool {
    false
}

#[cfg(unix)]
fn is_pipe(path: &Path) -> bool {
    use std::os::unix::fs::FileTypeExt as _;
    fs::metadata(path).is_ok_and(|found| found.file_type().is_fifo())
}

#[cfg(not(unix))]
fn is_pipe(_: &Path) -> bool {
    false
}

fn open(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).open(path)
}

/// A file in a folder that goes away again unless it is kept.
fn part_in(folder: &Path) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        // What any new file gets, of which the user's mask takes away.
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    builder.prefix(".photogram-").suffix(".part").tempfile_in(folder)
}

/// Writes an output. A regular file is written beside its place and moved there when it is whole;
/// a link is followed, and stays. A device or a pipe is written into, `-` is standard output.
///
/// # Errors
/// [`Error::Io`], and what `write` says; a regular file is then as it was before.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<()>,
) -> Result<()> {
    let failed = |source| Error::Io { path: path.into(), action: "write", source };
    let filled = |file: File| {
        let mut file = BufWriter::new(file);
        write(&mut file)?;
        file.into_inner().map_err(|e| failed(e.into_error()))
    };
    match Destination::of(path).map_err(failed)? {
        Destination::Whole(place, permissions) => {
            let part = part_in(place.parent().unwrap_or(Path::new("."))).map_err(failed)?;
            let file = filled(part.reopen().map_err(failed)?)?;
            permissions.map_or(Ok(()), |p| file.set_permissions(p)).map_err(failed)?;
            file.sync_all().map_err(failed)?;
            part.persist(&place).map_err(|e| failed(e.error)).map(drop)
        }
        destination => {
            // Kept until it is whole, too: image formats go back to their beginnings.
            let mut file = filled(tempfile::tempfile().map_err(failed)?)?;
            file.rewind().map_err(failed)?;
            pour(&mut file, destination).map_err(failed)
        }
    }
}

fn pour(from: &mut File, destination: Destination) -> io::Result<()> {
    match destination {
        Destination::Standard => {
            let mut out = io::stdout().lock();
            match io::copy(from, &mut out).and_then(|_| out.flush()) {
                // A reader that has heard enough is no error.
                Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
                poured => poured,
            }
        }
        Destination::Into(path) | Destination::Whole(path, _) => {
            let mut out = open(&path)?;
            // Only a regular file has a length to take away.
            let is_file = out.metadata()?.is_file();
            if is_file {
                out.set_len(0)?;
            }
            io::copy(from, &mut out)?;
            out.flush()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_place_has_one_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let root = folder.path().canonicalize().expect("its name");
        let name = |path: &str| place_of(&root.join(path));
        assert_eq!(name("new/deep/../../x/./y.json"), root.join("x/y.json"));
        assert_eq!(name("new/../y.json"), name("y.json"));
        assert!(is_same(&root.join("new/a"), &root.join("old/../new/a")));
        assert!(!is_same(&root.join("new/a"), &root.join("new/b")));
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn devices_are_written_into() {
        for device in ["/dev/null", "/dev/full"] {
            let found = Destination::of(Path::new(device)).expect("a device");
            assert!(matches!(found, Destination::Into(_)), "{device}");
            assert!(!is_same(Path::new(device), Path::new(device)), "{device} takes many outputs");
        }
        for name in ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"] {
            assert!(
                matches!(Destination::of(Path::new(name)), Ok(Destination::Standard)),
                "{name}"
            );
        }
        // To open a file that is open elsewhere must not put another in its place.
        let file = tempfile::tempfile().expect("a temporary file");
        let name = format!("/dev/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&file));
        assert!(matches!(Destination::of(Path::new(&name)), Ok(Destination::Into(_))), "{name}");
    }
}
