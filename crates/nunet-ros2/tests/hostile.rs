//! Damaged datagrams: refused or read, never a panic. libFuzzer runs the same function.
#![cfg(feature = "ros2-dds")]

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/rtps.rs"]
mod body;

use nunet_testkit::hostile::{feed_damaged, keep_for_fuzzing};

const HEADER: [u8; 20] = *b"RTPS\x02\x04\x01\x0fabcdefghijkl";
const ENDPOINTS: [u8; 8] = [0, 0, 4, 0xc7, 0, 0, 4, 0xc2];
const ONE: [u8; 8] = [0, 0, 0, 0, 1, 0, 0, 0];

fn submessage(id: u8, flags: u8, body: &[&[u8]]) -> Vec<u8> {
    let body = body.concat();
    [&[id, flags], &(body.len() as u16).to_le_bytes()[..], &body].concat()
}

/// One of each kind.
fn datagram() -> Vec<u8> {
    let set = [&[1, 0, 0, 0, 32, 0, 0, 0][..], &[0xff; 4], &[1, 0, 0, 0]].concat();
    let parameters =
        [&[0, 3, 0, 0][..], &[0x29, 0, 12, 0, 1, 0, 0, 0, 2, 0, 0, 0, b'*', 0, 0, 0], &[1, 0, 0, 0]];
    let inline = [0x71, 0, 4, 0, 0, 0, 0, 1, 1, 0, 0, 0];
    let parts = [
        submessage(0x0e, 1, &[&[0; 12]]),
        submessage(0x09, 1, &[&[0; 8]]),
        submessage(0x06, 1, &[&ENDPOINTS, &ONE, &[1, 0, 0, 0], &[0, 0, 0, 128], &[1, 0, 0, 0]]),
        submessage(0x07, 1, &[&ENDPOINTS, &ONE, &ONE, &[1, 0, 0, 0]]),
        submessage(0x08, 1, &[&ENDPOINTS, &ONE, &[0, 0, 0, 0, 9, 0, 0, 0], &[0; 4]]),
        submessage(0x12, 1, &[&ENDPOINTS, &ONE, &set]),
        submessage(0x13, 1, &[&ENDPOINTS, &ONE, &[2, 0, 0, 0, 1, 0, 0, 0]]),
        submessage(
            0x16,
            1,
            &[&[0, 0, 28, 0], &ENDPOINTS, &ONE, &[1, 0, 0, 0, 1, 0, 4, 0, 8, 0, 0, 0], b"abcd"],
        ),
        submessage(0x15, 7, &[&[0, 0, 16, 0], &ENDPOINTS, &ONE, &inline, &parameters.concat()]),
    ];
    [&HEADER[..], &parts.concat()].concat()
}

#[test]
fn damaged_datagrams_are_refused_or_read() {
    let bytes = datagram();
    assert_eq!(nunet_ros2::submessages_read(&bytes), Some(9));
    keep_for_fuzzing("rtps", "all_kinds", &bytes);
    feed_damaged("datagram", &bytes, body::rtps);
}
