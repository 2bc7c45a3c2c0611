//! Writing a scene as TOML that reads back to an equal one.

use glam::DVec3;
use toml::Value;

use super::*;

impl Scene {
    /// The scene as TOML. Reading it gives an equal scene, wherever the text is kept: the
    /// volume's path is absolute. A majorant and a flux unit that were derived are written. Where
    /// edits were made, write the scene [without them](Self::without_edits): what an edit has
    /// added or removed, the reader would refuse to see added or removed again.
    pub fn to_toml(&self) -> String {
        let mut w = Writer(String::new());
        w.put("name", self.name.as_str());
        w.put("background", rgb(self.background));

        w.head("[volume]");
        match &self.volume {
            VolumeSource::File(path) => w.put("file", path.to_string_lossy().as_ref()),
            VolumeSource::Phantom { phantom, size } => {
                w.put("phantom", phantom.to_string());
                w.put("size", i64::from(*size));
            }
        }
        w.put("filter", self.filter.to_string());

        w.head("[camera]");
        w.camera_place(self.camera.place);
        w.put("up", rgb(self.camera.up));
        w.put("fov_deg", self.camera.fov_deg);
        w.put("width", i64::from(self.camera.width));
        w.put("height", i64::from(self.camera.height));

        for light in &self.lights {
            w.light("[[light]]", light);
        }
        for material in &self.materials {
            w.material("[[material]]", material);
        }
        w.settings(&self.settings);
        w.head("[film]");
        w.put("exposure", self.film.exposure);
        w.put("curve", self.film.curve.to_string());
        let added = self.edits.iter().flat_map(|e| &e.changes.add_lights);
        let lights: Vec<&Light> = self.lights.iter().chain(added).collect();
        for edit in &self.edits {
            w.edit(edit, |name| lights.iter().rfind(|l| l.name == name).map(|l| l.kind));
        }
        w.0
    }
}

struct Writer(String);

impl Writer {
    fn head(&mut self, head: &str) {
        self.0 += &format!("\n{head}\n");
    }

    fn put(&mut self, key: &str, value: impl Into<Value>) {
        self.0 += &format!("{key} = {}\n", value.into());
    }

    fn put_some(&mut self, key: &str, value: Option<impl Into<Value>>) {
        if let Some(value) = value {
            self.put(key, value);
        }
    }

    fn camera_place(&mut self, place: CameraPlace) {
        match place {
            CameraPlace::At { origin, target } => {
                self.put("origin", rgb(origin));
                self.put("target", rgb(target));
            }
            CameraPlace::Around { from, zoom } => {
                self.put("from", rgb(from));
                self.put("zoom", zoom);
            }
        }
    }

    fn light(&mut self, head: &str, light: &Light) {
        self.head(head);
        self.put("kind", light.kind.shape());
        self.put("name", light.name.as_str());
        self.put("id", i64::from(light.id));
        self.put("share", light.share);
        self.put(light.kind.emitted_key(), rgb(light.emitted));
        self.light_kind(light.kind);
    }

    fn light_kind(&mut self, kind: LightKind) {
        match kind {
            LightKind::Point { position } => self.put("position", rgb(position)),
            LightKind::Directional { direction } => self.put("direction", rgb(direction)),
            LightKind::Rectangle { corner, edge_u, edge_v } => {
                self.put("corner", rgb(corner));
                self.put("edge_u", rgb(edge_u));
                self.put("edge_v", rgb(edge_v));
            }
            LightKind::Surroundings => {}
            LightKind::PointAround { from, distance } => {
                self.put("from", rgb(from));
                self.put("distance", distance);
            }
            LightKind::RectangleAround { from, distance, size } => {
                self.put("from", rgb(from));
                self.put("distance", distance);
                self.put("size", size);
            }
        }
    }

