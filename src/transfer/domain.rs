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
    used: usize,
    /// What entries are judged above their values.
    lift: f64,
}

/// How far beyond a range, in its widths, materials may name values that it is joined with: at most
/// then it keeps one in 33 entries, 124 of them.
const REACH: f64 = 16.0;

/// How far beyond it the ends of what is level out to them may be.
const LEVEL_REACH: f64 = 4.0;

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
        let (origin, extent) = (low, high - low);
        Self { origin, extent, offset: 0.5, parts, used: TABLE_ENTRIES, lift: 0.0 }
    }

    /// The value at an entry's centre.
    pub fn value(&self, entry: usize) -> f64 {
        self.origin + self.extent * ((entry as f64 + self.offset) / self.parts) + self.lift
    }

    /// The domain of the whole numbers from `low` to `high`, which are fewer than entries: each is an
    /// entry's centre, and as many entries as fit lie between neighbours.
    fn whole([low, high]: [f64; 2], numbers: &Numbers) -> Self {
        let parts = ((TABLE_ENTRIES - 1) as f64 / (high - low).max(1.0)).floor();
        // A file's slope of 0.7 is a little less, and label 3 a little below the 2.1 of a window.
        let is_exact = (numbers.step * 4096.0).fract() == 0.0;
        let lift = if is_exact { 0.0 } else { numbers.step / 2048.0 };
        Self {
            origin: numbers.least + numbers.step * low,
            extent: numbers.step,
            offset: 0.0,
            parts,
            used: ((high - low) * parts) as usize + 1,
            lift,
        }
    }

    /// The domain that suits a volume's numbers: every whole number, if there are few enough; else
    /// `range`, or all there are, joined with the values that materials name. What lies outside is
    /// told by the outermost entries, which are beyond the ends of all ramps.
    pub fn fitting(range: Option<[f64; 2]>, numbers: &Numbers, materials: &[Material]) -> Self {
        let data = numbers.range();
        let Some(range) = range else {
            let all = [0.0, numbers.span];
            return if numbers.are_few() { Self::whole(all, numbers) } else { Self::over(data) };
        };
        let [low, high] = joined(range, numbers, materials);
        if numbers.are_whole {
            let number = |value: f64| (value - numbers.least) / numbers.step;
            let ends = [number(low).floor() - 1.0, number(high).ceil() + 1.0];
            let [first, last] = ends.map(|n| n.clamp(0.0, numbers.span));
            if last - first < TABLE_ENTRIES as f64 {
                return Self::whole([first, last], numbers);
            }
        }
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

    /// Entries in use: those from the first on that stand for data, outliers aside.
    pub fn used(&self) -> usize {
        self.used
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
/// data and as these are near enough to leave entries for the range. Where a ramp is level out to an
/// end that is far off, that end says nothing: it is often just large.
pub fn joined(range: [f64; 2], numbers: &Numbers, materials: &[Material]) -> [f64; 2] {
    let data = numbers.range();
    let width = range[1] - range[0];
    let within = |widths: f64, value: f64| {
        width == 0.0 || (range[0] - widths * width..=range[1] + widths * width).contains(&value)
    };
    let named = materials.iter().flat_map(|material| {
        let ramp = &material.ramp[..];
        let inner = match ramp {
            [.., a, b] if a[1] == b[1] && b[0] > range[1] && !within(LEVEL_REACH, b[0]) => {
                &ramp[..ramp.len() - 1]
            }
            _ => ramp,
        };
        match inner {
            [a, b, ..] if a[1] == b[1] && a[0] < range[0] && !within(LEVEL_REACH, a[0]) => {
                &inner[1..]
            }
            _ => inner,
        }
    });
    let named = named.map(|point| point[0].clamp(data[0], data[1]));
    let near = named.filter(|&value| within(REACH, value));
    near.fold(range, |[a, b], v| [a.min(v), b.max(v)])
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
