//! The `--device` flag: where the network runs, chosen at run time.

use burn::tensor::Device;
use clap::Args;

use crate::device::{DeviceError, DeviceName};

#[derive(Debug, Args)]
pub struct DeviceArg {
    /// Where the network runs: cpu, or cuda:N or vulkan:N in a build with that backend
    #[arg(long, default_value = "cpu")]
    device: DeviceName,
}

impl DeviceArg {
    /// # Errors
    /// This build has no such device, or the machine.
    pub fn open(&self) -> Result<Device, DeviceError> {
        self.device.open()
    }
}
