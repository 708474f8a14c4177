//! The weathers, by CARLA's names, and the one physical state behind each that both sensors see.
//!
//! Extinction by haze and fog follows Koschmieder: alpha = ln 20 / MOR, where the meteorological
//! optical range (MOR) is the distance at which contrast falls to 5 %. Extinction by rain follows
//! Marshall and Palmer's drops, N(D) = 8000 exp(-4.1 R^-0.21 D) per m^3 and mm, as in LISA (Kilic et
//! al. 2021): with an extinction efficiency of 2, alpha = 1e-6 pi 8000 / Lambda^3.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::config::{Check, InvalidConfig, SHARE, define_config, from_to};

/// Drops per m^3 and mm of diameter at zero diameter (Marshall and Palmer 1948).
pub(super) const DROPS_PER_M3_MM: f64 = 8000.0;

/// Azimuth of the sun from the world's +x axis, counter-clockwise.
pub const SUN_AZIMUTH_RAD: f64 = 2.48;

/// Time of day.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Daytime {
    Noon,
    Sunset,
    Night,
}

macro_rules! weathers {
    ($($noon:ident $sunset:ident $night:ident: $mor_m:literal $rain_mmph:literal $wetness:literal $cover:literal;)*) => {
        /// Cloud, rain or fog, and the time of day.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
        pub enum Weather { #[default] $($noon, $sunset, $night),* }

        impl Weather {
            /// Every weather, each sky at noon, at sunset and at night.
            pub const ALL: &[Self] = &[$(Self::$noon, Self::$sunset, Self::$night),*];

            /// The weather's name in files: CARLA's.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$noon => stringify!($noon), Self::$sunset => stringify!($sunset), Self::$night => stringify!($night),)*
                }
            }

            pub fn daytime(self) -> Daytime {
                match self {
                    $(Self::$noon => Daytime::Noon, Self::$sunset => Daytime::Sunset, Self::$night => Daytime::Night,)*
                }
            }

            /// MOR, rain rate, wetness and cloud cover.
            fn sky(self) -> [f64; 4] {
                match self {
                    $(Self::$noon | Self::$sunset | Self::$night => [$mor_m, $rain_mmph, $wetness, $cover],)*
                }
            }
        }
    };
}

// A row is a sky: its three names, then MOR in metres, rain in mm/h, wetness, cloud cover. A new sky is a new row.
// Rain rates are those usually called light (below 2.5 to 10 mm/h) and violent (above 50 mm/h at its peak);
// the fog is thick (MOR 50 to 200 m); over wet streets the air is dry.
weathers!(
    ClearNoon    ClearSunset    ClearNight:    20_000.0  0.0 0.0  0.15;
    CloudyNoon   CloudySunset   CloudyNight:   12_000.0  0.0 0.0  0.95;
    WetNoon      WetSunset      WetNight:       8_000.0  0.0 0.75 0.45;
    SoftRainNoon SoftRainSunset SoftRainNight:  4_000.0  6.0 0.7  0.9;
    HardRainNoon HardRainSunset HardRainNight:  1_200.0 45.0 1.0  1.0;
    FogNoon      FogSunset      FogNight:         100.0  0.0 0.25 1.0;
);

/// The state of air and ground: everything that a sensor needs to know about the weather.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WeatherState {
    /// Meteorological optical range of haze or fog; rain adds to it.
    pub mor_m: f64,
    pub rain_rate_mmph: f64,
    /// Depth of the water film over the texture depth of the pavement (1.2 mm), 0 to 1.
    pub wetness: f64,
    /// Share of the sky that is covered, 0 to 1.
    pub cloud_cover: f64,
    /// Above the horizon; negative at night.
    pub sun_altitude_rad: f64,
}

define_config! {
    /// The part of `gen.toml` that replaces values of the named weather.
    #[derive(Copy)]
    pub struct WeatherOverride {
        /// Meteorological optical range of haze or fog, 10 to 100,000 m.
        #[serde(skip_serializing_if = "Option::is_none")]
        mor_m: Option<f64> = None, in from_to(10.0, 100_000.0);
        /// 0 to 200 mm/h.
        #[serde(skip_serializing_if = "Option::is_none")]
        rain_rate_mmph: Option<f64> = None, in from_to(0.0, 200.0);
        /// 0 (dry) to 1 (standing water).
        #[serde(skip_serializing_if = "Option::is_none")]
        wetness: Option<f64> = None, in SHARE;
    }
}

impl Check for WeatherOverride {}

impl Weather {
    /// The physical state that the name stands for.
    pub fn state(self) -> WeatherState {
        let [mor_m, rain_rate_mmph, wetness, cloud_cover] = self.sky();
        let sun_altitude_deg: f64 = match self.daytime() {
            Daytime::Noon => 55.0,
            Daytime::Sunset => 12.0,
            Daytime::Night => -30.0,
        };
        let sun_altitude_rad = sun_altitude_deg.to_radians();
        WeatherState { mor_m, rain_rate_mmph, wetness, cloud_cover, sun_altitude_rad }
    }
}

