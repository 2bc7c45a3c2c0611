//! Volumes from outside: what is read exactly, what is refused and how it is
//! said, and where in the world a voxel lands.

use std::fs;
use std::path::Path;

use files::{COUNT, Folder, Nifti, SIZE, cases, gzip, nrrd_file, nrrd_header, ramp};
use glam::{DMat3, DVec3};
use photogram::volume::{Elements, Numbers, Values, Volume, Voxels, load, nrrd, phantom};

#[path = "volumes/files.rs"]
mod files;

#[test]
fn every_type_in_both_orders_and_encodings() {
    let folder = Folder::new();
    for case in cases() {
        for big in [false, true] {
            let data = case.bytes(big);
            let endian = if big { "big" } else { "little" };
            for name in case.nrrd {
                for (encoding, data) in
                    [("raw", &data), ("gzip", &gzip(&data)), ("gz", &gzip(&data))]
                {
                    let what = format!("{name}, {endian}, {encoding}");
                    let volume =
                        load(folder.file("a.nrrd", &nrrd_file(name, endian, encoding, data)))
                            .expect(&what);
                    case.check(&volume, &what);
                    assert_eq!(volume.spacing(), DVec3::new(1.0, 2.0, 3.0));
                }
            }
            let file = Nifti::new(case.nifti, data.len() / COUNT, big).with(&data);
            for (name, bytes) in
                [("a.nii", &file), ("a.nii.gz", &gzip(&file)), ("by_content", &gzip(&file))]
            {
                let what = format!("{} as {name}, {endian}", case.nrrd[0]);
                case.check(&load(folder.file(name, bytes)).expect(&what), &what);
            }
        }
    }
}

#[test]
fn wide_integers_become_floats() {
    let data: Vec<i32> = (0..COUNT as i32).map(|n| n * 2000).collect();
    let volume = Volume::new(SIZE, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, data).unwrap();
    assert!(matches!(volume.voxels(), Voxels::F32(_)));
    assert_eq!((volume.range(), volume.value(4, 3, 2)), ([0.0, 118_000.0], 118_000.0));
}

#[test]
fn linear_maps() {
    let folder = Folder::new();
    let data: Vec<u8> = (0..COUNT).flat_map(|n| (ramp(n) as i16).to_le_bytes()).collect();
    for (slope, intercept) in [(1.0, -1024.0), (0.5, 10.0), (-2.0, 100.0), (0.0, 77.0)] {
        let volume = load(
            folder.file("a.nii", &Nifti::new(4, 2, false).scaled(slope, intercept).with(&data)),
        )
        .unwrap();
        // A slope of 0 says that there is no map.
        let (slope, intercept) =
            if slope == 0.0 { (1.0, 0.0) } else { (f64::from(slope), f64::from(intercept)) };
        let physical = |n: usize| ramp(n) as f64 * slope + intercept;
        let Voxels::U16(stored) = volume.voxels() else { panic!("16-bit data stay so") };
        for (n, &stored) in stored.iter().enumerate() {
            assert_eq!(volume.value(n as u32 % 5, n as u32 / 5 % 4, n as u32 / 20), physical(n));
            // Stored order is physical order.
            assert_eq!(f64::from(stored), (physical(n) - volume.range()[0]) / slope.abs());
        }
    }
}

#[test]
fn units_and_flat_data() {
    let new = |values: Values| {
        Volume::new([2, 1, 1], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).unwrap()
    };
    let flat = new(vec![7.5f32; 2].into());
    assert_eq!((flat.range(), flat.number(1, 0, 0)), ([7.5, 7.5], 0.0));
    let flat = new(vec![-3i8; 2].into());
    assert_eq!((flat.range(), flat.numbers().span, flat.value(1, 0, 0)), ([-3.0, -3.0], 0.0, -3.0));
    let full = new(vec![u16::MAX, 0].into());
    let numbers = Numbers { least: 0.0, step: 1.0, span: 65535.0, are_whole: true };
    assert_eq!((full.numbers(), full.number(0, 0, 0)), (numbers, 65535.0));
    let floats = new(vec![-1.0f32, 2.5].into());
    let numbers = Numbers { least: -1.0, step: 1.0, span: 3.5, are_whole: false };
    assert_eq!((floats.numbers(), floats.number(0, 0, 0)), (numbers, 0.0));
    assert!(new(vec![-1.0f32, 2.0].into()).numbers().are_few());
}

