//! Kernels: WGSL with imports from `kernels/shared/`, specialised by feature flags.
//!
//! Sources are embedded. A kernel is composed by WESL (imports, `@if(flag)`),
//! reflected by naga, and its bindings are found by name, so that the host never
//! repeats a binding number. Constants used on both sides come from Rust through
//! the generated module `constants`.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::Arc;

use include_dir::{Dir, include_dir};
use wesl::syntax::{ModulePath, PathOrigin};
use wesl::{CompileOptions, Feature, Features, ManglerKind, VirtualResolver, Wesl};
use wgpu::naga;

use super::{GROUP, Gpu, SOFTWARE, lock};
use crate::error::{Error, Result};

static SOURCES: Dir = include_dir!("$CARGO_MANIFEST_DIR/kernels");

/// Every kernel with the flags that specialise it. A flag missing here does not exist.
pub const KERNELS: &[(&str, &[&str])] = &[
    ("scan_blocks", &[]),
    ("scan_sums", &[]),
    (
        "trace",
        &["nearest", "squares", "float_voxels", "anisotropic", "history", "skip", "listed_bins"],
    ),
    ("layers", &[]),
    ("photon_query", &["points"]),
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
    ("resolve", &[]),
    ("dirty_vacant", &[]),
    ("points_mark", &[]),
    ("points_keep", &[]),
    ("points_key", &[]),
    ("points_merge", &[]),
    ("points_shift", &[]),
    ("points_rows", &[]),
    ("points_mean", &["nearest", "squares", "float_voxels", "history", "listed_bins"]),
    ("points_query", &[]),
    ("points_record", &["even", "anisotropic"]),
    ("points_dirty", &[]),
    ("points_count", &[]),
    ("points_take", &[]),
    ("points_arrange", &[]),
    ("points_origins", &["even"]),
    (
        "segment",
        &[
            "fluence",
            "even",
            "anisotropic",
            "nearest",
            "squares",
            "float_voxels",
            "emission",
            "history",
            "skip",
            "listed_bins",
        ],
    ),
    ("segment_query", &[]),
    ("composite", &["points"]),
    ("reference", &["nearest", "squares", "float_voxels", "anisotropic", "emission"]),
    (
        "probe",
        &["nearest", "squares", "float_voxels", "anisotropic", "history", "skip", "listed_bins"],
    ),
];

/// A compiled kernel.
pub struct Kernel {
    /// The name of its file, and of its dispatches.
    pub name: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layout: wgpu::BindGroupLayout,
    /// Binding number by variable name.
    pub(super) bindings: BTreeMap<String, u32>,
}

/// WGSL of a kernel with the given flags set.
///
/// # Errors
/// The sources do not compose; a fault of this program, never of a user.
pub fn compose(name: &str, flags: &[&str]) -> Result<String> {
    let known = KERNELS.iter().find(|(kernel, _)| *kernel == name);
    let known = known.ok_or_else(|| Error::device(name, "no such kernel is declared"))?.1;
    if let Some(flag) = flags.iter().find(|flag| !known.contains(flag)) {
        return Err(Error::device(name, format!("the flag `{flag}` is not declared")));
    }
    compose_unchecked(name, flags)
}

/// [`compose`] without asking whether the kernel declares the flags: a test asks whether
/// those that it does not declare make no difference.
///
/// # Errors
/// As [`compose`].
pub fn compose_unchecked(name: &str, flags: &[&str]) -> Result<String> {
    let mut resolver = VirtualResolver::new();
    for file in SOURCES.files().chain(SOURCES.get_dir("shared").into_iter().flat_map(Dir::files)) {
        let components = file.path().with_extension("");
        let components = components.iter().map(|c| c.to_string_lossy().into_owned()).collect();
        let text = file.contents_utf8().unwrap_or_default();
        resolver.add_module(ModulePath::new(PathOrigin::Absolute, components), text.into());
    }
    let constants = ModulePath::new(PathOrigin::Absolute, vec!["constants".into()]);
    resolver.add_module(constants, constants_module().into());
    let mut compiler = Wesl::new("").set_custom_resolver(resolver);
    compiler.set_mangler(ManglerKind::None);
    compiler.set_options(CompileOptions {
        features: Features {
            default: Feature::Error,
            // An imported module may know flags that matter to other kernels only.
            flags: KERNELS
                .iter()
                .flat_map(|(_, known)| *known)
                .map(|flag| (flag.to_string(), Feature::from(flags.contains(flag))))
                .collect(),
        },
        ..Default::default()
    });
    let root = ModulePath::new(PathOrigin::Absolute, vec![name.to_owned()]);
    let composed = compiler.compile(&root).map_err(|e| Error::device(name, e.to_string()))?;
    Ok(composed.to_string())
}

