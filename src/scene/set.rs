//! An edit in one line, as a command line has it: `bone.albedo=0.9,0.6,0.2`.
//!
//! The line becomes the TOML of a change, which the scene's reader reads and checks as if it stood
//! in an `[[edit]]`: what is possible, and what is said of the rest, is the same.

use std::fmt::Write as _;
use std::path::Path;

use glam::DVec3;
use toml::Value;
use toml::de::DeTable;

use super::edit::unknown;
use super::read::{CHANGE_KEYS, Known, background, camera_change};
use super::toml_file::{Section, Source};
use super::{CameraPlace, Changes, Edit, LightKind, Scene};
use crate::error::{Error, Result};

/// What a line may be about.
enum Owner<'a> {
    Background,
    Camera,
    Material(&'a str),
    Light(&'a str),
}

impl Scene {
    /// The edit that `text` asks of this scene, named by it: `KEY=VALUE` with the key
    /// `MATERIAL.FIELD`, `LIGHT.FIELD` or `light.LIGHT.FIELD`, `camera.FIELD`, or `background`.
    ///
    /// Fields and values are those of an `[[edit]]` in a scene file; lists may lack their outer
    /// brackets. Names may have dots and spaces. What is left of a camera's or light's place stays
    /// as it is: `camera.from` keeps the zoom.
    ///
    /// # Errors
    /// [`Error::Setting`], beginning with the text, for what is unknown, unreadable or impossible.
    pub fn edit_of(&self, text: &str) -> Result<Edit> {
        let refused = |what: String| Error::setting(format!("`{text}`: {what}"));
        let changes = self.changes_of(text).map_err(|error| match error {
            Error::Scene { what, .. } | Error::Setting { what } => refused(what),
            other => other,
        })?;
        // The same line may be asked for again, after others.
        let taken = |name: &str| self.edits.iter().any(|e| e.name == name);
        let mut names = (1..).map(|n| if n == 1 { text.into() } else { format!("{text} ({n})") });
        let name = names.find(|name| !taken(name)).unwrap_or_default();
        Ok(Edit { name, changes })
    }

    fn changes_of(&self, text: &str) -> Result<Changes> {
        let Some((key, value)) = text.split_once('=') else {
            return Err(Error::setting("write KEY=VALUE, such as bone.albedo=0.9,0.6,0.2"));
        };
        let (owner, field) = self.owner(key.trim())?;
        let mut toml = format!("{field} = {}\n", value_toml(value.trim()));
        let rest = match owner {
            Owner::Background => Vec::new(),
            Owner::Camera => camera_rest(self.camera.place, field),
            Owner::Material(name) => vec![("name", name.into())],
            Owner::Light(name) => {
                let kind = self.lights.iter().find(|l| l.name == name).map(|l| l.kind);
                let mut rest = kind.map(|kind| light_rest(kind, field)).unwrap_or_default();
                rest.push(("name", name.into()));
                rest
            }
        };
        for (key, value) in rest {
            let _ = writeln!(toml, "{key} = {value}");
        }
        let source = Source::new(&toml, Path::new(""));
        let table = source.parse()?;
        let section = Section::top(&source, &table);
        let known = Known::of(self);
        let mut changes = Changes::default();
        match owner {
            Owner::Background => changes.background = background(&section)?,
            Owner::Camera => changes.camera = camera_change(&section, &self.camera)?,
            Owner::Material(_) => changes.materials.push(known.material_change(&section)?),
            Owner::Light(_) => changes.lights.push(known.light_change(&section)?),
        }
        Ok(changes)
    }

    /// Whom a key is about and the field of it: the longest name that it begins with.
    fn owner<'a>(&'a self, key: &'a str) -> Result<(Owner<'a>, &'a str)> {
        if key == "background" {
            return Ok((Owner::Background, key));
        }
        let field_after = |name: &str| key.strip_prefix(name)?.strip_prefix('.');
        let mut found: Option<(usize, Owner<'a>, &'a str)> = None;
        let mut offer = |owner: Owner<'a>, field: Option<&'a str>| {
            let Some(field) = field else { return };
            if found.as_ref().is_none_or(|(length, ..)| key.len() - field.len() > *length) {
                found = Some((key.len() - field.len(), owner, field));
            }
        };
        for m in &self.materials {
            offer(Owner::Material(&m.name), field_after(&m.name));
        }
        for l in &self.lights {
            offer(Owner::Light(&l.name), field_after(&l.name));
            offer(Owner::Light(&l.name), field_after(&format!("light.{}", l.name)));
        }
        offer(Owner::Camera, field_after("camera"));
        let Some((_, owner, field)) = found else {
            return Err(Error::setting(self.unknown_owner(key)));
        };
        // Neither a name to change nor text that would be more than one key.
        let is_plain = field.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if field.is_empty() || field == "name" || !is_plain {
            let example = match owner {
                Owner::Material(_) => CHANGE_KEYS[1..].join(", "),
                Owner::Camera => "from, zoom, origin, target, up, fov_deg".into(),
                _ => "its power and place, such as radiance or from".into(),
            };
            return Err(Error::setting(format!("`{field}` is no field: there is {example}")));
        }
        Ok((owner, field))
    }

    fn unknown_owner(&self, key: &str) -> String {
        let lights = self.lights.iter().map(|l| l.name.as_str());
        if let Some(rest) = key.strip_prefix("light.") {
            let wanted = rest.rsplit_once('.').map_or(rest, |(name, _)| name);
            return unknown("light", wanted, &lights.collect::<Vec<_>>());
        }
        let wanted = key.rsplit_once('.').map_or(key, |(name, _)| name);
        let materials = self.materials.iter().map(|m| m.name.as_str());
        if materials.clone().chain(lights.clone()).chain(["camera"]).any(|n| n == key) {
            return format!("it names no field: write {key}.FIELD=VALUE");
        }
        let materials: Vec<&str> = materials.collect();
        let lights: Vec<&str> = lights.chain(["camera", "background"]).collect();
        format!("{}; and {}", unknown("material", wanted, &materials), lights.join(", "))
    }
}

