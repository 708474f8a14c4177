//! Split test, for reporting: data sets in the towns that come with harmzone and in maps by path, made where they are not there,
//! and what networks find in them.
//!
//! One data set is loaded at a time, boxes are kept: in memory while the experiment runs, and in `report/<set>/boxes-<network>` for
//! whoever asks for a figure later.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use super::config::SeenRowConfig;
use super::data::{LABELS, prepare_to_report};
use super::experiment::{Experiment, Row};
use super::found::Found;
use harmzone::dataset::{Dataset, Fingerprint};
use harmzone::episode::Split;
use harmzone::eval::{EvalSample, Mode};
use harmzone::files::sha256_hex;

/// Data sets in the same towns, without and with unfamiliar objects.
struct Group {
    /// Name of the one without in the experiment's folder.
    name: &'static str,
    /// Maps by path; none for the towns of the split.
    maps: Option<Vec<PathBuf>>,
}

impl Group {
    fn folder(&self, mode: Mode) -> String {
        match mode {
            Mode::Id => self.name.to_owned(),
            Mode::Ood => format!("{}-ood", self.name),
        }
    }
}

/// All data sets of split test.
pub struct SplitTest<'a> {
    experiment: &'a Experiment<'a>,
    found: &'a Found,
    groups: Vec<Group>,
    /// Maps that are not there, so that nothing is reported on them.
    pub absent_maps: Vec<PathBuf>,
    open: RefCell<Option<(PathBuf, Rc<Dataset>)>>,
}

/// What a network is asked on: one group of towns, or all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Towns {
    Group(usize),
    All,
}

impl<'a> SplitTest<'a> {
    /// Makes nothing yet.
    pub fn new(experiment: &'a Experiment<'a>, found: &'a Found) -> Self {
        let maps = experiment.request.config.test_maps.iter().cloned();
        let (maps, absent_maps): (Vec<PathBuf>, Vec<PathBuf>) = maps.partition(|map| map.is_file());
        let mut groups = vec![Group { name: "test", maps: None }];
        if !maps.is_empty() {
            groups.push(Group { name: "test-maps", maps: Some(maps) });
        }
        Self { experiment, found, groups, absent_maps, open: RefCell::default() }
    }

    /// Each group, then, where there are several, all of them together.
    pub fn towns(&self) -> Vec<Towns> {
        let together = (self.groups.len() > 1).then_some(Towns::All);
        (0..self.groups.len()).map(Towns::Group).chain(together).collect()
    }

    /// Name of the folder that holds all of the scoring.
    pub fn name(&self, towns: Towns, mode: Mode) -> String {
        match towns {
            Towns::Group(place) => self.groups[place].folder(mode),
            Towns::All => Group { name: "test-all", maps: None }.folder(mode),
        }
    }

    fn groups_of(&self, towns: Towns) -> &[Group] {
        match towns {
            Towns::Group(place) => std::slice::from_ref(&self.groups[place]),
            Towns::All => &self.groups,
        }
    }

    /// The folders of the data sets.
    pub fn paths(&self, towns: Towns, mode: Mode) -> Vec<PathBuf> {
        self.groups_of(towns)
            .iter()
            .map(|group| self.experiment.request.out.join(group.folder(mode)))
            .collect()
    }

    /// Of the data sets as they lie there; none where one is not made yet.
    pub fn kept_fingerprint(&self, towns: Towns, mode: Mode) -> Option<Fingerprint> {
        let prints = self.paths(towns, mode).into_iter().map(|path| Fingerprint::of(&path, LABELS).ok());
        prints.collect::<Option<Vec<_>>>().map(|prints| together(&prints))
    }

    /// Of the data sets, which are made where they are not there.
    ///
    /// # Errors
    /// They cannot be made or read.
    pub fn fingerprint(&self, towns: Towns, mode: Mode) -> anyhow::Result<Fingerprint> {
        let opened =
            self.groups_of(towns).iter().map(|group| Ok(self.open(group, mode)?.fingerprint().clone()));
        Ok(together(&opened.collect::<anyhow::Result<Vec<_>>>()?))
    }

