//! Counts heap allocations by thread, so that `allocations_per_frame` is measured and not claimed.
#![expect(unsafe_code, reason = "a global allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    // `const` and without a destructor: reading it never allocates, even while a thread ends.
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

/// The system's allocator, counting. A binary installs it with `#[global_allocator]`; memory that ONNX Runtime
/// takes by itself does not pass through here.
#[derive(Debug)]
pub struct CountingAllocator;

/// Allocations and growths made by the calling thread so far; 0 for ever where [`CountingAllocator`] is not
/// installed.
pub fn allocations_of_this_thread() -> u64 {
    COUNT.with(Cell::get)
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
