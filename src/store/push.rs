//! Puts what was made here: data first, then what names it, so that whoever reads meanwhile finds the old whole or the new.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use futures_util::{StreamExt, TryStreamExt, stream};

use super::bucket::{Content, Expected, Remote, runtime};
use super::error::StoreError;
use super::known::{self, Found};
use super::mirror::{AT_ONCE, Mirror, is_lazy, is_partial};
use crate::files::sha256_of;

/// Files that say that others are whole, the last of all last.
const TOLD_BY: [&[&str]; 3] = [
    // Of a training's state, a label set's part, boxes, scores.
    &["position.json", "part.json", "predictions.json", "metrics.json"],
    &["labels.json", "model.safetensors"],
    &["dataset.json"],
];

/// From this rank on a file says that all of its folder is whole and of its config.
const WHOLE_RANK: usize = 3;

/// By these a stage knows that it may go on with what another call has left.
const CONFIGS: [&str; 4] = ["gen.toml", "import.toml", "train.toml", "data.json"];

/// Files of a lower rank are put before those of a higher.
fn rank(name: &str) -> usize {
    if is_lazy(name) {
        return 0;
    }
    let file = name.rsplit('/').next().unwrap_or_default();
    // A state's network is a part of it, of which `position.json` tells.
    if name.starts_with("state/") && file == "model.safetensors" {
        return 1;
    }
    TOLD_BY.iter().position(|files| files.contains(&file)).map_or(1, |at| 2 + at)
}

impl Mirror {
    /// Puts all files that are new or changed, then deletes objects whose files were deleted here.
    pub(super) fn push(&self) -> Result<(), StoreError> {
        let _one_at_a_time = self.is_pushing.lock().expect("no thread panics with it");
        let files = known::walk(&self.root)?;
        let mut by_rank: BTreeMap<usize, Vec<String>> = BTreeMap::new();
        for (name, found) in files.iter().filter(|(name, _)| !is_partial(name)) {
            if !self.is_current(name, found) {
                by_rank.entry(rank(name)).or_default().push(name.clone());
            }
        }
        if let Some(data) = by_rank.get(&0) {
            self.withdraw_what_tells(data)?;
        }
        let mut gone: Vec<String> = {
            let remote = self.remote.lock().expect("no thread panics with it");
            let is_gone = |name: &&String| !is_lazy(name) && !files.contains_key(name.as_str());
            remote.keys().filter(is_gone).cloned().collect()
        };
        // What tells of others goes before them.
        gone.sort_by_key(|name| Reverse(rank(name)));
        // What another config has left would be taken for that of the new one.
        let is_other = self.has_other_config(by_rank.get(&1).map_or(&[], Vec::as_slice))?;
        for name in gone.iter().filter(|name| is_other || rank(name) >= WHOLE_RANK) {
            self.delete(name)?;
        }
        for names in by_rank.values() {
            let puts = stream::iter(names).map(|name| self.put(name)).buffer_unordered(AT_ONCE);
            runtime().block_on(puts.try_collect::<()>())?;
        }
        let doomed = std::mem::take(&mut *self.doomed.lock().expect("no thread panics with it"));
        let is_there = |name: &str| self.remote.lock().expect("no thread panics with it").contains_key(name);
        for name in gone.iter().chain(&doomed).filter(|name| !files.contains_key(name.as_str())) {
            if is_there(name) {
                self.delete(name)?;
            }
        }
        Ok(())
    }

    /// Whether one of these files is a config, and another one lies remotely.
    fn has_other_config(&self, names: &[String]) -> Result<bool, StoreError> {
        let remote = self.remote.lock().expect("no thread panics with it").clone();
        let is_there = |name: &&String| CONFIGS.contains(&name.as_str()) && remote.contains_key(*name);
        for name in names.iter().filter(is_there) {
            let found = runtime().block_on(self.bucket.look_up(name))?;
            if let Some(found) = found
                && found.sha256 != Some(sha256_of(&self.root.join(name))?)
            {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Puts one file.
    pub(super) fn push_file(&self, name: &str) -> Result<(), StoreError> {
        match Found::at(&self.root.join(name)) {
            Ok(found) if self.is_current(name, &found) => Ok(()),
            _ => runtime().block_on(self.put(name)),
        }
    }

    /// Where data changes under its name, as labels made anew do, what tells of it goes first.
    fn withdraw_what_tells(&self, data: &[String]) -> Result<(), StoreError> {
        let remote = self.remote.lock().expect("no thread panics with it").clone();
        let mut tellers = BTreeSet::new();
        for name in data.iter().filter(|name| remote.contains_key(name.as_str())) {
            let there = runtime().block_on(self.bucket.look_up(name))?.and_then(|there| there.sha256);
            if there == Some(sha256_of(&self.root.join(name))?) {
                continue;
            }
            let folder = Path::new(name).parent().unwrap_or(Path::new(""));
            let beside = TOLD_BY.iter().flat_map(|files| files.iter()).map(|file| folder.join(file));
            for teller in beside.map(|path| path.to_string_lossy().into_owned()) {
                if remote.contains_key(&teller) {
                    tellers.insert(teller);
                }
            }
        }
        for teller in tellers {
            let found = runtime().block_on(self.bucket.look_up(&teller))?;
            if found.and_then(|found| found.e_tag) != remote[&teller].e_tag {
                return Err(StoreError::Changed { url: self.bucket.url_of(&teller) });
            }
            self.delete(&teller)?;
        }
        Ok(())
    }

    async fn put(&self, name: &str) -> Result<(), StoreError> {
        let file = self.root.join(name);
        let (size, sha256) = (fs_err::metadata(&file)?.len(), sha256_of(&file)?);
        let before: Option<Remote> = self.remote.lock().expect("no thread panics with it").get(name).cloned();
        let expected = before.map_or(Expected::Nothing, Expected::This);
        let content = Content { file: &file, size, sha256: &sha256 };
        if let Expected::This(remote) = &expected
            && remote.sha256.as_deref() == Some(sha256.as_str())
        {
            return self.note(name, remote);
        }
        // Episodes never change once written; but those of an earlier call may be what nothing names, or to be replaced.
        let is_episode = name.starts_with("episodes/") && is_lazy(name);
        let is_old = self.listed.lock().expect("no thread panics with it").contains(name);
        let expected = if is_episode && !is_old { Expected::Nothing } else { expected };
        let remote = self.bucket.put(name, content, &expected).await?;
        self.listed.lock().expect("no thread panics with it").remove(name);
        self.note(name, &remote)
    }

    fn delete(&self, name: &str) -> Result<(), StoreError> {
        runtime().block_on(self.bucket.delete(name))?;
        self.remote.lock().expect("no thread panics with it").remove(name);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::rank;

    #[test]
    fn what_tells_of_others_goes_after_them_and_the_data_set_last() {
        let in_order = [
            "episodes/a.mcap",
            "gen.toml",
            "state/step-1/position.json",
            "labels/rect/labels.json",
            "dataset.json",
        ];
        assert!(in_order.is_sorted_by(|a, b| rank(a) < rank(b)));
        assert!(rank("state/step-1/model.safetensors") < rank("state/step-1/position.json"));
        assert!(rank("log.csv") < rank("model.safetensors"));
    }
}
