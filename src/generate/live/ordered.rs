//! What a drive of the driver under test asks of its world.

use super::LiveEpisode;
use crate::scene::{Motion, Vec2};

impl LiveEpisode<'_> {
    /// How far the ego would have come after each of so many control steps from where it is, with nothing in its way and all
    /// lights green, metres.
    #[must_use]
    pub fn free_way_m(&self, n_steps: usize) -> Vec<f64> {
        self.drive.free_way_m(n_steps)
    }

    /// The ego's route over ground, from its bumper on: points so far apart, metres.
    #[must_use]
    pub fn route_ahead(&self, length_m: f64, step_m: f64) -> Vec<Vec2> {
        self.drive.route_ahead(length_m, step_m)
    }

    /// Objects that the ego's coming has set off, by number: what falls, rolls, is thrown or dashes.
    pub fn set_off(&self) -> impl Iterator<Item = usize> {
        self.drive.set_off()
    }

    /// Whether the ego stands at the line of a light or a junction that does not let it through yet.
    #[must_use]
    pub fn ego_waits_at_line(&self) -> bool {
        self.drive.ego_waits_at_line()
    }

    /// Whether an object drives or walks, and may go away.
    #[must_use]
    pub fn moves_by_itself(&self, object_idx: usize) -> bool {
        match self.world.placements[object_idx].motion {
            Motion::Drives { .. } | Motion::Walks(_) | Motion::Follows(_) => true,
            Motion::Dashes(_) => self.drive.is_under_way(object_idx),
            Motion::Still | Motion::Loose(_) => false,
        }
    }
}
