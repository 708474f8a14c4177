//! Where the network runs: the CPU, or a GPU that one of this build's backends lists.
//!
//! `cpu` is burn's flex backend with the kernels of this crate; `cuda:0` and `vulkan:0` are the first devices that
//! CUDA and Vulkan list, in builds with the cargo feature of that name. burn's default device is never taken: it is
//! whatever the build prefers, there or not.

use std::fmt::{self, Display};
use std::str::FromStr;

#[cfg(feature = "vulkan")]
use burn::backend::{CubeDevice, WgpuBackend, WgpuDevice, WgpuDeviceKind};
use burn::tensor::Device;
#[cfg(feature = "cuda")]
use burn::tensor::DeviceType;
use thiserror::Error;

/// An interface that lists GPUs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GpuBackend {
    Cuda,
    Vulkan,
}

impl GpuBackend {
    pub const ALL: [Self; 2] = [Self::Cuda, Self::Vulkan];

    /// Its name in device names, which is also the cargo feature's.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Cuda => "cuda",
            Self::Vulkan => "vulkan",
        }
    }

    /// What a machine needs for it.
    fn needs(self) -> &'static str {
        match self {
            Self::Cuda => "NVIDIA's driver, and CUDA's headers in $CUDA_PATH or /usr/local/cuda",
            Self::Vulkan => {
                "a Vulkan driver (on Debian and Ubuntu: apt install libvulkan1 mesa-vulkan-drivers)"
            }
        }
    }

    /// The devices it lists, `None` where this build is without it.
    fn devices(self) -> Option<Vec<Device>> {
        match self {
            #[cfg(feature = "cuda")]
            Self::Cuda => Some(Device::enumerate(DeviceType::Cuda).into_vec()),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => Some(vulkan_devices()),
            #[allow(unreachable_patterns, reason = "with all features no backend is left")]
            _ => None,
        }
    }
}

/// What wgpu lists under Vulkan: discrete GPUs, then integrated and virtual ones, then CPUs.
///
/// burn has a feature and a list of its own for Vulkan, left off here: it brings a compiler to SPIR-V (cubecl-spirv
/// 0.11.3) whose matrix products break the rules for shared memory, so that drivers crash on them. Without that
/// feature the kernels go through WGSL, which wgpu checks.
#[cfg(feature = "vulkan")]
fn vulkan_devices() -> Vec<Device> {
    let kinds = [
        WgpuDeviceKind::DiscreteGpu(0),
        WgpuDeviceKind::IntegratedGpu(0),
        WgpuDeviceKind::VirtualGpu(0),
        WgpuDeviceKind::Cpu,
        WgpuDeviceKind::Other(0),
    ];
    let of_kind = |kind| {
        // Of a seed's kind and graphics API, whatever its index.
        let seed = CubeDevice::Wgpu(WgpuDevice::new(kind).on(WgpuBackend::Vulkan));
        CubeDevice::enumerate(seed.to_id()).into_iter().map(|id| Device::new(CubeDevice::from_id(id)))
    };
    let mut devices: Vec<Device> = Vec::new();
    for device in kinds.into_iter().flat_map(of_kind) {
        if !devices.contains(&device) {
            devices.push(device);
        }
    }
    devices
}

/// A device by name: `cpu`, `cuda:0`, `vulkan:1`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DeviceName {
    Cpu,
    /// The backend's device of this index, from 0.
    Gpu(GpuBackend, usize),
}

impl Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Gpu(backend, index) => write!(f, "{}:{index}", backend.name()),
        }
    }
}

/// Why there is no such device.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum DeviceError {
    #[error("no device is called `{found}`; valid are cpu, and cuda:N and vulkan:N with N from 0")]
    Name { found: String },
    #[error("no device {name}: this build has {has}; one built with --features {feature} has it")]
    NotBuilt { name: DeviceName, has: String, feature: &'static str },
    #[error(
        "no device {name}: {feature} lists no device here; it needs {needs}; --device cpu runs everywhere"
    )]
    NoneListed { name: DeviceName, feature: &'static str, needs: &'static str },
    #[error("no device {name}: the last one that {feature} lists here is {feature}:{last}")]
    NotListed { name: DeviceName, feature: &'static str, last: usize },
}

impl FromStr for DeviceName {
    type Err = DeviceError;

    fn from_str(text: &str) -> Result<Self, DeviceError> {
        let gpu = || {
            let (name, index) = text.split_once(':')?;
            let backend = GpuBackend::ALL.into_iter().find(|backend| backend.name() == name)?;
            // `parse` alone takes a plus sign too.
            let is_index = index.bytes().all(|byte| byte.is_ascii_digit());
            Some(Self::Gpu(backend, index.parse().ok().filter(|_| is_index)?))
        };
        let found = if text == "cpu" { Some(Self::Cpu) } else { gpu() };
        found.ok_or_else(|| DeviceError::Name { found: text.to_owned() })
    }
}

impl DeviceName {
    /// The device, without autodiff.
    ///
    /// # Errors
    /// This build is without the backend, or the machine without the device.
    pub fn open(self) -> Result<Device, DeviceError> {
        match self {
            Self::Cpu => Ok(Device::flex()),
            Self::Gpu(backend, index) => listed(backend, index, backend.devices()),
        }
    }
}

