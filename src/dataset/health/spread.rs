//! Whether an episode shows about what the others of its set do, and the set about what the presets' sets do.
//!
//! Only what no town and no weather explains is told, as a warning, and only of enough samples.

use super::check::{Aspect, Remark};
use super::motion::median;
use crate::episode::manifest::{LabelCounts, ObjectCounts};
use crate::generate::GenerateConfig;
use crate::label::count_of;
use crate::object::Kind;
use crate::scene::PopulateConfig;

/// Episodes are set side by side if there are so many, each of so many samples.
const MIN_EPISODES: usize = 8;
const MIN_EPISODE_SAMPLES: u64 = 20;
/// An episode's objects a sample, and their mean distance, lie within these times the median.
const MAX_OBJECTS_TIMES: f64 = 10.0;
const MAX_RANGE_TIMES: f64 = 4.0;
/// Where usually so many are in a sample, none in a whole episode is odd.
const MIN_OBJECTS: f64 = 3.0;

/// So many samples of a set say something of it.
const MIN_SET_SAMPLES: u64 = 300;
/// Least and most of the sets of ten presets' configs, 360 to 900 samples each, by a factor of two at least: 7.2 to 10
/// objects a sample, of which 18 to 41% are vehicles, 6 to 13% pedestrians, 52 to 75% static.
const OBJECTS_A_SAMPLE: [f64; 2] = [3.5, 25.0];
const VEHICLES: [f64; 2] = [0.08, 0.75];
const PEDESTRIANS: [f64; 2] = [0.02, 0.35];
const STATIC: [f64; 2] = [0.2, 0.92];
/// Of the same sets 3.8 to 5.7% are harmful by the zone `rect`; the paper's have 5.6%.
const HARMFUL: [f64; 2] = [0.01, 0.15];

/// What an episode shows.
#[derive(Debug, Clone)]
pub(super) struct Portrait {
    pub name: String,
    pub n_samples: u64,
    pub objects: ObjectCounts,
    pub sum_range_m: f64,
    /// Whether anybody annotated it.
    pub has_truth: bool,
}

impl Portrait {
    fn objects_a_sample(&self) -> f64 {
        self.objects.total() as f64 / self.n_samples.max(1) as f64
    }

    fn mean_range_m(&self) -> f64 {
        self.sum_range_m / self.objects.total().max(1) as f64
    }
}

/// A number and the bounds that it should lie in.
struct Share {
    what: &'static str,
    found: f64,
    usual: [f64; 2],
}

/// The whole set: samples and objects with truth.
fn sum(portraits: &[Portrait]) -> (u64, [u64; 3]) {
    let mut sum = (0, [0; 3]);
    for portrait in portraits.iter().filter(|portrait| portrait.has_truth) {
        sum.0 += portrait.n_samples;
        for kind in Kind::ALL {
            sum.1[kind.index()] += portrait.objects.id.get(kind) + portrait.objects.ood.get(kind);
        }
    }
    sum
}

/// What the set shows, in words. `labels`: counts of the set that the default zone made.
pub(super) fn figures(portraits: &[Portrait], labels: Option<&LabelCounts>) -> String {
    let (n_samples, of_kind) = sum(portraits);
    let n_objects: u64 = of_kind.iter().sum();
    if n_objects == 0 {
        return "no objects are annotated".to_owned();
    }
    let percent = |n: u64| 100.0 * n as f64 / n_objects as f64;
    let a_sample = n_objects as f64 / n_samples.max(1) as f64;
    let [vehicles, pedestrians, statics] = of_kind.map(percent);
    let harmful = labels.and_then(harmful_share).map(|share| format!(", {:.1}% harmful", 100.0 * share));
    format!(
        "{a_sample:.1} objects a sample: {vehicles:.0}% vehicles, {pedestrians:.0}% pedestrians, {statics:.0}% static{}",
        harmful.unwrap_or_default()
    )
}

fn harmful_share(labels: &LabelCounts) -> Option<f64> {
    let all = count_of(labels, None, None);
    let n = all.harmful + all.harmless;
    (n > 0).then(|| all.harmful as f64 / n as f64)
}

/// Everything odd, each with the episode, or with what it is of. `config`: of `gen`.
pub(super) fn judge(
    portraits: &[Portrait],
    config: Option<&GenerateConfig>,
    labels: Option<&LabelCounts>,
) -> Vec<(String, Remark)> {
    let mut found = judge_episodes(portraits);
    if config.is_some_and(has_usual_scene) {
        found.extend(
            judge_set(portraits, labels).into_iter().map(|remark| ("the whole set".to_owned(), remark)),
        );
    }
    found
}

/// Whether nobody changed how much stands and moves in the town.
fn has_usual_scene(config: &GenerateConfig) -> bool {
    let usual = PopulateConfig {
        ood: config.scene.ood,
        split: config.scene.split,
        own_models: config.scene.own_models.clone(),
        ..PopulateConfig::default()
    };
    config.scene == usual && config.annotation == GenerateConfig::default().annotation
}

