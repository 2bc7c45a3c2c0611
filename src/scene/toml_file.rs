//! TOML with places: tables whose every error carries the line.

use std::path::Path;

use glam::DVec3;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Named;
use crate::error::{Error, Result};
use crate::fault::Fault;

/// A file's text and where it stands.
pub struct Source<'a> {
    text: &'a str,
    path: &'a Path,
}

impl<'a> Source<'a> {
    pub fn new(text: &'a str, path: &'a Path) -> Self {
        Self { text, path }
    }

    /// The file's tables; an error where it is not TOML.
    pub fn parse(&self) -> Result<DeTable<'a>> {
        DeTable::parse(self.text).map(Spanned::into_inner).map_err(|e| {
            self.fail(e.span().map(|s| s.start), format!("this is not TOML: {}", e.message()))
        })
    }

    fn fail(&self, at: Option<usize>, what: String) -> Error {
        let before = at.and_then(|at| self.text.get(..at));
        Error::Scene {
            path: self.path.into(),
            line: before.map(|b| 1 + b.matches('\n').count()),
            what,
        }
    }
}

/// A table of the file.
pub struct Section<'a> {
    source: &'a Source<'a>,
    table: &'a DeTable<'a>,
    /// Byte at which it begins; none for the file itself.
    at: Option<usize>,
    /// Its keys in the file, as before a subtable's: `edit.`.
    path: String,
    /// As in the file, with the name where it has one: ``[[material]] `bone` ``.
    label: String,
}

impl<'a> Section<'a> {
    /// The file itself.
    pub fn top(source: &'a Source<'a>, table: &'a DeTable<'a>) -> Self {
        Self { source, table, at: None, path: String::new(), label: String::new() }
    }

    fn child(
        &self,
        key: &str,
        value: &'a Spanned<DeValue<'a>>,
        brackets: [&str; 2],
    ) -> Result<Self> {
        let path = format!("{}{key}", self.path);
        let head = [brackets[0], &path, brackets[1]].concat();
        let DeValue::Table(table) = value.get_ref() else {
            return Err(self.wrong(key, value, &format!("a table, {head}")));
        };
        let name = table.get("name").and_then(|n| n.get_ref().as_str());
        let name = name.map(|n| format!(" `{n}`")).unwrap_or_default();
        Ok(Self {
            source: self.source,
            table,
            at: Some(value.span().start),
            label: head + &name,
            path: path + ".",
        })
    }

    /// The table under `key`.
    pub fn section(&self, key: &str) -> Result<Option<Self>> {
        self.get(key).map(|v| self.child(key, v, ["[", "]"])).transpose()
    }

    /// The tables of the array under `key`; none where the key is absent.
    pub fn sections(&self, key: &str) -> Result<Vec<Self>> {
        match self.get(key).map(|v| (v, v.get_ref())) {
            None => Ok(Vec::new()),
            Some((_, DeValue::Array(items))) => {
                items.iter().map(|v| self.child(key, v, ["[[", "]]"])).collect()
            }
            Some((v, _)) => {
                Err(self.wrong(key, v, &format!("a list of tables, [[{}{key}]]", self.path)))
            }
        }
    }

    /// Refuses keys other than these.
    pub fn only(&self, keys: &[&str]) -> Result<()> {
        let strange = self.table.keys().filter(|k| !keys.contains(&k.get_ref().as_ref()));
        match strange.min_by_key(|k| k.span().start) {
            None => Ok(()),
            Some(k) => {
                let what = format!("`{}` is unknown: known are {}", k.get_ref(), keys.join(", "));
                Err(self.fail_at(Some(k.span().start), what))
            }
        }
    }

    /// Refuses `key` together with one of `others`.
    pub fn not_both(&self, key: &str, others: &[&str]) -> Result<()> {
        match others.iter().find(|o| self.get(o).is_some()) {
            Some(other) if self.get(key).is_some() => {
                Err(self.fail(key, format!("`{key}` and `{other}` say the same: give one of them")))
            }
            _ => Ok(()),
        }
    }

    /// Refuses `key` without `other`.
    pub fn goes_with(&self, key: &str, other: &str) -> Result<()> {
        match self.get(key).is_some() && self.get(other).is_none() {
            true => Err(self.fail(key, format!("`{key}` goes with `{other}`, which is missing"))),
            false => Ok(()),
        }
    }

    /// The value, or that it is missing.
    pub fn must<T>(&self, key: &str, value: Option<T>) -> Result<T> {
        value.ok_or_else(|| self.fail(key, format!("`{key}` is missing{}", unit(key))))
    }

    /// Adds the line to a fault.
    pub fn check(&self, check: std::result::Result<(), Fault>) -> Result<()> {
        check.map_err(|f| self.fail(f.key, f.what))
    }

    /// An error at `key`, at the table's head where the key is absent.
    pub fn fail(&self, key: &str, what: impl Into<String>) -> Error {
        self.fail_at(self.get(key).map(|v| v.span().start).or(self.at), what.into())
    }

    fn fail_at(&self, at: Option<usize>, what: String) -> Error {
        let colon = if self.label.is_empty() { "" } else { ": " };
        self.source.fail(at, format!("{}{colon}{what}", self.label))
    }

    /// An error: `key` holds `value`, `wanted` was something else.
    fn wrong(&self, key: &str, value: &Spanned<DeValue<'_>>, wanted: &str) -> Error {
        let found = match value.get_ref() {
            DeValue::String(s) => format!("the text {s:?}"),
            DeValue::Integer(i) => i.to_string(),
            DeValue::Float(f) => f.to_string(),
            DeValue::Boolean(b) => b.to_string(),
            DeValue::Array(a) => format!("a list of {}", a.len()),
            DeValue::Table(_) => "a table".into(),
            DeValue::Datetime(_) => "a date".into(),
        };
        let what = format!("`{key}` is {found}: it must be {wanted}");
        self.fail_at(Some(value.span().start), what)
    }

