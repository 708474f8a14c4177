//! Where the boxes come from by which the ego brakes.

use burn::tensor::Device;

use super::DriveError;
use super::config::ReflexConfig;
use super::external::{External, ExternalError};
use super::foresight::Foresight;
use crate::eval::judge::Judge;
use crate::infer::{self, Trained, TrainedError};
use crate::model::Detector;
use crate::object::{Detection, Harm, Object};
use crate::outcome::Source;
use crate::progress::Silent;
use crate::sample::{EgoState, Measured};
use crate::zone::Zone;

/// An opened source of boxes.
#[derive(Debug)]
pub(super) enum Perception {
    Blind,
    Truth,
    Network(Box<Network>),
    External { command: String, reply_s: f64, running: Option<External> },
}

#[derive(Debug)]
pub(super) struct Network {
    detector: Detector,
    judge: Judge,
    device: Device,
    scores: CountsFrom,
    /// Whether it has answered once: a device compiles its kernels at the first call.
    is_warm: bool,
}

/// The scores from which on a driver's boxes count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CountsFrom {
    /// From here on the ego brakes for them as hard as it takes.
    pub sure: f64,
    /// From here on they are there, and the ego brakes for them a little; no higher than `sure`.
    pub seen: f64,
}

/// What can be seen at one instant.
pub(super) struct Instant<'a> {
    pub episode: &'a str,
    pub sample_idx: u64,
    /// What the sensors measured; there for those that need it.
    pub measured: Option<&'a Measured>,
    /// All that is there, and the ego's true state.
    pub present: &'a [(usize, Object)],
    pub true_state: &'a EgoState,
}

impl Perception {
    /// Loads the network, if it is one, whose checkpoint has this hash.
    ///
    /// # Errors
    /// There is no such run, its checkpoint is broken, or is another one by now.
    pub fn open(
        source: &Source,
        sha256: &str,
        config: &ReflexConfig,
        reply_s: f64,
        device: &Device,
    ) -> Result<Self, DriveError> {
        Ok(match source {
            Source::Blind => Self::Blind,
            Source::Truth => Self::Truth,
            Source::External { command } => {
                Self::External { command: command.clone(), reply_s, running: None }
            }
            Source::Network { run, judge, score, warning } => {
                let trained = Trained::find(run)?;
                trained.check_sha256(sha256)?;
                let (scores, _) = network_scores(&trained, *judge, [*score, *warning], config)?;
                let detector = trained.load(device)?;
                let (judge, device) = (*judge, device.clone());
                Self::Network(Box::new(Network { detector, judge, device, scores, is_warm: false }))
            }
        })
    }

    /// Scores from which on its boxes count.
    pub fn scores(&self, config: &ReflexConfig) -> CountsFrom {
        match self {
            Self::Network(network) => network.scores,
            Self::Blind | Self::Truth | Self::External { .. } => {
                let of_all = score_of_all(config).unwrap_or(f64::NEG_INFINITY);
                CountsFrom { sure: of_all, seen: of_all }
            }
        }
    }

    /// Whether its next answer is the first of its program, which loads what it needs: no time that a car on its way would wait.
    pub fn is_loading(&self) -> bool {
        match self {
            Self::Network(network) => !network.is_warm,
            Self::External { running, .. } => running.is_none(),
            Self::Blind | Self::Truth => false,
        }
    }

    /// Whether the velocities of its boxes are to be believed: one sample shows a network none.
    pub fn knows_velocities(&self) -> bool {
        matches!(self, Self::Truth)
    }

    /// Its boxes, harmful and harmless.
    ///
    /// # Errors
    /// The external program fails; a picture is broken; a state is not valid for the zone.
    pub fn detect(&mut self, zone: &Zone, at: &Instant<'_>) -> Result<Vec<Detection>, DriveError> {
        let measured = || at.measured.expect("who needs sensors is given what they measured");
        match self {
            Self::Blind => Ok(Vec::new()),
            Self::Truth => {
                let here = zone.at(at.true_state)?;
                let of_object = |(_, object): &(usize, Object)| {
                    let harm = here.harm_of_object(object)?.harm;
                    let velocity_in_ego_mps = object.velocity_in_ego_mps;
                    let box_in_ego = object.solid_in_ego();
                    Ok(Detection { box_in_ego, velocity_in_ego_mps, harm, score: 1.0, spread: None })
                };
                at.present.iter().map(of_object).collect()
            }
            Self::Network(network) => {
                let (measured, Network { detector, judge, device, .. }) = (measured(), &**network);
                let found = infer::predict_for(*judge, detector, &[(at.episode, measured)], device, &Silent)?;
                let judge = *judge;
                network.is_warm = true;
                let found = found.into_iter().next().unwrap_or_default();
                Ok(judge.judge(&found, &measured.ego_state, zone)?)
            }
            Self::External { command, reply_s, running } => {
                let running = match running {
                    Some(running) => running,
                    none => none.insert(External::start(command, *reply_s)?),
                };
                Ok(running.detect(at.episode, at.sample_idx, measured())?)
            }
        }
    }

