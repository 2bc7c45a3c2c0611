//! `bench`: measurements, as tables here and as files.

use anyhow::{Result, ensure};
use comfy_table::{Table, presets};
use photogram::files;
use photogram::gpu::AdapterChoice;
use photogram::measure::{self, Effort, Sheet};
use serde_json::Value;

use super::{align_right, check_places, make_folder, say, with_progress, write_json};
use crate::{BenchArgs, What};

pub fn run_bench(adapter: &AdapterChoice, args: &BenchArgs) -> Result<()> {
    let own = args.out.join(format!("{:?}.json", args.what).to_lowercase());
    check_places(&[Some(&own), args.json.as_deref()], &[])?;
    if let Some(json) = args.json.as_deref().map(files::place_of) {
        // Sheets and charts have names of their own, which their measurements give them.
        let is_sheet = json.extension().is_some_and(|end| end == "csv" || end == "svg");
        let beside = json.parent() == files::place_of(&own).parent();
        ensure!(
            !(is_sheet && beside),
            "{}: .csv and .svg files in {} are written already: name another file",
            json.display(),
            args.out.display()
        );
    }
    let gpu = pollster::block_on(photogram::open(adapter))?;
    let effort = Effort { scale: args.scale, runs: args.runs.into() };
    let report = with_progress(|progress| match args.what {
        What::Table1 => measure::table1::run(&gpu, effort, progress),
        What::Sweeps => measure::sweeps::run(&gpu, effort, progress),
        What::Visits => measure::visits::run(&gpu, effort, progress),
        What::Overhead => measure::overhead::run(&gpu, effort, progress),
        What::Bins => measure::bins::run(&gpu, effort, progress),
        What::Merging => measure::merging::run(&gpu, effort, progress),
        What::Table2 => measure::table2::run(&gpu, effort, &args.scans, progress),
        What::Steps => measure::steps::run(&gpu, effort, &args.scans, progress),
    })?;
    say(format_args!(
        "adapter {}, kernel times by {}; scale {}, medians of {}",
        report.adapter, report.clock, report.scale, report.runs
    ))?;
    for sheet in &report.sheets {
        say(format_args!("\n{}\n{}", sheet.name, table(sheet)))?;
    }
    report.notes.iter().try_for_each(say)?;
    make_folder(&args.out.join("x"))?;
    report.write(&args.out)?.iter().try_for_each(|path| say(path.display()))?;
    args.json.as_deref().map_or(Ok(()), |path| write_json(path, &report.json()))?;
    let wrong = report.mismatches;
    ensure!(wrong == 0, "updates differ from rebuilds in {wrong} places: this is a bug");
    Ok(())
}

fn table(sheet: &Sheet) -> Table {
    let mut table = Table::new();
    table.load_style(presets::NOTHING).set_header(&sheet.columns);
    for row in &sheet.rows {
        table.add_row(row.iter().map(|value| match value {
            Value::String(text) => text.clone(),
            Value::Number(n) if n.is_f64() => format!("{:.3}", n.as_f64().unwrap_or_default()),
            other => other.to_string(),
        }));
    }
    align_right(&mut table);
    table
}
