//! The bytes of messages.

use mavlink::MavHeader;
use mavlink::dialects::common::{
    HEARTBEAT_DATA, MavAutopilot, MavComponent, MavDistanceSensor, MavFrame, MavMessage, MavModeFlag,
    MavState, MavType, OBSTACLE_DISTANCE_DATA,
};

use crate::ring::{BIN_DEG, DistanceRing};

/// The system of the autopilot, to which a companion computer belongs.
const SYSTEM_ID: u32 = 1;

/// Writes messages with consecutive numbers.
#[derive(Debug, Default)]
pub(crate) struct MessageWriter {
    sequence: u8,
}

impl MessageWriter {
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
        let component_id = MavComponent::MAV_COMP_ID_OBSTACLE_AVOIDANCE as u8;
        let header = MavHeader { system_id: SYSTEM_ID, component_id, sequence: self.sequence };
        self.sequence = self.sequence.wrapping_add(1);
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
        let mut messages = MessageWriter::default();
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
}
