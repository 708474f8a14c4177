//! Made boxes that two programs score and label: about as dense as on a street, detections near their truths.

use harmzone::dataset::SampleFacts;
use harmzone::eval::EvalSample;
use harmzone::geometry::{Box3, Ego, Point};
use harmzone::object::{Detection, Distribution, Harm, LabelledObject, Object};
use harmzone::random;
use harmzone::sample::EgoState;
use rand::RngExt;

pub const N_SAMPLES: usize = 6000;
const TRUTHS_A_SAMPLE: usize = 10;
const DETECTIONS_A_TRUTH: usize = 5;

/// 60,000 truths and 300,000 detections, the same each time.
pub fn samples() -> Vec<EvalSample> {
    let mut rng = random::stream(5, "bench-eval", 0);
    let mut between = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let mut sample = |i: usize| {
        let (mut objects, mut detections) = (Vec::new(), Vec::new());
        for _ in 0..TRUTHS_A_SAMPLE {
            let (x_m, y_m) = (between(4.0, 45.0), between(-15.0, 15.0));
            let harm = Harm::ALL[usize::from(between(0.0, 1.0) > 0.1)];
            let mut a_box = |spread_m: f64| Box3::<Ego> {
                center: Point::new(
                    x_m + between(-spread_m, spread_m),
                    y_m + between(-spread_m, spread_m),
                    0.8,
                ),
                length_m: between(0.5, 5.0),
                width_m: between(0.5, 2.0),
                height_m: 1.6,
                yaw_rad: between(-3.1, 3.1),
            };
            let velocity_in_ego_mps = [0.0; 2];
            let truth = Object {
                velocity_in_ego_mps,
                distribution: Some(Distribution::Id),
                n_lidar_points: Some(5),
                ..Object::new(a_box(0.0))
            };
            objects.push(LabelledObject { harm, truth });
            let found: Vec<Box3<Ego>> = (0..DETECTIONS_A_TRUTH).map(|k| a_box(0.4 + k as f64)).collect();
            for (k, box_in_ego) in found.into_iter().enumerate() {
                let score = between(0.0, 1.0) / (1.0 + k as f64);
                detections.push(Detection { box_in_ego, velocity_in_ego_mps, harm, score, spread: None });
            }
        }
        EvalSample::new(format!("s{i}"), SampleFacts::default(), objects, detections)
    };
    (0..N_SAMPLES).map(&mut sample).collect()
}

/// What the ego does in each sample.
pub fn states() -> Vec<EgoState> {
    let mut rng = random::stream(5, "bench-states", 0);
    let state = |_| EgoState {
        speed_mps: 14.0 * rng.random::<f64>(),
        steering_angle_rad: 0.4 * (rng.random::<f64>() - 0.5),
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.7,
        front_bumper_x_m: 3.6,
    };
    (0..N_SAMPLES).map(state).collect()
}
