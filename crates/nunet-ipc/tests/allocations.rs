#![expect(unsafe_code, reason = "a global allocator that counts")]
//! Loan, fill, publish, wake, receive and drop take nothing from the heap once they run.

#![allow(
    clippy::unwrap_used,
    reason = "a test may stop at the first thing that is wrong"
)]

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use nunet_ipc::{Reader, Topic, Wake};
use support::{PATIENCE, camera, owner, publish_depth};

struct Counting;

thread_local! {
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: every call goes on to the system's allocator unchanged; counting touches a thread-local `Cell` without a
// destructor, which itself does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations of this thread in 100 frames.
fn allocations_in_100_frames(mut frame: impl FnMut()) -> u64 {
    frame(); // connects
    let before = ALLOCATIONS.get();
    (0..100).for_each(|_| frame());
    ALLOCATIONS.get() - before
}

#[test]
fn publishing_does_not_allocate() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let _reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    let allocations = allocations_in_100_frames(|| publish_depth(&owner, 1));
    assert_eq!(allocations, 0);
}

#[test]
fn waking_does_not_allocate() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    let allocations = allocations_in_100_frames(|| {
        owner.notify(Wake::Depth).unwrap();
        reader.wait(PATIENCE).unwrap();
    });
    assert_eq!(allocations, 0);
}

#[test]
fn receiving_does_not_allocate() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let mut reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    let allocations = allocations_in_100_frames(|| {
        publish_depth(&owner, 1);
        assert!(reader.next_set().unwrap().is_some());
    });
    assert_eq!(allocations, 0);
}
