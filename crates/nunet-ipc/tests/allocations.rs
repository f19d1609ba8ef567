//! What frames take from the heap once they run: nothing, but for one small piece of iceoryx2's own in each
//! loan.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod support;

use nunet_ipc::{Reader, Topic, Wake};
use nunet_testkit::allocations::{CountingAllocator, allocations_during};
use support::{TIMEOUT, camera, publish_depth, publisher};

#[global_allocator]
static COUNTING: CountingAllocator = CountingAllocator;

#[test]
fn a_loan_allocates_iceoryx2s_shared_state_and_nothing_else() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let _reader = Reader::open(&camera, &[Topic::Depth], TIMEOUT).unwrap();
    publish_depth(&publisher, 0); // connects
    // `ChunkMutSharedState` is an `Arc` around a mutex, allocated for every loan. When a later iceoryx2 does
    // without, this number falls to 0.
    assert_eq!(allocations_during(|| (0..100).for_each(|sequence| publish_depth(&publisher, sequence))), 100);
}

#[test]
fn waking_does_not_allocate() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = Reader::open(&camera, &[Topic::Depth], TIMEOUT).unwrap();
    publisher.notify(Wake::Depth).unwrap(); // connects
    let work = || {
        publisher.notify(Wake::Depth).unwrap();
        reader.wait(TIMEOUT).unwrap();
    };
    assert_eq!(allocations_during(|| (0..100).for_each(|_| work())), 0);
}

#[test]
fn receiving_does_not_allocate() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let mut reader = Reader::open(&camera, &[Topic::Depth], TIMEOUT).unwrap();
    publish_depth(&publisher, 0); // connects
    let received = (1..=100).map(|sequence| {
        publish_depth(&publisher, sequence);
        allocations_during(|| assert!(reader.next_set().unwrap().is_some()))
    });
    assert_eq!(received.sum::<u64>(), 0);
}
