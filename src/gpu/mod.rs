//! The device: which adapter, what it allows, its buffers, and its errors.
//!
//! Nothing here knows about light. A validation error, a lost device or a refused
//! allocation is caught by handlers and comes back from the next call as an
//! [`Error`] that names the stage; nothing panics.

pub mod clock;
pub mod counter;
pub mod groups;
pub mod kernel;
pub mod layout;
pub mod pace;
pub mod pool;
mod progress;
pub mod queue;
pub mod read;
pub mod resource;
pub mod run;
pub mod scan;
pub mod sort;
pub mod turns;
pub mod ways;
pub mod work;

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use wgpu::util::DeviceExt;

use crate::error::{Error, Result};
use clock::Clock;
use groups::Keeper;
use kernel::{Kernel, Library};
use pool::Idle;
pub use progress::Progress;
use queue::{Command, DISPATCHES, Player, UNIFORM};
use turns::{ARGUMENT, ARGUMENTS};
use ways::Ways;

/// Threads of a work group, in every kernel that works item by item.
pub const GROUP: u32 = 64;

/// How an adapter is chosen.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// A discrete adapter, else an integrated, else a virtual, else the software one.
    #[default]
    Best,
    /// The adapter at this place of [`adapters`].
    Index(usize),
    /// The first adapter whose name contains this, whatever the case.
    Name(String),
}

impl std::fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Best => f.write_str("any"),
            Self::Index(index) => write!(f, "index {index}"),
            Self::Name(name) => write!(f, "`{name}`"),
        }
    }
}

impl std::str::FromStr for AdapterChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> std::result::Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Name(text.to_lowercase()), Self::Index))
    }
}

/// One adapter of this machine, with the limits that matter here.
#[derive(Clone, Debug, serde::Serialize)]
pub struct AdapterReport {
    /// Place in the list, as `--adapter INDEX` takes it.
    pub index: usize,
    /// Name as the driver gives it.
    pub name: String,
    /// Vulkan, Metal or Dx12.
    pub backend: String,
    /// Discrete, integrated, virtual or software.
    pub kind: &'static str,
    /// Driver and its version.
    pub driver: String,
    /// Largest buffer, bytes.
    pub max_buffer_size: u64,
    /// Largest part of a buffer that a kernel can see, bytes.
    pub max_binding_size: u64,
    /// Largest edge of a volume, voxels.
    pub max_texture_3d: u32,
    /// Whether the device can time its own work.
    pub timestamps: bool,
}

/// A kernel's name and the flags that are set, sorted.
type KernelKey = (&'static str, Vec<&'static str>);

/// A device with its queue, kernels and times.
pub struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
    report: AdapterReport,
    limits: wgpu::Limits,
    /// Nanoseconds per tick, where the device has timestamps.
    tick: Option<f32>,
    faults: Arc<Mutex<Vec<String>>>,
    library: &'static Library,
    kernels: Mutex<HashMap<KernelKey, Arc<Kernel>>>,
    ways: Ways,
    clock: Mutex<Clock>,
    /// What is recorded and not played.
    queued: Mutex<VecDeque<Command>>,
    player: Mutex<Player>,
    keeper: Keeper,
    idle: Arc<Mutex<Idle>>,
    /// What dispatches are told.
    uniforms: wgpu::Buffer,
    /// Arguments of indirect dispatches, and how many of them were ever given.
    arguments: wgpu::Buffer,
    given: AtomicU32,
    /// Short buffers that are read through.
    staging: Mutex<Vec<wgpu::Buffer>>,
    slice_budget: Mutex<Duration>,
    phase: AtomicUsize,
    is_stepped: AtomicBool,
    is_timed: AtomicBool,
}

/// Work that another thread left half-done is still data: a poisoned lock is entered.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN | wgpu::Backends::METAL | wgpu::Backends::DX12,
        // Arguments of indirect dispatches are found within their limits.
        flags: wgpu::InstanceFlags::default() - wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

/// The [`AdapterReport::kind`] of an adapter that runs on the host's cores.
const SOFTWARE: &str = "software";

