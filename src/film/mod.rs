//! The film: linear images, kept as EXR, and the pictures made of them, as PNG.
//!
//! Only the film knows sRGB. Both kinds of file carry the scene that they show and the
//! provenance of their pixels; both appear under their name only once they are whole.

pub mod metrics;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use exr::prelude as exr;
use exr::{AnyChannel, AnyChannels, AttributeValue, FlatSamples, Text};
use exr::{ReadChannels as _, ReadLayers as _, ReadSpecificChannel as _, WritableImage as _};

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::scene::{Curve, FilmSettings};

/// A linear RGB image, row by row; row 0 is the top and column 0 the left as the viewer
/// sees them.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `width * height` pixels, radiance in W/(sr mm²).
    pub rgb: Vec<[f32; 3]>,
}

/// What a file says besides its pixels.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Notes {
    /// The scene, as TOML.
    pub scene: String,
    /// How the pixels came about: device, version, times, ...
    pub provenance: BTreeMap<String, String>,
}

/// Kinds of image file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// OpenEXR: the linear image as it is, 32-bit.
    Exr,
    /// PNG: the picture, 8-bit sRGB.
    Png,
}

impl Format {
    /// The format that a path's extension asks for. Worth asking before a long render.
    ///
    /// # Errors
    /// [`Error::Image`] for another extension than .exr and .png.
    pub fn of(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("exr") => Ok(Self::Exr),
            Some("png") => Ok(Self::Png),
            _ => Err(image_error(path, "images are written as .exr (linear) or .png (sRGB)")),
        }
    }
}

impl Image {
    /// A black image.
    pub fn black(width: u32, height: u32) -> Self {
        Self { width, height, rgb: vec![[0.0; 3]; width as usize * height as usize] }
    }

    /// Writes the image in the format of the path's extension, through the film's
    /// exposure and curve for a PNG.
    ///
    /// # Errors
    /// [`Error::Image`] for another extension than .exr and .png, or an image without
    /// pixels; [`Error::Io`] for a path that cannot be written. Nothing is left half-written.
    pub fn write(&self, path: impl AsRef<Path>, film: FilmSettings, notes: &Notes) -> Result<()> {
        match Format::of(&path)? {
            Format::Exr => self.write_exr(path, &[], notes),
            Format::Png => self.write_png(path, film, notes),
        }
    }

    /// Writes the linear image, and further layers of the same size: the layer `stderr` has
    /// the channels `stderr.R`, `stderr.G` and `stderr.B`.
    ///
    /// # Errors
    /// Those of [`Image::write`], and a layer of another size.
    pub fn write_exr(
        &self,
        path: impl AsRef<Path>,
        layers: &[(&str, &Image)],
        notes: &Notes,
    ) -> Result<()> {
        let path = path.as_ref();
        let size = (self.width as usize, self.height as usize);
        let mut channels = exr::SmallVec::new();
        for (name, image) in [("", self)].iter().chain(layers) {
            image.check(path)?;
            if (image.width, image.height) != (self.width, self.height) {
                return Err(image_error(path, format!("layer `{name}` has another size")));
            }
            for (i, channel) in channel_names(name).into_iter().enumerate() {
                let samples = image.rgb.iter().map(|p| p[i]).collect();
                channels.push(AnyChannel::new(text(&channel), FlatSamples::F32(samples)));
            }
        }
        // Attributes are kept in hash maps, whose order differs from run to run: with one
        // in each map, equal images are equal files.
        let mut image = exr::Image::from_encoded_channels(
            size,
            exr::Encoding {
                compression: exr::Compression::ZIP16,
                blocks: exr::Blocks::ScanLines,
                line_order: exr::LineOrder::Increasing,
            },
            AnyChannels::sort(channels),
        );
        let scene = AttributeValue::Text(text(&notes.scene));
        image.layer_data.attributes.other.insert(text(SCENE), scene);
        let provenance = AttributeValue::Text(text(&notes.provenance_toml()));
        image.attributes.other.insert(text(PROVENANCE), provenance);
        write_whole(path, |file| {
            let written = image.write().to_buffered(file);
            written.map_err(|e| image_error(path, format!("cannot write it: {e}")))
        })
    }

    /// Writes the picture, 8-bit sRGB.
    ///
    /// # Errors
    /// Those of [`Image::write`].
    pub fn write_png(
        &self,
        path: impl AsRef<Path>,
        film: FilmSettings,
        notes: &Notes,
    ) -> Result<()> {
        let path = path.as_ref();
        self.check(path)?;
        let bytes: Vec<u8> = self.rgb.iter().flat_map(|&p| develop(p, film)).collect();
        write_whole(path, |file| {
            let written = (|| {
                let mut encoder = png::Encoder::new(file, self.width, self.height);
                encoder.set_color(png::ColorType::Rgb);
                encoder.set_depth(png::BitDepth::Eight);
                encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
                encoder.add_itxt_chunk(SCENE.into(), notes.scene.clone())?;
                encoder.add_itxt_chunk(PROVENANCE.into(), notes.provenance_toml())?;
                let mut writer = encoder.write_header()?;
                writer.write_image_data(&bytes)?;
                writer.finish()
            })();
            written.map_err(|e| image_error(path, format!("cannot write it: {e}")))
        })
    }

