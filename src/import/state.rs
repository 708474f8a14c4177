//! The ego's state at a sample: what was measured, else what its poses tell, else what the config assumes.

use std::collections::BTreeMap;

use super::config::CheckedImport;
use super::motion::Motion;
use super::{DriveFacts, Series};
use crate::sample::EgoState;

/// Below this speed the path says nothing of the steering angle: that of the nearest moving time holds.
const MIN_SPEED_MPS: f64 = 0.5;
/// How far around a standing time the search for a moving one goes, and its step.
const SEARCH_STEPS: u64 = 40;
const SEARCH_STEP_NS: u64 = 250_000_000;

/// Makes states, and remembers by which methods.
pub(super) struct StateMaker<'a> {
    pub(super) motion: &'a Motion<'a>,
    pub(super) wheelbase_m: f64,
    pub(super) front_bumper_x_m: f64,
    pub(super) config: &'a CheckedImport,
    /// By part of the state, one sentence; the best method comes first where samples differ.
    pub(super) methods: BTreeMap<&'static str, String>,
    /// Samples whose speed is assumed.
    pub(super) n_assumed: usize,
}

impl<'a> StateMaker<'a> {
    pub(super) fn new(motion: &'a Motion<'a>, facts: &DriveFacts, config: &'a CheckedImport) -> Self {
        Self {
            motion,
            wheelbase_m: facts.wheelbase_m.unwrap_or(config.vehicle.wheelbase_m),
            front_bumper_x_m: facts.front_bumper_x_m.unwrap_or(config.vehicle.front_bumper_x_m),
            config,
            methods: BTreeMap::new(),
            n_assumed: 0,
        }
    }

    /// The state at a time.
    pub(super) fn state_at(&mut self, time_ns: u64) -> EgoState {
        let odometry = self.motion.odometry;
        let course = self.motion.course_at(time_ns);
        let smoothing_s = self.config.smoothing_s;
        let from_poses = format!("from the poses within {smoothing_s} s");
        let assumed = self.config.assumed;

        let mut speed = self.measured(odometry.speed_mps.as_ref(), time_ns);
        speed = speed.or_else(|| course.map(|course| (course.speed_mps, from_poses.clone())));
        self.n_assumed += usize::from(speed.is_none());
        let speed_mps = self.take("speed", speed, || {
            (assumed.speed_mps, format!("unknown; assumed {} m/s", assumed.speed_mps))
        });

        let measured_yaw_rate = self.measured(odometry.yaw_rate_rps.as_ref(), time_ns);
        let measured_course = measured_yaw_rate.clone().filter(|_| odometry.speed_mps.is_some());
        let steering = self
            .measured(odometry.steering_angle_rad.as_ref(), time_ns)
            .or_else(|| self.steering_of_path(time_ns))
            .or_else(|| {
                let (yaw_rate_rps, source) = measured_course?;
                let source = format!("atan(wheelbase * yaw rate / speed), the yaw rate {source}");
                let moves = speed_mps.abs() >= MIN_SPEED_MPS;
                Some((if moves { (self.wheelbase_m * yaw_rate_rps / speed_mps).atan() } else { 0.0 }, source))
            });
        let steering_angle_rad = self.take("steering", steering, || {
            let angle_deg = assumed.steering_angle_deg;
            (angle_deg.to_radians(), format!("unknown; assumed {angle_deg} degrees"))
        });

        let yaw_rate =
            measured_yaw_rate.or_else(|| course.map(|course| (course.yaw_rate_rps, from_poses.clone())));
        let of_arc = speed_mps * steering_angle_rad.tan() / self.wheelbase_m;
        let yaw_rate_rps = self
            .take("yaw_rate", yaw_rate, || (of_arc, "speed * tan(steering angle) / wheelbase".to_owned()));
        let acceleration = self.measured(odometry.acceleration_mps2.as_ref(), time_ns);
        let acceleration =
            acceleration.or_else(|| course.map(|course| (course.acceleration_mps2, from_poses)));
        let acceleration_mps2 =
            self.take("acceleration", acceleration, || (0.0, "unknown; assumed 0".to_owned()));
        EgoState {
            speed_mps,
            steering_angle_rad,
            yaw_rate_rps,
            acceleration_mps2,
            wheelbase_m: self.wheelbase_m,
            front_bumper_x_m: self.front_bumper_x_m,
        }
    }

    fn measured(&self, series: Option<&Series>, time_ns: u64) -> Option<(f64, String)> {
        let series = series?;
        Some((self.motion.value_at(&series.values, time_ns)?, series.source.clone()))
    }

