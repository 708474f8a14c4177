//! Danger zone: the ground that the ego will soon need, and which objects meet it.
//!
//! Each kind of zone is a file with one `ZoneRule` and a line in `kinds.rs`. Metres, radians, ego frame. Nothing here
//! reads a file, a clock or a random number. `docs/zones.md` has the formulas and compares the zones.

mod arc;
mod config;
mod corridor;
mod course;
mod error;
mod kinds;
mod rect;
mod rss;
mod rule;
#[cfg(test)]
mod tests;
mod ttc;

pub use config::{BodyConfig, RssConfig, TtcConfig, ZoneConfig};
pub use error::ZoneError;
pub use kinds::ZoneKind;

use self::rule::{Meeting, Seen, ZoneRule};
use crate::config::Check;
use crate::geometry::{Box3, Ego, Point2, convex_signed_distance_m};
use crate::object::{Harm, Object};
use crate::sample::EgoState;

/// A checked zone.
///
/// ```
/// use harmzone::geometry::{Box3, Point};
/// use harmzone::object::Harm;
/// use harmzone::sample::EgoState;
/// use harmzone::zone::{Zone, ZoneConfig};
///
/// // The paper's rectangle. At 10 m/s it is 25 m deep and 3.5 m wide, from the bumper on.
/// let zone = Zone::try_from(ZoneConfig::default())?;
/// let ego = EgoState {
///     speed_mps: 10.0,
///     steering_angle_rad: 0.0,
///     yaw_rate_rps: 0.0,
///     acceleration_mps2: 0.0,
///     wheelbase_m: 2.7,
///     front_bumper_x_m: 3.6,
/// };
/// let here = zone.at(&ego)?;
/// assert_eq!(here.corners()[2].x_m, 28.6);
///
/// // A box of half a metre, 20 m ahead: in the lane it is harmful, 3 m to the left it is not.
/// let mut crate_ahead =
///     Box3 { center: Point::new(20.0, 0.0, 0.25), length_m: 0.5, width_m: 0.5, height_m: 0.5, yaw_rad: 0.0 };
/// let standing = [0.0, 0.0];
/// assert_eq!(here.harm_of(&crate_ahead, standing)?.harm, Harm::Harmful);
/// crate_ahead.center = Point::new(20.0, 3.0, 0.25);
/// assert_eq!(here.harm_of(&crate_ahead, standing)?.harm, Harm::Harmless);
/// # Ok::<(), harmzone::zone::ZoneError>(())
/// ```
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
        let rule = (self.entry().at)(&self.config, ego)?;
        Ok(ZoneAt { rule, max_clearance_m: self.config.max_clearance_m })
    }

    /// The steering angle at which the zone's axis leads to a point on the ground.
    #[must_use]
    pub fn steering_towards_rad(&self, ego: &EgoState, to: Point2) -> f64 {
        (self.entry().steering_towards_rad)(ego, to)
    }

    /// The zone at a speed in a few words, for a legend.
    #[must_use]
    pub fn describe(&self, speed_mps: f64) -> String {
        (self.entry().describe)(&self.config, speed_mps)
    }
}

type BoxedRule = Result<Box<dyn ZoneRule>, ZoneError>;

/// A kind's functions that need no instance of its rule.
struct Entry {
    at: fn(&ZoneConfig, &EgoState) -> BoxedRule,
    describe: fn(&ZoneConfig, f64) -> String,
    steering_towards_rad: fn(&EgoState, Point2) -> f64,
}

impl Entry {
    fn of<R: ZoneRule + 'static>() -> Self {
        Self {
            at: |config, ego| Ok(Box::new(R::at(config, ego)?)),
            describe: R::describe,
            steering_towards_rad: R::steering_towards_rad,
        }
    }
}

