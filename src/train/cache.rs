//! Prepared inputs in memory: decoding a picture and sorting points into pillars is the same work in every epoch.
//!
//! What does not fit the budget is prepared anew each time; results do not depend on it.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use crate::model::{Input, InputError};

/// The sample that an input was prepared from, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Key {
    pub sample_idx: usize,
    pub mirror: bool,
    pub with_camera: bool,
}

/// Inputs of the samples seen first, up to a number of bytes.
#[derive(Debug)]
pub struct Cache {
    budget_bytes: usize,
    contents: Mutex<Contents>,
}

#[derive(Debug, Default)]
struct Contents {
    inputs: HashMap<Key, Input>,
    n_bytes: usize,
}

impl Cache {
    #[must_use]
    pub fn new(budget_mib: usize) -> Self {
        Self { budget_bytes: budget_mib << 20, contents: Mutex::default() }
    }

    /// Copies an input from memory, or makes it with `prepare` and keeps it if there is room.
    ///
    /// # Errors
    /// Those of `prepare`.
    pub fn get(
        &self,
        key: Key,
        prepare: impl FnOnce() -> Result<Input, InputError>,
    ) -> Result<Input, InputError> {
        let lock = || self.contents.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(input) = lock().inputs.get(&key) {
            return Ok(input.clone());
        }
        let input = prepare()?;
        let n_bytes = input.n_bytes();
        let mut contents = lock();
        if contents.n_bytes + n_bytes <= self.budget_bytes {
            contents.n_bytes += n_bytes;
            contents.inputs.insert(key, input.clone());
        }
        Ok(input)
    }

    /// Forgets everything, as between stages that need different inputs.
    pub fn clear(&self) {
        *self.contents.lock().unwrap_or_else(PoisonError::into_inner) = Contents::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::test_data;
    use crate::model::ModelConfig;
    use std::cell::Cell;

    #[test]
    fn an_input_is_prepared_once_while_there_is_room_and_each_time_where_there_is_none() {
        let data = test_data::dataset(1);
        let config = ModelConfig::default();
        let n_prepared = Cell::new(0);
        let prepare = || {
            n_prepared.set(n_prepared.get() + 1);
            Input::prepare(&data.samples()[0].measured, &config, false, true)
        };
        let key = Key { sample_idx: 0, mirror: false, with_camera: true };
        let roomy = Cache::new(64);
        let first = roomy.get(key, prepare).unwrap();
        assert_eq!(roomy.get(key, prepare).unwrap(), first);
        assert_eq!(n_prepared.get(), 1);
        let none = Cache::new(0);
        assert_eq!(
            (none.get(key, prepare).unwrap(), none.get(key, prepare).unwrap()),
            (first.clone(), first)
        );
        assert_eq!(n_prepared.get(), 3);
    }
}
