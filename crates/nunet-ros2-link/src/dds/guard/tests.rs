use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use dust_dds::dds_async::configuration::DustDdsConfigurationBuilder;
use dust_dds::dds_async::domain_participant_factory::DomainParticipantFactoryAsync;
use dust_dds::domain::domain_participant::DomainParticipant;
use dust_dds::domain::domain_participant_factory::DomainParticipantFactory;
use dust_dds::infrastructure::listener::NO_LISTENER;
use dust_dds::infrastructure::qos::QosKind;
use dust_dds::infrastructure::status::NO_STATUS;
use dust_dds::std_runtime::StdRuntime;
use dust_dds::std_runtime::executor::block_on;
use dust_dds::transport::interface::{
    RtpsTransportParticipant, TransportDataReceiver, TransportParticipantFactory, WriteMessage,
};
use nunet_testkit::hostile::damaged;

use super::super::raw_message::RawMessage;
use super::super::rtps::{Prefix, departure_of};
use super::*;

const PEER: Prefix = [9; 12];
/// Copies of each datagram that the library gets.
const COPIES: u8 = 25;
const TIMEOUT: Duration = Duration::from_secs(20);

fn datagram(peer: Prefix, parts: &[Vec<u8>]) -> Vec<u8> {
    [&b"RTPS\x02\x04\x01\x0f"[..], &peer, &parts.concat()].concat()
}

fn submessage(id: u8, flags: u8, body: &[&[u8]]) -> Vec<u8> {
    let body = body.concat();
    [&[id, flags], &(body.len() as u16).to_le_bytes()[..], &body].concat()
}

fn data(writer: u8, sequence: u8, parameters: &[&[u8]]) -> Vec<u8> {
    let kind = if writer == 1 { [0, 1, 0] } else { [0, 0, writer] };
    let head =
        [&[0, 0, 16, 0][..], &kind, &[0xc7], &kind, &[0xc2], &[0, 0, 0, 0, sequence, 0, 0, 0], &[0, 3, 0, 0]];
    submessage(DATA, 5, &[&head.concat(), &parameters.concat(), &[1, 0, 0, 0]])
}

fn participant(peer: Prefix) -> Vec<u8> {
    let locator = [&[1, 0, 0, 0, 0xf2, 0x1c, 0, 0][..], &[0; 12], &[127, 0, 0, 1]].concat();
    let parameters = [
        &[0x15, 0, 4, 0, 2, 4, 0, 0, 0x16, 0, 4, 0, 1, 15, 0, 0][..],
        &[0x50, 0, 16, 0],
        &peer,
        &[0, 0, 1, 0xc1],
        &[0x32, 0, 24, 0],
        &locator,
        &[0x31, 0, 24, 0],
        &locator,
        &[0x02, 0, 8, 0, 100, 0, 0, 0, 0, 0, 0, 0],
        &[0x58, 0, 4, 0, 0x3f, 0x0c, 0, 0],
        &[0x2c, 0, 8, 0, 4, 0, 0, 0, b'a', b'=', b'b', b';'],
        &[0x14, 0x40, 8, 0, 1, 0, 0, 0, 0, 0, 0, 0],
    ];
    datagram(peer, &[submessage(INFO_TIMESTAMP, 1, &[&[0; 8]]), data(1, 1, &parameters)])
}

