//! What the driver under test asks of the traffic, and tells it.

use super::Traffic;
use crate::scene::{EgoOrders, Vec2};

impl Traffic {
    /// Has the ego driven by the driver under test, which knows nothing of objects, and tells it what perception orders.
    pub fn order(&mut self, orders: EgoOrders) {
        self.orders = Some(orders);
    }

    /// How far the ego would have come on its route after each of so many steps, from standing where it is, with nothing in
    /// its way and all lights green.
    pub fn free_way_m(&self, n_steps: usize, dt_s: f64) -> Vec<f64> {
        self.ego.free_way_m(n_steps, dt_s, &self.town.graph)
    }

    /// The ego's route over ground, from its bumper on: points so far apart, metres.
    pub fn route_ahead(&self, length_m: f64, step_m: f64) -> Vec<Vec2> {
        let (path, front_m) = (&self.ego.route.path, self.ego.front_m());
        let n_points = ((path.length_m() - front_m).min(length_m) / step_m).max(0.0) as usize;
        (0..n_points).map(|i| path.at(front_m + i as f64 * step_m)).collect()
    }

    /// Whether the ego stands at the line of a light or a junction that does not let it through.
    pub fn ego_waits_at_line(&self) -> bool {
        self.ego.waits_at_line()
    }
}
