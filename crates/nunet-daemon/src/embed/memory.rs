//! Memory of results, used again once the host lets go of it: a fresh page costs more than what is written into it.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

/// How many pieces wait for their next use; what comes back beyond them is freed.
const KEPT: usize = 4;

/// Where pieces wait.
type Shelf<T> = Arc<Mutex<Vec<Vec<T>>>>;

/// A host's results of one kind.
#[derive(Debug, Default)]
pub(super) struct Pool<T>(Shelf<T>);

/// Numbers that go back to their pool in the end, also after the model is gone.
#[derive(Debug)]
pub struct Recycled<T> {
    values: Vec<T>,
    shelf: Shelf<T>,
}

impl<T: Copy + Default> Pool<T> {
    /// `count` numbers, which may be those of an older result: to be written before they are read.
    pub(super) fn take(&self, count: usize) -> Recycled<T> {
        let mut values = lock(&self.0).pop().unwrap_or_default();
        values.resize(count, T::default());
        Recycled { values, shelf: Arc::clone(&self.0) }
    }
}

impl<T> Deref for Recycled<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values
    }
}

impl<T> DerefMut for Recycled<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values
    }
}

impl<T> Drop for Recycled<T> {
    fn drop(&mut self) {
        let mut shelf = lock(&self.shelf);
        if shelf.len() < KEPT {
            shelf.push(std::mem::take(&mut self.values));
        }
    }
}

/// A panic while it was held left a whole list.
fn lock<T>(shelf: &Shelf<T>) -> std::sync::MutexGuard<'_, Vec<Vec<T>>> {
    shelf.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn memory_comes_back_and_is_never_shared() {
        let pool = Pool::<f32>::default();
        let (first, second) = (pool.take(8), pool.take(8));
        let (one, other) = (first.as_ptr(), second.as_ptr());
        assert_ne!(one, other);
        drop(first);
        assert_eq!(pool.take(8).as_ptr(), one);
        assert_eq!(pool.take(4).len(), 4, "of another size");
        drop((second, pool));
    }

    #[test]
    fn only_some_pieces_wait() {
        let pool = Pool::<u8>::default();
        let pieces: Vec<_> = (0..3 * KEPT).map(|_| pool.take(16)).collect();
        drop(pieces);
        assert_eq!(lock(&pool.0).len(), KEPT);
    }
}
