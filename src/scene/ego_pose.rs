//! Where the ego is, and the ground that it takes.

use super::car::{EGO_LENGTH_M, EGO_WIDTH_M, FRONT_BUMPER_X_M};
use super::driving::{Obstacle, Owner};
use super::occupancy::Footprint;
use super::path::{Vec2, direction_of};

/// Pose and speed of the ego as the simulator reports them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoPose {
    pub position: Vec2,
    pub yaw_rad: f64,
    pub speed_mps: f64,
    /// Sine of the slope that it stands on, positive uphill.
    pub grade: f64,
}

impl EgoPose {
    pub fn direction(&self) -> Vec2 {
        direction_of(self.yaw_rad)
    }

    pub fn obstacle(&self) -> Obstacle {
        let center = self.position + self.direction() * (FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0);
        Obstacle {
            owner: Owner::Ego,
            footprint: Footprint {
                center,
                yaw_rad: self.yaw_rad,
                length_m: EGO_LENGTH_M,
                width_m: EGO_WIDTH_M,
            },
            velocity_mps: self.direction() * self.speed_mps,
            is_still: false,
            is_vehicle: true,
            backs_up: false,
        }
    }
}
