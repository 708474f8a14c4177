//! Objects around the ego: what is really there, what a detector reports, and whether it harms.

use serde::{Deserialize, Deserializer, Serialize};

use crate::geometry::{Box3, Ego, Point};

/// The three kinds of the paper's statistics.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Vehicle,
    Pedestrian,
    Static,
}

impl Kind {
    /// All three, in channel order.
    pub const ALL: [Self; 3] = [Self::Vehicle, Self::Pedestrian, Self::Static];

    /// The kind's name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Vehicle => "vehicle",
            Self::Pedestrian => "pedestrian",
            Self::Static => "static",
        }
    }

    /// The kind's channel.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

/// Whether training data may hold such an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Distribution {
    /// In distribution: seen in training.
    Id,
    /// Out of distribution: one of the kinds that no training set holds.
    Ood,
}

impl Distribution {
    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Id => "id",
            Self::Ood => "ood",
        }
    }
}

/// What an object out of distribution does in its episode.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Event {
    /// Nothing of the kind.
    #[default]
    None,
    /// It lies on the road.
    Lies,
    /// It falls from a balcony.
    Falls,
    /// It rolls or tumbles across the road.
    Rolls,
    /// It is thrown before the ego.
    Thrown,
}

impl Event {
    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Lies => "lies",
            Self::Falls => "falls",
            Self::Rolls => "rolls",
            Self::Thrown => "thrown",
        }
    }
}

/// Where an object out of distribution was put.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Spot {
    /// Not told: the object is in distribution, or comes from a log.
    #[default]
    None,
    /// Beside the road, or on a pavement.
    Beside,
    /// In the ego's lane, or partly in it.
    Lane,
    /// In the mouth of a junction, on the way through it, or at its far side.
    Junction,
    /// In a bend or on one of its sides.
    Bend,
    /// On a pedestrian crossing.
    Crossing,
    /// Half hidden, or coming out, behind a vehicle, a post, a tree or the corner of a house.
    Behind,
    /// On a balcony.
    Aloft,
}

impl Spot {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::None,
        Self::Beside,
        Self::Lane,
        Self::Junction,
        Self::Bend,
        Self::Crossing,
        Self::Behind,
        Self::Aloft,
    ];

    /// The name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Beside => "beside",
            Self::Lane => "lane",
            Self::Junction => "junction",
            Self::Bend => "bend",
            Self::Crossing => "crossing",
            Self::Behind => "behind",
            Self::Aloft => "aloft",
        }
    }
}

/// The two classes of the detector, in the order of its channels.
///
/// ```
/// use harmzone::object::Harm;
///
/// assert_eq!(Harm::ALL.map(Harm::name), ["harmful", "harmless"]);
/// assert_eq!(Harm::Harmless.index(), 1);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Harm {
    Harmful,
    Harmless,
}

impl Harm {
    /// Both classes, in channel order.
    pub const ALL: [Self; 2] = [Self::Harmful, Self::Harmless];

    /// The class's name in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Harmful => "harmful",
            Self::Harmless => "harmless",
        }
    }

    /// The other class.
    #[must_use]
    pub fn other(self) -> Self {
        Self::ALL[1 - self.index()]
    }

    /// The class's channel: 0 harmful, 1 harmless.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

/// The part of an object that something could hit, a rectangle on the ground in the axes of the object's box: a trunk
/// without its crown, a post without its arm.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct SolidPart {
    /// From the box's middle to the rectangle's, along the box's x axis.
    pub along_m: f64,
    /// The same along its y axis.
    pub across_m: f64,
    pub length_m: f64,
    pub width_m: f64,
}

