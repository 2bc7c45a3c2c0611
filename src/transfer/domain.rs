//! The table's domain: which data values its entries stand for.

use super::Material;
use super::TABLE_ENTRIES;
use crate::volume::Numbers;

/// Which data values the entries of a table stand for: entry e for
/// `origin + extent * (e + offset) / parts`, and for what is nearer to that than to its neighbours'.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    origin: f64,
    extent: f64,
    offset: f64,
    parts: f64,
}

/// From a voxel's number, as kernels are given it, to a table entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EntryMap {
    /// Entries for each unit of a number.
    pub gain: f32,
    /// Entry of the number 0, and a half.
    pub shift: f32,
}

impl Domain {
    /// Equal parts of a range of values.
    pub fn over([low, high]: [f64; 2]) -> Self {
        let parts = TABLE_ENTRIES as f64;
        Self { origin: low, extent: high - low, offset: 0.5, parts }
    }

    /// The value at an entry's centre.
    pub fn value(&self, entry: usize) -> f64 {
        self.origin + self.extent * ((entry as f64 + self.offset) / self.parts)
    }

    /// The domain of whole numbers up to `span`: each is an entry's centre, and as many entries as fit
    /// lie between neighbours.
    fn whole(numbers: &Numbers) -> Self {
        let between = ((TABLE_ENTRIES - 1) as f64 / numbers.span.max(1.0)).floor();
        Self { origin: numbers.least, extent: numbers.step, offset: 0.0, parts: between }
    }

    /// The domain that suits a volume's numbers: every whole number, if there are few enough; else
    /// `range`, or all there are, joined with the values that materials name.
    pub fn fitting(range: Option<[f64; 2]>, numbers: &Numbers, materials: &[Material]) -> Self {
        let data = [numbers.least, numbers.least + numbers.step * numbers.span];
        let Some(range) = range else {
            return if numbers.are_few() { Self::whole(numbers) } else { Self::over(data) };
        };
        let [low, high] = joined(range, numbers, materials);
        // What lies outside is told by the outermost entries: beyond the ends of all ramps.
        let margin = (high - low) / (TABLE_ENTRIES - 2) as f64;
        Self::over([
            if data[0] < low { low - margin } else { low },
            if data[1] > high { high + margin } else { high },
        ])
    }

    /// Values from one entry to the next.
    pub fn step(&self) -> f64 {
        self.extent / self.parts
    }

    /// Entries in use: those from the first on that data can have.
    pub fn used(&self, numbers: &Numbers) -> usize {
        match self.offset == 0.0 {
            true => numbers.span as usize * self.parts as usize + 1,
            false => TABLE_ENTRIES,
        }
    }

    /// The map for a volume's numbers.
    pub fn map(&self, numbers: &Numbers) -> EntryMap {
        if self.extent == 0.0 {
            return EntryMap { gain: 0.0, shift: 0.0 };
        }
        let before = (numbers.least - self.origin) / self.extent * self.parts;
        EntryMap {
            gain: (self.parts / (self.extent / numbers.step)) as f32,
            shift: (before - self.offset + 0.5) as f32,
        }
    }
}

/// A range that also has the values at which materials begin, change and end, as far as there are
/// data. Where a ramp is level out to a far end, that end says nothing: it is often just large.
pub fn joined(range: [f64; 2], numbers: &Numbers, materials: &[Material]) -> [f64; 2] {
    let data = [numbers.least, numbers.least + numbers.step * numbers.span];
    let named = materials.iter().flat_map(|material| {
        let ramp = &material.ramp[..];
        let inner = match ramp {
            [.., a, b] if a[1] == b[1] && b[0] > range[1] => &ramp[..ramp.len() - 1],
            _ => ramp,
        };
        match inner {
            [a, b, ..] if a[1] == b[1] && a[0] < range[0] => &inner[1..],
            _ => inner,
        }
    });
    let named = named.map(|point| point[0].clamp(data[0], data[1]));
    named.fold(range, |[a, b], v| [a.min(v), b.max(v)])
}

impl EntryMap {
    /// The entry of a number; what lies outside of the table goes to the first or last.
    pub fn entry_of(&self, number: f32) -> usize {
        ((number * self.gain + self.shift) as usize).min(TABLE_ENTRIES - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_reach_the_first_and_the_last_entry() {
        let map = EntryMap { gain: TABLE_ENTRIES as f32, shift: 0.0 };
        assert_eq!(map.entry_of(0.0), 0);
        assert_eq!(map.entry_of(1.0), 4095);
        assert_eq!(map.entry_of(0.5), 2048);
        assert_eq!(map.entry_of(0.5 - f32::EPSILON), 2047);
        assert_eq!(map.entry_of(-0.1), 0);
        assert_eq!(map.entry_of(7.0), 4095);
        assert_eq!(map.entry_of(f32::NAN), 0);
    }
}