/// As Fast DDS announces a reader.
fn reader(peer: Prefix) -> Vec<u8> {
    let parameters = [
        &[0x5a, 0, 16, 0][..],
        &peer,
        &[0, 0, 18, 4],
        &[0x05, 0, 8, 0, 4, 0, 0, 0, b'r', b't', b'a', 0],
        &[0x07, 0, 8, 0, 2, 0, 0, 0, b'T', 0, 0, 0],
        &[0x23, 0, 8, 0, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff],
        &[0x75, 0, 4, 0, 1, 2, 3, 4],
        &[0x1b, 0, 12, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 0, 0, 0],
        &[0x1a, 0, 12, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        &[0x1d, 0, 4, 0, 0, 0, 0, 0],
        &[0x29, 0, 12, 0, 1, 0, 0, 0, 2, 0, 0, 0, b'*', 0, 0, 0],
        &[0x73, 0, 8, 0, 1, 0, 0, 0, 0, 0, 0, 0],
    ];
    datagram(peer, &[submessage(INFO_DESTINATION, 1, &[&[0; 12]]), data(4, 1, &parameters)])
}

const ENDPOINTS: [u8; 8] = [0, 0, 4, 0xc7, 0, 0, 4, 0xc2];

fn others(peer: Prefix) -> [Vec<u8>; 6] {
    let one = [0, 0, 0, 0, 1, 0, 0, 0];
    let fragment = [&[0, 0, 28, 0][..], &ENDPOINTS, &one, &[1, 0, 0, 0, 1, 0, 4, 0, 8, 0, 0, 0], b"abcd"];
    [
        datagram(
            peer,
            &[submessage(HEARTBEAT, 1, &[&ENDPOINTS, &one, &[0, 0, 0, 0, 3, 0, 0, 0], &[1, 0, 0, 0]])],
        ),
        datagram(
            peer,
            &[submessage(ACKNACK, 1, &[&ENDPOINTS, &one, &[1, 0, 0, 0], &[0, 0, 0, 128], &[1, 0, 0, 0]])],
        ),
        datagram(peer, &[nack_frag(32)]),
        datagram(peer, &[submessage(GAP, 1, &[&ENDPOINTS, &one, &[0, 0, 0, 0, 9, 0, 0, 0], &[0; 4]])]),
        datagram(peer, &[submessage(DATA_FRAG, 1, &fragment)]),
        datagram(peer, &[submessage(HEARTBEAT_FRAG, 1, &[&ENDPOINTS, &one, &[2, 0, 0, 0, 1, 0, 0, 0]])]),
    ]
}

fn nack_frag(bits: u32) -> Vec<u8> {
    let set =
        [&[1, 0, 0, 0][..], &bits.to_le_bytes(), &vec![0xff; bits.div_ceil(32) as usize * 4], &[1, 0, 0, 0]];
    submessage(NACK_FRAG, 1, &[&ENDPOINTS, &[0, 0, 0, 0, 1, 0, 0, 0], &set.concat()])
}

#[test]
fn what_the_library_misunderstands_is_hidden_and_nothing_else() {
    let (before, mut after) = (reader(PEER), reader(PEER));
    hide_misunderstood(&mut after);
    let changed: Vec<_> = (0..before.len()).filter(|&at| before[at] != after[at]).collect();
    let parameters: Vec<_> = changed.iter().map(|&at| (before[at - 1], after[at])).collect();
    assert_eq!(parameters, [(0x23, 0x80), (0x75, 0x80)], "not a finite liveliness: {changed:?}");
}

/// Also of a participant that another announcement precedes.
#[test]
fn of_participants_the_library_sees_the_endpoints_that_the_transport_carries() {
    let mut sent = [reader(PEER), participant(PEER).split_off(HEADER_BYTES)].concat();
    let place = sent.windows(4).position(|bytes| bytes == [0x58, 0, 4, 0]).unwrap() + 4;
    assert_eq!(sent[place..place + 4], [0x3f, 0x0c, 0, 0]);
    hide_misunderstood(&mut sent);
    assert_eq!(sent[place..place + 4], [0x3f, 0, 0, 0]);
}

#[test]
fn what_ros_sends_gets_through() {
    for sent in [participant(PEER), reader(PEER)].iter().chain(&others(PEER)) {
        assert!(submessages_read(sent).is_some(), "{sent:02x?}");
    }
    let vendor = datagram(PEER, &[submessage(0x80, 1, &[&[0; 4]]), submessage(PAD, 0, &[])]);
    assert_eq!(submessages_read(&vendor), Some(1));
}

/// Each of them ended the library's thread, made it loop, or ended the process for want of memory.
#[test]
fn what_the_library_panics_at_is_refused() {
    let reply = submessage(0x0f, 1, &[&[0; 4]]);
    let announcing = |parameter: &[u8]| datagram(PEER, &[data(1, 1, &[parameter])]);
    for refused in [
        datagram(PEER, &[nack_frag(257)]),
        datagram(PEER, std::slice::from_ref(&reply)),
        datagram(PEER, &[vec![0x80, 1, 0, 0], reply.clone()]),
        datagram(PEER, &[vec![DATA, 5, 0, 0], reply]),
        announcing(&[0x29, 0, 8, 0, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]),
        announcing(&[0x73, 0, 8, 0, 0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0]),
        announcing(&[0x14, 0x40, 4, 0, 0, 0, 0, 0]),
        datagram(PEER, &[submessage(HEARTBEAT, 1, &[&ENDPOINTS, &[0xff; 16], &[0; 4]])]),
    ] {
        assert!(!is_acceptable(&refused), "{refused:02x?}");
    }
}

#[test]
fn a_gap_of_any_length_is_one_message_for_the_library() {
    let far = [0, 0, 0, 0x20, 5, 0, 0, 0];
    let mut gap =
        datagram(PEER, &[submessage(GAP, 1, &[&ENDPOINTS, &[0, 0, 0, 0, 1, 0, 0, 0], &far, &[0; 4]])]);
    assert!(is_acceptable(&gap));
    hide_misunderstood(&mut gap);
    assert_eq!(gap[32..48], [[0, 0, 0, 0x20, 4, 0, 0, 0], far].concat());
}

#[test]
fn messages_of_topics_are_hidden_and_lengths_stated() {
    let mut message = data(0x12, 1, &[]);
    message[2] = 0; // up to the end
    let mut sent = datagram(PEER, &[message.clone()]);
    hide_misunderstood(&mut sent);
    assert_eq!(sent[20..24], [PAD, 5, (message.len() - 4) as u8, 0]);
}

/// Gives its receiver away and sends nothing.
struct NoNetwork(Arc<Mutex<Option<TransportDataReceiver>>>);

impl TransportParticipantFactory for NoNetwork {
    fn create_participant(&self, _domain: i32, receiver: TransportDataReceiver) -> RtpsTransportParticipant {
        *self.0.lock().unwrap() = Some(receiver);
        RtpsTransportParticipant {
            message_writer: Box::new(NoWriter(vec![0; 65_507])),
            default_unicast_locator_list: Vec::new(),
            metatraffic_unicast_locator_list: Vec::new(),
            metatraffic_multicast_locator_list: Vec::new(),
            default_multicast_locator_list: Vec::new(),
            fragment_size: 16_000,
        }
    }
}

struct NoWriter(Vec<u8>);

impl WriteMessage for NoWriter {
    fn write_buffer_mut(&mut self) -> &mut [u8] {
        &mut self.0
    }

    fn write_message(&mut self, _length: usize, _locators: &[dust_dds::transport::types::Locator]) {}
}

/// A participant with a publisher of `/a`, and its side of the transport.
fn library() -> (DomainParticipant, TransportDataReceiver) {
    let receiver = Arc::default();
    let configuration = DustDdsConfigurationBuilder::new().enable_type_information(false).build().unwrap();
    let transport = NoNetwork(Arc::clone(&receiver));
    let factory =
        DomainParticipantFactoryAsync::new(StdRuntime::new(), [1; 4], [2; 4], transport, configuration);
    let factory = DomainParticipantFactory::new(Box::leak(Box::new(factory)));
    let participant = factory.create_participant(0, QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let publisher = participant.create_publisher(QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let topic =
        participant.create_topic::<RawMessage>("rta", "T", QosKind::Default, NO_LISTENER, NO_STATUS).unwrap();
    let writer = publisher.create_datawriter::<RawMessage>(&topic, QosKind::Default, NO_LISTENER, NO_STATUS);
    writer.unwrap().write(RawMessage(vec![1; 100]), None).unwrap();
    let receiver = receiver.lock().unwrap().take().unwrap();
    (participant, receiver)
}

fn discovered(participant: &DomainParticipant) -> Option<usize> {
    let (participant, (answer, answered)) = (participant.clone(), channel());
    std::thread::spawn(move || answer.send(participant.get_discovered_participants().unwrap().len()));
    answered.recv_timeout(TIMEOUT).ok()
}

/// The library continues after every datagram. Each copy comes from another participant, so that its state is
/// new.
#[test]
fn the_library_survives_damaged_datagrams() {
    let (own, receiver) = library();
    let give = |bytes: &[u8]| {
        if is_acceptable(bytes) {
            let mut bytes = bytes.to_vec();
            hide_misunderstood(&mut bytes);
            block_on(receiver.receive_message(bytes));
        }
    };
    for kind in 0..8_u8 {
        for seed in 0..COPIES {
            let peer = [7, 7, 7, 7, 7, 7, 7, 7, 7, kind, seed, 1];
            let whole = [[participant(peer), reader(peer)].as_slice(), &others(peer)].concat();
            give(&whole[0]);
            let copy = damaged(&whole[usize::from(kind)][HEADER_BYTES..], seed.into());
            give(&[&whole[0][..HEADER_BYTES], &copy].concat());
            give(&whole[1]);
            give(&departure_of(peer, 9));
        }
        give(&participant([kind; 12]));
        // The library answers before it has worked on what waits.
        let start = Instant::now();
        while discovered(&own).expect("the library does not answer any more") <= usize::from(kind) {
            assert!(
                start.elapsed() < TIMEOUT,
                "a participant is not found after damaged datagrams of kind {kind}"
            );
            std::thread::yield_now();
        }
    }
}