#[test]
fn what_threads_share_is_what_one_finds() {
    // More than one share of a histogram.
    let size = [101, 97, 89];
    let count = size.iter().product::<u32>() as usize;
    let value = |n: usize| (n * 7919 % 10_007) as i32 - 5000;
    let new = |values: Values| {
        Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, values).unwrap()
    };
    for volume in [
        new((0..count).map(value).collect::<Vec<_>>().into()),
        new((0..count).map(|n| value(n) as f32 * 0.5).collect::<Vec<_>>().into()),
    ] {
        let mut plain = vec![0u64; 37];
        let mut range = [f64::INFINITY, f64::NEG_INFINITY];
        let per_number = (37.0 / volume.numbers().span) as f32;
        for at in 0..count as u32 {
            let [i, j, k] = [at % 101, at / 101 % 97, at / 101 / 97];
            let share = volume.number(i, j, k) * per_number;
            plain[(share as usize).min(36)] += 1;
            let value = volume.value(i, j, k);
            range = [range[0].min(value), range[1].max(value)];
        }
        assert_eq!(volume.histogram(37), plain);
        assert_eq!(volume.range(), range);
    }
    // The first bad voxel is the first, whoever finds it.
    let mut floats = vec![0.0f32; count];
    floats[3 * 101 + 5..].fill(f32::NAN);
    let bad = Volume::new(size, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, floats).unwrap_err();
    assert!(bad.to_string().contains("the first at voxel [5, 3, 0]"), "{bad}");
    // A zero has no sign, whichever comes first.
    for zeros in [vec![0.0f32, -0.0], vec![-0.0, 0.0]] {
        let flat = Volume::new([2, 1, 1], DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, zeros).unwrap();
        assert_eq!(flat.range().map(f64::to_bits), [0; 2]);
    }
}

#[test]
fn grids_that_are_refused() {
    let (one, turn) = (DVec3::ONE, DMat3::IDENTITY);
    let sheared = DMat3::from_cols(DVec3::X, DVec3::new(0.1, 1.0, 0.0).normalize(), DVec3::Z);
    let long = DMat3::from_diagonal(DVec3::new(1.0, 1.0, 1.1));
    let ok = || Values::from(vec![0u8; 8]);
    let refused: [(_, _, _, _, Values, &[&str]); 19] = [
        ([0, 4, 2], one, turn, one, ok(), &["0 x 4 x 2", "no side may be 0"]),
        ([2049, 1, 1], one, turn, one, ok(), &["2049", "3D texture", "2048"]),
        ([u32::MAX; 3], one, turn, one, ok(), &["3D texture"]),
        ([2, 2, 3], one, turn, one, ok(), &["8 values", "2 x 2 x 3", "12 are needed"]),
        ([2, 2, 2], DVec3::new(1.0, 0.0, 1.0), turn, one, ok(), &["spacing", "positive"]),
        ([2, 2, 2], DVec3::new(1.0, 1.0, -1.0), turn, one, ok(), &["spacing", "positive"]),
        ([2, 2, 2], DVec3::new(f64::NAN, 1.0, 1.0), turn, one, ok(), &["spacing", "finite"]),
        ([2, 2, 2], DVec3::new(1.0, f64::INFINITY, 1.0), turn, one, ok(), &["spacing", "finite"]),
        ([2, 2, 2], one, turn, DVec3::new(0.0, f64::NAN, 0.0), ok(), &["origin", "finite"]),
        ([2, 2, 2], one, sheared, one, ok(), &["sheared", "resample"]),
        ([2, 2, 2], one, long, one, ok(), &["unit length"]),
        ([2, 2, 2], one, DMat3::NAN, one, ok(), &["axes"]),
        ([2, 2, 2], one, turn, one, ok().mapped(0.0, 1.0), &["slope 0"]),
        ([2, 2, 2], one, turn, one, ok().mapped(f64::NAN, 1.0), &["slope NaN"]),
        ([2, 2, 2], one, turn, one, ok().mapped(1.0, f64::INFINITY), &["intercept inf"]),
        (
            [2, 2, 2],
            one,
            turn,
            one,
            vec![0.0, 0.0, 0.0, f32::NAN, 1.0, f32::INFINITY, 1.0, 1.0].into(),
            &["2 of 8", "NaN or infinite", "[1, 1, 0]"],
        ),
        (
            [2, 2, 2],
            one,
            turn,
            one,
            vec![0.0, 0.0, 0.0, 0.0, 0.0, 1e300, 0.0, 0.0].into(),
            &["1e300", "[1, 0, 1]"],
        ),
        (
            [2, 2, 2],
            one,
            turn,
            one,
            vec![-3e38f32, 3e38, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].into(),
            &["span too much"],
        ),
        (
            [2, 2, 2],
            one,
            turn,
            one,
            vec![0.0, 1e-42f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0].into(),
            &["too little"],
        ),
    ];
    for (size, spacing, axes, origin, values, says) in refused {
        let error =
            Volume::new(size, spacing, axes, origin, values).expect_err(says[0]).to_string();
        for part in says {
            assert!(error.contains(part), "`{error}` does not say `{part}`");
        }
    }
}

