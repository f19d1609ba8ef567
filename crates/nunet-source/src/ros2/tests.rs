//! Subscribers of images, over a network that a test makes up.

use std::sync::atomic::{AtomicU32, Ordering};

use nunet_ros2_link::{Delivery, MessagePublisher};

use super::*;

/// A network that still lists a killed publisher of each type. Counts the subscribers that were made.
#[derive(Default)]
struct Outdated(AtomicU32);

impl Link for Outdated {
    fn publisher(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
        _delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        Err(Ros2Error::Transport { name: "none" })
    }

    fn subscriber(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        self.0.fetch_add(1, Ordering::Relaxed);
        Ok(Box::new(Unmatched))
    }

    fn published_types(&self, _topic: &str) -> Result<Vec<String>, Ros2Error> {
        Ok(IMAGE_TYPES.map(|known| known.name().to_owned()).to_vec())
    }

    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        Ok(())
    }
}

/// A subscriber without publishers.
struct Unmatched;

impl MessageSubscriber for Unmatched {
    fn update(&mut self) -> Result<usize, Ros2Error> {
        Ok(0)
    }

    fn take(&mut self, _message: &mut Vec<u8>, _timeout: Duration) -> Arrival {
        Arrival::Nothing
    }
}

#[test]
fn killed_publishers_of_both_types_are_subscribed_to_ever_more_rarely() {
    let link = Arc::new(Outdated::default());
    let mut source = Ros2Source::over("/front/image_raw", link.clone()).unwrap();
    let of_cameras = link.0.load(Ordering::Relaxed);
    let start = Instant::now();
    let mut made = Vec::new();
    // For a minute.
    for period in 0..300_u32 {
        let before = link.0.load(Ordering::Relaxed);
        source.look_for_publishers(start + period * DISCOVERY_PERIOD).unwrap();
        made.extend((link.0.load(Ordering::Relaxed) > before).then_some(period));
    }
    // In multiples of 0.2 s.
    assert_eq!(made, [0, 1, 3, 7, 15, 31, 63, 113, 163, 213, 263]);
    assert_eq!(link.0.load(Ordering::Relaxed) as usize, of_cameras as usize + made.len());
    assert!(source.silence.is_long(start + Duration::from_secs(5)), "a new subscriber is no sign of life");
}
