//! Qualities of service, as ROS 2 states them.

use dust_dds::infrastructure::qos::{DataReaderQos, DataWriterQos};
use dust_dds::infrastructure::qos_policy::{
    DurabilityQosPolicy, DurabilityQosPolicyKind, HistoryQosPolicy, HistoryQosPolicyKind,
    ReliabilityQosPolicy, ReliabilityQosPolicyKind, UserDataQosPolicy,
};
use dust_dds::infrastructure::time::{Duration, DurationKind};

use crate::link::Delivery;

/// How long a message waits for room while confirmations are on their way.
const WAIT_FOR_ROOM: Duration = Duration::new(0, 5_000_000);

/// Of a publisher: reliable.
pub(super) fn writer_qos(delivery: Delivery, type_hash: &str) -> DataWriterQos {
    let durability = if delivery.is_kept {
        DurabilityQosPolicyKind::TransientLocal
    } else {
        DurabilityQosPolicyKind::Volatile
    };
    DataWriterQos {
        durability: DurabilityQosPolicy { kind: durability },
        reliability: ReliabilityQosPolicy {
            kind: ReliabilityQosPolicyKind::Reliable,
            max_blocking_time: DurationKind::Finite(WAIT_FOR_ROOM),
        },
        history: HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(delivery.depth) },
        user_data: hash(type_hash),
        ..DataWriterQos::default()
    }
}

/// Of a subscriber: that of ROS 2 for sensor data, which matches every publisher, but the newest message is
/// enough.
pub(super) fn reader_qos(type_hash: &str) -> DataReaderQos {
    DataReaderQos {
        durability: DurabilityQosPolicy { kind: DurabilityQosPolicyKind::Volatile },
        reliability: ReliabilityQosPolicy {
            kind: ReliabilityQosPolicyKind::BestEffort,
            max_blocking_time: DurationKind::Finite(Duration::new(0, 0)),
        },
        history: HistoryQosPolicy { kind: HistoryQosPolicyKind::KeepLast(1) },
        user_data: hash(type_hash),
        ..DataReaderQos::default()
    }
}

/// As `rmw_fastrtps` and `rmw_cyclonedds` state it.
fn hash(type_hash: &str) -> UserDataQosPolicy {
    UserDataQosPolicy { value: format!("typehash={type_hash};").into_bytes() }
}