    fn check(&self, path: &Path) -> Result<()> {
        let pixels = self.width as usize * self.height as usize;
        match pixels > 0 && pixels == self.rgb.len() {
            true => Ok(()),
            false => Err(image_error(
                path,
                format!("{} pixels do not fill {} x {}", self.rgb.len(), self.width, self.height),
            )),
        }
    }

    /// Reads the RGB channels of an EXR file, of any sample type.
    ///
    /// # Errors
    /// Those of [`Image::read_layer`].
    pub fn read_exr(path: impl AsRef<Path>) -> Result<Self> {
        Self::read_layer(path, "")
    }

    /// Reads the RGB channels of one layer of an EXR file: `stderr` means `stderr.R`, ...;
    /// the empty name means `R`, `G`, `B`.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::Image`] where it is damaged, no
    /// EXR, or without these channels.
    pub fn read_layer(path: impl AsRef<Path>, layer: &str) -> Result<Self> {
        let path = path.as_ref();
        let [r, g, b] = channel_names(layer);
        let image = exr::read()
            .no_deep_data()
            .largest_resolution_level()
            .specific_channels()
            .required(text(&r))
            .required(text(&g))
            .required(text(&b))
            .collect_pixels(
                |size, _| Self::black(size.width() as u32, size.height() as u32),
                |image: &mut Self, at, (r, g, b): (f32, f32, f32)| {
                    image.rgb[at.y() * image.width as usize + at.x()] = [r, g, b];
                },
            )
            .first_valid_layer()
            .all_attributes()
            .from_buffered(open(path)?)
            .map_err(|e| {
                image_error(path, format!("it has no readable channels {r}, {g} and {b}: {e}"))
            })?;
        Ok(image.layer_data.channel_data.pixels)
    }
}

impl Notes {
    /// Reads what [`Image::write_exr`] noted in a file; empty where it was not us.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, [`Error::Image`] where it is no EXR.
    pub fn read_exr(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let meta = exr::MetaData::read_from_buffered(open(path)?, false)
            .map_err(|e| image_error(path, format!("it is no readable EXR file: {e}")))?;
        let note = |name: &str| {
            let found = meta.headers.iter().find_map(|h| {
                let own = h.own_attributes.other.get(&text(name));
                own.or_else(|| h.shared_attributes.other.get(&text(name)))
            });
            match found {
                Some(AttributeValue::Text(t)) => String::from_utf8_lossy(t.as_slice()).into(),
                _ => String::new(),
            }
        };
        Ok(Self {
            scene: note(SCENE),
            provenance: toml::from_str(&note(PROVENANCE)).unwrap_or_default(),
        })
    }

    fn provenance_toml(&self) -> String {
        let lines = self.provenance.iter().map(|(k, v)| {
            let [k, v] = [k, v].map(|s| toml::Value::from(s.as_str()));
            format!("{k} = {v}\n")
        });
        lines.collect()
    }
}

/// The name under which a file holds the scene.
const SCENE: &str = "scene";

/// The name under which a file holds how it was made.
const PROVENANCE: &str = "provenance";

/// A linear pixel as it is shown: exposed, through the curve, 8-bit sRGB. What is negative
/// or no number is black.
pub fn develop(rgb: [f32; 3], film: FilmSettings) -> [u8; 3] {
    let exposure = (film.exposure as f32).exp2();
    rgb.map(|linear| {
        let exposed = (linear * exposure).max(0.0);
        let toned = match film.curve {
            Curve::Filmic => filmic(exposed),
            Curve::Srgb => exposed,
        };
        (srgb(toned.min(1.0)) * 255.0).round() as u8
    })
}

/// The ACES filmic curve as fitted by Narkowicz (2016), "ACES filmic tone mapping curve":
/// from linear light, >= 0, to [0, 1].
pub fn filmic(x: f32) -> f32 {
    // Beyond this the curve is flat, and its squares would overflow.
    let x = x.min(1e4);
    ((x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14)).clamp(0.0, 1.0)
}

/// The sRGB transfer function (IEC 61966-2-1), both sides in [0, 1].
pub fn srgb(linear: f32) -> f32 {
    match linear <= 0.003_130_8 {
        true => 12.92 * linear,
        false => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
    }
}

