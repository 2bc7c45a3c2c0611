//! Materials: what scenes say of ranges of data values.

use glam::DVec3;

use crate::fault::{Check, fault, non_negative, scalar, unit_range};

/// A named material over data values.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Unique in the scene.
    pub name: String,
    /// Piecewise-linear weight over data values: `[value, weight]`, weights in [0, 1],
    /// values ascending, zero outside. Two equal values make a step, the later one
    /// counting at the value itself; the last value is excluded. A window is
    /// `[[lo, 1], [hi, 1]]`, half-open.
    pub ramp: Vec<[f64; 2]>,
    /// Where the weight is one, 1/mm; >= 0.
    pub extinction: f64,
    /// Share of the extinction that scatters, in [0, 1].
    pub scatter: f64,
    /// Linear RGB in [0, 1]; the albedo is `scatter * colour`.
    pub colour: DVec3,
    /// Emitted radiance per mm where the weight is one, >= 0; seen directly, it lights nothing.
    pub emission: DVec3,
    /// Henyey-Greenstein g in (-1, 1); 0 is isotropic, positive is forward.
    pub phase_g: f64,
}

impl Material {
    /// Possible in every field, so that a change can be checked alone.
    pub(crate) fn neutral() -> Self {
        Self {
            name: String::new(),
            ramp: vec![[0.0, 1.0], [1.0, 1.0]],
            extinction: 0.0,
            scatter: 0.0,
            colour: DVec3::ONE,
            emission: DVec3::ZERO,
            phase_g: 0.0,
        }
    }

    /// Whether it could be seen at all.
    pub fn is_visible(&self) -> bool {
        self.extinction > 0.0 || self.emission.max_element() > 0.0
    }

    /// How far its ramp goes, in values.
    pub fn width(&self) -> f64 {
        let ends = self.ramp.first().zip(self.ramp.last());
        ends.map_or(0.0, |(first, last)| last[0] - first[0])
    }

    /// Albedo in [0, 1]: the scatter times the colour.
    pub fn albedo(&self) -> DVec3 {
        self.scatter * self.colour
    }

    pub(crate) fn check(&self) -> Check {
        ramp("ramp", &self.ramp)?;
        scalar("extinction", self.extinction, self.extinction >= 0.0, "it must be >= 0, per mm")?;
        let fraction = (0.0..=1.0).contains(&self.scatter);
        scalar("scatter", self.scatter, fraction, "it must be in [0, 1]")?;
        unit_range("colour", self.colour)?;
        non_negative("emission", self.emission)?;
        scalar("phase_g", self.phase_g, self.phase_g.abs() < 1.0, "it must be in (-1, 1)")
    }
}

/// Weight in [0, 1] of a ramp at a data value (see [`Material::ramp`]).
pub fn ramp_weight(ramp: &[[f64; 2]], value: f64) -> f64 {
    let after = ramp.partition_point(|p| p[0] <= value);
    if after == 0 || after == ramp.len() {
        return 0.0;
    }
    let ([a, from], [b, to]) = (ramp[after - 1], ramp[after]);
    from + (to - from) * ((value - a) / (b - a))
}

fn ramp(key: &'static str, ramp: &[[f64; 2]]) -> Check {
    let [first, .., last] = ramp else {
        return fault(key, format!("`{key}` has {} points: it takes two or more", ramp.len()));
    };
    if let Some([v, w]) = ramp.iter().find(|[v, w]| !v.is_finite() || !(0.0..=1.0).contains(w)) {
        return fault(key, format!("`{key}` has the point [{v}, {w}]: a weight is in [0, 1]"));
    }
    if let Some(pair) = ramp.windows(2).find(|p| p[0][0] > p[1][0]) {
        let (a, b) = (pair[0][0], pair[1][0]);
        return fault(key, format!("`{key}` descends from {a} to {b}: its values must ascend"));
    }
    if first[0] == last[0] {
        return fault(
            key,
            format!("`{key}` covers the value {} alone: it must cover a range", first[0]),
        );
    }
    Ok(())
}
