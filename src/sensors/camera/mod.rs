//! Weather and daytime in the camera's picture, added to the renderer's colours and depths.
//!
//! The renderer draws dry things in clear air: by day under the sun and the sky, at night evenly
//! bright, so that its colours are the things' own. [`Scope::see`] does the rest, in this order: the sky,
//! lamps (at night), water on the ground, Koschmieder's fog, rain, sensor noise, exposure and blur. Colours are
//! display-referred, 0 to 1; light is added up in linear units (display value squared).
//!
//! Frames: camera (x right, y down, z forward) and world. Everything random comes from named streams.

mod fog;
mod lens;
mod night;
mod noise;
mod picture;
mod rain;
mod shot;
mod sky;
mod table;
mod wet;

use image::RgbImage;
use nalgebra::Vector3;

use self::lens::Lens;
use self::picture::{Picture, View};
pub use self::shot::{Material, Rendered, Shot, StreetLamp};
use self::sky::Panorama;
use super::rig::RigCamera;
use super::weather::{Weather, WeatherState};
use crate::geometry::{Camera, Ego, Pinhole, Transform};

/// The camera of one episode in its weather.
#[derive(Debug, Clone)]
pub struct Scope {
    state: WeatherState,
    intrinsics: Pinhole,
    ego_from_camera: Transform<Ego, Camera>,
    panorama: Panorama,
    rays: picture::Rays,
    noise: noise::Tile,
    puddles: wet::Puddles,
    lens: Lens,
    seed: u64,
}

impl Scope {
    /// All cameras see one sky; what else is random is of each.
    pub fn new(weather: Weather, state: &WeatherState, camera: &RigCamera, seed: u64) -> Self {
        let (intrinsics, forward) = (&camera.intrinsics, camera.ego_from_camera.rotate(&Vector3::z()));
        let farthest_px = intrinsics.cy_px.max(f64::from(intrinsics.height_px) - intrinsics.cy_px);
        let highest_rad = forward.z.asin().abs() + (farthest_px / intrinsics.fy_px).atan();
        Self {
            state: *state,
            intrinsics: camera.intrinsics,
            ego_from_camera: camera.ego_from_camera,
            panorama: Panorama::new(weather.daytime(), state, highest_rad, seed),
            rays: picture::Rays::new(&camera.intrinsics),
            noise: noise::Tile::new(camera.intrinsics.width_px as usize),
            puddles: wet::Puddles::new(),
            lens: Lens::new(&camera.config),
            seed: camera.seed(seed),
        }
    }

    /// Whether [`Self::see`] needs depths; if not, any will do.
    pub fn needs_depth(&self) -> bool {
        self.state.is_night() || self.state.wetness > 0.0 || fog::is_visible(&self.state)
    }

    /// The picture as the camera takes it.
    ///
    /// # Panics
    /// If the sizes of the renderer's pictures and of the intrinsics differ.
    pub fn see(&self, rendered: &Rendered<'_>, shot: &Shot<'_>) -> RgbImage {
        let mut seen = self.add_weather(rendered, shot);
        self.lens.apply(&mut seen);
        seen
    }

    fn add_weather(&self, rendered: &Rendered<'_>, shot: &Shot<'_>) -> RgbImage {
        let pose = shot.world_from_ego * self.ego_from_camera;
        let view = View::new(&self.intrinsics, &self.ego_from_camera, &pose, &self.rays);
        assert_eq!(rendered.material.len(), self.rays.stretch.len(), "one material for each pixel");
        let noise = noise::level(&self.state);
        if !self.needs_depth() && self.state.rain_rate_mmph <= 0.0 && noise.is_none() {
            return self.add_sky(&view, rendered);
        }
        let mut picture = Picture::of(rendered.rgb);
        self.panorama.paint(&view, rendered.material, |at, colour| picture.pixels[at] = colour);
        let mut glow = None;
        if self.state.is_night() {
            glow = Some(night::curves().light(
                &mut picture,
                &view,
                rendered,
                shot.lamps,
                self.state.extinction_per_m(),
            ));
        }
        if self.state.wetness > 0.0 {
            self.puddles.cover(&mut picture, &view, rendered, &self.panorama, self.state.wetness);
        }
        if fog::is_visible(&self.state) {
            fog::veil(&mut picture, &view, rendered, &self.panorama, &self.state);
        }
        if let Some(glow) = glow {
            night::curves().add_glow(&glow, &mut picture, self.state.extinction_per_m());
        }
        if self.state.rain_rate_mmph > 0.0 {
            rain::fall(&mut picture, &view, &self.state, shot, self.seed);
        }
        self.noise.add(&mut picture, noise, self.seed, shot.sample_idx);
        picture.to_image()
    }

    /// All that there is to see in clear air on a dry day.
    fn add_sky(&self, view: &View<'_>, rendered: &Rendered<'_>) -> RgbImage {
        let mut image = rendered.rgb.clone();
        let (pixels, _) = image.as_chunks_mut::<3>();
        self.panorama.paint(view, rendered.material, |at, colour| pixels[at] = colour.map(picture::byte));
        image
    }
}
