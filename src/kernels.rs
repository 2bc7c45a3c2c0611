//! The kernels: WGSL files under `kernels/`, the flags that specialise each, and the constants that
//! they share with the rooms that own them. It stands above all stages; they know a kernel by name.

use include_dir::{Dir, include_dir};

use crate::device_scene::lights;
use crate::error::Result;
use crate::gpu::counter::Choice;
use crate::gpu::kernel::Library;
use crate::gpu::{AdapterChoice, Gpu};
use crate::{field, gpu, history, scene, segment, transfer, volume};

static SOURCES: Dir = include_dir!("$CARGO_MANIFEST_DIR/kernels");

/// Opens the chosen adapter, with all kernels at hand.
///
/// # Errors
/// As [`Gpu::open`].
pub async fn open(choice: &AdapterChoice) -> Result<Gpu> {
    Gpu::open(choice, &LIBRARY).await
}

/// All kernels.
pub static LIBRARY: Library = Library::new(&SOURCES, KERNELS, CONSTANTS);

const CONSTANTS: &[(&str, u32)] = &[
    ("GROUP", gpu::GROUP),
    ("MAX_GROUPS", gpu::turns::MAX_GROUPS),
    ("ARGUMENTS", gpu::turns::ARGUMENTS),
    ("SCAN_BLOCK", gpu::scan::SCAN_BLOCK),
    ("SORT_BLOCK", gpu::sort::SORT_BLOCK),
    ("DIGIT_BITS", gpu::sort::DIGIT_BITS),
    ("COUNTER_STRIPES", gpu::counter::COUNTER_STRIPES),
    ("COUNTER_WORDS", gpu::counter::COUNTER_WORDS as u32),
    ("CHOICE_INVALID", Choice::Invalid as u32),
    ("CHOICE_WOKEN", Choice::Woken as u32),
    ("CHOICE_ANEW", Choice::Anew as u32),
    ("CHOICE_LISTED", Choice::Listed as u32),
    ("CHOICE_SEEN", Choice::Seen as u32),
    ("CHOICE_MOVED", Choice::Moved as u32),
    ("CHOICE_CELLS", Choice::Cells as u32),
    ("CHOICE_REFUSED", Choice::Refused as u32),
    ("CELL_EDGE", volume::cells::CELL_EDGE),
    ("TABLE_ENTRIES", transfer::TABLE_ENTRIES as u32),
    ("SPATIAL_AXES", scene::Spatial::Axes as u32),
    ("LAYERS", history::LAYERS),
    ("CHANGE_FALLEN", history::CHANGE_FALLEN),
    ("CHANGE_PHASE", history::CHANGE_PHASE),
    ("CHANGE_ALBEDO", history::CHANGE_ALBEDO),
    ("MAX_LIGHTS", lights::MAX_LIGHTS as u32),
    ("LIGHT_POINT", lights::LIGHT_POINT),
    ("LIGHT_DIRECTIONAL", lights::LIGHT_DIRECTIONAL),
    ("LIGHT_RECTANGLE", lights::LIGHT_RECTANGLE),
    ("LIGHT_SURROUNDINGS", lights::LIGHT_SURROUNDINGS),
    ("DEPOSIT_ADD", field::fluence::Deposit::Add as u32),
    ("DEPOSIT_REPLACE", field::fluence::Deposit::Replace as u32),
    ("DIRTY_SPLIT", field::dirty::DIRTY_SPLIT),
    ("MEAN_BLOCK", field::points::MEAN_BLOCK),
    ("LIST_READ", segment::LIST_READ),
    ("LIST_LIT", segment::LIST_LIT),
    ("SEGMENTS_AT_ONCE", segment::SEGMENTS_AT_ONCE),
];

const KERNELS: &[(&str, &[&str])] = &[
    ("scan_blocks", &[]),
    ("scan_sums", &[]),
    ("sort_count", &[]),
    ("sort_place", &[]),
    ("sort_digits", &[]),
    ("sort_scatter", &[]),
    ("trace", &["nearest", "squares", "float_voxels", "anisotropic", "history", "skip"]),
    ("going", &[]),
    ("forget", &[]),
    ("layers", &[]),
    ("photon_query", &["points"]),
    ("turns", &[]),
    ("list_sums", &[]),
    ("list_rank", &[]),
    ("list", &[]),
    ("fill", &[]),
    ("journal", &[]),
    ("weigh", &[]),
    ("weighed", &["points"]),
    ("compare", &["points"]),
    ("chosen", &[]),
    ("deposit", &[]),
    ("deposit_choice", &[]),
    ("resolve", &[]),
    ("dirty_vacant", &[]),
    ("points_mark", &[]),
    ("points_keep", &[]),
    ("points_key", &["hashed"]),
    ("points_merge", &[]),
    ("points_shift", &["hashed"]),
    ("points_rows", &[]),
    ("points_mean", &["nearest", "squares", "float_voxels", "history"]),
    ("points_query", &[]),
    ("points_record", &["even", "anisotropic"]),
    ("points_dirty", &[]),
    ("points_count", &["hashed"]),
    ("points_take", &["hashed"]),
    ("points_arrange", &[]),
    ("points_origins", &["even"]),
    (
        "segment",
        &[
            "fluence",
            "even",
            "hashed",
            "anisotropic",
            "nearest",
            "squares",
            "float_voxels",
            "emission",
            "history",
            "skip",
        ],
    ),
    ("segment_query", &[]),
    ("composite", &["points"]),
    ("reference", &["nearest", "squares", "float_voxels", "anisotropic", "emission"]),
    (
        "cache_rays",
        &["nearest", "squares", "float_voxels", "emission", "history", "grid", "gather"],
    ),
    (
        "cache_light",
        &["nearest", "squares", "float_voxels", "history", "grid", "all_lights", "evenly", "ratio"],
    ),
    ("cache_pool", &[]),
    ("cache_image", &[]),
    ("cache_restart", &[]),
    ("cache_forget", &[]),
    ("probe", &["nearest", "squares", "float_voxels", "anisotropic", "history", "skip"]),
];
