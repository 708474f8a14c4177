//! The `--device` flag: where the network runs, chosen at run time.

use burn::tensor::Device;
use clap::Args;

use crate::device::{DeviceError, DeviceName};
use crate::kernels::keep_freed_memory;

#[derive(Debug, Args)]
pub struct DeviceArg {
    /// Device that runs the network: cpu, or cuda:N or vulkan:N in a build with that backend
    #[arg(long, default_value = "cpu")]
    device: DeviceName,
}

/// Devices of a training.
#[derive(Debug, Args)]
pub struct DevicesArg {
    /// Device that runs the network: cpu, or cuda:N or vulkan:N in a build with that backend; several with commas between
    /// share the batches of each step
    #[arg(long = "device", value_name = "DEVICES", default_value = "cpu", value_delimiter = ',')]
    devices: Vec<DeviceName>,
}

impl DevicesArg {
    /// Opens the devices, at least one, as [`DeviceArg::open`] does.
    ///
    /// # Errors
    /// This build has no such device, or the machine.
    pub fn open(&self) -> Result<Vec<Device>, DeviceError> {
        keep_freed_memory();
        self.devices.iter().map(|device| device.open()).collect()
    }
}

/// The same, for processes that open the device themselves.
#[derive(Debug, Args)]
pub struct DeviceNameArg {
    /// Device that runs the network: cpu, or cuda:N or vulkan:N in a build with that backend
    #[arg(long = "device", value_name = "DEVICE", default_value = "cpu")]
    name: DeviceName,
}

impl DeviceNameArg {
    pub fn name(&self) -> DeviceName {
        self.name
    }
}

impl DeviceArg {
    pub fn name(&self) -> DeviceName {
        self.device
    }

    /// Opens the device, and has the allocator keep what a network frees: each sample asks for it again.
    ///
    /// # Errors
    /// This build has no such device, or the machine.
    pub fn open(&self) -> Result<Device, DeviceError> {
        keep_freed_memory();
        self.device.open()
    }
}
