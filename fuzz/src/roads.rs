//! OpenDRIVE maps, and the `town.toml` beside one.

use harmzone::scene::{PopulateConfig, Town, populate};

use super::scratch;

/// A map with one crossing, as `tests/data/make_crossroads.py` made it.
pub const CROSSROADS: &str = include_str!("../../tests/data/crossroads.xodr");

/// One straight street: what a `town.toml` is tried on.
pub const STREET: &str = r#"<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="4" name="street"/>
  <road name="street" length="60" id="1" junction="-1">
    <planView><geometry s="0" x="0" y="0" hdg="0.1" length="60"><line/></geometry></planView>
    <elevationProfile><elevation s="0" a="0" b="0.01" c="0" d="0"/></elevationProfile>
    <lanes>
      <laneOffset s="0" a="0" b="0" c="0" d="0"/>
      <laneSection s="0">
        <left>
          <lane id="2" type="sidewalk" level="false"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
          <lane id="1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
        </left>
        <center><lane id="0" type="none" level="false"><roadMark sOffset="0" type="broken" width="0.12"/></lane></center>
        <right>
          <lane id="-1" type="driving" level="false"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>
          <lane id="-2" type="sidewalk" level="false"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane>
        </right>
      </laneSection>
    </lanes>
    <objects>
      <object id="1" type="crosswalk" name="zebra" s="30" t="0" zOffset="0" hdg="0" length="3" width="7" height="0"/>
    </objects>
    <signals>
      <signal s="50" t="-5" id="1" name="light" dynamic="yes" orientation="+" type="1000001" subtype="-1" value="-1"/>
    </signals>
  </road>
</OpenDRIVE>
"#;

/// A map (first byte even), or a `town.toml` beside [`STREET`]; where the town can be loaded, it is filled.
pub fn road(bytes: &[u8]) {
    let Some((kind, rest)) = scratch::split(bytes) else { return };
    scratch::empty_folder("road");
    let (map, toml) = if kind % 2 == 0 { (rest, None) } else { (STREET.as_bytes(), Some(rest)) };
    let path = scratch::write("road/road.xodr", map);
    if let Some(toml) = toml {
        scratch::write("road/town.toml", toml);
    }
    let town = match Town::load(path.to_str().expect("scratch paths are text")) {
        Ok(town) => town,
        Err(error) => return scratch::tell(&error),
    };
    if kind & 2 == 2
        && let Err(error) = populate(&town.into(), &PopulateConfig::default(), 3)
    {
        scratch::tell(&error);
    }
}
