//! How big people are: height by age and sex, build, and the sizes of the parts of a body.
//!
//! Heights: CDC growth charts for the United States (2000), median and spread, to 18 years; then those of Europe's adults
//! (NCD Risk Factor Collaboration 2020), with a loss of 0.6 mm a year from 40 years on. Lengths of segments as parts of the
//! height: Drillis and Contini 1966, as in Winter, Biomechanics and Motor Control of Human Movement. Children have longer heads and
//! shorter legs: a head is a fifth of the height at 2 years, and 2 in 15 of an adult's.

use rand::RngExt;

use crate::random::Rng;

/// Median heights of girls and boys at 1, 2, ... 18 years, metres.
const GIRLS_M: [f64; 18] = [
    0.742, 0.851, 0.942, 1.008, 1.075, 1.149, 1.214, 1.275, 1.328, 1.382, 1.437, 1.510, 1.572, 1.603, 1.618,
    1.624, 1.629, 1.634,
];
const BOYS_M: [f64; 18] = [
    0.757, 0.868, 0.952, 1.023, 1.090, 1.154, 1.219, 1.279, 1.334, 1.385, 1.433, 1.490, 1.561, 1.640, 1.700,
    1.735, 1.752, 1.762,
];
/// Median heights and standard deviations of adults.
const WOMEN_M: (f64, f64) = (1.655, 0.064);
const MEN_M: (f64, f64) = (1.785, 0.070);
/// Heights farther from the median than this many deviations are not drawn: the 2nd and the 98th percentile.
const MOST_DEVIATIONS: f64 = 2.05;

/// Oldest age that counts as a child in the data sets of real streets.
pub const CHILD_TO_YEARS: f64 = 15.0;

/// Median height and its standard deviation.
pub fn height_m(age_years: f64, is_female: bool) -> (f64, f64) {
    if age_years > 18.0 {
        let (median, deviation) = if is_female { WOMEN_M } else { MEN_M };
        return (median - 0.0006 * (age_years - 40.0).max(0.0), deviation);
    }
    let table = if is_female { &GIRLS_M } else { &BOYS_M };
    let at = (age_years - 1.0).clamp(0.0, 17.0);
    let (low, share) = ((at as usize).min(16), at - f64::from((at as u32).min(16)));
    let median = table[low] + share * (table[low + 1] - table[low]);
    (median, 0.041 * median)
}

/// A body's sizes in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    pub age_years: f64,
    pub is_female: bool,
    pub height_m: f64,
    pub mass_kg: f64,
    pub head_m: f64,
    pub hip_m: f64,
    pub thigh_m: f64,
    pub shank_m: f64,
    pub ankle_m: f64,
    pub foot_m: f64,
    /// From the hip's height to the shoulders'.
    pub trunk_m: f64,
    pub upper_arm_m: f64,
    pub forearm_m: f64,
    pub hand_m: f64,
    /// Half of the distances between the shoulders' and between the hips' joints.
    pub half_shoulders_m: f64,
    pub half_hips_m: f64,
    /// Factor on girths: 1 is a man of 1.75 m with a body mass index of 23.
    pub girth: f64,
    /// Factor on the waist's girth beside that.
    pub belly: f64,
}

/// A number with the given mean and deviation, within bounds on the deviations.
fn spread(mean: f64, deviation: f64, rng: &mut Rng) -> f64 {
    // The sum of four uniform numbers is near enough to a normal one.
    let sum: f64 = (0..4).map(|_| rng.random::<f64>() - 0.5).sum();
    mean + deviation * (sum * 3.0_f64.sqrt()).clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS)
}

impl Body {
    /// Draws a body of an age.
    pub fn draw(age_years: f64, is_female: bool, rng: &mut Rng) -> Self {
        let (median_m, deviation_m) = height_m(age_years, is_female);
        let height_m = spread(median_m, deviation_m, rng);
        // Body mass index: about 16 at 5 years, 25 among adults, who differ more.
        let grown = ((age_years - 6.0) / 14.0).clamp(0.0, 1.0);
        let index =
            spread(16.0 + 8.5 * grown, 1.2 + 2.6 * grown, rng) + grown * 2.5 * rng.random::<f64>().powi(3);
        let h = height_m;
        // 1 for small children, 0 for adults.
        let small = ((16.0 - age_years) / 14.0).clamp(0.0, 1.0).powf(1.2);
        let hip_share = spread(0.53 - 0.075 * small, 0.008, rng);
        let head_share = 0.131 + 0.068 * small;
        let shoulder_share = 0.818 - 0.055 * small;
        let ankle_m = 0.045 * h;
        let leg_m = hip_share * h - ankle_m;
        let sex = if is_female { 1.0 - small } else { 0.0 };
        Self {
            age_years,
            is_female,
            height_m,
            mass_kg: index * h * h,
            head_m: head_share * h,
            hip_m: hip_share * h,
            thigh_m: 0.5 * leg_m,
            shank_m: 0.5 * leg_m,
            ankle_m,
            foot_m: 0.152 * h,
            trunk_m: (shoulder_share - hip_share) * h,
            upper_arm_m: 0.172 * h,
            forearm_m: 0.15 * h,
            hand_m: 0.1 * h,
            half_shoulders_m: spread(0.104 - 0.010 * sex, 0.004, rng) * h,
            half_hips_m: (0.05 + 0.004 * sex) * h,
            girth: (index * h / (23.0 * 1.75)).sqrt(),
            belly: 1.0 + 0.018 * (index - 23.0).max(-3.0) * grown,
        }
    }

    pub fn is_child(&self) -> bool {
        self.age_years <= CHILD_TO_YEARS
    }

    /// Length of a leg from the hip's joint to the ankle.
    pub fn leg_m(&self) -> f64 {
        self.thigh_m + self.shank_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random;

    #[test]
    fn heights_lie_within_the_2nd_and_98th_percentile_of_their_age() {
        let mut rng = random::stream(1, "stature", 0);
        for age in [2.0, 4.5, 8.0, 12.0, 17.0, 30.0, 75.0] {
            for is_female in [false, true] {
                let (median, deviation) = height_m(age, is_female);
                let drawn: Vec<f64> =
                    (0..400).map(|_| Body::draw(age, is_female, &mut rng).height_m).collect();
                let mean = drawn.iter().sum::<f64>() / 400.0;
                assert!((mean - median).abs() < 0.2 * deviation, "{age}: {mean} for {median}");
                assert!(drawn.iter().all(|h| (h - median).abs() < 2.06 * deviation));
            }
        }
        // CDC 2000: the 5th and the 95th percentile of boys of 8 years are 1.19 m and 1.37 m.
        let (median, deviation) = height_m(8.0, false);
        assert!(
            (median - 1.645 * deviation - 1.19).abs() < 0.015
                && (median + 1.645 * deviation - 1.37).abs() < 0.015
        );
    }

    #[test]
    fn parts_of_a_body_add_up_to_its_height() {
        let mut rng = random::stream(2, "stature", 0);
        for age in [2.0, 6.0, 12.0, 40.0] {
            let body = Body::draw(age, true, &mut rng);
            assert!((body.leg_m() + body.ankle_m - body.hip_m).abs() < 1e-9);
            let neck_m = body.height_m - body.hip_m - body.trunk_m - body.head_m;
            assert!((0.02..0.06).contains(&(neck_m / body.height_m)), "{age}: {}", neck_m / body.height_m);
        }
    }
}
