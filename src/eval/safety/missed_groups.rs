//! Which harm is missed: in distribution, out of it, and each family out of it, at the scores that hold for all.

use serde::{Deserialize, Serialize};

use super::alarm_facts::{AlarmFacts, Origin, Tally};
use super::{MetricTable, MetricValue};
use crate::eval::bootstrap::{Resamples, interval};
use crate::object::Distribution;

/// Missed harm of some objects, at the operating points of all.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MissedGroup {
    /// `id`, `ood`, or a family out of distribution.
    pub name: String,
    pub n_harmful: usize,
    pub n_events: usize,
    /// At each of the points.
    pub missed_per_sample: Vec<Option<f64>>,
    pub missed_per_event: Vec<Option<f64>>,
    /// Of the same resamples as those of the points; empty in what an older version wrote.
    #[serde(default)]
    pub missed_per_sample_intervals: Vec<Option<[f64; 2]>>,
    #[serde(default)]
    pub missed_per_event_intervals: Vec<Option<[f64; 2]>>,
}

impl MissedGroup {
    /// Shares missed of the events, then of the objects, at each of the points, with their intervals.
    pub fn shares(&self) -> impl Iterator<Item = [MissedShare; 2]> {
        let at = |i: usize, shares: &[Option<f64>], intervals: &[Option<[f64; 2]>]| MissedShare {
            value: shares[i],
            interval: intervals.get(i).copied().flatten(),
        };
        let n = self.missed_per_event.len().min(self.missed_per_sample.len());
        (0..n).map(move |i| {
            [
                at(i, &self.missed_per_event, &self.missed_per_event_intervals),
                at(i, &self.missed_per_sample, &self.missed_per_sample_intervals),
            ]
        })
    }
}

/// A share of harm that is missed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissedShare {
    /// `None` of nothing.
    pub value: Option<f64>,
    pub interval: Option<[f64; 2]>,
}

/// The groups, at the scores that keep to `asked` false alarms a kilometre in the whole set.
pub(super) fn measure<'a>(
    facts: &AlarmFacts<'a>,
    asked: &[f64],
    scores: &[f64],
    resamples: Option<&Resamples>,
) -> Vec<MissedGroup> {
    let once = vec![1; facts.n_episodes];
    let listed = list_groups(facts);
    let missed = |score: f64, n_drawn: &[u32], is_of: &IsOf<'a>| {
        [facts.count_missed(score, n_drawn, is_of), facts.count_missed_events(score, n_drawn, is_of)]
    };
    // `[point][group][objects, events]` in each resample, at the scores that keep to so many false alarms there.
    let of_resample = |n_drawn: &[u32]| -> Option<Vec<Vec<[Tally; 2]>>> {
        let of_point = |&per_km: &f64| {
            let score = facts.find_score(per_km, n_drawn).0.unwrap_or(f64::INFINITY);
            listed.iter().map(|(_, is_of)| missed(score, n_drawn, is_of)).collect()
        };
        (facts.driven_km(n_drawn) > 0.0).then(|| asked.iter().map(of_point).collect())
    };
    let resampled = resamples.map(|resamples| resamples.map(of_resample)).unwrap_or_default();
    let groups = listed.iter().enumerate().map(|(group, (name, is_of))| {
        let [objects, events] = missed(f64::INFINITY, &once, is_of).map(|tally| tally.of);
        let at_points =
            |what: usize| scores.iter().map(|&score| missed(score, &once, is_of)[what].share()).collect();
        let intervals = |what: usize| {
            let shares = |point: usize| {
                let drawn = resampled.iter().flatten();
                interval(drawn.filter_map(|tallies| tallies[point][group][what].share()))
            };
            (0..scores.len()).map(shares).collect()
        };
        MissedGroup {
            name: name.clone(),
            n_harmful: objects,
            n_events: events,
            missed_per_sample: at_points(0),
            missed_per_event: at_points(1),
            missed_per_sample_intervals: intervals(0),
            missed_per_event_intervals: intervals(1),
        }
    });
    groups.collect()
}

type IsOf<'a> = Box<dyn Fn(&Origin<'a>) -> bool + Sync + 'a>;