    fn material(&mut self, head: &str, m: &Material) {
        self.head(head);
        self.put("name", m.name.as_str());
        self.put("ramp", points(&m.ramp));
        self.put("extinction", m.extinction);
        self.put("scatter", m.scatter);
        self.put("colour", rgb(m.colour));
        self.put("emission", rgb(m.emission));
        self.put("phase_g", m.phase_g);
    }

    fn settings(&mut self, s: &Settings) {
        self.head("[settings]");
        self.put("method", s.method.to_string());
        self.put_some("estimator", s.estimator.map(|e| e.to_string()));
        self.put("weighting", s.weighting.to_string());
        self.put_whole("photons", s.photons);
        self.put_whole("max_events", s.max_events);
        self.put_whole("roulette_from", s.roulette_from);
        self.put("roulette_survival", s.roulette_survival);
        self.put_some("radius", s.radius);
        self.put("grid", s.grid);
        self.put_whole("segments", s.segments);
        self.put("step", s.step);
        self.put_some("majorant", s.majorant);
        self.put_some("range", s.range.map(|range| range.to_vec()));
        self.put_whole("rays", s.rays);
        self.put_whole("samples", s.samples);
        self.put_some("reference_events", s.reference_events.map(i64::from));
        self.put_whole("seed", s.seed);
        self.put_some("flux_unit", s.flux_unit);
        self.put("skip_empty", s.skip_empty);
        self.put("history", s.history);
        self.put("spatial", s.spatial.to_string());
        self.put("cache", s.cache.to_string());
        self.put("gather", s.gather);
        self.put("shadows", s.shadows.to_string());
        self.put("least_chance", s.least_chance);
        self.put("cache_mib", s.cache_mib);
    }

    /// Beyond what a TOML value holds in Rust, not beyond what the reader takes.
    fn put_whole(&mut self, key: &str, value: impl Into<u64>) {
        self.0 += &format!("{key} = {}\n", value.into());
    }

    fn edit(&mut self, edit: &Edit, kind_of: impl Fn(&str) -> Option<LightKind>) {
        let changes = &edit.changes;
        self.head("[[edit]]");
        self.put("name", edit.name.as_str());
        self.put_some("background", changes.background.map(rgb));
        for (key, names) in [
            ("remove_material", &changes.remove_materials),
            ("remove_light", &changes.remove_lights),
        ] {
            if !names.is_empty() {
                self.put(key, names.clone());
            }
        }
        if changes.camera != CameraChange::default() {
            self.head("[edit.camera]");
            if let Some(place) = changes.camera.place {
                self.camera_place(place);
            }
            self.put_some("up", changes.camera.up.map(rgb));
            self.put_some("fov_deg", changes.camera.fov_deg);
        }
        for m in &changes.materials {
            self.head("[[edit.material]]");
            self.put("name", m.name.as_str());
            self.put_some("ramp", m.ramp.as_deref().map(points));
            self.put_some("extinction", m.extinction);
            self.put_some("scatter", m.scatter);
            self.put_some("colour", m.colour.map(rgb));
            self.put_some("emission", m.emission.map(rgb));
            self.put_some("phase_g", m.phase_g);
        }
        for material in &changes.add_materials {
            self.material("[[edit.add_material]]", material);
        }
        for light in &changes.lights {
            self.head("[[edit.light]]");
            self.put("name", light.name.as_str());
            if let Some(kind) = light.kind.or_else(|| kind_of(&light.name)) {
                self.put_some(kind.emitted_key(), light.emitted.map(rgb));
            }
            if let Some(kind) = light.kind {
                self.light_kind(kind);
            }
        }
        for light in &changes.add_lights {
            self.light("[[edit.add_light]]", light);
        }
    }
}

/// Three numbers.
fn rgb(v: DVec3) -> Value {
    v.to_array().to_vec().into()
}

fn points(ramp: &[[f64; 2]]) -> Value {
    ramp.iter().map(|p| Value::from(p.to_vec())).collect::<Vec<_>>().into()
}
