//! `render`: a scene to an image.

use std::fmt::Write as _;

use anyhow::Result;
use comfy_table::{Table, presets};
use photogram::film::Format;
use photogram::gpu::AdapterChoice;
use photogram::render::{Rendered, render_for};
use photogram::split::Split;

use super::{
    align_right, make_folder, notes, say, warn_of_materials, warnings, with_progress, write_json,
};
use crate::{Prepared, RenderArgs, prepare};

pub fn run_render(adapter: &AdapterChoice, args: &RenderArgs) -> Result<()> {
    let format = Format::of(&args.out)?;
    let json = args.scene.json.as_deref();
    let written = [Some(args.out.as_path()), json];
    let prepared = prepare(&args.scene, &written, &args.changes, |settings| {
        settings.method = args.method.unwrap_or(settings.method);
        settings.rays = args.rays.unwrap_or(settings.rays);
        settings.cache = args.cache.unwrap_or(settings.cache);
        settings.samples = args.samples.unwrap_or(settings.samples);
    })?;
    let Prepared { mut scene, volume, edits, told } = prepared;
    for edit in &edits {
        scene = scene.edited(edit)?;
    }
    scene.check_against(&volume)?;
    warn_of_materials([&scene], &volume);
    let gpu = pollster::block_on(photogram::open(adapter))?;
    let rendered = with_progress(|progress| {
        render_for(&gpu, &scene, &volume, &Split::default(), args.time, progress)
    })?;
    let report = &rendered.report;
    let notes = notes(&scene, &report.adapter, report.photons);
    make_folder(&args.out)?;
    match (format, &rendered.error) {
        (Format::Exr, Some(error)) => {
            rendered.image.write_exr(&args.out, &[("stderr", error)], &notes)?;
        }
        _ => rendered.image.write(&args.out, scene.film, &notes)?,
    }
    told.map_or(Ok(()), say)?;
    say(format_args!("{}{}", summary(&rendered), args.out.display()))?;
    json.map_or(Ok(()), |path| write_json(path, &rendered.report))
}

fn summary(rendered: &Rendered) -> String {
    let r = &rendered.report;
    let mut text = format!("adapter {}, times by {}\n", r.adapter, r.clock);
    if r.photons > 0 {
        let _ = writeln!(
            text,
            "{} photons, up to {} events, {} interactions; {} segments; {} rays a pixel; {}",
            r.photons,
            r.max_events,
            r.counts.interactions,
            r.segments,
            r.rays,
            r.estimator.unwrap_or_default()
        );
        let _ =
            writeln!(text, "{} bytes a photon slot, {} a segment", r.slot_bytes, r.segment_bytes);
    }
    if let Some(cells) = &r.cells {
        let levels = cells.by_level.iter().map(u64::to_string).collect::<Vec<_>>().join(", ");
        let _ = writeln!(text, "{} passes; cells, coarse to fine: {levels}", r.rays);
        if cells.refused > 0 {
            let _ = writeln!(text, "the cache is full: raise `cache_mib`");
        }
    }
    let bytes = r.bytes.iter().map(|(name, n)| format!("{name} {:.1}", *n as f64 / 1048576.0));
    let _ = writeln!(text, "MiB: {}", bytes.collect::<Vec<_>>().join(", "));
    text += &warnings("", r.counts.clamped, r.entries_clamped);
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(["stage", "ms", "dispatches"]);
    for row in &r.stages {
        table.add_row([row.stage.to_owned(), format!("{:.2}", row.ms), row.dispatches.to_string()]);
    }
    table.add_row(["total".to_owned(), format!("{:.0}", r.total_ms), String::new()]);
    align_right(&mut table);
    let _ = writeln!(text, "{table}");
    text
}
