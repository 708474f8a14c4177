//! Near objects that are found, whatever they are called, at a bearable number of false boxes.
//!
//! It asks for no speeds and no poses, so that a log of frames has it, too. A harmful and a harmless box of one query, or within
//! 0.5 m of each other, are one box ([`join_classes`]) with the sum of their scores, at most 1; with the better's score where not all
//! scores are from 0 to 1. By falling score, the later first among equals, each takes the nearest object that none has taken, if
//! nearer than the threshold of the errors; one that takes none is false, unless nobody annotated what may be there
//! ([`crate::eval::neutral`]), or it lies on an object that the LiDAR did not hit. Near objects are nearer than 30 m and have 10 LiDAR points or more. The score is the lowest at which
//! false boxes, at any range, do not exceed the given number a sample. Intervals are of the same resamples as those of the APs, each
//! with a score of its own.

use serde::{Deserialize, Serialize};

use super::{Context, MetricTable, MetricValue};
use crate::eval::EvalConfig;
use crate::eval::bootstrap::{Resamples, interval};
use crate::eval::filter::KeptSample;
use crate::eval::judge::{Joined, join_classes};
use crate::eval::matching::center_distance_m;
use crate::object::{Detection, Distribution, Harm, Kind, LabelledObject};

/// Where a car in a town has to see all that stands.
const NEAR_M: f64 = 30.0;
/// Fewer tell next to nothing of a shape.
const N_POINTS: u32 = 10;
/// False boxes a sample.
const FALSE_BOXES: [f64; 2] = [0.1, 1.0];

/// What is found at a number of false boxes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NearFound {
    pub max_false_per_sample: f64,
    /// Boxes of this score or more count; `None` if none may.
    pub score: Option<f64>,
    pub n_false: usize,
    /// All near objects, then those of each class, kind and distribution that there are.
    pub groups: Vec<NearGroup>,
}

/// Near objects of a group.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NearGroup {
    pub name: String,
    pub n_objects: usize,
    pub n_found: usize,
    pub found: Option<f64>,
    pub found_interval: Option<[f64; 2]>,
}

/// One for each number of false boxes; empty where there is no near object, or nobody counted points.
pub(super) fn measure(of: &Context<'_>) -> Vec<NearFound> {
    let matching = of.matching;
    let resamples = Resamples::always(matching);
    let mut facts = Facts::default();
    let mut scores = matching.samples.iter().flat_map(|sample| &sample.detections).map(|found| found.score);
    let are_probabilities = scores.all(|score| (0.0..=1.0).contains(&score));
    for (sample, &episode) in matching.samples.iter().zip(&resamples.episode_of) {
        facts.add(sample, episode, matching.config().tp_threshold_m, are_probabilities);
    }
    if facts.near.is_empty() {
        return Vec::new();
    }
    facts.false_boxes.sort_by(|a, b| b.score.total_cmp(&a.score));
    facts.n_samples =
        resamples.episode_of.iter().fold(vec![0; resamples.n_episodes], |mut counts, &episode| {
            counts[episode] += 1;
            counts
        });
    let groups = Group::all().into_iter().filter(|group| facts.near.iter().any(|of| group.has(of.object)));
    let groups: Vec<Group> = groups.collect();
    FALSE_BOXES.map(|per_sample| facts.point(per_sample, &groups, &resamples)).into()
}

/// A box on nothing.
struct FalseBox {
    score: f64,
    episode: usize,
}

/// A near object, and the score of the box on it.
struct Near<'a> {
    object: &'a LabelledObject,
    episode: usize,
    score: Option<f64>,
}

#[derive(Default)]
struct Facts<'a> {
    /// By falling score.
    false_boxes: Vec<FalseBox>,
    near: Vec<Near<'a>>,
    /// Of each episode.
    n_samples: Vec<u32>,
}

