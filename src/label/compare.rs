//! The same objects labelled by several zones: how many each calls harmful, and on which objects they differ.
//!
//! Nothing is written; every annotated box counts once in each sample it is in. An object of unknown velocity, as in logs that tell none,
//! is left out and counted where one of the zones asks for it.

use std::fmt;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;

use super::LabelError;
use super::apply::label_sample;
use super::counts::count_of;
use crate::episode::EpisodeReader;
use crate::episode::manifest::{EpisodeEntry, HarmCounts, LabelCounts, Manifest};
use crate::object::{Distribution, Harm, Kind, Object};
use crate::progress::Progress;
use crate::sample::EgoState;
use crate::text_table::text_table;
use crate::zone::Zone;

/// An object faster than this over ground moves, m/s.
pub const MOVING_MPS: f64 = 0.5;

/// The labels of several zones on one data set, compared.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ZoneComparison {
    pub n_episodes: u64,
    pub n_samples: u64,
    pub n_objects: u64,
    /// Objects that are left out, as their velocity is unknown and a zone asks for it.
    pub n_without_velocity: u64,
    pub zones: Vec<ZoneCounts>,
    /// `[row][column]`: objects that are harmful by the row's zone and harmless by the column's, in the order of `zones`.
    pub change_sides: Vec<Vec<u64>>,
    /// `[row][column]`: objects harmful by both over those harmful by either; `None` if neither has one.
    pub agreement: Vec<Vec<Option<f64>>>,
    /// Objects that are harmful by exactly this many zones, from none to all.
    pub n_harmful_by: Vec<u64>,
    /// The first sample with the most objects on which zones differ, counted through all episodes from 0.
    pub most_disputed_sample: Option<usize>,
}

/// The labels of one zone, counted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ZoneCounts {
    pub zone: String,
    /// Harmful objects over all.
    pub harmful_share: Option<f64>,
    /// Counts by distribution and kind.
    pub counts: LabelCounts,
    pub moving: HarmCounts,
    pub standing: HarmCounts,
}

/// Labels every object of a data set by each of the zones.
///
/// # Errors
/// [`LabelError`]: no data set or an empty one, a broken file, a state of the ego that is not valid.
pub fn compare(
    dataset: &Path,
    zones: &[Zone],
    progress: &dyn Progress,
) -> Result<ZoneComparison, LabelError> {
    let manifest = Manifest::read(dataset)?;
    if manifest.episodes.is_empty() {
        return Err(LabelError::NoEpisodes { path: dataset.to_owned() });
    }
    progress.start("compare", manifest.episodes.iter().map(|entry| entry.n_samples as u64).sum());
    let tallies = manifest
        .episodes
        .par_iter()
        .map(|entry| {
            let tally = Tally::of_episode(dataset, entry, zones);
            progress.advance(entry.n_samples as u64);
            tally
        })
        .collect::<Result<Vec<_>, _>>()?;
    progress.finish();
    let mut sum = Tally::new(zones.len());
    tallies.into_iter().for_each(|tally| sum.merge(tally));
    let names = zones.iter().map(|zone| zone.config().kind.name().to_owned()).collect();
    Ok(sum.finish(names, manifest.episodes.len() as u64))
}

/// Counts over some samples.
#[derive(Debug, Clone, PartialEq)]
struct Tally {
    by_zone: Vec<LabelCounts>,
    moving: Vec<HarmCounts>,
    standing: Vec<HarmCounts>,
    change_sides: Vec<Vec<u64>>,
    both: Vec<Vec<u64>>,
    n_harmful_by: Vec<u64>,
    n_without_velocity: u64,
    /// For each sample, the number of objects on which zones differ.
    n_disputed: Vec<usize>,
}

impl Tally {
    fn new(n_zones: usize) -> Self {
        Self {
            by_zone: vec![LabelCounts::default(); n_zones],
            moving: vec![HarmCounts::default(); n_zones],
            standing: vec![HarmCounts::default(); n_zones],
            change_sides: vec![vec![0; n_zones]; n_zones],
            both: vec![vec![0; n_zones]; n_zones],
            n_harmful_by: vec![0; n_zones + 1],
            n_without_velocity: 0,
            n_disputed: Vec::new(),
        }
    }

