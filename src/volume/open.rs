//! Where the bytes of a volume come from: a file, a pipe or standard input.
//!
//! A pipe can be read once, from the front, and nobody knows how much is in it. All sources are
//! read that way: what a file is, its first bytes tell, which are looked at without being taken.

use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, Read};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use flate2::bufread::GzDecoder;

use super::{Elements, Found, Kind, by, voxel_count};
use crate::error::{Error, Result};
use crate::files;

/// What a gzip member starts with: its magic number and the one method there is.
pub(super) const GZIP: [u8; 3] = [0x1f, 0x8b, 8];

/// How far bytes after the data are counted: to tell of them it need not be all.
const COUNTED: u64 = 64 << 20;

/// Deflate shrinks by 1032 at most.
const DEFLATE: u64 = 1032;

/// The bytes of a volume, from the front.
pub(super) struct Source {
    /// The file, for messages.
    pub path: PathBuf,
    /// What was odd, but did not keep the volume from being read.
    pub warnings: Vec<String>,
    stream: Stream,
    /// Bytes of the file, where that is known.
    length: Option<u64>,
    /// Layers of gzip around what comes out.
    layers: u32,
    /// Bytes after compressed data.
    after: Rc<Cell<u64>>,
}

impl Source {
    /// Opens a file, a pipe, or standard input as `-`, and unwraps gzip, once or twice.
    ///
    /// # Errors
    /// [`Error::Io`] where it cannot be read, [`Error::Volume`] for a folder.
    pub fn open(path: &Path) -> Result<Self> {
        let failed = |source| Error::Io { path: path.into(), action: "read", source };
        let (path, stream, length) = if files::is_standard(path) {
            ("standard input".into(), Stream::new(io::stdin().lock()), None)
        } else {
            let file = File::open(path).map_err(failed)?;
            let found = file.metadata().map_err(failed)?;
            if found.is_dir() {
                return Err(Error::volume(
                    path,
                    "a folder, where one file is needed; a folder of DICOM slices is made one file by \
                     `dcm2niix -z y FOLDER`",
                ));
            }
            // Only a regular file tells, and those that the system makes up say 0.
            let length = Some(found.len()).filter(|&n| found.is_file() && n > 0);
            (path.into(), Stream::new(file), length)
        };
        let after = Rc::new(Cell::new(0));
        let mut source = Self { path, warnings: Vec::new(), stream, length, layers: 0, after };
        while source.layers < 2 && source.peek(GZIP.len()) == GZIP {
            source.gunzip();
        }
        if source.layers > 1 {
            source.warnings.push("it is compressed twice: `gunzip` it once".into());
        }
        Ok(source)
    }

    /// The next bytes, as many of `count` as there are; they are still to be read.
    pub fn peek(&mut self, count: usize) -> &[u8] {
        self.stream.peek(count)
    }

    /// Takes what follows for gzip, and gives what is in it.
    pub fn gunzip(&mut self) {
        let packed = std::mem::replace(&mut self.stream, Stream::new(io::empty()));
        let member = Some(GzDecoder::new(packed));
        self.stream = Stream::new(Gunzip { member, after: self.after.clone() });
        self.layers += 1;
    }

