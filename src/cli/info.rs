//! `info`: adapters and volumes.

use std::path::Path;

use anyhow::Result;
use comfy_table::{Table, presets};
use photogram::gpu;
use photogram::scene::{Scene, VolumeSource};
use photogram::volume::{self, Volume};

use super::scene::is_scene;
use super::{check_unread, say, warn_of, warn_of_materials, write_json};

pub fn list_adapters(json: Option<&Path>) -> Result<()> {
    let adapters = pollster::block_on(gpu::adapters())?;
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header([
        "",
        "name",
        "kind",
        "backend",
        "driver",
        "buffer MiB",
        "binding MiB",
        "3D edge",
        "timestamps",
    ]);
    for a in &adapters {
        table.add_row([
            a.index.to_string(),
            a.name.clone(),
            a.kind.to_owned(),
            a.backend.clone(),
            a.driver.clone(),
            (a.max_buffer_size >> 20).to_string(),
            (a.max_binding_size >> 20).to_string(),
            a.max_texture_3d.to_string(),
            if a.timestamps { "yes" } else { "no" }.to_owned(),
        ]);
    }
    say(&table)?;
    json.map_or(Ok(()), |path| write_json(path, &adapters))
}

pub fn dimensions(volume: &Volume) -> String {
    let ([i, j, k], s) = (volume.size(), volume.spacing());
    format!("{i}x{j}x{k} voxels of {:.4}x{:.4}x{:.4} mm", s.x, s.y, s.z)
}

/// Describes a volume; or that of a scene, and what its materials do not meet.
pub fn describe(path: &Path, json: Option<&Path>) -> Result<()> {
    let scene = if is_scene(path) { Some(Scene::load(path)?) } else { None };
    if let Some(VolumeSource::File(volume)) = scene.as_ref().map(|scene| &scene.volume) {
        check_unread(&[json], &[Some(volume)])?;
    }
    let volume = scene.as_ref().map_or_else(|| volume::load(path), |scene| scene.volume.load())?;
    warn_of(&volume);
    let mut materials = Vec::new();
    if let Some(mut scene) = scene {
        scene.settle(&volume);
        materials = scene.unresolved(&volume);
        warn_of_materials([&scene], &volume);
    }
    let [low, high] = volume.range();
    say(format_args!("{}: {}, {}", path.display(), dimensions(&volume), volume.voxels().name()))?;
    say(format_args!("origin {:.3} mm (left, posterior, superior)", volume.origin()))?;
    for (name, axis) in ["i", "j", "k"].iter().zip([0, 1, 2].map(|a| volume.axes().col(a))) {
        say(format_args!("{name} runs along {axis:.4}"))?;
    }
    say(format_args!("values {low} to {high}"))?;
    let counts = volume.histogram(32);
    let most = counts.iter().map(|&n| n as f64).fold(1.0, f64::max).ln_1p();
    for (i, &n) in counts.iter().enumerate() {
        let value = low + (high - low) * (i as f64 + 0.5) / counts.len() as f64;
        let bar = "#".repeat(((n as f64).ln_1p() / most * 40.0).round() as usize);
        say(format_args!("{value:>12.3} {n:>12} {bar}"))?;
    }
    let warnings = [volume.warnings(), &materials].concat();
    json.map_or(Ok(()), |path| {
        write_json(
            path,
            &serde_json::json!({
                "size": volume.size(),
                "spacing_mm": volume.spacing().to_array(),
                "origin_mm": volume.origin().to_array(),
                "axes": volume.axes().to_cols_array_2d(),
                "stored_as": volume.voxels().name(),
                "range": volume.range(),
                "histogram": counts,
                "warnings": warnings,
            }),
        )
    })
}
