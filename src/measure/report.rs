//! What a measurement found: sheets for people and programs, and charts.

use std::path::{Path, PathBuf};

use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::files::write_whole;
use crate::gpu::Gpu;

/// Rows of figures.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// Names the file.
    pub name: String,
    /// Names the columns.
    pub columns: Vec<String>,
    /// Numbers and texts.
    pub rows: Vec<Vec<Value>>,
}

impl Sheet {
    /// A sheet without rows.
    pub fn new(name: &str, columns: &[&str]) -> Self {
        let columns = columns.iter().map(ToString::to_string).collect();
        Self { name: name.to_owned(), columns, rows: Vec::new() }
    }

    fn csv(&self) -> std::result::Result<Vec<u8>, csv::Error> {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.write_record(&self.columns)?;
        for row in &self.rows {
            writer.write_record(row.iter().map(|value| match value {
                Value::String(text) => text.clone(),
                other => other.to_string(),
            }))?;
        }
        writer.into_inner().map_err(|e| e.into_error().into())
    }

    fn json(&self) -> Value {
        let object = |row: &Vec<Value>| -> Value {
            self.columns.iter().cloned().zip(row.iter().cloned()).collect()
        };
        self.rows.iter().map(object).collect()
    }
}

/// Points of a chart with a name.
#[derive(Clone, Debug)]
pub struct Series {
    /// For the legend.
    pub name: String,
    /// (x, y).
    pub points: Vec<(f64, f64)>,
    /// Whether a line joins them.
    pub joined: bool,
}

/// A chart.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Names the file.
    pub name: String,
    /// Above the chart.
    pub title: String,
    /// Below and beside the axes.
    pub axes: [String; 2],
    /// Whether the x axis is logarithmic; the y axis always is.
    pub log_x: bool,
    /// What is drawn.
    pub series: Vec<Series>,
}

const COLOURS: [RGBColor; 6] = [
    RGBColor(200, 60, 40),
    RGBColor(40, 90, 200),
    RGBColor(20, 140, 60),
    RGBColor(120, 120, 120),
    RGBColor(190, 120, 20),
    RGBColor(130, 60, 160),
];

impl Chart {
    fn svg(&self) -> std::result::Result<String, String> {
        let values = |axis: fn(&(f64, f64)) -> f64| {
            let all = self.series.iter().flat_map(|s| &s.points).map(axis);
            let all = all.filter(|v| v.is_finite());
            all.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        };
        let ((x0, x1), (y0, y1)) = (values(|p| p.0), values(|p| p.1));
        if !(x0 <= x1 && y0 <= y1) {
            return Err(format!("chart `{}` has no points", self.name));
        }
        let mut text = String::new();
        match self.log_x {
            true => self.draw(&mut text, (x0 / 1.2..x1 * 1.2).log_scale(), [y0, y1]),
            false => {
                let margin = 0.06 * (x1 - x0).max(1e-9);
                self.draw(&mut text, x0 - margin..x1 + margin, [y0, y1])
            }
        }
        .map_err(|e| e.to_string())?;
        Ok(text)
    }

