#![expect(unsafe_code, reason = "asks the kernel to back a range of our own mapping with pages")]
//! Backs every chunk with memory before the first frame needs it.

use std::mem::MaybeUninit;

use iceoryx2::port::publisher::Publisher as IoxPublisher;
use rustix::io::Errno;
use rustix::mm::{Advice, madvise};

use crate::contract::{Block64, FrameHeader, blocks_for};
use crate::error::IpcError;
use crate::iceoryx::Iceoryx;
use crate::plan::TopicPlan;

/// Loans every chunk, backs it with pages, and returns all of them.
///
/// The first write to a fresh 1.2 MB chunk takes milliseconds, and where `/dev/shm` is full it kills the
/// process (SIGBUS). Here both happen at the start, and the second is an error.
pub(crate) fn every_chunk(
    port: &IoxPublisher<Iceoryx, [Block64], FrameHeader>,
    plan: TopicPlan,
    chunks: usize,
) -> Result<(), IpcError> {
    let mut loans = Vec::with_capacity(chunks);
    for _ in 0..chunks {
        let mut loan = port.loan_slice_uninit(blocks_for(plan.payload_bytes)).map_err(|cause| {
            IpcError::iceoryx(format!("prefault the chunks of topic `{}`", plan.topic), cause)
        })?;
        populate(loan.payload_mut())
            .map_err(|errno| IpcError::MemoryNotBacked { topic: plan.topic, source: errno.into() })?;
        loans.push(loan);
    }
    Ok(())
}

/// Backs the pages of a payload. Rounding outwards to whole pages stays inside of the segment's mapping,
/// which begins and ends at page boundaries; the rest of these pages holds the neighboring chunks and their
/// headers.
fn populate(payload: &mut [MaybeUninit<Block64>]) -> Result<(), Errno> {
    let page = rustix::param::page_size();
    let range = payload.as_mut_ptr_range();
    let start = range.start.map_addr(|address| address - address % page);
    let bytes = range.end.addr().next_multiple_of(page) - start.addr();
    // SAFETY: `LinuxPopulateWrite` reads and writes no byte of the range (it faults its pages in as a write
    // would), and the range lies within the mapping that `payload` borrows from.
    match unsafe { madvise(start.cast(), bytes, Advice::LinuxPopulateWrite) } {
        Err(Errno::INVAL) => {
            payload.fill(MaybeUninit::new(Block64([0; 64]))); // Linux before 5.14
            Ok(())
        }
        result => result,
    }
}
