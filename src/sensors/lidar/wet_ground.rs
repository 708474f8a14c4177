//! How much a film of water takes from the LiDAR's return of paved ground.
//!
//! Hahner et al., "LiDAR Snowfall Simulation for Robust 3D Object Detection", CVPR 2022: the film
//! covers the share `wetness` of the pavement. Light that goes in is scattered below and comes out
//! along the way it came: T^2 rho / (1 - rho R), with Fresnel's T and R at the angle of incidence
//! for the better of the two polarisations; what the surface reflects goes away as from a mirror.
//!
//! The film is level: it takes light by cos(i), and below it the light meets the pavement at the refracted angle, where
//! the finish has its factor. Only dry ground stays bright by its grains at grazing angles.

use super::surface::Finish;

/// Refractive indices of air and water.
const AIR_INDEX: f64 = 1.0003;
const WATER_INDEX: f64 = 1.33;

/// As [`Finish::factor`], of a partly covered pavement with the reflectivity `dry`.
pub(super) fn factor(finish: Finish, dry: f64, cos_incidence: f64, wetness: f64) -> f64 {
    let above = finish.factor(cos_incidence);
    if wetness <= 0.0 {
        return above;
    }
    let transmitted = transmittance(cos_incidence);
    let cos_below = refracted_cos(cos_incidence);
    let under_water = transmitted.powi(2) / (1.0 - dry * (1.0 - transmitted))
        * (cos_incidence / cos_below)
        * finish.factor(cos_below);
    (1.0 - wetness) * above + wetness * under_water
}

fn refracted_cos(cos_incidence: f64) -> f64 {
    let sin_in_squared = 1.0 - cos_incidence.clamp(0.0, 1.0).powi(2);
    (1.0 - (AIR_INDEX / WATER_INDEX).powi(2) * sin_in_squared).sqrt()
}

/// Share of the light's power that passes from air into water: the better of the polarisations.
fn transmittance(cos_incidence: f64) -> f64 {
    let cos_in = cos_incidence.clamp(0.0, 1.0);
    let cos_out = refracted_cos(cos_in);
    let reflected = |near: f64, far: f64| ((near - far) / (near + far)).powi(2);
    let across = reflected(AIR_INDEX * cos_in, WATER_INDEX * cos_out);
    let along = reflected(AIR_INDEX * cos_out, WATER_INDEX * cos_in);
    1.0 - across.min(along)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn upright_light_loses_two_percent_at_the_surface() {
        // ((1.33 - 1.0003) / (1.33 + 1.0003))^2 = 0.02002.
        assert!((transmittance(1.0) - 0.97998).abs() < 1e-4);
    }

    #[test]
    fn brewsters_angle_lets_all_of_one_polarisation_in() {
        let brewster_rad = (WATER_INDEX / AIR_INDEX).atan();
        assert!((transmittance(brewster_rad.cos()) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn grazing_light_is_lost_and_dry_ground_keeps_its_factor() {
        assert_eq!(factor(Finish::Rough, 0.2, 0.05, 0.0), Finish::Rough.factor(0.05));
        let wet = |cos_incidence| factor(Finish::Rough, 0.2, cos_incidence, 1.0);
        let dry = |cos_incidence| Finish::Rough.factor(cos_incidence);
        // At 3 m asphalt under water sends back most of what it does when dry, at 15 m an eighth.
        assert!((0.7..0.95).contains(&(wet(0.5) / dry(0.5))), "{}", wet(0.5) / dry(0.5));
        assert!((0.1..0.16).contains(&(wet(0.123) / dry(0.123))), "{}", wet(0.123) / dry(0.123));
    }
}