fn open(path: &Path) -> Result<BufReader<File>> {
    let file = File::open(path);
    let file = file.map_err(|source| Error::Io { path: path.into(), action: "read", source })?;
    Ok(BufReader::new(file))
}

fn image_error(path: &Path, what: impl Into<String>) -> Error {
    Error::Image { path: path.into(), what: what.into() }
}

fn channel_names(layer: &str) -> [String; 3] {
    let dot = if layer.is_empty() { "" } else { "." };
    ["R", "G", "B"].map(|c| format!("{layer}{dot}{c}"))
}

/// An EXR text holds bytes; ours are UTF-8.
fn text(s: &str) -> Text {
    Text::from_slice_unchecked(s.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient(width: u32, height: u32) -> Image {
        let pixel = |i: u32| [i as f32, 0.1 * i as f32, -1.5e-7 * i as f32];
        Image { width, height, rgb: (0..width * height).map(pixel).collect() }
    }

    fn notes() -> Notes {
        let provenance = [("adapter", "a \"quoted\" one"), ("größe", "≥ 3 mm²")];
        Notes {
            // Long enough to need more than one byte for its length.
            scene: "name = \"µ\"\n".repeat(1000),
            provenance: provenance.map(|(k, v)| (k.into(), v.into())).into(),
        }
    }

    #[test]
    fn exr_keeps_every_bit_layers_and_notes() -> Result<()> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.exr");
        let (image, other) = (gradient(37, 5), Image::black(37, 5));
        image.write_exr(&path, &[("stderr", &other)], &notes())?;
        assert_eq!(Image::read_exr(&path)?, image);
        assert_eq!(Image::read_layer(&path, "stderr")?, other);
        assert_eq!(Notes::read_exr(&path)?, notes());
        assert!(Image::read_layer(&path, "albedo").is_err());
        let twin = folder.path().join("twin.exr");
        image.write_exr(&twin, &[("stderr", &other)], &notes())?;
        assert_eq!(std::fs::read(path).ok(), std::fs::read(twin).ok());
        Ok(())
    }

    #[test]
    fn png_holds_the_developed_picture_and_notes() -> Result<()> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("x.PNG");
        let image = gradient(4, 3);
        let film = FilmSettings { exposure: -2.0, curve: Curve::Srgb };
        image.write(&path, film, &notes())?;
        let mut reader = png::Decoder::new(open(&path)?).read_info().expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("a small image")];
        reader.next_frame(&mut bytes).expect("a frame");
        let expect: Vec<u8> = image.rgb.iter().flat_map(|&p| develop(p, film)).collect();
        assert_eq!(bytes, expect);
        let texts = &reader.info().utf8_text;
        assert_eq!(texts[0].get_text().ok(), Some(notes().scene));
        assert_eq!(texts[1].get_text().ok(), Some(notes().provenance_toml()));
        Ok(())
    }

    #[test]
    fn the_curves_hit_known_points() {
        let srgb = FilmSettings { exposure: 0.0, curve: Curve::Srgb };
        assert_eq!(develop([0.0, 1.0, 0.215_86], srgb), [0, 255, 128]);
        assert_eq!(develop([-1.0, f32::NAN, f32::INFINITY], srgb), [0, 0, 255]);
        let stop_up = FilmSettings { exposure: 1.0, ..srgb };
        assert_eq!(develop([0.107_93; 3], stop_up), [128; 3]);
        let filmic_film = FilmSettings { exposure: 0.0, curve: Curve::Filmic };
        assert_eq!(develop([0.0, f32::INFINITY, 1e30], filmic_film), [0, 255, 255]);
        assert!((filmic(1.0) - 2.54 / 3.16).abs() < 1e-6);
    }

    #[test]
    fn what_cannot_be_written_leaves_nothing_behind() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let image = gradient(2, 2);
        let film = FilmSettings::default();
        let unknown = image.write(folder.path().join("x.jpg"), film, &Notes::default());
        assert!(unknown.is_err_and(|e| e.to_string().contains(".exr (linear) or .png")));
        let nowhere = image.write(folder.path().join("no/where.exr"), film, &Notes::default());
        assert!(nowhere.is_err_and(|e| e.to_string().contains("cannot write")));
        // The part is written, but cannot take the place of a folder.
        let taken = folder.path().join("folder.exr");
        std::fs::create_dir(&taken).expect("a folder");
        assert!(image.write(&taken, film, &Notes::default()).is_err());
        let broken = Image { width: 3, ..image };
        assert!(broken.write(folder.path().join("x.exr"), film, &Notes::default()).is_err());
        let left = std::fs::read_dir(folder.path()).expect("the folder").count();
        assert_eq!(left, 1, "only the folder that was there");
    }
}
