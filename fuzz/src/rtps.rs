//! What arrives from the network of ROS 2: datagrams, as the library gets them.

/// A datagram. The library panics at nothing that the transport lets through.
pub fn rtps(data: &[u8]) {
    if let Some(submessages) = nunet_ros2::submessages_read(data) {
        assert!(submessages <= data.len() / 4, "{submessages} submessages in {} bytes", data.len());
    }
}
