//! Shapes near events: balconies, and the pavements and walls that loose things bounce on.

use nalgebra::{UnitQuaternion, Vector3};

use super::builder::{Builder, quaternion_text};
use super::ground::PAVEMENT_M;
use super::loose::Perch;
use super::obstacles::Block;
use super::path::{Vec2, rotate};
use super::surface::StripKind;
use super::world::World;

/// Contact bits of scenery that only loose things meet: the ego's wheels still mount kerbs.
const SCENERY_CONTACT: &str = "contype=\"2\" conaffinity=\"2\"";
/// A loose thing cannot meet scenery farther than this from its start or its aim.
const EVENT_REACH_M: f64 = 22.0;
/// Nor walls and fences farther than this.
const LINES_REACH_M: f64 = 12.0;

impl World {
    /// Balconies, and shapes to bounce on near loose things: pavements and walls.
    pub(super) fn add_event_scenery(&self, builder: &mut Builder) {
        let centers: Vec<Vec2> = self
            .loose()
            .flat_map(|(_, loose)| [loose.aim, loose.world_from_model.translation.vector.xy()])
            .collect();
        let reach_m =
            |point: Vec2| centers.iter().map(|center| (point - center).norm()).fold(f64::MAX, f64::min);
        for building in &self.town.buildings {
            let body = building.footprint;
            if reach_m(body.center) > EVENT_REACH_M + body.radius_m() {
                continue;
            }
            let half_m = building.height_m() / 2.0;
            let half = [body.length_m / 2.0, body.width_m / 2.0, half_m];
            let z_m = half_m + building.base_m(&|at| self.town.surface.ground_m(at));
            add_box(builder, (body.center, z_m), heading(body.yaw_rad), half, "group=\"3\"");
        }
        let is_near =
            |block: &Block| reach_m(block.footprint.center) < EVENT_REACH_M + block.footprint.radius_m();
        let blocks = self.town.blocks().filter(is_near);
        let lines = self.town.lines_where(|at, half_m| reach_m(at) < LINES_REACH_M + half_m);
        for Block { footprint, height_m } in blocks.chain(lines) {
            let half = [footprint.length_m / 2.0, footprint.width_m / 2.0, height_m];
            let z_m = self.town.surface.ground_m(footprint.center);
            add_box(builder, (footprint.center, z_m), heading(footprint.yaw_rad), half, "group=\"3\"");
        }
        for strip in self.town.surface.strips.iter().filter(|strip| strip.kind == StripKind::Pavement) {
            let points = strip.center.points_every(3.0);
            for (from, to) in points.iter().zip(&points[1..]) {
                let (middle, way) = ((from + to) / 2.0, to - from);
                if reach_m(middle) > EVENT_REACH_M {
                    continue;
                }
                let [low_m, high_m] = [from, to].map(|&at| self.town.surface.ground_m(at));
                let climb = UnitQuaternion::from_axis_angle(
                    &Vector3::y_axis(),
                    -((high_m - low_m) / way.norm()).atan(),
                );
                let turn = heading(way.y.atan2(way.x)) * climb;
                // Longer than the piece, so that no gap opens in bends.
                let half = [way.norm() / 2.0 + 0.1, strip.width_m / 2.0, PAVEMENT_M];
                let center = (middle, f64::midpoint(low_m, high_m));
                add_box(builder, center, turn, half, "group=\"3\"");
            }
        }
        if !self.perches().is_empty() {
            builder.plain("scene_balcony", [0.78, 0.76, 0.72]);
        }
        for perch in self.perches() {
            let Perch { foot, out_rad, .. } = *perch;
            for ([x, y, z_m], half) in perch.boxes() {
                let center = foot + rotate(x, y, out_rad);
                add_box(
                    builder,
                    (center, z_m),
                    heading(out_rad),
                    half,
                    "group=\"1\" material=\"scene_balcony\"",
                );
            }
        }
    }
}

fn heading(yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad)
}

/// A fixed box that loose things meet.
fn add_box(
    builder: &mut Builder,
    (at, z_m): (Vec2, f64),
    turn: UnitQuaternion<f64>,
    [x, y, z]: [f64; 3],
    look: &str,
) {
    builder.body += &format!(
        "<geom type=\"box\" pos=\"{:.4} {:.4} {z_m:.4}\" quat=\"{}\" size=\"{x:.4} {y:.4} {z:.4}\" {look} {SCENERY_CONTACT}/>\n",
        at.x,
        at.y,
        quaternion_text(&turn)
    );
}
