//! The `--device` flag: where the network runs, chosen at run time.

use anyhow::bail;
use burn::tensor::Device;
use clap::Args;

#[derive(Debug, Args)]
pub struct DeviceArg {
    /// Where the network runs: cpu
    #[arg(long, default_value = "cpu")]
    device: String,
}

impl DeviceArg {
    /// # Errors
    /// This build has no such device.
    pub fn open(&self) -> anyhow::Result<Device> {
        match self.device.as_str() {
            "cpu" => Ok(Device::flex()),
            other => bail!("no device `{other}`; this build has: cpu"),
        }
    }
}
