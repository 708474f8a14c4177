//! The command that makes a label set, as errors and findings tell it.

use std::path::Path;

use crate::config;
use crate::zone::ZoneConfig;

/// `harmzone label DIR --labels SET`, with `--set` for each key in which the zone is not the default one. Without those where the zone
/// is not known.
#[must_use]
pub fn label_command(data_set: &Path, set: &str, zone: Option<&ZoneConfig>) -> String {
    let overrides = zone.map(|zone| config::differences(&ZoneConfig::default(), zone)).unwrap_or_default();
    let flag = |text: &String| format!(" --set {text}");
    let overrides: String = overrides.iter().map(flag).collect();
    format!("harmzone label {} --labels {set}{overrides}", data_set.display())
}

/// The zone that a label set or a part of it tells; `None` where this version does not read it.
#[must_use]
pub fn zone_in(zone_toml: &str) -> Option<ZoneConfig> {
    toml::from_str(zone_toml).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_names_the_keys_in_which_the_zone_is_not_the_default_one() {
        let told = |toml: &str| label_command(Path::new("data"), "mine", zone_in(toml).as_ref());
        assert_eq!(told("width_m = 3.5\n"), "harmzone label data --labels mine");
        let wanted = "harmzone label data --labels mine --set kind=ttc --set ttc.horizon_s=3.0";
        assert_eq!(told("kind = \"ttc\"\n[ttc]\nhorizon_s = 3.0\n"), wanted);
        assert_eq!(told("a key of another version"), "harmzone label data --labels mine");
    }
}
