//! Every kernel, found by listing the folder, composes and validates in every
//! permutation; and every struct shared with the host has the host's layout.

use std::collections::BTreeSet;

use photogram::gpu::kernel::parse;
use photogram::gpu::layout::Layout;
use photogram::gpu::{scan, sort};
use photogram::kernels::LIBRARY;
use photogram::segment::composite;
use photogram::{device_scene, field, photon, reference, segment};
use wgpu::naga::back::pipeline_constants::process_overrides;
use wgpu::naga::back::spv;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};
use wgpu::naga::{AddressSpace, Module, StorageAccess, TypeInner};

const LAYOUTS: &[Layout] = &[
    device_scene::SceneParams::LAYOUT,
    device_scene::Shading::LAYOUT,
    device_scene::Optics::LAYOUT,
    device_scene::CellLayers::LAYOUT,
    device_scene::CellRange::LAYOUT,
    device_scene::lights::Light::LAYOUT,
    device_scene::lights::Lights::LAYOUT,
    photon::PhotonParams::LAYOUT,
    photon::SlotMarks::LAYOUT,
    photon::QuotaRecord::LAYOUT,
    photon::Quotas::LAYOUT,
    photon::ForgetParams::LAYOUT,
    field::fluence::ResolveParams::LAYOUT,
    field::fluence::DepositParams::LAYOUT,
    field::fluence::ChoiceParams::LAYOUT,
    field::fluence::FluenceParams::LAYOUT,
    field::points::PointsParams::LAYOUT,
    field::points::Origin::LAYOUT,
    segment::SegmentParams::LAYOUT,
    composite::CompositeParams::LAYOUT,
    reference::ReferenceParams::LAYOUT,
    photogram::irradiance::CacheParams::LAYOUT,
    photogram::irradiance::Film::LAYOUT,
    photogram::irradiance::Event::LAYOUT,
    photogram::field::dirty::DirtyGrid::LAYOUT,
    photogram::gpu::turns::TurnParams::LAYOUT,
    photogram::gpu::work::ListParams::LAYOUT,
    photogram::gpu::work::FillParams::LAYOUT,
    scan::ScanParams::LAYOUT,
    sort::CountParams::LAYOUT,
    sort::DigitParams::LAYOUT,
    photogram::photon::probe::ProbeParams::LAYOUT,
];

/// All subsets of a kernel's flags.
fn permutations(flags: &'static [&'static str]) -> impl Iterator<Item = Vec<&'static str>> {
    (0..1_u32 << flags.len()).map(move |bits| {
        flags.iter().enumerate().filter(|(i, _)| bits >> i & 1 == 1).map(|(_, f)| *f).collect()
    })
}

fn each_module(mut look: impl FnMut(&str, &[&str], &Module)) {
    for (name, flags) in LIBRARY.kernels {
        for on in permutations(flags) {
            let source =
                LIBRARY.compose(name, &on).unwrap_or_else(|e| panic!("{name} {on:?}: {e}"));
            let module = parse(name, &source).unwrap_or_else(|e| panic!("{name} {on:?}: {e}"));
            look(name, &on, &module);
        }
    }
}

#[test]
fn every_kernel_file_is_declared() {
    let files: BTreeSet<_> = LIBRARY.files().into_iter().collect();
    let declared: BTreeSet<_> = LIBRARY.kernels.iter().map(|(name, _)| name.to_string()).collect();
    assert_eq!(files, declared);
}

/// A flag that changes a kernel must be among those that the kernel declares.
#[test]
fn undeclared_flags_make_no_difference() {
    let all: BTreeSet<_> = LIBRARY.kernels.iter().flat_map(|(_, flags)| *flags).copied().collect();
    for (name, flags) in LIBRARY.kernels {
        let plain = LIBRARY.compose(name, &[]).expect("composes");
        for flag in all.iter().filter(|flag| !flags.contains(flag)) {
            let with = LIBRARY.compose(name, &[flag]).expect("composes");
            assert_eq!(with, plain, "{name} depends on the undeclared flag {flag}");
        }
    }
}

#[test]
fn every_permutation_validates_within_the_limits_of_webgpu() {
    each_module(|name, on, module| {
        let info = Validator::new(ValidationFlags::all(), Capabilities::empty())
            .validate(module)
            .unwrap_or_else(|e| panic!("{name} {on:?}: {e:?}"));
        // What the Vulkan back end makes of it: it knows faults of its own.
        let (given, info) = process_overrides(module, &info, None, &Default::default())
            .unwrap_or_else(|e| panic!("{name} {on:?}: {e}"));
        spv::write_vec(&given, &info, &spv::Options::default(), None)
            .unwrap_or_else(|e| panic!("{name} {on:?}: {e}"));
        let storage = module.global_variables.iter().filter(|(_, v)| {
            matches!(v.space, AddressSpace::Storage { access } if access.contains(StorageAccess::LOAD))
        });
        // One is to spare: WebGPU allows 8.
        assert!(storage.count() <= 7, "{name} {on:?} binds more than 7 storage buffers");
    });
}

#[test]
fn shared_structs_have_the_hosts_layout() {
    let mut seen = BTreeSet::new();
    each_module(|name, _, module| {
        for (_, ty) in module.types.iter() {
            let (TypeInner::Struct { members, span }, Some(type_name)) = (&ty.inner, &ty.name)
            else {
                continue;
            };
            let Some(layout) = LAYOUTS.iter().find(|l| l.name == *type_name) else { continue };
            seen.insert(type_name.clone());
            check(name, layout, members, *span, module);
        }
    });
    let all: BTreeSet<_> = LAYOUTS.iter().map(|l| l.name.to_owned()).collect();
    assert_eq!(seen, all, "every shared struct occurs in a kernel");
}

fn check(
    kernel: &str,
    layout: &Layout,
    members: &[wgpu::naga::StructMember],
    span: u32,
    module: &Module,
) {
    let found: Vec<_> = members
        .iter()
        .map(|m| {
            let size = module.types[m.ty].inner.size(module.to_ctx());
            (m.name.as_deref().unwrap_or(""), m.offset as usize, size as usize)
        })
        .collect();
    assert_eq!(found, layout.members, "{kernel}: {}", layout.name);
    assert_eq!(span as usize, layout.size, "{kernel}: size of {}", layout.name);
}

/// A uniform or storage struct that the host fills must be among those checked.
#[test]
fn no_bound_struct_is_unchecked() {
    each_module(|name, _, module| {
        for (_, v) in module.global_variables.iter().filter(|(_, v)| v.binding.is_some()) {
            let inner = match &module.types[v.ty].inner {
                TypeInner::Array { base, .. } => &module.types[*base],
                _ => &module.types[v.ty],
            };
            if let (TypeInner::Struct { .. }, Some(struct_name)) = (&inner.inner, &inner.name) {
                assert!(LAYOUTS.iter().any(|l| l.name == *struct_name), "{name}: {struct_name}");
            }
        }
    });
}

#[test]
#[should_panic(expected = "CompositeParams")]
fn a_wrong_layout_is_found() {
    let mut wrong = composite::CompositeParams::LAYOUT;
    wrong.members = &[("background", 4, 12)];
    let source = LIBRARY.compose("composite", &[]).expect("composes");
    let module = parse("composite", &source).expect("parses");
    for (_, ty) in module.types.iter() {
        if let (TypeInner::Struct { members, span }, Some("CompositeParams")) =
            (&ty.inner, ty.name.as_deref())
        {
            check("composite", &wrong, members, *span, &module);
        }
    }
}
