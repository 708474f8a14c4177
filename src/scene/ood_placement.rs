//! Where out-of-distribution objects stand, as shares of them.

use crate::config::{InvalidConfig, SHARE, define_config, from_to, require};
use crate::object::Spot;

define_config! {
    /// Shares of the out-of-distribution objects that no event sets in motion; those that are left stand beside the road.
    pub struct OodPlacementConfig {
        /// In the ego's lane, or partly in it.
        lane_share: f64 = 0.025, in SHARE;
        /// At a junction: in its mouth, on the way through it or at its far side, in the lane or at the corner.
        junction_share: f64 = 0.07, in SHARE;
        /// In a bend, in the lane or on one of its sides.
        bend_share: f64 = 0.04, in SHARE;
        /// On a pedestrian crossing.
        crossing_share: f64 = 0.03, in SHARE;
        /// Half hidden behind a parked car, a post, a tree or the corner of a house.
        behind_share: f64 = 0.27, in SHARE;
        /// Share of those that stand on the ground that lie on a side.
        tipped_share: f64 = 0.3, in SHARE;
        /// Share of the events in which a thing comes out from behind a parked vehicle, if there is one.
        emerge_share: f64 = 0.4, in SHARE;
        /// Share of those on the road that the ego's driver notices late.
        late_share: f64 = 0.3, in SHARE;
        /// How hard the ego must then brake to stop before them, m/s²: least, most.
        late_braking_mps2: [f64; 2] = [3.0, 6.0], in from_to(0.5, 7.0).pair();
    }
}

/// Refuses shares of one whole that are more than it.
///
/// # Errors
/// Names the part of the config, and the shares.
pub(super) fn check_sum(part: &str, names: &str, shares: &[f64]) -> Result<(), InvalidConfig> {
    let found = format!("{shares:?} as shares of {names}");
    require(shares.iter().sum::<f64>() <= 1.0 + 1e-9, part, found, "at most 1 in sum is needed")
}

impl OodPlacementConfig {
    /// Whether the places leave something for the side of the road.
    ///
    /// # Errors
    /// The shares of the places are more than one in sum.
    pub fn check_shares(&self) -> Result<(), InvalidConfig> {
        let shares = self.shares().map(|(_, share)| share);
        check_sum("ood_placement", "lane, junction, bend, crossing and behind", &shares)
    }

    /// The place for a draw from 0 to 1.
    pub(super) fn spot(&self, draw: f64) -> Spot {
        let mut below = 0.0;
        let found = self.shares().into_iter().find(|(_, share)| {
            below += share;
            draw < below
        });
        found.map_or(Spot::Beside, |(spot, _)| spot)
    }

    fn shares(&self) -> [(Spot, f64); 5] {
        [
            (Spot::Lane, self.lane_share),
            (Spot::Junction, self.junction_share),
            (Spot::Bend, self.bend_share),
            (Spot::Crossing, self.crossing_share),
            (Spot::Behind, self.behind_share),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_draw_finds_its_place_and_too_large_shares_are_told() {
        let config =
            OodPlacementConfig { lane_share: 0.5, junction_share: 0.25, ..OodPlacementConfig::default() };
        assert_eq!(config.spot(0.49), Spot::Lane);
        assert_eq!(config.spot(0.51), Spot::Junction);
        assert!(config.check_shares().unwrap_err().to_string().contains("0.5, 0.25"));
        let alone = OodPlacementConfig {
            lane_share: 0.0,
            junction_share: 0.0,
            bend_share: 0.0,
            crossing_share: 0.0,
            behind_share: 0.2,
            ..OodPlacementConfig::default()
        };
        assert_eq!((alone.spot(0.1), alone.spot(0.3)), (Spot::Behind, Spot::Beside));
        assert!(alone.check_shares().is_ok());
    }
}
