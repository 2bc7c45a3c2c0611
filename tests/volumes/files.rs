//! Volume files made up by tests, byte by byte, so that readers are not
//! checked against the crates that they are built on.

use std::fs;
use std::io::Write;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::GzEncoder;
use photogram::volume::{Volume, Voxels, load};

/// A size without symmetry.
pub const SIZE: [u32; 3] = [5, 4, 3];
pub const COUNT: usize = 60;

/// Procedural values: every voxel its own, least not first.
pub fn ramp(n: usize) -> i64 {
    (n as i64 * 7 + 13) % COUNT as i64
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Files in a folder of their own.
pub struct Folder(pub tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn file(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    }

    /// What loading these bytes says; it must fail, and name the file.
    pub fn refusal(&self, name: &str, bytes: &[u8]) -> String {
        let path = self.file(name, bytes);
        let error = load(&path).expect_err(name).to_string();
        error
            .strip_prefix(&format!("{}: ", path.display()))
            .unwrap_or_else(|| panic!("no path in `{error}`"))
            .to_string()
    }
}

/// A type's name in NRRD, its NIfTI code, and the ramp's bytes, little or big endian.
pub struct Case {
    pub nrrd: &'static [&'static str],
    pub nifti: i16,
    /// Added to the ramp, to reach the type's own range.
    low: f64,
    encode: fn(i64, bool) -> Vec<u8>,
    bits: u32,
}

macro_rules! case {
    ($type:ty, $low:expr, $bits:expr, $nifti:expr, $($name:expr),+) => {
        Case {
            nrrd: &[$($name),+],
            nifti: $nifti,
            low: $low as f64,
            encode: |n, big| {
                let x = $low + n as $type;
                if big { x.to_be_bytes().to_vec() } else { x.to_le_bytes().to_vec() }
            },
            bits: $bits,
        }
    };
}

/// Every element type, with the bits of its storage.
pub fn cases() -> [Case; 10] {
    [
        case!(i8, i8::MIN, 8, 256, "signed char", "int8", "int8_t"),
        case!(u8, 190u8, 8, 2, "uchar", "unsigned char", "uint8", "uint8_t"),
        case!(
            i16,
            i16::MIN,
            16,
            4,
            "short",
            "short int",
            "signed short",
            "signed short int",
            "int16",
            "int16_t"
        ),
        case!(
            u16,
            65_000u16,
            16,
            512,
            "ushort",
            "unsigned short",
            "unsigned short int",
            "uint16",
            "uint16_t"
        ),
        case!(i32, -100_000i32, 16, 8, "int", "signed int", "int32", "int32_t"),
        case!(u32, 4_000_000_000u32, 16, 768, "uint", "unsigned int", "uint32", "uint32_t"),
        case!(
            i64,
            -(1i64 << 52),
            16,
            1024,
            "longlong",
            "long long",
            "long long int",
            "signed long long",
            "signed long long int",
            "int64",
            "int64_t"
        ),
        case!(
            u64,
            1u64 << 52,
            16,
            1280,
            "ulonglong",
            "unsigned long long",
            "unsigned long long int",
            "uint64",
            "uint64_t"
        ),
        case!(f32, -12.5f32, 32, 16, "float"),
        case!(f64, 0.25f64, 32, 64, "double"),
    ]
}

impl Case {
    pub fn bytes(&self, big: bool) -> Vec<u8> {
        (0..COUNT).flat_map(|n| (self.encode)(ramp(n), big)).collect()
    }

    pub fn check(&self, volume: &Volume, what: &str) {
        let bits = match volume.voxels() {
            Voxels::U8(_) => 8,
            Voxels::U16(_) => 16,
            Voxels::F32(_) => 32,
        };
        assert_eq!((volume.size(), bits), (SIZE, self.bits), "{what}");
        assert_eq!(volume.range(), [self.low, self.low + 59.0], "{what}");
        for n in 0..COUNT as u32 {
            let (i, j, k) = (n % 5, n / 5 % 4, n / 20);
            assert_eq!(volume.index(i, j, k), n as usize);
            assert_eq!(
                volume.value(i, j, k),
                self.low + ramp(n as usize) as f64,
                "{what} at {i} {j} {k}"
            );
            assert_eq!(volume.number(i, j, k), ramp(n as usize) as f32, "{what} at {i} {j} {k}");
        }
    }
}

pub fn nrrd_header(fields: &str) -> Vec<u8> {
    format!("NRRD0004\n# made by a test\n{fields}\n\n").into_bytes()
}

pub fn nrrd_file(kind: &str, endian: &str, encoding: &str, data: &[u8]) -> Vec<u8> {
    let fields = format!(
        "type: {kind}\ndimension: 3\nsizes: 5 4 3\nspacings: 1 2 3\nendian: {endian}\nencoding: {encoding}\nnote:=any"
    );
    [nrrd_header(&fields), data.to_vec()].concat()
}

/// A NIfTI-1 header by its fields' offsets, which the standard gives.
pub struct Nifti {
    pub bytes: Vec<u8>,
    big: bool,
}

impl Nifti {
    pub fn new(code: i16, element: usize, big: bool) -> Self {
        let mut new = Self { bytes: vec![0; 352], big };
        new.i32(0, 348);
        for (n, d) in [3, 5, 4, 3, 1, 1, 1, 1].into_iter().enumerate() {
            new.i16(40 + 2 * n, d);
        }
        new.i16(70, code).i16(72, 8 * element as i16);
        for (n, p) in [1.0, 1.0, 2.0, 3.0].into_iter().enumerate() {
            new.f32(76 + 4 * n, p);
        }
        new.f32(108, 352.0);
        new.bytes[344..348].copy_from_slice(b"n+1\0");
        new
    }

    pub fn put(&mut self, at: usize, little: &[u8], big: &[u8]) -> &mut Self {
        self.bytes[at..at + little.len()].copy_from_slice(if self.big { big } else { little });
        self
    }

    pub fn i16(&mut self, at: usize, x: i16) -> &mut Self {
        self.put(at, &x.to_le_bytes(), &x.to_be_bytes())
    }

    pub fn i32(&mut self, at: usize, x: i32) -> &mut Self {
        self.put(at, &x.to_le_bytes(), &x.to_be_bytes())
    }

    pub fn f32(&mut self, at: usize, x: f32) -> &mut Self {
        self.put(at, &x.to_le_bytes(), &x.to_be_bytes())
    }

    pub fn scaled(&mut self, slope: f32, intercept: f32) -> &mut Self {
        self.f32(112, slope).f32(116, intercept)
    }

    pub fn sform(&mut self, rows: [[f32; 4]; 3]) -> &mut Self {
        for (n, x) in rows.into_iter().flatten().enumerate() {
            self.f32(280 + 4 * n, x);
        }
        self.i16(254, 1)
    }

    pub fn qform(&mut self, quaternion: [f32; 3], origin: [f32; 3], flip: f32) -> &mut Self {
        for (n, x) in quaternion.into_iter().chain(origin).enumerate() {
            self.f32(256 + 4 * n, x);
        }
        self.f32(76, flip).i16(252, 1)
    }

    pub fn with(&self, data: &[u8]) -> Vec<u8> {
        [self.bytes.as_slice(), data].concat()
    }
}
