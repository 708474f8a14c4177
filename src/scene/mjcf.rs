//! The world as MJCF: static scene, objects, and the ego car.
//!
//! Visual groups: 0 the ground's surface, 1 static scene, 2 objects, 3 collision shapes (and the ground plane at z = 0),
//! 4 the ego. Moving objects are mocap bodies at the top level, in the order of
//! [`Placement::mocap`](super::world::Placement), which is MuJoCo's mocap order.

use std::collections::{BTreeMap, BTreeSet};

use super::builder::{Builder, quaternion_text};
use super::car;
use super::facing::is_plant;
use super::ground::GRASS_M;
use super::lights::Aspect;
use super::models::Role;
use super::path::Vec2;
use super::textures;
use super::tilt::Tilt;
use super::world::{Motion, Placement, World};
use crate::object::Kind;

/// The sun, as parallel light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sun {
    /// Towards the ground, unit length.
    pub direction: [f64; 3],
    pub colour: [f64; 3],
    pub casts_shadow: bool,
}

/// The light under which the world is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lighting {
    /// Light from everywhere.
    pub ambient: [f64; 3],
    /// If `None`, everything is drawn in its own colour.
    pub sun: Option<Sun>,
}

/// Height of the looks that a thing does not have at the moment: far below all that is drawn or lit.
pub const AWAY_Z_M: f64 = -2000.0;

/// MJCF text with the files it names.
#[derive(Debug, Clone)]
pub struct Mjcf {
    pub xml: String,
    pub assets: Vec<(String, Vec<u8>)>,
}

impl World {
    /// The whole world as MJCF.
    pub fn mjcf(&self, lighting: &Lighting) -> Mjcf {
        let mut builder = Builder::default();
        self.add_ground(&mut builder);
        self.add_scenery(&mut builder);
        self.add_objects(&mut builder);
        self.add_event_scenery(&mut builder);
        let [red, green, blue] = lighting.ambient;
        // A little light from the eye makes a thing's sides differ where there is no sun.
        let headlight = if lighting.sun.is_some() { 0.12 } else { 0.0 };
        let contact = self.add_contact(&mut builder);
        let sun = lighting.sun.as_ref().map_or_else(String::new, sun_xml);
        builder.body += &car::body_xml(self.ego_start(), &self.town.surface.ground, &sun);
        let Builder { asset, body, equality, files } = builder;
        let xml = format!(
            "<mujoco model=\"harmzone\">\n<compiler angle=\"radian\" autolimits=\"true\"/>\n\
             <option timestep=\"{}\" integrator=\"implicitfast\" cone=\"elliptic\" impratio=\"5\"/>\n\
             <statistic extent=\"60\" center=\"0 0 0\"/>\n\
             <visual><global offwidth=\"800\" offheight=\"450\"/>\
             <quality shadowsize=\"2048\" offsamples=\"0\" numslices=\"10\" numstacks=\"6\" numquads=\"1\"/>\
             <headlight ambient=\"{red:.3} {green:.3} {blue:.3}\" diffuse=\"{headlight} {headlight} {headlight}\" specular=\"0 0 0\"/>\
             <map znear=\"0.004\" zfar=\"8\" shadowclip=\"1\"/></visual>\n\
             <asset>\n\
             {asset}</asset>\n<worldbody>\n\
             <geom name=\"ground\" {contact} group=\"3\" friction=\"1.1 0.005 0.0001\"/>\n\
             {body}</worldbody>\n<equality>\n{equality}</equality>\n{}</mujoco>\n",
            car::TIMESTEP_S,
            car::ACTUATORS
        );
        Mjcf { xml, assets: files }
    }

    pub(super) fn is_in_sight(&self) -> impl Fn(Vec2) -> bool + use<> {
        let near = self.ego_route.path.points_every(15.0);
        move |point: Vec2| near.iter().any(|other| (point - other).norm() < 160.0)
    }

