//! The bytes of messages.

use mavlink::MavHeader;
use mavlink::dialects::common::{
    HEARTBEAT_DATA, MavAutopilot, MavComponent, MavDistanceSensor, MavFrame, MavMessage, MavModeFlag,
    MavState, MavType, OBSTACLE_DISTANCE_DATA,
};

use crate::ring::{BIN_DEG, DistanceRing};

/// The usual system of an autopilot.
pub(crate) const SYSTEM_ID: u8 = 1;
/// The usual component of what this computer does.
pub(crate) const COMPONENT_ID: u8 = MavComponent::MAV_COMP_ID_OBSTACLE_AVOIDANCE as u8;

/// Writes messages with consecutive numbers.
#[derive(Debug)]
pub(crate) struct MessageWriter {
    system_id: u8,
    component_id: u8,
    sequence: u8,
}

impl MessageWriter {
    /// Writes the messages of a component of a system.
    pub(crate) fn new(system_id: u8, component_id: u8) -> Self {
        Self { system_id, component_id, sequence: 0 }
    }

    /// A `HEARTBEAT`: this computer is alive.
    pub(crate) fn heartbeat(&mut self) -> Vec<u8> {
        self.bytes(&MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
            autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
            base_mode: MavModeFlag::empty(),
            system_status: MavState::MAV_STATE_ACTIVE,
            ..HEARTBEAT_DATA::DEFAULT
        }))
    }

    /// The distances, in the vehicle's body frame. `unix_micros` is when the image was captured.
    pub(crate) fn obstacle_distance(&mut self, ring: &DistanceRing, unix_micros: u64) -> Vec<u8> {
        self.bytes(&MavMessage::OBSTACLE_DISTANCE(OBSTACLE_DISTANCE_DATA {
            time_usec: unix_micros,
            distances: ring.distances_cm,
            min_distance: 0,
            max_distance: ring.max_cm,
            sensor_type: MavDistanceSensor::MAV_DISTANCE_SENSOR_UNKNOWN,
            increment: BIN_DEG as u8,
            increment_f: BIN_DEG,
            angle_offset: 0.0,
            frame: MavFrame::MAV_FRAME_BODY_FRD,
        }))
    }

    fn bytes(&mut self, message: &MavMessage) -> Vec<u8> {
        let Self { system_id, component_id, sequence } = *self;
        let header = MavHeader { system_id: system_id.into(), component_id, sequence };
        self.sequence = sequence.wrapping_add(1);
        let mut bytes = Vec::with_capacity(280); // the longest message
        match mavlink::write_v2_msg(&mut bytes, header, message) {
            Ok(_) => bytes,
            // Writing to memory cannot fail.
            Err(_) => Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(bytes: &[u8]) -> (MavHeader, MavMessage) {
        mavlink::MavlinkReader::new(bytes).read_any_message().unwrap()
    }

    #[test]
    fn messages_are_numbered_and_read_back() {
        let mut messages = MessageWriter::new(SYSTEM_ID, COMPONENT_ID);
        let (header, heartbeat) = read(&messages.heartbeat());
        assert_eq!((header.system_id, header.component_id, header.sequence), (1, 196, 0));
        let MavMessage::HEARTBEAT(heartbeat) = heartbeat else { panic!("{heartbeat:?}") };
        assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_ONBOARD_CONTROLLER);
        let mut ring = DistanceRing { max_cm: 450, ..DistanceRing::default() };
        ring.distances_cm[3] = 150;
        let (header, distance) = read(&messages.obstacle_distance(&ring, 1_700_000_000_000_000));
        assert_eq!(header.sequence, 1);
        let MavMessage::OBSTACLE_DISTANCE(distance) = distance else { panic!("{distance:?}") };
        assert_eq!((distance.distances, distance.max_distance), (ring.distances_cm, 450));
        assert_eq!((distance.increment, distance.increment_f, distance.angle_offset), (5, 5.0, 0.0));
        assert_eq!(
            (distance.frame, distance.time_usec),
            (MavFrame::MAV_FRAME_BODY_FRD, 1_700_000_000_000_000)
        );
    }
    #[test]
    fn messages_come_from_the_system_and_component_that_were_chosen() {
        let mut messages = MessageWriter::new(255, 197);
        for bytes in [messages.heartbeat(), messages.obstacle_distance(&DistanceRing::default(), 1)] {
            let (header, _) = read(&bytes);
            assert_eq!((header.system_id, header.component_id), (255, 197));
        }
    }
}