/// The groups that have something harmful: in and out of distribution, then the families out of it by name.
fn list_groups<'a>(facts: &AlarmFacts<'a>) -> Vec<(String, IsOf<'a>)> {
    let kinds = || facts.objects.iter().map(|object| object.origin);
    let mut groups: Vec<(String, IsOf<'a>)> = Vec::new();
    for distribution in [Distribution::Id, Distribution::Ood] {
        if kinds().any(|kind| kind.distribution == Some(distribution)) {
            let is_of: IsOf<'a> = Box::new(move |kind| kind.distribution == Some(distribution));
            groups.push((distribution.name().to_owned(), is_of));
        }
    }
    let unfamiliar = kinds().filter(|kind| kind.distribution == Some(Distribution::Ood));
    let mut families: Vec<&'a str> = unfamiliar.filter_map(|kind| kind.category).collect();
    families.sort_unstable();
    families.dedup();
    for family in families {
        let wanted = Origin { distribution: Some(Distribution::Ood), category: Some(family) };
        groups.push((family.to_owned(), Box::new(move |kind| *kind == wanted)));
    }
    groups
}

/// The table of the groups, at so many false alarms a kilometre each.
pub(super) fn show(groups: &[MissedGroup], per_km: &[f64]) -> Option<MetricTable> {
    let row = |group: &MissedGroup| {
        let name = match group.name.as_str() {
            "id" => "in distribution".to_owned(),
            "ood" => "out of distribution".to_owned(),
            family => family.replace('_', " "),
        };
        let counts = [MetricValue::Count(group.n_events), MetricValue::Count(group.n_harmful)];
        let shares = group.shares().flatten().map(|MissedShare { value, interval }| MetricValue::Share {
            value,
            of: None,
            interval,
        });
        std::iter::once(MetricValue::name(name)).chain(counts).chain(shares).collect()
    };
    let note = "Harmful events and objects that are missed, at the scores that keep to so many false alarms a kilometre.";
    let mut table =
        MetricTable::new(&["harm missed", "events", "objects"], groups.iter().map(row).collect(), note)?;
    for per_km in per_km {
        let at = format!("at {per_km}/km");
        table.head.extend(["events", "objects"].map(|what| format!("{what}, {at}")));
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::super::tracks::tests::episode;
    use super::MissedShare;
    use crate::eval::matching::tests::found;
    use crate::eval::{EvalConfig, EvalSample, Mode, Protocol, SafetyConfig, evaluate};
    use crate::object::{Distribution, Harm};

    /// Of eight drives past an unfamiliar thing, the share in which it is found is that of the drives, with an interval over them;
    /// what stands in one drive alone varies with nothing.
    #[test]
    fn each_family_has_its_shares_missed_with_intervals_over_the_episodes() {
        let samples: Vec<EvalSample> = (0..9)
            .flat_map(|i: usize| {
                let mut samples = episode(&format!("e{i}"), "hhh");
                for sample in &mut samples {
                    let truth = &mut sample.objects[0].truth;
                    truth.distribution = Some(Distribution::Ood);
                    truth.category = Some(if i == 8 { "sofa" } else { "dog" }.into());
                }
                if i.is_multiple_of(4) {
                    samples[1].detections = vec![found(15.0, Harm::Harmful, 0.5)];
                }
                samples
            })
            .collect();
        let safety = SafetyConfig { false_alarms_per_km: vec![10.0], ..SafetyConfig::default() };
        let config = EvalConfig { safety, ..EvalConfig::default() };
        let protocol = Protocol::try_from(config).unwrap();
        let alarms = evaluate(&samples, &protocol, Mode::Ood).unwrap().safety.alarms.unwrap();
        let [all, dog, sofa] = &alarms.groups[..] else { panic!("{:?}", alarms.groups) };
        assert_eq!((all.name.as_str(), dog.name.as_str(), sofa.name.as_str()), ("ood", "dog", "sofa"));
        let [events, objects] = dog.shares().next().unwrap();
        assert_eq!((events.value, dog.n_events), (Some(0.75), 8));
        let [low, high] = events.interval.unwrap();
        assert!((0.2..0.7).contains(&low) && (0.9..=1.0).contains(&high), "{low} {high}");
        let [low, high] = objects.interval.unwrap();
        assert!(low < 1.0 - 1.0 / 12.0 && high > 1.0 - 1.0 / 12.0, "{low} {high}");
        assert_eq!(
            sofa.shares().next().unwrap()[0],
            MissedShare { value: Some(0.0), interval: Some([0.0; 2]) }
        );
        // What an older version wrote has no intervals.
        let older: super::MissedGroup =
            serde_json::from_str(r#"{"name": "dog", "n_harmful": 1, "n_events": 1, "missed_per_sample": [1.0], "missed_per_event": [null]}"#)
                .unwrap();
        assert_eq!(older.shares().next().unwrap()[1], MissedShare { value: Some(1.0), interval: None });
    }
}
