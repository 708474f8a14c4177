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
    /// 1.3 m of leaves.
    Hedge,
    /// 1.0 m of wooden pickets.
    Fence,
    /// 1.1 m of masonry.
    Wall,
    /// 2.0 m of steel bars.
    Railings,
}

/// What stands along median lanes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MedianLook {
    /// Nothing.
    Open,
    /// A concrete barrier, 0.8 m high.
    Barrier,
    Hedge,
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
