//! The world as MJCF: static scene, objects, and the ego car.
//!
//! Visual groups: 1 static scene, 2 objects, 3 collision shapes (and the ground plane at z = 0),
//! 4 the ego. Moving objects are mocap bodies at the top level, in the order of
//! [`Placement::mocap`](super::populate::Placement), which is MuJoCo's mocap order.
//!
//! The body `ego` has its origin at the rear-axle centre projected to the ground, x forward: its
//! pose is the ego frame. Dimensions are a Renault Zoe's, the car of nuScenes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use nalgebra::{UnitQuaternion, Vector3};

use super::ground::Ground;
use super::lights::Aspect;
use super::mesh::TriangleMesh;
use super::path::Vec2;
use super::populate::{Motion, Placement, World};
use super::surface::GRASS_M;
use super::textures;
use crate::object::Kind;

/// Distance between the axles.
pub const WHEELBASE_M: f64 = 2.588;
/// Front bumper's x in the ego frame.
pub const FRONT_BUMPER_X_M: f64 = 3.35;
pub const EGO_LENGTH_M: f64 = 4.084;
pub const EGO_WIDTH_M: f64 = 1.730;
pub const EGO_HEIGHT_M: f64 = 1.562;
/// Distance between the wheels of an axle.
pub const TRACK_M: f64 = 1.51;
pub const WHEEL_RADIUS_M: f64 = 0.31;
/// Largest road-wheel angle.
pub const MAX_STEERING_RAD: f64 = 0.6;
/// Physics step.
pub const TIMESTEP_S: f64 = 0.005;
/// Time constant of the wheels' speed control: a target of `speed + a * this` yields about `a`.
pub const DRIVE_RESPONSE_S: f64 = 0.15;
const EGO_MASS_KG: f64 = 1500.0;

/// Order of the actuators, which is the order of `ctrl`.
pub const STEER_LEFT: usize = 0;
pub const STEER_RIGHT: usize = 1;
pub const SPIN_FRONT_LEFT: usize = 2;
pub const SPIN_FRONT_RIGHT: usize = 3;
pub const SPIN_REAR_LEFT: usize = 4;
pub const SPIN_REAR_RIGHT: usize = 5;
pub const N_ACTUATORS: usize = 6;

/// What the driver asks of the car.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EgoCommand {
    /// Speed that the wheels are driven towards; see [`DRIVE_RESPONSE_S`].
    pub target_speed_mps: f64,
    /// Ackermann mean of the road wheels, positive to the left.
    pub steering_angle_rad: f64,
}

impl EgoCommand {
    /// The actuators' inputs, in their order: front wheel angles by Ackermann, wheel spin rates.
    #[must_use]
    pub fn ctrl(&self) -> [f64; N_ACTUATORS] {
        let mean = self.steering_angle_rad.clamp(-MAX_STEERING_RAD, MAX_STEERING_RAD);
        let curvature = mean.tan() / WHEELBASE_M;
        let (narrow, wide) = (1.0 - curvature * TRACK_M / 2.0, 1.0 + curvature * TRACK_M / 2.0);
        let (left, right) =
            ((WHEELBASE_M * curvature / narrow).atan(), (WHEELBASE_M * curvature / wide).atan());
        let rate = self.target_speed_mps / WHEEL_RADIUS_M;
        [left, right, rate * narrow / left.cos(), rate * wide / right.cos(), rate * narrow, rate * wide]
    }
}

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
    /// From everywhere.
    pub ambient: [f64; 3],
    /// Without it everything is drawn in its own colour.
    pub sun: Option<Sun>,
}

/// MJCF text with the files it names.
#[derive(Debug, Clone)]
pub struct Mjcf {
    pub xml: String,
    pub assets: Vec<(String, Vec<u8>)>,
}

pub(super) const TOLD: &str = "writing to a string cannot fail";

#[derive(Default)]
pub(super) struct Builder {
    asset: String,
    pub(super) body: String,
    equality: String,
    files: Vec<(String, Vec<u8>)>,
}

impl Builder {
    pub(super) fn texture(&mut self, name: &str, png: Vec<u8>) {
        writeln!(self.asset, "<texture name=\"{name}\" type=\"2d\" file=\"{name}.png\"/>").expect(TOLD);
        writeln!(
            self.asset,
            "<material name=\"{name}\" texture=\"{name}\" specular=\"0.05\" shininess=\"0.05\"/>"
        )
        .expect(TOLD);
        self.files.push((format!("{name}.png"), png));
    }

    pub(super) fn plain(&mut self, name: &str, [r, g, b]: [f64; 3]) {
        writeln!(
            self.asset,
            "<material name=\"{name}\" rgba=\"{r} {g} {b} 1\" specular=\"0.05\" shininess=\"0.05\"/>"
        )
        .expect(TOLD);
    }

