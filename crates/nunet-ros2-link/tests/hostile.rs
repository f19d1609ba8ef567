//! Damaged datagrams and messages: an error, never a panic. libFuzzer runs the same functions.
#![cfg(feature = "ros2-dds")]

#[expect(unreachable_pub, reason = "the fuzz targets are another crate")]
#[path = "../../../fuzz/src/ros2.rs"]
mod body;

use nunet_mcap::ros::{Header, ImagePixels, RosMessage, Time};
use nunet_ros2_link::{DatagramProbe, submessages_read};
use nunet_testkit::hostile::{feed_damaged, keep_for_fuzzing};

const PARTICIPANT: [u8; 12] = [9; 12];
const WRITER: [u8; 4] = [0, 0, 0x12, 3];
const FRAGMENT_BYTES: u16 = 64;

const HEADER: [u8; 20] = *b"RTPS\x02\x04\x01\x0fabcdefghijkl";
const ENDPOINTS: [u8; 8] = [0, 0, 4, 0xc7, 0, 0, 4, 0xc2];
const ONE: [u8; 8] = [0, 0, 0, 0, 1, 0, 0, 0];

/// An image of 16x4 pixels.
fn message() -> Vec<u8> {
    let data: Vec<u8> = (0..3 * 16 * 4).collect();
    let image = ImagePixels { width: 16, height: 4, encoding: "rgb8", pixel_bytes: 3, data: &data };
    let header = Header { stamp: Time { sec: 1, nanosec: 2 }, frame_id: "eye".into() };
    let mut message = Vec::new();
    RosMessage::Image(image).encode(&header, &mut message).expect("a small message");
    message
}

fn datagram(id: u8, flags: u8, fields: &[u8], payload: &[u8]) -> Vec<u8> {
    let length = (fields.len() + payload.len()) as u16;
    [&b"RTPS\x02\x03\x01\x0f"[..], &PARTICIPANT, &[id, flags], &length.to_le_bytes(), fields, payload]
        .concat()
}

/// The message in one datagram, and in one for each fragment (DDSI-RTPS 2.5, sections 9.4.5.4 and 9.4.5.5).
fn datagrams() -> Vec<Vec<u8>> {
    let message = message();
    let fields = [&[0, 0, 16, 0, 0, 0, 0, 0][..], &WRITER, &[0, 0, 0, 0, 1, 0, 0, 0]].concat();
    let whole = datagram(0x15, 5, &fields, &message);
    let fragment = |(first, bytes): (u32, &[u8])| {
        let fields = [
            &[0, 0, 28, 0, 0, 0, 0, 0][..],
            &WRITER,
            &[0, 0, 0, 0, 2, 0, 0, 0],
            &first.to_le_bytes(),
            &[1, 0],
            &FRAGMENT_BYTES.to_le_bytes(),
            &(message.len() as u32).to_le_bytes(),
        ];
        datagram(0x16, 1, &fields.concat(), bytes)
    };
    let fragments = (1..).zip(message.chunks(FRAGMENT_BYTES.into())).map(fragment);
    std::iter::once(whole).chain(fragments).collect()
}

fn submessage(id: u8, flags: u8, body: &[&[u8]]) -> Vec<u8> {
    let body = body.concat();
    [&[id, flags], &(body.len() as u16).to_le_bytes()[..], &body].concat()
}

/// One of each kind.
fn all_kinds() -> Vec<u8> {
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

/// What the fuzz target reads: each after its length.
fn with_lengths(datagrams: &[Vec<u8>]) -> Vec<u8> {
    datagrams.iter().flat_map(|one| [&(one.len() as u16).to_le_bytes()[..], one].concat()).collect()
}

#[test]
fn whole_and_fragmented_messages_arrive_as_they_were_sent() {
    let probe = DatagramProbe::default();
    let arrived: Vec<_> = datagrams().iter().filter_map(|datagram| probe.put(datagram)).collect();
    assert_eq!(arrived, [message(), message()]);
}

#[test]
fn damaged_datagrams_are_ignored() {
    let bytes = with_lengths(&datagrams());
    keep_for_fuzzing("ros2_datagrams", "image", &bytes);
    feed_damaged("datagrams", &bytes, body::datagrams);
}

#[test]
fn damaged_submessages_are_refused_or_read_by_the_library() {
    assert_eq!(submessages_read(&all_kinds()), Some(9));
    let bytes = with_lengths(&[all_kinds()]);
    keep_for_fuzzing("ros2_datagrams", "all_kinds", &bytes);
    feed_damaged("submessages", &bytes, body::datagrams);
}

#[test]
fn damaged_messages_are_errors() {
    let bytes = message();
    keep_for_fuzzing("ros2_live_message", "image", &bytes);
    feed_damaged("message", &bytes, body::live_message);
}