    /// The angle of the arc that the poses describe.
    fn steering_of_path(&self, time_ns: u64) -> Option<(f64, String)> {
        let angle = |at_ns: u64| {
            let course = self.motion.course_at(at_ns)?;
            let moves = course.speed_mps.abs() >= MIN_SPEED_MPS;
            moves.then(|| (self.wheelbase_m * course.yaw_rate_rps / course.speed_mps).atan())
        };
        self.motion.course_at(time_ns)?;
        let mut steps = (0..=SEARCH_STEPS).map(|i| i * SEARCH_STEP_NS);
        let around =
            |step_ns: u64| angle(time_ns.saturating_sub(step_ns)).or_else(|| angle(time_ns + step_ns));
        let found = steps.find_map(around).unwrap_or(0.0);
        let source = format!(
            "atan(wheelbase * curvature) of the poses within {} s; where the car stands, of the nearest time at which \
             it moves",
            self.config.smoothing_s
        );
        Some((found, source))
    }

    fn take(
        &mut self,
        part: &'static str,
        found: Option<(f64, String)>,
        or: impl FnOnce() -> (f64, String),
    ) -> f64 {
        let (value, source) = found.unwrap_or_else(or);
        let told = self.methods.entry(part).or_insert_with(|| source.clone());
        if !told.contains(&source) {
            told.push_str(&format!("; in part {source}"));
        }
        // Minus zero would be written as such.
        value + 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Transform;
    use crate::import::{ImportConfig, Odometry};

    fn state(odometry: &Odometry, time_ns: u64) -> (EgoState, BTreeMap<&'static str, String>) {
        let (state, maker_methods, _) = made(odometry, time_ns);
        (state, maker_methods)
    }

    /// The state, its methods, and how many speeds were assumed.
    fn made(odometry: &Odometry, time_ns: u64) -> (EgoState, BTreeMap<&'static str, String>, usize) {
        let motion = Motion { odometry, tolerance_ns: 50_000_000, smoothing_ns: 500_000_000 };
        let config = CheckedImport::new(ImportConfig::default()).unwrap();
        let methods = BTreeMap::new();
        let mut maker = StateMaker {
            motion: &motion,
            wheelbase_m: 2.7,
            front_bumper_x_m: 3.6,
            config: &config,
            methods,
            n_assumed: 0,
        };
        let state = maker.state_at(time_ns);
        (state, maker.methods, maker.n_assumed)
    }

    #[test]
    fn nothing_known_gives_what_the_config_assumes_and_says_so() {
        let (state, methods) = state(&Odometry::default(), 5);
        assert_eq!((state.speed_mps, state.steering_angle_rad, state.yaw_rate_rps), (8.0, 0.0, 0.0));
        assert_eq!(methods["speed"], "unknown; assumed 8 m/s");
        assert_eq!(made(&Odometry::default(), 5).2, 1);
        let speed_mps = Some(Series { source: "measured".into(), values: vec![(0, 3.0)] });
        assert_eq!(made(&Odometry { speed_mps, ..Odometry::default() }, 5).2, 0);
    }

    #[test]
    fn a_circle_is_steered_at_atan_of_wheelbase_over_radius() {
        // 20 m to the left at 5 m/s; then the car stands.
        let pose = |i: u64| {
            let turned = 0.25 * i.min(40) as f64 * 0.1;
            let (x, y) = (20.0 * turned.sin(), 20.0 - 20.0 * turned.cos());
            (i * 100_000_000, Transform::from_xyz_yaw(x, y, 0.0, turned))
        };
        let odometry = Odometry { poses: (0..=80).map(pose).collect(), ..Odometry::default() };
        let wanted = (2.7f64 / 20.0).atan();
        assert!((state(&odometry, 2_000_000_000).0.steering_angle_rad - wanted).abs() < 1e-3);
        let (standing, methods) = state(&odometry, 7_000_000_000);
        assert!(standing.speed_mps.abs() < 1e-6, "{standing:?}");
        assert!((standing.steering_angle_rad - wanted).abs() < 0.02, "{standing:?}");
        assert!(methods["steering"].starts_with("atan(wheelbase * curvature)"));
    }

    #[test]
    fn what_is_measured_goes_before_the_poses() {
        let series = |value| Some(Series { source: "measured".into(), values: vec![(0, value)] });
        let odometry = Odometry { speed_mps: series(9.0), yaw_rate_rps: series(0.1), ..Odometry::default() };
        let (state, methods) = state(&odometry, 0);
        assert_eq!((state.speed_mps, state.yaw_rate_rps), (9.0, 0.1));
        assert_eq!(state.steering_angle_rad, (2.7f64 * 0.1 / 9.0).atan());
        assert!(methods["steering"].contains("yaw rate measured"));
    }
}