/// A true object: its box, and what is known about it. Our episodes hold every fact; files of others may lack
/// some.
///
/// ```
/// use harmzone::geometry::{Box3, Point};
/// use harmzone::object::{Kind, Object};
///
/// let center = Point::new(12.0, 0.5, 0.75); // ahead and a little to the left
/// let box_in_ego = Box3 { center, length_m: 4.0, width_m: 1.8, height_m: 1.5, yaw_rad: 0.0 };
/// let car = Object { kind: Some(Kind::Vehicle), n_lidar_points: Some(60), ..Object::new(box_in_ego) };
/// assert_eq!(car.id, None);
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Object {
    #[serde(flatten)]
    pub box_in_ego: Box3<Ego>,
    /// Velocity over ground along the ego's x and y; NaN where unknown.
    #[serde(default = "unknown_velocity", deserialize_with = "velocity_or_unknown")]
    pub velocity_in_ego_mps: [f64; 2],
    /// The same in all samples of an episode, and unique to the object.
    pub id: Option<String>,
    /// The model's family: `car`, `child`, `hay_bale`, ...
    pub category: Option<String>,
    pub kind: Option<Kind>,
    pub distribution: Option<Distribution>,
    pub n_lidar_points: Option<u32>,
    pub visible_px: Option<u32>,
    /// Visible pixels over the pixels of the whole silhouette inside the image, 0 to 1.
    pub visible_fraction: Option<f64>,
    pub event: Option<Event>,
    /// What is solid of it; `None`: the whole box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub solid: Option<SolidPart>,
    /// From the ground under it to its lowest point; `None`: the ground is the ego's plane.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub clearance_m: Option<f64>,
    /// Where it was put.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spot: Option<Spot>,
    /// Whether it was put on a side.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub is_tipped: Option<bool>,
}

impl Object {
    /// An object of which only the box is known.
    #[must_use]
    pub fn new(box_in_ego: Box3<Ego>) -> Self {
        Self {
            box_in_ego,
            velocity_in_ego_mps: unknown_velocity(),
            id: None,
            category: None,
            kind: None,
            distribution: None,
            n_lidar_points: None,
            visible_px: None,
            visible_fraction: None,
            event: None,
            solid: None,
            clearance_m: None,
            spot: None,
            is_tipped: None,
        }
    }

    /// The box with the ground plan of what is solid, as high as the whole object; its base is the footprint that zones
    /// and distances take.
    #[must_use]
    pub fn solid_in_ego(&self) -> Box3<Ego> {
        let of = self.box_in_ego;
        let Some(SolidPart { along_m, across_m, length_m, width_m }) = self.solid else { return of };
        let (sin, cos) = of.yaw_rad.sin_cos();
        let center = Point::new(
            of.center.x() + along_m * cos - across_m * sin,
            of.center.y() + along_m * sin + across_m * cos,
            of.center.z(),
        );
        Box3 { center, length_m, width_m, ..of }
    }

    /// Whether it is known to be out of distribution.
    #[must_use]
    pub fn is_ood(&self) -> bool {
        self.distribution == Some(Distribution::Ood)
    }

    /// Whether the LiDAR hit it, or may have: unknown counts as hit.
    #[must_use]
    pub fn is_hit(&self) -> bool {
        self.n_lidar_points != Some(0)
    }
}

/// A true object with its label.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LabelledObject {
    #[serde(flatten)]
    pub truth: Object,
    pub harm: Harm,
}

/// Lowest score that a network's box may have.
pub const MIN_SCORE: f32 = 0.01;

/// How far a box's numbers may be off: standard deviations, apart from each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct BoxSpread {
    /// Of the centre, along the ego's axes.
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    /// Of the sizes, as parts of them.
    pub length: f64,
    pub width: f64,
    pub height: f64,
    pub yaw_rad: f64,
}

/// One box that a detector reports.
///
/// ```
/// use harmzone::geometry::{Box3, Point};
/// use harmzone::object::{Detection, Harm};
///
/// let center = Point::new(12.0, 0.5, 0.75);
/// let box_in_ego = Box3 { center, length_m: 4.0, width_m: 1.8, height_m: 1.5, yaw_rad: 0.0 };
/// let found = Detection { box_in_ego, velocity_in_ego_mps: [8.0, 0.0], harm: Harm::Harmful, score: 0.9, spread: None };
/// assert_eq!(found.harm.name(), "harmful");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Detection {
    #[serde(flatten)]
    pub box_in_ego: Box3<Ego>,
    /// Velocity over ground along the ego's x and y; NaN where unknown.
    #[serde(default = "unknown_velocity", deserialize_with = "velocity_or_unknown")]
    pub velocity_in_ego_mps: [f64; 2],
    pub harm: Harm,
    /// Confidence. Networks give 0 to 1; from other detectors any finite number is accepted, since only the
    /// order counts. It has the precision of the file that it came from: ties decide ranks.
    pub score: f64,
    /// `None` where the detector does not tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<BoxSpread>,
}

fn unknown_velocity() -> [f64; 2] {
    [f64::NAN; 2]
}

/// JSON has no NaN, and serde writes null.
fn velocity_or_unknown<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[f64; 2], D::Error> {
    Ok(<[Option<f64>; 2]>::deserialize(deserializer)?.map(|part| part.unwrap_or(f64::NAN)))
}
