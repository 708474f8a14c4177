//! The histograms of a data set as one picture: a panel each, and the comparison with the paper.

use image::RgbImage;

use super::{CategoryInfo, Info, TOLERANCE};
use crate::dataset::statistics::Histogram;
use crate::episode::manifest::HarmCounts;
use crate::label::count_of;
use crate::object::{Distribution, Harm, Kind};
use crate::report::canvas::{Align, Canvas, Color, Pen, text_width_px};
use crate::report::palette;

const PAGE_PX: (u32, u32) = (1940, 880);
const MARGIN_PX: f32 = 16.0;
const TITLE_PX: f32 = 60.0;
const PANEL_PX: (f32, f32) = (360.0, 390.0);
const BAR: Color = Color::new(0x0055_92b5);
const SMALL_PX: f32 = 14.0;

/// A part of the page, with its title written.
struct Panel {
    left: f32,
    top: f32,
    right: f32,
    bottom: f32,
}

/// Draws the picture.
pub(super) fn draw(info: &Info) -> RgbImage {
    let mut page = Canvas::new(PAGE_PX.0, PAGE_PX.1, palette::PAGE);
    draw_title(&mut page, info);
    let histograms = &info.histograms;
    draw_comparison(&mut page, 0, info);
    draw_classes(&mut page, 1, info);
    let panels: [(usize, &str, &Histogram, Labels); 6] = [
        (2, "range of objects, m", &histograms.range_m, Labels::Edges),
        (3, "LiDAR points an object", &histograms.points_per_object, Labels::Groups),
        (4, "visible fraction of objects", &histograms.visible_fraction, Labels::Edges),
        (5, "speed of the ego, m/s", &histograms.speed_mps, Labels::Edges),
        (6, "steering, degrees, left positive", &histograms.steering_deg, Labels::Edges),
        (7, "objects a sample", &histograms.objects_per_sample, Labels::Whole),
    ];
    for (place, title, histogram, labels) in panels {
        let area = panel(&mut page, place, title);
        draw_histogram(&mut page, &area, histogram, labels);
    }
    draw_categories(&mut page, info);
    page.into_rgb()
}

fn draw_title(page: &mut Canvas, info: &Info) {
    let name = info.dataset.display().to_string();
    page.text((MARGIN_PX, 39.0), 25.0, palette::TEXT, Align::Left, &name);
    let all = &info.all;
    let labels = info.label_set.as_ref().map_or_else(|| "not labelled".into(), |set| format!("labels {set}"));
    let counts = format!(
        "episodes {} · samples {} · objects {} · towns {} · weathers {} · {labels}",
        all.n_episodes,
        all.n_samples,
        all.n_objects,
        info.towns.len(),
        info.weathers.len()
    );
    let x = MARGIN_PX + text_width_px(25.0, &name) + 22.0;
    page.text((x, 39.0), 17.0, palette::TEXT_SOFT, Align::Left, &counts);
}

/// Draws the frame of one of the eight panels, and gives what of it is free.
fn panel(page: &mut Canvas, place: usize, title: &str) -> Panel {
    let (column, row) = ((place % 4) as f32, (place / 4) as f32);
    let left = MARGIN_PX + column * (PANEL_PX.0 + MARGIN_PX);
    let top = TITLE_PX + row * (PANEL_PX.1 + MARGIN_PX);
    frame(page, left, top, PANEL_PX, title)
}

fn frame(page: &mut Canvas, left: f32, top: f32, size: (f32, f32), title: &str) -> Panel {
    page.fill_rounded(left, top, size, 8.0, palette::PANEL);
    page.text((left + 14.0, top + 27.0), 17.0, palette::TEXT, Align::Left, title);
    Panel { left: left + 14.0, top: top + 46.0, right: left + size.0 - 14.0, bottom: top + size.1 - 14.0 }
}

fn fill_box(page: &mut Canvas, (left, right): (f32, f32), (top, bottom): (f32, f32), color: Color) {
    page.fill(&[(left, top), (right, top), (right, bottom), (left, bottom)], color);
}

fn centered(page: &mut Canvas, (x, baseline): (f32, f32), text: &str) {
    let left = x - text_width_px(SMALL_PX, text) / 2.0;
    page.text((left, baseline), SMALL_PX, palette::TEXT_SOFT, Align::Left, text);
}

/// What stands below the bars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Labels {
    /// Some edges, where they are.
    Edges,
    /// The whole number in the middle of some bins.
    Whole,
    /// The whole numbers that each bin groups.
    Groups,
}

