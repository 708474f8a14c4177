//! Outcomes for tests.

use super::{Collision, DRIVING, DriveOutcome, DriveSummary, End, Origin, Source, Who, compare};
use crate::episode::Split;
use crate::object::{Event, Spot};

fn outcome(episode: usize, impact_mps: Option<f64>) -> DriveOutcome {
    let collision = impact_mps.map(|impact_mps| Collision {
        time_s: 3.0,
        object: "hay_bale-001".into(),
        category: "hay_bale".into(),
        kind: None,
        distribution: None,
        event: Event::Lies,
        spot: Spot::Lane,
        is_background: false,
        impact_mps,
        relative_mps: Some(impact_mps),
        ego_mps: impact_mps,
        energy_j: 100.0,
        set_off_s: None,
        is_sudden: false,
        was_harmful: true,
    });
    DriveOutcome {
        episode: format!("e{episode}"),
        family: String::new(),
        seed: 1,
        town: "downtown".into(),
        weather: "ClearNoon".into(),
        end: if collision.is_some() { End::Collision } else { End::Time },
        duration_s: 30.0,
        distance_m: 100.0,
        free_m: 200.0,
        collision,
        struck_by: Vec::new(),
        hard_stops: Vec::new(),
        brakes: Vec::new(),
        first_brake_ttc_s: None,
        hardest_mps2: 0.0,
        rms_jerk_mps3: 0.0,
        n_samples: 100,
        entry: None,
    }
}

/// A driver's four drives, each with the speed at which it hits something, if it does.
pub fn drives(who: &str, impacts: [Option<f64>; 4]) -> (Who, Vec<DriveOutcome>) {
    (who.parse().unwrap(), impacts.into_iter().enumerate().map(|(i, impact)| outcome(i, impact)).collect())
}

/// What a command writes; networks have this hash.
pub fn summary(drives: &[(Who, Vec<DriveOutcome>)], sha256: &str) -> DriveSummary {
    let origin = |(who, _): &(Who, Vec<DriveOutcome>)| Origin {
        who: who.clone(),
        sha256: sha256.to_owned(),
        min_score: match who.source {
            Source::Network { score, .. } => score,
            _ => None,
        },
        seen_from: None,
        generator_version: "0.1.0".into(),
        driving: DRIVING,
        device: "cpu".into(),
        cpus: vec!["x86_64".into()],
    };
    DriveSummary {
        generator_version: "0.1.0".into(),
        config_sha256: "0".repeat(64),
        split: Split::Dev,
        ood: true,
        seed: 1,
        labels: "rect".into(),
        origins: drives.iter().map(origin).collect(),
        figures: compare(drives),
        outcomes: drives.iter().map(|(_, outcomes)| outcomes.clone()).collect(),
    }
}