    /// A static mesh of group 1.
    pub(super) fn mesh(&mut self, name: &str, material: &str, mesh: &TriangleMesh) {
        if mesh.is_empty() {
            return;
        }
        self.files.push((format!("{name}.obj"), mesh.to_obj().into_bytes()));
        writeln!(self.asset, "<mesh name=\"{name}\" file=\"{name}.obj\" inertia=\"shell\"/>").expect(TOLD);
        writeln!(
            self.body,
            "<geom name=\"{name}\" type=\"mesh\" mesh=\"{name}\" material=\"{material}\" group=\"1\" contype=\"0\" conaffinity=\"0\"/>"
        )
        .expect(TOLD);
    }
}

impl World {
    /// The whole world as MJCF.
    #[must_use]
    pub fn mjcf(&self, lighting: &Lighting) -> Mjcf {
        let mut builder = Builder::default();
        self.add_ground(&mut builder);
        self.add_scenery(&mut builder);
        self.add_objects(&mut builder);
        self.add_event_scenery(&mut builder);
        let [red, green, blue] = lighting.ambient;
        // A little light from the eye tells a thing's sides apart where no sun does.
        let headlight = if lighting.sun.is_some() { 0.12 } else { 0.0 };
        let contact = self.add_contact(&mut builder);
        add_ego(&mut builder, self.ego_start(), &self.town.surface.ground, lighting.sun.as_ref());
        let Builder { asset, body, equality, files } = builder;
        let xml = format!(
            "<mujoco model=\"harmzone\">\n<compiler angle=\"radian\" autolimits=\"true\"/>\n\
             <option timestep=\"{TIMESTEP_S}\" integrator=\"implicitfast\" cone=\"elliptic\" impratio=\"5\"/>\n\
             <statistic extent=\"60\" center=\"0 0 0\"/>\n\
             <visual><global offwidth=\"800\" offheight=\"450\"/>\
             <quality shadowsize=\"2048\" offsamples=\"0\" numslices=\"10\" numstacks=\"6\" numquads=\"1\"/>\
             <headlight ambient=\"{red:.3} {green:.3} {blue:.3}\" diffuse=\"{headlight} {headlight} {headlight}\" specular=\"0 0 0\"/>\
             <map znear=\"0.004\" zfar=\"8\" shadowclip=\"1\"/></visual>\n\
             <asset>\n\
             {asset}</asset>\n<worldbody>\n\
             <geom name=\"ground\" {contact} group=\"3\" friction=\"1.1 0.005 0.0001\"/>\n\
             {body}</worldbody>\n<equality>\n{equality}</equality>\n{ACTUATORS}</mujoco>\n"
        );
        Mjcf { xml, assets: files }
    }

    pub(super) fn is_in_sight(&self) -> impl Fn(Vec2) -> bool + use<> {
        let near = self.ego_route.path.sampled(15.0);
        move |point: Vec2| near.iter().any(|other| (point - other).norm() < 160.0)
    }