    /// The ground of wheels and free bodies: a plane, or on slopes the height field.
    fn add_contact(&self, builder: &mut Builder) -> String {
        let Some(grid) = self.town.surface.ground.grid() else {
            return "type=\"plane\" size=\"0 0 1\" pos=\"0 0 0\"".to_owned();
        };
        let (center, half) = grid.extent();
        let (low, high) = grid
            .z_m
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), z| (low.min(*z), high.max(*z)));
        let span_m = (high - low).max(0.01);
        // MuJoCo's own format: rows, columns, then heights, row by row.
        let mut bytes = Vec::with_capacity(8 + 4 * grid.z_m.len());
        for n in [grid.n_y, grid.n_x] {
            bytes.extend((n as i32).to_le_bytes());
        }
        grid.z_m.iter().for_each(|z| bytes.extend(((z - low) / span_m).to_le_bytes()));
        builder.files.push(("ground.hfield".into(), bytes));
        builder.asset += &format!(
            "<hfield name=\"ground\" content_type=\"image/vnd.mujoco.hfield\" file=\"ground.hfield\" size=\"{:.4} {:.4} {span_m:.6} 1\"/>\n",
            half.x, half.y
        );
        format!("type=\"hfield\" hfield=\"ground\" pos=\"{:.4} {:.4} {low:.6}\"", center.x, center.y)
    }

    fn add_ground(&self, builder: &mut Builder) {
        let config = &self.town.config;
        builder.texture("scene_road", textures::ground(config.road_texture));
        builder.texture("scene_pavement", textures::ground(config.sidewalk_texture));
        builder.files.push(("scene_grass.png".into(), textures::ground(config.ground_texture)));
        builder.asset.push_str(
            "<texture name=\"scene_grass\" type=\"2d\" file=\"scene_grass.png\"/>\n\
             <material name=\"scene_grass\" texture=\"scene_grass\" texrepeat=\"0.25 0.25\" texuniform=\"true\" specular=\"0\" shininess=\"0\"/>\n",
        );
        // The terrain stands in for the plane where the land is not flat; beyond it lies the plane.
        let grass_m = if self.town.surface.ground.is_flat() { GRASS_M } else { GRASS_M - 0.5 };
        builder.plain("scene_kerb", [0.5, 0.49, 0.47]);
        builder.plain("scene_marks", [0.86, 0.86, 0.84]);
        if !self.add_basins(builder) {
            builder.body += &format!(
                "<geom name=\"scene_grass\" type=\"plane\" size=\"600 600 1\" pos=\"0 0 {grass_m}\" material=\"scene_grass\" group=\"0\" contype=\"0\" conaffinity=\"0\"/>\n"
            );
        }
        let meshes = self.town.surface.meshes(self.is_in_sight());
        builder.ground("scene_road", "scene_road", &meshes.road);
        builder.ground("scene_pavement", "scene_pavement", &meshes.pavement);
        builder.mesh("scene_kerb", "scene_kerb", &meshes.kerb);
        builder.ground("scene_marks", "scene_marks", &meshes.marks);
        if !meshes.terrain.is_empty() {
            builder.asset.push_str(
                "<material name=\"scene_terrain\" texture=\"scene_grass\" specular=\"0\" shininess=\"0\"/>\n",
            );
            builder.ground("scene_terrain", "scene_terrain", &meshes.terrain);
        }
    }

    /// Models wider than high lie on the slope, all others stand upright.
    fn turn_of(&self, placement: &Placement) -> String {
        let model = &self.models[placement.model];
        let ground = &self.town.surface.ground;
        let is_low = model.height_m() < model.length_m().max(model.width_m());
        if ground.is_flat() || !is_low || model.facts.kind == Kind::Pedestrian {
            let (sin, cos) = (placement.yaw_rad / 2.0).sin_cos();
            return format!("{cos:.6} 0 0 {sin:.6}");
        }
        let (length_m, width_m) = (0.8 * model.length_m(), 0.9 * model.width_m());
        quaternion_text(&ground.stance(placement.position, placement.yaw_rad, length_m, width_m).1)
    }

    /// Lying on a side, on the slope.
    fn lying_turn(&self, placement: &Placement, tilt: &Tilt) -> String {
        let size = tilt.bounds[1] - tilt.bounds[0];
        let stance = self.town.surface.ground.stance(placement.position, placement.yaw_rad, size.x, size.y);
        quaternion_text(&(stance.1 * tilt.turn))
    }

    fn add_objects(&self, builder: &mut Builder) {
        let used: BTreeSet<usize> = self.placements.iter().map(|placement| placement.model).collect();
        for model in used.into_iter().map(|i| &self.models[i]) {
            builder.asset.push_str(&model.assets_xml);
            builder.files.extend(model.files.iter().map(|(name, bytes)| (name.clone(), bytes.to_vec())));
        }
        let mut ordered: Vec<&Placement> = self.placements.iter().collect();
        ordered.sort_by_key(|placement| placement.mocap);
        let light_of: BTreeMap<&str, usize> =
            self.lamp_posts.iter().map(|&(post, light)| (self.placements[post].id.as_str(), light)).collect();
        if !light_of.is_empty() {
            add_lamp_materials(builder);
        }
        for placement in ordered {
            let model = &self.models[placement.model];
            let mut geoms = model.geoms_xml.clone();
            if let Some(&light) = light_of.get(placement.id.as_str()) {
                geoms.push_str(&lamps(light, model.bounds[1].x));
            }
            if let (Some([r, g, b]), Some(paint), Some(xml)) =
                (placement.paint, &model.facts.paint, &model.paint_xml)
            {
                let own = format!("obj:{}/paint", placement.id);
                builder.asset.push_str(&recolour(xml, paint, &own, [r, g, b]));
                geoms = geoms.replace(&format!("material=\"{paint}\""), &format!("material=\"{own}\""));
            }
            if let Motion::Loose(loose) = &placement.motion {
                let at = loose.world_from_model.translation;
                let turn = quaternion_text(&loose.world_from_model.rotation);
                let geoms = geoms.replace("group=\"3\"", "group=\"3\" contype=\"3\" conaffinity=\"3\"");
                builder.body += &format!(
                    "<body name=\"obj:{}\" pos=\"{:.4} {:.4} {:.4}\" quat=\"{turn}\"><freejoint/>\n{geoms}</body>\n",
                    placement.id, at.x, at.y, at.z
                );
                // Holds it until it is let go.
                builder.equality += &format!(
                    "<weld body1=\"obj:{}\" anchor=\"{:.4} {:.4} {:.4}\"/>\n",
                    placement.id, at.x, at.y, at.z
                );
                continue;
            }
            if model.facts.role == Role::Background && is_plant(&model.facts.category) {
                // Things fall into bushes and through them; and the physics has less to do.
                geoms = geoms.replace("group=\"3\"", "group=\"3\" contype=\"0\" conaffinity=\"0\"");
            }
            let (x, y, z) = (placement.position.x, placement.position.y, placement.z_m);
            let turn = placement
                .tilt
                .as_ref()
                .map_or_else(|| self.turn_of(placement), |tilt| self.lying_turn(placement, tilt));
            let mocap = if placement.mocap.is_some() { " mocap=\"true\"" } else { "" };
            builder.body += &format!(
                "<body name=\"obj:{}\" pos=\"{x:.4} {y:.4} {z:.4}\" quat=\"{turn}\"{mocap}>\n{geoms}</body>\n",
                placement.id
            );
            for (i, shape) in model.shapes.iter().enumerate() {
                let z = if i == 0 { z } else { AWAY_Z_M };
                builder.body += &format!(
                    "<body name=\"obj:{}/{i}\" pos=\"{x:.4} {y:.4} {z:.4}\" quat=\"{turn}\"{mocap}>\n{}</body>\n",
                    placement.id, shape.geoms_xml
                );
            }
        }
    }
}

