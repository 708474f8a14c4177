//! The bare calls to MuJoCo of some time, issued again with nothing around them: what no code of ours can save.

use std::collections::HashMap;
use std::ffi::CString;
use std::time::Duration;

use harmzone::sim::{SimError, Simulator};
use pyo3::prelude::*;

/// Time in MuJoCo's own functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct BareCalls {
    /// `mj_step`.
    pub steps: Duration,
    /// `mjv_updateScene`, `mjr_render`, `mjr_readPixels`.
    pub pictures: Duration,
    /// `mj_multiRay`.
    pub rays: Duration,
}

impl BareCalls {
    pub(super) fn total(&self) -> Duration {
        self.steps + self.pictures + self.rays
    }
}

/// Notes all calls to MuJoCo from its making on; the simulator must be alone in its process.
pub(super) struct CallLog(Py<PyAny>);

impl CallLog {
    /// Begins to note; draws once, so that the camera is warm.
    ///
    /// # Errors
    /// As [`Simulator::render_rgb`].
    pub(super) fn start(simulator: &mut Simulator) -> Result<Self, SimError> {
        simulator.with_python("note its calls", |world, camera| {
            let source = CString::new(include_str!("../../python/replay.py"))?;
            let module = PyModule::from_code(world.py(), &source, c"<xtask/python/replay.py>", c"replay")?;
            Ok(Self(module.getattr("CallLog")?.call1((world, camera))?.unbind()))
        })
    }

    /// Notes no more calls, and issues the noted ones again; the state ends as it is.
    ///
    /// # Errors
    /// [`SimError::Ask`]: the calls did not end in the same picture.
    pub(super) fn replay(self, simulator: &mut Simulator) -> Result<BareCalls, SimError> {
        simulator.with_python("issue its calls again", |world, _| {
            let seconds: HashMap<String, f64> = self.0.bind(world.py()).call_method0("replay")?.extract()?;
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
