//! How each geom sends LiDAR light back: reflectivity at about 905 nm and finish, by the name of its material.
//!
//! Usual figures: worn asphalt 0.17, concrete 0.3, road paint 0.55; plants are bright in the near infrared (0.4 to 0.5), so is
//! skin; rubber and black plastic send back 5 %; car paint from 3 % (black) to 60 % (white), mostly as a mirror does;
//! sheeting of plates and signs many times what white paint does (VLP-16 manual, 6.1: "retroreflectors pop").

use crate::object::Kind;
use crate::scene::SceneObject;
use crate::sensors::lidar::Finish;

/// Geoms without an object, by the start of the geom's name.
const GROUNDS: [(&str, f64, Finish); 23] = [
    ("scene_road", 0.17, Finish::Rough),
    ("scene_pavement", 0.3, Finish::Rough),
    ("scene_kerb", 0.3, Finish::Rough),
    ("scene_marks", 0.55, Finish::Rough),
    ("scene_grass", 0.4, Finish::Rough),
    ("scene_facade", 0.35, Finish::Rough),
    ("scene_shop", 0.3, Finish::Rough),
    ("scene_gable", 0.35, Finish::Rough),
    ("scene_landmark_container", 0.35, Finish::Glossy),
    // Water takes the light in, or sends it away from the sensor as a mirror does.
    ("scene_water", 0.004, Finish::Glossy),
    ("scene_hedge", 0.45, Finish::Leafy),
    ("scene_ivy", 0.5, Finish::Rough),
    ("scene_fence", 0.45, Finish::Rough),
    ("scene_wall", 0.35, Finish::Rough),
    ("scene_dry_stone", 0.3, Finish::Rough),
    ("scene_barrier", 0.3, Finish::Rough),
    // Zinc on steel.
    ("scene_steel", 0.45, Finish::Glossy),
    ("scene_yard", 0.2, Finish::Glossy),
    ("scene_pipes", 0.3, Finish::Glossy),
    ("scene_fittings", 0.35, Finish::Matt),
    ("scene_awning", 0.5, Finish::Matt),
    ("scene_litter", 0.6, Finish::Matt),
    ("scene_wires", 0.06, Finish::Matt),
];
/// All other geoms without an object.
const OTHER: Surface = Surface { reflectivity: 0.25, finish: Finish::Rough };

/// Materials of models, by the last part of their names.
const MATERIALS: [(&str, f64, Finish); 22] = [
    ("glass", 0.1, Finish::Glass),
    ("pane", 0.1, Finish::Glass),
    ("plate", 30.0, Finish::Retro),
    ("headlamp", 0.6, Finish::Retro),
    ("taillamp", 4.0, Finish::Retro),
    ("tyre", 0.05, Finish::Matt),
    ("trim", 0.05, Finish::Matt),
    ("rim", 0.4, Finish::Glossy),
    ("steel", 0.4, Finish::Glossy),
    ("dark_steel", 0.15, Finish::Glossy),
    ("leaves", 0.45, Finish::Leafy),
    ("leaves_dark", 0.4, Finish::Leafy),
    ("leaves_light", 0.55, Finish::Leafy),
    ("bark", 0.3, Finish::Rough),
    ("twigs", 0.3, Finish::Rough),
    ("bag", 0.5, Finish::Matt),
    ("black", 0.05, Finish::Matt),
    ("concrete", 0.3, Finish::Rough),
    ("stone", 0.3, Finish::Rough),
    ("soil", 0.2, Finish::Rough),
    ("straw", 0.5, Finish::Rough),
    ("skin", 0.55, Finish::Matt),
];
/// Materials of models of these categories that are covered with retroreflecting sheeting.
const SHEETING: [(&str, &[&str], f64); 3] = [
    ("traffic_sign", &["white", "red"], 30.0),
    ("construction_cone", &["white"], 10.0),
    ("barrier", &["red", "white"], 3.0),
];

/// What a beam meets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Surface {
    /// At right angles; 1 is white, retroreflectors are above.
    pub reflectivity: f64,
    pub finish: Finish,
}

