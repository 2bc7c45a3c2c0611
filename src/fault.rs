//! Impossible values, and how they are told: what reads a value adds where it stands.

use glam::DVec3;

/// An impossible value: the TOML key it belongs to, and what is wrong with it.
pub(crate) struct Fault {
    pub key: &'static str,
    pub what: String,
}

/// What a check finds.
pub(crate) type Check = std::result::Result<(), Fault>;

/// Below this a length is none, mm.
pub(crate) const TINY: f64 = 1e-9;

/// What is wrong with a number that no kernel can hold.
const SINGLE: &str = "it is beyond single precision, 3.4e38";

pub(crate) fn fault(key: &'static str, what: impl Into<String>) -> Check {
    Err(Fault { key, what: what.into() })
}

pub(crate) fn scalar(key: &'static str, value: f64, possible: bool, rule: &str) -> Check {
    match possible && value.is_finite() {
        true if (value as f32).is_finite() => Ok(()),
        true => fault(key, format!("`{key}` is {value}: {SINGLE}")),
        false => fault(key, format!("`{key}` is {value}: {rule}")),
    }
}

pub(crate) fn positive(key: &'static str, value: Option<f64>, unit: &str) -> Check {
    value.map_or(Ok(()), |v| scalar(key, v, v > 0.0, &format!("it must be > 0, {unit}")))
}

pub(crate) fn count(key: &'static str, value: u64, least: u64, most: u64) -> Check {
    match (least..=most).contains(&value) {
        true => Ok(()),
        false => fault(key, format!("`{key}` is {value}: it must be {least} to {most}")),
    }
}

pub(crate) fn finite(key: &'static str, v: DVec3) -> Check {
    vector(key, v, true, "it must be finite")
}

pub(crate) fn vector(key: &'static str, v: DVec3, possible: bool, rule: &str) -> Check {
    match possible && v.is_finite() {
        true if v.as_vec3().is_finite() => Ok(()),
        true => fault(key, format!("`{key}` is {v}: {SINGLE}")),
        false => fault(key, format!("`{key}` is {v}: {rule}")),
    }
}

pub(crate) fn direction(key: &'static str, v: DVec3) -> Check {
    vector(key, v, v.length() >= TINY, "it must have a length")
}

pub(crate) fn non_negative(key: &'static str, v: DVec3) -> Check {
    vector(key, v, v.min_element() >= 0.0, "each channel must be >= 0")
}

pub(crate) fn unit_range(key: &'static str, v: DVec3) -> Check {
    let inside = v.min_element() >= 0.0 && v.max_element() <= 1.0;
    vector(key, v, inside, "each channel must be in [0, 1]")
}

pub(crate) fn askew(key: &'static str, a: DVec3, b: DVec3, other: &str) -> Check {
    match a.normalize().cross(b.normalize()).length() >= 1e-6 {
        true => Ok(()),
        false => fault(key, format!("`{key}` is {b}: it must not be parallel to {other}")),
    }
}