    fn of_episode(dataset: &Path, entry: &EpisodeEntry, zones: &[Zone]) -> Result<Self, LabelError> {
        let mut tally = Self::new(zones.len());
        let reader = EpisodeReader::open_entry(dataset, entry)?;
        for (sample_idx, sample) in reader.samples().enumerate() {
            let mut sample = sample?;
            let state = *sample.true_state();
            if let Some(truth) = &mut sample.truth {
                tally.n_without_velocity += leave_out_unknown(&mut truth.objects, zones, &state);
            }
            let harms_by = |zone: &Zone| -> Result<Vec<Harm>, LabelError> {
                let labels = label_sample(zone, &entry.name, sample_idx, &sample)?.labels;
                Ok(labels.iter().map(|label| label.harm).collect())
            };
            let harms = zones.iter().map(harms_by).collect::<Result<Vec<_>, _>>()?;
            tally.add(sample.objects(), &harms);
        }
        Ok(tally)
    }

    /// Adds a sample's objects with each zone's verdict on each.
    fn add(&mut self, objects: &[Object], harms_by_zone: &[Vec<Harm>]) {
        let mut n_disputed = 0;
        for (object_idx, object) in objects.iter().enumerate() {
            let [vx_mps, vy_mps] = object.velocity_in_ego_mps;
            let is_moving = vx_mps.hypot(vy_mps) > MOVING_MPS;
            let harms: Vec<Harm> = harms_by_zone.iter().map(|harms| harms[object_idx]).collect();
            for (zone_idx, &harm) in harms.iter().enumerate() {
                if let Some(counts) = self.by_zone[zone_idx].of_mut(object) {
                    counts.add(harm);
                }
                let by_motion = if is_moving { &mut self.moving } else { &mut self.standing };
                by_motion[zone_idx].add(harm);
                for (other_idx, &other) in harms.iter().enumerate().filter(|_| harm == Harm::Harmful) {
                    let counts = if other == harm { &mut self.both } else { &mut self.change_sides };
                    counts[zone_idx][other_idx] += 1;
                }
            }
            let n_harmful = harms.iter().filter(|&&harm| harm == Harm::Harmful).count();
            self.n_harmful_by[n_harmful] += 1;
            n_disputed += usize::from(n_harmful > 0 && n_harmful < harms.len());
        }
        self.n_disputed.push(n_disputed);
    }

    fn merge(&mut self, other: Self) {
        self.by_zone.iter_mut().zip(&other.by_zone).for_each(|(into, from)| into.add_all(from));
        for (into, from) in [(&mut self.moving, &other.moving), (&mut self.standing, &other.standing)] {
            into.iter_mut().zip(from).for_each(|(into, from)| into.add_all(from));
        }
        for (into, from) in [(&mut self.change_sides, other.change_sides), (&mut self.both, other.both)] {
            let pairs = into.iter_mut().flatten().zip(from.into_iter().flatten());
            pairs.for_each(|(into, from)| *into += from);
        }
        self.n_harmful_by.iter_mut().zip(other.n_harmful_by).for_each(|(into, from)| *into += from);
        self.n_without_velocity += other.n_without_velocity;
        self.n_disputed.extend(other.n_disputed);
    }

    fn finish(self, names: Vec<String>, n_episodes: u64) -> ZoneComparison {
        let share = |part: u64, whole: u64| (whole > 0).then(|| part as f64 / whole as f64);
        let zones = names.into_iter().zip(self.by_zone).zip(self.moving.into_iter().zip(self.standing));
        let zones: Vec<ZoneCounts> = zones
            .map(|((zone, counts), (moving, standing))| {
                let all = count_of(&counts, None, None);
                let harmful_share = share(all.harmful, all.harmful + all.harmless);
                ZoneCounts { zone, harmful_share, counts, moving, standing }
            })
            .collect();
        let n = zones.len();
        // Harmful by either: by both, by one alone, or by the other alone.
        let agreement = |row: usize, column: usize| {
            let both = self.both[row][column];
            share(both, both + self.change_sides[row][column] + self.change_sides[column][row])
        };
        let agreement = (0..n).map(|row| (0..n).map(|column| agreement(row, column)).collect()).collect();
        let most = self.n_disputed.iter().copied().max();
        ZoneComparison {
            n_episodes,
            n_samples: self.n_disputed.len() as u64,
            n_objects: self.n_harmful_by.iter().sum(),
            n_without_velocity: self.n_without_velocity,
            zones,
            change_sides: self.change_sides,
            agreement,
            n_harmful_by: self.n_harmful_by,
            most_disputed_sample: most.and_then(|most| self.n_disputed.iter().position(|&n| n == most)),
        }
    }
}

