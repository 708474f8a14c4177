//! Danger zone: the ground the ego will soon need, and which objects meet it.
//!
//! - `rect`: `depth_m = time_gap_s * max(speed_mps, 0) + min_safe_distance_m`; the rectangle begins at the middle of the
//!   front bumper `p0 = (front_bumper_x_m, 0)` and runs along `u = (cos s, sin s)`, `s` the steering angle, with
//!   `n = (-sin s, cos s)` to its left (paper, section on the danger zone).
//! - `arc`: what a bar across the bumper, as wide as the rectangle, sweeps while the rear axle runs `depth_m` along the
//!   arc of curvature `tan s / wheelbase`.
//! - `ttc`, `rss`: contact within a time, distances that are not safe; their rules stand in their files.
//!
//! Metres, radians, ego frame. Nothing here reads a file, a clock or a random number. `docs/zones.md` compares them.

mod config;
mod corridor;
mod course;
mod rss;
#[cfg(test)]
mod tests;
mod ttc;

pub use config::{BodyConfig, RssConfig, TtcConfig, ZoneConfig, ZoneError, ZoneKind};

use self::corridor::{Body, Corridor};
use self::course::Course;
use self::rss::SafeDistances;
use crate::geometry::{Box3, Ego, Point2, convex_overlap_area, convex_signed_distance_m};
use crate::object::Harm;
use crate::sample::EgoState;

/// Shared ground from which `rss` takes two shapes to meet, square metres: above rounding.
const MEETING_M2: f64 = 1e-6;

/// A checked zone rule: every number finite and above zero.
#[derive(Debug, Clone, PartialEq)]
pub struct Zone {
    config: ZoneConfig,
}

impl TryFrom<ZoneConfig> for Zone {
    type Error = ZoneError;

    fn try_from(config: ZoneConfig) -> Result<Self, ZoneError> {
        config.check()?;
        Ok(Self { config })
    }
}

impl Zone {
    /// The config it was made from.
    #[must_use]
    pub fn config(&self) -> &ZoneConfig {
        &self.config
    }

    /// The zone for one state of the ego. A car that rolls backwards keeps the safe distance alone.
    ///
    /// # Errors
    /// Speed, steering angle or bumper is not finite, or the bumper is not ahead of the rear axle. All but `rect`: the
    /// wheelbase is not above zero, or the ego turns so sharply that the zone would reach the centre of the turn.
    pub fn at(&self, ego: &EgoState) -> Result<ZoneAt, ZoneError> {
        let fields = [
            ("speed_mps", ego.speed_mps),
            ("steering_angle_rad", ego.steering_angle_rad),
            ("front_bumper_x_m", ego.front_bumper_x_m),
        ];
        for (field, found) in fields {
            if !found.is_finite() {
                return Err(ZoneError::StateNotFinite { field, found });
            }
        }
        if ego.front_bumper_x_m <= 0.0 {
            let found = ego.front_bumper_x_m;
            return Err(ZoneError::StateNotPositive { field: "front_bumper_x_m", found });
        }
        let config = &self.config;
        let rule = match config.kind {
            ZoneKind::Rect => Rule::Rect { corners: self.rect(ego)? },
            ZoneKind::Arc => {
                let course = Course::of(ego)?;
                let along_m = course.limited_m(self.depth_m(ego)?, self.max_turn_rad());
                let half_width_m = config.width_m / 2.0;
                Rule::Arc { swept: Corridor::of_bar(&course, ego.front_bumper_x_m, half_width_m, along_m)? }
            }
            ZoneKind::Ttc => {
                let (course, body) = (Course::of(ego)?, self.body(ego));
                let horizon_m = ego.speed_mps.abs() * config.ttc.horizon_s;
                let along_m = course.limited_m(horizon_m, self.max_turn_rad());
                if !along_m.is_finite() {
                    return Err(ZoneError::Depth { depth_m: along_m, speed_mps: ego.speed_mps });
                }
                // A course that ends by its turn ends the forecast too.
                let share = if horizon_m > 0.0 { along_m / horizon_m } else { 1.0 };
                let swept =
                    Corridor::of_body(&course, &body, if ego.speed_mps > 0.0 { along_m } else { 0.0 })?;
                Rule::Ttc {
                    swept,
                    course,
                    body,
                    speed_mps: ego.speed_mps,
                    horizon_s: share * config.ttc.horizon_s,
                }
            }
            ZoneKind::Rss => {
                let needs = RssNeeds {
                    course: Course::of(ego)?,
                    body: self.body(ego),
                    speed_mps: ego.speed_mps,
                    config: config.rss,
                    max_turn_rad: self.max_turn_rad(),
                };
                Rule::Rss { standing: needs.corridor(0.0, 0.0)?, needs }
            }
        };
        let (min_overlap_area_m2, min_overlap_ratio) = (config.min_overlap_area_m2, config.min_overlap_ratio);
        Ok(ZoneAt { rule, min_overlap_area_m2, min_overlap_ratio })
    }

