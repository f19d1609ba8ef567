use super::*;

const PEER: Prefix = [9; 12];

fn datagram(parts: &[&[u8]]) -> Vec<u8> {
    [&header_of(PEER)[..], &parts.concat()].concat()
}

fn to(peer: Prefix, id: u8, body: &[u8]) -> Vec<u8> {
    datagram(&[&[INFO_DESTINATION, 1, 12, 0], &peer, &[id, 1, body.len() as u8, 0], body])
}

/// For `peer`, with the messages from the first to `last`.
pub(in crate::dds) fn heartbeat(peer: Prefix, endpoints: Endpoints, last: u8) -> Vec<u8> {
    let numbers = [[0, 0, 0, 0, 1, 0, 0, 0], [0, 0, 0, 0, last, 0, 0, 0]].concat();
    to(peer, HEARTBEAT, &[&endpoints[..], &numbers, &[last, 0, 0, 0]].concat())
}

pub(in crate::dds) fn data_frag(peer: Prefix, endpoints: Endpoints) -> Vec<u8> {
    to(peer, DATA_FRAG, &[&[0, 0, 28, 0][..], &endpoints, &[0; 24]].concat())
}

pub(in crate::dds) fn acknack(endpoints: Endpoints, count: u8) -> Vec<u8> {
    let set = [&[0, 0, 0, 0, 1, 0, 0, 0, 33, 0, 0, 0][..], &[0; 8]].concat();
    datagram(&[&[ACKNACK, 1, 32, 0], &endpoints, &set, &[count, 0, 0, 0]])
}

#[test]
fn a_heartbeat_is_answered_as_its_reader_would_answer() {
    let (other, endpoints) = ([7; 12], [0, 0, 0x12, 4, 0, 0, 0x11, 3]);
    let question = question(&heartbeat(other, endpoints, 5)).unwrap();
    assert_eq!(question.endpoints, endpoints);
    let answer = answer(&question, 0x0102);
    assert_eq!(sender(&answer), Some(other));
    let body = [&endpoints[..], &[0, 0, 0, 0, 6, 0, 0, 0], &[0; 4], &[2, 1, 0, 0]].concat();
    assert_eq!(answer[20..], [&[ACKNACK, 3, 24, 0][..], &body].concat(), "message 6 is the next");
    assert!(super::question(&data_frag(other, endpoints)).is_none());
    assert_eq!(destination(&data_frag(other, endpoints)), Some(other));
    assert_eq!(sender(&datagram(&[])), Some(PEER));
}

#[test]
fn topics_and_discovery_are_distinguished() {
    let (topic, builtin) = ([0, 0, 0x12, 4, 0, 0, 0x11, 3], [0, 0, 4, 0xc7, 0, 0, 4, 0xc2]);
    assert!(carries_topic(&heartbeat(PEER, topic, 1)) && carries_topic(&data_frag(PEER, topic)));
    assert!(!carries_topic(&heartbeat(PEER, builtin, 1)) && !carries_topic(&acknack(topic, 1)));
}

#[test]
fn a_departure_is_one_submessage_of_the_participant_that_leaves() {
    let departed = departure_of(PEER, (7 << 32) + 5);
    assert_eq!(sender(&departed), Some(PEER));
    assert_eq!(departed[28..36], [0, 1, 0, 0xc7, 0, 1, 0, 0xc2], "from the writer of announcements");
    assert_eq!(departed[36..44], [7, 0, 0, 0, 5, 0, 0, 0]);
    let parts: Vec<_> = submessages(&departed).collect();
    assert_eq!((parts.len(), parts[0].body.end), (1, departed.len()));
    let found: Vec<_> = parameters(&departed[24..], 20, true).map(|(_, id, _)| id).collect();
    assert_eq!(found, [0x70, 0x71]);
}

#[test]
fn the_departure_of_the_library_has_no_data() {
    let number = [0, 0, 0, 0, 3, 0, 0, 0];
    let key = [&[0, 3, 0, 0, 0x50, 0, 16, 0][..], &PEER, &PARTICIPANT, &[1, 0, 0, 0]].concat();
    let head = [&[0, 0, 16, 0][..], &[0; 4], &PARTICIPANT_WRITER, &number].concat();
    let status = [0x71, 0, 4, 0, 0, 0, 0, 2, 1, 0, 0, 0];
    let body = [&head[..], &status, &key].concat();
    let departure = |flags| datagram(&[&[DATA, flags, body.len() as u8, 0], &body]);
    assert_eq!(understood_departure(&departure(0x0b)), Some(departure_of(PEER, 3)));
    assert_eq!(understood_departure(&departure(0x07)), None, "an announcement");
}
