use strum::VariantArray as _;

use super::*;

/// Share of the voxels in each tissue's window.
fn shares(phantom: Phantom, size: u32) -> Vec<f64> {
    let volume = build(phantom, size).unwrap();
    let [ni, nj, nk] = volume.size();
    let mut counts = vec![0u32; phantom.tissues().len()];
    for k in 0..nk {
        for (i, j) in (0..nj).flat_map(|j| (0..ni).map(move |i| (i, j))) {
            let value = volume.value(i, j, k);
            for (tissue, count) in phantom.tissues().iter().zip(&mut counts) {
                *count += u32::from((tissue.low..=tissue.high).contains(&value));
            }
        }
    }
    let voxels = f64::from(ni * nj * nk);
    counts.into_iter().map(|n| f64::from(n) / voxels).collect()
}

/// Mean value above the least, which averaging over voxels would conserve.
fn mean(phantom: Phantom, size: u32) -> f64 {
    let volume = build(phantom, size).unwrap();
    let [ni, nj, nk] = volume.size();
    let air = phantom.plan().air;
    let sum: f64 = (0..nk)
        .flat_map(|k| (0..nj).flat_map(move |j| (0..ni).map(move |i| [i, j, k])))
        .map(|[i, j, k]| volume.value(i, j, k) - air)
        .sum();
    sum / f64::from(ni * nj * nk)
}

/// Value at a point, by the voxel that it lies in.
fn at(volume: &Volume, point: [f64; 3]) -> f64 {
    let local = volume.local_from_world().transform_point3(point.into()) / volume.spacing();
    let [i, j, k] = local.as_uvec3().to_array();
    volume.value(i, j, k)
}

#[test]
fn every_tissue_has_its_share() {
    // Per cent of the voxels at size 64, about what each structure has of the extent.
    let expected: [(Phantom, &[(f64, f64)]); 5] = [
        (
            Phantom::Cornell,
            &[(38.5, 39.5), (1.9, 2.0), (3.4, 3.6), (3.4, 3.6), (12.9, 13.1), (1.1, 1.3)],
        ),
        (Phantom::Hand, &[(2.0, 5.0), (2.0, 7.0), (0.4, 2.0), (0.6, 2.0), (1.0, 3.0)]),
        (Phantom::Engine, &[(3.5, 8.0), (17.0, 25.0), (0.7, 1.5)]),
        (
            Phantom::Torso,
            &[(5.0, 8.0), (3.0, 8.0), (30.0, 42.0), (0.4, 2.0), (1.0, 3.0), (1.0, 3.0)],
        ),
        (Phantom::Kidneys, &[(60.0, 85.0), (9.5, 19.0), (1.6, 4.4), (0.4, 1.6)]),
    ];
    for (phantom, bounds) in expected {
        let shares = shares(phantom, 64);
        assert_eq!(shares.len(), bounds.len());
        for ((tissue, share), (least, most)) in phantom.tissues().iter().zip(shares).zip(bounds) {
            let percent = 100.0 * share;
            assert!(
                (*least..=*most).contains(&percent),
                "{phantom}: {} has {percent:.2} %, not {least} to {most}",
                tissue.name
            );
        }
    }
}

#[test]
fn a_coarser_phantom_is_the_same_one() {
    for phantom in Phantom::VARIANTS.iter().copied() {
        // Partial volume conserves the mean, but for the shells kept a voxel thick.
        let ratio = mean(phantom, 48) / mean(phantom, 96);
        assert!((ratio - 1.0).abs() < 0.04, "{phantom}: means at 48 and 96 are in ratio {ratio}");
        // Shares lose what edges take: a voxel's width of every surface.
        let most = if phantom == Phantom::Cornell { 1.03 } else { 1.6 };
        for ((tissue, coarse), fine) in
            phantom.tissues().iter().zip(shares(phantom, 64)).zip(shares(phantom, 128))
        {
            let ratio = coarse / fine;
            assert!(
                (1.0 / most..most).contains(&ratio) || tissue.name == "soft tissue" && ratio > 0.45,
                "{phantom}: shares of {} at 64 and 128 are {coarse} and {fine}",
                tissue.name
            );
        }
    }
}

#[test]
fn the_same_voxels_every_time() {
    for phantom in Phantom::VARIANTS.iter().copied() {
        let [once, twice] = [(); 2].map(|()| build(phantom, 40).unwrap());
        assert_eq!(once.voxels(), twice.voxels(), "{phantom}");
        assert_eq!(once.size().iter().max(), Some(&40), "{phantom}");
    }
    // The hash is what voxels and twigs hang on: it must not change by accident.
    assert_eq!([hash(0, 0), hash(1, 0), hash(0, 1)], [520_022_130, 3_375_014_680, 3_849_843_626]);
}

#[test]
fn noise_is_normal_enough() {
    let grains: Vec<f64> =
        (0..32_768).map(|n| f64::from(noise(UVec3::new(n & 31, n >> 5 & 31, n >> 10)))).collect();
    let count = grains.len() as f64;
    let mean = grains.iter().sum::<f64>() / count;
    let variance = grains.iter().map(|x| x * x).sum::<f64>() / count;
    assert!(mean.abs() < 4.0 / count.sqrt(), "mean {mean}");
    assert!((variance - 1.0).abs() < 0.03, "variance {variance}");
    assert!(grains.iter().all(|x| x.abs() <= 3.5));
    // Neighbours know nothing of each other.
    let along = grains.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / count;
    assert!(along.abs() < 4.0 / count.sqrt(), "correlation {along}");
}

#[test]
fn structures_lie_where_they_should() {
    // Patient's left is +x, front -y, up +z.
    let is = |phantom: Phantom, point: [f64; 3], name: &str| {
        let value = at(&build(phantom, 96).unwrap(), point);
        let tissue = phantom.tissues().iter().find(|t| t.name == name).unwrap();
        assert!(
            (tissue.low..=tissue.high).contains(&value),
            "{phantom} at {point:?}: {value}, not {name}"
        );
    };
    is(Phantom::Cornell, [-53.0, 0.0, 0.0], "red");
    is(Phantom::Cornell, [53.0, 0.0, 0.0], "green");
    is(Phantom::Cornell, [0.0, 53.0, 0.0], "white");
    is(Phantom::Cornell, [0.0, -47.0, 0.0], "medium");
    is(Phantom::Hand, [-53.5, -16.0, 11.0], "vessels");
    is(Phantom::Torso, [18.0, 20.0, 100.0], "vessels");
    is(Phantom::Torso, [0.0, 52.0, -19.0], "marrow");
    is(Phantom::Torso, [70.0, 8.0, 70.0], "lungs");
    is(Phantom::Kidneys, [54.0, 32.0, 3.0], "contents");
    is(Phantom::Engine, [18.5, 0.0, 45.0], "valves");
}

#[test]
fn windows_are_apart_and_hold_the_noise() {
    for phantom in Phantom::VARIANTS.iter().copied() {
        let grain = 3.5 * f64::from(phantom.plan().noise);
        for tissue in phantom.tissues() {
            assert!(tissue.plateau() - grain >= tissue.low, "{phantom}: {}", tissue.name);
        }
        for pair in phantom.tissues().windows(2) {
            assert!(pair[0].high < pair[1].low, "{phantom}: {} and {}", pair[0].name, pair[1].name);
        }
    }
}

#[test]
fn sizes_that_cannot_be_are_refused() {
    for size in [0, 15, 1025, u32::MAX] {
        let error = build(Phantom::Hand, size).unwrap_err().to_string();
        assert!(error.contains("16 to 1024"), "{error}");
    }
}
