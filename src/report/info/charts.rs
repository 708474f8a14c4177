//! The histograms of a data set as one picture, and the comparison with the paper.

use super::{CategoryInfo, Info, TOLERANCE};
use crate::dataset::statistics::Histogram;
use crate::label::count_of;
use crate::object::{Distribution, Kind};
use crate::report::chart::{Axis, Chart, Look, Series, Sheet, Tone, row};
use crate::report::score_tables::to_words;
use crate::report::table::{number, percent};

const HEIGHT_PX: u32 = 400;
/// Most labels below a histogram.
const MAX_LABELS: usize = 9;

/// The picture.
#[must_use]
pub(super) fn sheet(info: &Info) -> Sheet {
    let (all, histograms) = (&info.all, &info.histograms);
    let labels = info.label_set.as_ref().map_or_else(|| "not labelled".into(), |set| format!("labels {set}"));
    let title = format!(
        "{}   episodes {} · samples {} · objects {} · towns {} · weathers {} · {labels}",
        info.dataset.display(),
        all.n_episodes,
        all.n_samples,
        all.n_objects,
        info.towns.len(),
        info.weathers.len()
    );
    let edges = |title, histogram| draw_histogram(title, histogram, Labels::Edges);
    let whole = |title, histogram| draw_histogram(title, histogram, Labels::Whole);
    let columns = vec![
        vec![compare(info), edges("speed of the ego, m/s", &histograms.speed_mps)],
        vec![count_kinds(info), edges("steering, degrees, left positive", &histograms.steering_deg)],
        vec![
            edges("range of objects, m", &histograms.range_m),
            edges("visible fraction of objects", &histograms.visible_fraction),
        ],
        vec![
            whole("LiDAR points an object", &histograms.points_per_object),
            whole("objects a sample", &histograms.objects_per_sample),
        ],
        vec![count_categories(info)],
    ];
    Sheet { title, column_px: 400, columns }
}

/// The labels below the bars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Labels {
    /// Some edges, at their places.
    Edges,
    /// The first whole number of some bins; a plus says that a bin holds more numbers.
    Whole,
}

/// Bars of the bins between the first and the last that are not empty.
fn draw_histogram(title: &str, histogram: &Histogram, labels: Labels) -> Chart {
    let Histogram { counts, edges, .. } = histogram;
    let is_filled = |&count: &u64| count > 0;
    let ends = counts.iter().position(is_filled).zip(counts.iter().rposition(is_filled));
    let Some((first, last)) = ends else {
        let (x, y) = (Axis::new("", 0.0, 1.0, vec![]), Axis::new("", 0.0, 1.0, vec![]));
        let texts = vec![((0.0, 0.5), "nothing to count".to_owned())];
        return Chart { texts, ..Chart::new(title, x, y, vec![], HEIGHT_PX) };
    };
    let total = (counts.iter().sum::<u64>() + histogram.n_below + histogram.n_above) as f64;
    let shares: Vec<f64> = counts[first..=last].iter().map(|&count| 100.0 * count as f64 / total).collect();
    let bars =
        shares.iter().enumerate().flat_map(|(i, &share)| [(i as f64 + 0.04, 0.0), (i as f64 + 0.96, share)]);
    let label = |bin: usize| {
        let at = (bin - first) as f64;
        match labels {
            Labels::Edges => (at, ((100.0 * edges[bin]).round() / 100.0).to_string()),
            Labels::Whole => {
                let more = if edges[bin + 1] - edges[bin] > 1.0 { "+" } else { "" };
                (at + 0.5, number(Some(edges[bin] + 0.5), 0) + more)
            }
        }
    };
    let last_label = if labels == Labels::Edges { last + 1 } else { last };
    let step = (last_label - first + 1).div_ceil(MAX_LABELS);
    let ticks = (first..=last_label).step_by(step).map(label).collect();
    let most = shares.iter().copied().fold(0.0, f64::max);
    Chart::new(
        title,
        Axis::new("", 0.0, shares.len() as f64, ticks),
        Axis::over("share, %", 0.0, 1.05 * most),
        vec![Series::new("", Tone::Harmless, Look::Bars, bars.collect())],
        HEIGHT_PX,
    )
}

/// One row per number of the paper: this set's over the paper's, and where the tolerance lies.
fn compare(info: &Info) -> Chart {
    let rows = &info.comparison;
    let names: Vec<String> = rows.iter().map(|row| row.quantity.to_owned()).collect();
    let (mut within, mut outside, mut texts) = (Vec::new(), Vec::new(), Vec::new());
    for (i, comparison) in rows.iter().enumerate() {
        let of = |value| if comparison.is_share { percent(value) } else { number(value, 2) };
        let told = format!("{} ({})", of(comparison.here), of(Some(comparison.paper)));
        texts.push(((0.0, row(i, rows.len()) - 0.3), told));
        let bars = if comparison.is_within_tolerance == Some(true) { &mut within } else { &mut outside };
        let ratio = comparison.ratio.unwrap_or(0.0).min(2.0);
        bars.extend([(0.0, row(i, rows.len())), (ratio, row(i, rows.len()) + 0.25)]);
    }
    let y = Axis::rows(&names);
    let band = vec![(1.0 - TOLERANCE, y.low), (1.0 + TOLERANCE, y.high)];
    let series = vec![
        Series::new(format!("within {:.0} %", 100.0 * TOLERANCE), Tone::Grid, Look::Bars, band),
        Series::new("", Tone::Green, Look::Bars, within),
        Series::new("", Tone::Harmful, Look::Bars, outside),
    ];
    let row = if info.ood { "OOD set" } else { "training set" };
    let title = format!("this set over the paper's {row} (in brackets)");
    Chart { texts, ..Chart::new(title, Axis::over("", 0.0, 2.0), y, series, HEIGHT_PX) }
}

