//! A row of KITTI's label and result files.
//!
//! `type truncated occluded alpha left top right bottom height width length x y z rotation_y [score]`, metres, radians, pixels.

use std::fmt;

use super::rig::{KittiRig, RectifiedBox};
use crate::export::nuscenes::Naming;
use crate::geometry::{Box3, Ego};
use crate::object::{Harm, Kind, Object};
use crate::sample::IgnoredRegion;

/// Least visible fraction of objects that count as fully visible (0) and as partly occluded (1); the others are largely
/// occluded (2). KITTI's annotators judged by eye; these are the edges of nuScenes' visibility bins.
const VISIBLE_ENOUGH: [f64; 2] = [0.8, 0.4];
/// Height of what may stand on ignored ground: that of a tall van, metres.
const IGNORED_HEIGHT_M: f64 = 2.5;
/// Edges of a box that is not in the picture, in a file of results.
const UNSEEN_PX: [f64; 4] = [-1.0; 4];

/// A row.
#[derive(Debug, Clone, PartialEq)]
pub struct KittiRow {
    pub name: String,
    /// 0 to 1; -1 where it does not apply.
    truncation: f64,
    /// 0, 1 or 2; -1 where nobody knows.
    occlusion: i8,
    alpha_rad: f64,
    /// Left, top, right, bottom.
    edges_px: [f64; 4],
    pub of: RectifiedBox,
    pub score: Option<f64>,
}

impl KittiRow {
    /// The label of an object; `None` where it is not in the picture.
    pub(super) fn of_object(name: String, object: &Object, rig: &KittiRig) -> Option<Self> {
        let seen = rig.picture_box(&object.box_in_ego)?;
        let of = rig.rectified(&object.box_in_ego);
        let occlusion = object
            .visible_fraction
            .map_or(-1, |share| VISIBLE_ENOUGH.iter().filter(|&&least| share < least).count() as i8);
        let (truncation, alpha_rad) = (seen.truncation, of.alpha_rad());
        Some(Self { name, truncation, occlusion, alpha_rad, edges_px: seen.edges_px, of, score: None })
    }

    /// A detector's box.
    #[must_use]
    pub fn of_detection(name: &str, found: &Box3<Ego>, score: f64, rig: &KittiRig) -> Self {
        let of = rig.rectified(found);
        Self {
            name: name.to_owned(),
            truncation: -1.0,
            occlusion: -1,
            alpha_rad: of.alpha_rad(),
            edges_px: rig.picture_box(found).map_or(UNSEEN_PX, |seen| seen.edges_px),
            of,
            score: Some(score),
        }
    }

    /// A region of the picture in which nobody annotated; `None` where it is not in the picture.
    pub(super) fn of_ignored(region: &IgnoredRegion, rig: &KittiRig) -> Option<Self> {
        let edges_px = match region {
            IgnoredRegion::Image { left_px, top_px, right_px, bottom_px } => {
                [*left_px, *top_px, *right_px, *bottom_px]
            }
            IgnoredRegion::Ground { corners_in_ego_m } => {
                let at = |z_m: f64| {
                    corners_in_ego_m.iter().map(move |corner| [corner.x_m, corner.y_m, z_m].into())
                };
                let corners: Vec<_> = at(0.0).chain(at(IGNORED_HEIGHT_M)).collect();
                rig.frame_columns(&corners)?.edges_px
            }
        };
        let of = RectifiedBox { size_m: [-1.0; 3], bottom_m: [-1000.0; 3], rotation_y_rad: -10.0 };
        let name = "DontCare".to_owned();
        Some(Self { name, truncation: -1.0, occlusion: -1, alpha_rad: -10.0, edges_px, of, score: None })
    }