/// Takes the objects of unknown velocity out where one of the zones asks for it, and tells how many.
fn leave_out_unknown(objects: &mut Vec<Object>, zones: &[Zone], state: &EgoState) -> u64 {
    let is_asked = zones.iter().any(|zone| zone.at(state).is_ok_and(|here| here.uses_velocity()));
    let n_all = objects.len();
    objects.retain(|object| !is_asked || object.velocity_in_ego_mps.iter().all(|part| part.is_finite()));
    (n_all - objects.len()) as u64
}

impl fmt::Display for ZoneComparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent =
            |share: Option<f64>| share.map_or("-".to_owned(), |share| format!("{:.1}%", 100.0 * share));
        let of = |counts: HarmCounts| {
            let all = counts.harmful + counts.harmless;
            percent((all > 0).then(|| counts.harmful as f64 / all as f64))
        };
        writeln!(
            f,
            "{} episodes, {} samples, {} objects, each labelled by every zone\n",
            self.n_episodes, self.n_samples, self.n_objects
        )?;
        if self.n_without_velocity > 0 {
            writeln!(
                f,
                "{} objects are left out: their velocity is unknown, and `ttc` and `rss` go by it\n",
                self.n_without_velocity
            )?;
        }
        let columns = [
            ("id", Some(Distribution::Id), None),
            ("ood", Some(Distribution::Ood), None),
            ("vehicle", None, Some(Kind::Vehicle)),
            ("pedestrian", None, Some(Kind::Pedestrian)),
            ("static", None, Some(Kind::Static)),
        ];
        let head = ["harmful", "objects", "all", "standing", "moving"].into_iter();
        let head = head.chain(columns.map(|column| column.0)).map(str::to_owned).collect();
        let row = |zone: &ZoneCounts| {
            let all = count_of(&zone.counts, None, None);
            let shares =
                columns.map(|(_, distribution, kind)| of(count_of(&zone.counts, distribution, kind)));
            let start =
                [zone.zone.clone(), all.harmful.to_string(), of(all), of(zone.standing), of(zone.moving)];
            start.into_iter().chain(shares).collect::<Vec<_>>()
        };
        f.write_str(&text_table(std::iter::once(head).chain(self.zones.iter().map(row))))?;
        let matrix = |f: &mut fmt::Formatter<'_>, title: &str, cell: &dyn Fn(usize, usize) -> String| {
            let names = || self.zones.iter().map(|zone| zone.zone.clone());
            let head = std::iter::once(String::new()).chain(names()).collect();
            let row = |(row, name)| {
                let cells = (0..self.zones.len()).map(|column| cell(row, column));
                std::iter::once(name).chain(cells).collect::<Vec<_>>()
            };
            write!(f, "\n{title}\n{}", text_table(std::iter::once(head).chain(names().enumerate().map(row))))
        };
        matrix(f, "Objects harmful by the row's zone and harmless by the column's", &|row, column| {
            if row == column { "-".to_owned() } else { self.change_sides[row][column].to_string() }
        })?;
        matrix(f, "Objects harmful by both, over those harmful by either", &|row, column| {
            percent(self.agreement[row][column])
        })?;
        let by: Vec<String> =
            self.n_harmful_by.iter().enumerate().map(|(n, count)| format!("{n}: {count}")).collect();
        write!(f, "\nObjects by the number of zones that call them harmful: {}", by.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use rand::RngExt;

    use super::*;
    use crate::geometry::{Box3, Point};
    use crate::random;
    use crate::zone::{ZoneConfig, ZoneKind};

    fn tally(n_samples: usize, velocity_in_ego_mps: [f64; 2]) -> Tally {
        let zones =
            ZoneKind::ALL.map(|kind| Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap());
        let mut tally = Tally::new(zones.len());
        let mut rng = random::stream(3, "zone-comparison", 0);
        for _ in 0..n_samples {
            let ego = state(rng.random_range(0.0..12.0), rng.random_range(-0.2..0.2));
            let objects: Vec<Object> = (0..5)
                .map(|i| {
                    let x_m = rng.random_range(6.0..45.0);
                    car(i, [x_m, rng.random_range(-0.5..0.5) * x_m], velocity_in_ego_mps)
                })
                .collect();
            let harms = zones.each_ref().map(|zone| {
                let here = zone.at(&ego).unwrap();
                objects.iter().map(|car| here.harm_of_object(car).unwrap().harm).collect()
            });
            tally.add(&objects, &harms);
        }
        tally
    }

    fn state(speed_mps: f64, steering_angle_rad: f64) -> EgoState {
        EgoState {
            speed_mps,
            steering_angle_rad,
            yaw_rate_rps: 0.0,
            acceleration_mps2: 0.0,
            wheelbase_m: 2.6,
            front_bumper_x_m: 3.3,
        }
    }

    fn car(i: usize, [x_m, y_m]: [f64; 2], velocity_in_ego_mps: [f64; 2]) -> Object {
        let center = Point::new(x_m, y_m, 0.75);
        Object {
            velocity_in_ego_mps,
            id: Some(format!("car-{i}")),
            kind: Some(Kind::Vehicle),
            distribution: Some(Distribution::Id),
            ..Object::new(Box3 { center, length_m: 4.0, width_m: 1.8, height_m: 1.5, yaw_rad: 0.2 })
        }
    }

    fn names() -> Vec<String> {
        ZoneKind::ALL.map(|kind| kind.name().to_owned()).to_vec()
    }

    #[test]
    fn changes_of_sides_and_agreement_follow_from_the_counts() {
        let found = tally(20, [0.0, 0.0]).finish(names(), 1);
        assert_eq!((found.n_samples, found.n_objects), (20, 100));
        assert_eq!(found.n_harmful_by.iter().sum::<u64>(), 100);
        let n_harmful: Vec<u64> =
            found.zones.iter().map(|zone| count_of(&zone.counts, None, None).harmful).collect();
        let weighted: u64 = found.n_harmful_by.iter().enumerate().map(|(n, count)| n as u64 * count).sum();
        assert_eq!(weighted, n_harmful.iter().sum::<u64>());
        for row in 0..names().len() {
            assert_eq!(found.change_sides[row][row], 0);
            assert_eq!(found.agreement[row][row], Some(1.0));
            for column in 0..names().len() {
                // Harmful by the row = by both + by the row alone.
                let both = n_harmful[row] - found.change_sides[row][column];
                assert_eq!(both, n_harmful[column] - found.change_sides[column][row]);
                assert_eq!(found.agreement[row][column], found.agreement[column][row]);
            }
        }
        assert!(found.change_sides.iter().flatten().any(|&n| n > 0));
        assert_eq!(found.zones[0].moving, HarmCounts::default());
        assert_eq!(found.zones[0].standing.harmful, n_harmful[0]);
    }

    #[test]
    fn velocities_move_ttc_and_rss_and_leave_rect_and_arc() {
        let [standing, coming] =
            [[0.0, 0.0], [-8.0, 0.0]].map(|velocity| tally(20, velocity).finish(names(), 1));
        for (a, b) in standing.zones.iter().zip(&coming.zones) {
            let more = b.harmful_share.unwrap() > a.harmful_share.unwrap();
            assert_eq!(more, ["ttc", "rss"].contains(&a.zone.as_str()), "{}", a.zone);
            assert_eq!(b.standing, HarmCounts::default());
        }
    }

    #[test]
    fn objects_of_unknown_velocity_are_left_out_where_a_zone_asks_for_it() {
        let zone = |kind| Zone::try_from(ZoneConfig { kind, ..ZoneConfig::default() }).unwrap();
        let [rect, ttc] = [ZoneKind::Rect, ZoneKind::Ttc].map(zone);
        let all = [car(0, [10.0, 0.0], [1.0, 0.0]), car(1, [20.0, 0.0], [f64::NAN; 2])];
        let left = |zones: &[Zone]| {
            let mut objects = all.to_vec();
            (leave_out_unknown(&mut objects, zones, &state(8.0, 0.0)), objects.len())
        };
        assert_eq!((left(std::slice::from_ref(&rect)), left(&[rect.clone(), ttc.clone()])), ((0, 2), (1, 1)));
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        let (mut one, other) = (tally(7, [1.0, 0.0]), tally(7, [1.0, 0.0]));
        one.merge(other);
        let (twice, once) = (one.finish(names(), 2), tally(7, [1.0, 0.0]).finish(names(), 1));
        assert_eq!((twice.n_objects, twice.n_samples), (2 * once.n_objects, 14));
        assert_eq!(twice.change_sides[0][1], 2 * once.change_sides[0][1]);
        assert_eq!(twice.agreement, once.agreement);
        assert_eq!(twice.most_disputed_sample, once.most_disputed_sample);
    }

    #[test]
    fn the_table_names_every_zone_in_rows_and_columns() {
        let text = tally(20, [0.0, 0.0]).finish(names(), 1).to_string();
        for name in names() {
            assert!(text.matches(&name).count() >= 5, "{text}");
        }
        assert!(text.contains("20 samples, 100 objects") && text.contains("100.0%"), "{text}");
    }
}