/// Objects of one name.
struct Count {
    name: String,
    n_objects: u64,
    /// `None` if the set is not labelled.
    n_harmful: Option<u64>,
}

/// Objects by kind, distribution and class.
fn count_kinds(info: &Info) -> Chart {
    let groups = [
        ("vehicle", Distribution::Id, Kind::Vehicle),
        ("pedestrian", Distribution::Id, Kind::Pedestrian),
        ("static", Distribution::Id, Kind::Static),
        ("static, OOD", Distribution::Ood, Kind::Static),
    ];
    let count = |(name, distribution, kind): (&str, Distribution, Kind)| {
        let harmful = |of| count_of(of, Some(distribution), Some(kind)).harmful;
        Count {
            name: name.to_owned(),
            n_objects: *info.all.objects.get(distribution).get(kind),
            n_harmful: info.all.labels.as_ref().map(harmful),
        }
    };
    count_rows("objects by kind and class", &groups.map(count), HEIGHT_PX)
}

/// The categories, the most frequent first.
fn count_categories(info: &Info) -> Chart {
    let count = |CategoryInfo { category, n_objects, n_harmful }: &CategoryInfo| {
        let dot = if category.distribution == Distribution::Ood { "· " } else { "" };
        let name = format!("{dot}{}", to_words(&category.category));
        Count { name, n_objects: *n_objects, n_harmful: *n_harmful }
    };
    let rows: Vec<Count> = info.categories.iter().map(count).collect();
    count_rows("objects by category (dotted names: OOD)", &rows, 2 * HEIGHT_PX)
}

/// A bar for each name: the number of objects, and the number of harmful ones if known.
fn count_rows(title: &str, counts: &[Count], height_px: u32) -> Chart {
    let names: Vec<String> = counts.iter().map(|count| count.name.clone()).collect();
    let (mut harmful, mut harmless, mut unlabelled) = (Vec::new(), Vec::new(), Vec::new());
    let mut texts = Vec::new();
    for (i, &Count { n_objects, n_harmful, .. }) in counts.iter().enumerate() {
        let y = row(i, counts.len());
        let bar = |from: u64, to: u64| [(from as f64, y - 0.35), (to as f64, y + 0.35)];
        match n_harmful {
            Some(n_harmful) => {
                harmful.extend(bar(0, n_harmful));
                harmless.extend(bar(n_harmful, n_objects));
            }
            None => unlabelled.extend(bar(0, n_objects)),
        }
        texts.push(((n_objects as f64, y), n_objects.to_string()));
    }
    let series = [
        Series::new("harmful", Tone::Harmful, Look::Bars, harmful),
        Series::new("harmless", Tone::Harmless, Look::Bars, harmless),
        Series::new("not labelled", Tone::Soft, Look::Bars, unlabelled),
    ];
    let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
    let most = counts.iter().map(|count| count.n_objects).max().unwrap_or(0).max(1) as f64;
    // Room for the longest bar's number, which stands right of it.
    let x = Axis::new("", 0.0, 1.3 * most, vec![]);
    Chart { texts, ..Chart::new(title, x, Axis::rows(&names), series, height_px) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_as_high_as_its_share_and_empty_bins_at_the_ends_are_cut() {
        let mut histogram = Histogram::even(0.0, 10.0, 10);
        [3.5, 3.5, 4.5, 99.0].iter().for_each(|&value| histogram.add(value));
        let chart = draw_histogram("x", &histogram, Labels::Edges);
        assert_eq!(chart.series[0].points, [(0.04, 0.0), (0.96, 50.0), (1.04, 0.0), (1.96, 25.0)]);
        assert_eq!(chart.x.ticks.iter().map(|tick| tick.1.as_str()).collect::<Vec<_>>(), ["3", "4", "5"]);
    }

    #[test]
    fn whole_numbers_stand_below_the_middle_of_their_bin() {
        let mut histogram = Histogram::new(vec![-0.5, 0.5, 1.5, 3.5]);
        [0.0, 1.0, 2.0].iter().for_each(|&value| histogram.add(value));
        let ticks = draw_histogram("x", &histogram, Labels::Whole).x.ticks;
        assert_eq!(ticks, [(0.5, "0".into()), (1.5, "1".into()), (2.5, "2+".into())]);
    }

    #[test]
    fn nothing_counted_says_so_and_draws_no_bar() {
        let chart = draw_histogram("x", &Histogram::even(0.0, 1.0, 4), Labels::Edges);
        assert!(chart.series.is_empty() && chart.texts[0].1 == "nothing to count");
    }
}