fn judge_episodes(portraits: &[Portrait]) -> Vec<(String, Remark)> {
    let long: Vec<&Portrait> = portraits
        .iter()
        .filter(|portrait| portrait.has_truth && portrait.n_samples >= MIN_EPISODE_SAMPLES)
        .collect();
    if long.len() < MIN_EPISODES {
        return Vec::new();
    }
    let objects = median(long.iter().map(|portrait| portrait.objects_a_sample()).collect());
    let range_m = median(long.iter().map(|portrait| portrait.mean_range_m()).collect());
    let judge_one = |portrait: &Portrait| {
        let (n, mean_m) = (portrait.objects_a_sample(), portrait.mean_range_m());
        let text = if n == 0.0 && objects >= MIN_OBJECTS {
            format!("no sample has an object, and the set's median is {objects:.1}; some were to be expected")
        } else if n > MAX_OBJECTS_TIMES * objects.max(1.0) {
            format!(
                "{n:.1} objects a sample, and the set's median is {objects:.1}; about as many were to be expected"
            )
        } else if n > 0.0 && !(range_m / MAX_RANGE_TIMES..=range_m * MAX_RANGE_TIMES).contains(&mean_m) {
            format!(
                "objects are {mean_m:.1} m away in the mean, and the set's median is {range_m:.1} m; the unit may be wrong"
            )
        } else {
            return None;
        };
        Some((portrait.name.clone(), Remark::warning(Aspect::Statistics, "unlike the others", text)))
    };
    long.into_iter().filter_map(judge_one).collect()
}

fn judge_set(portraits: &[Portrait], labels: Option<&LabelCounts>) -> Vec<Remark> {
    let (n_samples, of_kind) = sum(portraits);
    let n_objects: u64 = of_kind.iter().sum();
    if n_samples < MIN_SET_SAMPLES {
        return Vec::new();
    }
    let a_sample = n_objects as f64 / n_samples as f64;
    let [vehicles, pedestrians, statics] = of_kind.map(|n| n as f64 / n_objects.max(1) as f64);
    let mut shares = vec![
        Share { what: "objects a sample", found: a_sample, usual: OBJECTS_A_SAMPLE },
        Share { what: "vehicles of all objects", found: vehicles, usual: VEHICLES },
        Share { what: "pedestrians of all objects", found: pedestrians, usual: PEDESTRIANS },
        Share { what: "static things of all objects", found: statics, usual: STATIC },
    ];
    let harmful = labels.and_then(harmful_share);
    shares.extend(harmful.map(|found| Share { what: "harmful of all objects", found, usual: HARMFUL }));
    let is_odd = |share: &Share| !(share.usual[0]..=share.usual[1]).contains(&share.found);
    let tell = |Share { what, found, usual: [least, most] }: Share| {
        let text = format!("{what}: {found:.3}; sets of the presets have {least} to {most}");
        Remark::warning(Aspect::Statistics, what, text)
    };
    shares.into_iter().filter(is_odd).map(tell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn portrait(name: &str, vehicles: u64, pedestrians: u64, statics: u64, range_m: f64) -> Portrait {
        let mut objects = ObjectCounts::default();
        (objects.id.vehicle, objects.id.pedestrian, objects.id.static_object) =
            (vehicles, pedestrians, statics);
        let sum_range_m = range_m * objects.total() as f64;
        Portrait { name: name.into(), n_samples: 40, objects, sum_range_m, has_truth: true }
    }

    fn set() -> Vec<Portrait> {
        (0..10).map(|i| portrait(&format!("e{i}"), 100, 30, 200, 30.0)).collect()
    }

    #[test]
    fn an_episode_unlike_the_others_is_named_and_few_are_not_set_side_by_side() {
        let usual = GenerateConfig::default();
        assert_eq!(judge(&set(), Some(&usual), None), []);
        for odd in [
            portrait("odd", 0, 0, 0, 0.0),
            portrait("odd", 9000, 0, 0, 30.0),
            portrait("odd", 100, 30, 200, 3.0),
        ] {
            let mut all = set();
            all[3] = odd.clone();
            let found = judge(&all, None, None);
            assert!(found.len() == 1 && found[0].0 == "odd", "{found:?}");
            assert_eq!(judge(&[set()[0].clone(), odd], None, None), []);
        }
    }

    #[test]
    fn a_set_without_people_is_told_unless_its_config_asked_for_another_world() {
        let bare: Vec<Portrait> = (0..10).map(|i| portrait(&format!("e{i}"), 100, 0, 200, 30.0)).collect();
        let mut config = GenerateConfig::default();
        let kinds = |config: &GenerateConfig| {
            judge(&bare, Some(config), None).into_iter().map(|(_, remark)| remark.kind).collect::<Vec<_>>()
        };
        assert_eq!(kinds(&config), ["pedestrians of all objects"]);
        config.scene.prop_density = 2.0;
        assert_eq!(kinds(&config), [""; 0]);
        let mut labels = LabelCounts::default();
        labels.id.vehicle.harmful = 300;
        labels.id.vehicle.harmless = 700;
        let told = figures(&bare, Some(&labels));
        assert_eq!(told, "7.5 objects a sample: 33% vehicles, 0% pedestrians, 67% static, 30.0% harmful");
    }
}
