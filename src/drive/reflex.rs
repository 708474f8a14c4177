//! From harmful boxes to braking: a box that several samples show is a hazard, and the ego brakes so that it stops before it.
//!
//! `braking = v^2 / (2 (gap - margin))`, within bounds, for the hazard that asks for most. A hazard stays where it was seen, over
//! ground, until no sample has confirmed it for a while. Nothing here knows the truth, reads a clock or draws a random number.

use std::collections::VecDeque;

use nalgebra::Vector2;

use super::config::ReflexConfig;
use crate::geometry::{Box3, Ego, Point, Transform, World};
use crate::object::Detection;
use crate::object::Harm;
use crate::sample::EgoState;
use crate::scene::EgoOrders;

/// Slower than this the ego stands, m/s.
const STANDS_MPS: f64 = 0.3;
/// Braking of one who stands and is to go on standing, m/s².
const HOLDING_MPS2: f64 = 2.0;
/// Points along an edge of a footprint at which its distance is measured, corners included.
const N_ON_EDGE: usize = 17;

/// What waits until it takes effect.
#[derive(Debug, Clone)]
struct Due {
    time_s: f64,
    boxes: Vec<Box3<World>>,
}

/// A confirmed harmful box.
#[derive(Debug, Clone)]
struct Hazard {
    at: Box3<World>,
    confirmed_s: f64,
}

/// The memory of one drive.
#[derive(Debug, Clone)]
pub struct Reflex {
    config: ReflexConfig,
    /// From which score on a harmful box counts.
    min_score: f64,
    due: VecDeque<Due>,
    /// Harmful boxes of the last samples, the latest first.
    history: VecDeque<Vec<Box3<World>>>,
    hazards: Vec<Hazard>,
}

impl Reflex {
    /// `own_score` is the detector's own, for a config that names none.
    #[must_use]
    pub fn new(config: &ReflexConfig, own_score: f64) -> Self {
        let min_score = if config.score > 0.0 { config.score } else { own_score };
        Self {
            config: config.clone(),
            min_score,
            due: VecDeque::new(),
            history: VecDeque::new(),
            hazards: Vec::new(),
        }
    }

    /// Takes the boxes of a sample, which was measured at a time and a place.
    pub fn see(&mut self, time_s: f64, world_from_ego: &Transform<World, Ego>, found: &[Detection]) {
        let counts = |found: &&Detection| found.harm == Harm::Harmful && found.score >= self.min_score;
        let boxes = found.iter().filter(counts).map(|found| found.box_in_ego.in_frame(world_from_ego));
        self.due.push_back(Due { time_s: time_s + self.config.latency_s, boxes: boxes.collect() });
    }

    /// What the driver is to do at a time; `state` is what the car measures of itself.
    pub fn orders(
        &mut self,
        time_s: f64,
        world_from_ego: &Transform<World, Ego>,
        state: &EgoState,
    ) -> EgoOrders {
        while self.due.front().is_some_and(|due| due.time_s <= time_s + 1e-9) {
            let due = self.due.pop_front().expect("there is a front");
            self.take(due);
        }
        let free_s = self.config.free_s;
        self.hazards.retain(|hazard| time_s - hazard.confirmed_s <= free_s + 1e-9);
        let ego_from_world = world_from_ego.inverse();
        let asked = self.hazards.iter().filter_map(|hazard| {
            let gap_m = self.gap_m(&hazard.at.in_frame(&ego_from_world), state.front_bumper_x_m)?;
            Some(self.braking_mps2(gap_m, state.speed_mps))
        });
        EgoOrders { braking_mps2: asked.max_by(f64::total_cmp) }
    }

    /// Whether anything is confirmed.
    #[must_use]
    pub fn is_alarmed(&self) -> bool {
        !self.hazards.is_empty()
    }

    fn take(&mut self, due: Due) {
        let same_m = self.config.same_m;
        let is_same = |a: &Box3<World>, b: &Box3<World>| apart_m(a.center, b.center) < same_m;
        for at in &due.boxes {
            let is_in = |boxes: &&Vec<Box3<World>>| boxes.iter().any(|before| is_same(before, at));
            let n_before = self.history.iter().filter(is_in).count();
            if n_before + 1 < self.config.n_confirming as usize {
                continue;
            }
            let hazard = Hazard { at: *at, confirmed_s: due.time_s };
            match self.hazards.iter_mut().find(|known| is_same(&known.at, at)) {
                Some(known) => *known = hazard,
                None => self.hazards.push(hazard),
            }
        }
        self.history.push_front(due.boxes);
        self.history.truncate(self.config.n_samples as usize - 1);
    }

    /// From the bumper to the nearest of a footprint, along the ego's x axis; of what lies in the strip ahead, if anything
    /// does. `None` where all of it lies behind the bumper.
    fn gap_m(&self, of: &Box3<Ego>, front_bumper_x_m: f64) -> Option<f64> {
        let corners = of.footprint();
        let points = corners.iter().zip(corners.iter().cycle().skip(1)).flat_map(|(from, to)| {
            (0..N_ON_EDGE).map(move |i| {
                let share = i as f64 / (N_ON_EDGE - 1) as f64;
                Vector2::new(
                    from.x_m + share * (to.x_m - from.x_m) - front_bumper_x_m,
                    from.y_m + share * (to.y_m - from.y_m),
                )
            })
        });
        let ahead: Vec<Vector2<f64>> = points.filter(|point| point.x > 0.0).collect();
        let nearest = |points: &mut dyn Iterator<Item = &Vector2<f64>>| {
            points.map(|point| point.x).min_by(f64::total_cmp)
        };
        let in_strip = nearest(&mut ahead.iter().filter(|point| point.y.abs() <= self.config.half_width_m));
        in_strip.or_else(|| nearest(&mut ahead.iter()))
    }