/// The device of an index among those that a backend lists.
fn listed<T>(backend: GpuBackend, index: usize, devices: Option<Vec<T>>) -> Result<T, DeviceError> {
    let (name, feature) = (DeviceName::Gpu(backend, index), backend.name());
    let Some(devices) = devices else {
        return Err(DeviceError::NotBuilt { name, has: built().join(", "), feature });
    };
    let Some(last) = devices.len().checked_sub(1) else {
        return Err(DeviceError::NoneListed { name, feature, needs: backend.needs() });
    };
    devices.into_iter().nth(index).ok_or(DeviceError::NotListed { name, feature, last })
}

/// What this build can run on: `cpu`, and the names of its GPU backends.
#[must_use]
pub fn built() -> Vec<&'static str> {
    let of_gpu = [("cuda", cfg!(feature = "cuda")), ("vulkan", cfg!(feature = "vulkan"))];
    std::iter::once("cpu").chain(of_gpu.into_iter().filter(|of| of.1).map(|of| of.0)).collect()
}

/// The devices that this build can open on this machine, and what each GPU calls itself. Opens them.
#[must_use]
pub fn present() -> Vec<(DeviceName, Option<String>)> {
    let of_backend = |backend: GpuBackend| {
        let devices = backend.devices().unwrap_or_default().into_iter().enumerate();
        devices.map(move |(index, device)| (DeviceName::Gpu(backend, index), own_name(&device)))
    };
    std::iter::once((DeviceName::Cpu, None)).chain(GpuBackend::ALL.into_iter().flat_map(of_backend)).collect()
}

#[cfg(any(feature = "cuda", feature = "vulkan"))]
fn own_name(device: &Device) -> Option<String> {
    device.identity().map(|identity| identity.name)
}

#[cfg(not(any(feature = "cuda", feature = "vulkan")))]
fn own_name(_: &Device) -> Option<String> {
    None
}

/// Whether tensors lie in the program's own memory, so that reading one costs nothing and several threads may
/// compute side by side. A GPU has one queue and memory pool a thread, and waits for all of its work wherever a
/// tensor is read.
#[must_use]
pub fn is_cpu(device: &Device) -> bool {
    // `==` on devices compares the hardware and leaves autodiff aside.
    *device == Device::flex()
}

/// What computes: `cpu`, or what a GPU calls itself.
#[must_use]
pub fn what_computes(device: &Device) -> String {
    if is_cpu(device) { "cpu".to_owned() } else { own_name(device).unwrap_or_else(|| "gpu".to_owned()) }
}

/// The device that golden tests run on: that of the environment variable `HARMZONE_TEST_DEVICE`, or the CPU.
#[cfg(test)]
pub fn test_device() -> Device {
    let name = std::env::var("HARMZONE_TEST_DEVICE").unwrap_or_else(|_| "cpu".into());
    let device = name.parse::<DeviceName>().and_then(DeviceName::open);
    device.unwrap_or_else(|error| panic!("HARMZONE_TEST_DEVICE: {error}"))
}

/// How many times wider than the CPU's the bounds of golden tests are on [`test_device`]: burn multiplies matrices on CUDA's tensor
/// cores in TF32, whose numbers have 11 bits where f32 has 24.
#[cfg(test)]
pub fn test_slack() -> f64 {
    let is_cuda = std::env::var("HARMZONE_TEST_DEVICE").is_ok_and(|name| name.starts_with("cuda"));
    if is_cuda { 100.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for name in ["cpu", "cuda:0", "vulkan:12"] {
            assert_eq!(name.parse::<DeviceName>().unwrap().to_string(), name);
        }
        for wrong in
            ["", "gpu", "CPU", "cpu:0", "cuda", "cuda:", "cuda:-1", "cuda:+1", "vulkan:0:0", "metal:0"]
        {
            let error = wrong.parse::<DeviceName>().unwrap_err();
            assert_eq!(error, DeviceError::Name { found: wrong.into() });
        }
    }

    #[test]
    fn an_index_counts_what_the_backend_lists() {
        let of = |index, devices: &[char]| listed(GpuBackend::Vulkan, index, Some(devices.to_vec()));
        assert_eq!(of(1, &['a', 'b']), Ok('b'));
        let message = of(2, &['a', 'b']).unwrap_err().to_string();
        assert_eq!(message, "no device vulkan:2: the last one that vulkan lists here is vulkan:1");
        let message = of(0, &[]).unwrap_err().to_string();
        assert!(
            message.starts_with("no device vulkan:0: vulkan lists no device here; it needs"),
            "{message}"
        );
    }

    #[test]
    fn a_backend_that_is_not_built_names_the_feature_that_builds_it() {
        let message = listed::<char>(GpuBackend::Cuda, 0, None).unwrap_err().to_string();
        let has = built().join(", ");
        let told = format!("no device cuda:0: this build has {has}; one built with --features cuda has it");
        assert_eq!(message, told);
        for backend in GpuBackend::ALL {
            assert_eq!(built().contains(&backend.name()), backend.devices().is_some());
        }
    }

    #[test]
    fn the_cpu_is_there_with_and_without_autodiff() {
        let cpu = DeviceName::Cpu.open().unwrap();
        assert!(is_cpu(&cpu) && is_cpu(&cpu.autodiff()));
        assert_eq!(present()[0], (DeviceName::Cpu, None));
    }
}
