//! Towns that the episodes of a process share.

use std::sync::{Arc, Mutex, PoisonError};

use super::{EpisodePlan, GenerateError};
use crate::scene::{PopulateConfig, Town, TownVariation};

/// Towns of a process's earlier episodes, the latest last.
static TOWNS: Mutex<Vec<(String, Arc<Town>)>> = Mutex::new(Vec::new());
/// As many towns are kept.
const MAX_TOWNS: usize = 8;

/// The town of an episode: its own, where it is built anew or on rolling land, else one that the episodes of a process share.
pub(super) fn town_of(plan: &EpisodePlan, scene: &PopulateConfig) -> Result<Arc<Town>, GenerateError> {
    let variation = scene.variation(plan.seed);
    if variation == TownVariation::default() {
        return shared_town(&plan.town);
    }
    Ok(Arc::new(Town::varied(&plan.town, variation)?))
}

/// A town by name or path, which is read once.
fn shared_town(name: &str) -> Result<Arc<Town>, GenerateError> {
    let mut towns = TOWNS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, town)) = towns.iter().find(|(known, _)| known == name) {
        return Ok(Arc::clone(town));
    }
    let town = Arc::new(Town::load(name)?);
    if towns.len() == MAX_TOWNS {
        towns.remove(0);
    }
    towns.push((name.to_owned(), Arc::clone(&town)));
    Ok(town)
}