/// Bars of the bins between the first and the last that are not empty.
fn draw_histogram(page: &mut Canvas, area: &Panel, histogram: &Histogram, labels: Labels) {
    let counts = &histogram.counts;
    let (Some(first), Some(last)) =
        (counts.iter().position(|&count| count > 0), counts.iter().rposition(|&count| count > 0))
    else {
        page.text(
            (area.left, area.top + 40.0),
            SMALL_PX,
            palette::TEXT_SOFT,
            Align::Left,
            "nothing to count",
        );
        return;
    };
    let total = (counts.iter().sum::<u64>() + histogram.n_below + histogram.n_above) as f32;
    let most = counts.iter().copied().max().unwrap_or(1) as f32;
    let (floor, n_bins) = (area.bottom - 24.0, (last - first + 1) as f32);
    let left = area.left + 46.0;
    let (width, height) = ((area.right - left) / n_bins, floor - area.top);
    for part in [0.5, 1.0] {
        let y = floor - part * height;
        page.line(&[(left, y), (area.right, y)], Pen::solid(palette::RING, 1.0));
        let share = format!("{:.1}%", 100.0 * part * most / total);
        page.text((left - 8.0, y + 5.0), SMALL_PX, palette::TEXT_SOFT, Align::Right, &share);
    }
    page.line(&[(left, floor), (area.right, floor)], Pen::solid(palette::RING, 1.0));
    for (i, &count) in counts[first..=last].iter().enumerate() {
        let x = left + i as f32 * width;
        let top = floor - count as f32 / most * height;
        fill_box(page, (x + 0.5, x + width - 0.5), (top, floor), BAR);
    }
    // As many labels as find room.
    let step = ((46.0 / width).ceil() as usize).max(1);
    let baseline = area.bottom;
    let number =
        |value: f64| if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.1}") };
    match labels {
        Labels::Edges => {
            for edge in (first..=last + 1).step_by(step) {
                let x = left + (edge - first) as f32 * width;
                centered(page, (x, baseline), &number(histogram.edges[edge]));
            }
        }
        Labels::Whole | Labels::Groups => {
            let step = if labels == Labels::Groups { ((34.0 / width).ceil() as usize).max(1) } else { step };
            for bin in (first..=last).step_by(step) {
                let x = left + (bin - first) as f32 * width + width / 2.0;
                let least = histogram.edges[bin] + 0.5;
                let has_more = histogram.edges[bin + 1] - histogram.edges[bin] > 1.0;
                centered(
                    page,
                    (x, baseline),
                    &format!("{}{}", number(least), if has_more { "+" } else { "" }),
                );
            }
        }
    }
}

/// One row a number of the paper: this set's over the paper's, and where thirty percent lie.
fn draw_comparison(page: &mut Canvas, place: usize, info: &Info) {
    let row = if info.ood { "OOD set" } else { "training set" };
    let area = panel(page, place, &format!("this set over the paper's {row}"));
    // A ratio of two is at the right border.
    let width = area.right - area.left;
    let at = |ratio: f64| area.left + width * (ratio as f32 / 2.0).clamp(0.0, 1.0);
    let rows_bottom = area.bottom - 20.0;
    let height = (rows_bottom - area.top) / info.comparison.len().max(1) as f32;
    fill_box(
        page,
        (at(1.0 - TOLERANCE), at(1.0 + TOLERANCE)),
        (area.top, rows_bottom),
        palette::ZONE.with_alpha(0.10),
    );
    page.line(&[(at(1.0), area.top), (at(1.0), rows_bottom)], Pen::solid(palette::ZONE, 1.5));
    for (i, comparison) in info.comparison.iter().enumerate() {
        let top = area.top + i as f32 * height;
        let baseline = top + 15.0;
        let name = comparison.quantity;
        page.text((area.left, baseline), SMALL_PX, palette::TEXT_SOFT, Align::Left, name);
        let number = |value: f64| {
            if comparison.is_share { format!("{:.1}%", 100.0 * value) } else { format!("{value:.2}") }
        };
        let told = match comparison.here {
            Some(here) => format!("{}  ({})", number(here), number(comparison.paper)),
            None => format!("-  ({})", number(comparison.paper)),
        };
        page.text((area.right, baseline), SMALL_PX, palette::TEXT, Align::Right, &told);
        let Some(ratio) = comparison.ratio else { continue };
        let is_within = comparison.is_within_tolerance == Some(true);
        let color = if is_within { palette::ZONE } else { palette::truth(Harm::Harmful) };
        fill_box(page, (area.left, at(ratio)), (top + 21.0, top + 27.0), color.with_alpha(0.9));
    }
    centered(page, (at(1.0 - TOLERANCE), area.bottom), &format!("{:.1}", 1.0 - TOLERANCE));
    centered(page, (at(1.0), area.bottom), "1");
    centered(page, (at(1.0 + TOLERANCE), area.bottom), &format!("{:.1}", 1.0 + TOLERANCE));
}

