//! Reading a scene: every refusal names the line, the key, what is wrong and what would
//! be right.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::edit::{set, unknown};
use super::toml_file::{Section, Source};
use super::*;
use crate::fault::unit_range;
use crate::transfer::{Material, PRESETS};

/// What may be said of a material that changes.
pub(super) const CHANGE_KEYS: [&str; 9] =
    ["name", "window", "ramp", "extinction", "albedo", "scatter", "colour", "emission", "phase_g"];

impl Scene {
    /// Reads a scene file. Relative volume paths are relative to it.
    ///
    /// # Errors
    /// [`Error::Io`] where the file cannot be read, and those of [`Scene::parse`].
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|source| Error::Io {
            path: path.into(),
            action: "read",
            source,
        })?;
        Self::parse(&text, path)
    }

    /// Reads a scene from `text` as if it stood in the file `path`.
    ///
    /// # Errors
    /// [`Error::Scene`], with the line, where the text is not TOML, has an unknown key, a
    /// wrong type, an impossible value, or an edit of what there is not.
    pub fn parse(text: &str, path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let source = Source::new(text, path);
        let root = source.parse()?;
        let top = Section::top(&source, &root);
        top.only(&[
            "name",
            "background",
            "volume",
            "camera",
            "light",
            "material",
            "settings",
            "film",
            "edit",
        ])?;
        let section = |key| top.section(key);
        let (volume, filter) = volume(&top.must("volume", section("volume")?)?, path)?;
        let mut scene = Self {
            name: match top.text("name")? {
                Some(name) => name,
                None => path.file_stem().map_or("scene".into(), |s| s.to_string_lossy().into()),
            },
            volume,
            filter,
            camera: camera(&top.must("camera", section("camera")?)?)?,
            lights: Vec::new(),
            materials: Vec::new(),
            background: background(&top)?.unwrap_or(DVec3::ZERO),
            settings: section("settings")?.map_or(Ok(Settings::default()), |s| settings(&s))?,
            film: section("film")?.map_or(Ok(FilmSettings::default()), |s| film(&s))?,
            edits: Vec::new(),
        };
        let mut known = Known::new(&top)?;
        for s in top.sections("material")? {
            scene.materials.push(known.material(&s)?);
        }
        for s in top.sections("light")? {
            scene.lights.push(known.light(&s)?);
        }
        for s in top.sections("edit")? {
            let edit = known.edit(&s, &scene.camera)?;
            if scene.edits.iter().any(|e| e.name == edit.name) {
                return Err(
                    s.fail("name", format!("two edits are called `{}`: rename one", edit.name))
                );
            }
            scene.edits.push(edit);
        }
        Ok(scene)
    }
}

/// The built-in material `name` (see [`PRESETS`]), called like the preset.
///
/// # Errors
/// [`Error::Setting`] where there is no such preset.
pub fn preset(name: &str) -> Result<Material> {
    let names = PRESETS.map(|(n, _)| n);
    let (_, text) = PRESETS
        .into_iter()
        .find(|(n, _)| *n == name)
        .ok_or_else(|| Error::setting(unknown("preset", name, &names)))?;
    let path = PathBuf::from(format!("data/transfer/{name}.toml"));
    let source = Source::new(text, &path);
    let root = source.parse()?;
    let section = Section::top(&source, &root);
    section.only(&CHANGE_KEYS[1..])?;
    whole_material(&section, name.into(), None)
}

pub(super) fn background(s: &Section) -> Result<Option<DVec3>> {
    let background = s.rgb("background")?;
    match background {
        Some(b) if b.min_element() < 0.0 => {
            Err(s.fail("background", format!("`background` is {b}: each channel must be >= 0")))
        }
        _ => Ok(background),
    }
}

fn volume(s: &Section, scene: &Path) -> Result<(VolumeSource, Filter)> {
    s.only(&["file", "phantom", "size", "filter"])?;
    s.not_both("file", &["phantom", "size"])?;
    let volume = match (s.text("file")?, s.text("phantom")?) {
        (Some(file), _) => {
            let file = scene.parent().unwrap_or(Path::new("")).join(file);
            let absolute = std::path::absolute(&file);
            VolumeSource::File(absolute.map_err(|e| s.fail("file", format!("`file`: {e}")))?)
        }
        (None, Some(phantom)) => VolumeSource::Phantom {
            phantom: phantom
                .parse::<Phantom>()
                .map_err(|e| s.fail("phantom", format!("`phantom`: {e}")))?,
            size: s.count("size")?.unwrap_or(128),
        },
        (None, None) => {
            return Err(s.fail("file", "it needs a `file` or a built-in `phantom`"));
        }
    };
    s.check(volume.check())?;
    Ok((volume, s.choice("filter")?.unwrap_or(Filter::Linear)))
}

