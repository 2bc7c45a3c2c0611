//! Kernels: WGSL with imports from `kernels/shared/`, specialised by feature flags.
//!
//! Sources are embedded. A kernel is composed by WESL (imports, `@if(flag)`),
//! reflected by naga, and its bindings are found by name, so that the host never
//! repeats a binding number. Constants used on both sides come from Rust through
//! the generated module `constants`.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use include_dir::Dir;
use wesl::syntax::{ModulePath, PathOrigin};
use wesl::{CompileOptions, Feature, Features, ManglerKind, VirtualResolver, Wesl};
use wgpu::naga::{
    self, AddressSpace, ImageClass, ImageDimension, ScalarKind, StorageAccess, StorageFormat,
    TypeInner,
};

use super::{Gpu, lock};
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
    /// Binding number by variable name, of all but `params`.
    pub(super) bindings: BTreeMap<String, u32>,
    /// That of `params`, if it is told any.
    pub(super) told: Option<u32>,
    /// No other has it.
    pub(super) id: usize,
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

/// What a variable of a kernel can be given.
fn entry(
    name: &str,
    module: &naga::Module,
    variable: &naga::GlobalVariable,
) -> Result<wgpu::BindGroupLayoutEntry> {
    let buffer = |ty| wgpu::BindingType::Buffer {
        ty,
        // Where its `params` begin is told beside the group.
        has_dynamic_offset: name == "params",
        min_binding_size: None,
    };
    let ty = match (variable.space, &module.types[variable.ty].inner) {
        (AddressSpace::Uniform, _) => buffer(wgpu::BufferBindingType::Uniform),
        (AddressSpace::Storage { access }, _) => {
            let read_only = !access.contains(StorageAccess::STORE);
            buffer(wgpu::BufferBindingType::Storage { read_only })
        }
        (AddressSpace::Handle, &TypeInner::Image { dim, arrayed: false, class }) => {
            let view_dimension = match dim {
                ImageDimension::D1 => wgpu::TextureViewDimension::D1,
                ImageDimension::D2 => wgpu::TextureViewDimension::D2,
                ImageDimension::D3 => wgpu::TextureViewDimension::D3,
                ImageDimension::Cube => wgpu::TextureViewDimension::Cube,
            };
            match class {
                ImageClass::Sampled { kind, multi } => wgpu::BindingType::Texture {
                    sample_type: match kind {
                        ScalarKind::Uint => wgpu::TextureSampleType::Uint,
                        ScalarKind::Sint => wgpu::TextureSampleType::Sint,
                        _ => wgpu::TextureSampleType::Float { filterable: false },
                    },
                    view_dimension,
                    multisampled: multi,
                },
                ImageClass::Storage { format: StorageFormat::Rgba32Float, .. } => {
                    wgpu::BindingType::StorageTexture {
                        access: wgpu::StorageTextureAccess::WriteOnly,
                        format: wgpu::TextureFormat::Rgba32Float,
                        view_dimension,
                    }
                }
                _ => return Err(Error::device(name, "no kernel is given such a texture")),
            }
        }
        _ => return Err(Error::device(name, "no kernel is given such a variable")),
    };
    let binding = variable.binding.map_or(0, |at| at.binding);
    Ok(wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty,
        count: None,
    })
}

impl Gpu {
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
        let mut bindings = BTreeMap::new();
        let mut entries = Vec::new();
        for (_, variable) in module.global_variables.iter() {
            if let (Some(name), Some(at)) = (&variable.name, variable.binding) {
                bindings.insert(name.clone(), at.binding);
                entries.push(entry(name, &module, variable)?);
            }
        }
        let told = bindings.remove("params");
        let layout = self.device().create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some(name),
            entries: &entries,
        });
        let own = self.device().create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(name),
            bind_group_layouts: &[Some(&layout)],
            immediate_size: 0,
        });
        let shader = self.device().create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some(name),
            source: wgpu::ShaderSource::Wgsl(source.into()),
        });
        // One that asks for no item would not know what it is told.
        let constants = [("parts", f64::from(self.ways().parts))];
        let asks = module.overrides.iter().any(|(_, o)| o.name.as_deref() == Some("parts"));
        let constants = if asks { &constants[..] } else { &[] };
        let pipeline = self.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(name),
            layout: Some(&own),
            module: &shader,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions {
                constants,
                ..Default::default()
            },
            cache: None,
        });
        self.check(name)?;
        static NEXT: AtomicUsize = AtomicUsize::new(0);
        let id = NEXT.fetch_add(1, Ordering::Relaxed);
        let kernel = Arc::new(Kernel { name, pipeline, layout, bindings, told, id });
        lock(&self.kernels).insert(key, kernel.clone());
        Ok(kernel)
    }
}
