//! A folder with a tiny scene and its volume, and the program run on them.

use std::fs;
use std::path::PathBuf;

use assert_cmd::Command;
use serde_json::Value;

use super::files::{Folder, nrrd_header};

/// Edge of the volume, voxels of 1 mm.
pub const EDGE: usize = 16;

/// A ball, seen from the front and lit from the upper left.
pub const SCENE: &str = r#"
background = 0.25
[volume]
file = "volume.nrrd"
[camera]
from = [0, -1, 0.2]
fov_deg = 30
width = 16
height = 16
[[light]]
kind = "rectangle"
name = "key"
from = [-1, -1, 1]
distance = 2
size = 1
radiance = 10
[[material]]
name = "ball"
window = [100, 300]
extinction = 0.2
albedo = [0.9, 0.8, 0.7]
[settings]
photons = 1000
max_events = 4
segments = 4
rays = 1
samples = 2
[[edit]]
name = "dark"
[[edit.material]]
name = "ball"
albedo = 0.1
"#;

pub struct Place(Folder);

/// Eight-bit voxels of a cube, or of any size, as NRRD.
pub fn nrrd(size: [usize; 3], voxels: &[u8]) -> Vec<u8> {
    let [i, j, k] = size;
    let fields =
        format!("type: uint8\ndimension: 3\nsizes: {i} {j} {k}\nspacings: 1 1 1\nencoding: gzip");
    [nrrd_header(&fields), super::files::gzip(voxels)].concat()
}

fn ball(at: usize) -> u8 {
    let middle = (EDGE as f64 - 1.0) / 2.0;
    let away = [at % EDGE, at / EDGE % EDGE, at / EDGE / EDGE].map(|x| x as f64 - middle);
    let distance = away.iter().map(|x| x * x).sum::<f64>().sqrt();
    (255.0 - 20.0 * distance).max(0.0) as u8
}

impl Place {
    pub fn new() -> Self {
        let place = Self(Folder::new());
        let voxels: Vec<u8> = (0..EDGE.pow(3)).map(ball).collect();
        place.file("volume.nrrd", nrrd([EDGE; 3], &voxels));
        place.file("scene.toml", SCENE);
        place
    }

    /// With a piece of the scene replaced.
    pub fn with(old: &str, new: &str) -> Self {
        let place = Self::new();
        assert!(SCENE.contains(old), "the scene has no `{old}`");
        place.file("scene.toml", SCENE.replace(old, new));
        place
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.0.path().join(name)
    }

    pub fn file(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        self.0.file(name, bytes.as_ref())
    }

    /// The program, begun in this folder.
    pub fn program(&self, args: &[&str]) -> Command {
        let mut program = Command::new(env!("CARGO_BIN_EXE_photogram"));
        program.current_dir(self.0.0.path()).env("XDG_RUNTIME_DIR", "/tmp").args(args);
        program
    }

    /// Succeeds, and says nothing but what the driver says anyway; returns what it prints.
    pub fn fine(&self, args: &[&str]) -> String {
        let output = self.program(args).output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{args:?}: {error}");
        let driver = self.program(&["info", "--adapters"]).output().unwrap().stderr;
        assert_eq!(error, String::from_utf8(driver).unwrap(), "{args:?}");
        String::from_utf8(output.stdout).unwrap()
    }

    /// `render scene.toml -o out/image.exr` with `more`: refused, as [`Place::refused`].
    pub fn unrendered(&self, more: &[&str]) -> String {
        self.refused(&[&["render", "scene.toml", "-o", "out/image.exr"], more].concat())
    }

    /// Fails with code 1 and leaves no file; returns what it says.
    pub fn refused(&self, args: &[&str]) -> String {
        self.failed(&mut self.program(args), 1)
    }

    /// Fails with a code and leaves no file; returns what it says.
    pub fn failed(&self, program: &mut Command, code: i32) -> String {
        let before = self.list();
        let output = program.output().unwrap();
        let error = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{program:?}: {error}");
        assert!(error.contains("error: ") && !error.contains("panicked"), "{program:?}: {error}");
        assert_eq!(String::from_utf8(output.stdout).unwrap(), "", "{program:?}: {error}");
        assert_eq!(self.list(), before, "{program:?} left something: {error}");
        error
    }

    /// Everything in the folder, with its length.
    fn list(&self) -> Vec<(PathBuf, u64)> {
        let (mut list, mut folders) = (Vec::new(), vec![self.path("")]);
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
                let meta = entry.metadata().unwrap();
                folders.extend(meta.is_dir().then(|| entry.path()));
                list.push((entry.path(), if meta.is_dir() { 0 } else { meta.len() }));
            }
        }
        list.sort();
        list
    }

    pub fn json(&self, name: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(name)).unwrap()).unwrap()
    }
}
