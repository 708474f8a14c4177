//! Things that take time to read, kept as long as they fit into so much memory; who asks for one that is being read waits
//! for that.

use std::collections::HashMap;
use std::fmt;
use std::hash::Hash;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::OnceCell;

/// What is kept; the longest unused goes first.
pub struct Shelf<K, V> {
    limit: usize,
    kept: Mutex<Kept<K, V>>,
}

struct Kept<K, V> {
    slots: HashMap<K, Slot<V>>,
    /// Counts the uses.
    now: u64,
}

struct Slot<V> {
    value: Arc<OnceCell<Arc<V>>>,
    /// 0 while it is being read.
    size: usize,
    last_use: u64,
}

impl<K: Clone + Eq + Hash, V> Shelf<K, V> {
    /// For things of this size together, in the unit of those who put them here.
    #[must_use]
    pub fn new(limit: usize) -> Self {
        Self { limit, kept: Mutex::new(Kept { slots: HashMap::new(), now: 0 }) }
    }

    /// A thing and its size, read if it is not here. What cannot be read is not kept.
    ///
    /// # Errors
    /// Those of `read`.
    pub async fn get_or_read<E, Read>(&self, key: K, read: Read) -> Result<Arc<V>, E>
    where
        Read: Future<Output = Result<(V, usize), E>>,
    {
        let slot = self.find(&key);
        let mut size_read = 0;
        let got = slot.get_or_try_init(|| async {
            let (value, size) = read.await?;
            size_read = size;
            Ok(Arc::new(value))
        });
        let got = got.await.cloned();
        drop(slot);
        self.settle(&key, size_read);
        got
    }

    fn find(&self, key: &K) -> Arc<OnceCell<Arc<V>>> {
        let mut kept = self.lock();
        kept.now += 1;
        let last_use = kept.now;
        let empty = || Slot { value: Arc::default(), size: 0, last_use };
        let slot = kept.slots.entry(key.clone()).or_insert_with(empty);
        slot.last_use = last_use;
        slot.value.clone()
    }

    /// Notes the size of what was read, and makes room.
    fn settle(&self, key: &K, size_read: usize) {
        let mut kept = self.lock();
        if let Some(slot) = kept.slots.get_mut(key).filter(|_| size_read > 0) {
            slot.size = size_read;
        }
        // What could not be read, and nobody waits for.
        kept.slots.retain(|_, slot| slot.value.initialized() || Arc::strong_count(&slot.value) > 1);
        let mut size: usize = kept.slots.values().map(|slot| slot.size).sum();
        while size > self.limit {
            let is_read = kept.slots.iter().filter(|(_, slot)| slot.size > 0);
            let oldest = is_read.min_by_key(|(_, slot)| slot.last_use).map(|(key, _)| key.clone());
            let Some(slot) = oldest.and_then(|oldest| kept.slots.remove(&oldest)) else { break };
            size -= slot.size;
        }
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Kept<K, V>> {
        self.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<K, V> fmt::Debug for Shelf<K, V> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shelf").field("limit", &self.limit).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;

    /// How many things are here or being read.
    fn n_kept<K: Clone + Eq + Hash, V>(shelf: &Shelf<K, V>) -> usize {
        shelf.lock().slots.len()
    }

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap()
    }

    #[test]
    fn the_longest_unused_makes_room_and_failures_are_not_kept() {
        runtime().block_on(async {
            let (shelf, n_reads) = (Shelf::<u8, u8>::new(10), AtomicUsize::new(0));
            let get = async |key: u8| {
                let read = async {
                    n_reads.fetch_add(1, Ordering::Relaxed);
                    if key == 9 { Err("broken") } else { Ok((key, 4)) }
                };
                shelf.get_or_read(key, read).await.map(|value| *value)
            };
            for key in [1, 2, 1, 3] {
                assert_eq!(get(key).await, Ok(key));
            }
            assert_eq!((n_reads.load(Ordering::Relaxed), n_kept(&shelf)), (3, 2));
            assert_eq!(get(1).await, Ok(1), "used later than 2");
            assert_eq!(n_reads.load(Ordering::Relaxed), 3);
            assert_eq!(get(2).await, Ok(2));
            assert_eq!(n_reads.load(Ordering::Relaxed), 4, "it had made room");
            assert_eq!((get(9).await, get(9).await), (Err("broken"), Err("broken")));
            assert_eq!((n_reads.load(Ordering::Relaxed), n_kept(&shelf)), (6, 2));
        });
    }

    #[test]
    fn who_asks_while_a_thing_is_read_waits_for_it_even_if_the_first_goes_away() {
        runtime().block_on(async {
            let (shelf, n_reads) = (Arc::new(Shelf::<u8, u8>::new(10)), Arc::new(AtomicUsize::new(0)));
            let ask = || {
                let (shelf, n_reads) = (shelf.clone(), n_reads.clone());
                let read = async move {
                    n_reads.fetch_add(1, Ordering::Relaxed);
                    tokio::time::sleep(std::time::Duration::from_millis(20)).await;
                    Ok::<_, ()>((7, 1))
                };
                tokio::spawn(async move { shelf.get_or_read(1, read).await })
            };
            let all: Vec<_> = (0..20).map(|_| ask()).collect();
            for one in all {
                assert_eq!(one.await.unwrap().map(|value| *value), Ok(7));
            }
            assert_eq!(n_reads.load(Ordering::Relaxed), 1);
            let (first, second) = (ask(), ask());
            first.abort();
            assert_eq!(second.await.unwrap().map(|value| *value), Ok(7));
        });
    }
}
