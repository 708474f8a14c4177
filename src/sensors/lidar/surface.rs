//! How much light a surface sends back to where it came from, by its finish and the angle of incidence.
//!
//! All factors are 1 at right angles, where a surface of reflectivity 1 counts as a white Lambertian target.
//!
//! - matt: Lambert's cos(i).
//! - rough: Oren and Nayar 1994 with light and eye in one place, cos(i) + B / A sin(i)^2, for facets that spread by 30 degrees:
//!   A = 0.773, B = 0.339. Asphalt, masonry and plants stay bright at grazing angles (Tan and Cheng 2016 correct
//!   laser scans so).
//! - glossy: clear coat and metal send little back but near right angles, where they mirror: 0.5 cos(i) + 0.5 exp(-(i / 10 degrees)^2).
//! - retro: plates, signs and reflectors keep their strength to about 50 degrees: min(1, 1.5 cos(i)).
//!
//! Leaves are rough, and no skin: a beam goes some way among them before one stops it ([`way_among_leaves_m`]).

/// What kind of surface a beam meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Finish {
    /// Cloth, skin, cardboard, plastic.
    #[default]
    Matt,
    /// Ground, masonry, bark.
    Rough,
    /// The outside of a tuft of leaves.
    Leafy,
    /// Paint with a clear coat, and metal.
    Glossy,
    /// A window: most beams go through and do not come back.
    Glass,
    Retro,
}

/// B over A of Oren and Nayar's model at a spread of 30 degrees.
const ROUGHNESS: f64 = 0.339 / 0.773;
const GLOSS_RAD: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Width of the pulse on the way there: half of 5 ns at the speed of light.
const PULSE_M: f64 = 0.75;
/// Full angle of the beam.
const DIVERGENCE_RAD: f64 = 3e-3;
/// Area of leaves in a cubic metre of hedges and the outer crown, one side each: 8 m2 (4 to 12 in hedges and street trees).
const LEAF_AREA_PER_M: f64 = 8.0;
/// Share of it that a beam meets, leaves lying in all directions (Ross 1981, "The radiation regime and architecture of plant
/// stands").
const LEAVES_MET: f64 = 0.5;
/// Tufts of leaves are not deeper.
pub const TUFT_M: f64 = 0.6;

impl Finish {
    /// The part of the light at right angles that comes back under this cosine of incidence.
    pub(super) fn factor(self, cos_incidence: f64) -> f64 {
        let cos = cos_incidence.clamp(0.0, 1.0);
        match self {
            Self::Matt => cos,
            Self::Rough | Self::Leafy => cos + ROUGHNESS * (1.0 - cos * cos),
            Self::Glossy | Self::Glass => 0.5 * cos + 0.5 * (-(cos.acos() / GLOSS_RAD).powi(2)).exp(),
            Self::Retro => (1.5 * cos).min(1.0),
        }
    }
}

/// What a pulse's peak keeps when the beam's spot lies over a stretch of ranges: 1 / sqrt(1 + (depth / pulse)^2), the depth
/// being range * divergence * tan(i).
pub(super) fn peak_kept(range_m: f64, cos_incidence: f64) -> f64 {
    let cos = cos_incidence.clamp(1e-3, 1.0);
    let depth = range_m * DIVERGENCE_RAD * (1.0 - cos * cos).sqrt() / cos / PULSE_M;
    (1.0 + depth * depth).sqrt().recip()
}

/// How far a beam goes among leaves until one sends it back, by Beer and Lambert's law, given that one does within `depth_m`:
/// less than w with probability (1 - exp(-4 w)) / (1 - exp(-4 `depth_m`)), 4 / m being 0.5 * 8 / m; 0 where the depth is 0.
/// `draw` is even from 0 to 1.
pub(super) fn way_among_leaves_m(draw: f64, depth_m: f64) -> f64 {
    let met_per_m = LEAVES_MET * LEAF_AREA_PER_M;
    let met_at_all = 1.0 - (-met_per_m * depth_m).exp();
    -(1.0 - draw * met_at_all).ln() / met_per_m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_finish_is_one_at_right_angles_and_never_brightens_from_there() {
        for finish in [Finish::Matt, Finish::Glossy, Finish::Glass, Finish::Retro] {
            assert!((finish.factor(1.0) - 1.0).abs() < 1e-12, "{finish:?}");
            let factors: Vec<f64> = (0..=100).map(|i| finish.factor(f64::from(i) / 100.0)).collect();
            assert!(factors.is_sorted(), "{finish:?}");
        }
        assert_eq!([Finish::Rough, Finish::Leafy].map(|finish| finish.factor(1.0)), [1.0; 2]);
    }

    #[test]
    fn half_of_the_beams_stop_within_fifteen_centimetres_of_leaves_and_all_within_a_tuft() {
        assert_eq!(way_among_leaves_m(0.0, TUFT_M), 0.0);
        assert!((way_among_leaves_m(1.0, TUFT_M) - TUFT_M).abs() < 1e-9);
        // 1 - exp(-4 * 0.15) = 0.451, of the 0.909 that stop within a tuft: 0.496.
        assert!((way_among_leaves_m(0.496, TUFT_M) - 0.15).abs() < 0.002);
        // Thin ones send nearly as many back from the back as from the front.
        assert!((way_among_leaves_m(1.0, 0.1) - 0.1).abs() < 1e-9);
        assert!((0.04..0.05).contains(&way_among_leaves_m(0.5, 0.1)) && way_among_leaves_m(0.7, 0.0) == 0.0);
    }

    #[test]
    fn a_road_at_fifteen_metres_is_four_times_as_bright_as_lamberts() {
        // A sensor at 1.73 m: cos(i) = 0.115.
        let ratio = Finish::Rough.factor(0.115) / Finish::Matt.factor(0.115);
        assert!((4.0..5.5).contains(&ratio), "{ratio}");
        assert!(Finish::Glossy.factor(0.7) < 0.4);
    }

    #[test]
    fn grazing_pulses_are_smeared_and_upright_ones_are_not() {
        assert_eq!(peak_kept(80.0, 1.0), 1.0);
        // 40 m * 3 mrad * 23.1 = 2.77 m of 0.75 m.
        assert!((peak_kept(40.0, 1.73 / 40.0) - 0.261).abs() < 0.005, "{}", peak_kept(40.0, 1.73 / 40.0));
    }
}
