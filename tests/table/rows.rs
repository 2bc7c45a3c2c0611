//! Trouble that users of other programs had with labels, masks and outliers, on boxes of one colour
//! each.

use std::ops::Range;

use photogram::film::Image;

use super::common::rendered;
use super::{glow, glowing, sized};

/// Letters of the colours along the middle of an image, each once, from left to right.
fn colours(image: &Image) -> String {
    let middle = (image.height / 2 * image.width) as usize;
    let row = &image.rgb[middle..middle + image.width as usize];
    let letter = |rgb: &[f32; 3]| {
        let most = rgb.iter().copied().fold(0.0, f32::max);
        let bits = rgb.map(|c| usize::from(c > 0.5 * most && most > 0.1));
        ['-', 'B', 'G', 'C', 'R', 'M', 'Y', 'W'][4 * bits[0] + 2 * bits[1] + bits[2]]
    };
    let mut letters: Vec<char> = row.iter().map(letter).collect();
    letters.dedup();
    letters.retain(|&c| c != '-');
    letters.into_iter().collect()
}

/// Boxes beside each other, six voxels from one to the next, of these values in another.
fn boxes<T: Copy>(values: &[T], outside: T) -> (Vec<T>, [u32; 3]) {
    let along = 6 * values.len() + 2;
    let inside = |at: usize, range: Range<usize>| range.contains(&at);
    let value = |n: usize| {
        let (i, j, k) = (n % along, n / along % 10, n / along / 10);
        let is_box = i % 6 >= 2 && inside(j, 2..8) && inside(k, 2..8);
        if is_box { values[i / 6] } else { outside }
    };
    ((0..along * 100).map(value).collect(), [along as u32, 10, 10])
}

const RAINBOW: [[f64; 3]; 7] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [1.0, 0.0, 1.0],
    [0.0, 1.0, 1.0],
    [1.0, 1.0, 1.0],
];

/// Red, green, blue, yellow, magenta, cyan, white: labels 1 to 7 under windows of whole numbers, and
/// of halves.
#[test]
fn label_integer_windows() {
    let (voxels, size) = boxes(&[1u8, 2, 3, 4, 5, 6, 7], 0);
    let floats: Vec<f32> = voxels.iter().map(|&v| v.into()).collect();
    for volume in [sized(size, voxels), sized(size, floats)] {
        for shift in [0.0, -0.5] {
            let window = |n: usize| [n as f64 + 1.0 + shift, n as f64 + 2.0 + shift];
            let materials = (0..7).map(|n| glow(&format!("label {n}"), window(n), RAINBOW[n]));
            let scene = glowing(&volume, "nearest", &materials.collect::<String>());
            assert_eq!(colours(&rendered(&scene, &volume).image), "RGBYMCW", "{shift}");
        }
    }
}

/// Green: the mask of ones, or of 255, under a window that begins there, and under one about it.
#[test]
fn binary_mask_window() {
    for (high, window) in [(1, [1.0, 2.0]), (1, [0.5, 1.5]), (255, [255.0, 256.0])] {
        let (voxels, size) = boxes(&[high, high], 0_u8);
        let volume = sized(size, voxels);
        let scene = glowing(&volume, "nearest", &glow("mask", window, [0.0, 1.0, 0.0]));
        assert_eq!(colours(&rendered(&scene, &volume).image), "GG", "{window:?}");
    }
}

/// Red muscle, green vessel, blue bone, and air between them, as without the outlier.
#[test]
fn outlier_voxel() {
    let materials = [
        glow("muscle", [0.0, 100.0], RAINBOW[0]),
        glow("vessel", [290.0, 350.0], RAINBOW[1]),
        glow("bone", [480.0, 2000.0], RAINBOW[2]),
    ];
    let image = |outlier: Option<f32>| {
        let (mut voxels, size) = boxes(&[50.0_f32, 320.0, 320.0, 700.0], -1000.0);
        voxels[0] = outlier.unwrap_or(voxels[0]);
        let volume = sized(size, voxels);
        let scene = glowing(&volume, "nearest", &materials.concat());
        assert_eq!(scene.unresolved(&volume), Vec::<String>::new(), "{outlier:?}");
        rendered(&scene, &volume).image
    };
    let clean = image(None);
    assert_eq!(colours(&clean), "RGGB");
    for outlier in [3e5, 1e6, 2e7, -2e6, 30_000.0] {
        assert!(image(Some(outlier)) == clean, "{outlier}");
    }
}
