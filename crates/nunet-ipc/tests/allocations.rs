#![expect(unsafe_code, reason = "a global allocator that counts")]
//! What frames take from the heap once they run: nothing, but for one small piece of iceoryx2's own in each loan.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

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

/// Allocations of this thread while `work` runs.
fn allocations(work: impl FnOnce()) -> u64 {
    let before = ALLOCATIONS.get();
    work();
    ALLOCATIONS.get() - before
}

#[test]
fn a_loan_allocates_iceoryx2s_shared_state_and_nothing_else() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let _reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    publish_depth(&owner, 0); // connects
    // `ChunkMutSharedState` is an `Arc` around a mutex, made anew for every loan. When a later iceoryx2 does without,
    // this number falls to 0.
    assert_eq!(allocations(|| (0..100).for_each(|sequence| publish_depth(&owner, sequence))), 100);
}

#[test]
fn waking_does_not_allocate() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    owner.notify(Wake::Depth).unwrap(); // connects
    let work = || {
        owner.notify(Wake::Depth).unwrap();
        reader.wait(PATIENCE).unwrap();
    };
    assert_eq!(allocations(|| (0..100).for_each(|_| work())), 0);
}

#[test]
fn receiving_does_not_allocate() {
    let camera = camera();
    let owner = owner(&camera, &[Topic::Depth]);
    let mut reader = Reader::open(&camera, &[Topic::Depth], PATIENCE).unwrap();
    publish_depth(&owner, 0); // connects
    let received = (1..=100).map(|sequence| {
        publish_depth(&owner, sequence);
        allocations(|| assert!(reader.next_set().unwrap().is_some()))
    });
    assert_eq!(received.sum::<u64>(), 0);
}
