//! Another rig for each episode: the rig of the config with sensors drawn anew around it, so that a detector does not learn one sensor.
//!
//! Each kind of change happens in a share of the episodes, alone of the others. What is drawn is a [`RigConfig`] like any
//! other: the episode's metadata, calibration and points are those of the drawn rig. Steps are added to the rig's own values
//! or multiply them, so that any rig can be varied; each sensor draws for itself.

use rand::RngExt;

use super::rig_config::{LidarPreset, OdometryConfig, RigCameraConfig, RigConfig, RigLidarConfig};
use crate::config::{Check, InvalidConfig, SHARE, define_config, from_to, part, require};
use crate::random::{self, Rng};

define_config! {
    /// The part `[rig_variation]` of `gen.toml`.
    pub struct RigVariationConfig {
        /// Whether episodes have rigs of their own.
        enabled: bool = false;
        lidar: LidarVariationConfig = LidarVariationConfig::default(), in part::<LidarVariationConfig>();
        camera: CameraVariationConfig = CameraVariationConfig::default(), in part::<CameraVariationConfig>();
        odometry: OdometryVariationConfig = OdometryVariationConfig::default(), in part::<OdometryVariationConfig>();
    }
}

impl Check for RigVariationConfig {
    fn check_relations(&self) -> Result<(), InvalidConfig> {
        let LidarModels { hdl32e, vlp16, hdl64e, os1_128 } = self.lidar.models;
        let found = format!("{:?}", [hdl32e, vlp16, hdl64e, os1_128]);
        let is_one_drawn = self.lidar.model_share == 0.0 || hdl32e + vlp16 + hdl64e + os1_128 > 0.0;
        require(is_one_drawn, "lidar.models", found, "a number above 0 is needed, or model_share = 0")
    }
}

define_config! {
    /// What varies of each LiDAR. Pairs are the least and the most.
    pub struct LidarVariationConfig {
        /// Share of the episodes with a model drawn by `models`, its azimuth step included; a rig with `elevations_deg` keeps them.
        model_share: f64 = 0.6, in SHARE;
        models: LidarModels = LidarModels::default(), in part::<LidarModels>();
        /// Share of the episodes in which the LiDAR stands elsewhere.
        place_share: f64 = 0.8, in SHARE;
        /// How far forward.
        x_shift_m: [f64; 2] = [-0.4, 0.4], in from_to(-3.0, 3.0).pair();
        /// How far to the left.
        y_shift_m: [f64; 2] = [-0.1, 0.1], in from_to(-1.0, 1.0).pair();
        /// How far up.
        z_shift_m: [f64; 2] = [-0.25, 0.5], in from_to(-1.5, 3.0).pair();
        /// How much more its front is tilted down.
        pitch_shift_deg: [f64; 2] = [-1.5, 1.5], in from_to(-20.0, 20.0).pair();
        /// Share of the episodes with dead beams.
        lost_beams_share: f64 = 0.15, in SHARE;
        /// Which part of the beams is dead then.
        lost_beams: [f64; 2] = [0.03, 0.3], in from_to(0.0, 0.9).pair();
        /// Share of the episodes with another angle between two firings.
        azimuth_share: f64 = 0.4, in SHARE;
        /// Factor on that angle.
        azimuth_factor: [f64; 2] = [0.8, 1.6], in from_to(0.2, 5.0).pair();
        /// Share of the episodes with another noise of ranges.
        noise_share: f64 = 0.7, in SHARE;
        /// Standard deviation of each return's range.
        range_noise_m: [f64; 2] = [0.005, 0.04], in from_to(0.0, 1.0).pair();
        /// Share of the episodes with another intensity curve.
        intensity_share: f64 = 0.8, in SHARE;
        /// Factor on the strength of each return.
        intensity_scale: [f64; 2] = [0.6, 1.7], in from_to(0.05, 5.0).pair();
        /// Exponent of the strength, 1 being full scale.
        intensity_gamma: [f64; 2] = [0.6, 1.4], in from_to(0.1, 4.0).pair();
        /// How many values are told apart; drawn evenly in their logarithm.
        intensity_steps: [f64; 2] = [16.0, 256.0], in from_to(2.0, 65536.0).pair();
        /// Nearer than this the intensity falls with the range.
        near_m: [f64; 2] = [0.0, 8.0], in from_to(0.0, 50.0).pair();
        /// How much rings and shots differ, as a part of what they do in the make.
        intensity_spread: [f64; 2] = [0.5, 2.0], in from_to(0.0, 5.0).pair();
        /// Share of the episodes in which the LiDAR loses more or fewer of its weak returns: those of dark, glossy, far and grazing
        /// surfaces (its sure range), those of windows, and any (`dropout`).
        drop_share: f64 = 0.7, in SHARE;
        /// Factor on the range at which a target of reflectivity 0.1 is still detected for sure.
        sure_range_factor: [f64; 2] = [0.5, 1.2], in from_to(0.1, 5.0).pair();
        /// Share of the beams on windows that return.
        glass_return: [f64; 2] = [0.0, 0.5], in SHARE.pair();
        /// Share of returns lost at random.
        dropout: [f64; 2] = [0.0, 0.08], in from_to(0.0, 0.9).pair();
    }
}

