#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for an unsafe promise that a type may cross process boundaries"
)]
//! The unit that payloads are made of.

use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Bytes in a [`Block64`], and the alignment of every payload: a cache line, and the alignment of AVX-512
/// loads.
pub const BLOCK_BYTES: usize = 64;

/// 64 bytes, aligned to 64: a payload is a slice of `ceil(payload_bytes / 64)` of them.
///
/// A slice of plain `u8` would be aligned to 8 only, and `payload_alignment(64)` would pad every *element* to
/// 64 bytes; an element that is itself 64 bytes long gets the alignment without the waste.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Block64(pub [u8; BLOCK_BYTES]);

const _: () = assert!(size_of::<Block64>() == BLOCK_BYTES && align_of::<Block64>() == BLOCK_BYTES);

/// The name under which other languages know [`Block64`].
pub const BLOCK_TYPE_NAME: &str = "nunet.v1.Block64";

// SAFETY: `Block64` is `repr(C)`, holds nothing but bytes (no pointer, no reference, no handle, no `Drop`),
// has no padding (asserted above) and every bit pattern of it is valid, in any process. The derive cannot be
// used: its generated check panics on types with an explicit alignment.
unsafe impl ZeroCopySend for Block64 {
    unsafe fn type_name() -> &'static str {
        BLOCK_TYPE_NAME
    }
}

/// How many blocks hold this many bytes.
#[must_use]
pub const fn blocks_for(payload_bytes: usize) -> usize {
    payload_bytes.div_ceil(BLOCK_BYTES)
}
