//! One sample with all zones over each other: from above on the left, the camera and a table of objects on the right.

use image::RgbImage;
use thiserror::Error;

use crate::geometry::Point2;
use crate::label::MOVING_MPS;
use crate::object::{Harm, Object};
use crate::report::canvas::{Align, Canvas, Color, Pen, text_width_px};
use crate::report::palette;
use crate::report::view::{Area, Mark, birdseye, front};
use crate::sample::Sample;
use crate::zone::{Verdict, Zone, ZoneAt, ZoneError};

/// Size of the picture, pixels.
pub(super) const SIZE_PX: (u32, u32) = (1600, 900);

const MARGIN_PX: f32 = 16.0;
const TOP_PX: f32 = 60.0;
const BIRDSEYE_PX: (u32, u32) = (824, 824);
const FRONT_PX: (u32, u32) = (728, 410);
/// Left edge of the right column.
const RIGHT_PX: f32 = 856.0;
const TEXT_PX: f32 = 15.0;
const ROW_PX: f32 = 23.0;
/// Most objects with a row in the table; the others are only drawn.
const MAX_ROWS: usize = 10;
/// An arrow leads to a moving object's place after this time, seconds.
const ARROW_S: f64 = 1.0;

/// Why a sample could not be drawn.
#[derive(Debug, Error)]
pub enum OverlayError {
    #[error("the camera's image cannot be unpacked: {0}")]
    Image(#[from] image::ImageError),
    #[error(transparent)]
    Zone(#[from] ZoneError),
}

/// The content of the picture.
pub(super) struct Overlay<'a> {
    pub episode: &'a str,
    pub sample_idx: usize,
    pub sample: &'a Sample,
    pub zones: &'a [Zone],
    /// Harmful share of each zone over the data set.
    pub shares: &'a [Option<f64>],
}

/// An object with each zone's verdict on it.
struct ObjectRow<'a> {
    object: &'a Object,
    verdicts: Vec<Verdict>,
}

impl ObjectRow<'_> {
    fn n_harmful(&self) -> usize {
        self.verdicts.iter().filter(|verdict| verdict.harm == Harm::Harmful).count()
    }

    fn is_disputed(&self) -> bool {
        (1..self.verdicts.len()).contains(&self.n_harmful())
    }

    fn range_m(&self) -> f64 {
        let center = self.object.box_in_ego.center;
        center.x().hypot(center.y())
    }

    fn speed_mps(&self) -> f64 {
        let [vx_mps, vy_mps] = self.object.velocity_in_ego_mps;
        vx_mps.hypot(vy_mps)
    }

    /// White if zones differ, red if all say harmful, grey if none does: blue is a zone's colour here.
    fn color(&self) -> Color {
        match self.n_harmful() {
            _ if self.is_disputed() => palette::TEXT,
            0 => palette::TEXT_SOFT,
            _ => palette::truth(Harm::Harmful),
        }
    }

    fn time_to_collision_s(&self) -> Option<f64> {
        self.verdicts.iter().find_map(|verdict| verdict.time_to_collision_s)
    }
}