    /// After a failure a program starts anew with the next episode.
    pub fn give_up(&mut self) {
        if let Self::External { running, .. } = self {
            *running = None;
        }
    }
}

/// The score from which on every driver's boxes count, if the config has one.
pub(super) fn score_of_all(config: &ReflexConfig) -> Option<f64> {
    (config.score > 0.0).then_some(config.score)
}

/// The scores from which on a network's boxes count. The ego brakes fully from what was asked for with it, else the config's, else
/// its own for braking; a rule over its boxes has none. They are there from the second that was asked for on, else from the one that it
/// warns from, where the brake may be partial. And whether anybody chose the first.
///
/// # Errors
/// The checkpoint is broken.
pub(super) fn network_scores(
    trained: &Trained,
    judge: Judge,
    [asked, asked_for_warning]: [Option<f64>; 2],
    config: &ReflexConfig,
) -> Result<(CountsFrom, bool), TrainedError> {
    let own = trained.braking_score()?.filter(|_| judge == Judge::Network).map(|own| own.score);
    let chosen = asked.or(score_of_all(config)).or(own);
    let warning = match asked_for_warning {
        Some(asked) => asked,
        None => trained.eval_config()?.operating_score,
    };
    let sure = chosen.unwrap_or(warning);
    let seen = if config.partial_mps2 > 0.0 { warning.min(sure) } else { sure };
    Ok((CountsFrom { sure, seen }, chosen.is_some()))
}

impl From<ExternalError> for DriveError {
    fn from(error: ExternalError) -> Self {
        Self::External(error)
    }
}

/// The numbers of the objects that are truly harmful now: those that the zone calls so, and those that move into the ego's way.
pub(super) fn truly_harmful(
    zone: &Zone,
    foresight: &Foresight,
    state: &EgoState,
    present: &[(usize, Object)],
) -> Result<Vec<usize>, DriveError> {
    let (here, soon) = (zone.at(state)?, foresight.at(state)?);
    let mut harmful = Vec::new();
    for (i, object) in present {
        let is_harmful = here.harm_of_object(object)?.harm == Harm::Harmful
            || soon.meeting(&object.solid_in_ego(), object.velocity_in_ego_mps)?.is_some();
        if is_harmful {
            harmful.push(*i);
        }
    }
    Ok(harmful)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_network_brakes_from_its_score_for_braking_and_sees_what_it_warns_of() {
        let small = Trained::find("small".as_ref()).unwrap();
        let scores = |judge, asked, score| {
            let config = ReflexConfig { score, ..ReflexConfig::default() };
            network_scores(&small, judge, [asked, None], &config).unwrap()
        };
        let warning = small.operating_score().unwrap().unwrap().score;
        let braking = small.braking_score().unwrap().unwrap().score;
        assert!(braking > warning, "{braking}, {warning}");
        let of = |sure, seen| CountsFrom { sure, seen };
        assert_eq!(scores(Judge::Network, None, 0.0), (of(braking, warning), true));
        assert_eq!(scores(Judge::Network, None, 0.6), (of(0.6, warning), true));
        assert_eq!(scores(Judge::Network, Some(0.1), 0.6), (of(0.1, 0.1), true));
        let partial_mps2 = 0.0;
        let config = ReflexConfig { partial_mps2, ..ReflexConfig::default() };
        let found = network_scores(&small, Judge::Network, [None; 2], &config).unwrap();
        assert_eq!(found, (of(braking, braking), true));
        // Its scores are not those of a rule.
        assert_eq!(scores(Judge::Zone, None, 0.0), (of(warning, warning), false));
        assert_eq!(scores(Judge::Zone, Some(0.8), 0.0), (of(0.8, warning), true));
    }
}