define_config! {
    /// How often each model of LiDAR is drawn, relative to the others.
    pub struct LidarModels {
        /// Velodyne HDL-32E.
        hdl32e: f64 = 3.0, in from_to(0.0, 1e6);
        /// Velodyne VLP-16.
        vlp16: f64 = 2.0, in from_to(0.0, 1e6);
        /// Velodyne HDL-64E.
        hdl64e: f64 = 3.0, in from_to(0.0, 1e6);
        /// Ouster OS1-128.
        os1_128: f64 = 1.0, in from_to(0.0, 1e6);
    }
}

define_config! {
    /// What varies of each camera. Pairs are the least and the most.
    pub struct CameraVariationConfig {
        /// Share of the episodes with another focal length.
        focal_share: f64 = 0.7, in SHARE;
        /// Factor on the tangent of half the horizontal angle: of the default's 70 degrees, these make 52 to 90.
        focal_factor: [f64; 2] = [0.697, 1.428], in from_to(0.2, 5.0).pair();
        /// Share of the episodes in which the camera stands elsewhere.
        place_share: f64 = 0.8, in SHARE;
        /// How far up.
        z_shift_m: [f64; 2] = [-0.2, 0.4], in from_to(-1.5, 3.0).pair();
        /// How much more its front is tilted down.
        pitch_shift_deg: [f64; 2] = [-2.0, 4.0], in from_to(-20.0, 20.0).pair();
        /// Share of the episodes that are exposed differently.
        exposure_share: f64 = 0.6, in SHARE;
        /// By how many stops.
        exposure_ev: [f64; 2] = [-1.0, 0.7], in from_to(-4.0, 4.0).pair();
        /// Share of the episodes that are out of focus.
        blur_share: f64 = 0.3, in SHARE;
        /// Standard deviation of the blur.
        blur_px: [f64; 2] = [0.3, 0.7], in from_to(0.0, 3.0).pair();
        /// Share of the episodes of another JPEG quality.
        quality_share: f64 = 0.7, in SHARE;
        /// That quality.
        jpeg_quality: [f64; 2] = [60.0, 95.0], in from_to(1.0, 100.0).pair();
    }
}

define_config! {
    /// How far the car's own sensors err. Pairs are the least and the most.
    pub struct OdometryVariationConfig {
        /// Share of the episodes in which they err.
        share: f64 = 0.8, in SHARE;
        /// Measured speed over true speed.
        speed_factor: [f64; 2] = [0.97, 1.03], in from_to(0.5, 2.0).pair();
        /// Standard deviation of each measured speed.
        speed_noise_mps: [f64; 2] = [0.0, 0.1], in from_to(0.0, 5.0).pair();
        /// What the steering sensor tells beside the true road-wheel angle, positive to the left.
        steering_bias_deg: [f64; 2] = [-0.8, 0.8], in from_to(-20.0, 20.0).pair();
        /// Standard deviation of each measured angle.
        steering_noise_deg: [f64; 2] = [0.0, 0.2], in from_to(0.0, 20.0).pair();
    }
}

impl RigVariationConfig {
    /// The rig of an episode, both configs being valid; where not enabled, the rig as it is.
    #[must_use]
    pub fn draw(&self, rig: &RigConfig, seed: u64) -> RigConfig {
        let mut drawn = rig.clone();
        if !self.enabled {
            return drawn;
        }
        for (i, lidar) in drawn.lidars.values_mut().enumerate() {
            self.lidar.vary(lidar, &mut random::stream(seed, "rig-variation-lidar", i as u64));
        }
        for (i, camera) in drawn.cameras.values_mut().enumerate() {
            self.camera.vary(camera, &mut random::stream(seed, "rig-variation-camera", i as u64));
        }
        self.odometry.vary(&mut drawn.odometry, &mut random::stream(seed, "rig-variation-odometry", 0));
        drawn
    }
}

/// Whether a change of this share happens; it draws one number.
fn happens(share: f64, rng: &mut Rng) -> bool {
    rng.random::<f64>() < share
}

