//! How much a film of water takes from the LiDAR's return of paved ground.
//!
//! Hahner et al., "LiDAR Snowfall Simulation for Robust 3D Object Detection", CVPR 2022: the film
//! covers the share `wetness` of the pavement. Light that goes in is scattered below and comes out
//! along the way it came: T^2 rho / (1 - rho R), with Fresnel's T and R at the angle of incidence
//! for the better of the two polarisations; what the surface reflects goes away as from a mirror.

/// Refractive indices of air and water.
const AIR_INDEX: f64 = 1.0003;
const WATER_INDEX: f64 = 1.33;

/// Reflectivity of a partly covered pavement of reflectivity `dry` under a cosine of incidence.
pub(super) fn reflectivity(dry: f64, cos_incidence: f64, wetness: f64) -> f64 {
    if wetness <= 0.0 {
        return dry;
    }
    let transmitted = transmittance(cos_incidence);
    let under_water = transmitted.powi(2) * dry / (1.0 - dry * (1.0 - transmitted));
    (1.0 - wetness) * dry + wetness * under_water
}

/// Share of the light's power that passes from air into water: the better of the polarisations.
fn transmittance(cos_incidence: f64) -> f64 {
    let cos_in = cos_incidence.clamp(0.0, 1.0);
    let sin_out = AIR_INDEX / WATER_INDEX * (1.0 - cos_in * cos_in).sqrt();
    let cos_out = (1.0 - sin_out * sin_out).sqrt();
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
    fn grazing_light_is_lost_and_dry_ground_keeps_its_reflectivity() {
        assert_eq!(reflectivity(0.2, 0.05, 0.0), 0.2);
        let (steep, grazing) = (reflectivity(0.2, 0.5, 1.0), reflectivity(0.2, 0.03, 1.0));
        assert!(grazing < 0.25 * steep && steep < 0.2, "{steep} {grazing}");
    }
}
