//! From harmful boxes to braking: a box that several samples show is a hazard, and the ego brakes so that it stops before it.
//!
//! `braking = v^2 / (2 (gap - margin))`, within bounds, for the hazard that asks for most. A hazard stays where it was seen, over
//! ground, until no sample has confirmed it for a while; one that stood right before the bumper when it was last seen, where sensors
//! look over it, is not forgotten. What is not harmful yet but moves into the ego's way is a hazard where
//! both will meet ([`Foresight`]), and so is what stands on its route through a bend ([`RouteAhead`]). Nothing here knows the truth,
//! reads a clock or draws a random number.

use std::collections::VecDeque;

use nalgebra::{Vector2, Vector3};

use super::config::ReflexConfig;
use super::foresight::{Foresight, ForesightAt};
use super::hazards::{Hazard, Hazards};
use super::perception::CountsFrom;
use super::route_ahead::{RouteAhead, RouteAheadAt};
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
    route_ahead: RouteAhead,
    scores: CountsFrom,
    due: VecDeque<Sample>,
    /// The last samples that took effect, the latest first.
    history: VecDeque<Sample>,
    hazards: Hazards,
}

impl Reflex {
    /// # Errors
    /// The config is not valid.
    pub fn new(config: &ReflexConfig, scores: CountsFrom) -> Result<Self, ZoneError> {
        Ok(Self {
            config: config.clone(),
            foresight: Foresight::new(config)?,
            route_ahead: RouteAhead::new(config)?,
            scores,
            due: VecDeque::new(),
            history: VecDeque::new(),
            hazards: Hazards::default(),
        })
    }

    /// Takes the boxes of a sample, which was measured at a time and a place and was looked at for so long; `knows_velocities` of who
    /// knows more than boxes.
    pub fn see(
        &mut self,
        [time_s, took_s]: [f64; 2],
        world_from_ego: &Transform<World, Ego>,
        found: &[Detection],
        knows_velocities: bool,
    ) {
        let counted = found.iter().filter(|found| found.score >= self.scores.seen);
        let seen = counted.map(|found| Seen {
            at: found.box_in_ego.in_frame(world_from_ego),
            is_sure: found.score >= self.scores.sure,
            is_harmful: found.harm == Harm::Harmful,
            velocity_mps: knows_velocities.then(|| {
                let [x_mps, y_mps] = found.velocity_in_ego_mps;
                let over_ground = world_from_ego.rotate(&Vector3::new(x_mps, y_mps, 0.0));
                [over_ground.x, over_ground.y]
            }),
            meets: false,
        });
        self.due.push_back(Sample {
            time_s,
            seen: seen.collect(),
            due_s: time_s + self.config.latency_s + took_s,
        });
    }

    /// What the driver is to do at a time; `state` is what the car measures of itself, `route` its route over ground from the bumper
    /// on, in steps of `route_ahead::STEP_M`.
    ///
    /// # Errors
    /// The state is not valid, or a box is not finite.
    pub fn orders(
        &mut self,
        time_s: f64,
        world_from_ego: &Transform<World, Ego>,
        state: &EgoState,
        route: &[Vector2<f64>],
    ) -> Result<EgoOrders, ZoneError> {
        while self.due.front().is_some_and(|due| due.due_s <= time_s + 1e-9) {
            let due = self.due.pop_front().expect("there is a front");
            let ahead = self.route_ahead.at(state, route)?;
            self.take(due, time_s, world_from_ego, &self.foresight.at(state)?, &ahead)?;
        }
        let free_s = self.config.free_s;
        let ego_from_world = world_from_ego.inverse();
        let bumper_x_m = state.front_bumper_x_m;
        let is_near = |hazard: &Hazard| {
            // What is still seen shows by itself what it is.
            !hazard.is_seen
                && hazard.has_stood(&self.config)
                && self.config.is_near(&hazard.at.in_frame(&ego_from_world), bumper_x_m)
        };
        let is_kept = |hazard: &Hazard| time_s - hazard.confirmed_s <= free_s + 1e-9 || is_near(hazard);
        self.hazards.retain(is_kept);
        let asked = self.hazards.iter().filter_map(|hazard| {
            let gap_m = self.gap_m(&hazard.at.in_frame(&ego_from_world), state.front_bumper_x_m)?;
            Some(self.braking_mps2(gap_m, state.speed_mps, hazard.is_sure))
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
        ahead: &RouteAheadAt<'_>,
    ) -> Result<(), ZoneError> {
        let ego_from_world = world_from_ego.inverse();
        let n_confirming = self.config.n_confirming as usize;
        let mut confirmed = Vec::new();
        for i in 0..sample.seen.len() {
            let seen = sample.seen[i];
            let track = Track::of(&sample, i, self.history.iter(), &self.config);
            let velocity_mps = track.velocity_mps();
            let stands = velocity_mps.map(|[x_mps, y_mps]| x_mps.hypot(y_mps) < self.config.moving_mps);
            let mut is_sure =
                seen.is_sure && track.n_alarming_before(|earlier| earlier.is_sure) + 1 >= n_confirming;
            let hazard_at = if seen.is_harmful {
                let n_before = |counts: fn(&Seen) -> bool| {
                    self.n_harmful_before(&sample.seen, i, counts).max(track.n_alarming_before(counts))
                };
                is_sure = seen.is_sure && n_before(|earlier| earlier.is_sure) + 1 >= n_confirming;
                (n_before(|_| true) + 1 >= n_confirming).then_some(seen.at)
            } else if stands == Some(true) {
                let is_confirmed = track.n_alarming_before(|_| true) + 1 >= n_confirming;
                let is_blocked = ahead.is_blocked_by(&seen.at, &seen.at.in_frame(&ego_from_world))?;
                sample.seen[i].meets = is_blocked;
                (is_blocked && is_confirmed).then_some(seen.at)
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
                // A velocity that two boxes give is an error more often than the boxes are.
                let is_confirmed = if seen.velocity_mps.is_some() {
                    is_sure = seen.is_sure;
                    track.is_seen_in(n_confirming)
                } else {
                    track.n_alarming_before(|_| true) + 1 >= n_confirming
                };
                sample.seen[i].meets = met.is_some();
                met.filter(|_| is_confirmed).map(|met| met.in_frame(world_from_ego))
            };
            confirmed.extend(hazard_at.map(|at| Hazard {
                at,
                confirmed_s: sample.due_s,
                n_confirmed: 1,
                stands,
                is_sure,
                is_seen: true,
                places: VecDeque::new(),
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
    fn n_harmful_before(&self, seen: &[Seen], i: usize, counts: impl Fn(&Seen) -> bool) -> usize {
        let is_own = |earlier: &&Seen| {
            let here_m = apart_m(&earlier.at, &seen[i].at);
            let others = seen.iter().enumerate().filter(|(j, other)| *j != i && other.is_harmful);
            earlier.is_harmful
                && counts(earlier)
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

    fn braking_mps2(&self, gap_m: f64, speed_mps: f64, is_sure: bool) -> f64 {
        if speed_mps < STANDS_MPS {
            return HOLDING_MPS2;
        }
        let [least, most] = self.config.braking_mps2;
        let room_m = (gap_m - self.config.margin_m).max(0.0);
        let most = if is_sure { most } else { self.config.partial_mps2.clamp(least, most) };
        (speed_mps * speed_mps / (2.0 * room_m)).clamp(least, most)
    }
}

#[cfg(test)]
mod tests;
