//! What arrives from ROS 2: datagrams of DDS, and the messages in them.

use nunet_mcap::{RecordedImage, TopicDecoder};
use nunet_ros2_link::DatagramProbe;

/// Datagrams, each after its length in two bytes. A message that is completed has the bytes that were sent.
pub fn datagrams(data: &[u8]) {
    let (probe, mut rest) = (DatagramProbe::default(), data);
    while let Some((&[low, high], behind)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([low, high])).min(behind.len());
        let (datagram, next) = behind.split_at(length);
        if let Some(message) = probe.put(datagram) {
            live_message(&message);
        }
        rest = next;
    }
}

/// A message on a topic, read as each type that is subscribed to.
pub fn live_message(data: &[u8]) {
    for type_name in ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"] {
        let decoder = TopicDecoder::new("/camera/image_raw", type_name).expect("a type of images");
        let mut image = RecordedImage::default();
        match decoder.image(data, &mut image) {
            Ok(()) => assert!(image.data.len() <= data.len(), "{} bytes of {}", image.data.len(), data.len()),
            Err(reason) => assert!(!reason.is_empty() && reason.len() < 2000, "{reason}"),
        }
        let mut camera = None;
        decoder.update_camera(data, &mut camera);
    }
}
