//! What belongs to one process, and is made anew in a forked one.

use std::sync::{Arc, Mutex};

/// A value that needs threads. None of them lives on in a forked process, so that makes a value of its own. It never drops
/// the one of its parent, which could wait for the threads.
pub(super) struct OfProcess<T: ?Sized>(Mutex<Option<(u32, Arc<T>)>>);

impl<T: ?Sized> OfProcess<T> {
    /// `made`: a value and the process that made it.
    pub(super) const fn new(made: Option<(u32, Arc<T>)>) -> Self {
        Self(Mutex::new(made))
    }

    pub(super) fn get<E>(&self, make: impl FnOnce() -> Result<Arc<T>, E>) -> Result<Arc<T>, E> {
        let (mut kept, here) = (self.0.lock().expect("no thread panics with it"), std::process::id());
        if let Some((_, value)) = kept.as_ref().filter(|(maker, _)| *maker == here) {
            return Ok(Arc::clone(value));
        }
        let made = make()?;
        std::mem::forget(kept.replace((here, Arc::clone(&made))));
        Ok(made)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_forked_process_makes_its_own_value_and_keeps_it_beside_its_parents() {
        let of_parent = Arc::new("parent's");
        let kept = OfProcess::new(Some((std::process::id().wrapping_add(1), Arc::clone(&of_parent))));
        assert!(kept.get(|| Err("no connection")).is_err());
        assert_eq!(*kept.get(|| Ok::<_, ()>(Arc::new("own"))).unwrap(), "own");
        assert_eq!(*kept.get(|| Err("it is made already")).unwrap(), "own");
        drop(kept);
        assert_eq!(Arc::strong_count(&of_parent), 2, "it was not dropped");
    }
}
