//! Work whose length the device alone knows: the arguments of its dispatches are found there.

use super::layout::shared_struct;
use super::run::Stage;
use super::{GROUP, Gpu};
use crate::error::Result;

/// Work groups in one dimension that WebGPU allows.
pub const MAX_GROUPS: u32 = 65_535;

/// Arguments that there is room for: used again when all were.
pub const ARGUMENTS: u32 = 1 << 12;
/// Bytes of those of one dispatch.
pub(super) const ARGUMENT: u64 = 12;

/// Dispatches of one work, at most: slices are larger where there would be more.
pub(super) const MOST_TURNS: u32 = 512;

shared_struct! {
    /// What the kernel is told that finds arguments.
    pub struct TurnParams {
        /// Items of a slice.
        pub slice: u32,
        /// Slices.
        pub turns: u32,
        /// Items for each that is listed.
        pub each: u32,
        /// How many are listed at least before the first that counts.
        pub first: u32,
        /// How many count, at most.
        pub most: u32,
        /// 1 where the length is `most`, whatever the list has.
        pub is_known: u32,
        /// Where the choices begin, words.
        pub choices: u32,
        /// Choices of which one must be made; 0: none needs to.
        pub some: u32,
        /// Choices of which none may be made.
        pub none: u32,
        /// The first of the arguments.
        pub at: u32,
    }
}

/// How long a list is, as the device has it.
#[derive(Clone, Debug)]
pub struct Told {
    /// Its first word is the length.
    pub list: wgpu::Buffer,
    /// The length is `most`, whatever that word says.
    pub is_known: bool,
    /// What comes before this does not count.
    pub first: u32,
    /// How many count, at most.
    pub most: u32,
    /// Items for each that is listed.
    pub each: u32,
    /// Nothing counts unless these were made.
    pub when: Option<When>,
}

/// Choices that the device makes: words that are 0 until they are made.
#[derive(Clone, Debug)]
pub struct When {
    /// Has the choices.
    pub choices: wgpu::Buffer,
    /// Where they begin there, words.
    pub at: u32,
    /// Bits of choices of which one must be made, if any are told.
    pub some: u32,
    /// Bits of choices of which none may be made.
    pub none: u32,
}

impl Told {
    /// All of a list, of at most so many.
    pub fn of(list: &wgpu::Buffer, most: u32) -> Self {
        Self { list: list.clone(), is_known: false, first: 0, most, each: 1, when: None }
    }

    /// So many, where choices were made.
    pub fn known(most: u32, when: When) -> Self {
        let list = when.choices.clone();
        Self { list, is_known: true, first: 0, most, each: 1, when: Some(when) }
    }

    /// Items, at most.
    pub fn bound(&self) -> u64 {
        u64::from(self.most) * u64::from(self.each)
    }
}

/// Where a dispatch finds how many groups it has.
#[derive(Clone, Debug)]
pub(super) struct Arguments {
    pub buffer: wgpu::Buffer,
    pub offset: u64,
}

impl Stage<'_> {
    /// Records that arguments of some turns are found, for slices of `slice` items; returns where
    /// the first of them are.
    pub(super) fn find_turns(&mut self, told: &Told, slice: u32, turns: u32) -> Result<u32> {
        let gpu = self.gpu();
        let at = gpu.reserve_arguments(turns);
        let arguments = gpu.arguments();
        let nothing = When { choices: told.list.clone(), at: 0, some: 0, none: 0 };
        let When { choices, at: choices_at, some, none } = told.when.as_ref().unwrap_or(&nothing);
        let params = TurnParams {
            slice,
            turns,
            each: told.each,
            first: told.first,
            most: told.most,
            is_known: told.is_known.into(),
            choices: *choices_at,
            some: *some,
            none: *none,
            at,
        };
        let bindings = [
            ("lengths", (&told.list).into()),
            ("choices", choices.into()),
            ("arguments", arguments.into()),
        ];
        let kernel = gpu.kernel("turns", &[])?;
        self.dispatch(&kernel, turns.into(), &bindings, &params)?;
        Ok(at)
    }
}

impl Gpu {
    /// Arguments of a place in their buffer.
    pub(super) fn argument(&self, at: u32) -> Arguments {
        let offset = u64::from(at % ARGUMENTS) * ARGUMENT;
        Arguments { buffer: self.arguments().clone(), offset }
    }
}

/// Work groups for `items` threads: in two dimensions where one does not suffice.
pub fn groups_for(items: u64) -> [u32; 2] {
    let groups = items.div_ceil(u64::from(GROUP)).max(1);
    let rows = groups.div_ceil(u64::from(MAX_GROUPS));
    [groups.div_ceil(rows) as u32, rows as u32]
}
