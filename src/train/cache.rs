//! Unpacked pictures in memory: decoding and resizing one is the same work in every epoch.
//!
//! What does not fit the budget is unpacked anew each time; results do not depend on it.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use crate::model::{InputError, NetworkImage};

/// The sample that a picture belongs to, and whether it is mirrored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Key {
    pub sample_idx: usize,
    pub mirror: bool,
}

/// Pictures of the samples seen first, up to a number of bytes.
#[derive(Debug)]
pub struct Cache {
    budget_bytes: usize,
    contents: Mutex<Contents>,
}

#[derive(Debug, Default)]
struct Contents {
    pictures: HashMap<Key, NetworkImage>,
    n_bytes: usize,
}

impl Cache {
    #[must_use]
    pub fn new(budget_mib: usize) -> Self {
        Self { budget_bytes: budget_mib << 20, contents: Mutex::default() }
    }

    /// Copies a picture from memory, or makes it with `unpack` and keeps it if there is room.
    ///
    /// # Errors
    /// Those of `unpack`.
    pub fn get(
        &self,
        key: Key,
        unpack: impl FnOnce() -> Result<NetworkImage, InputError>,
    ) -> Result<NetworkImage, InputError> {
        let lock = || self.contents.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(picture) = lock().pictures.get(&key) {
            return Ok(picture.clone());
        }
        let picture = unpack()?;
        let n_bytes = picture.pixels.len();
        let mut contents = lock();
        if contents.n_bytes + n_bytes <= self.budget_bytes {
            contents.n_bytes += n_bytes;
            contents.pictures.insert(key, picture.clone());
        }
        Ok(picture)
    }

    /// The bytes that are kept.
    #[must_use]
    pub fn n_bytes(&self) -> usize {
        self.contents.lock().unwrap_or_else(PoisonError::into_inner).n_bytes
    }

    /// Keeps so much from now on; where there is more already, everything is forgotten.
    pub fn limit(&mut self, budget_bytes: usize) {
        self.budget_bytes = budget_bytes;
        if self.n_bytes() > budget_bytes {
            self.clear();
        }
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
    use crate::model::{Input, ModelConfig};
    use std::cell::Cell;

    #[test]
    fn a_picture_is_unpacked_once_while_there_is_room_and_each_time_where_there_is_none() {
        let data = test_data::dataset(1);
        let config = ModelConfig::default();
        let n_unpacked = Cell::new(0);
        let unpack = || {
            n_unpacked.set(n_unpacked.get() + 1);
            Input::picture(&data.samples()[0].measured, false, &config.camera)
        };
        let key = Key { sample_idx: 0, mirror: false };
        let roomy = Cache::new(64);
        let first = roomy.get(key, unpack).unwrap();
        assert_eq!(roomy.get(key, unpack).unwrap(), first);
        assert_eq!(n_unpacked.get(), 1);
        let none = Cache::new(0);
        assert_eq!((none.get(key, unpack).unwrap(), none.get(key, unpack).unwrap()), (first.clone(), first));
        assert_eq!(n_unpacked.get(), 3);
    }
}