fn kind(info: &wgpu::AdapterInfo) -> (&'static str, u32) {
    match info.device_type {
        wgpu::DeviceType::DiscreteGpu => ("discrete", 0),
        wgpu::DeviceType::IntegratedGpu => ("integrated", 1),
        wgpu::DeviceType::VirtualGpu => ("virtual", 2),
        wgpu::DeviceType::Cpu => (SOFTWARE, 3),
        wgpu::DeviceType::Other => ("other", 4),
    }
}

fn describe(index: usize, adapter: &wgpu::Adapter) -> AdapterReport {
    let (info, limits) = (adapter.get_info(), adapter.limits());
    AdapterReport {
        index,
        kind: kind(&info).0,
        backend: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        name: info.name,
        max_buffer_size: limits.max_buffer_size,
        max_binding_size: limits.max_storage_buffer_binding_size,
        max_texture_3d: limits.max_texture_dimension_3d,
        timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
    }
}

async fn found() -> Result<Vec<wgpu::Adapter>> {
    let found = instance().enumerate_adapters(wgpu::Backends::all()).await;
    match found.is_empty() {
        false => Ok(found),
        true => Err(Error::Adapter {
            what: "no Vulkan, Metal or DirectX 12 adapter was found; run ./setup.sh to install a \
                   Vulkan loader and Mesa's software driver (Debian: libvulkan1, \
                   mesa-vulkan-drivers)"
                .into(),
        }),
    }
}

/// Every adapter of this machine, in the driver's order.
///
/// # Errors
/// There is none.
pub async fn adapters() -> Result<Vec<AdapterReport>> {
    Ok(found().await?.iter().enumerate().map(|(index, adapter)| describe(index, adapter)).collect())
}

