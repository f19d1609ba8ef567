//! Counts heap allocations of a thread, for tests that assert there are none.
#![expect(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    // `const` and without a destructor: counting itself never allocates.
    static COUNT: Cell<u64> = const { Cell::new(0) };
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

/// The system's allocator with a counter. A test binary installs it with `#[global_allocator]`. Allocations
/// of C and C++ libraries are not counted.
#[derive(Debug)]
pub struct CountingAllocator;

/// Allocations of the calling thread while `work` runs; 0 if [`CountingAllocator`] is not installed.
pub fn allocations_during(work: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    work();
    COUNT.get() - before
}

/// Bytes of the largest single allocation of the calling thread while `work` runs; 0 where
/// [`CountingAllocator`] is not installed.
pub fn largest_allocation_during(work: impl FnOnce()) -> usize {
    LARGEST.set(0);
    work();
    LARGEST.get()
}

// SAFETY: every call is passed on unchanged to the system's allocator, which keeps the trait's promises. The
// other methods of the trait end in these two.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.set(COUNT.get() + 1);
        LARGEST.set(LARGEST.get().max(layout.size()));
        // SAFETY: the caller's promises about `layout` are passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` came from `alloc` above, that is from the system, with `layout`.
        unsafe { System.dealloc(pointer, layout) }
    }
}
