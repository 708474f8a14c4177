//! The looks that a `town.toml` chooses from, for buildings, grounds, boundaries and medians; and colours.

use serde::{Deserialize, Serialize};

/// Whether houses touch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BuildingStyle {
    /// Walls touch; `building_gap_m` is not used.
    Row,
    /// `building_gap_m` lies between one building and the next.
    Detached,
}

/// How a roof is shaped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoofStyle {
    Flat,
    /// Two slopes, the ridge along the street.
    Gable,
    /// Two slopes, the gable towards the street.
    GableFront,
    /// One slope, down to the street.
    Shed,
    /// Rows of steep and flat slopes across the street, as on old halls.
    Sawtooth,
}

/// What one bay of one floor looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FacadeLook {
    /// Bricks, upright windows.
    Brick,
    /// Plain walls, wide windows.
    Plaster,
    /// Plain walls, upright windows with shutters.
    Shutters,
    /// Hewn blocks, upright windows.
    Stone,
    /// Bands of glass, shop windows below.
    Glass,
    /// Rendered walls, small windows on all floors.
    House,
    /// Corrugated metal, few windows, roller gates below.
    Metal,
    /// Brick piers with tall windows under flat arches between them, sliding gates below.
    Warehouse,
    /// Rough stones of all sizes, small windows.
    Rubble,
}

/// What covers a ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundLook {
    Asphalt,
    /// Bleached and patched.
    WornAsphalt,
    Concrete,
    Cobbles,
    /// Grey slabs.
    Pavement,
    /// Warm, uneven stone slabs.
    Flagstones,
    Grass,
    Dirt,
    Gravel,
}

/// What stands along the edge of a plot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoundaryLook {
    /// Nothing.
    Open,
    /// A clipped hedge, 0.9 to 1.6 m high.
    Hedge,
    /// A hedge grown wild, uneven and with gaps, to 2.4 m.
    WildHedge,
    /// 1.0 m of wooden pickets.
    Fence,
    /// 1.1 m of masonry with pilasters and a coping.
    Wall,
    /// 2.0 m of steel bars.
    Railings,
    /// 1.8 m of wire mesh, four fifths of it open.
    ChainLink,
    /// A steel beam on posts, 0.75 m high.
    GuardRail,
    /// 0.9 m of stones without mortar.
    DryStone,
}

/// What stands along median lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MedianLook {
    /// Nothing.
    Open,
    /// A concrete barrier, 0.8 m high.
    Barrier,
    /// Steel beams on posts, one to each side.
    GuardRail,
    Hedge,
}

/// What a landmark is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LandmarkLook {
    /// A portal on four legs with a boom over the water, 34 m high; the boom points to the left of its yaw.
    QuayCrane,
    /// A bridge on two frames over a stack of containers.
    GantryCrane,
    /// Three rows of ISO containers, up to four on each other.
    Containers,
    /// A coaster of 62 m, afloat: its base is the water of its basin.
    Ship,
    /// Three round towers.
    Silos,
    /// A nave with a tower and a spire, the door away from its yaw.
    Church,
}

/// A colour as `#rrggbb`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct TownColor(pub [u8; 3]);

impl TryFrom<String> for TownColor {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6);
        let number = digits.and_then(|digits| u32::from_str_radix(digits, 16).ok());
        let [_, r, g, b] =
            number.ok_or_else(|| format!("`{text}` is not a colour such as `#b4866a`"))?.to_be_bytes();
        Ok(Self([r, g, b]))
    }
}

impl From<TownColor> for String {
    fn from(TownColor([r, g, b]): TownColor) -> Self {
        format!("#{r:02x}{g:02x}{b:02x}")
    }
}