/// A number between two.
fn between([least, most]: [f64; 2], rng: &mut Rng) -> f64 {
    least + (most - least) * rng.random::<f64>()
}

impl LidarVariationConfig {
    fn vary(&self, lidar: &mut RigLidarConfig, rng: &mut Rng) {
        if happens(self.model_share, rng) {
            let of = &self.models;
            let models = [
                (LidarPreset::Hdl32e, of.hdl32e),
                (LidarPreset::Vlp16, of.vlp16),
                (LidarPreset::Hdl64e, of.hdl64e),
                (LidarPreset::Os1128, of.os1_128),
            ];
            let drawn = random::pick_weighted(models.iter().map(|(_, weight)| *weight), rng);
            if let Some(model) = drawn.filter(|_| lidar.elevations_deg.is_empty()) {
                lidar.preset = models[model].0;
                lidar.azimuth_step_deg = lidar.preset.azimuth_step_deg();
                // Dead beams were those of the other one.
                lidar.lost_beams.clear();
            }
        }
        if happens(self.place_share, rng) {
            lidar.x_m = (lidar.x_m + between(self.x_shift_m, rng)).clamp(-100.0, 100.0);
            lidar.y_m = (lidar.y_m + between(self.y_shift_m, rng)).clamp(-100.0, 100.0);
            lidar.z_m = (lidar.z_m + between(self.z_shift_m, rng)).clamp(-100.0, 100.0);
            lidar.pitch_deg = (lidar.pitch_deg + between(self.pitch_shift_deg, rng)).clamp(-60.0, 60.0);
        }
        if happens(self.lost_beams_share, rng) {
            let n_beams = lidar.n_beams();
            let n_lost = ((between(self.lost_beams, rng) * n_beams as f64).round() as usize).min(n_beams - 1);
            let mut lost = rand::seq::index::sample(rng, n_beams, n_lost).into_vec();
            lost.sort_unstable();
            lidar.lost_beams = lost.into_iter().map(|beam| beam as u16).collect();
        }
        if happens(self.azimuth_share, rng) {
            let step_deg = lidar.azimuth_step_deg * between(self.azimuth_factor, rng);
            lidar.azimuth_step_deg = step_deg.clamp(0.05, 5.0);
        }
        if happens(self.noise_share, rng) {
            lidar.range_noise_m = between(self.range_noise_m, rng);
        }
        if happens(self.intensity_share, rng) {
            let of = &mut lidar.intensity;
            of.scale = between(self.intensity_scale, rng);
            of.gamma = between(self.intensity_gamma, rng);
            of.steps = between(self.intensity_steps.map(f64::ln), rng).exp().round() as u32;
            of.near_m = between(self.near_m, rng);
            of.spread = between(self.intensity_spread, rng);
        }
        if happens(self.drop_share, rng) {
            lidar.sure_range_m =
                (lidar.sure_range_m * between(self.sure_range_factor, rng)).clamp(1.0, 1000.0);
            lidar.glass_return = between(self.glass_return, rng);
            lidar.dropout = between(self.dropout, rng);
        }
    }
}

impl CameraVariationConfig {
    fn vary(&self, camera: &mut RigCameraConfig, rng: &mut Rng) {
        if happens(self.focal_share, rng) {
            let half_rad = (camera.horizontal_fov_deg / 2.0).to_radians();
            let half_rad = (half_rad.tan() * between(self.focal_factor, rng)).atan();
            camera.horizontal_fov_deg = (2.0 * half_rad).to_degrees().clamp(10.0, 170.0);
        }
        if happens(self.place_share, rng) {
            camera.z_m = (camera.z_m + between(self.z_shift_m, rng)).clamp(-100.0, 100.0);
            camera.pitch_deg = (camera.pitch_deg + between(self.pitch_shift_deg, rng)).clamp(-60.0, 60.0);
        }
        if happens(self.exposure_share, rng) {
            camera.exposure_ev = between(self.exposure_ev, rng);
        }
        if happens(self.blur_share, rng) {
            camera.blur_px = between(self.blur_px, rng);
        }
        if happens(self.quality_share, rng) {
            camera.jpeg_quality = Some(between(self.jpeg_quality, rng).round() as u8);
        }
    }
}

