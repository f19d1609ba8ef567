//! Opening a camera's services, and waiting for them.
//!
//! A program often waits for hours for a camera that is switched off, and many do so by opening again and
//! again with a short timeout. So waiting only looks at files: no node of iceoryx2 is created before every
//! service is there, because a node writes and syncs several files each time. One look is two system calls. A
//! wait for a change of the folder (inotify) would need none, but every service of every other camera wakes
//! it, and the folder may not exist yet.

use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::MessagingPattern;
use iceoryx2::service::port_factory::PortFactory as _;
use nunet_types::Topic;

use super::{ReadTopic, Reader};
use crate::access;
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, check_root, record_of};
use crate::name::CameraName;
use crate::recovery::create_node;
use crate::service::{TopicService, is_complete, open_topic, open_wake};

/// How soon to look again for a service that is not there yet, at first and at most. The longest period is
/// the most that the first frame of a publisher is delayed.
const FIRST_PERIOD: Duration = Duration::from_millis(10);
const LONGEST_PERIOD: Duration = Duration::from_millis(200);

impl Reader {
    /// Opens topics of a camera. Waits for its publisher until the timeout.
    ///
    /// # Errors
    /// [`IpcError::NobodyPublishes`] after the timeout, [`IpcError::TooManyReaders`],
    /// [`IpcError::ContractVersion`].
    pub fn open(camera: &CameraName, topics: &[Topic], timeout: Duration) -> Result<Self, IpcError> {
        Self::open_unless(camera, topics, timeout, || false)
    }

    /// As [`open`](Self::open), but stops waiting when `interrupted` returns true. It is called before each
    /// new attempt, at most 200 ms apart.
    ///
    /// # Errors
    /// Those of [`open`](Self::open); [`IpcError::NobodyPublishes`] also when it was interrupted.
    pub fn open_unless(
        camera: &CameraName,
        topics: &[Topic],
        timeout: Duration,
        mut interrupted: impl FnMut() -> bool,
    ) -> Result<Self, IpcError> {
        check_root()?;
        let deadline = deadline_after(timeout);
        let mut waiting = Waiting { timeout, deadline, interrupted: &mut interrupted };
        waiting.for_services(camera, topics)?;
        let node = create_node()?;
        let mut opened = Vec::with_capacity(topics.len());
        for &topic in topics {
            let service = waiting.until(&camera.service(topic), || open_topic(&node, camera, topic))?;
            opened.push(ReadTopic::subscribe(camera, topic, service)?);
            // At once: the publisher waits until it may open the connection.
            access::share_read()?;
        }
        let listener = listen(&node, camera, &mut waiting)?;
        Ok(Self { camera: camera.clone(), listener, topics: opened, joining: Default::default() })
    }
}

impl ReadTopic {
    fn subscribe(camera: &CameraName, topic: Topic, service: TopicService) -> Result<Self, IpcError> {
        let port = service.subscriber_builder().create().map_err(|cause| match cause {
            SubscriberCreateError::ExceedsMaxSupportedSubscribers => {
                let limit = service.static_config().max_subscribers();
                IpcError::TooManyReaders { camera: camera.clone(), topic, limit }
            }
            cause => IpcError::iceoryx(format!("read `{}`", camera.service(topic)), cause),
        })?;
        Ok(Self { topic, port: Arc::new(port), service: Arc::new(service) })
    }
}

fn listen(
    node: &Node<Iceoryx>,
    camera: &CameraName,
    waiting: &mut Waiting<'_>,
) -> Result<Listener<Iceoryx>, IpcError> {
    let name = camera.wake_service();
    let service = waiting.until(&name, || open_wake(node, camera))?;
    let listener = service.listener_builder().create().map_err(|cause| match cause {
        ListenerCreateError::ExceedsMaxSupportedListeners => IpcError::TooManyListeners {
            camera: camera.clone(),
            limit: service.static_config().max_listeners(),
        },
        cause => IpcError::iceoryx(format!("listen to `{name}`"), cause),
    })?;
    if access::is_shared() {
        access::share_read()?;
        // A publisher that looked before the files were shared does not look again until a listener appears
        // or disappears. Where there is no room for one more, frames arrive without a wake-up, as after any
        // lost one.
        drop(service.listener_builder().create());
    }
    Ok(listener)
}

/// A timeout beyond what a clock can count is one that never ends.
pub(super) fn deadline_after(timeout: Duration) -> Instant {
    const FOREVER: Duration = Duration::from_secs(100 * 365 * 24 * 60 * 60);
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + FOREVER)
}

/// When to stop waiting.
struct Waiting<'a> {
    timeout: Duration,
    deadline: Instant,
    interrupted: &'a mut dyn FnMut() -> bool,
}

impl Waiting<'_> {
    /// Waits until all services of a reader are there, without a node.
    fn for_services(&mut self, camera: &CameraName, topics: &[Topic]) -> Result<(), IpcError> {
        for &topic in topics {
            self.for_service(&camera.service(topic), MessagingPattern::PublishSubscribe)?;
        }
        self.for_service(&camera.wake_service(), MessagingPattern::Event)
    }

    fn for_service(&mut self, name: &str, pattern: MessagingPattern) -> Result<(), IpcError> {
        let record = record_of(name, pattern)?;
        self.until(name, || {
            access::check_usable()?; // another user's folder looks empty
            let is_there = record.exists() && is_complete(name, pattern)?;
            Ok(is_there.then_some(()))
        })
    }

    /// Attempts until there is a result, the time is over, or the caller stops waiting; attempts at least
    /// once.
    fn until<T>(
        &mut self,
        service: &str,
        mut attempt: impl FnMut() -> Result<Option<T>, IpcError>,
    ) -> Result<T, IpcError> {
        let mut period = FIRST_PERIOD;
        loop {
            if let Some(found) = attempt()? {
                return Ok(found);
            }
            let left = self.deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || (self.interrupted)() {
                return Err(IpcError::NobodyPublishes { service: service.to_owned(), timeout: self.timeout });
            }
            std::thread::sleep(period.min(left));
            period = period_after(period);
        }
    }
}

fn period_after(period: Duration) -> Duration {
    (period * 2).min(LONGEST_PERIOD)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_wait_looks_at_most_five_times_per_second_and_never_rests_longer_than_200_ms() {
        let periods = std::iter::successors(Some(FIRST_PERIOD), |&period| Some(period_after(period)));
        let first: Vec<_> = periods.take(60).collect();
        assert!(first.iter().sum::<Duration>() >= Duration::from_secs(10), "{first:?}");
        assert_eq!(first.iter().max(), Some(&Duration::from_millis(200)));
    }
}
