//! Structs that a kernel and the host share, declared once.
//!
//! `shared_struct!` makes a plain-old-data Rust struct and notes its layout;
//! a test compares every note with what naga finds in the WGSL.

/// Name, offset and size in bytes of one member.
pub type Member = (&'static str, usize, usize);

/// The layout of a struct as Rust has it.
#[derive(Clone, Copy, Debug)]
pub struct Layout {
    /// Name, the same in Rust and in WGSL.
    pub name: &'static str,
    /// Size in bytes, which is also the stride in an array.
    pub size: usize,
    /// The members in order.
    pub members: &'static [Member],
}

/// Declares a `#[repr(C)]` struct shared with the kernels, and its `LAYOUT`.
macro_rules! shared_struct {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(#[$doc:meta])* pub $field:ident: $type:ty,)*
    }) => {
        $(#[$meta])*
        #[repr(C)]
        #[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        $vis struct $name { $($(#[$doc])* pub $field: $type,)* }

        impl $name {
            /// The layout that the kernels must have too.
            pub const LAYOUT: $crate::gpu::layout::Layout = $crate::gpu::layout::Layout {
                name: stringify!($name),
                size: size_of::<$name>(),
                members: &[$((
                    stringify!($field),
                    std::mem::offset_of!($name, $field),
                    size_of::<$type>(),
                ),)*],
            };
        }
    };
}

pub(crate) use shared_struct;
