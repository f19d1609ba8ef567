//! Obstacles for an autopilot. The messages and the connection are `nunet-mavlink`'s.

use std::time::{Duration, Instant};

use nunet_mavlink::{DistanceRing, LinkEvent, MavlinkAddress, MavlinkLink};
use nunet_types::counted;
use tracing::{info, warn};

use crate::queue::{OnRoom, SinkQueue, Writer};
use crate::results::Results;
use crate::sink::{FinishingSink, Outcome, PublishedFrame, Sink, Wants};

/// The number of messages that wait. It is small, because waiting makes them old.
const CAPACITY: usize = 2;
/// Distances that waited longer, while the connection did not respond, are not sent: the autopilot would take
/// them for those of now.
const MAX_WAIT: Duration = Duration::from_millis(500);

/// Sends the obstacles of one camera to an autopilot.
///
/// # Errors
/// The thread cannot be started.
pub fn mavlink_sink(address: MavlinkAddress, on_room: OnRoom) -> anyhow::Result<Box<dyn Sink>> {
    let writer = LinkWriter { link: MavlinkLink::new(address) };
    Ok(Box::new(MavlinkSink { queue: SinkQueue::start("mavlink", CAPACITY, writer, on_room)? }))
}

struct MavlinkSink {
    queue: SinkQueue<LinkWriter>,
}

impl Sink for MavlinkSink {
    fn wants(&self) -> Wants {
        Wants { obstacles: true, ..Wants::default() }
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        let Some(found) = published.results.obstacles else { return };
        let unix_nanos = published.frame.capture.unix_nanos;
        self.queue.offer(|item| {
            let angles = [found.angle_min_rad, found.angle_step_rad];
            item.ring.fill(&found.sectors, angles, found.max_range_m);
            item.unix_micros = u64::try_from(unix_nanos / 1000).unwrap_or(0);
            item.offered = Some(Instant::now());
        });
    }

    /// An autopilot needs no old distances, so only the message that is being sent is waited for.
    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        let closed = self.queue.close();
        if closed.dropped > 0 {
            let messages = counted(closed.dropped, "message");
            warn!("{messages} not sent to the autopilot: the connection did not keep up");
        }
        FinishingSink::new(move |timeout| {
            closed.wait("the messages to the autopilot", timeout)?;
            Ok(Outcome::Done)
        })
    }
}

#[derive(Default)]
struct Distances {
    ring: DistanceRing,
    unix_micros: u64,
    /// When it began to wait.
    offered: Option<Instant>,
}

/// Autopilots expect distances at least this often.
const SLOW: Duration = Duration::from_millis(100);

struct LinkWriter {
    link: MavlinkLink,
}

impl LinkWriter {
    fn report(&self, event: Option<LinkEvent>) {
        let address = self.link.address();
        match event {
            Some(LinkEvent::Opened) => {
                info!("sending obstacles to `{address}`");
                let period = self.link.period();
                if period > SLOW {
                    warn!(
                        hint = "set both ends to 57600 baud or more",
                        "the serial line is slow: obstacles are sent every {:.1} s, expected every {:.1} s",
                        period.as_secs_f32(),
                        SLOW.as_secs_f32()
                    );
                }
            }
            Some(LinkEvent::Lost(reason)) => {
                warn!("cannot send obstacles to `{address}`: {reason}; retrying");
            }
            None => {}
        }
    }
}

impl Writer for LinkWriter {
    type Item = Distances;

    fn write(&mut self, item: &Distances) {
        // Opening the connection may take long, too.
        self.flush_if_due();
        if item.offered.is_some_and(|offered| offered.elapsed() <= MAX_WAIT) {
            let event = self.link.send(&item.ring, item.unix_micros, Instant::now());
            self.report(event);
        }
    }

    /// Heartbeats continue while the camera delivers no images.
    fn flush_if_due(&mut self) {
        let event = self.link.keep_alive(Instant::now());
        self.report(event);
    }

    fn finish(&mut self) {}
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use super::*;

    #[test]
    fn distances_that_waited_too_long_are_not_sent() {
        const TIME_OFFSET: usize = 10; // behind the header of MAVLink 2
        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        autopilot.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let address = format!("udpout:{}", autopilot.local_addr().unwrap()).parse().unwrap();
        let mut writer = LinkWriter { link: MavlinkLink::new(address) };
        let now = Instant::now();
        let old = now.checked_sub(10 * MAX_WAIT);
        for (unix_micros, offered) in [(1, old), (2, None), (3, now.checked_add(10 * MAX_WAIT))] {
            writer.write(&Distances { ring: DistanceRing::default(), unix_micros, offered });
        }
        let mut message = [0; 300];
        autopilot.recv(&mut message).unwrap();
        assert_eq!(message[7], 0, "a heartbeat");
        autopilot.recv(&mut message).unwrap();
        assert_eq!(message[TIME_OFFSET], 3, "only that of now");
    }
}