fn camera(s: &Section) -> Result<Camera> {
    s.only(&["origin", "target", "from", "zoom", "up", "fov_deg", "width", "height"])?;
    let camera = Camera {
        place: s.must("origin", camera_place(s)?)?,
        up: s.vec3("up")?.unwrap_or(DVec3::Z),
        fov_deg: s.number("fov_deg")?.unwrap_or(30.0),
        width: s.count("width")?.unwrap_or(512),
        height: s.count("height")?.unwrap_or(512),
    };
    s.check(camera.check())?;
    Ok(camera)
}

fn camera_place(s: &Section) -> Result<Option<CameraPlace>> {
    s.not_both("from", &["origin", "target"])?;
    s.goes_with("zoom", "from")?;
    s.goes_with("target", "origin")?;
    if let Some(from) = s.vec3("from")? {
        let zoom = s.number("zoom")?.unwrap_or(1.0);
        return Ok(Some(CameraPlace::Around { from, zoom }));
    }
    let Some(origin) = s.vec3("origin")? else {
        return Ok(None);
    };
    let target = s.must("target", s.vec3("target")?)?;
    Ok(Some(CameraPlace::At { origin, target }))
}

fn settings(s: &Section) -> Result<Settings> {
    s.only(&[
        "method",
        "estimator",
        "weighting",
        "photons",
        "max_events",
        "roulette_from",
        "roulette_survival",
        "radius",
        "grid",
        "segments",
        "step",
        "majorant",
        "range",
        "rays",
        "samples",
        "reference_events",
        "seed",
        "flux_unit",
        "skip_empty",
        "history",
        "spatial",
        "cache",
        "gather",
        "shadows",
        "least_chance",
        "cache_mib",
    ])?;
    let mut v = Settings::default();
    set(&mut v.method, s.choice("method")?);
    v.estimator = s.choice("estimator")?;
    set(&mut v.weighting, s.choice("weighting")?);
    set(&mut v.photons, s.whole("photons")?);
    set(&mut v.max_events, s.count("max_events")?);
    set(&mut v.roulette_from, s.count("roulette_from")?);
    set(&mut v.roulette_survival, s.number("roulette_survival")?);
    v.radius = s.number("radius")?;
    set(&mut v.grid, s.number("grid")?);
    set(&mut v.segments, s.count("segments")?);
    set(&mut v.step, s.number("step")?);
    v.majorant = s.number("majorant")?;
    v.range = s.pair("range")?;
    set(&mut v.rays, s.count("rays")?);
    set(&mut v.samples, s.count("samples")?);
    v.reference_events = s.count("reference_events")?;
    set(&mut v.seed, s.whole("seed")?);
    v.flux_unit = s.number("flux_unit")?;
    set(&mut v.skip_empty, s.flag("skip_empty")?);
    set(&mut v.history, s.flag("history")?);
    set(&mut v.spatial, s.choice("spatial")?);
    set(&mut v.cache, s.choice("cache")?);
    set(&mut v.gather, s.flag("gather")?);
    set(&mut v.shadows, s.choice("shadows")?);
    set(&mut v.least_chance, s.number("least_chance")?);
    set(&mut v.cache_mib, s.number("cache_mib")?);
    s.check(v.check())?;
    Ok(v)
}

fn film(s: &Section) -> Result<FilmSettings> {
    s.only(&["exposure", "curve"])?;
    let mut v = FilmSettings::default();
    set(&mut v.exposure, s.number("exposure")?);
    set(&mut v.curve, s.choice("curve")?);
    s.check(v.check())?;
    Ok(v)
}

/// The fields of a material that a section gives, without its name.
fn material_change(s: &Section) -> Result<MaterialChange> {
    s.not_both("window", &["ramp"])?;
    s.not_both("albedo", &["scatter", "colour"])?;
    let mut change = MaterialChange {
        ramp: s.points("ramp")?,
        extinction: s.number("extinction")?,
        scatter: s.number("scatter")?,
        colour: s.rgb("colour")?,
        emission: s.rgb("emission")?,
        phase_g: s.number("phase_g")?,
        ..Default::default()
    };
    if let Some([lo, hi]) = s.pair("window")? {
        if lo >= hi {
            let what = format!("`window` is [{lo}, {hi}]: it is empty, write [low, high)");
            return Err(s.fail("window", what));
        }
        change.ramp = Some(vec![[lo, 1.0], [hi, 1.0]]);
    }
    if let Some(albedo) = s.rgb("albedo")? {
        s.check(unit_range("albedo", albedo))?;
        let scatter = albedo.max_element();
        change.scatter = Some(scatter);
        change.colour = Some(if scatter > 0.0 { albedo / scatter } else { DVec3::ONE });
    }
    Ok(change)
}