    /// The steering angle at which the zone's axis leads to a point on the ground.
    #[must_use]
    pub fn steering_towards_rad(&self, ego: &EgoState, to: Point2) -> f64 {
        match self.config.kind {
            ZoneKind::Rect => to.y_m.atan2(to.x_m - ego.front_bumper_x_m),
            ZoneKind::Arc | ZoneKind::Ttc | ZoneKind::Rss => Course::steering_towards_rad(ego, to),
        }
    }

    fn depth_m(&self, ego: &EgoState) -> Result<f64, ZoneError> {
        let depth_m = self.config.time_gap_s * ego.speed_mps.max(0.0) + self.config.min_safe_distance_m;
        if depth_m.is_finite() {
            Ok(depth_m)
        } else {
            Err(ZoneError::Depth { depth_m, speed_mps: ego.speed_mps })
        }
    }

    /// The paper's rectangle, counter-clockwise from the near right corner.
    fn rect(&self, ego: &EgoState) -> Result<[Point2; 4], ZoneError> {
        let depth_m = self.depth_m(ego)?;
        let (sin, cos) = ego.steering_angle_rad.sin_cos();
        let half_width_m = self.config.width_m / 2.0;
        let corner = |along_m: f64, left_m: f64| Point2 {
            x_m: ego.front_bumper_x_m + along_m * cos - left_m * sin,
            y_m: along_m * sin + left_m * cos,
        };
        Ok([
            corner(0.0, -half_width_m),
            corner(depth_m, -half_width_m),
            corner(depth_m, half_width_m),
            corner(0.0, half_width_m),
        ])
    }

    fn body(&self, ego: &EgoState) -> Body {
        let half_width_m = self.config.body.width_m / 2.0;
        Body {
            front_m: ego.front_bumper_x_m,
            rear_m: self.config.body.rear_overhang_m,
            left_m: half_width_m,
            right_m: half_width_m,
        }
    }

    fn max_turn_rad(&self) -> f64 {
        self.config.max_turn_deg.to_radians()
    }
}

/// The zone at one instant: ground in the ego frame, and the rule by which objects there are harmful.
#[derive(Debug, Clone, PartialEq)]
pub struct ZoneAt {
    rule: Rule,
    min_overlap_area_m2: f64,
    min_overlap_ratio: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Rule {
    Rect {
        corners: [Point2; 4],
    },
    Arc {
        swept: Corridor,
    },
    Ttc {
        /// What the body sweeps within the horizon.
        swept: Corridor,
        course: Course,
        body: Body,
        speed_mps: f64,
        horizon_s: f64,
    },
    Rss {
        /// Where an object that stands is harmful.
        standing: Corridor,
        needs: RssNeeds,
    },
}

/// What `rss` needs to know of the ego.
#[derive(Debug, Clone, Copy, PartialEq)]
struct RssNeeds {
    course: Course,
    body: Body,
    speed_mps: f64,
    config: RssConfig,
    max_turn_rad: f64,
}

impl RssNeeds {
    /// The ground nearer than both safe distances, for an object of this velocity in the course's directions.
    fn corridor(&self, along_mps: f64, leftward_mps: f64) -> Result<Corridor, ZoneError> {
        let Self { course, body, speed_mps, config, max_turn_rad } = self;
        let safe = SafeDistances::of(config, *speed_mps, along_mps, leftward_mps);
        if !safe.ahead_m.is_finite() {
            return Err(ZoneError::Depth { depth_m: safe.ahead_m, speed_mps: *speed_mps });
        }
        // Across the turn's centre there is no more aside; the body itself must fit, or the corridor says so.
        let room_m = course.room_inside_m() - 1e-9;
        let widened = |half_m: f64, by_m: f64, is_inside: bool| {
            if is_inside { f64::max(half_m, f64::min(half_m + by_m, room_m)) } else { half_m + by_m }
        };
        let turns_left = course.curvature_per_m >= 0.0;
        let wide = Body {
            left_m: widened(body.left_m, safe.left_m, turns_left),
            right_m: widened(body.right_m, safe.right_m, !turns_left),
            ..*body
        };
        Corridor::of_body(course, &wide, course.limited_m(safe.ahead_m, *max_turn_rad))
    }

