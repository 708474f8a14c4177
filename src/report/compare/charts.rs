//! The comparison as one page of charts: what is farthest apart, and the shares of both sets beside each other.

use crate::compare::{DomainGap, GapRow, Quantity, RANGE_BIN_M};
use crate::dataset::statistics::Histogram;
use crate::object::Kind;
use crate::report::chart::{Axis, Chart, Look, Series, Sheet, Tone, row};

const HEIGHT_PX: u32 = 280;
const N_IN_COLUMN: u32 = 4;
/// Rows of the first chart.
const N_ROWS: usize = 30;
/// Most labels below a histogram.
const MAX_LABELS: usize = 7;
/// A mean of no point is drawn here, at the foot of a logarithmic axis.
const LEAST_POINTS: f64 = 0.1;
const A: Tone = Tone::Harmless;
const B: Tone = Tone::Harmful;

/// The page.
pub(super) fn sheet(gap: &DomainGap) -> Sheet {
    let of = |quantity| draw_quantity(gap, quantity);
    let columns = vec![
        vec![draw_distances(gap)],
        [Quantity::PointRange, Quantity::PointElevation, Quantity::PointRing, Quantity::PointHeight]
            .map(of)
            .into(),
        [Quantity::Intensity, Quantity::PointsPerSample, Quantity::ClutterShare, Quantity::AzimuthStep]
            .map(of)
            .into(),
        vec![
            draw_points_on(gap, Kind::Vehicle),
            draw_points_on(gap, Kind::Pedestrian),
            draw_points_on(gap, Kind::Static),
            of(Quantity::ObjectsPerSample(Kind::Vehicle)),
        ],
        [
            Quantity::ObjectRange(Kind::Vehicle),
            Quantity::Length(Kind::Vehicle),
            Quantity::Speed,
            Quantity::Steering,
        ]
        .map(of)
        .into(),
        [Quantity::Brightness, Quantity::Contrast, Quantity::Sharpness, Quantity::Saturation].map(of).into(),
    ];
    let [a, b] = [&gap.a, &gap.b].map(|of| format!("{} (samples {})", of.dataset.display(), of.n_samples));
    Sheet { title: format!("A: {a}   B: {b}"), column_px: 400, columns }
}

/// A bar for each quantity, as long as its divergence, and a stroke at what parts of A have.
fn draw_distances(gap: &DomainGap) -> Chart {
    let shown = &gap.rows[..gap.rows.len().min(N_ROWS)];
    let (mut apart, mut alike, mut strokes, mut texts) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (i, of) in shown.iter().enumerate() {
        let y = row(i, shown.len());
        let bars = if of.is_apart == Some(false) { &mut alike } else { &mut apart };
        bars.extend([(0.0, y + 0.05), (of.distance.jensen_shannon, y + 0.4)]);
        if let Some(within) = of.within_a {
            strokes.extend([(within.jensen_shannon, y), (within.jensen_shannon, y + 0.45)]);
        }
        texts.push(((0.0, y - 0.22), of.name.clone()));
    }
    let series = [
        Series::new("apart", Tone::Amber, Look::Bars, apart),
        Series::new("as parts of A", Tone::Grid, Look::Bars, alike),
        Series::new("parts of A", Tone::Ink, Look::Strokes, strokes),
    ];
    let series = series.into_iter().filter(|series| !series.points.is_empty()).collect();
    let y = Axis::new("", -0.6, shown.len() as f64 - 0.4, vec![]);
    let title = "Jensen-Shannon divergence, bits";
    Chart { texts, ..Chart::new(title, Axis::over("", 0.0, 1.0), y, series, N_IN_COLUMN * HEIGHT_PX) }
}

fn find(gap: &DomainGap, quantity: Quantity) -> Option<&GapRow> {
    gap.rows.iter().find(|row| row.quantity == quantity)
}