/// A material that must end up complete, from nothing or from a preset.
fn whole_material(s: &Section, name: String, base: Option<Material>) -> Result<Material> {
    let change = material_change(s)?;
    let mut material = match base {
        Some(base) => Material { name, ..base },
        None => {
            if change.ramp.is_none() {
                return Err(s.fail("ramp", "it needs a `window`, a `ramp` or a `preset`"));
            }
            let extinction = s.must("extinction", change.extinction)?;
            let coloured = change.scatter.is_some() && change.colour.is_some();
            if extinction != 0.0 && !coloured {
                return Err(s.fail("scatter", "it needs an `albedo`, or `scatter` and `colour`"));
            }
            Material { name, ..Material::neutral() }
        }
    };
    change.apply(&mut material);
    s.check(material.check())?;
    Ok(material)
}

/// Shape, place and power keys of a light.
fn light_keys(shape: &str) -> &'static [&'static str] {
    match shape {
        "point" => &["intensity", "position", "from", "distance"],
        "directional" => &["irradiance", "direction"],
        "rectangle" => &["radiance", "corner", "edge_u", "edge_v", "from", "distance", "size"],
        _ => &["radiance"],
    }
}

/// The place of a light of this shape, where the section gives one; always whole.
fn light_kind(s: &Section, shape: &str) -> Result<Option<LightKind>> {
    let around = s.vec3("from")?;
    let distance = s.number("distance")?.unwrap_or(3.0);
    s.goes_with("distance", "from")?;
    s.goes_with("size", "from")?;
    Ok(match (shape, around) {
        ("point", Some(from)) => {
            s.not_both("from", &["position"])?;
            Some(LightKind::PointAround { from, distance })
        }
        ("point", None) => s.vec3("position")?.map(|position| LightKind::Point { position }),
        ("directional", _) => {
            s.vec3("direction")?.map(|direction| LightKind::Directional { direction })
        }
        ("rectangle", Some(from)) => {
            s.not_both("from", &["corner", "edge_u", "edge_v"])?;
            let size = s.number("size")?.unwrap_or(1.0);
            Some(LightKind::RectangleAround { from, distance, size })
        }
        ("rectangle", None) => {
            s.goes_with("edge_u", "corner")?;
            s.goes_with("edge_v", "corner")?;
            match s.vec3("corner")? {
                Some(corner) => Some(LightKind::Rectangle {
                    corner,
                    edge_u: s.must("edge_u", s.vec3("edge_u")?)?,
                    edge_v: s.must("edge_v", s.vec3("edge_v")?)?,
                }),
                None => None,
            }
        }
        _ => None,
    })
}

/// The materials and lights that the file has named so far: what edits may speak of.
pub(super) struct Known {
    materials: Vec<Material>,
    lights: Vec<Light>,
    /// Ids that the file gives to lights, wherever they stand, and those given out since.
    ids: Vec<u32>,
    /// Names, with their kind, that an edit has freed and may be given once more.
    freed: Vec<(&'static str, String)>,
}

impl Known {
    /// What a whole scene has.
    pub fn of(scene: &Scene) -> Self {
        let (materials, lights) = (scene.materials.clone(), scene.lights.clone());
        Self { materials, lights, ids: Vec::new(), freed: Vec::new() }
    }

    fn new(top: &Section) -> Result<Self> {
        let mut ids = Vec::new();
        let mut lights = top.sections("light")?;
        for edit in top.sections("edit")? {
            lights.extend(edit.sections("add_light")?);
        }
        for s in lights {
            let Some(id) = s.count("id")? else { continue };
            if ids.contains(&id) {
                return Err(s.fail("id", format!("two lights have the `id` {id}: change one")));
            }
            ids.push(id);
        }
        Ok(Self { materials: Vec::new(), lights: Vec::new(), ids, freed: Vec::new() })
    }

    /// Refuses a name that is taken, unless an edit has freed it.
    fn fresh(&mut self, s: &Section, kind: &str, name: &str) -> Result<()> {
        let taken = match kind {
            "material" => self.materials.iter().any(|m| m.name == name),
            _ => self.lights.iter().any(|l| l.name == name),
        };
        let freed = self.freed.iter().position(|(k, n)| *k == kind && n == name);
        match (taken, freed) {
            (true, None) => {
                Err(s.fail("name", format!("two {kind}s are called `{name}`: rename one")))
            }
            (true, Some(at)) => {
                self.freed.swap_remove(at);
                Ok(())
            }
            (false, _) => Ok(()),
        }
    }

    fn material(&mut self, s: &Section) -> Result<Material> {
        s.only(&[&CHANGE_KEYS[..], &["preset"]].concat())?;
        let preset = s
            .text("preset")?
            .map(|name| preset(&name).map_err(|e| s.fail("preset", format!("`preset`: {e}"))));
        let preset = preset.transpose()?;
        let name = s.text("name")?.or_else(|| preset.as_ref().map(|p| p.name.clone()));
        let name = s.must("name", name)?;
        self.fresh(s, "material", &name)?;
        let material = whole_material(s, name, preset)?;
        self.materials.push(material.clone());
        Ok(material)
    }

