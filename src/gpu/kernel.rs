//! Kernels: WGSL with imports from `kernels/shared/`, specialised by feature flags.
//!
//! Sources are embedded. A kernel is composed by WESL (imports, `@if(flag)`),
//! reflected by naga, and its bindings are found by name, so that the host never
//! repeats a binding number. Constants used on both sides come from Rust through
//! the generated module `constants`.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::{Arc, OnceLock};

use include_dir::Dir;
use wesl::syntax::{ModulePath, PathOrigin};
use wesl::{CompileOptions, Feature, Features, ManglerKind, VirtualResolver, Wesl};
use wgpu::naga;

use super::{Gpu, SOFTWARE, lock};
use crate::error::{Error, Result};

/// All kernels of a program: what a device can be asked to run.
pub struct Library {
    /// The folder of WGSL files: a kernel each, and `shared/` with what they import.
    pub sources: &'static Dir<'static>,
    /// Every kernel with the flags that specialise it. A flag missing here does not exist.
    pub kernels: &'static [(&'static str, &'static [&'static str])],
    /// Constants that host and kernels share: the module `constants`.
    pub constants: &'static [(&'static str, u32)],
    /// The sources by the names that imports have for them.
    modules: OnceLock<VirtualResolver<'static>>,
}

/// A compiled kernel.
pub struct Kernel {
    /// The name of its file, and of its dispatches.
    pub name: &'static str,
    pub(super) pipeline: wgpu::ComputePipeline,
    pub(super) layout: wgpu::BindGroupLayout,
    /// Binding number by variable name.
    pub(super) bindings: BTreeMap<String, u32>,
}

impl Library {
    /// Kernels from a folder of sources.
    pub const fn new(
        sources: &'static Dir<'static>,
        kernels: &'static [(&'static str, &'static [&'static str])],
        constants: &'static [(&'static str, u32)],
    ) -> Self {
        Self { sources, kernels, constants, modules: OnceLock::new() }
    }

    /// WGSL of a kernel with the given flags set.
    ///
    /// # Errors
    /// The sources do not compose; a fault of this program, never of a user.
    pub fn compose(&self, name: &str, flags: &[&str]) -> Result<String> {
        let mut compiler =
            Wesl::new("").set_custom_resolver(self.modules.get_or_init(|| self.modules()));
        compiler.set_mangler(ManglerKind::None);
        compiler.set_options(CompileOptions {
            features: Features {
                default: Feature::Error,
                // An imported module may know flags that matter to other kernels only.
                flags: self
                    .kernels
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

    fn modules(&self) -> VirtualResolver<'static> {
        let mut modules = VirtualResolver::new();
        let shared = self.sources.get_dir("shared").into_iter().flat_map(Dir::files);
        for file in self.sources.files().chain(shared) {
            let components = file.path().with_extension("");
            let components = components.iter().map(|c| c.to_string_lossy().into_owned()).collect();
            let text = file.contents_utf8().unwrap_or_default();
            modules.add_module(ModulePath::new(PathOrigin::Absolute, components), text.into());
        }
        let constants = ModulePath::new(PathOrigin::Absolute, vec!["constants".into()]);
        let text =
            self.constants.iter().map(|(name, value)| format!("const {name}: u32 = {value}u;\n"));
        modules.add_module(constants, text.collect::<String>().into());
        modules
    }

    /// The names of the kernel files, as the folder has them.
    pub fn files(&self) -> Vec<String> {
        let stems = self.sources.files().filter_map(|f| f.path().file_stem());
        stems.map(|stem| stem.to_string_lossy().into_owned()).collect()
    }
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

    /// The kernel with those of the flags set that it declares, compiled at the first call.
    ///
    /// # Errors
    /// The sources do not compose or the device refuses them.
    pub fn kernel(&self, name: &'static str, flags: &[&'static str]) -> Result<Arc<Kernel>> {
        let declared = self.library.kernels.iter().find(|(kernel, _)| *kernel == name);
        let declared = declared.ok_or_else(|| Error::device(name, "no such kernel is declared"))?.1;
        let mut flags = flags.to_vec();
        flags.retain(|flag| declared.contains(flag));
        flags.sort_unstable();
        let key = (name, flags);
        if let Some(kernel) = lock(&self.kernels).get(&key) {
            return Ok(kernel.clone());
        }
        let source = self.library.compose(name, &key.1)?;
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