    /// The towns' names, sorted, and the numbers of episodes and samples.
    ///
    /// # Errors
    /// As [`Self::fingerprint`].
    pub fn extent(&self, towns: Towns, mode: Mode) -> anyhow::Result<(Vec<String>, usize, usize)> {
        let (mut names, mut n_episodes, mut n_samples) = (Vec::new(), 0, 0);
        for group in self.groups_of(towns) {
            let data = self.open(group, mode)?;
            names.extend(data.episodes().iter().map(|entry| entry.town.clone()));
            n_episodes += data.episodes().len();
            n_samples += data.samples().len();
        }
        names.sort();
        names.dedup();
        Ok((names, n_episodes, n_samples))
    }

    /// The samples with what a row finds in them; of several data sets under names that tell those apart.
    ///
    /// # Errors
    /// The data cannot be made or read, the network learned from them, or cannot run on them.
    pub fn look(
        &self,
        row: &Row,
        seen: &SeenRowConfig,
        towns: Towns,
        mode: Mode,
    ) -> anyhow::Result<Vec<EvalSample>> {
        let mut samples = Vec::new();
        for group in self.groups_of(towns) {
            let data = self.open(group, mode)?;
            let keep_in = self.experiment.request.out.join("report").join(group.folder(mode));
            let judged = self.found.look(self.experiment, row, seen, &data, Some(&keep_in))?;
            samples.extend(judged.into_iter().map(|sample| match towns {
                Towns::Group(_) => sample,
                Towns::All => of_set(sample, group.name),
            }));
        }
        Ok(samples)
    }

    /// Makes what is missing of a data set; the one that was asked for last stays loaded.
    fn open(&self, group: &Group, mode: Mode) -> anyhow::Result<Rc<Dataset>> {
        let path = self.experiment.request.out.join(group.folder(mode));
        if let Some((_, data)) = self.open.borrow().as_ref().filter(|(of, _)| *of == path) {
            return Ok(Rc::clone(data));
        }
        self.open.take();
        let maps = group.maps.as_deref();
        prepare_to_report(self.experiment.request, mode == Mode::Ood, maps, &path, self.experiment.progress)?;
        let data = Rc::new(load(&path)?);
        self.open.replace(Some((path, Rc::clone(&data))));
        Ok(data)
    }
}

fn load(path: &Path) -> anyhow::Result<Dataset> {
    Ok(Dataset::open(path, LABELS, Split::Test)?)
}

/// Data sets number their episodes alike.
fn of_set(sample: EvalSample, set: &str) -> EvalSample {
    let mut facts = sample.facts;
    facts.episode = facts.episode.map(|episode| format!("{set}:{episode}"));
    EvalSample { id: format!("{set}:{}", sample.id), facts, ..sample }
}

/// That of several data sets; of one its own.
fn together(prints: &[Fingerprint]) -> Fingerprint {
    let [one] = prints else {
        let hash = |of: fn(&Fingerprint) -> &str| {
            sha256_hex(prints.iter().map(of).collect::<Vec<_>>().join(" ").as_bytes())
        };
        return Fingerprint {
            dataset_sha256: hash(|print| &print.dataset_sha256),
            labels_sha256: hash(|print| &print.labels_sha256),
        };
    };
    one.clone()
}

#[cfg(test)]
mod tests {
    use super::*;
    use harmzone::dataset::SampleFacts;
    use harmzone::eval::{Protocol, evaluate};

    #[test]
    fn episodes_of_two_sets_are_told_apart() {
        let sample = |set: &str, episode: Option<&str>| {
            let facts = SampleFacts { episode: episode.map(str::to_owned), ..SampleFacts::default() };
            of_set(EvalSample::new("episode_000000/0", facts, Vec::new(), Vec::new()), set)
        };
        let (one, other) = (sample("test", None), sample("test-maps", Some("episode_000000")));
        assert_eq!(one.id, "test:episode_000000/0");
        assert_eq!(other.facts.episode.as_deref(), Some("test-maps:episode_000000"));
        let twice = vec![one.clone(), one];
        assert!(evaluate(&twice, &Protocol::default(), Mode::Id).is_err(), "the same sample twice");
    }

    #[test]
    fn a_single_set_keeps_its_fingerprint() {
        let print = |c: &str| Fingerprint { dataset_sha256: c.repeat(64), labels_sha256: "e".repeat(64) };
        assert_eq!(together(&[print("a")]), print("a"));
        let both = together(&[print("a"), print("b")]);
        assert!(both != print("a") && both != together(&[print("b"), print("a")]));
        assert_eq!(both.dataset_sha256.len(), 64);
    }
}
