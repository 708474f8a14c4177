//! The way of a mover that the ego's coming sets off.

use super::route::Route;

/// How fast it goes, how far, and from when on.
#[derive(Debug, Clone)]
pub struct Dash {
    pub speed_mps: f64,
    pub way_m: f64,
    /// It sets out when the ego is so near.
    pub trigger_m: f64,
    /// A route, the station where it stands and the offset to the left; `None`: straight on.
    pub on_route: Option<(Route, f64, f64)>,
}