#[test]
fn nrrd_that_is_refused() {
    let folder = Folder::new();
    let data = [7u8; COUNT];
    let good = "type: uint8\ndimension: 3\nsizes: 5 4 3\nspacings: 1 1 1\nencoding: raw";
    let file = |fields: &str, data: &[u8]| [nrrd_header(fields), data.to_vec()].concat();
    load(folder.file("good.nrrd", &file(good, &data))).unwrap();

    // A line of the good header, what stands there instead, what the refusal says.
    let edits: [(&str, &str, &[&str]); 32] = [
        ("type: uint8\n", "", &["no `type`"]),
        ("dimension: 3\n", "", &["no `dimension`"]),
        ("sizes: 5 4 3\n", "", &["no `sizes`"]),
        ("encoding: raw", "", &["no `encoding`"]),
        ("spacings: 1 1 1\n", "", &["neither `space directions` nor `spacings`"]),
        ("uint8", "uint16", &["no `endian`"]),
        ("uint8", "uint16\nendian: middle", &["line 4", "middle", "little or big"]),
        ("uint8", "block", &["line 3", "block"]),
        ("uint8", "uint8\ntype: uint8", &["line 4", "`type` again", "line 3"]),
        ("uint8", "uint16\nendian: little", &["truncated", "120 bytes"]),
        ("dimension: 3", "dimension: 4", &["line 4", "dimension 4"]),
        ("dimension: 3", "dimension: 2", &["line 4", "dimension 2"]),
        ("5 4 3", "5 4", &["line 5", "3 are needed"]),
        ("5 4 3", "5 4 3 1", &["line 5", "3 are needed"]),
        ("5 4 3", "5 -4 3", &["line 5", "-4", "positive"]),
        ("5 4 3", "5 0 3", &["5 x 0 x 3", "no side may be 0"]),
        ("5 4 3", "5 4 3000", &["3D texture", "2048"]),
        ("5 4 3", "5 4 99999999999", &["line 5", "99999999999"]),
        ("5 4 3", "2048 2048 2048", &["truncated", "8589934592 bytes"]),
        ("5 4 3", "5 4 4", &["truncated", "80 bytes", "60"]),
        ("raw", "ascii", &["line 7", "ascii", "raw and gzip"]),
        ("raw", "bzip2", &["bzip2"]),
        ("raw", "raw\ndata file: a.raw", &["line 8", "a.raw", "another file"]),
        ("raw", "raw\nbyte skip: 4", &["line 8", "byte skip"]),
        ("raw", "raw\nspace: scanner-xyz", &["line 8", "scanner-xyz"]),
        ("raw", "raw\nkinds: RGB-color space space", &["line 8", "RGB-color", "scalar"]),
        ("raw", "raw\nspace units: \"ell\" \"mm\" \"mm\"", &["line 8", "units of ell"]),
        ("raw", "raw\nspace origin: (1,2)", &["line 8", "2 numbers"]),
        ("raw", "raw\nspace origin: (1,nan,2)", &["origin", "finite"]),
        ("spacings: 1 1 1", "spacings: 1 0 1", &["spacing", "positive"]),
        ("spacings: 1 1 1", "space directions: (1,0,0) (0.2,1,0) (0,0,1)", &["sheared"]),
        ("spacings: 1 1 1", "space directions: none (1,0,0) (0,1,0)", &["line 6", "(x,y,z)"]),
    ];
    for (from, to, says) in edits {
        assert!(good.contains(from));
        let error = folder.refusal("a.nrrd", &file(&good.replace(from, to), &data));
        for part in says {
            assert!(error.contains(part), "`{to}`: `{error}` does not say `{part}`");
        }
    }

    let packed = good.replace("raw", "gzip");
    let whole = gzip(&data);
    let mut flipped = whole.clone();
    let crc = flipped.len() - 8;
    flipped[crc] ^= 1;
    let raws: [(&str, Vec<u8>, &str); 9] = [
        ("empty", Vec::new(), "not an NRRD file"),
        ("magic", b"NRRD0009\n\n".to_vec(), "not an NRRD file"),
        ("endless header", b"NRRD0004\ntype: uint8\n".to_vec(), "does not end"),
        ("no field", nrrd_header("nonsense"), "line 3: `nonsense`"),
        ("raw, short", file(good, &data[1..]), "there are 59"),
        ("gzip, cut", file(&packed, &whole[..whole.len() - 9]), "damaged data"),
        ("gzip, changed", file(&packed, &flipped), "damaged data"),
        ("gzip, none", file(&packed, &data), "damaged data"),
        ("gzip, short", file(&packed, &gzip(&data[2..])), "there are 58"),
    ];
    for (what, bytes, says) in raws {
        let error = folder.refusal("a.nrrd", &bytes);
        assert!(error.contains(says), "{what}: `{error}` does not say `{says}`");
    }
}

