//! The weathers, by CARLA's names.

use serde::{Deserialize, Serialize};
use thiserror::Error;

macro_rules! weathers {
    ($($name:ident),* $(,)?) => {
        /// Cloud, rain or fog, and the time of day.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
        pub enum Weather { #[default] $($name),* }

        impl Weather {
            /// Every name that exists.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$name => stringify!($name)),* }
            }
        }
    };
}

weathers!(
    ClearNoon,
    ClearSunset,
    ClearNight,
    CloudyNoon,
    CloudySunset,
    CloudyNight,
    WetNoon,
    WetSunset,
    WetNight,
    SoftRainNoon,
    SoftRainSunset,
    SoftRainNight,
    HardRainNoon,
    HardRainSunset,
    HardRainNight,
    FogNoon,
    FogSunset,
    FogNight,
);

impl Weather {
    /// Those that are simulated today.
    pub const SUPPORTED: &[Self] = &[Self::ClearNoon];
}

/// A weather that does not exist, or is not simulated yet.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("the weather `{name}` {problem}; supported: {}", supported())]
pub struct UnsupportedWeather {
    pub name: String,
    problem: &'static str,
}

fn supported() -> String {
    Weather::SUPPORTED.iter().map(|weather| weather.name()).collect::<Vec<_>>().join(", ")
}

impl std::str::FromStr for Weather {
    type Err = UnsupportedWeather;

    fn from_str(name: &str) -> Result<Self, UnsupportedWeather> {
        let fail = |problem| UnsupportedWeather { name: name.to_owned(), problem };
        let weather = Self::ALL.iter().copied().find(|weather| weather.name() == name);
        let weather = weather.ok_or_else(|| fail("does not exist"))?;
        if Self::SUPPORTED.contains(&weather) { Ok(weather) } else { Err(fail("is not simulated yet")) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_eighteen_weathers_and_only_the_working_ones_are_taken() {
        assert_eq!(Weather::ALL.len(), 18);
        assert_eq!("ClearNoon".parse(), Ok(Weather::ClearNoon));
        for (name, problem) in [("FogNight", "not simulated yet"), ("Sleet", "does not exist")] {
            let message = name.parse::<Weather>().unwrap_err().to_string();
            assert!(message.contains(problem) && message.contains("ClearNoon"), "{message}");
        }
    }
}
