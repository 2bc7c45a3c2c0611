//! The transfer function: from data values to optical properties.
//!
//! A table of [`TABLE_ENTRIES`] entries over a [`Domain`] of values, one column per property,
//! evaluated at each entry's centre value; nothing is interpolated between entries.
//! [`EntryMap`] is the only way from a value to an entry.

mod cells;
mod domain;
mod material;

use glam::DVec3;

pub use cells::{CellEntries, spans};
pub use domain::{Domain, EntryMap, joined};
pub use material::{Material, ramp_weight};

/// Entries of a [`Table`].
pub const TABLE_ENTRIES: usize = 4096;

/// The unit in which values up to the `greatest` are summed over table entries, as 64-bit integers:
/// a power of two, so that values of 24 bits keep them all unless they are below 2^-27 of it.
pub fn sum_unit(greatest: f32) -> f32 {
    let exponent = if greatest > 0.0 { greatest.log2().floor() + 1.0 } else { 0.0 };
    // Twice the entries: a value may round up, and none may carry over.
    let bits = 63.0 - (TABLE_ENTRIES as f32).log2();
    (exponent - bits).exp2().max(f32::MIN_POSITIVE)
}

/// Built-in materials for CT in Hounsfield units: name and TOML, the keys of a scene's
/// `[[material]]`.
pub const PRESETS: [(&str, &str); 5] = [
    ("ct-bone", include_str!("../../data/transfer/ct-bone.toml")),
    ("ct-vessels", include_str!("../../data/transfer/ct-vessels.toml")),
    ("ct-soft-tissue", include_str!("../../data/transfer/ct-soft-tissue.toml")),
    ("ct-lung", include_str!("../../data/transfer/ct-lung.toml")),
    ("ct-skin", include_str!("../../data/transfer/ct-skin.toml")),
];

/// Optical properties of every table entry, in columns of [`TABLE_ENTRIES`].
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Extinction, 1/mm, at most the majorant.
    pub extinction: Vec<f32>,
    /// Share of the extinction that scatters, in [0, 1].
    pub scatter: Vec<f32>,
    /// Linear RGB in [0, 1]; zero where nothing scatters.
    pub colour: Vec<[f32; 3]>,
    /// Emitted radiance per mm.
    pub emission: Vec<[f32; 3]>,
    /// Henyey-Greenstein g; zero where nothing scatters.
    pub phase_g: Vec<f32>,
    /// Entries whose extinction was clamped at the majorant.
    pub clamped: usize,
}

impl Table {
    /// The table of `materials` over a domain of values.
    ///
    /// Where materials overlap, extinctions and emissions add; scatter is the share that
    /// scatters of their sum; colour and phase are weighted by scattering.
    pub fn build(materials: &[Material], domain: &Domain, majorant: Option<f64>) -> Self {
        let limit = majorant.map_or(f32::INFINITY, |m| m as f32);
        let mut table = Self {
            extinction: vec![0.0; TABLE_ENTRIES],
            scatter: vec![0.0; TABLE_ENTRIES],
            colour: vec![[0.0; 3]; TABLE_ENTRIES],
            emission: vec![[0.0; 3]; TABLE_ENTRIES],
            phase_g: vec![0.0; TABLE_ENTRIES],
            clamped: 0,
        };
        for entry in 0..TABLE_ENTRIES {
            let value = domain.value(entry);
            let (mut extinction, mut scattering, mut g) = (0.0, 0.0, 0.0);
            let (mut colour, mut emission) = (DVec3::ZERO, DVec3::ZERO);
            for m in materials {
                let weight = ramp_weight(&m.ramp, value);
                let scatters = weight * m.extinction * m.scatter;
                extinction += weight * m.extinction;
                scattering += scatters;
                colour += scatters * m.colour;
                g += scatters * m.phase_g;
                emission += weight * m.emission;
            }
            let full = extinction as f32;
            table.clamped += usize::from(full > limit);
            table.extinction[entry] = full.min(limit);
            table.emission[entry] = emission.as_vec3().to_array();
            // What rounds away to nothing in f32 must not leave a colour behind.
            if scattering > 0.0 && full > 0.0 {
                table.scatter[entry] = (scattering / extinction).min(1.0) as f32;
                table.colour[entry] = (colour / scattering).min(DVec3::ONE).as_vec3().to_array();
                table.phase_g[entry] = (g / scattering) as f32;
            }
        }
        table
    }

    /// Albedo of an entry, in [0, 1].
    pub fn albedo(&self, entry: usize) -> [f32; 3] {
        self.colour[entry].map(|c| self.scatter[entry] * c)
    }

    /// The greatest extinction, 1/mm.
    pub fn max_extinction(&self) -> f32 {
        self.extinction.iter().copied().fold(0.0, f32::max)
    }

    /// The greatest component of any emission.
    pub fn max_emission(&self) -> f32 {
        self.emission.iter().flatten().copied().fold(0.0, f32::max)
    }

