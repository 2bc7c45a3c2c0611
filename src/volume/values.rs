//! What a file or a phantom holds, as its own element type, and how it is
//! stored: as one of the three types that a kernel can read, exactly but for `f64` and integers
//! of wide range, which single precision rounds.

use rayon::prelude::*;

use super::Voxels;
use crate::error::{Error, Result};

macro_rules! elements {
    ($($name:ident: $type:ty),*) => {
        /// An element type.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind { $(#[doc = concat!("`", stringify!($type), "`")] $name),* }

        /// Elements of any scalar type, i fastest, then j, then k.
        #[derive(Clone, Debug, PartialEq)]
        pub enum Elements { $(#[doc = concat!("`", stringify!($type), "`")] $name(Vec<$type>)),* }

        $(impl From<Vec<$type>> for Values {
            fn from(data: Vec<$type>) -> Self {
                Elements::$name(data).into()
            }
        })*

        impl Kind {
            /// Bytes of one element.
            pub fn bytes(self) -> usize {
                match self { $(Self::$name => size_of::<$type>()),* }
            }

            /// The elements that the bytes spell; an incomplete last one is dropped.
            pub fn decode(self, bytes: &[u8], big_endian: bool) -> Elements {
                match self { $(Self::$name => {
                    let (chunks, _) = bytes.as_chunks::<{ size_of::<$type>() }>();
                    let decode = if big_endian { <$type>::from_be_bytes } else { <$type>::from_le_bytes };
                    Elements::$name(chunks.par_iter().map(|&c| decode(c)).collect())
                }),* }
            }
        }

        impl Elements {
            /// How many there are.
            pub fn count(&self) -> usize {
                match self { $(Self::$name(data) => data.len()),* }
            }
        }
    };
}

elements!(I8: i8, U8: u8, I16: i16, U16: u16, I32: i32, U32: u32, I64: i64, U64: u64, F32: f32, F64: f64);

/// Elements with the linear map to physical values: `slope * element + intercept`.
#[derive(Clone, Debug, PartialEq)]
pub struct Values {
    /// The elements as they are.
    pub elements: Elements,
    /// Physical step from one integer to the next; negative turns the order round, 0 is refused.
    pub slope: f64,
    /// Physical value of element 0.
    pub intercept: f64,
}

impl From<Elements> for Values {
    fn from(elements: Elements) -> Self {
        Self { elements, slope: 1.0, intercept: 0.0 }
    }
}

impl Values {
    /// The same elements under another linear map.
    pub fn mapped(self, slope: f64, intercept: f64) -> Self {
        Self { slope, intercept, ..self }
    }

    /// Stored form. `size` serves to tell where a bad value lies.
    pub(super) fn store(self, size: [u32; 3]) -> Result<Stored> {
        let Self { elements, slope, intercept } = self;
        if !(slope.is_finite() && slope != 0.0 && intercept.is_finite()) {
            return Err(Error::setting(format!(
                "slope {slope} and intercept {intercept} map no value: the slope must be finite and not 0, \
                 the intercept finite"
            )));
        }
        let map = Map { slope, intercept, size };
        match elements {
            Elements::I8(data) => map.integers(data, true),
            Elements::U8(data) => map.integers(data, true),
            Elements::I16(data) => map.integers(data, false),
            Elements::U16(data) => map.integers(data, false),
            Elements::I32(data) => map.integers(data, false),
            Elements::U32(data) => map.integers(data, false),
            Elements::I64(data) => map.integers(data, false),
            Elements::U64(data) => map.integers(data, false),
            Elements::F32(data) if slope == 1.0 && intercept == 0.0 => map.floats(data),
            Elements::F32(data) => map.floats(map.physical(&data, f64::from)?),
            Elements::F64(data) => map.floats(map.physical(&data, |x| x)?),
        }
    }
}

/// Voxels with the map back: physical value = `range[0] + step * stored` for
/// integers; floats are physical as they are.
pub(super) struct Stored {
    pub voxels: Voxels,
    pub range: [f64; 2],
    pub step: f64,
}

struct Map {
    slope: f64,
    intercept: f64,
    size: [u32; 3],
}

impl Map {
    fn integers<T: Copy + Ord + Into<i128> + Send + Sync>(
        &self,
        data: Vec<T>,
        eight: bool,
    ) -> Result<Stored> {
        let least: i128 = data.par_iter().min().map_or(0, |&x| x.into());
        let greatest: i128 = data.par_iter().max().map_or(0, |&x| x.into());
        let span = greatest - least;
        if span > i128::from(u16::MAX) {
            return self.floats(self.physical(&data, |x| x.into() as f64)?);
        }
        // Stored order is physical order: a negative slope counts down from the greatest.
        let (zero, sign) = if self.slope > 0.0 { (least, 1) } else { (greatest, -1) };
        let rebased = data.par_iter().map(|&x| sign * (x.into() - zero));
        let voxels = if eight {
            Voxels::U8(rebased.map(|x| x as u8).collect())
        } else {
            Voxels::U16(rebased.map(|x| x as u16).collect())
        };
        let (step, low) = (self.slope.abs(), zero as f64 * self.slope + self.intercept);
        let range = [low, low + step * span as f64];
        if !range.iter().all(|x| x.is_finite()) {
            return Err(Error::setting(
                "values overflow under the slope and intercept: correct these",
            ));
        }
        Ok(Stored { voxels, range, step })
    }

    /// Physical values in single precision, or what does not fit it.
    fn physical<T: Copy + Sync>(
        &self,
        data: &[T],
        double: impl Fn(T) -> f64 + Sync,
    ) -> Result<Vec<f32>> {
        let exact = |x: T| double(x) * self.slope + self.intercept;
        let fits = |x: T| (exact(x) as f32).is_finite() || !double(x).is_finite();
        if let Some(at) = data.par_iter().position_first(|&x| !fits(x)) {
            return Err(Error::setting(format!(
                "value {:e} at voxel {:?} is beyond single precision: scale the data down",
                exact(data[at]),
                self.voxel(at)
            )));
        }
        Ok(data.par_iter().map(|&x| exact(x) as f32).collect())
    }

    fn floats(&self, data: Vec<f32>) -> Result<Stored> {
        if let Some(at) = data.par_iter().position_first(|x| !x.is_finite()) {
            let count = data.par_iter().filter(|x| !x.is_finite()).count();
            return Err(Error::setting(format!(
                "{count} of {} values are NaN or infinite, the first at voxel {:?}: replace them",
                data.len(),
                self.voxel(at)
            )));
        }
        // Ordered in full, so that the sign of a zero does not hang on who looked first; and
        // then without it.
        let least = data.par_iter().copied().min_by(f32::total_cmp);
        let greatest = data.par_iter().copied().max_by(f32::total_cmp);
        let range = [least, greatest].map(|x| x.map_or(0.0, f64::from) + 0.0);
        let span = range[1] - range[0];
        // A kernel's numbers times their gain must not leave the normal ones.
        let normal = |x: f64| (x as f32).is_normal();
        if span != 0.0 && !(normal(span) && normal(1.0 / span)) {
            return Err(Error::setting(format!(
                "values from {:e} to {:e} span too much or too little for single precision: rescale the data",
                range[0], range[1]
            )));
        }
        Ok(Stored { voxels: Voxels::F32(data), range, step: 1.0 })
    }

    fn voxel(&self, at: usize) -> [usize; 3] {
        let [i, j] = [self.size[0] as usize, self.size[1] as usize];
        [at % i, at / i % j, at / i / j]
    }
}
