//! Requests to the live view, and the frames that its clients receive.

use nunet_view::{FrameMessage, Request, Section};

/// The text of a request: one that is accepted has numbers in range.
pub fn request(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Request::parse(text) {
        Ok(Request::Watch(watch)) => {
            assert!(watch.max_width >= 16);
            assert!(watch.max_fps > 0.0 && watch.max_mbit_per_s > 0.0, "{watch:?}");
        }
        Ok(Request::Probe { u, v }) => assert!([u, v].iter().all(|share| (0.0..=1.0).contains(share))),
        Ok(Request::Pause) => {}
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// A binary message: a map that is unpacked has as many values as its size has pixels.
pub fn message(data: &[u8]) {
    let Ok(frame) = FrameMessage::parse(data) else { return };
    let pixels = frame.map_size.pixel_count();
    if let Ok(Some(depth)) = frame.depth() {
        assert_eq!(depth.values.len(), pixels);
    }
    for map in [frame.labels(), frame.confidence()].into_iter().flatten().flatten() {
        assert_eq!(map.len(), pixels);
    }
    assert!(frame.section(Section::Image).is_none_or(|image| image.len() <= data.len()));
}