impl Overlay<'_> {
    pub fn draw(&self) -> Result<RgbImage, OverlayError> {
        let (measured, objects) = (&self.sample.measured, self.sample.objects());
        let zones: Vec<ZoneAt> =
            self.zones.iter().map(|zone| zone.at(self.sample.true_state())).collect::<Result<_, _>>()?;
        let mut rows = objects
            .iter()
            .map(|object| {
                let harm_of = |zone: &ZoneAt| zone.harm_of_object(object);
                Ok(ObjectRow { object, verdicts: zones.iter().map(harm_of).collect::<Result<_, _>>()? })
            })
            .collect::<Result<Vec<_>, ZoneError>>()?;
        rows.sort_by(|a, b| {
            let rank = |row: &ObjectRow| (row.is_disputed(), row.n_harmful());
            rank(b).cmp(&rank(a)).then(a.range_m().total_cmp(&b.range_m()))
        });
        let areas: Vec<Area> = self
            .zones
            .iter()
            .zip(&zones)
            .map(|(zone, here)| Area {
                corners: here.corners(),
                color: palette::zone(zone.config().kind),
                fill: 0.08,
            })
            .collect();
        let marks: Vec<Mark> = rows
            .iter()
            .enumerate()
            .map(|(i, row)| Mark {
                box_in_ego: row.object.box_in_ego,
                pen: Pen {
                    color: row.color(),
                    width_px: if row.is_disputed() { 2.2 } else { 1.5 },
                    is_dashed: row.object.is_ood(),
                },
                tag: (i < MAX_ROWS).then(|| letter(i)),
            })
            .collect();

        let mut page = Canvas::new(SIZE_PX.0, SIZE_PX.1, palette::PAGE);
        let mut above = birdseye::draw(measured, &areas, &marks, BIRDSEYE_PX.0, BIRDSEYE_PX.1);
        annotate(&mut above, &rows);
        let seen = front::draw(measured, &areas, &marks, FRONT_PX.0, FRONT_PX.1)?;
        page.paste(&above, MARGIN_PX as i32, TOP_PX as i32);
        page.paste(&seen, RIGHT_PX as i32, TOP_PX as i32);
        self.draw_title(&mut page);
        let top = TOP_PX + FRONT_PX.1 as f32 + 30.0;
        let top = self.draw_zones(&mut page, top);
        self.draw_objects(&mut page, &rows, top + 20.0);
        Ok(page.into_rgb())
    }

    fn draw_title(&self, page: &mut Canvas) {
        let state = self.sample.true_state();
        page.text((MARGIN_PX, 39.0), 25.0, palette::TEXT, Align::Left, self.episode);
        let x = MARGIN_PX + text_width_px(25.0, self.episode) + 18.0;
        let steering_deg = state.steering_angle_rad.to_degrees();
        let side = if steering_deg > 0.0 { "left" } else { "right" };
        let text = format!(
            "sample {} · {:.1} m/s · steering {:.1}° {side}",
            self.sample_idx,
            state.speed_mps,
            steering_deg.abs()
        );
        page.text((x, 39.0), 17.0, palette::TEXT_SOFT, Align::Left, &text);
    }

    /// Draws the zones with their share over the set; returns the next free height.
    fn draw_zones(&self, page: &mut Canvas, top: f32) -> f32 {
        let right = SIZE_PX.0 as f32 - MARGIN_PX;
        let note = "harmful, whole set";
        page.text((right, top), TEXT_PX, palette::TEXT_SOFT, Align::Right, note);
        let speed_mps = self.sample.true_state().speed_mps.max(0.0);
        for (i, (zone, share)) in self.zones.iter().zip(self.shares).enumerate() {
            let baseline = top + (i + 1) as f32 * ROW_PX;
            let color = palette::zone(zone.config().kind);
            square(page, (RIGHT_PX, baseline), color, true);
            page.text(
                (RIGHT_PX + 24.0, baseline),
                TEXT_PX,
                palette::TEXT,
                Align::Left,
                zone.config().kind.name(),
            );
            let told = zone.describe(speed_mps);
            page.text((RIGHT_PX + 66.0, baseline), TEXT_PX, palette::TEXT_SOFT, Align::Left, &told);
            let share = share.map_or("-".to_owned(), |share| format!("{:.1}%", 100.0 * share));
            page.text((right, baseline), TEXT_PX, palette::TEXT, Align::Right, &share);
        }
        top + (self.zones.len() + 1) as f32 * ROW_PX
    }

    fn draw_objects(&self, page: &mut Canvas, rows: &[ObjectRow], top: f32) {
        let right = SIZE_PX.0 as f32 - MARGIN_PX;
        let columns = [(300.0, "range"), (390.0, "speed"), (490.0, "contact in")];
        let square_at = |zone_idx: usize| right - 36.0 * (self.zones.len() - zone_idx) as f32 + 18.0;
        let heads = [
            (palette::truth(Harm::Harmful), "harmful by all"),
            (palette::TEXT, "zones differ"),
            (palette::TEXT_SOFT, "by none"),
        ];
        let mut x = RIGHT_PX;
        for (color, name) in heads {
            page.line(&[(x, top - 5.0), (x + 14.0, top - 5.0)], Pen::solid(color, 2.2));
            page.text((x + 20.0, top), 13.0, palette::TEXT_SOFT, Align::Left, name);
            x += 20.0 + text_width_px(13.0, name) + 12.0;
        }
        for (at, name) in columns {
            page.text((RIGHT_PX + at + 45.0, top), 13.0, palette::TEXT_SOFT, Align::Right, name);
        }
        for (zone_idx, zone) in self.zones.iter().enumerate() {
            let x = square_at(zone_idx) + 7.0 + text_width_px(13.0, zone.config().kind.name()) / 2.0;
            page.text(
                (x, top),
                13.0,
                palette::zone(zone.config().kind),
                Align::Right,
                zone.config().kind.name(),
            );
        }
        for (i, row) in rows.iter().take(MAX_ROWS).enumerate() {
            let baseline = top + (i + 1) as f32 * ROW_PX;
            page.text((RIGHT_PX, baseline), TEXT_PX, row.color(), Align::Left, &letter(i));
            let name = row.object.category.as_deref().unwrap_or("object").replace('_', " ");
            page.text((RIGHT_PX + 24.0, baseline), TEXT_PX, palette::TEXT, Align::Left, &name);
            let contact = row.time_to_collision_s().map_or("-".to_owned(), |time_s| format!("{time_s:.1} s"));
            let told = [format!("{:.1} m", row.range_m()), format!("{:.1} m/s", row.speed_mps()), contact];
            for ((at, _), text) in columns.iter().zip(told) {
                page.text((RIGHT_PX + at + 45.0, baseline), TEXT_PX, palette::TEXT_SOFT, Align::Right, &text);
            }
            for (zone_idx, (zone, verdict)) in self.zones.iter().zip(&row.verdicts).enumerate() {
                let is_harmful = verdict.harm == Harm::Harmful;
                square(page, (square_at(zone_idx), baseline), palette::zone(zone.config().kind), is_harmful);
            }
        }
    }
}

