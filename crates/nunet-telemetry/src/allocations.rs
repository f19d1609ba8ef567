//! Counts heap allocations by thread, for `allocations_per_frame`.
#![expect(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    // `const` and without a destructor: reading it never allocates, even while a thread ends.
    static COUNT: Cell<u64> = const { Cell::new(0) };
    static FOREIGN: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting. A binary installs it with `#[global_allocator]`; allocations inside ONNX
/// Runtime are not counted.
#[derive(Debug)]
pub struct CountingAllocator;

/// Heap allocations and growths of one thread so far.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Allocations {
    /// Made by nunet's crates.
    pub own: u64,
    /// Made by a library within [`foreign_allocations`].
    pub foreign: u64,
}

/// The calling thread's allocations; always 0 if [`CountingAllocator`] is not installed.
pub fn allocations_of_this_thread() -> Allocations {
    Allocations { own: COUNT.with(Cell::get), foreign: FOREIGN.with(Cell::get) }
}

/// Runs `work` of a library and counts its allocations separately, because nunet cannot avoid them.
pub fn foreign_allocations<T>(work: impl FnOnce() -> T) -> T {
    let before = COUNT.with(Cell::get);
    let result = work();
    let made = COUNT.with(|count| count.replace(before)) - before;
    FOREIGN.with(|foreign| foreign.set(foreign.get() + made));
    result
}

fn count() {
    COUNT.with(|count| count.set(count.get() + 1));
}

// SAFETY: every call is passed on unchanged to the system's allocator, which keeps the trait's promises.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises about `layout` are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises about `layout` are passed on.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: `pointer` came from this allocator, that is from the system's, with `layout`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` came from this allocator, that is from the system's, with `layout`.
        unsafe { System.dealloc(pointer, layout) }
    }
}