    fn braking_mps2(&self, gap_m: f64, speed_mps: f64) -> f64 {
        if speed_mps < STANDS_MPS {
            return HOLDING_MPS2;
        }
        let [least, most] = self.config.braking_mps2;
        let room_m = (gap_m - self.config.margin_m).max(0.0);
        (speed_mps * speed_mps / (2.0 * room_m)).clamp(least, most)
    }
}

fn apart_m(a: Point<World>, b: Point<World>) -> f64 {
    (a.x() - b.x()).hypot(a.y() - b.y())
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATE: EgoState = EgoState {
        speed_mps: 10.0,
        steering_angle_rad: 0.0,
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: 2.6,
        front_bumper_x_m: 3.0,
    };

    /// A cube of one metre, its near side so far before the bumper.
    fn crate_at(gap_m: f64, harm: Harm, score: f64) -> Detection {
        let center = Point::new(3.0 + gap_m + 0.5, 0.0, 0.5);
        let box_in_ego = Box3 { center, length_m: 1.0, width_m: 1.0, height_m: 1.0, yaw_rad: 0.0 };
        Detection { box_in_ego, velocity_in_ego_mps: [0.0; 2], harm, score, spread: None }
    }

    fn at(x_m: f64) -> Transform<World, Ego> {
        Transform::from_xyz_yaw(x_m, 0.0, 0.0, 0.0)
    }

    #[test]
    fn one_sample_alone_does_not_brake_and_the_second_brakes_to_stop_before_the_box() {
        let mut reflex = Reflex::new(&ReflexConfig::default(), 0.3);
        reflex.see(0.0, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
        assert_eq!(reflex.orders(0.0, &at(0.0), &STATE).braking_mps2, None);
        reflex.see(0.3, &at(3.0), &[crate_at(19.0, Harm::Harmful, 0.9)]);
        // 100 / (2 (19 - 2)).
        let braking_mps2 = reflex.orders(0.3, &at(3.0), &STATE).braking_mps2.unwrap();
        assert!((braking_mps2 - 100.0 / 34.0).abs() < 1e-9, "{braking_mps2}");
    }

    #[test]
    fn what_is_harmless_or_unsure_never_brakes() {
        for found in [crate_at(10.0, Harm::Harmless, 0.9), crate_at(10.0, Harm::Harmful, 0.2)] {
            let mut reflex = Reflex::new(&ReflexConfig::default(), 0.3);
            for i in 0..5 {
                let time_s = 0.3 * f64::from(i);
                reflex.see(time_s, &at(0.0), &[found]);
                assert_eq!(reflex.orders(time_s, &at(0.0), &STATE).braking_mps2, None);
            }
        }
    }

    #[test]
    fn a_hazard_is_remembered_where_it_stands_until_the_way_was_free_for_a_second() {
        let mut reflex = Reflex::new(&ReflexConfig::default(), 0.3);
        for time_s in [0.0, 0.3] {
            reflex.see(time_s, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
            reflex.orders(time_s, &at(0.0), &STATE);
        }
        // Half a second later, 5 m on, it asks for more, although nobody has seen it since.
        let braking_mps2 = reflex.orders(0.8, &at(5.0), &STATE).braking_mps2.unwrap();
        assert!((braking_mps2 - 100.0 / 30.0).abs() < 1e-9, "{braking_mps2}");
        assert!(reflex.orders(1.3, &at(5.0), &STATE).braking_mps2.is_some());
        assert_eq!(reflex.orders(1.35, &at(5.0), &STATE).braking_mps2, None);
    }

    #[test]
    fn latency_delays_the_brake() {
        let config = ReflexConfig { latency_s: 0.2, ..ReflexConfig::default() };
        let mut reflex = Reflex::new(&config, 0.3);
        for time_s in [0.0, 0.3] {
            reflex.see(time_s, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
        }
        assert_eq!(reflex.orders(0.45, &at(0.0), &STATE).braking_mps2, None);
        assert!(reflex.orders(0.5, &at(0.0), &STATE).braking_mps2.is_some());
    }

    #[test]
    fn what_lies_behind_the_bumper_is_past_and_what_is_too_near_takes_all_brakes() {
        let reflex = Reflex::new(&ReflexConfig::default(), 0.3);
        assert_eq!(reflex.gap_m(&crate_at(-1.5, Harm::Harmful, 0.9).box_in_ego, 3.0), None);
        assert!((reflex.braking_mps2(1.0, 5.0) - 8.0).abs() < 1e-12);
        // Of a long wall beside the car that turns into the strip ahead, the part in the strip counts.
        let wall = Box3 {
            center: Point::new(13.0, 2.0, 0.5),
            length_m: 20.0,
            width_m: 0.2,
            height_m: 1.0,
            yaw_rad: -0.1,
        };
        let gap_m = reflex.gap_m(&wall, 3.0).unwrap();
        assert!((10.0..14.0).contains(&gap_m), "{gap_m}");
    }
}