/// Lamps of a traffic light from the top: name, and colour when lit.
const LAMPS: [(&str, [f64; 3]); 3] =
    [("red", [0.95, 0.08, 0.05]), ("yellow", [0.98, 0.72, 0.05]), ("green", [0.1, 0.9, 0.35])];
/// Height of the middle lamp, and the way to its neighbours.
const LAMP_M: f64 = 2.88;
const LAMP_STEP_M: f64 = 0.3;

/// The geoms of a light's lamps with the materials they show, from the top.
pub fn lamps_of(light: usize, aspect: Aspect) -> [(String, String); 3] {
    let lit = match aspect {
        Aspect::Red => 0,
        Aspect::Yellow => 1,
        Aspect::Green => 2,
    };
    std::array::from_fn(|i| {
        let state = if i == lit { "lit" } else { "dark" };
        (format!("lamp:{light}:{i}"), format!("lamp_{}_{state}", LAMPS[i].0))
    })
}

fn add_lamp_materials(builder: &mut Builder) {
    for (name, [r, g, b]) in LAMPS {
        let dim = [r, g, b].map(|c| 0.22 * c);
        builder.asset += &format!(
            "<material name=\"lamp_{name}_lit\" rgba=\"{r} {g} {b} 1\" emission=\"1\"/>\n\
             <material name=\"lamp_{name}_dark\" rgba=\"{:.3} {:.3} {:.3} 1\" specular=\"0.3\"/>\n",
            dim[0], dim[1], dim[2]
        );
    }
}