    fn get(&self, key: &str) -> Option<&'a Spanned<DeValue<'a>>> {
        self.table.get(key)
    }

    fn read<T>(
        &self,
        key: &str,
        wanted: &str,
        read: impl Fn(&DeValue<'a>) -> Option<T>,
    ) -> Result<Option<T>> {
        let Some(value) = self.get(key) else {
            return Ok(None);
        };
        match read(value.get_ref()) {
            Some(v) => Ok(Some(v)),
            None => Err(self.wrong(key, value, wanted)),
        }
    }

    /// A finite number.
    pub fn number(&self, key: &str) -> Result<Option<f64>> {
        self.read(key, &format!("a plain finite number{}", unit(key)), number)
    }

    /// A whole number that is not negative.
    pub fn whole(&self, key: &str) -> Result<Option<u64>> {
        self.read(key, "a whole number, not negative, without exponent or point", |v| {
            let i = v.as_integer()?;
            u64::from_str_radix(i.as_str(), i.radix()).ok()
        })
    }

    /// A whole number that fits 32 bits.
    pub fn count(&self, key: &str) -> Result<Option<u32>> {
        let Some(whole) = self.whole(key)? else {
            return Ok(None);
        };
        match u32::try_from(whole) {
            Ok(count) => Ok(Some(count)),
            Err(_) => {
                Err(self.fail(key, format!("`{key}` is {whole}: it must be at most {}", u32::MAX)))
            }
        }
    }

    /// A text.
    pub fn text(&self, key: &str) -> Result<Option<String>> {
        self.read(key, "a text in quotes, not empty", |v| {
            v.as_str().filter(|s| !s.is_empty()).map(String::from)
        })
    }

    /// A list of texts; empty where the key is absent.
    pub fn names(&self, key: &str) -> Result<Vec<String>> {
        let names = self.read(key, "a list of names in quotes", |v| {
            v.as_array()?.iter().map(|n| n.get_ref().as_str().map(String::from)).collect()
        })?;
        Ok(names.unwrap_or_default())
    }

    /// Yes or no.
    pub fn flag(&self, key: &str) -> Result<Option<bool>> {
        self.read(key, "true or false", DeValue::as_bool)
    }

    /// The variant of an enum by its name.
    pub fn choice<T: Named>(&self, key: &str) -> Result<Option<T>> {
        let list: Vec<String> = T::VARIANTS.iter().map(|v| format!("\"{v}\"")).collect();
        self.read(key, &format!("one of {}", list.join(", ")), |v| T::named(v.as_str()?).ok())
    }

    /// One of some names.
    pub fn one_of(&self, key: &str, names: &[&'static str]) -> Result<Option<&'static str>> {
        let list: Vec<String> = names.iter().map(|n| format!("{n:?}")).collect();
        self.read(key, &format!("one of {}", list.join(", ")), |v| {
            let name = v.as_str()?;
            names.iter().find(|n| **n == name).copied()
        })
    }

    /// Three finite numbers.
    pub fn vec3(&self, key: &str) -> Result<Option<DVec3>> {
        let wanted = format!("three plain finite numbers [x, y, z]{}", unit(key));
        self.read(key, &wanted, |v| numbers(v).map(DVec3::from_array))
    }

    /// Three finite numbers, or one for all channels.
    pub fn rgb(&self, key: &str) -> Result<Option<DVec3>> {
        let wanted = format!("plain finite numbers [r, g, b], or one for all{}", unit(key));
        self.read(key, &wanted, |v| {
            number(v).map(DVec3::splat).or_else(|| numbers(v).map(DVec3::from_array))
        })
    }

    /// Two finite numbers.
    pub fn pair(&self, key: &str) -> Result<Option<[f64; 2]>> {
        self.read(key, "two finite data values [low, high]", numbers)
    }

    /// A list of pairs of finite numbers.
    pub fn points(&self, key: &str) -> Result<Option<Vec<[f64; 2]>>> {
        self.read(key, "a list of points [[value, weight], ...]", |v| {
            v.as_array()?.iter().map(|p| numbers(p.get_ref())).collect()
        })
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    let v = match value {
        DeValue::Integer(i) => i128::from_str_radix(i.as_str(), i.radix()).ok()? as f64,
        DeValue::Float(f) => f.as_str().parse().ok()?,
        _ => return None,
    };
    v.is_finite().then_some(v)
}

fn numbers<const N: usize>(value: &DeValue<'_>) -> Option<[f64; N]> {
    let items: Option<Vec<f64>> = value.as_array()?.iter().map(|v| number(v.get_ref())).collect();
    items?.try_into().ok()
}

/// The unit of a key, as it reads after what is wanted.
fn unit(key: &str) -> &'static str {
    match key {
        "extinction" | "majorant" => ", per mm",
        "emission" => ", radiance per mm",
        "origin" | "target" | "position" | "corner" | "edge_u" | "edge_v" | "radius" => ", in mm",
        "fov_deg" => ", in degrees",
        "distance" | "size" => ", in radii of the bounding sphere",
        "intensity" => ", in W/sr",
        "irradiance" => ", in W/mm²",
        "radiance" | "background" => ", in W/(sr mm²)",
        "flux_unit" => ", in W",
        "exposure" => ", in stops",
        _ => "",
    }
}