impl OdometryVariationConfig {
    fn vary(&self, odometry: &mut OdometryConfig, rng: &mut Rng) {
        if happens(self.share, rng) {
            odometry.speed_factor = between(self.speed_factor, rng);
            odometry.speed_noise_mps = between(self.speed_noise_mps, rng);
            odometry.steering_bias_deg = between(self.steering_bias_deg, rng);
            odometry.steering_noise_deg = between(self.steering_noise_deg, rng);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensors::Rig;

    fn variation() -> RigVariationConfig {
        RigVariationConfig { enabled: true, ..RigVariationConfig::default() }
    }

    fn drawn(n: u64) -> Vec<RigConfig> {
        (0..n).map(|seed| variation().draw(&RigConfig::default(), seed)).collect()
    }

    #[test]
    fn a_rig_is_drawn_by_its_seed_and_off_means_the_rig_as_it_is() {
        let rig = RigConfig::default();
        assert_eq!(variation().draw(&rig, 3), variation().draw(&rig, 3));
        assert_ne!(variation().draw(&rig, 3), variation().draw(&rig, 4));
        assert_eq!(RigVariationConfig::default().draw(&rig, 3), rig);
        crate::config::assert_every_number_is_checked(&variation());
    }

    #[test]
    fn every_draw_is_a_valid_rig_inside_the_ranges() {
        let of = LidarVariationConfig::default();
        for rig in drawn(300) {
            assert!(Rig::try_from(&rig).is_ok());
            let (lidar, camera) = (&rig.lidars["lidar_top"], &rig.cameras["cam_front"]);
            assert!((1.84 - 0.25..=1.84 + 0.5).contains(&lidar.z_m) && lidar.pitch_deg.abs() <= 1.5);
            assert!(lidar.lost_beams.len() as f64 <= (0.3 * lidar.n_beams() as f64).ceil());
            assert!((of.range_noise_m[0]..=of.range_noise_m[1]).contains(&lidar.range_noise_m));
            assert!((51.9..=90.1).contains(&camera.horizontal_fov_deg), "{}", camera.horizontal_fov_deg);
            assert!(camera.jpeg_quality.is_none_or(|quality| (60..=95).contains(&quality)));
            assert!((0.97..=1.03).contains(&rig.odometry.speed_factor));
        }
    }

    #[test]
    fn each_change_happens_in_its_share_of_the_episodes() {
        let (rigs, own) = (drawn(2000), RigConfig::default());
        let share = |changed: &dyn Fn(&RigConfig) -> bool| {
            rigs.iter().filter(|rig| changed(rig)).count() as f64 / rigs.len() as f64
        };
        let lidar = |of: fn(&RigLidarConfig) -> f64| {
            share(&|rig| of(&rig.lidars["lidar_top"]) != of(&own.lidars["lidar_top"]))
        };
        let camera = |of: fn(&RigCameraConfig) -> f64| {
            share(&|rig| of(&rig.cameras["cam_front"]) != of(&own.cameras["cam_front"]))
        };
        let dead = lidar(|of| of.lost_beams.len() as f64);
        let model = lidar(|of| f64::from(of.preset as u8));
        for (found, wanted) in [
            (dead, 0.15),
            // Two of three draws are another model than the rig's own.
            (model, 0.6 * 6.0 / 9.0),
            (lidar(|of| of.z_m), 0.8),
            (lidar(|of| of.range_noise_m), 0.7),
            (lidar(|of| of.intensity.gamma), 0.8),
            (lidar(|of| of.sure_range_m), 0.7),
            (camera(|of| of.horizontal_fov_deg), 0.7),
            (camera(|of| of.blur_px), 0.3),
            (share(&|rig| rig.odometry != own.odometry), 0.8),
        ] {
            assert!((found - wanted).abs() < 0.04, "{found} against {wanted}");
        }
    }

    #[test]
    fn a_drawn_model_has_no_dead_beams_of_another() {
        let mut rig = RigConfig::default();
        let lidar = rig.lidars.get_mut("lidar_top").unwrap();
        (lidar.preset, lidar.lost_beams) = (LidarPreset::Os1128, vec![0, 100]);
        for seed in 0..40 {
            Rig::try_from(&variation().draw(&rig, seed)).unwrap();
        }
    }

    #[test]
    fn no_model_to_draw_is_refused() {
        let models = LidarModels { hdl32e: 0.0, vlp16: 0.0, hdl64e: 0.0, os1_128: 0.0 };
        let mut config = variation();
        config.lidar.models = models;
        let error = config.check().unwrap_err().to_string();
        assert!(error.contains("lidar.models is [0.0, 0.0, 0.0, 0.0]; a number above 0"), "{error}");
        config.lidar.model_share = 0.0;
        assert!(config.check().is_ok());
    }

    #[test]
    fn each_sensor_of_a_rig_draws_for_itself() {
        let mut rig = RigConfig::default();
        rig.cameras.insert("cam_left".into(), RigCameraConfig::default());
        let drawn = variation().draw(&rig, 1);
        assert_ne!(drawn.cameras["cam_left"], drawn.cameras["cam_front"]);
    }
}