/// Draws letters beside the boxes, and arrows for moving ones.
fn annotate(canvas: &mut Canvas, rows: &[ObjectRow]) {
    let plan = birdseye::PlanView::of(BIRDSEYE_PX.0, BIRDSEYE_PX.1);
    for (i, row) in rows.iter().enumerate() {
        let center = row.object.box_in_ego.center;
        if row.speed_mps() > MOVING_MPS {
            let [vx_mps, vy_mps] = row.object.velocity_in_ego_mps;
            let to = Point2 { x_m: center.x() + ARROW_S * vx_mps, y_m: center.y() + ARROW_S * vy_mps };
            let (from, tip) = (plan.at(center.x(), center.y()), plan.at(to.x_m, to.y_m));
            canvas.line(&[from, tip], Pen::solid(row.color(), 1.4));
            canvas.dots(&[tip], 2.6, row.color());
        }
        if i < MAX_ROWS {
            let left = row.object.box_in_ego.footprint().map(|corner| plan.at(corner.x_m, corner.y_m));
            let x = left.iter().map(|corner| corner.0).fold(f32::MIN, f32::max) + 5.0;
            let (_, y) = plan.at(center.x(), center.y());
            canvas.text((x, y + 5.0), TEXT_PX, row.color(), Align::Left, &letter(i));
        }
    }
}

fn letter(i: usize) -> String {
    char::from(b'A' + i as u8).to_string()
}

/// Draws a square on a text's line, filled or as a frame.
fn square(page: &mut Canvas, (left, baseline): (f32, f32), color: Color, is_filled: bool) {
    let (top, right) = (baseline - 13.0, left + 14.0);
    let corners = [(left, top), (right, top), (right, baseline + 1.0), (left, baseline + 1.0)];
    if is_filled {
        page.fill(&corners, color);
    } else {
        page.outline(&corners, Pen::solid(color.with_alpha(0.35), 1.2));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::sample::Truth;
    use crate::zone::{ZoneConfig, ZoneKind};

    #[test]
    fn all_zones_and_the_disputed_objects_are_drawn() {
        let dataset = test_data::dataset(2);
        let labelled = &dataset.samples()[1];
        let mut objects: Vec<Object> = labelled.objects.iter().map(|o| o.truth.clone()).collect();
        // Dead ahead and driving away: harmful by its place, not by its motion.
        objects[0].box_in_ego.center = crate::geometry::Point::new(12.0, 0.0, 0.75);
        objects[0].velocity_in_ego_mps = [15.0, 0.0];
        let mut measured = labelled.measured.clone();
        (measured.ego_state.speed_mps, measured.ego_state.steering_angle_rad) = (8.0, 0.02);
        let sample = Sample { measured, truth: Some(Truth { objects, ..Truth::default() }) };
        let zones =
            ZoneKind::ALL.map(|kind| Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap());
        let overlay = Overlay {
            episode: "made",
            sample_idx: 1,
            sample: &sample,
            zones: &zones,
            shares: &[Some(0.1); ZoneKind::ALL.len()],
        };
        let drawn = overlay.draw().unwrap();
        assert_eq!(drawn.dimensions(), SIZE_PX);
        let count = |color: Color, from_x: u32| {
            drawn.enumerate_pixels().filter(|(x, _, pixel)| *x >= from_x && pixel.0 == color.rgb).count()
        };
        for kind in ZoneKind::ALL {
            assert!(count(palette::zone(kind), 0) > 196, "{kind:?}: its square and its outline");
        }
        // In the table, a square of 14 by 14 pixels for each object that a zone calls harmful; the head adds fewer.
        for zone in &zones {
            let (kind, zone) = (zone.config().kind, zone.at(&sample.measured.ego_state).unwrap());
            let is_harmful = |object: &&Object| {
                let verdict = zone.harm_of_object(object).unwrap();
                verdict.harm == Harm::Harmful
            };
            let n_harmful = sample.objects().iter().filter(is_harmful).count();
            let n_squares = count(palette::zone(kind), RIGHT_PX as u32 + 500) / 196;
            assert_eq!(n_squares, n_harmful, "{kind:?}");
        }
        assert_eq!(drawn, overlay.draw().unwrap());
    }
}
