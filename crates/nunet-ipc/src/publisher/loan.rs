#![expect(
    unsafe_code,
    reason = "the chunk's bytes come from the kernel, which Rust cannot know to be initialized"
)]
//! A message that is being filled.

use std::mem::MaybeUninit;

use bytemuck::Pod;
use iceoryx2::sample_mut::SampleMut;
use iceoryx2::sample_mut_uninit::SampleMutUninit;
use nunet_types::Topic;

use crate::contract::{Block64, CONTRACT_VERSION, FrameHeader};
use crate::error::IpcError;
use crate::iceoryx::Iceoryx;

/// A chunk of shared memory on loan from a [`Publisher`](crate::Publisher): fill its header and its bytes,
/// then publish it. Dropping it returns it unpublished. `Send`: another thread may fill it.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<Iceoryx, [Block64], FrameHeader>,
    topic: Topic,
    payload_bytes: usize,
}

impl Loan {
    pub(crate) fn new(
        sample: SampleMutUninit<Iceoryx, [MaybeUninit<Block64>], FrameHeader>,
        topic: Topic,
        payload_bytes: usize,
    ) -> Self {
        // SAFETY: the chunk is memory that the kernel handed out as zeros (`prefault` had it backed by pages)
        // and that only whole `Block64`s were written to since; any bytes are a valid `Block64`.
        let mut sample = unsafe { sample.assume_init() };
        let header = sample.user_header_mut();
        header.set_topic(topic);
        header.payload_bytes = payload_bytes as u64;
        Self { sample, topic, payload_bytes }
    }

    /// The header. `topic`, `payload_bytes` and `contract_version` are set, and are set again when it is
    /// published; all other fields have the values of [`FrameHeader::default`].
    pub fn header_mut(&mut self) -> &mut FrameHeader {
        self.sample.user_header_mut()
    }

    /// The payload, aligned to 64 bytes, in shared memory: readers see the same memory. It still contains the
    /// bytes of an earlier frame.
    pub fn bytes_mut(&mut self) -> &mut [u8] {
        let bytes = bytemuck::cast_slice_mut::<Block64, u8>(self.sample.payload_mut());
        &mut bytes[..self.payload_bytes]
    }

    /// The payload as numbers.
    ///
    /// # Errors
    /// [`IpcError::WrongElement`] when it is not a whole number of them.
    pub fn slice_mut<T: Pod>(&mut self) -> Result<&mut [T], IpcError> {
        let payload_bytes = self.payload_bytes;
        bytemuck::try_cast_slice_mut(self.bytes_mut()).map_err(|_misfit| IpcError::WrongElement {
            element: std::any::type_name::<T>(),
            element_bytes: size_of::<T>(),
            payload_bytes,
        })
    }

    /// Sends the frame and returns how many readers received it. `publish_nanos`: now, in nanoseconds of
    /// `CLOCK_MONOTONIC`. It wakes no reader: call [`Publisher::notify`](crate::Publisher::notify) once for
    /// all topics of a frame.
    ///
    /// # Errors
    /// [`IpcError::CaptureTime`] if the header's `capture_nanos` is negative, [`IpcError::Iceoryx`].
    pub fn publish(mut self, publish_nanos: i64) -> Result<usize, IpcError> {
        let (topic, payload_bytes) = (self.topic, self.payload_bytes as u64);
        let header = self.sample.user_header_mut();
        check_capture_time(topic, header.capture_nanos)?;
        header.contract_version = CONTRACT_VERSION;
        header.set_topic(topic);
        header.payload_bytes = payload_bytes;
        header.publish_nanos = publish_nanos;
        self.sample.send().map_err(|cause| IpcError::iceoryx(format!("publish topic `{topic}`"), cause))
    }
}

/// Refuses a capture time before the zero of its clock, as [`Loan::publish`] does: for programs that know the
/// time before they fill an image.
///
/// # Errors
/// [`IpcError::CaptureTime`].
pub fn check_capture_time(topic: Topic, nanos: i64) -> Result<(), IpcError> {
    if nanos < 0 { Err(IpcError::CaptureTime { topic, nanos }) } else { Ok(()) }
}
