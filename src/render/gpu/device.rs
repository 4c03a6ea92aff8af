//! Adapter, device, and the faults that a driver reports on its own.

use crate::render::{DeviceInfo, RenderError};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// Storage buffers that the tracer binds at once.
const STORAGE_BUFFERS: u32 = 5;

/// Storage textures likewise.
const STORAGE_TEXTURES: u32 = 4;

/// Longest wait for one dispatch, many times its intended length, before the device counts as lost.
const PATIENCE: Duration = Duration::from_secs(60);

/// The same of a software device, which waits for processors as any program does.
const SOFTWARE_PATIENCE: Duration = Duration::from_secs(600);

/// A device and its queue.
pub struct Gpu {
    /// For everything that is created.
    pub device: wgpu::Device,
    /// For everything that is done.
    pub queue: wgpu::Queue,
    /// Who they are.
    pub info: DeviceInfo,
    fault: Arc<Mutex<Option<RenderError>>>,
}

impl Gpu {
    /// Opens the adapter that promises most: discrete, integrated, virtual, software.
    ///
    /// # Errors
    /// [`RenderError::NoAdapter`] if none will do.
    pub fn new() -> Result<Self, RenderError> {
        let adapter = choose_adapter()?;
        let info = adapter.get_info();
        if info.name.starts_with("llvmpipe") && info.driver_info.starts_with("Mesa 22.") {
            tracing::warn!("lavapipe of {} leaks memory with every dispatch; install Mesa 25", info.driver_info);
        }
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("candela"),
            required_features: wgpu::Features::empty(),
            required_limits: adapter.limits(),
            ..Default::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|e| RenderError::NoAdapter(e.to_string()))?;
        let fault = Arc::new(Mutex::new(None));
        watch(&device, &fault);
        Ok(Self { device, queue, info: describe(&info), fault })
    }

    /// What the driver has complained of since the device was opened, if anything.
    ///
    /// # Errors
    /// The first complaint, once.
    pub fn fault(&self) -> Result<(), RenderError> {
        let fault = self.fault.lock().unwrap_or_else(std::sync::PoisonError::into_inner).take();
        fault.map_or(Ok(()), Err)
    }

    /// Waits until everything submitted is done.
    ///
    /// # Errors
    /// [`RenderError::DeviceLost`] if the device does not answer, or what the driver complained of.
    pub fn wait(&self) -> Result<(), RenderError> {
        let patience = if self.info.hardware { PATIENCE } else { SOFTWARE_PATIENCE };
        let poll = wgpu::PollType::Wait { submission_index: None, timeout: Some(patience) };
        let polled = self.device.poll(poll);
        self.fault()?;
        polled.map(|_| ()).map_err(|e| RenderError::DeviceLost(e.to_string()))
    }

    /// A buffer with the given contents; empty ones get a zeroed element, for a binding cannot be empty.
    ///
    /// # Errors
    /// [`RenderError::TooLarge`] beyond the device's binding size.
    pub fn storage(&self, label: &str, bytes: &[u8], element: usize) -> Result<wgpu::Buffer, RenderError> {
        let limit = self.device.limits().max_storage_buffer_binding_size.min(self.device.limits().max_buffer_size);
        if bytes.len() as u64 > limit {
            return Err(RenderError::TooLarge(format!(
                "{label} take {} MiB, one buffer of {} holds {} MiB; use fewer triangles",
                bytes.len() >> 20,
                self.info.name,
                limit >> 20
            )));
        }
        let zeros = vec![0; element];
        let contents = if bytes.is_empty() { &zeros } else { bytes };
        Ok(self.device.create_buffer_init(&BufferInitDescriptor {
            label: Some(label),
            contents,
            usage: wgpu::BufferUsages::STORAGE,
        }))
    }
}

/// Whether there is an adapter that is no software.
pub fn has_hardware_adapter() -> bool {
    choose_adapter().is_ok_and(|adapter| describe(&adapter.get_info()).hardware)
}

fn choose_adapter() -> Result<wgpu::Adapter, RenderError> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    let seen: Vec<String> = adapters.iter().map(|adapter| adapter.get_info().name).collect();
    adapters.into_iter().filter(can_trace).min_by_key(|adapter| rank(adapter.get_info().device_type)).ok_or_else(|| {
        RenderError::NoAdapter(if seen.is_empty() {
            "no Vulkan, Metal or DirectX 12 driver; on Debian or Ubuntu install mesa-vulkan-drivers".to_owned()
        } else {
            format!("none of {} runs the compute shaders", seen.join(", "))
        })
    })
}

fn can_trace(adapter: &wgpu::Adapter) -> bool {
    let limits = adapter.limits();
    limits.max_storage_buffers_per_shader_stage >= STORAGE_BUFFERS
        && limits.max_storage_textures_per_shader_stage >= STORAGE_TEXTURES
        && adapter.get_downlevel_capabilities().flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS)
}

fn rank(kind: wgpu::DeviceType) -> u32 {
    match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

fn describe(info: &wgpu::AdapterInfo) -> DeviceInfo {
    DeviceInfo {
        engine: "gpu",
        name: info.name.clone(),
        backend: info.backend.to_string(),
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        hardware: info.device_type != wgpu::DeviceType::Cpu,
    }
}

/// Keeps the first fault: without a handler wgpu would panic on it.
fn watch(device: &wgpu::Device, fault: &Arc<Mutex<Option<RenderError>>>) {
    let keep = |fault: &Mutex<Option<RenderError>>, error| {
        fault.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
    };
    let lost = Arc::clone(fault);
    device.set_device_lost_callback(move |reason, message| {
        keep(&lost, RenderError::DeviceLost(format!("{reason:?} {message}")));
    });
    let uncaptured = Arc::clone(fault);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        tracing::error!(%error, "the graphics driver reported an error");
        let error = match error {
            wgpu::Error::OutOfMemory { .. } => RenderError::TooLarge("the device is out of memory".to_owned()),
            other => RenderError::DeviceLost(other.to_string()),
        };
        keep(&uncaptured, error);
    }));
}