    /// Reads a row of results, which ends with the score.
    ///
    /// # Errors
    /// What is needed in place of what was found.
    pub fn parse_result(line: &str) -> Result<Self, String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        let &[name, ref numbers @ ..] = words.as_slice() else { return Err("an empty row".to_owned()) };
        if numbers.len() != 15 {
            return Err(format!(
                "{} columns; 16 are needed: type truncated occluded alpha left top right bottom height width length x y z \
                 rotation_y score",
                words.len()
            ));
        }
        let parse = |(i, word): (usize, &&str)| {
            let number = word.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| format!("column {} is `{word}`; a finite number is needed", i + 2))
        };
        let numbers: Vec<f64> = numbers.iter().enumerate().map(parse).collect::<Result<_, _>>()?;
        let of = RectifiedBox {
            size_m: std::array::from_fn(|i| numbers[7 + i]),
            bottom_m: std::array::from_fn(|i| numbers[10 + i]),
            rotation_y_rad: numbers[13],
        };
        if let Some(found) = of.size_m.iter().find(|size| **size <= 0.0) {
            return Err(format!("a size is {found}; sizes above 0 are needed"));
        }
        Ok(Self {
            name: name.to_owned(),
            truncation: numbers[0],
            occlusion: numbers[1] as i8,
            alpha_rad: numbers[2],
            edges_px: std::array::from_fn(|i| numbers[3 + i]),
            of,
            score: Some(numbers[14]),
        })
    }
}

impl fmt::Display for KittiRow {
    /// Nine decimals, so that boxes come back to the nanometre; KITTI's own files have two.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let is_region = self.alpha_rad == -10.0;
        let (name, [left, top, right, bottom]) = (&self.name, self.edges_px);
        let ([height, width, length], [x, y, z]) = (self.of.size_m, self.of.bottom_m);
        if is_region {
            // As in KITTI's own files, to the letter, but for the digits of the edges.
            return write!(
                f,
                "{name} -1 -1 -10 {left} {top} {right} {bottom} -1 -1 -1 -1000 -1000 -1000 -10"
            );
        }
        write!(
            f,
            "{name} {} {} {:.6} {left:.4} {top:.4} {right:.4} {bottom:.4} {height:.9} {width:.9} {length:.9} {x:.9} {y:.9} {z:.9} \
             {:.9}",
            format_truncation(self.truncation),
            self.occlusion,
            self.alpha_rad,
            self.of.rotation_y_rad
        )?;
        self.score.map_or(Ok(()), |score| write!(f, " {score}"))
    }
}

fn format_truncation(truncation: f64) -> String {
    if truncation < 0.0 { "-1".to_owned() } else { format!("{truncation:.4}") }
}

/// The type of an object in a label file; `harm` is there where labels are needed.
pub(super) fn type_of(naming: Naming, object: &Object, harm: Option<Harm>) -> String {
    match (naming, harm, object.kind) {
        (Naming::Harm | Naming::HarmAsCarTruck, Some(harm), _) => type_of_harm(naming, harm).to_owned(),
        (Naming::Source, _, _) if object.category.is_some() => {
            let category = object.category.as_deref().unwrap_or_default();
            // A type is one word.
            category.split_whitespace().collect::<Vec<_>>().join("_")
        }
        (_, _, Some(Kind::Vehicle)) => "Car".to_owned(),
        (_, _, Some(Kind::Pedestrian)) => "Pedestrian".to_owned(),
        _ => "Misc".to_owned(),
    }
}