    /// What wheels and free bodies stand on: a plane, or on slopes the height field of the ground.
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
        writeln!(
            builder.asset,
            "<hfield name=\"ground\" content_type=\"image/vnd.mujoco.hfield\" file=\"ground.hfield\" size=\"{:.4} {:.4} {span_m:.6} 1\"/>",
            half.x, half.y
        )
        .expect(TOLD);
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
        writeln!(
            builder.body,
            "<geom name=\"scene_grass\" type=\"plane\" size=\"600 600 1\" pos=\"0 0 {grass_m}\" material=\"scene_grass\" group=\"1\" contype=\"0\" conaffinity=\"0\"/>"
        )
        .expect(TOLD);
        let meshes = self.town.surface.meshes(self.is_in_sight());
        builder.mesh("scene_road", "scene_road", &meshes.road);
        builder.mesh("scene_pavement", "scene_pavement", &meshes.pavement);
        builder.mesh("scene_kerb", "scene_kerb", &meshes.kerb);
        builder.mesh("scene_marks", "scene_marks", &meshes.marks);
        if !meshes.terrain.is_empty() {
            builder.asset.push_str(
                "<material name=\"scene_terrain\" texture=\"scene_grass\" specular=\"0\" shininess=\"0\"/>\n",
            );
            builder.mesh("scene_terrain", "scene_terrain", &meshes.terrain);
        }
    }

    /// What is wider than high lies on the slope, all else stands upright.
    fn turn_of(&self, placement: &Placement) -> String {
        let model = &self.models.models[placement.model];
        let ground = &self.town.surface.ground;
        let is_low = model.height_m() < model.length_m().max(model.width_m());
        if ground.is_flat() || !is_low || model.kind == Kind::Pedestrian {
            let (sin, cos) = (placement.yaw_rad / 2.0).sin_cos();
            return format!("{cos:.6} 0 0 {sin:.6}");
        }
        let (length_m, width_m) = (0.8 * model.length_m(), 0.9 * model.width_m());
        quaternion(&ground.stance(placement.position, placement.yaw_rad, length_m, width_m).1)
    }

    fn add_objects(&self, builder: &mut Builder) {
        let used: BTreeSet<usize> = self.placements.iter().map(|placement| placement.model).collect();
        for model in used.into_iter().map(|i| &self.models.models[i]) {
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
            let model = &self.models.models[placement.model];
            let mut geoms = model.geoms_xml.clone();
            if let Some(&light) = light_of.get(placement.id.as_str()) {
                geoms.push_str(&lamps(light, model.bounds.1[0]));
            }
            if let (Some([r, g, b]), Some(paint), Some(xml)) =
                (placement.paint, &model.paint, &model.paint_xml)
            {
                let own = format!("obj:{}/paint", placement.id);
                builder.asset.push_str(&recoloured(xml, paint, &own, [r, g, b]));
                geoms = geoms.replace(&format!("material=\"{paint}\""), &format!("material=\"{own}\""));
            }
            if let Motion::Loose(loose) = &placement.motion {
                let (at, turn) = (loose.world_from_model.translation, loose.world_from_model.rotation);
                let geoms = geoms.replace("group=\"3\"", "group=\"3\" contype=\"3\" conaffinity=\"3\"");
                writeln!(
                    builder.body,
                    "<body name=\"obj:{}\" pos=\"{:.4} {:.4} {:.4}\" quat=\"{:.6} {:.6} {:.6} {:.6}\"><freejoint/>\n{geoms}</body>",
                    placement.id, at.x, at.y, at.z, turn.w, turn.i, turn.j, turn.k
                )
                .expect(TOLD);
                // Holds it until it is let go.
                writeln!(
                    builder.equality,
                    "<weld body1=\"obj:{}\" anchor=\"{:.4} {:.4} {:.4}\"/>",
                    placement.id, at.x, at.y, at.z
                )
                .expect(TOLD);
                continue;
            }
            let (x, y, z) = (placement.position.x, placement.position.y, placement.z_m);
            let turn = self.turn_of(placement);
            let mocap = if placement.mocap.is_some() { " mocap=\"true\"" } else { "" };
            writeln!(
                builder.body,
                "<body name=\"obj:{}\" pos=\"{x:.4} {y:.4} {z:.4}\" quat=\"{turn}\"{mocap}>\n{geoms}</body>",
                placement.id
            )
            .expect(TOLD);
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
#[must_use]
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
        writeln!(
            builder.asset,
            "<material name=\"lamp_{name}_lit\" rgba=\"{r} {g} {b} 1\" emission=\"1\"/>\n\
             <material name=\"lamp_{name}_dark\" rgba=\"{:.3} {:.3} {:.3} 1\" specular=\"0.3\"/>",
            dim[0], dim[1], dim[2]
        )
        .expect(TOLD);
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

/// A turn as MuJoCo writes it: w, x, y, z.
pub(super) fn quaternion(turn: &UnitQuaternion<f64>) -> String {
    format!("{:.6} {:.6} {:.6} {:.6}", turn.w, turn.i, turn.j, turn.k)
}

/// A material's element under another name and colour.
fn recoloured(xml: &str, name: &str, own: &str, [r, g, b]: [f64; 3]) -> String {
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

const ACTUATORS: &str = "<actuator>
<position name=\"steer_left\" joint=\"steer_fl\" kp=\"4000\" kv=\"200\" ctrlrange=\"-0.8 0.8\" forcerange=\"-3000 3000\"/>
<position name=\"steer_right\" joint=\"steer_fr\" kp=\"4000\" kv=\"200\" ctrlrange=\"-0.8 0.8\" forcerange=\"-3000 3000\"/>
<velocity name=\"spin_fl\" joint=\"spin_fl\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_fr\" joint=\"spin_fr\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_rl\" joint=\"spin_rl\" kv=\"240\" forcerange=\"-930 930\"/>
<velocity name=\"spin_rr\" joint=\"spin_rr\" kv=\"240\" forcerange=\"-930 930\"/>
</actuator>
";

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

/// The car, with its rear axle at a place on the ground.
fn add_ego(builder: &mut Builder, (position, yaw_rad): (Vec2, f64), ground: &Ground, sun: Option<&Sun>) {
    let center = position + Vec2::new(yaw_rad.cos(), yaw_rad.sin()) * (WHEELBASE_M / 2.0);
    let (middle_m, turn) = ground.stance(center, yaw_rad, WHEELBASE_M, TRACK_M);
    let z_m = middle_m - (turn * Vector3::x()).z * WHEELBASE_M / 2.0;
    let quaternion = if ground.is_flat() {
        let (sin, cos) = (yaw_rad / 2.0).sin_cos();
        format!("{cos:.6} 0 0 {sin:.6}")
    } else {
        quaternion(&turn)
    };
    let center_x_m = FRONT_BUMPER_X_M - EGO_LENGTH_M / 2.0;
    let chassis_low_m = 0.2;
    let half_height_m = (EGO_HEIGHT_M - chassis_low_m) / 2.0;
    let wheel_mass_kg = 20.0;
    let mass_kg = EGO_MASS_KG - 4.0 * wheel_mass_kg;
    // Inertia of a homogeneous box; the mass lies low, as in a car.
    let [ixx, iyy, izz] = [
        mass_kg / 12.0 * (EGO_WIDTH_M.powi(2) + 1.0),
        mass_kg / 12.0 * (EGO_LENGTH_M.powi(2) + 1.0),
        mass_kg / 12.0 * (EGO_LENGTH_M.powi(2) + EGO_WIDTH_M.powi(2)),
    ];
    let body = &mut builder.body;
    writeln!(
        body,
        "<body name=\"ego\" pos=\"{:.4} {:.4} {z_m}\" quat=\"{quaternion}\">\n<freejoint name=\"ego\"/>\n\
         <inertial pos=\"{:.4} 0 0.4\" mass=\"{mass_kg}\" diaginertia=\"{ixx:.1} {iyy:.1} {izz:.1}\"/>\n\
         {}\n\
         <geom name=\"ego_chassis\" type=\"box\" size=\"{:.4} {:.4} {half_height_m:.4}\" pos=\"{center_x_m:.4} 0 {:.4}\" group=\"4\" rgba=\"0.8 0.8 0.85 1\"/>",
        position.x,
        position.y,
        WHEELBASE_M / 2.0,
        sun.map_or_else(String::new, sun_xml),
        EGO_LENGTH_M / 2.0,
        EGO_WIDTH_M / 2.0,
        chassis_low_m + half_height_m,
    )
    .expect(TOLD);
    for (name, x_m, side) in
        [("fl", WHEELBASE_M, 1.0), ("fr", WHEELBASE_M, -1.0), ("rl", 0.0, 1.0), ("rr", 0.0, -1.0)]
    {
        let steer = if x_m > 0.0 {
            format!(
                "<joint name=\"steer_{name}\" type=\"hinge\" axis=\"0 0 1\" range=\"-0.85 0.85\" damping=\"40\" armature=\"2\"/>\n"
            )
        } else {
            String::new()
        };
        // Wheels touch the ground plane only (bit 2), the chassis other things only.
        writeln!(
            body,
            "<body name=\"wheel_{name}\" pos=\"{x_m:.4} {:.4} {WHEEL_RADIUS_M}\">\n{steer}\
             <joint name=\"spin_{name}\" type=\"hinge\" axis=\"0 1 0\" armature=\"0.5\" damping=\"0.05\"/>\n\
             <geom type=\"cylinder\" size=\"{WHEEL_RADIUS_M} 0.1\" quat=\"0.7071068 0.7071068 0 0\" mass=\"{wheel_mass_kg}\" group=\"4\" \
             friction=\"1.1 0.005 0.0001\" rgba=\"0.1 0.1 0.1 1\"/>\n</body>",
            side * TRACK_M / 2.0
        )
        .expect(TOLD);
    }
    body.push_str("</body>\n");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inner_wheel_turns_more_and_slower() {
        let ctrl = EgoCommand { target_speed_mps: 5.0, steering_angle_rad: 0.3 }.ctrl();
        assert!(ctrl[STEER_LEFT] > 0.3 && ctrl[STEER_RIGHT] < 0.3 && ctrl[STEER_RIGHT] > 0.2);
        assert!(ctrl[SPIN_REAR_LEFT] < ctrl[SPIN_REAR_RIGHT]);
        let mean = f64::midpoint(ctrl[SPIN_REAR_LEFT], ctrl[SPIN_REAR_RIGHT]);
        assert!((mean * WHEEL_RADIUS_M - 5.0).abs() < 1e-12);
    }

    #[test]
    fn a_recoloured_material_has_its_own_name_and_colour() {
        let xml = "<material name=\"car/paint\" rgba=\"1 0 0 1\" specular=\"0.5\"/>";
        let own = recoloured(xml, "car/paint", "obj:a/paint", [0.0, 0.5, 1.0]);
        assert_eq!(own, "<material name=\"obj:a/paint\" rgba=\"0.000 0.500 1.000 1\" specular=\"0.5\"/>\n");
    }
}