#[test]
fn nifti_that_is_refused() {
    type Spoil = fn(&mut Nifti);
    let folder = Folder::new();
    let data = [7u8; COUNT];
    let spoils: [(&str, Spoil, &str); 25] = [
        ("magic", |h| h.bytes[344] = b'x', "does not end in `n+1`"),
        ("detached", |h| h.bytes[345] = b'i', ".img"),
        ("size of header", |h| _ = h.i32(0, 349), "sizeof_hdr"),
        ("byte orders differ", |h| h.bytes[40..42].reverse(), "byte order"),
        ("dim[0] 0", |h| _ = h.i16(40, 0), "dim[0]"),
        ("dim[0] 8", |h| _ = h.i16(40, 8), "dim[0]"),
        ("two dimensions", |h| _ = h.i16(40, 2), "three are needed"),
        ("four volumes", |h| _ = h.i16(40, 4).i16(48, 4), "single volumes"),
        ("negative side", |h| _ = h.i16(44, -4), "[5, -4, 3]: three are needed, all positive"),
        ("no side", |h| _ = h.i16(44, 0), "all positive"),
        ("large side", |h| _ = h.i16(42, 30_000), "3D texture"),
        ("colour", |h| _ = h.i16(70, 128).i16(72, 24), "Rgb24"),
        ("complex", |h| _ = h.i16(70, 32).i16(72, 64), "Complex64"),
        ("unknown type", |h| _ = h.i16(70, 3), "datatype 3 is none"),
        ("bits", |h| _ = h.i16(72, 16), "bitpix 16"),
        ("NaN slope", |h| _ = h.scaled(f32::NAN, 0.0), "scl_slope NaN"),
        ("infinite intercept", |h| _ = h.scaled(1.0, f32::INFINITY), "scl_inter inf"),
        ("data inside the header", |h| _ = h.f32(108, 100.0), "vox_offset 100"),
        ("NaN offset", |h| _ = h.f32(108, f32::NAN), "vox_offset NaN"),
        ("data behind the end", |h| _ = h.f32(108, 1e9), "vox_offset"),
        ("longer than the file", |h| _ = h.i16(46, 4), "truncated"),
        ("no spacing", |h| _ = h.f32(80, 0.0), "spacing"),
        (
            "negative spacing in a qform",
            |h| _ = h.qform([0.0; 3], [0.0; 3], 1.0).f32(80, -1.0),
            "spacing",
        ),
        ("long quaternion", |h| _ = h.qform([1.0, 1.0, 0.0], [0.0; 3], 1.0), "quaternion"),
        (
            "shear",
            |h| _ = h.sform([[1.0, 0.3, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]),
            "sheared",
        ),
    ];
    for big in [false, true] {
        load(folder.file("good.nii", &Nifti::new(2, 1, big).with(&data))).unwrap();
        for (what, spoil, says) in spoils {
            let mut header = Nifti::new(2, 1, big);
            spoil(&mut header);
            let error = folder.refusal("a.nii", &header.with(&data));
            assert!(error.contains(says), "{what}: `{error}` does not say `{says}`");
        }
    }
    let file = Nifti::new(2, 1, false).with(&data);
    let packed = gzip(&file);
    let mut second = file.clone();
    second[..4].copy_from_slice(&540i32.to_le_bytes());
    second[4..8].copy_from_slice(b"n+2\0");
    second.resize(600, 0);
    for (name, bytes, says) in [
        ("a.nii", &file[..200], "not a whole NIfTI-1 header"),
        ("a.nii", &file[..400], "truncated"),
        ("a.nii", &second[..500], "not a whole NIfTI-2 header of 540 bytes"),
        ("a.nii", &second, "not a NIfTI-2 file"),
        ("a.nii.gz", &packed[..packed.len() - 9], "damaged data"),
        ("a.nii.gz", &gzip(&file[..400]), "truncated"),
        ("a.nii.gz", &gzip(b"no volume"), "not a whole NIfTI-1 header"),
        ("a.txt", b"text", "NRRD (.nrrd) and NIfTI (.nii, .nii.gz)"),
        ("empty", b"", "empty: "),
    ] {
        let error = folder.refusal(name, bytes);
        assert!(error.contains(says), "{name}: `{error}` does not say `{says}`");
    }
    let missing = load(folder.0.path().join("missing.nrrd")).unwrap_err().to_string();
    assert!(missing.contains("cannot read"), "{missing}");
}

/// The voxel of value 1 among zeros: (4, 1, 2), nothing symmetric.
fn marker() -> [u8; COUNT] {
    let mut data = [0; COUNT];
    data[4 + 5 * (1 + 4 * 2)] = 1;
    data
}

/// Centre of the marker in the world, by the volume's own maps.
fn marked(volume: &Volume) -> DVec3 {
    let [ni, nj, nk] = volume.size();
    let mut found = Vec::new();
    for k in 0..nk {
        for (i, j) in (0..nj).flat_map(|j| (0..ni).map(move |i| (i, j))) {
            if volume.value(i, j, k) == 1.0 {
                found.push(DVec3::new(i.into(), j.into(), k.into()));
            }
        }
    }
    let [voxel] = found[..] else { panic!("{} markers", found.len()) };
    let world = volume.origin() + volume.axes() * (voxel * volume.spacing());
    // The map from the world must say the same.
    let local = volume.local_from_world().transform_point3(world);
    assert!(local.abs_diff_eq((voxel + 0.5) * volume.spacing(), 1e-9), "{local}");
    let far = volume.local_from_world().inverse().transform_point3(volume.extent());
    assert!(far.abs_diff_eq(volume.corner() + volume.axes() * volume.extent(), 1e-9), "{far}");
    world
}

fn near(a: DVec3, b: [f64; 3]) {
    assert!(a.abs_diff_eq(b.into(), 1e-4), "{a} is not {b:?}");
}

#[test]
fn nrrd_lands_where_it_says() {
    let folder = Folder::new();
    let load = |frame: &str| {
        let fields = format!("type: uint8\ndimension: 3\nsizes: 5 4 3\nencoding: raw\n{frame}");
        load(folder.file("a.nrrd", &[nrrd_header(&fields), marker().to_vec()].concat())).unwrap()
    };
    // (10, 20, 30) + 4 (0, 2, 0) + 1 (-1.5, 0, 0) + 2 (0, 0, 3) in the file's own space.
    let frame = "space directions: (0,2,0) (-1.5, 0, 0) (0,0,3)\nspace origin: (10,20,30)";
    for (space, there) in [
        ("left-posterior-superior", [8.5, 28.0, 36.0]),
        ("LPS", [8.5, 28.0, 36.0]),
        ("right-anterior-superior", [-8.5, -28.0, 36.0]),
        ("RAS", [-8.5, -28.0, 36.0]),
        ("Left-Anterior-Superior", [8.5, -28.0, 36.0]),
        ("las", [8.5, -28.0, 36.0]),
    ] {
        let volume = load(&format!("space: {space}\n{frame}"));
        near(marked(&volume), there);
        near(volume.spacing(), [2.0, 1.5, 3.0]);
    }
    near(marked(&load("spacings: 1 2 3")), [4.0, 2.0, 6.0]);
    near(
        marked(&load("space dimension: 3\nspacings: 1 2 3\nspace origin: (1,0,0)")),
        [5.0, 2.0, 6.0],
    );
    let mirrored = load(&format!("space: LAS\n{frame}"));
    assert!((mirrored.axes().determinant() + 1.0).abs() < 1e-12);
}

#[test]
fn nifti_lands_where_it_says() {
    let folder = Folder::new();
    let load = |header: &Nifti| load(folder.file("a.nii", &header.with(&marker()))).unwrap();
    let fresh = || Nifti::new(2, 1, false);

    // Neither form: axes as the world's, voxel 0 at 0.
    near(marked(&load(&fresh())), [4.0, 2.0, 6.0]);

    // sform, axes to the left, posterior and up: in right-anterior-superior
    // (100 - 4, 50 - 2, 7 + 6); the qform beside it is not heard.
    let rows = [[-1.0, 0.0, 0.0, 100.0], [0.0, -2.0, 0.0, 50.0], [0.0, 0.0, 3.0, 7.0]];
    let volume = load(fresh().qform([1.0, 0.0, 0.0], [9.0; 3], 1.0).sform(rows));
    near(marked(&volume), [-96.0, -48.0, 13.0]);
    assert_eq!(volume.axes(), DMat3::IDENTITY);

    // sform, axes to the right and anterior: kept as they are, told by the axes.
    let rows = [[1.0, 0.0, 0.0, 100.0], [0.0, 2.0, 0.0, 50.0], [0.0, 0.0, 3.0, 7.0]];
    let volume = load(fresh().sform(rows));
    near(marked(&volume), [-104.0, -52.0, 13.0]);
    assert_eq!(volume.axes(), DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)));

    // qform: a quarter turn about z (i to anterior, j to the left), then with k down.
    let quarter = [0.0, 0.0, 0.5f32.sqrt()];
    near(marked(&load(fresh().qform(quarter, [10.0, 20.0, 30.0], 1.0))), [-8.0, -24.0, 36.0]);
    let volume = load(fresh().qform(quarter, [10.0, 20.0, 30.0], -1.0));
    near(marked(&volume), [-8.0, -24.0, 24.0]);
    assert!((volume.axes().determinant() + 1.0).abs() < 1e-6);

    // Metres; and one volume in a series of one.
    near(marked(&load(fresh().i16(40, 4).put(123, &[1], &[1]))), [4e3, 2e3, 6e3]);
}