    /// Whether an entry neither extinguishes nor emits.
    pub fn is_empty_entry(&self, entry: usize) -> bool {
        self.extinction[entry] == 0.0 && self.emission[entry] == [0.0; 3]
    }

    /// Whether there is no extinction and no emission anywhere.
    pub fn is_empty(&self) -> bool {
        (0..TABLE_ENTRIES).all(|e| self.is_empty_entry(e))
    }

    /// Whether all that scatters does so isotropically.
    pub fn is_isotropic(&self) -> bool {
        self.phase_g.iter().all(|&g| g == 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn material(ramp: &[[f64; 2]], extinction: f64, scatter: f64, colour: f64, g: f64) -> Material {
        Material {
            name: String::new(),
            ramp: ramp.to_vec(),
            extinction,
            scatter,
            colour: DVec3::splat(colour),
            emission: DVec3::ZERO,
            phase_g: g,
        }
    }

    #[test]
    fn a_window_is_half_open_and_a_step_counts_its_later_weight() {
        let window = [[10.0, 1.0], [20.0, 1.0]];
        let expect = [(9.99, 0.0), (10.0, 1.0), (19.99, 1.0), (20.0, 0.0)];
        for (value, weight) in expect {
            assert_eq!(ramp_weight(&window, value), weight, "at {value}");
        }
        let stairs = [[0.0, 0.0], [10.0, 0.5], [10.0, 1.0], [20.0, 0.0]];
        let expect = [(5.0, 0.25), (10.0, 1.0), (15.0, 0.5), (20.0, 0.0)];
        for (value, weight) in expect {
            assert_eq!(ramp_weight(&stairs, value), weight, "at {value}");
        }
    }

    #[test]
    fn an_entry_on_a_window_edge_belongs_to_the_upper_window() {
        // Entry 1000's centre is exactly 1000.5 over this range.
        let edge = 1000.5;
        let below = material(&[[0.0, 1.0], [edge, 1.0]], 1.0, 1.0, 1.0, 0.0);
        let above = material(&[[edge, 1.0], [4096.0, 1.0]], 2.0, 1.0, 1.0, 0.0);
        let table = Table::build(&[below, above], &Domain::over([0.0, 4096.0]), None);
        assert_eq!(table.extinction[999], 1.0);
        assert_eq!(table.extinction[1000], 2.0);
        assert_eq!(table.extinction[4095], 2.0);
    }

    #[test]
    fn a_degenerate_range_takes_its_one_value() {
        let m = material(&[[7.0, 1.0], [8.0, 1.0]], 0.25, 1.0, 1.0, 0.0);
        let table = Table::build(&[m], &Domain::over([7.0, 7.0]), None);
        assert!(table.extinction.iter().all(|&e| e == 0.25));
    }

    #[test]
    fn overlapping_materials_add_and_mix_by_scattering() {
        let everywhere = [[0.0, 1.0], [1.0, 1.0]];
        let mut a = material(&everywhere, 3.0, 0.5, 1.0, 0.6);
        let b = material(&everywhere, 1.0, 0.5, 0.2, -0.2);
        a.emission = DVec3::new(1.0, 2.0, 0.0);
        let table = Table::build(&[a.clone(), b, a], &Domain::over([0.0, 1.0]), None);
        assert_eq!(table.extinction[17], 7.0);
        assert_eq!(table.scatter[17], 0.5);
        assert!((table.colour[17][0] - (3.0 + 0.1) / 3.5).abs() < 1e-6);
        assert!((table.phase_g[17] - (1.8 - 0.1) / 3.5).abs() < 1e-6);
        assert_eq!(table.emission[17], [2.0, 4.0, 0.0]);
        assert!((table.albedo(17)[0] - 0.5 * 3.1 / 3.5).abs() < 1e-6);
    }

    #[test]
    fn extinction_is_clamped_and_the_clamps_are_counted() {
        let m = material(&[[0.0, 0.0], [1.0, 1.0]], 2.0, 0.9, 1.0, 0.0);
        let table = Table::build(&[m], &Domain::over([0.0, 1.0]), Some(1.0));
        assert_eq!(table.max_extinction(), 1.0);
        assert_eq!(table.clamped, 2048);
        assert_eq!(table.scatter[4095], 0.9);
    }

    #[test]
    fn what_absorbs_all_has_no_colour_and_what_is_absent_has_nothing() {
        let black = material(&[[0.0, 1.0], [0.5, 1.0]], 1.0, 0.0, 0.7, 0.3);
        let table = Table::build(&[black], &Domain::over([0.0, 1.0]), None);
        assert_eq!((table.scatter[0], table.colour[0], table.phase_g[0]), (0.0, [0.0; 3], 0.0));
        assert!(!table.is_empty() && table.is_empty_entry(2048) && table.is_isotropic());
        assert!(Table::build(&[], &Domain::over([0.0, 1.0]), None).is_empty());
    }
}