    fn light(&mut self, s: &Section) -> Result<Light> {
        const SHAPES: [&str; 4] = ["point", "directional", "rectangle", "surroundings"];
        let shape = s.must("kind", s.one_of("kind", &SHAPES)?)?;
        s.only(&[light_keys(shape), &["kind", "name", "id", "share"]].concat())?;
        let id = match s.count("id")? {
            Some(id) => id,
            None => {
                let id = (0..).find(|i| !self.ids.contains(i)).unwrap_or(u32::MAX);
                self.ids.push(id);
                id
            }
        };
        let name = s.text("name")?.unwrap_or_else(|| format!("light-{id}"));
        self.fresh(s, "light", &name)?;
        let kind = match shape {
            "surroundings" => LightKind::Surroundings,
            _ => s.must(light_keys(shape)[1], light_kind(s, shape)?)?,
        };
        let light = Light {
            id,
            name,
            share: s.number("share")?.unwrap_or(1.0),
            emitted: s.must(kind.emitted_key(), s.rgb(kind.emitted_key())?)?,
            kind,
        };
        s.check(light.check())?;
        self.lights.push(light.clone());
        Ok(light)
    }

    fn edit(&mut self, s: &Section, base: &Camera) -> Result<Edit> {
        s.only(&[
            "name",
            "background",
            "camera",
            "material",
            "add_material",
            "remove_material",
            "light",
            "add_light",
            "remove_light",
        ])?;
        let mut changes = Changes { background: background(s)?, ..Default::default() };
        changes.remove_materials = s.names("remove_material")?;
        changes.remove_lights = s.names("remove_light")?;
        for name in &changes.remove_materials {
            self.known_material(s, "remove_material", name)?;
            self.freed.push(("material", name.clone()));
        }
        for name in &changes.remove_lights {
            self.known_light(s, "remove_light", name)?;
            self.freed.push(("light", name.clone()));
        }
        // What comes may be named by what changes in this edit or a later one.
        for m in s.sections("add_material")? {
            changes.add_materials.push(self.material(&m)?);
        }
        for l in s.sections("add_light")? {
            changes.add_lights.push(self.light(&l)?);
        }
        for m in s.sections("material")? {
            changes.materials.push(self.material_change(&m)?);
        }
        for l in s.sections("light")? {
            changes.lights.push(self.light_change(&l)?);
        }
        if let Some(c) = s.section("camera")? {
            changes.camera = camera_change(&c, base)?;
        }
        Ok(Edit { name: s.must("name", s.text("name")?)?, changes })
    }

    fn known_material(&self, s: &Section, key: &str, name: &str) -> Result<&Material> {
        self.materials.iter().rfind(|m| m.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.materials.iter().map(|m| m.name.as_str()).collect();
            s.fail(key, unknown("material", name, &names))
        })
    }

    fn known_light(&self, s: &Section, key: &str, name: &str) -> Result<&Light> {
        self.lights.iter().rfind(|l| l.name == name).ok_or_else(|| {
            let names: Vec<&str> = self.lights.iter().map(|l| l.name.as_str()).collect();
            s.fail(key, unknown("light", name, &names))
        })
    }

    pub fn material_change(&self, s: &Section) -> Result<MaterialChange> {
        s.only(&CHANGE_KEYS)?;
        let name = s.must("name", s.text("name")?)?;
        self.known_material(s, "name", &name)?;
        let change = MaterialChange { name, ..material_change(s)? };
        let mut changed = Material::neutral();
        change.apply(&mut changed);
        s.check(changed.check())?;
        Ok(change)
    }

    pub fn light_change(&self, s: &Section) -> Result<LightChange> {
        let name = s.must("name", s.text("name")?)?;
        let light = self.known_light(s, "name", &name)?;
        let shape = light.kind.shape();
        s.only(&[light_keys(shape), &["name"]].concat())?;
        let change = LightChange {
            name,
            emitted: s.rgb(light.kind.emitted_key())?,
            kind: light_kind(s, shape)?,
        };
        let mut changed = light.clone();
        set(&mut changed.kind, change.kind);
        set(&mut changed.emitted, change.emitted);
        s.check(changed.check())?;
        Ok(change)
    }
}

pub(super) fn camera_change(s: &Section, base: &Camera) -> Result<CameraChange> {
    s.only(&["origin", "target", "from", "zoom", "up", "fov_deg"])?;
    let change =
        CameraChange { place: camera_place(s)?, up: s.vec3("up")?, fov_deg: s.number("fov_deg")? };
    let mut changed = base.clone();
    change.apply(&mut changed);
    s.check(changed.check())?;
    Ok(change)
}