#[test]
fn nearly_perpendicular_axes_are_made_so() {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7);
    let off = DMat3::from_cols(turn.x_axis + DVec3::splat(2e-4), turn.y_axis, turn.z_axis);
    let volume = Volume::new([2, 1, 1], DVec3::ONE, off, DVec3::ZERO, vec![0u8, 1]).unwrap();
    assert!((volume.axes().transpose() * volume.axes()).abs_diff_eq(DMat3::IDENTITY, 1e-14));
    assert!(volume.axes().abs_diff_eq(turn, 4e-4));
}

#[test]
fn written_volumes_come_back() {
    let folder = Folder::new();
    let path = folder.0.path().join("a.nrrd");
    let axes = DMat3::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7)
        * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0));
    let floats: Vec<f32> = (0..COUNT).map(|n| ramp(n) as f32 * 0.1 - 2.0).collect();
    let pixels = |low: i64| (0..COUNT).map(move |n| low + ramp(n));
    let all: [Values; 8] = [
        pixels(0).map(|x| x as u8).collect::<Vec<_>>().into(),
        pixels(-100).map(|x| x as i8).collect::<Vec<_>>().into(),
        pixels(-1024).map(|x| x as i16).collect::<Vec<_>>().into(),
        pixels(65_000).map(|x| x as u16).collect::<Vec<_>>().into(),
        pixels(-100_000).map(|x| x as i32).collect::<Vec<_>>().into(),
        pixels(1 << 40).collect::<Vec<_>>().into(),
        Values::from(pixels(0).map(|x| x as i16).collect::<Vec<_>>()).mapped(-1.0, 9.0),
        floats.into(),
    ];
    for values in all {
        let volume =
            Volume::new(SIZE, DVec3::new(0.7, 1.1, 2.5), axes, DVec3::new(-3.1, 4.0, 1e3), values)
                .unwrap();
        nrrd::write(&volume, &path).unwrap();
        let back = load(&path).unwrap();
        assert_eq!(
            (back.voxels(), back.range(), back.size()),
            (volume.voxels(), volume.range(), volume.size())
        );
        assert!(back.axes().abs_diff_eq(volume.axes(), 1e-14) && back.origin() == volume.origin());
        assert!(back.spacing().abs_diff_eq(volume.spacing(), 1e-14));
    }
    // A fractional slope is written as physical values.
    let halves =
        Values { elements: Elements::U8((0..COUNT as u8).collect()), slope: 0.5, intercept: 0.25 };
    let volume = Volume::new(SIZE, DVec3::ONE, DMat3::IDENTITY, DVec3::ZERO, halves).unwrap();
    nrrd::write(&volume, &path).unwrap();
    assert_eq!(load(&path).unwrap().value(1, 2, 0), volume.value(1, 2, 0));
    assert_eq!(fs::read_dir(folder.0.path()).unwrap().count(), 1, "only the file itself remains");
}

