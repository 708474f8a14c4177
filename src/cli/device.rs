//! The `--device` flag: where the network runs, chosen at run time.

use anyhow::bail;
use burn::tensor::Device;
use clap::Args;

use crate::kernels::keep_freed_memory;

#[derive(Debug, Args)]
pub struct DeviceArg {
    /// Where the network runs: cpu
    #[arg(long, default_value = "cpu")]
    device: String,
}

impl DeviceArg {
    /// Opens the device, and has the allocator keep what a network frees: each sample asks for it again.
    ///
    /// # Errors
    /// This build has no such device.
    pub fn open(&self) -> anyhow::Result<Device> {
        keep_freed_memory();
        match self.device.as_str() {
            "cpu" => Ok(Device::flex()),
            other => bail!("no device `{other}`; this build has: cpu"),
        }
    }
}
