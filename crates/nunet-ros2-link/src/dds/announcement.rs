//! The parameters by which participants announce themselves, their writers and their readers.

use std::net::{Ipv4Addr, SocketAddrV4};

use super::rtps::{SENTINEL, number, parameters, word};

/// A parameter list in little endian, as all ROS 2 nodes send it. The library takes the options that follow
/// for a length.
const ENCAPSULATION: [u8; 2] = [0, 3];
const ENCAPSULATION_BYTES: usize = 4;

const LEASE: u16 = 0x0002;
const LIVELINESS: u16 = 0x001b;
const DEADLINE: u16 = 0x0023;
const PARTITION: u16 = 0x0029;
const DISCOVERY_LOCATOR: u16 = 0x0032;
const BUILT_IN_ENDPOINTS: u16 = 0x0058;
const REPRESENTATION: u16 = 0x0073;
const TYPE_INFORMATION: u16 = 0x0075;
const DOMAIN_TAG: u16 = 0x4014;
/// The readers and writers that announce participants, writers and readers (DDSI-RTPS 2.5, table 9.4). The
/// transport carries no others.
const CARRIED_ENDPOINTS: u32 = 0x3f;
/// Parameters of vendors are ignored by others.
const VENDOR_SPECIFIC: u8 = 0x80;

/// Whether the library can read an announcement.
pub(super) fn is_sound(payload: &[u8]) -> bool {
    let mut end = ENCAPSULATION_BYTES;
    let are_sound = parameters(payload, end, true).all(|(_, id, value)| {
        end = value.end;
        payload.get(value).is_some_and(|value| is_parameter_sound(id, value))
    });
    are_sound && payload.starts_with(&ENCAPSULATION) && number(payload, end, true) == Some(SENTINEL)
}

/// The library reserves memory for as many elements as are stated, and subtracts one from the length of the
/// tag.
fn is_parameter_sound(id: u16, value: &[u8]) -> bool {
    let stated = value.first_chunk().map(|bytes| u32::from_le_bytes(*bytes) as usize);
    let available = value.len().saturating_sub(4);
    match id {
        PARTITION => stated.is_some_and(|count| count <= available / 4),
        REPRESENTATION => stated.is_some_and(|count| count <= available / 2),
        DOMAIN_TAG => stated.is_some_and(|length| (1..=available).contains(&length)),
        _ => true,
    }
}

/// Hides parameters that the library misunderstands:
/// - type information, because it would compare the type with that of
///   [`RawMessage`](super::raw_message::RawMessage); without it, types are compared by name, as between ROS 2
///   nodes of different vendors;
/// - deadlines and liveliness that are infinite in the way of Fast DDS, which it takes for finite ones and
///   refuses.
pub(super) fn simplify(payload: &mut [u8]) {
    payload.get_mut(ENCAPSULATION.len()..ENCAPSULATION_BYTES).into_iter().for_each(|options| options.fill(0));
    let found: Vec<_> = parameters(payload, ENCAPSULATION_BYTES, true).collect();
    for (at, id, value) in found {
        let value = payload.get(value).unwrap_or_default();
        if id == TYPE_INFORMATION || ([DEADLINE, LIVELINESS].contains(&id) && ends_infinite(value)) {
            payload.get_mut(at + 1).into_iter().for_each(|byte| *byte = VENDOR_SPECIFIC);
        }
    }
}

/// Leaves a participant the readers and writers of discovery whose messages the transport carries. With
/// others, as those of topics, the library would repeat messages forever that never arrive.
pub(super) fn limit_endpoints(payload: &mut [u8]) {
    change(payload, BUILT_IN_ENDPOINTS, |stated| {
        (u32::from_le_bytes(stated) & CARRIED_ENDPOINTS).to_le_bytes()
    });
}

/// Makes the lease of a participant at least `seconds`.
pub(super) fn extend_lease(payload: &mut [u8], seconds: i32) {
    change(payload, LEASE, |stated| i32::from_le_bytes(stated).max(seconds).to_le_bytes());
}

/// Changes the first word of a parameter.
fn change(payload: &mut [u8], changed: u16, word: impl Fn([u8; 4]) -> [u8; 4]) {
    let found: Vec<_> = parameters(payload, ENCAPSULATION_BYTES, true).collect();
    for (_, _, value) in found.into_iter().filter(|(_, id, _)| *id == changed) {
        let stated = payload.get_mut(value).and_then(|value| value.first_chunk_mut());
        stated.into_iter().for_each(|stated| *stated = word(*stated));
    }
}

/// Where a participant says that it receives announcements.
pub(super) fn discovery_addresses(payload: &[u8]) -> Vec<SocketAddrV4> {
    let found = parameters(payload, ENCAPSULATION_BYTES, true).filter(|(_, id, _)| *id == DISCOVERY_LOCATOR);
    found.filter_map(|(_, _, value)| address(payload.get(value)?)).collect()
}

/// Kind 1 is UDP with IPv4, whose address is in the last four bytes.
fn address(locator: &[u8]) -> Option<SocketAddrV4> {
    let (kind, port) = (word(locator, 0, true)?, word(locator, 4, true)?);
    let &[a, b, c, d] = locator.get(20..24)?.first_chunk()?;
    let port = u16::try_from(port).ok().filter(|port| *port != 0 && kind == 1)?;
    Some(SocketAddrV4::new(Ipv4Addr::new(a, b, c, d), port))
}

/// 0x7fffffff seconds and 0xffffffff fractions of a second.
fn ends_infinite(value: &[u8]) -> bool {
    value.ends_with(&[0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0xff])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_participant_keeps_the_endpoints_that_the_transport_carries() {
        let payload = |endpoints: u32| {
            let set = endpoints.to_le_bytes();
            [&[0, 3, 0, 0, 0x16, 0, 4, 0, 1, 15, 0, 0, 0x58, 0, 4, 0][..], &set, &[1, 0, 0, 0]].concat()
        };
        for (stated, kept) in [(u32::MAX, 0x3f), (0x3000_f03f, 0x3f), (0x0c15, 0x15)] {
            let mut changed = payload(stated);
            limit_endpoints(&mut changed);
            assert_eq!(changed, payload(kept));
        }
    }
}
