//! The harmful score over the signed distance to the zone's edge, where labels change.

use serde::{Deserialize, Serialize};

use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;
use crate::object::Harm;

/// Located objects whose footprints lie this far from the zone's edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EdgeBand {
    /// Least distance, metres, negative inside the zone; `None`: any depth.
    pub from_m: Option<f64>,
    /// The distance is less than this; `None`: any distance.
    pub to_m: Option<f64>,
    pub n: usize,
    /// Share that is harmful in truth.
    pub harmful_share: Option<f64>,
    /// Share of the objects for which the harmful share of the scores is one half or more.
    pub called_harmful_share: Option<f64>,
    pub mean_harm_probability: Option<f64>,
}

/// Bands between the edges, and beyond; empty where no zone is known.
pub(super) fn measure(of: &Context<'_>) -> Vec<EdgeBand> {
    let edges_m = &of.matching.config().breakdown.zone_distance_m;
    let mut bands = vec![Vec::new(); edges_m.len() + 1];
    let objects = of.matching.objects.iter().zip(of.matching.zone_distances_m());
    for ((placed, &distance_m), &probability) in objects.zip(&of.harm_probability) {
        let (Some(distance_m), Some(probability)) = (distance_m, probability) else { continue };
        let at = edges_m.partition_point(|&edge_m| edge_m <= distance_m);
        bands[at].push((placed.object.harm == Harm::Harmful, probability));
    }
    if bands.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let of_band = |(at, found): (usize, Vec<(bool, f64)>)| {
        let share = |value: &dyn Fn(&(bool, f64)) -> f64| {
            (!found.is_empty()).then(|| found.iter().map(value).sum::<f64>() / found.len() as f64)
        };
        EdgeBand {
            from_m: at.checked_sub(1).map(|below| edges_m[below]),
            to_m: edges_m.get(at).copied(),
            n: found.len(),
            harmful_share: share(&|&(is_harmful, _)| f64::from(u8::from(is_harmful))),
            called_harmful_share: share(&|&(_, probability)| f64::from(u8::from(probability >= 0.5))),
            mean_harm_probability: share(&|&(_, probability)| probability),
        }
    };
    bands.into_iter().enumerate().map(of_band).collect()
}

pub(super) fn show(bands: &Vec<EdgeBand>, _: &EvalConfig) -> Option<MetricTable> {
    let row = |band: &EdgeBand| {
        let name = match (band.from_m, band.to_m) {
            (None, Some(to_m)) => format!("below {to_m} m"),
            (Some(from_m), Some(to_m)) => format!("{from_m} to {to_m} m"),
            (Some(from_m), None) => format!("{from_m} m and more"),
            (None, None) => "all".to_owned(),
        };
        let shares =
            [band.harmful_share, band.called_harmful_share].map(|share| MetricValue::share(share, None));
        let mean = MetricValue::number(band.mean_harm_probability, 3);
        [MetricValue::name(name), MetricValue::Count(band.n)]
            .into_iter()
            .chain(shares)
            .chain([mean])
            .collect()
    };
    let head =
        ["distance to the zone's edge", "objects", "harmful", "called harmful", "mean harm probability"];
    let note = "Below 0 the object reaches into the zone.";
    MetricTable::new(&head, bands.iter().map(row).collect(), note)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use crate::eval::matching::tests::found;
    use crate::eval::{Mode, Protocol, evaluate};
    use crate::object::Harm;

    #[test]
    fn an_object_falls_into_the_band_of_its_distance() {
        let mut samples = episode("a", "nn");
        // The zone ends at 17 m; the boxes (4 m) begin at 18 and 13 m: 1 m outside, 4 m deep (less across: 2.75).
        for sample in &mut samples {
            sample.facts.zone_in_ego_m = Some(vec![[3.0, -1.75], [17.0, -1.75], [17.0, 1.75], [3.0, 1.75]]);
        }
        samples[0].detections = vec![found(20.0, Harm::Harmful, 0.2), found(20.0, Harm::Harmless, 0.6)];
        samples[1].detections = vec![found(15.0, Harm::Harmful, 0.5)];
        let bands = evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().safety.zone_edge;
        let filled: Vec<_> = bands.iter().filter(|band| band.n > 0).collect();
        assert_eq!(filled.len(), 2);
        assert_eq!((filled[0].from_m, filled[0].to_m), (None, Some(-1.0)));
        assert_eq!((filled[0].harmful_share, filled[0].called_harmful_share), (Some(0.0), Some(1.0)));
        assert_eq!((filled[1].from_m, filled[1].to_m), (Some(1.0), Some(2.0)));
        assert!((filled[1].mean_harm_probability.unwrap() - 0.25).abs() < 1e-12);
    }
}