/// A value as TOML. What is none becomes a text, which the reader refuses by saying what it wants.
fn value_toml(value: &str) -> String {
    let number = |text: &str| {
        let parsed: Option<f64> = text.trim().parse().ok();
        parsed.filter(|v| v.is_finite()).map(|v| format!("{v:?}"))
    };
    let listed = || {
        let items: Option<Vec<String>> = value.split(',').map(number).collect();
        items.map(|items| format!("[{}]", items.join(", ")))
    };
    if let Some(toml) = number(value).or_else(listed) {
        return toml;
    }
    let bracketed = if value.is_empty() { String::new() } else { format!("[{value}]") };
    for toml in [value.to_owned(), bracketed] {
        let one = DeTable::parse(&format!("value = {toml}")).is_ok_and(|t| t.get_ref().len() == 1);
        if one {
            return toml;
        }
    }
    Value::from(value).to_string()
}

fn vector(v: DVec3) -> Value {
    v.to_array().to_vec().into()
}

/// Of the camera's place, what goes with `field`.
fn camera_rest(place: CameraPlace, field: &str) -> Vec<(&'static str, Value)> {
    let all = match place {
        CameraPlace::Around { from, zoom } => [("from", vector(from)), ("zoom", zoom.into())],
        CameraPlace::At { origin, target } => {
            [("origin", vector(origin)), ("target", vector(target))]
        }
    };
    others(all.into(), field)
}

/// Of a light's place, what goes with `field`.
fn light_rest(kind: LightKind, field: &str) -> Vec<(&'static str, Value)> {
    let all = match kind {
        LightKind::PointAround { from, distance } => {
            vec![("from", vector(from)), ("distance", distance.into())]
        }
        LightKind::RectangleAround { from, distance, size } => {
            vec![("from", vector(from)), ("distance", distance.into()), ("size", size.into())]
        }
        LightKind::Rectangle { corner, edge_u, edge_v } => {
            vec![("corner", vector(corner)), ("edge_u", vector(edge_u)), ("edge_v", vector(edge_v))]
        }
        _ => Vec::new(),
    };
    others(all, field)
}

fn others(all: Vec<(&'static str, Value)>, field: &str) -> Vec<(&'static str, Value)> {
    match all.iter().any(|(key, _)| *key == field) {
        true => all.into_iter().filter(|(key, _)| *key != field).collect(),
        false => Vec::new(),
    }
}
