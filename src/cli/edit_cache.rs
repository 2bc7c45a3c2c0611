//! `edit` of a picture with an irradiance cache: what each edit leaves.

use anyhow::{Result, ensure};
use comfy_table::{Table, presets};
use photogram::device_scene::DeviceScene;
use photogram::film::Format;
use photogram::gpu::{AdapterChoice, Gpu};
use photogram::irradiance::grid::Cells;
use photogram::irradiance::{IrradianceCache, Touched, Until};
use photogram::scene::Scene;
use photogram::volume::Volume;
use serde_json::json;

use super::{align_right, make_folder, notes, say, warn_of_materials, with_progress, write_json};
use crate::EditArgs;

/// An edit, with the passes after it.
struct Row<'a> {
    edit: &'a str,
    touched: Touched,
    cells: Option<Cells>,
    pass_ms: f64,
}

/// Renders the first of the scenes, and goes on with each of the others.
pub fn run(
    adapter: &AdapterChoice,
    args: &EditArgs,
    (scenes, edits): (&[Scene], &[String]),
    volume: &Volume,
) -> Result<()> {
    ensure!(
        args.verify.is_none(),
        "--verify compares updates of the photon map: an irradiance cache goes on as it is"
    );
    warn_of_materials(scenes, volume);
    let gpu = pollster::block_on(photogram::open(adapter))?;
    let device = DeviceScene::new(&gpu, &scenes[0], volume)?;
    let mut cache = IrradianceCache::new(&gpu, &scenes[0], device)?;
    let passes = Until::Passes(scenes[0].settings.samples);
    let mut rows = Vec::new();
    add(&gpu, &mut cache, passes)?;
    for (edit, scene) in edits.iter().zip(&scenes[1..]) {
        let touched = cache.edit(&gpu, scene)?;
        let (cells, pass_ms) = add(&gpu, &mut cache, passes)?;
        rows.push(Row { edit, touched, cells, pass_ms });
    }
    let scene = &scenes[edits.len()];
    if let Some(out) = &args.out {
        make_folder(out)?;
        let images = cache.images(&gpu)?;
        let notes = notes(scene, &gpu.report().name, 0);
        match Format::of(out)? {
            Format::Exr => {
                images.blended.write_exr(out, &[("samples", &images.samples)], &notes)?
            }
            Format::Png => images.blended.write(out, scene.film, &notes)?,
        }
    }
    let mut table = Table::new();
    table.load_style(presets::NOTHING);
    table.set_header(["edit", "pixels restarted %", "cells", "of", "ms a pass"]);
    for Row { edit, touched, cells, pass_ms } in &rows {
        table.add_row([
            (*edit).to_owned(),
            format!("{:.1}", restarted_percent(touched)),
            (if touched.cells_stand { "stand" } else { "learn anew" }).to_owned(),
            cells.as_ref().map_or(0, |cells| cells.made).to_string(),
            format!("{pass_ms:.1}"),
        ]);
    }
    align_right(&mut table);
    let passes = scenes[0].settings.samples;
    say(format_args!("adapter {}; {passes} passes each, wall-clock\n{table}", gpu.report().name))?;
    args.out.as_deref().map_or(Ok(()), |out| say(out.display()))?;
    let rows = rows.iter().map(|row| {
        json!({
            "edit": row.edit,
            "adapter": gpu.report().name,
            "pixels": {
                "total": row.touched.pixels,
                "restarted": row.touched.restarted,
                "restarted_percent": restarted_percent(&row.touched),
            },
            "cells_stand": row.touched.cells_stand,
            "cells": row.cells,
            "passes": passes,
            "time_ms": { "pass": row.pass_ms },
        })
    });
    let rows = rows.collect::<Vec<_>>();
    args.scene.json.as_deref().map_or(Ok(()), |path| write_json(path, &rows))
}

fn restarted_percent(touched: &Touched) -> f64 {
    100.0 * touched.restarted as f64 / touched.pixels.max(1) as f64
}

/// Adds passes. Returns the cells that there are then, and what a pass took, ms.
fn add(gpu: &Gpu, cache: &mut IrradianceCache, passes: Until) -> Result<(Option<Cells>, f64)> {
    let (begun, before) = (std::time::Instant::now(), cache.passes());
    with_progress(|progress| cache.run(gpu, passes, progress))?;
    let ms = begun.elapsed().as_secs_f64() * 1e3 / f64::from(cache.passes() - before);
    Ok((cache.cells(gpu)?, ms))
}