    fn draw<X>(
        &self,
        text: &mut String,
        x: X,
        [low, high]: [f64; 2],
    ) -> std::result::Result<(), Box<dyn std::error::Error + Send + Sync>>
    where
        X: AsRangedCoord<Value = f64>,
        X::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let boxed = |e: DrawingAreaErrorKind<_>| Box::new(e);
        let root = SVGBackend::with_string(text, (900, 440)).into_drawing_area();
        root.fill(&WHITE).map_err(boxed)?;
        let (plot, legend) = root.split_horizontally(640);
        let y = (low.max(1e-4) / 1.3..high * 1.3).log_scale();
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 16))
            .margin(10)
            .x_label_area_size(40)
            .y_label_area_size(60)
            .build_cartesian_2d(x, y)
            .map_err(boxed)?;
        let [x_label, y_label] = &self.axes;
        let short = |value: &f64| format!("{}", (value * 1e6).round() / 1e6);
        chart
            .configure_mesh()
            .x_desc(x_label)
            .y_desc(y_label)
            .x_label_formatter(&short)
            .y_label_formatter(&short)
            .light_line_style(TRANSPARENT)
            .bold_line_style(BLACK.mix(0.12))
            .draw()
            .map_err(boxed)?;
        for (i, (series, colour)) in self.series.iter().zip(COLOURS.iter().cycle()).enumerate() {
            let points = series.points.iter().map(|&(x, y)| (x, y.max(low.max(1e-4))));
            if series.joined {
                let line = LineSeries::new(points.clone(), colour.stroke_width(2));
                chart.draw_series(line).map_err(boxed)?;
            }
            let size = if series.joined { 3 } else { 5 };
            let dots = points.map(|p| Circle::new(p, size, colour.mix(0.7).filled()));
            chart.draw_series(dots).map_err(boxed)?;
            let at = (8, 50 + 20 * i as i32);
            legend.draw(&Circle::new(at, 4, colour.filled())).map_err(boxed)?;
            let label = Text::new(series.name.as_str(), (at.0 + 12, at.1 - 6), ("sans-serif", 12));
            legend.draw(&label).map_err(boxed)?;
        }
        root.present().map_err(boxed)?;
        Ok(())
    }
}

/// Everything that one measurement found.
#[derive(Clone, Debug)]
pub struct Report {
    /// Names the JSON file.
    pub name: &'static str,
    /// What it was measured on.
    pub adapter: String,
    /// What kernel times were taken with.
    pub clock: &'static str,
    /// How large the scenes were.
    pub scale: String,
    /// Runs of each measurement.
    pub runs: usize,
    /// What updates left that a rebuild would not have, where they are to be exact.
    pub mismatches: u64,
    /// What must be said beside the figures.
    pub notes: Vec<String>,
    /// The figures.
    pub sheets: Vec<Sheet>,
    /// The pictures.
    pub charts: Vec<Chart>,
}

impl Report {
    /// A report without figures.
    pub(super) fn new(gpu: &Gpu, name: &'static str, effort: super::Effort) -> Self {
        Self {
            name,
            adapter: gpu.report().name.clone(),
            clock: if gpu.has_timestamps() { "device timestamps" } else { "host clock" },
            scale: effort.scale.to_string(),
            runs: effort.runs,
            mismatches: 0,
            notes: Vec::new(),
            sheets: Vec::new(),
            charts: Vec::new(),
        }
    }

    /// The report as JSON.
    pub fn json(&self) -> Value {
        let sheets: serde_json::Map<_, _> =
            self.sheets.iter().map(|s| (s.name.clone(), s.json())).collect();
        json!({
            "bench": self.name, "adapter": self.adapter, "clock": self.clock,
            "scale": self.scale, "runs": self.runs, "notes": self.notes, "sheets": sheets,
        })
    }

    /// Writes a CSV file for each sheet, an SVG file for each chart, and one JSON file;
    /// returns their paths.
    ///
    /// # Errors
    /// The folder cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |what: String| Error::Image { path, what }
        };
        let mut files = Vec::new();
        for sheet in &self.sheets {
            let path = folder.join(format!("{}.csv", sheet.name));
            let bytes = sheet.csv().map_err(|e| failed(&path)(e.to_string()))?;
            files.push((path, bytes));
        }
        for chart in &self.charts {
            let path = folder.join(format!("{}.svg", chart.name));
            let text = chart.svg().map_err(failed(&path))?;
            files.push((path, text.into_bytes()));
        }
        let path = folder.join(format!("{}.json", self.name));
        let text = serde_json::to_vec_pretty(&self.json());
        let text = text.map_err(|e| failed(&path)(e.to_string()))?;
        files.push((path, text));
        for (path, bytes) in &files {
            write_whole(path, |file| {
                std::io::Write::write_all(file, bytes).map_err(|source| Error::Io {
                    path: path.clone(),
                    action: "write",
                    source,
                })
            })?;
        }
        Ok(files.into_iter().map(|(path, _)| path).collect())
    }
}