macro_rules! define_entries {
    ($($(#[$attribute:meta])* $Kind:ident = ($name:literal, $Rule:path),)*) => {
        impl Zone {
            fn entry(&self) -> Entry {
                match self.config.kind { $(ZoneKind::$Kind => Entry::of::<$Rule>(),)* }
            }
        }
    };
}
kinds::for_each_zone!(define_entries);

/// The zone at one instant: ground in the ego frame, and the rule by which objects there are harmful.
#[derive(Debug)]
pub struct ZoneAt {
    rule: Box<dyn ZoneRule>,
    max_clearance_m: f64,
}

/// The zone's verdict on one box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    pub harm: Harm,
    /// Area that the box's footprint shares now with the zone, square metres; for `rss`, with the zone of the
    /// object's own velocity.
    pub overlap_area_m2: f64,
    /// `overlap_area_m2` over the footprint's area, 0 to 1.
    pub overlap_ratio: f64,
    /// For `ttc`: seconds until contact, if it comes within the horizon; `None` for what hangs above.
    pub time_to_collision_s: Option<f64>,
}

impl ZoneAt {
    /// The zone's outline in the ego frame, counter-clockwise from the near right corner: four corners of `rect`; of the
    /// others out along the right side and back along the left, equally many on each, not convex in a turn.
    /// `rss` draws the zone of an object that stands.
    #[must_use]
    pub fn corners(&self) -> &[Point2] {
        self.rule.outline()
    }

    /// The outline as an edge to measure distances to; it must be convex, so only `rect` has one. The others
    /// bend, and what `ttc` and `rss` say about an object is not a distance to one edge.
    #[must_use]
    pub fn edge(&self) -> Option<&[Point2]> {
        self.rule.edge()
    }

    /// Whether an object's velocity counts, as with `ttc` and `rss`.
    #[must_use]
    pub fn uses_velocity(&self) -> bool {
        self.rule.uses_velocity()
    }

    /// Signed distance of a box's footprint to [`Self::edge`], metres: the gap, or minus the least shift that would part
    /// them.
    ///
    /// # Errors
    /// [`ZoneError::NoEdge`] if the zone has no such edge.
    pub fn edge_distance_m(&self, box_in_ego: &Box3<Ego>) -> Result<f64, ZoneError> {
        let edge = self.edge().ok_or(ZoneError::NoEdge)?;
        Ok(convex_signed_distance_m(edge, &box_in_ego.footprint()))
    }

    /// Whether a true object is harmful: by the footprint of what is solid of it, and its height above the ground under
    /// it. Otherwise as [`Self::harm_of`].
    ///
    /// # Errors
    /// As [`Self::harm_of`].
    pub fn harm_of_object(&self, object: &Object) -> Result<Verdict, ZoneError> {
        let clearance_m = object.clearance_m.unwrap_or_else(|| object.box_in_ego.bottom_m());
        self.judge(&object.solid_in_ego(), object.velocity_in_ego_mps, clearance_m)
    }

    /// Whether a box is harmful; `velocity_in_ego_mps` is over ground in the ego's axes, and only `ttc` and `rss` use it.
    /// A box that lies higher than `max_clearance_m` above the ego's plane, z = 0, is harmless.
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
        self.judge(box_in_ego, velocity_in_ego_mps, box_in_ego.bottom_m())
    }

    fn judge(
        &self,
        box_in_ego: &Box3<Ego>,
        velocity_in_ego_mps: [f64; 2],
        clearance_m: f64,
    ) -> Result<Verdict, ZoneError> {
        box_in_ego.check()?;
        if self.rule.uses_velocity() && !velocity_in_ego_mps.iter().all(|part| part.is_finite()) {
            return Err(ZoneError::Velocity { found: velocity_in_ego_mps });
        }
        let object = Seen { box_in_ego, velocity_mps: velocity_in_ego_mps };
        let footprint_area_m2 = object.area_m2();
        let overlap_area_m2 = self.rule.overlap_m2(&object)?;
        let overlap_ratio = overlap_area_m2 / footprint_area_m2;
        if !footprint_area_m2.is_finite() || !overlap_ratio.is_finite() {
            return Err(ZoneError::Overlap { footprint_area_m2, overlap_area_m2 });
        }
        if self.max_clearance_m > 0.0 && clearance_m > self.max_clearance_m {
            let harm = Harm::Harmless;
            return Ok(Verdict { harm, overlap_area_m2, overlap_ratio, time_to_collision_s: None });
        }
        let time_to_collision_s = self.rule.time_to_collision_s(&object)?;
        let meeting = Meeting { overlap_area_m2, overlap_ratio, time_to_collision_s };
        let harm = if self.rule.is_harmful(&meeting) { Harm::Harmful } else { Harm::Harmless };
        Ok(Verdict { harm, overlap_area_m2, overlap_ratio, time_to_collision_s })
    }
}