/// The names of the kernel files, as the folder has them.
pub fn kernel_files() -> Vec<String> {
    let stems = SOURCES.files().filter_map(|f| f.path().file_stem());
    stems.map(|stem| stem.to_string_lossy().into_owned()).collect()
}

/// Constants that host and kernels share, as a WGSL module.
fn constants_module() -> String {
    let constants: &[(&str, u32)] = &[
        ("GROUP", GROUP),
        ("TABLE_ENTRIES", crate::transfer::TABLE_ENTRIES as u32),
        ("MAX_LIGHTS", crate::light::MAX_LIGHTS as u32),
        ("LIGHT_POINT", crate::light::LIGHT_POINT),
        ("LIGHT_DIRECTIONAL", crate::light::LIGHT_DIRECTIONAL),
        ("LIGHT_RECTANGLE", crate::light::LIGHT_RECTANGLE),
        ("LIGHT_SURROUNDINGS", crate::light::LIGHT_SURROUNDINGS),
        ("COUNTER_STRIPES", crate::counter::COUNTER_STRIPES),
        ("LAYERS", crate::frame::LAYERS),
        ("CHANGE_FALLEN", crate::query::CHANGE_FALLEN),
        ("CHANGE_PHASE", crate::query::CHANGE_PHASE),
        ("CHANGE_ALBEDO", crate::query::CHANGE_ALBEDO),
        ("DIRTY_SPLIT", crate::dirty::DIRTY_SPLIT),
        ("MEAN_BLOCK", crate::points::MEAN_BLOCK),
        ("SPATIAL_AXES", crate::scene::Spatial::Axes as u32),
        ("LIST_READ", crate::segment::LIST_READ),
        ("LIST_LIT", crate::segment::LIST_LIT),
        ("SEGMENTS_AT_ONCE", crate::segment::SEGMENTS_AT_ONCE),
        ("CELL_EDGE", crate::volume::cells::CELL_EDGE),
        ("SCAN_BLOCK", super::scan::SCAN_BLOCK),
    ];
    constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n")).collect()
}

/// Parses composed WGSL.
///
/// # Errors
/// The text is not WGSL.
pub fn parse(name: &str, source: &str) -> Result<naga::Module> {
    naga::front::wgsl::parse_str(source)
        .map_err(|e| Error::device(name, e.emit_to_string_with_path(source, name)))
}

impl Gpu {
    /// Parts in which the adapter deals the groups of a dispatch: Mesa's software adapter gives
    /// each of its threads as many in a row, and those of a picture's empty side soon rest.
    fn parts(&self) -> u32 {
        let cores = || std::thread::available_parallelism().map_or(1, NonZero::get) as u32;
        if self.report().kind == SOFTWARE { cores() } else { 1 }
    }

    /// The kernel with these flags set, compiled at the first call.
    ///
    /// # Errors
    /// The sources do not compose or the device refuses them.
    pub fn kernel(&self, name: &'static str, flags: &[&'static str]) -> Result<Arc<Kernel>> {
        let mut flags = flags.to_vec();
        flags.sort_unstable();
        let key = (name, flags);
        if let Some(kernel) = lock(&self.kernels).get(&key) {
            return Ok(kernel.clone());
        }
        let source = compose(name, &key.1)?;
        let module = parse(name, &source)?;
        let bindings = module
            .global_variables
            .iter()
            .filter_map(|(_, v)| Some((v.name.clone()?, v.binding?.binding)))
            .collect();
        let shader = self.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        // One that asks for no item would not know what it is told.
        let constants = [("parts", f64::from(self.parts()))];
        let asks = module.overrides.iter().any(|(_, o)| o.name.as_deref() == Some("parts"));
        let constants = if asks { &constants[..] } else { &[] };
        let pipeline = self.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: None,
            module: &shader,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            cache: None,
        });
        self.check(name)?;
        let layout = pipeline.get_bind_group_layout(0);
        let kernel = Arc::new(Kernel { name, pipeline, layout, bindings });
        lock(&self.kernels).insert(key, kernel.clone());
        Ok(kernel)
    }
}