    /// The same for a velocity in the ego's axes, of an object at a place.
    fn corridor_for(&self, at: Point2, [vx_mps, vy_mps]: [f64; 2]) -> Result<Corridor, ZoneError> {
        let [along_x, along_y] = self.course.direction_at(at);
        self.corridor(vx_mps * along_x + vy_mps * along_y, vy_mps * along_x - vx_mps * along_y)
    }
}

/// What the zone says of one box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    pub harm: Harm,
    /// Area that the box's footprint shares now with the zone, square metres; of `rss`, with the zone of the object's own
    /// velocity.
    pub overlap_area_m2: f64,
    /// That area over the footprint's own, 0 to 1.
    pub overlap_ratio: f64,
    /// Of `ttc`: seconds until contact, where it comes within the horizon.
    pub time_to_collision_s: Option<f64>,
}

impl ZoneAt {
    /// The zone's outline in the ego frame, counter-clockwise from the near right corner: four corners of `rect`; of the
    /// others out along the right side and back along the left, as many on each, not convex in a turn. `rss` draws the
    /// zone of an object that stands.
    #[must_use]
    pub fn corners(&self) -> &[Point2] {
        match &self.rule {
            Rule::Rect { corners } => corners,
            Rule::Arc { swept } | Rule::Ttc { swept, .. } => swept.outline(),
            Rule::Rss { standing, .. } => standing.outline(),
        }
    }

    /// Signed distance of a box's footprint to the edge of `rect`, metres: the gap, or minus the least shift that would part
    /// them.
    ///
    /// # Errors
    /// [`ZoneError::NoEdge`] for the others: they bend, and what `ttc` and `rss` say of an object is no distance to one edge.
    pub fn edge_distance_m(&self, box_in_ego: &Box3<Ego>) -> Result<f64, ZoneError> {
        match &self.rule {
            Rule::Rect { corners } => Ok(convex_signed_distance_m(corners, &box_in_ego.footprint())),
            Rule::Arc { .. } | Rule::Ttc { .. } | Rule::Rss { .. } => Err(ZoneError::NoEdge),
        }
    }

    /// Whether a box is harmful; `velocity_in_ego_mps` is over ground in the ego's axes, and only `ttc` and `rss` use it.
    ///
    /// `rect`, `arc`: its footprint shares enough area, or enough of itself, with the zone. `ttc`: contact within the
    /// horizon. `rss`: its footprint meets the zone of its velocity.
    ///
    /// # Errors
    /// The box has a number that is not finite, a size that is not above zero, or is absurdly large; a velocity that is
    /// used is not finite.
    pub fn harm_of(
        &self,
        box_in_ego: &Box3<Ego>,
        velocity_in_ego_mps: [f64; 2],
    ) -> Result<Verdict, ZoneError> {
        box_in_ego.check()?;
        let uses_velocity = matches!(self.rule, Rule::Ttc { .. } | Rule::Rss { .. });
        if uses_velocity && !velocity_in_ego_mps.iter().all(|part| part.is_finite()) {
            return Err(ZoneError::Velocity { found: velocity_in_ego_mps });
        }
        let footprint = box_in_ego.footprint();
        let footprint_area_m2 = box_in_ego.length_m * box_in_ego.width_m;
        let overlap_area_m2 = match &self.rule {
            // The zone is clipped by the box, not the other way round: its corners stay exact beside a vast box.
            Rule::Rect { corners } => convex_overlap_area(corners, &footprint),
            Rule::Arc { swept } | Rule::Ttc { swept, .. } => swept.overlap_m2(&footprint),
            Rule::Rss { needs, .. } => {
                let at = Point2 { x_m: box_in_ego.center.x(), y_m: box_in_ego.center.y() };
                needs.corridor_for(at, velocity_in_ego_mps)?.overlap_m2(&footprint)
            }
        };
        let overlap_ratio = overlap_area_m2 / footprint_area_m2;
        if !footprint_area_m2.is_finite() || !overlap_ratio.is_finite() {
            return Err(ZoneError::Overlap { footprint_area_m2, overlap_area_m2 });
        }
        let mut time_to_collision_s = None;
        let is_harmful = match &self.rule {
            Rule::Rect { .. } | Rule::Arc { .. } => {
                overlap_area_m2 >= self.min_overlap_area_m2 || overlap_ratio >= self.min_overlap_ratio
            }
            Rule::Ttc { course, body, speed_mps, horizon_s, .. } => {
                let velocity_mps = velocity_in_ego_mps;
                time_to_collision_s =
                    ttc::time_to_collision_s(course, *speed_mps, body, box_in_ego, velocity_mps, *horizon_s);
                time_to_collision_s.is_some()
            }
            Rule::Rss { .. } => overlap_area_m2 > MEETING_M2,
        };
        let harm = if is_harmful { Harm::Harmful } else { Harm::Harmless };
        Ok(Verdict { harm, overlap_area_m2, overlap_ratio, time_to_collision_s })
    }
}
