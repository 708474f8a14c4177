//! The light that comes back from one ray.

/// What sent a return back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reflector {
    Target,
    Fog,
    Rain,
}

/// Light that comes back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Echo {
    pub reflector: Reflector,
    /// In units of a target with reflectivity 1 at 1 m.
    pub power: f64,
    pub range_m: f64,
}