impl WeatherState {
    /// Replaces some values.
    ///
    /// # Errors
    /// A value outside its range.
    pub fn replace_by(self, by: &WeatherOverride) -> Result<Self, InvalidConfig> {
        by.check()?;
        Ok(Self {
            mor_m: by.mor_m.unwrap_or(self.mor_m),
            rain_rate_mmph: by.rain_rate_mmph.unwrap_or(self.rain_rate_mmph),
            wetness: by.wetness.unwrap_or(self.wetness),
            ..self
        })
    }

    /// Extinction by haze or fog, one way: the light scattered out of a beam on each metre.
    pub fn haze_extinction_per_m(&self) -> f64 {
        20f64.ln() / self.mor_m
    }

    /// Extinction by rain drops, one way.
    pub fn rain_extinction_per_m(&self) -> f64 {
        let slope = self.drop_slope_per_mm();
        if slope.is_finite() { 1e-6 * std::f64::consts::PI * DROPS_PER_M3_MM / slope.powi(3) } else { 0.0 }
    }

    /// Extinction of the air as a whole, one way.
    pub fn extinction_per_m(&self) -> f64 {
        self.haze_extinction_per_m() + self.rain_extinction_per_m()
    }

    /// Lambda of the drops' exponential spectrum; infinite without rain.
    pub(super) fn drop_slope_per_mm(&self) -> f64 {
        if self.rain_rate_mmph > 0.0 { 4.1 * self.rain_rate_mmph.powf(-0.21) } else { f64::INFINITY }
    }

    pub fn is_night(&self) -> bool {
        self.sun_altitude_rad < 0.0
    }
}

/// A weather that does not exist.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the weather `{name}` does not exist; there are {}", names())]
pub struct UnknownWeather {
    pub name: String,
}

fn names() -> String {
    Weather::ALL.iter().map(|weather| weather.name()).collect::<Vec<_>>().join(", ")
}

impl std::str::FromStr for Weather {
    type Err = UnknownWeather;

    fn from_str(name: &str) -> Result<Self, UnknownWeather> {
        let weather = Self::ALL.iter().copied().find(|weather| weather.name() == name);
        weather.ok_or_else(|| UnknownWeather { name: name.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sky_has_three_daytimes_in_its_names_and_there_is_no_sleet() {
        for names in Weather::ALL.chunks(3) {
            let found = [0, 1, 2].map(|i| names[i].name());
            let sky = found[0].strip_suffix("Noon").unwrap();
            let row = format!("\n| {sky} | ");
            assert!(include_str!("../../docs/weather.md").contains(&row), "docs/weather.md has no row {sky}");
            assert_eq!(found, ["Noon", "Sunset", "Night"].map(|daytime| format!("{sky}{daytime}")));
            assert_eq!(found.map(str::parse), [0, 1, 2].map(|i| Ok(names[i])));
        }
        let message = "Sleet".parse::<Weather>().unwrap_err().to_string();
        assert!(message.contains("Sleet") && message.contains("FogNight"), "{message}");
    }

    #[test]
    fn contrast_falls_to_a_twentieth_at_the_optical_range() {
        let state = Weather::FogNoon.state();
        assert!(((-state.haze_extinction_per_m() * state.mor_m).exp() - 0.05).abs() < 1e-12);
    }

    #[test]
    fn rain_extinction_is_that_of_the_closed_form() {
        // Figures of LISA's closed form with an extinction efficiency of 2: 10, 30, 50, 100 mm/h.
        for (rate, wanted) in [(10.0, 0.00156), (30.0, 0.0031), (50.0, 0.0043), (100.0, 0.0066)] {
            let state = WeatherState { rain_rate_mmph: rate, ..Weather::HardRainNoon.state() };
            assert!((state.rain_extinction_per_m() / wanted - 1.0).abs() < 0.02, "{rate} mm/h");
        }
        assert_eq!(Weather::ClearNoon.state().rain_extinction_per_m(), 0.0);
    }

    #[test]
    fn an_override_replaces_only_what_it_names_and_is_checked() {
        let by = WeatherOverride { mor_m: Some(50.0), ..WeatherOverride::default() };
        let state = Weather::FogNoon.state().replace_by(&by).unwrap();
        assert_eq!((state.mor_m, state.wetness), (50.0, Weather::FogNoon.state().wetness));
        let bad = WeatherOverride { wetness: Some(f64::NAN), ..WeatherOverride::default() };
        assert_eq!(Weather::FogNoon.state().replace_by(&bad).unwrap_err().key(), "wetness");
    }
}
