//! The bare calls to MuJoCo for the frames of an episode, with nothing around them: what a plain user of MuJoCo issues
//! for the same data, whatever `gen` itself calls.

use std::collections::HashMap;
use std::ffi::CString;
use std::time::Duration;

use harmzone::geometry::Point;
use harmzone::sensors::Rig;
use harmzone::sim::{SimError, Simulator};
use pyo3::prelude::*;

/// Time in MuJoCo's own functions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct BareCalls {
    /// `mj_step`.
    pub steps: Duration,
    /// `mjv_updateScene`, `mjr_render`, `mjr_readPixels`: a picture with shadows and a full segmentation.
    pub pictures: Duration,
    /// `mj_multiRay`.
    pub rays: Duration,
}

impl BareCalls {
    pub(super) fn total(&self) -> Duration {
        self.steps + self.pictures + self.rays
    }
}

/// Notes the steps from its making on; the simulator must be alone in its process.
pub(super) struct StepLog(Py<PyAny>);

impl StepLog {
    /// Begins to note; draws once, so that the camera is warm.
    ///
    /// # Errors
    /// As [`Simulator::render_rgb`].
    pub(super) fn start(simulator: &mut Simulator) -> Result<Self, SimError> {
        simulator.render_rgb()?;
        simulator.with_python("note its steps", |world, _| {
            let source = CString::new(include_str!("../../python/replay.py"))?;
            let module = PyModule::from_code(world.py(), &source, c"<xtask/python/replay.py>", c"replay")?;
            Ok(Self(module.getattr("StepLog")?.call1((world,))?.unbind()))
        })
    }

    /// Notes no more steps, and issues them again with pictures and rays of the noted samples; the state ends as it is.
    ///
    /// # Errors
    /// [`SimError::Ask`]: the steps did not end in the same state.
    pub(super) fn replay(
        self,
        simulator: &mut Simulator,
        rig: &Rig,
        n_samples: u32,
        with_depth: bool,
    ) -> Result<BareCalls, SimError> {
        let origin = rig.top().ego_from_lidar * Point::new(0.0, 0.0, 0.0);
        let position_m = [origin.x(), origin.y(), origin.z()];
        let directions: Vec<[f64; 3]> = rig
            .top()
            .pattern
            .directions
            .iter()
            .map(|of| rig.top().ego_from_lidar.rotate(of).into())
            .collect();
        simulator.with_python("issue its steps again", |world, _| {
            let array = world.py().import("numpy")?.getattr("array")?;
            let [position_m, directions] = [array.call1((position_m,))?, array.call1((directions,))?];
            let reach_m = rig.top().config.max_range_m + 1.0;
            let arguments = (n_samples, "ego", position_m, directions, reach_m, with_depth);
            let seconds: HashMap<String, f64> =
                self.0.bind(world.py()).call_method1("replay", arguments)?.extract()?;
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
