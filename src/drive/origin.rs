//! Who drives, and by what: known before the first drive, and refused there where it cannot drive.

use std::path::Path;

use super::perception::{network_scores, score_of_all};
use super::{DriveConfig, DriveError};
use crate::device::DeviceName;
use crate::episode::cpu;
use crate::eval::judge::Judge;
use crate::files::{sha256_hex, sha256_of};
use crate::geometry::{Box3, Point};
use crate::infer::Trained;
use crate::model::Classes;
use crate::object::{Detection, Harm};
use crate::outcome::{DRIVING, Origin, Source, Who};
use crate::sample::EgoState;
use crate::scene::{SceneSplit, car};
use crate::zone::Zone;

/// Who a driver is, with the hash of what it drives by, and the scores from which on its boxes count.
///
/// # Errors
/// There is no such run or device, or the network cannot be driven by in this way: better told now than by each drive.
pub(super) fn origin_of(who: &Who, config: &DriveConfig, device: DeviceName) -> Result<Origin, DriveError> {
    let reflex = &config.reflex;
    let (sha256, min_score, seen_from) = match &who.source {
        Source::Network { run, judge, score, warning } => {
            let trained = Trained::find(run)?;
            check_judge(who, *judge, &trained, config)?;
            device.open()?;
            let (scores, is_chosen) = network_scores(&trained, *judge, [*score, *warning], reflex)?;
            if !is_chosen {
                let message = unchosen(run, *judge, scores.sure);
                if config.world.scene.split == SceneSplit::Test {
                    return Err(DriveError::NoScore { name: who.name.clone(), message });
                }
                tracing::warn!("{}: {message}", who.name);
            }
            let own = trained.braking_score()?.filter(|own| own.score == scores.sure);
            if let Some(other) = own.and_then(|own| own.tell_other_period(config.world.sample_period_s)) {
                tracing::warn!("{}: {other}", who.name);
            }
            (trained.sha256()?, Some(scores.sure), (scores.seen < scores.sure).then_some(scores.seen))
        }
        Source::External { command } => {
            let files = command.split_whitespace().map(Path::new).filter(|path| path.is_file());
            let hashes = files.map(sha256_of).collect::<Result<Vec<_>, _>>()?;
            (sha256_hex(hashes.concat().as_bytes()), score_of_all(reflex), None)
        }
        Source::Blind | Source::Truth => (String::new(), None, None),
    };
    let generator_version = env!("CARGO_PKG_VERSION").to_owned();
    Ok(Origin {
        who: who.clone(),
        sha256,
        min_score,
        seen_from,
        generator_version,
        driving: DRIVING,
        device: device.to_string(),
        cpus: vec![cpu()],
    })
}

/// Refuses a judge that the network, or the zone, has nothing for.
fn check_judge(who: &Who, judge: Judge, trained: &Trained, config: &DriveConfig) -> Result<(), DriveError> {
    if judge.asks_the_network() && trained.config()?.head.classes == Classes::Kind {
        return Err(DriveError::TellsKinds { name: who.name.clone() });
    }
    let state = EgoState {
        speed_mps: 5.0,
        steering_angle_rad: 0.0,
        yaw_rate_rps: 0.0,
        acceleration_mps2: 0.0,
        wheelbase_m: car::WHEELBASE_M,
        front_bumper_x_m: car::FRONT_BUMPER_X_M,
    };
    let ahead = Detection {
        box_in_ego: Box3 {
            center: Point::new(10.0, 0.0, 1.0),
            length_m: 1.0,
            width_m: 1.0,
            height_m: 1.0,
            yaw_rad: 0.0,
        },
        velocity_in_ego_mps: [0.0; 2],
        harm: Harm::Harmful,
        score: 1.0,
        spread: None,
    };
    match judge.judge(&[ahead], &state, &Zone::try_from(config.zone.clone())?) {
        Ok(_) => Ok(()),
        Err(source) => {
            let (name, kind) = (who.name.clone(), config.zone.kind.name());
            Err(DriveError::NoJudge { name, judge: judge.name(), kind, source })
        }
    }
}

/// A driver at a score that nobody chose for it brakes as often as it happens to.
fn unchosen(run: &Path, judge: Judge, min_score: f64) -> String {
    let run = run.display();
    let (flag, prefix) = match judge {
        Judge::Network => (String::new(), String::new()),
        _ => (format!(" --judge {}", judge.name()), format!("{}:", judge.name())),
    };
    format!(
        "it brakes hard from a score of {min_score:.3}, which was not chosen for it; `harmzone calibrate {run}{flag} --data DIR` finds the \
         score for a number of false alarms a km, and {prefix}{run}@SCORE sets it"
    )
}
