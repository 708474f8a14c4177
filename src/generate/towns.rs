//! Towns that the episodes of a process share.

use std::sync::{Arc, Mutex, PoisonError};

use super::{EpisodePlan, GenerateError};
use crate::scene::{PopulateConfig, Town};

/// Towns of a process's earlier episodes, the latest last.
static TOWNS: Mutex<Vec<(String, Arc<Town>)>> = Mutex::new(Vec::new());
/// As many towns are kept.
const MAX_TOWNS: usize = 8;

/// The town of an episode: its own, where it is built anew, else one that the episodes of a process share.
pub(super) fn town_of(plan: &EpisodePlan, scene: &PopulateConfig) -> Result<Arc<Town>, GenerateError> {
    if scene.rebuilds(plan.seed) {
        return Ok(Arc::new(Town::rebuilt(&plan.town, plan.seed)?));
    }
    shared_town(&plan.town)
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
