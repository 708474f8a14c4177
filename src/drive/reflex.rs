//! From harmful boxes to braking: a box that several samples show is a hazard, and the ego brakes so that it stops before it.
//!
//! `braking = v^2 / (2 (gap - margin))`, within bounds, for the hazard that asks for most. A hazard stays where it was seen, over
//! ground, until no sample has confirmed it for a while; one that stood right before the bumper when it was last seen, where sensors
//! look over it, is not forgotten. What is not harmful yet but moves into the ego's way is a hazard where
//! both will meet ([`Foresight`]). Nothing here knows the truth, reads a clock or draws a random number.

use std::collections::VecDeque;

use nalgebra::{Vector2, Vector3};

use super::config::ReflexConfig;
use super::foresight::{Foresight, ForesightAt};
use super::hazards::{Hazard, Hazards};
use super::strip::ahead_of;
use super::tracks::{Sample, Seen, Track, apart_m};
use crate::geometry::{Box3, Ego, Point, Transform, World};
use crate::object::{Detection, Harm};
use crate::sample::EgoState;
use crate::scene::EgoOrders;
use crate::zone::ZoneError;

/// Slower than this the ego stands, m/s.
const STANDS_MPS: f64 = 0.3;
/// Braking of one who stands and is to go on standing, m/s².
const HOLDING_MPS2: f64 = 2.0;

/// The memory of one drive.
#[derive(Debug, Clone)]
pub struct Reflex {
    config: ReflexConfig,
    foresight: Foresight,
    /// From which score on a box counts.
    min_score: f64,
    due: VecDeque<Sample>,
    /// The last samples that took effect, the latest first.
    history: VecDeque<Sample>,
    hazards: Hazards,
}

impl Reflex {
    /// Boxes count from `min_score` on.
    ///
    /// # Errors
    /// The config is not valid.
    pub fn new(config: &ReflexConfig, min_score: f64) -> Result<Self, ZoneError> {
        Ok(Self {
            config: config.clone(),
            foresight: Foresight::new(config)?,
            min_score,
            due: VecDeque::new(),
            history: VecDeque::new(),
            hazards: Hazards::default(),
        })
    }

    /// Takes the boxes of a sample, which was measured at a time and a place.
    pub fn see(&mut self, time_s: f64, world_from_ego: &Transform<World, Ego>, found: &[Detection]) {
        let counted = found.iter().filter(|found| found.score >= self.min_score);
        let seen = counted.map(|found| Seen {
            at: found.box_in_ego.in_frame(world_from_ego),
            is_harmful: found.harm == Harm::Harmful,
            meets: false,
        });
        self.due.push_back(Sample { time_s, seen: seen.collect(), due_s: time_s + self.config.latency_s });
    }

    /// What the driver is to do at a time; `state` is what the car measures of itself.
    ///
    /// # Errors
    /// The state is not valid, or a box is not finite.
    pub fn orders(
        &mut self,
        time_s: f64,
        world_from_ego: &Transform<World, Ego>,
        state: &EgoState,
    ) -> Result<EgoOrders, ZoneError> {
        while self.due.front().is_some_and(|due| due.due_s <= time_s + 1e-9) {
            let due = self.due.pop_front().expect("there is a front");
            self.take(due, time_s, world_from_ego, &self.foresight.at(state)?)?;
        }
        let free_s = self.config.free_s;
        let ego_from_world = world_from_ego.inverse();
        let bumper_x_m = state.front_bumper_x_m;
        let is_near = |hazard: &Hazard| {
            let stood = hazard.stands == Some(true) && hazard.n_confirmed >= self.config.near_confirming;
            // What is still seen shows by itself what it is.
            !hazard.is_seen && stood && self.config.is_near(&hazard.at.in_frame(&ego_from_world), bumper_x_m)
        };
        let is_kept = |hazard: &Hazard| time_s - hazard.confirmed_s <= free_s + 1e-9 || is_near(hazard);
        self.hazards.retain(is_kept);
        let asked = self.hazards.iter().filter_map(|hazard| {
            let gap_m = self.gap_m(&hazard.at.in_frame(&ego_from_world), state.front_bumper_x_m)?;
            Some(self.braking_mps2(gap_m, state.speed_mps))
        });
        Ok(EgoOrders { braking_mps2: asked.max_by(f64::total_cmp) })
    }

