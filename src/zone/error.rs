//! What can be wrong with a zone's config, or with the state or box it is applied to.

use thiserror::Error;

use crate::config::InvalidConfig;
use crate::geometry::BoxError;

/// Why there is no zone, or no verdict.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ZoneError {
    #[error("the zone's {0}")]
    Config(#[from] InvalidConfig),
    #[error("the ego's {field} is {found}; a finite number is needed")]
    StateNotFinite { field: &'static str, found: f64 },
    #[error("the ego's {field} is {found}; a number above zero is needed")]
    StateNotPositive { field: &'static str, found: f64 },
    #[error("the zone's depth comes out as {depth_m} m at {speed_mps} m/s; a finite depth is needed")]
    Depth { depth_m: f64, speed_mps: f64 },
    #[error("the ego's steering_angle_rad is {found}; a car that drives on needs less than a right angle")]
    Steering { found: f64 },
    #[error(
        "at steering_angle_rad {steering_angle_rad} the ego turns on a radius of {radius_m} m; the zone's width needs \
         more than {needed_m} m"
    )]
    Radius { steering_angle_rad: f64, radius_m: f64, needed_m: f64 },
    #[error(
        "the zone would bend along {along_m} m with a curvature of {curvature_per_m} per metre; a speed, a wheelbase and a bumper of a \
         car are needed"
    )]
    Bend { along_m: f64, curvature_per_m: f64 },
    #[error(
        "the ego and the object close in at up to {closing_mps} m/s, too fast for a forecast over {horizon_s} s"
    )]
    Closing { closing_mps: f64, horizon_s: f64 },
    #[error(
        "the object's velocity is {found:?} m/s; `ttc` and `rss` need finite numbers, `rect` and `arc` need no velocity"
    )]
    Velocity { found: [f64; 2] },
    #[error("only zone `rect` has an edge to measure a distance to; hard rules take every zone")]
    NoEdge,
    #[error("{0}")]
    Box(#[from] BoxError),
    #[error(
        "footprint and overlap come out as {footprint_area_m2} and {overlap_area_m2} m²; finite areas are needed"
    )]
    Overlap { footprint_area_m2: f64, overlap_area_m2: f64 },
}