/// The type of a class of harm.
#[must_use]
pub fn type_of_harm(naming: Naming, harm: Harm) -> &'static str {
    match (naming, harm) {
        (Naming::HarmAsCarTruck, Harm::Harmful) => "Car",
        (Naming::HarmAsCarTruck, Harm::Harmless) => "Truck",
        (_, Harm::Harmful) => "Harmful",
        (_, Harm::Harmless) => "Harmless",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::geometry::{Point, Point2};

    fn rig() -> KittiRig {
        KittiRig::of(&test_data::dataset(1).samples()[0].measured, None).unwrap()
    }

    fn object(visible_fraction: Option<f64>) -> Object {
        let center = Point::new(20.0, -3.0, 0.8);
        let box_in_ego = Box3 { center, length_m: 4.25, width_m: 1.75, height_m: 1.5, yaw_rad: 0.3 };
        Object { visible_fraction, kind: Some(Kind::Vehicle), ..Object::new(box_in_ego) }
    }

    #[test]
    fn a_label_has_fifteen_columns_and_a_result_sixteen_that_read_back() {
        let rig = rig();
        let label = KittiRow::of_object("Car".into(), &object(Some(0.5)), &rig).unwrap().to_string();
        let words: Vec<&str> = label.split(' ').collect();
        assert_eq!((words.len(), words[0], words[1], words[2]), (15, "Car", "0.0000", "1"));
        assert_eq!(&words[8..11], ["1.500000000", "1.750000000", "4.250000000"]);
        let given = object(None).box_in_ego;
        let result = KittiRow::of_detection("Harmful", &given, 0.125, &rig).to_string();
        let back = KittiRow::parse_result(&result).unwrap();
        let found = rig.in_ego(&back.of);
        assert!(
            (found.center.coords - given.center.coords).norm() < 1e-8 && (found.yaw_rad - 0.3).abs() < 1e-8
        );
        assert_eq!((back.name.as_str(), back.score), ("Harmful", Some(0.125)));
    }

    #[test]
    fn occlusion_follows_the_visible_fraction_and_is_unknown_without() {
        let occlusion = |share| KittiRow::of_object("Car".into(), &object(share), &rig()).unwrap().occlusion;
        assert_eq!(
            [Some(1.0), Some(0.8), Some(0.79), Some(0.4), Some(0.1), None].map(occlusion),
            [0, 0, 1, 1, 2, -1]
        );
    }

    #[test]
    fn ignored_regions_are_dont_care_in_the_picture() {
        let image = IgnoredRegion::Image { left_px: 1.5, top_px: 2.0, right_px: 3.0, bottom_px: 4.25 };
        let text = KittiRow::of_ignored(&image, &rig()).unwrap().to_string();
        assert_eq!(text, "DontCare -1 -1 -10 1.5 2 3 4.25 -1 -1 -1 -1000 -1000 -1000 -10");
        let square = |x_m: f64| {
            let corners = [(x_m, -1.0), (x_m + 2.0, -1.0), (x_m + 2.0, 1.0), (x_m, 1.0)];
            IgnoredRegion::Ground { corners_in_ego_m: corners.map(|(x_m, y_m)| Point2 { x_m, y_m }).into() }
        };
        let ahead = KittiRow::of_ignored(&square(20.0), &rig()).unwrap();
        let [left, top, right, bottom] = ahead.edges_px;
        assert!((left + right - 160.0).abs() < 1e-9 && top < 45.0 && bottom > 45.0, "{ahead}");
        assert_eq!(KittiRow::of_ignored(&square(-20.0), &rig()), None);
    }

    #[test]
    fn rows_that_are_no_result_say_what_is_needed() {
        let told = |line: &str| KittiRow::parse_result(line).unwrap_err();
        assert!(told("Car 0 0 0 1 2 3 4 1 1 1 0 0 9 0").contains("15 columns; 16 are needed"));
        assert!(told("Car 0 0 0 1 2 3 4 1 1 1 0 x 9 0 0.5").contains("column 13 is `x`"));
        assert!(told("Car 0 0 0 1 2 3 4 1 0 1 0 0 9 0 0.5").contains("above 0"));
    }

    #[test]
    fn types_are_harm_kinds_or_the_source_s_own_in_one_word() {
        let van = Object { category: Some("delivery van".into()), ..object(None) };
        let names = Naming::ALL.map(|naming| type_of(naming, &van, Some(Harm::Harmless)));
        assert_eq!(names, ["Harmless", "Truck", "Car", "delivery_van"]);
        let thing = Object { kind: Some(Kind::Static), ..object(None) };
        assert_eq!(
            [Naming::Kinds, Naming::Source].map(|naming| type_of(naming, &thing, None)),
            ["Misc", "Misc"]
        );
    }
}