impl Gpu {
    /// Opens the chosen adapter, to run the kernels of a library.
    ///
    /// # Errors
    /// No adapter, none of that name or index, or one below WebGPU's default limits.
    pub async fn open(choice: &AdapterChoice, library: &'static Library) -> Result<Self> {
        let adapters = found().await?;
        let index = match choice {
            AdapterChoice::Best => {
                (0..adapters.len()).min_by_key(|&i| kind(&adapters[i].get_info()).1)
            }
            AdapterChoice::Index(i) => Some(*i).filter(|&i| i < adapters.len()),
            AdapterChoice::Name(name) => adapters
                .iter()
                .position(|a| a.get_info().name.to_lowercase().contains(&name.to_lowercase())),
        };
        let Some(index) = index else {
            let names: Vec<_> = adapters
                .iter()
                .enumerate()
                .map(|(i, a)| format!("{i}: {}", a.get_info().name))
                .collect();
            return Err(Error::Adapter {
                what: format!("no adapter matches {choice}; this machine has {}", names.join(", ")),
            });
        };
        let adapter = &adapters[index];
        let report = describe(index, adapter);
        let wanted =
            wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES;
        // WebGPU's own limits, sizes alone raised: a kernel that needs more would not run elsewhere.
        let limits = wgpu::Limits {
            max_buffer_size: report.max_buffer_size,
            max_storage_buffer_binding_size: report.max_binding_size,
            ..wgpu::Limits::default()
        };
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("photogram"),
            required_features: adapter.features() & wanted,
            required_limits: limits,
            ..Default::default()
        });
        let (device, queue) = request.await.map_err(|e| Error::Adapter {
            what: format!("adapter {index} ({}) refuses WebGPU's default limits: {e}", report.name),
        })?;
        Ok(Self::from_device(device, queue, report, library))
    }

    /// Works on a device that somebody else opened (a viewer, say).
    pub fn from_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        report: AdapterReport,
        library: &'static Library,
    ) -> Self {
        let faults = Arc::new(Mutex::new(Vec::new()));
        let (heard, lost) = (faults.clone(), faults.clone());
        device.on_uncaptured_error(Arc::new(move |e| lock(&heard).push(e.to_string())));
        device.set_device_lost_callback(move |reason, message| {
            if reason != wgpu::DeviceLostReason::Destroyed {
                lock(&lost).push(format!("the device was lost ({reason:?}): {message}"));
            }
        });
        let timed = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let buffer = |label, size, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let uniforms = buffer(
            "uniforms",
            (DISPATCHES * UNIFORM) as u64,
            wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        );
        let arguments = buffer(
            "arguments",
            u64::from(ARGUMENTS) * ARGUMENT,
            wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::STORAGE,
        );
        Self {
            limits: device.limits(),
            tick: timed.then(|| queue.get_timestamp_period()),
            ways: Ways::of(&report),
            queued: Mutex::default(),
            player: Mutex::new(Player::new(uniforms.clone())),
            keeper: Keeper::default(),
            idle: Arc::default(),
            uniforms,
            arguments,
            given: AtomicU32::new(0),
            phase: AtomicUsize::new(0),
            is_stepped: AtomicBool::new(false),
            is_timed: AtomicBool::new(true),
            device,
            queue,
            report,
            faults,
            library,
            kernels: Mutex::default(),
            clock: Mutex::default(),
            staging: Mutex::default(),
            slice_budget: Mutex::new(Duration::from_millis(100)),
        }
    }

    /// The adapter in use.
    pub fn report(&self) -> &AdapterReport {
        &self.report
    }

    /// How work is shaped for it.
    pub fn ways(&self) -> Ways {
        self.ways
    }

    /// Whether [`clock::Timings`] come from the device's own clock.
    pub fn has_timestamps(&self) -> bool {
        self.tick.is_some()
    }

    /// Wall-clock time that one slice of a heavy stage may take; 100 ms to begin with.
    pub fn set_slice_budget(&self, budget: Duration) {
        *lock(&self.slice_budget) = budget;
    }

    pub(crate) fn slice_budget(&self) -> Duration {
        *lock(&self.slice_budget)
    }

    /// Has what is recorded wait until it is played ([`Gpu::play`]), or be played as it comes, which
    /// is so to begin with.
    pub fn set_stepped(&self, is_stepped: bool) {
        self.is_stepped.store(is_stepped, Ordering::Relaxed);
    }

    pub(super) fn is_stepped(&self) -> bool {
        self.is_stepped.load(Ordering::Relaxed)
    }

    /// Has the device time what is dispatched from now on, or not, if it can: it does to begin with.
    /// Untimed slices are as long as they were when the last was timed.
    pub fn set_timed(&self, is_timed: bool) {
        self.is_timed.store(is_timed, Ordering::Relaxed);
    }

    pub(super) fn is_timed(&self) -> bool {
        self.tick.is_some() && self.is_timed.load(Ordering::Relaxed)
    }

    /// Has the times of what is recorded from now on summed as this phase, below
    /// [`clock::PHASES`].
    pub fn enter(&self, phase: usize) {
        self.phase.store(phase, Ordering::Relaxed);
    }

    pub(super) fn phase(&self) -> usize {
        self.phase.load(Ordering::Relaxed)
    }

    pub(super) fn arguments(&self) -> &wgpu::Buffer {
        &self.arguments
    }

    /// Room for so many arguments; returns the first.
    pub(super) fn reserve_arguments(&self, count: u32) -> u32 {
        self.given.fetch_add(count, Ordering::Relaxed)
    }

    /// Bytes of one buffer that a kernel can see, and no more than 32 bits can count.
    pub fn max_binding(&self) -> u64 {
        let most = self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size);
        most.min(u64::from(u32::MAX) & !255)
    }

    /// Largest edge of a volume or of a light-field grid.
    pub fn max_edge(&self) -> u32 {
        self.limits.max_texture_dimension_3d
    }

    /// Overwrites a texture, after all that was recorded before.
    ///
    /// # Errors
    /// The device failed.
    pub fn write_texture<T: bytemuck::Pod>(
        &self,
        texture: &wgpu::Texture,
        texels: &[T],
    ) -> Result<()> {
        self.submit()?;
        let size = texture.size();
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(size.width * size_of::<T>() as u32),
            rows_per_image: Some(size.height),
        };
        let bytes = bytemuck::cast_slice(texels);
        self.queue.write_texture(texture.as_image_copy(), bytes, layout, size);
        self.check("write")
    }

    /// The first fault that the device reported since the last look, if any.
    pub(crate) fn check(&self, stage: &str) -> Result<()> {
        let mut faults = lock(&self.faults);
        match faults.drain(..).next() {
            None => Ok(()),
            Some(fault) => Err(Error::device(stage, fault)),
        }
    }

    /// A zeroed storage buffer of `count` items of type `T`.
    ///
    /// # Errors
    /// It exceeds what the adapter binds, or the allocation is refused.
    pub fn buffer<T: bytemuck::Pod>(&self, stage: &str, count: usize) -> Result<wgpu::Buffer> {
        let size = (count.max(1) * size_of::<T>()).next_multiple_of(4) as u64;
        self.fits(stage, size)?;
        self.has_room(stage, size)?;
        lock(&self.clock).effort.buffers += 1;
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(stage),
            size,
            usage: STORAGE,
            mapped_at_creation: false,
        });
        self.check(stage).map(|()| buffer)
    }

    /// A storage buffer holding `data`.
    ///
    /// # Errors
    /// As [`Gpu::buffer`].
    pub fn upload<T: bytemuck::Pod>(&self, stage: &str, data: &[T]) -> Result<wgpu::Buffer> {
        self.fits(stage, size_of_val(data) as u64)?;
        lock(&self.clock).effort.buffers += 1;
        let buffer = self.device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: Some(stage),
            contents: bytemuck::cast_slice(data),
            usage: STORAGE | wgpu::BufferUsages::UNIFORM,
        });
        self.check(stage).map(|()| buffer)
    }

    /// Overwrites the beginning of `buffer`, after all that was recorded before.
    ///
    /// # Errors
    /// The device failed.
    pub fn write<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, data: &[T]) -> Result<()> {
        self.submit()?;
        self.queue.write_buffer(buffer, 0, bytemuck::cast_slice(data));
        self.check("write")
    }

    /// Refuses a buffer that no kernel could see.
    pub(crate) fn fits(&self, stage: &str, bytes: u64) -> Result<()> {
        let most = self.max_binding();
        if bytes <= most {
            return Ok(());
        }
        Err(Error::capacity(
            stage,
            format!(
                "a buffer of {:.1} MiB is needed, but {} binds at most {:.1} MiB; lower the setting \
                 it depends on, or use another adapter",
                bytes as f64 / MIB,
                self.report.name,
                most as f64 / MIB
            ),
        ))
    }

    /// Bytes that may still be taken, where that is known: of an adapter whose memory is the host's,
    /// what the host has available but for a tenth, which others will want. What was promised and is
    /// not used yet is not among it.
    pub fn free_bytes(&self) -> Option<u64> {
        if ![SOFTWARE, "integrated"].contains(&self.report.kind) {
            return None;
        }
        let (free, host) = (host_memory("MemAvailable:")?, host_memory("MemTotal:")?);
        let held = self.device.generate_allocator_report().map_or(0, |r| r.total_allocated_bytes);
        Some((free / 10 * 9).min((host / 10 * 9).saturating_sub(held)))
    }

    /// Refuses what a software adapter would promise, and die of when it is used. Other adapters
    /// refuse for themselves.
    pub(crate) fn has_room(&self, stage: &str, bytes: u64) -> Result<()> {
        if self.report.kind != SOFTWARE || bytes <= 1 << 24 {
            return Ok(());
        }
        match self.free_bytes() {
            Some(free) if bytes > free => Err(Error::capacity(
                stage,
                format!(
                    "{:.0} MiB of memory are needed, and this machine has {:.0} free; lower the \
                     setting it depends on",
                    bytes as f64 / MIB,
                    free as f64 / MIB
                ),
            )),
            _ => Ok(()),
        }
    }

    pub(crate) fn device(&self) -> &wgpu::Device {
        &self.device
    }

    pub(crate) fn queue(&self) -> &wgpu::Queue {
        &self.queue
    }
}

/// Bytes of the host's memory, where the system says: a line of what it says.
fn host_memory(line: &str) -> Option<u64> {
    let info = std::fs::read_to_string("/proc/meminfo").ok()?;
    let line = info.lines().find_map(|each| each.strip_prefix(line))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? << 10)
}

const MIB: f64 = 1024.0 * 1024.0;

const STORAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::COPY_SRC)
    .union(wgpu::BufferUsages::COPY_DST);