impl<'a> Facts<'a> {
    fn add(&mut self, sample: &KeptSample<'a>, episode: usize, threshold_m: f64, are_probabilities: bool) {
        let detections: Vec<Detection> = sample.detections.iter().map(|&found| *found).collect();
        let boxes = join_classes(&detections);
        let score_of =
            |of: &Joined| if are_probabilities { of.object.score } else { detections[of.place].score };
        let mut boxes: Vec<(f64, Joined)> = boxes.into_iter().map(|of| (score_of(&of), of)).collect();
        boxes.sort_by(|a, b| b.0.total_cmp(&a.0).then(b.1.place.cmp(&a.1.place)));
        let mut scores: Vec<Option<f64>> = vec![None; sample.objects.len()];
        // What the LiDAR did not hit is not near enough to count, but is there.
        let mut unhit_scores: Vec<Option<f64>> = vec![None; sample.unhit.len()];
        for (score, found) in boxes {
            let nearest = |objects: &[&LabelledObject], scores: &[Option<f64>]| {
                let free = objects.iter().enumerate().filter(|(i, _)| scores[*i].is_none());
                free.map(|(i, of)| (i, center_distance_m(&found.object.box_in_ego, &of.truth.box_in_ego)))
                    .filter(|&(_, distance_m)| distance_m < threshold_m)
                    .min_by(|a, b| a.1.total_cmp(&b.1))
            };
            if let Some((i, _)) = nearest(&sample.objects, &scores) {
                scores[i] = Some(score);
            } else if let Some((i, _)) = nearest(&sample.unhit, &unhit_scores) {
                unhit_scores[i] = Some(score);
            } else if sample.neutral_at(found.place).is_none() {
                self.false_boxes.push(FalseBox { score, episode });
            }
        }
        let near = sample.objects.iter().zip(scores).filter(|(object, _)| is_near(object));
        self.near.extend(near.map(|(&object, score)| Near { object, episode, score }));
    }

    /// The score above which boxes count in a resample, and how many false ones then do; above none where all may.
    fn bound(&self, per_sample: f64, n_drawn: &[u32]) -> (Option<f64>, u32) {
        let n_samples: u32 = self.n_samples.iter().zip(n_drawn).map(|(n, drawn)| n * drawn).sum();
        let allowed = per_sample * f64::from(n_samples);
        // Equal scores count together.
        let (mut n_false, mut n_before) = (0, 0);
        for of_score in self.false_boxes.chunk_by(|a, b| a.score == b.score) {
            n_false += of_score.iter().map(|of| n_drawn[of.episode]).sum::<u32>();
            if f64::from(n_false) > allowed {
                return (Some(of_score[0].score), n_before);
            }
            n_before = n_false;
        }
        (None, n_false)
    }

    fn point(&self, per_sample: f64, groups: &[Group], resamples: &Resamples) -> NearFound {
        // Of each group found and there.
        let count = |n_drawn: &[u32]| -> Vec<[u32; 2]> {
            let (bound, _) = self.bound(per_sample, n_drawn);
            let counts = |score: f64| bound.is_none_or(|bound| score > bound);
            let of_group = |group: &Group| {
                let of = self.near.iter().filter(|of| group.has(of.object));
                of.fold([0, 0], |[n_found, n], of| {
                    let drawn = n_drawn[of.episode];
                    let found = if of.score.is_some_and(counts) { drawn } else { 0 };
                    [n_found + found, n + drawn]
                })
            };
            groups.iter().map(of_group).collect()
        };
        let share = |[n_found, n]: [u32; 2]| (n > 0).then(|| f64::from(n_found) / f64::from(n));
        let once = vec![1; resamples.n_episodes];
        let (whole, resampled) = (count(&once), resamples.map(count));
        let (bound, n_false) = self.bound(per_sample, &once);
        let scores = self.near.iter().filter_map(|of| of.score);
        let counting = scores.chain(self.false_boxes.iter().map(|of| of.score));
        let counting = counting.filter(|&score| bound.is_none_or(|bound| score > bound));
        let group = |(i, group): (usize, &Group)| NearGroup {
            name: group.name().to_owned(),
            n_objects: whole[i][1] as usize,
            n_found: whole[i][0] as usize,
            found: share(whole[i]),
            found_interval: interval(resampled.iter().filter_map(|of| share(of[i]))),
        };
        NearFound {
            max_false_per_sample: per_sample,
            score: counting.min_by(f64::total_cmp),
            n_false: n_false as usize,
            groups: groups.iter().enumerate().map(group).collect(),
        }
    }
}