    /// Whether anything is confirmed.
    #[must_use]
    pub fn is_alarmed(&self) -> bool {
        !self.hazards.is_empty()
    }

    /// Confirms what a sample shows.
    fn take(
        &mut self,
        mut sample: Sample,
        time_s: f64,
        world_from_ego: &Transform<World, Ego>,
        foresight: &ForesightAt,
    ) -> Result<(), ZoneError> {
        let ego_from_world = world_from_ego.inverse();
        let n_confirming = self.config.n_confirming as usize;
        let mut confirmed = Vec::new();
        for i in 0..sample.seen.len() {
            let seen = sample.seen[i];
            let track = Track::of(&sample, i, self.history.iter(), &self.config);
            let velocity_mps = track.velocity_mps();
            let stands = velocity_mps.map(|[x_mps, y_mps]| x_mps.hypot(y_mps) < self.config.moving_mps);
            let hazard_at = if seen.is_harmful {
                let n_before = self.n_harmful_before(&sample.seen, i).max(track.n_alarming_before());
                (n_before + 1 >= n_confirming).then_some(seen.at)
            } else {
                let Some([x_mps, y_mps]) = velocity_mps else { continue };
                let since_s = time_s - sample.time_s;
                let mut now_at = seen.at;
                now_at.center = Point::new(
                    seen.at.center.x() + x_mps * since_s,
                    seen.at.center.y() + y_mps * since_s,
                    seen.at.center.z(),
                );
                let in_ego = ego_from_world.rotate(&Vector3::new(x_mps, y_mps, 0.0));
                let met = foresight.meeting(&now_at.in_frame(&ego_from_world), [in_ego.x, in_ego.y])?;
                let is_confirmed = track.n_alarming_before() + 1 >= n_confirming;
                sample.seen[i].meets = met.is_some();
                met.filter(|_| is_confirmed).map(|met| met.in_frame(world_from_ego))
            };
            confirmed.extend(hazard_at.map(|at| Hazard {
                at,
                confirmed_s: sample.due_s,
                n_confirmed: 1,
                stands: if seen.is_harmful { stands } else { Some(false) },
                is_seen: true,
            }));
        }
        self.hazards.follow(self.history.front(), &sample, &self.config);
        self.hazards.confirm(confirmed, &self.config);
        self.history.push_front(sample);
        self.history.truncate(self.config.n_samples as usize - 1);
        Ok(())
    }

    /// How many of the samples before show a harmful box that this one may be, and no other harmful one of its sample sooner: what is
    /// seen once beside a thing that is known is not known for that.
    fn n_harmful_before(&self, seen: &[Seen], i: usize) -> usize {
        let is_own = |earlier: &&Seen| {
            let here_m = apart_m(&earlier.at, &seen[i].at);
            let others = seen.iter().enumerate().filter(|(j, other)| *j != i && other.is_harmful);
            earlier.is_harmful
                && here_m < self.config.same_m
                && others.into_iter().all(|(_, other)| apart_m(&earlier.at, &other.at) >= here_m)
        };
        self.history.iter().filter(|sample| sample.seen.iter().any(|earlier| is_own(&earlier))).count()
    }

