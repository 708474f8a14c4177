//! The bare calls to MuJoCo of some time, issued again with nothing around them: what no code of ours can save.

use std::collections::HashMap;
use std::time::Duration;

use pyo3::prelude::*;

use super::simulator::failed;
use super::{SimError, Simulator};

/// Time in MuJoCo's own functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BareCalls {
    /// `mj_step`.
    pub steps: Duration,
    /// `mjv_updateScene`, `mjr_render`, `mjr_readPixels`.
    pub pictures: Duration,
    /// `mj_multiRay`.
    pub rays: Duration,
}

impl BareCalls {
    #[must_use]
    pub fn total(&self) -> Duration {
        self.steps + self.pictures + self.rays
    }
}

impl Simulator {
    /// Notes all calls to MuJoCo from now on, of this simulator alone in its process; draws once, so that
    /// the camera is warm.
    ///
    /// # Errors
    /// As [`Simulator::render_rgb`].
    pub fn note_calls(&mut self) -> Result<(), SimError> {
        Python::attach(|py| {
            let camera = self.camera(py)?;
            let make = || py.import("harmzone_sim")?.getattr("CallLog")?.call1((self.world.bind(py), camera));
            self.call_log = Some(make().map_err(failed("note its calls"))?.unbind());
            Ok(())
        })
    }

    /// Notes no more calls, and issues the noted ones again; the state ends as it is.
    ///
    /// # Errors
    /// [`SimError::Ask`]: no call was noted, or the calls did not end in the same picture.
    pub fn replay_calls(&mut self) -> Result<BareCalls, SimError> {
        let fail = failed("issue its calls again");
        Python::attach(|py| {
            let Some(log) = self.call_log.take() else {
                return Err(fail(pyo3::exceptions::PyRuntimeError::new_err("no call was noted")));
            };
            let replay = || log.bind(py).call_method0("replay")?.extract::<HashMap<String, f64>>();
            let seconds = replay().map_err(&fail)?;
            let spent = |names: &[&str]| {
                Duration::from_secs_f64(names.iter().filter_map(|&name| seconds.get(name)).sum())
            };
            Ok(BareCalls {
                steps: spent(&["mj_step"]),
                pictures: spent(&["mjv_updateScene", "mjr_render", "mjr_readPixels"]),
                rays: spent(&["mj_multiRay"]),
            })
        })
    }
}