    /// Reads the voxels. What follows them is no longer read, which a warning tells.
    pub fn elements(&mut self, kind: Kind, size: [u32; 3], big_endian: bool) -> Found<Elements> {
        let count = voxel_count(size).map_err(|e| e.to_string())?;
        let wanted = count * kind.bytes() as u64;
        let need = format!("{} voxels of {} bytes need {wanted} bytes", by(size), kind.bytes());
        let no_memory = |e: &dyn std::fmt::Display| {
            format!("{need}, more than there is memory for ({e}); crop or resample the volume")
        };
        let mut bytes = Vec::new();
        // No header makes this allocate beyond what its file can hold. Where the length is not
        // known, memory grows with what comes.
        if let Some(length) = self.length {
            let most = length.saturating_mul(DEFLATE.saturating_pow(self.layers));
            if most < wanted {
                return Err(format!(
                    "truncated: {need}, and the whole file has {length}; get it again"
                ));
            }
            let all = usize::try_from(wanted).map_err(|e| no_memory(&e))?;
            bytes.try_reserve_exact(all).map_err(|e| no_memory(&e))?;
        }
        let read = self.stream.by_ref().take(wanted).read_to_end(&mut bytes);
        let damaged = |n: usize, e: io::Error| match e.kind() {
            io::ErrorKind::OutOfMemory => no_memory(&e),
            _ => format!("damaged data after {n} bytes ({e}); {need}; get it again"),
        };
        read.map_err(|e| damaged(bytes.len(), e))?;
        if (bytes.len() as u64) < wanted {
            return Err(format!("truncated: {need}, and there are {}; get it again", bytes.len()));
        }
        // A checksum stands at the end, and is looked at only there.
        let more = count_bytes(&mut self.stream).map_err(|e| damaged(bytes.len(), e))?;
        self.tell_of_surplus(more.saturating_add(self.after.get()), &need);
        Ok(kind.decode(&bytes, big_endian))
    }

    fn tell_of_surplus(&mut self, more: u64, need: &str) {
        let follow = match more {
            0 => return,
            1 => "1 byte follows the data and is".to_owned(),
            COUNTED.. => format!("{} MiB or more follow the data and are", COUNTED >> 20),
            _ => format!("{more} bytes follow the data and are"),
        };
        self.warnings.push(format!(
            "{follow} not read ({need}); if the volume looks wrong, the header's sizes or type are"
        ));
    }
}

impl Read for Source {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        self.stream.read(into)
    }
}

impl BufRead for Source {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.stream.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        self.stream.consume(count);
    }
}

/// A buffered reader whose next bytes can be looked at.
struct Stream {
    inner: Box<dyn Read>,
    /// Read ahead; those before `at` are taken.
    ahead: Vec<u8>,
    at: usize,
    /// What stopped the reading ahead. It is told to who reads that far.
    failed: Option<io::Error>,
}

impl Stream {
    fn new(inner: impl Read + 'static) -> Self {
        Self { inner: Box::new(inner), ahead: Vec::new(), at: 0, failed: None }
    }

    fn peek(&mut self, count: usize) -> &[u8] {
        self.ahead.drain(..self.at);
        self.at = 0;
        let missing = count.saturating_sub(self.ahead.len()) as u64;
        if self.failed.is_none() {
            self.failed = self.inner.by_ref().take(missing).read_to_end(&mut self.ahead).err();
        }
        &self.ahead[..count.min(self.ahead.len())]
    }
}

impl BufRead for Stream {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.ahead.len() {
            if let Some(error) = self.failed.take() {
                return Err(error);
            }
            self.at = 0;
            self.ahead.resize(1 << 16, 0);
            let read = self.inner.read(&mut self.ahead);
            self.ahead.truncate(*read.as_ref().unwrap_or(&0));
            read?;
        }
        Ok(&self.ahead[self.at..])
    }

    fn consume(&mut self, count: usize) {
        self.at += count;
    }
}

impl Read for Stream {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(into)?;
        self.consume(count);
        Ok(count)
    }
}

/// The data of all gzip members. What follows them and is none is counted: padding of tapes and
/// file systems, newlines of editors.
struct Gunzip {
    member: Option<GzDecoder<Stream>>,
    after: Rc<Cell<u64>>,
}

impl Read for Gunzip {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        while let Some(member) = &mut self.member {
            let count = member.read(into)?;
            if count > 0 || into.is_empty() {
                return Ok(count);
            }
            let Some(mut rest) = self.member.take().map(GzDecoder::into_inner) else { break };
            if rest.peek(GZIP.len()) == GZIP {
                self.member = Some(GzDecoder::new(rest));
            } else {
                self.after.set(self.after.get().saturating_add(count_bytes(&mut rest)?));
            }
        }
        Ok(0)
    }
}

/// How many bytes are left, [`COUNTED`] at most.
fn count_bytes(from: &mut impl Read) -> io::Result<u64> {
    io::copy(&mut from.take(COUNTED), &mut io::sink())
}