    /// From the bumper to the nearest of a footprint, along the ego's x axis; of what lies in the strip ahead, if anything
    /// does. `None` where all of it lies behind the bumper.
    fn gap_m(&self, of: &Box3<Ego>, front_bumper_x_m: f64) -> Option<f64> {
        let ahead = ahead_of(of, front_bumper_x_m);
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

    fn reflex(config: ReflexConfig) -> Reflex {
        Reflex::new(&config, 0.3).unwrap()
    }

    #[test]
    fn one_sample_alone_does_not_brake_and_the_second_brakes_to_stop_before_the_box() {
        let mut reflex = reflex(ReflexConfig::default());
        reflex.see(0.0, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
        assert_eq!(reflex.orders(0.0, &at(0.0), &STATE).unwrap().braking_mps2, None);
        reflex.see(0.3, &at(3.0), &[crate_at(19.0, Harm::Harmful, 0.9)]);
        // 100 / (2 (19 - 2)).
        let braking_mps2 = reflex.orders(0.3, &at(3.0), &STATE).unwrap().braking_mps2.unwrap();
        assert!((braking_mps2 - 100.0 / 34.0).abs() < 1e-9, "{braking_mps2}");
    }

    #[test]
    fn what_is_harmless_or_unsure_never_brakes() {
        for found in [crate_at(10.0, Harm::Harmless, 0.9), crate_at(10.0, Harm::Harmful, 0.2)] {
            let mut reflex = reflex(ReflexConfig::default());
            for i in 0..5 {
                let time_s = 0.3 * f64::from(i);
                reflex.see(time_s, &at(0.0), &[found]);
                assert_eq!(reflex.orders(time_s, &at(0.0), &STATE).unwrap().braking_mps2, None);
            }
        }
    }

    #[test]
    fn a_hazard_is_remembered_where_it_stands_until_the_way_was_free_for_a_second() {
        let mut reflex = reflex(ReflexConfig::default());
        for time_s in [0.0, 0.3] {
            reflex.see(time_s, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
            reflex.orders(time_s, &at(0.0), &STATE).unwrap();
        }
        // Half a second later, 5 m on, it asks for more, although nobody has seen it since.
        let braking_mps2 = reflex.orders(0.8, &at(5.0), &STATE).unwrap().braking_mps2.unwrap();
        assert!((braking_mps2 - 100.0 / 30.0).abs() < 1e-9, "{braking_mps2}");
        assert!(reflex.orders(1.3, &at(5.0), &STATE).unwrap().braking_mps2.is_some());
        assert_eq!(reflex.orders(1.35, &at(5.0), &STATE).unwrap().braking_mps2, None);
    }

    #[test]
    fn what_stands_right_before_the_bumper_is_not_forgotten() {
        // 2.5 m before the bumper no sensor sees a low box, and a car that stands must not drive over it. What two samples
        // alone have shown may have been an error.
        for (near_m, n_samples, is_kept) in [(3.0, 5, true), (3.0, 2, false), (0.0, 5, false)] {
            let mut reflex = reflex(ReflexConfig { near_m, ..ReflexConfig::default() });
            for i in 0..n_samples {
                let time_s = 0.3 * f64::from(i);
                reflex.see(time_s, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
                reflex.orders(time_s, &at(0.0), &STATE).unwrap();
            }
            // Nobody sees it any more.
            reflex.see(3.9, &at(19.5), &[]);
            let brakes = reflex.orders(4.0, &at(19.5), &STATE).unwrap().braking_mps2.is_some();
            assert_eq!(brakes, is_kept, "{near_m} m, {n_samples} samples");
            // Passed, it is.
            assert_eq!(reflex.orders(4.05, &at(26.0), &STATE).unwrap().braking_mps2, None);
        }
    }

    #[test]
    fn who_stood_before_the_bumper_and_drives_off_is_not_remembered_there() {
        // A leader stands 2.1 m ahead for 1.5 s and then leaves at 1.5 m/s, seen throughout and harmful only while it is near.
        let standing = EgoState { speed_mps: 0.0, ..STATE };
        let mut reflex = reflex(ReflexConfig::default());
        let mut brakes = Vec::new();
        for i in 0..14 {
            let time_s = 0.3 * f64::from(i);
            let gap_m = 2.1 + 0.45 * f64::from((i - 5).max(0));
            let harm = if gap_m < 3.5 { Harm::Harmful } else { Harm::Harmless };
            reflex.see(time_s, &at(0.0), &[crate_at(gap_m, harm, 0.9)]);
            brakes.push(reflex.orders(time_s, &at(0.0), &standing).unwrap().braking_mps2.is_some());
        }
        // It is last harmful at 2.4 s, and the way is free a second later.
        assert_eq!(brakes[1..12], [true; 11]);
        assert_eq!(brakes[12..], [false; 2]);
    }

    #[test]
    fn of_two_that_stand_close_together_the_nearer_one_brakes_whichever_is_told_last() {
        for gaps_m in [[19.0, 21.0], [21.0, 19.0]] {
            let mut reflex = reflex(ReflexConfig::default());
            for i in 0..4 {
                let time_s = 0.3 * f64::from(i);
                reflex.see(time_s, &at(0.0), &gaps_m.map(|gap_m| crate_at(gap_m, Harm::Harmful, 0.9)));
                let braking_mps2 = reflex.orders(time_s, &at(0.0), &STATE).unwrap().braking_mps2;
                // 100 / (2 (19 - 2)).
                assert!(i == 0 || (braking_mps2.unwrap() - 100.0 / 34.0).abs() < 1e-9, "{braking_mps2:?}");
            }
        }
    }

    #[test]
    fn a_box_seen_once_beside_a_known_thing_neither_brakes_nor_takes_its_place() {
        for other_m in [22.0, 17.5] {
            let mut reflex = reflex(ReflexConfig::default());
            for (i, gaps_m) in [&[20.0][..], &[20.0], &[20.0, other_m], &[20.0]].into_iter().enumerate() {
                let time_s = 0.3 * i as f64;
                let found: Vec<Detection> =
                    gaps_m.iter().map(|&gap_m| crate_at(gap_m, Harm::Harmful, 0.9)).collect();
                reflex.see(time_s, &at(0.0), &found);
                let braking_mps2 = reflex.orders(time_s, &at(0.0), &STATE).unwrap().braking_mps2;
                assert!(i == 0 || (braking_mps2.unwrap() - 100.0 / 36.0).abs() < 1e-9, "{braking_mps2:?}");
            }
        }
    }

    #[test]
    fn latency_delays_the_brake() {
        let config = ReflexConfig { latency_s: 0.2, ..ReflexConfig::default() };
        let mut reflex = reflex(config);
        for time_s in [0.0, 0.3] {
            reflex.see(time_s, &at(0.0), &[crate_at(22.0, Harm::Harmful, 0.9)]);
        }
        assert_eq!(reflex.orders(0.45, &at(0.0), &STATE).unwrap().braking_mps2, None);
        assert!(reflex.orders(0.5, &at(0.0), &STATE).unwrap().braking_mps2.is_some());
    }

    #[test]
    fn what_lies_behind_the_bumper_is_past_and_what_is_too_near_takes_all_brakes() {
        let reflex = reflex(ReflexConfig::default());
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

    /// A harmless crate on its way across, 12 m ahead of the bumper and so far to the left.
    fn rolling(y_m: f64) -> Detection {
        let mut found = crate_at(12.0, Harm::Harmless, 0.9);
        found.box_in_ego.center = Point::new(15.5, y_m, 0.5);
        found
    }

    #[test]
    fn what_rolls_into_the_way_brakes_before_it_is_harmful_and_what_stands_or_rolls_away_does_not() {
        let braked = |ys_m: [f64; 3], foresight_s: f64| {
            let mut reflex = reflex(ReflexConfig { foresight_s, ..ReflexConfig::default() });
            let mut told = None;
            for (i, y_m) in ys_m.into_iter().enumerate() {
                let time_s = 0.3 * i as f64;
                reflex.see(time_s, &at(0.0), &[rolling(y_m)]);
                told = reflex.orders(time_s, &at(0.0), &STATE).unwrap().braking_mps2;
            }
            told
        };
        // 3 m/s to the right: in 1.2 s, when the bumper is there, it is in the middle of the lane.
        assert!((braked([5.4, 4.5, 3.6], 2.0).unwrap() - 100.0 / 20.0).abs() < 0.2);
        assert_eq!(braked([5.4, 4.5, 3.6], 0.0), None);
        assert_eq!(braked([3.6, 3.6, 3.6], 2.0), None);
        assert_eq!(braked([3.0, 3.9, 4.8], 2.0), None);
    }

    #[test]
    fn two_that_stand_side_by_side_are_not_taken_for_one_that_moves() {
        let mut reflex = reflex(ReflexConfig { foresight_s: 2.0, ..ReflexConfig::default() });
        let both = [rolling(3.0), rolling(5.0)];
        // The nearer one is seen at every second sample only.
        for (i, seen) in [&both[..], &both[1..], &both[..], &both[1..]].into_iter().enumerate() {
            let time_s = 0.3 * i as f64;
            reflex.see(time_s, &at(0.0), seen);
            assert_eq!(reflex.orders(time_s, &at(0.0), &STATE).unwrap().braking_mps2, None, "{time_s} s");
        }
    }
}