#[test]
fn a_failed_write_leaves_nothing() {
    let folder = Folder::new();
    let volume = phantom::build(phantom::Phantom::Cornell, 16).unwrap();
    let taken = folder.0.path().join("taken");
    fs::create_dir(&taken).unwrap();
    for path in [taken.as_path(), &folder.0.path().join("no/such/a.nrrd"), Path::new("/")] {
        let error = nrrd::write(&volume, path).unwrap_err().to_string();
        assert!(error.contains("cannot write"), "{error}");
    }
    assert_eq!(fs::read_dir(folder.0.path()).unwrap().count(), 1);
}

#[test]
fn real_scans() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/volumes");
    // Size, spacing, range, signs of the axes, origin; all in left-posterior-superior.
    let scans = [
        (
            "aorta_ct.nii.gz",
            [120, 126, 164],
            1.5,
            [-1078.0, 3343.0],
            [1.0, 1.0, 1.0],
            [-71.658_203_125, -255.658_203_125, 540.200_012_207_031_2],
        ),
        (
            "pelvis_ct.nii.gz",
            [122, 101, 112],
            3.0,
            [-1207.0, 3382.0],
            [-1.0, -1.0, 1.0],
            [177.956_329_345_703_12, -11.319_000_244_140_625, 94.301_757_812_5],
        ),
        ("stent.nrrd", [128, 128, 256], 1.0, [0.0, 1.0], [1.0, 1.0, 1.0], [0.0; 3]),
    ];
    for (name, size, spacing, range, signs, origin) in scans {
        let path = folder.join(name);
        if !path.exists() {
            println!("skipped: {name} is not in {}", folder.display());
            continue;
        }
        let volume = load(&path).unwrap();
        assert_eq!((volume.size(), volume.range()), (size, range), "{name}");
        assert_eq!(volume.spacing(), DVec3::splat(spacing), "{name}");
        assert_eq!(volume.axes(), DMat3::from_diagonal(signs.into()), "{name}");
        assert_eq!(volume.origin(), DVec3::from(origin), "{name}");
        assert_eq!(
            matches!(volume.voxels(), Voxels::U16(_)),
            name.ends_with(".gz"),
            "{name}: int32 HU fit 16 bits"
        );
    }
}