/// Discs on the head's front.
fn lamps(light: usize, front_m: f64) -> String {
    let disc = |(i, (geom, _)): (usize, (String, String))| {
        let z_m = LAMP_M + LAMP_STEP_M * (1.0 - i as f64);
        format!(
            "<geom name=\"{geom}\" type=\"cylinder\" size=\"0.11 0.008\" pos=\"{front_m:.4} 0 {z_m:.3}\" \
             quat=\"0.7071068 0 0.7071068 0\" material=\"lamp_{}_dark\" group=\"2\" contype=\"0\" conaffinity=\"0\" mass=\"0\"/>\n",
            LAMPS[i].0
        )
    };
    lamps_of(light, Aspect::Red).into_iter().enumerate().map(disc).collect()
}

/// A material's element under another name and colour.
fn recolour(xml: &str, name: &str, own: &str, [r, g, b]: [f64; 3]) -> String {
    let renamed = xml.replace(&format!("name=\"{name}\""), &format!("name=\"{own}\""));
    let colour = format!("rgba=\"{r:.3} {g:.3} {b:.3} 1\"");
    match renamed.find("rgba=\"").and_then(|start| {
        let end = start + 6 + renamed[start + 6..].find('"')?;
        Some(start..=end)
    }) {
        Some(range) => {
            let mut text = renamed;
            text.replace_range(range, &colour);
            text + "\n"
        }
        None => renamed.replacen("<material", &format!("<material {colour}"), 1) + "\n",
    }
}

/// The sun stands still over the ego, so that its shadows are sharp wherever the ego is.
fn sun_xml(sun: &Sun) -> String {
    const DISTANCE_M: f64 = 60.0;
    let [x, y, z] = sun.direction;
    let [red, green, blue] = sun.colour;
    format!(
        "<light name=\"sun\" mode=\"track\" directional=\"true\" castshadow=\"{}\" pos=\"{:.3} {:.3} {:.3}\" \
         dir=\"{x:.5} {y:.5} {z:.5}\" diffuse=\"{red:.3} {green:.3} {blue:.3}\" specular=\"0.2 0.2 0.2\" ambient=\"0 0 0\"/>",
        sun.casts_shadow,
        -DISTANCE_M * x,
        -DISTANCE_M * y,
        -DISTANCE_M * z,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recoloured_material_has_its_own_name_and_colour() {
        let xml = "<material name=\"car/paint\" rgba=\"1 0 0 1\" specular=\"0.5\"/>";
        let own = recolour(xml, "car/paint", "obj:a/paint", [0.0, 0.5, 1.0]);
        assert_eq!(own, "<material name=\"obj:a/paint\" rgba=\"0.000 0.500 1.000 1\" specular=\"0.5\"/>\n");
    }
}