/// Objects by kind, distribution and class.
fn draw_classes(page: &mut Canvas, place: usize, info: &Info) {
    let area = panel(page, place, "objects by kind and class");
    let groups = [
        ("vehicle", Distribution::Id, Kind::Vehicle),
        ("pedestrian", Distribution::Id, Kind::Pedestrian),
        ("static", Distribution::Id, Kind::Static),
        ("static, OOD", Distribution::Ood, Kind::Static),
    ];
    let count = |distribution, kind| *info.all.objects.get(distribution).get(kind);
    let most =
        groups.iter().map(|&(_, distribution, kind)| count(distribution, kind)).max().unwrap_or(0).max(1);
    let width = (area.right - area.left) / groups.len() as f32;
    let (ceiling, floor) = (area.top + 52.0, area.bottom - 24.0);
    let height = |n: u64| n as f32 / most as f32 * (floor - ceiling);
    for (i, (name, distribution, kind)) in groups.into_iter().enumerate() {
        let middle = area.left + (i as f32 + 0.5) * width;
        let sides = (middle - 0.32 * width, middle + 0.32 * width);
        let n_objects = count(distribution, kind);
        let top = floor - height(n_objects);
        centered(page, (middle, area.bottom), name);
        centered(page, (middle, top - 8.0), &n_objects.to_string());
        let Some(labels) = &info.all.labels else {
            fill_box(page, sides, (top, floor), palette::UNLABELLED);
            continue;
        };
        let HarmCounts { harmful, .. } = count_of(labels, Some(distribution), Some(kind));
        fill_box(page, sides, (top, floor), palette::truth(Harm::Harmless));
        fill_box(page, sides, (floor - height(harmful), floor), palette::truth(Harm::Harmful));
    }
    if info.all.labels.is_some() {
        let mut x = area.left;
        for (harm, name) in [(Harm::Harmful, "harmful"), (Harm::Harmless, "harmless")] {
            fill_box(page, (x, x + 12.0), (area.top - 2.0, area.top + 10.0), palette::truth(harm));
            page.text((x + 19.0, area.top + 9.0), SMALL_PX, palette::TEXT_SOFT, Align::Left, name);
            x += 19.0 + text_width_px(SMALL_PX, name) + 18.0;
        }
    }
}

/// The tall column on the right: the categories, the most frequent first.
fn draw_categories(page: &mut Canvas, info: &Info) {
    let left = MARGIN_PX + 4.0 * (PANEL_PX.0 + MARGIN_PX);
    let size = (PAGE_PX.0 as f32 - MARGIN_PX - left, 2.0 * PANEL_PX.1 + MARGIN_PX);
    let area = frame(page, left, TITLE_PX, size, "objects by category (dotted names: OOD)");
    let n_rows = info.categories.len().max(24) as f32;
    let height = ((area.bottom - area.top) / n_rows).min(30.0);
    let size_px = (0.75 * height).min(SMALL_PX);
    let most = info.categories.first().map_or(1, |category| category.n_objects) as f32;
    let (from, to) = (area.left + 150.0, area.right - 62.0);
    for (i, CategoryInfo { category, n_objects, n_harmful }) in info.categories.iter().enumerate() {
        let baseline = area.top + (i as f32 + 0.72) * height;
        let is_ood = category.distribution == Distribution::Ood;
        let name = format!("{}{}", if is_ood { "· " } else { "" }, category.category.replace('_', " "));
        page.text((from - 10.0, baseline), size_px, palette::TEXT_SOFT, Align::Right, &name);
        let (top, bottom) = (area.top + (i as f32 + 0.15) * height, area.top + (i as f32 + 0.85) * height);
        let at = |n: u64| from + n as f32 / most * (to - from);
        let color = if n_harmful.is_some() { palette::truth(Harm::Harmless) } else { palette::UNLABELLED };
        fill_box(page, (from, at(*n_objects).max(from + 1.0)), (top, bottom), color);
        fill_box(page, (from, at(n_harmful.unwrap_or(0))), (top, bottom), palette::truth(Harm::Harmful));
        page.text((area.right, baseline), size_px, palette::TEXT, Align::Right, &n_objects.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bars(histogram: &Histogram) -> RgbImage {
        let mut page = Canvas::new(400, 400, palette::PAGE);
        let area = Panel { left: 0.0, top: 0.0, right: 400.0, bottom: 400.0 };
        draw_histogram(&mut page, &area, histogram, Labels::Edges);
        page.into_rgb()
    }

    #[test]
    fn a_bar_is_as_high_as_its_count_and_bins_at_the_ends_that_hold_nothing_are_cut() {
        let mut histogram = Histogram::even(0.0, 10.0, 10);
        [3.5, 3.5, 4.5].iter().for_each(|&value| histogram.add(value));
        let picture = bars(&histogram);
        // Two bars from x = 46 to 400; the floor is at y = 376: the first reaches the top, the second half of it.
        let is_bar = |x, y| picture.get_pixel(x, y).0 == BAR.rgb;
        assert!(is_bar(130, 10) && is_bar(130, 370));
        assert!(is_bar(310, 200) && !is_bar(310, 170));
    }

    #[test]
    fn nothing_counted_says_so_and_draws_no_bar() {
        let picture = bars(&Histogram::even(0.0, 1.0, 4));
        assert!(picture.pixels().all(|pixel| pixel.0 != BAR.rgb));
    }
}