/// The surface of a geom by its name, or, on an object, by its material's name; `paint` is the object's own colour.
pub(super) fn surface_of(
    geom: &str,
    material: &str,
    object: Option<&SceneObject>,
    paint: Option<[f64; 3]>,
) -> Surface {
    let Some(object) = object else {
        let known = GROUNDS.iter().find(|(start, ..)| geom.starts_with(start));
        return known.map_or(OTHER, |&(_, reflectivity, finish)| Surface { reflectivity, finish });
    };
    let part = material.rsplit('/').next().unwrap_or_default();
    let sheeting =
        SHEETING.iter().find(|(category, parts, _)| object.category == *category && parts.contains(&part));
    if let Some(&(.., reflectivity)) = sheeting {
        return Surface { reflectivity, finish: Finish::Retro };
    }
    if part == "paint" && object.kind == Kind::Vehicle {
        let reflectivity = paint.map_or(object.reflectivity, paint_reflectivity);
        return Surface { reflectivity, finish: Finish::Glossy };
    }
    let known = MATERIALS.iter().find(|(name, ..)| *name == part);
    known.map_or(
        Surface { reflectivity: object.reflectivity, finish: Finish::Matt },
        |&(_, reflectivity, finish)| Surface { reflectivity, finish },
    )
}

/// Of car paint by its colour: pigments that are dark to the eye are mostly dark at 905 nm.
fn paint_reflectivity([red, green, blue]: [f64; 3]) -> f64 {
    let brightness = 0.4 * red + 0.4 * green + 0.2 * blue;
    0.02 + 0.6 * brightness * brightness
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::object::{Distribution, Event, Spot};
    use std::sync::Arc;

    fn object(category: &str, kind: Kind) -> SceneObject {
        SceneObject {
            id: "a".into(),
            category: category.into(),
            kind,
            distribution: Distribution::Id,
            body_name: "obj:a".into(),
            bounds: [[0.0; 3].into(), [1.0; 3].into()],
            solid: [[0.0; 3].into(), [1.0; 3].into()],
            is_background: false,
            triangles: Arc::default(),
            shapes: Vec::new(),
            reflectivity: 0.35,
            event: Event::None,
            spot: Spot::None,
            is_tipped: false,
        }
    }

    #[test]
    fn parts_of_a_car_differ_and_black_paint_sends_little_back() {
        let car = object("car", Kind::Vehicle);
        let of = |material: &str, paint| surface_of("", material, Some(&car), paint);
        let (white, black) = (of("obj:a/paint", Some([0.9; 3])), of("obj:a/paint", Some([0.05; 3])));
        assert!(white.reflectivity > 0.45 && black.reflectivity < 0.03);
        assert_eq!((white.finish, of("car/glass", None).finish), (Finish::Glossy, Finish::Glass));
        assert!(of("car/plate", None).reflectivity > 10.0 && of("car/tyre", None).reflectivity < 0.1);
    }

    #[test]
    fn plants_are_brighter_than_the_road_whether_scenery_or_models() {
        let bush = object("bush", Kind::Static);
        for name in ["bush_wild/leaves", "bush_wild/leaves_dark", "bush_wild/leaves_light"] {
            let leaves = surface_of("", name, Some(&bush), None);
            assert!(
                (0.4..=0.6).contains(&leaves.reflectivity) && leaves.finish == Finish::Leafy,
                "{name}: {leaves:?}"
            );
        }
        // Beams do not go far among ivy and grass.
        for (name, finish) in [
            ("scene_hedge_1", Finish::Leafy),
            ("scene_ivy_0", Finish::Rough),
            ("scene_grass_tufts_1", Finish::Rough),
        ] {
            let leaves = surface_of(name, "", None, None);
            assert!(
                (0.4..=0.6).contains(&leaves.reflectivity) && leaves.finish == finish,
                "{name}: {leaves:?}"
            );
        }
        assert_eq!(surface_of("scene_steel", "", None, None).finish, Finish::Glossy);
    }

    #[test]
    fn what_no_table_knows_keeps_its_models_reflectivity() {
        let barrel = object("barrel", Kind::Static);
        let wanted = Surface { reflectivity: 0.35, finish: Finish::Matt };
        assert_eq!(surface_of("", "barrel_a/paint", Some(&barrel), None), wanted);
        assert_eq!(surface_of("scene_road_3", "", None, None).reflectivity, 0.17);
        assert_eq!(surface_of("ground", "", None, None), OTHER);
        let sign = object("traffic_sign", Kind::Static);
        assert_eq!(surface_of("", "traffic_sign/red", Some(&sign), None).finish, Finish::Retro);
    }
}