/// Shares of the bins of both sets as steps, between the first and the last bin that either fills.
fn draw_quantity(gap: &DomainGap, quantity: Quantity) -> Chart {
    let unit = match quantity.unit().name() {
        "" => String::new(),
        unit => format!(", {unit}"),
    };
    let title = quantity.name() + &unit;
    let Some(of) = find(gap, quantity) else { return draw_nothing(&title) };
    let (a, b) = (&of.a.histogram, &of.b.histogram);
    let is_filled = |bin: &usize| a.counts[*bin] + b.counts[*bin] > 0;
    let bins = || 0..a.counts.len();
    let Some((first, last)) = bins().find(is_filled).zip(bins().rev().find(is_filled)) else {
        return draw_nothing(&title);
    };
    let shares = [a, b].map(|histogram| shares(histogram, first, last));
    let most = shares.iter().flatten().copied().fold(0.0, f64::max);
    let steps = |shares: &[f64]| {
        let ends = shares.iter().enumerate();
        let inner = ends.flat_map(|(i, &share)| [(i as f64, share), (i as f64 + 1.0, share)]);
        [(0.0, 0.0)].into_iter().chain(inner).chain([(shares.len() as f64, 0.0)]).collect()
    };
    let n_labels = last + 2 - first;
    let label = |edge: usize| ((edge - first) as f64, tell_edge(a.edges[edge]));
    let ticks = (first..=last + 1).step_by(n_labels.div_ceil(MAX_LABELS)).map(label).collect();
    Chart::new(
        title,
        Axis::new("", 0.0, (last + 1 - first) as f64, ticks),
        Axis::over("share, %", 0.0, 1.05 * most),
        vec![
            Series::new("A", A, Look::Line, steps(&shares[0])),
            Series::new("B", B, Look::Dashed, steps(&shares[1])),
        ],
        HEIGHT_PX,
    )
}

/// Shares of bins in percent of all values.
fn shares(of: &Histogram, first: usize, last: usize) -> Vec<f64> {
    let total = of.n_values().max(1) as f64;
    of.counts[first..=last].iter().map(|&count| 100.0 * count as f64 / total).collect()
}

/// An edge in as few digits as tell it from its neighbours.
fn tell_edge(edge: f64) -> String {
    let rounded = if edge.abs() >= 100.0 { edge.round() } else { (100.0 * edge).round() / 100.0 };
    (rounded + 0.0).to_string()
}

/// The mean number of points on objects of a kind over their range.
fn draw_points_on(gap: &DomainGap, kind: Kind) -> Chart {
    let title = format!("mean of points on {} over range, m", kind.name());
    let rows: Vec<(f64, &GapRow)> = (0..u8::MAX)
        .map(|bin| (bin, Quantity::PointsOnObject(kind, bin)))
        .take_while(|(bin, _)| f64::from(*bin) * RANGE_BIN_M < 50.0)
        .filter_map(|(bin, quantity)| Some(((f64::from(bin) + 0.5) * RANGE_BIN_M, find(gap, quantity)?)))
        .collect();
    if rows.is_empty() {
        return draw_nothing(&title);
    }
    let ticks = [0.1, 1.0, 10.0, 100.0, 1000.0, 10_000.0].map(|at: f64| (at, at.to_string())).into();
    let line =
        |mean: fn(&GapRow) -> f64| rows.iter().map(|(at, of)| (*at, mean(of).max(LEAST_POINTS))).collect();
    Chart::new(
        title,
        Axis::over("", 0.0, 50.0),
        Axis { ticks, ..Axis::log("points", LEAST_POINTS, 10_000.0) },
        vec![
            Series::new("A", A, Look::LineAndDots, line(|of| of.a.mean)),
            Series::new("B", B, Look::LineAndDots, line(|of| of.b.mean)),
        ],
        HEIGHT_PX,
    )
}

fn draw_nothing(title: &str) -> Chart {
    let (x, y) = (Axis::new("", 0.0, 1.0, vec![]), Axis::new("", 0.0, 1.0, vec![]));
    let texts = vec![((0.0, 0.5), "not measured in both".to_owned())];
    Chart { texts, ..Chart::new(title, x, y, vec![], HEIGHT_PX) }
}