fn is_near(object: &LabelledObject) -> bool {
    let center = &object.truth.box_in_ego.center;
    object.truth.n_lidar_points.is_some_and(|n| n >= N_POINTS) && center.x().hypot(center.y()) < NEAR_M
}

/// Objects that are counted apart.
enum Group {
    All,
    Class(Harm),
    Kind(Kind),
    Distribution(Distribution),
}

impl Group {
    fn all() -> Vec<Self> {
        let classes = Harm::ALL.map(Self::Class).into_iter();
        let distributions = [Distribution::Id, Distribution::Ood].map(Self::Distribution);
        [Self::All].into_iter().chain(classes).chain(Kind::ALL.map(Self::Kind)).chain(distributions).collect()
    }

    fn name(&self) -> &'static str {
        match self {
            Self::All => "all objects",
            Self::Class(class) => class.name(),
            Self::Kind(kind) => kind.name(),
            Self::Distribution(of) => of.name(),
        }
    }

    fn has(&self, object: &LabelledObject) -> bool {
        match *self {
            Self::All => true,
            Self::Class(class) => object.harm == class,
            Self::Kind(kind) => object.truth.kind == Some(kind),
            Self::Distribution(of) => object.truth.distribution == Some(of),
        }
    }
}

pub(super) fn show(points: &Vec<NearFound>, config: &EvalConfig) -> Option<MetricTable> {
    let first = points.first()?;
    let rows = first.groups.iter().enumerate().map(|(i, group)| {
        let shares = points.iter().map(|point| {
            let of = &point.groups[i];
            MetricValue::Share { value: of.found, of: Some(of.n_objects), interval: of.found_interval }
        });
        std::iter::once(MetricValue::name(group.name.clone())).chain(shares).collect()
    });
    let scores = points.iter().map(|point| {
        let score = point.score.map_or_else(|| "none".to_owned(), |score| format!("{score:.3}"));
        format!("At {} the score is {score} and {} are false", point.max_false_per_sample, point.n_false)
    });
    let note = format!(
        "Objects nearer than {NEAR_M} m with {N_POINTS} points or more, found at {} m under whatever name. {}.",
        config.tp_threshold_m,
        scores.collect::<Vec<_>>().join(". ")
    );
    let mut table = MetricTable::new(&["near objects found"], rows.collect(), note)?;
    table
        .head
        .extend(points.iter().map(|point| format!("at {} false boxes a sample", point.max_false_per_sample)));
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::SampleFacts;
    use crate::eval::matching::tests::{found, truth};
    use crate::eval::{EvalSample, Mode, Protocol, evaluate};
    use crate::geometry::Point2;
    use crate::sample::IgnoredRegion;

    fn object(x_m: f64, n_lidar_points: u32) -> LabelledObject {
        let mut of = truth(x_m, Harm::Harmful, Distribution::Id);
        of.truth.n_lidar_points = Some(n_lidar_points);
        of.truth.kind = Some(Kind::Vehicle);
        of
    }

    fn measured(samples: &[(Vec<LabelledObject>, Vec<Detection>)]) -> Vec<NearFound> {
        let sample = |(i, (objects, found)): (usize, &(Vec<LabelledObject>, Vec<Detection>))| {
            EvalSample::new(format!("{i}/0"), SampleFacts::default(), objects.clone(), found.clone())
        };
        let samples: Vec<EvalSample> = samples.iter().enumerate().map(sample).collect();
        evaluate(&samples, &Protocol::default(), Mode::Id).unwrap().safety.near
    }

    #[test]
    fn a_box_of_either_class_finds_an_object_and_both_together_are_one() {
        let found_both = vec![found(10.0, Harm::Harmless, 0.3), found(10.1, Harm::Harmful, 0.2)];
        // The false box is above each of the two but below both together.
        let with_false = [found_both, vec![found(40.0, Harm::Harmful, 0.4)]].concat();
        let points = measured(&[(vec![object(10.0, 10)], with_false)]);
        let all = |point: &NearFound| (point.groups[0].n_found, point.groups[0].n_objects, point.n_false);
        assert_eq!(all(&points[0]), (1, 1, 0));
        assert!((points[0].score.unwrap() - 0.5).abs() < 1e-6, "{points:?}");
        assert_eq!(all(&points[1]), (1, 1, 1));
        let names: Vec<&str> = points[0].groups.iter().map(|of| of.name.as_str()).collect();
        assert_eq!(names, ["all objects", "harmful", "vehicle", "id"]);
    }

    #[test]
    fn what_is_far_or_has_few_points_is_not_asked_for_and_its_box_is_not_false() {
        let far = vec![object(10.0, 9), object(30.0, 50), object(29.0, 10)];
        let boxes = vec![found(10.0, Harm::Harmful, 0.9), found(30.0, Harm::Harmful, 0.8)];
        let points = measured(&[(far, boxes)]);
        // The box at 30 m lies on what is 30 m away.
        assert_eq!(
            (points[1].groups[0].n_objects, points[1].groups[0].n_found, points[1].n_false),
            (1, 0, 0)
        );
        assert!(measured(&[(vec![object(30.0, 50)], vec![])]).is_empty(), "there is no near object");
    }

    #[test]
    fn a_box_on_what_the_lidar_did_not_hit_is_not_false_but_a_second_one_is() {
        let objects = vec![object(10.0, 10), object(20.0, 0)];
        let boxes = [20.0, 20.5].map(|x_m| found(x_m, Harm::Harmless, 0.9)).to_vec();
        let points = measured(&[(objects, boxes)]);
        assert_eq!(
            (points[1].groups[0].n_objects, points[1].groups[0].n_found, points[1].n_false),
            (1, 0, 1)
        );
    }

    #[test]
    fn what_lies_on_ignored_ground_is_not_false_and_scores_above_one_keep_their_rank() {
        let corners = [(38.0, -2.0), (42.0, -2.0), (42.0, 2.0), (38.0, 2.0)];
        let corners_in_ego_m = corners.map(|(x_m, y_m)| Point2 { x_m, y_m }).to_vec();
        let facts = SampleFacts {
            ignored: vec![IgnoredRegion::Ground { corners_in_ego_m }],
            ..SampleFacts::default()
        };
        // The better box of the two at 40 m is the last one given; the false box lies at 20 m.
        let boxes = |scale: f64| {
            let placed = [
                (10.0, Harm::Harmful, 0.5),
                (40.0, Harm::Harmless, 0.3),
                (20.0, Harm::Harmful, 0.6),
                (40.1, Harm::Harmful, 0.65),
            ];
            placed.map(|(x_m, harm, score)| found(x_m, harm, scale * score)).to_vec()
        };
        for scale in [1.0, 10.0] {
            let sample = EvalSample::new("s", facts.clone(), vec![object(10.0, 20)], boxes(scale));
            let points = evaluate(&[sample], &Protocol::default(), Mode::Id).unwrap().safety.near;
            assert_eq!(
                (points[0].n_false, points[0].groups[0].n_found),
                (0, 0),
                "the false box is above the object's"
            );
            assert_eq!((points[1].n_false, points[1].groups[0].n_found), (1, 1));
            assert_eq!(points[1].score, Some(scale * 0.5));
        }
    }

    #[test]
    fn equal_scores_count_together_and_a_second_box_on_an_object_is_false() {
        let twice = vec![found(10.0, Harm::Harmful, 0.6), found(11.0, Harm::Harmful, 0.5)];
        let other = vec![found(60.0, Harm::Harmful, 0.5), found(45.0, Harm::Harmless, 0.5)];
        let points = measured(&[(vec![object(10.0, 20)], twice), (vec![object(12.0, 20)], other)]);
        // Of a sample one may be false, of two two; the range ends at 50 m, so that two are.
        assert_eq!((points[1].n_false, points[1].groups[0].n_found), (2, 1));
        // A tenth of two allows none: the score is that of the first box.
        assert_eq!((points[0].score, points[0].groups[0].found), (Some(0.6), Some(0.5)));
        let interval = points[0].groups[0].found_interval.unwrap();
        assert_eq!(interval, [0.0, 1.0]);
    }
}
