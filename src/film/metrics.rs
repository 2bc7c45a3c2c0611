//! How far an image is from a truth.

use crate::error::{Error, Result};
use crate::film::Image;

/// Error of an image x against a truth t, over pixels and channels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Metrics {
    /// Mean of `(x - t)² / (t² + e)` with `e = (0.1 mean t)²`.
    pub rel_mse: f64,
    /// Share of the image's energy in pixels where t is black, in [0, 1]; 0 for a black image.
    pub leak: f64,
    /// `mean x / mean t`; 1 is right.
    pub energy: f64,
}

impl Metrics {
    /// Compares an image with a truth of the same size.
    ///
    /// # Errors
    /// [`Error::Setting`] for different sizes, a value that is not finite, and a truth that
    /// is black on average.
    pub fn of(image: &Image, truth: &Image) -> Result<Self> {
        let size = |i: &Image| format!("{} x {}", i.width, i.height);
        let fits = (image.width, image.height) == (truth.width, truth.height);
        if !fits || image.rgb.len() != truth.rgb.len() {
            return Err(Error::setting(format!(
                "an image of {} cannot be compared with a truth of {}: render the truth's size",
                size(image),
                size(truth)
            )));
        }
        let count = 3.0 * truth.rgb.len() as f64;
        let (sum_x, sum_t): (f64, f64) = (values(image).sum(), values(truth).sum());
        // A sum of f32 in f64 cannot overflow: it is finite where all values are.
        if !sum_x.is_finite() || !sum_t.is_finite() {
            return Err(Error::setting("a value of the image or the truth is not finite"));
        }
        if sum_t <= 0.0 {
            return Err(Error::setting("the truth is black: no error can be relative to it"));
        }
        let e = (0.1 * sum_t / count).powi(2);
        let errors = values(image).zip(values(truth)).map(|(x, t)| (x - t).powi(2) / (t * t + e));
        let pixels = image.rgb.iter().zip(&truth.rgb);
        let stray: f64 = pixels
            .filter(|(_, t)| **t == [0.0; 3])
            .map(|(x, _)| x.iter().map(|&v| f64::from(v)).sum::<f64>())
            .sum();
        Ok(Self {
            rel_mse: errors.sum::<f64>() / count,
            leak: if sum_x == 0.0 { 0.0 } else { stray / sum_x },
            energy: sum_x / sum_t,
        })
    }
}

fn values(image: &Image) -> impl Iterator<Item = f64> {
    image.rgb.as_flattened().iter().map(|&v| f64::from(v))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(rgb: &[[f32; 3]]) -> Image {
        Image { width: rgb.len() as u32, height: 1, rgb: rgb.to_vec() }
    }

    #[test]
    fn metrics_agree_with_a_hand_computation() -> Result<()> {
        let truth = image(&[[2.0, 1.0, 0.0], [0.0; 3]]);
        let x = image(&[[1.0, 1.0, 0.5], [0.0, 0.25, 0.25]]);
        let m = Metrics::of(&x, &truth)?;
        // mean t = 0.5, e = 0.0025; black is a pixel, not a channel.
        let rel_mse = (1.0 / 4.0025 + 0.25 / 0.0025 + 2.0 * 0.0625 / 0.0025) / 6.0;
        assert!((m.rel_mse - rel_mse).abs() < 1e-12);
        assert!((m.leak - 0.5 / 3.0).abs() < 1e-12);
        assert_eq!(m.energy, 1.0);
        Ok(())
    }

    #[test]
    fn a_perfect_and_a_black_image() -> Result<()> {
        let truth = image(&[[1.0; 3], [3.0; 3]]);
        let perfect = Metrics::of(&truth, &truth)?;
        assert_eq!(perfect, Metrics { rel_mse: 0.0, leak: 0.0, energy: 1.0 });
        let black = Metrics::of(&image(&[[0.0; 3]; 2]), &truth)?;
        assert_eq!((black.leak, black.energy), (0.0, 0.0));
        assert!((black.rel_mse - (1.0 / 1.04 + 9.0 / 9.04) / 2.0).abs() < 1e-12);
        Ok(())
    }

    #[test]
    fn what_cannot_be_compared_is_refused() {
        let truth = image(&[[1.0; 3]]);
        for (x, t) in [
            (image(&[[1.0; 3]; 2]), truth.clone()),
            (image(&[[1.0, f32::NAN, 1.0]]), truth.clone()),
            (truth.clone(), image(&[[0.0; 3]])),
            (truth, image(&[[f32::INFINITY; 3]])),
        ] {
            assert!(Metrics::of(&x, &t).is_err());
        }
    }
}
