//! The reader's side: opens what a publisher created and reads its frames in place.

mod message;
mod open;
mod set;

use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::prelude::EventActivation;
use iceoryx2::service::port_factory::PortFactory as _;
use nunet_types::{Topic, Wake};

use crate::error::IpcError;
use crate::iceoryx::Iceoryx;
use crate::name::CameraName;
use crate::process::Process;
use crate::service::{TopicService, publisher_of};

pub use message::{FrameSet, Message};

use message::TopicSubscriber;
use open::deadline_after;

/// iceoryx2 passes the timeout to the socket in microseconds, and 0 means no timeout there.
const SHORTEST_SLEEP: Duration = Duration::from_micros(10);

/// A reader of some of a camera's topics.
///
/// It receives the newest frame of each topic, and delays neither the publisher nor other readers. When the
/// publisher ends, the reader stays connected to the services; frames of a new publisher arrive without
/// opening again. `Send`.
///
/// ```no_run
/// use std::time::Duration;
/// use nunet_ipc::{CameraName, Reader, Topic};
///
/// let mut reader = Reader::open(&CameraName::new("front")?, &[Topic::Depth], Duration::from_secs(5))?;
/// loop {
///     reader.wait(Duration::from_secs(1))?; // a hint: look for frames whatever it returns
///     while let Some(frame) = reader.latest(Topic::Depth)? {
///         println!("{}: {} pixels", frame.header().sequence, frame.depth()?.len());
///     }
/// }
/// # #[expect(unreachable_code, reason = "the loop above has no end")]
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Reader {
    camera: CameraName,
    listener: Listener<Iceoryx>,
    topics: Vec<ReadTopic>,
    joining: [Option<Message>; Topic::ALL.len()],
}

#[derive(Debug)]
struct ReadTopic {
    topic: Topic,
    port: Arc<TopicSubscriber>,
    service: Arc<TopicService>,
}

/// The publishers of a reader's topics, for a thread that does not have the reader: [`Reader::publishers`].
///
/// It keeps the services open, so drop it with its reader.
#[derive(Debug, Clone)]
pub struct Publishers {
    services: Vec<Arc<TopicService>>,
}

impl Publishers {
    /// The same as [`Reader::is_connected`].
    #[must_use]
    pub fn are_all_alive(&self) -> bool {
        self.services.iter().all(|service| publisher_of(service).is_some_and(|publisher| publisher.alive))
    }
}

impl Reader {
    /// The camera's name.
    #[must_use]
    pub fn camera(&self) -> &CameraName {
        &self.camera
    }

    /// The topics that were opened.
    pub fn topics(&self) -> impl ExactSizeIterator<Item = Topic> {
        self.topics.iter().map(|opened| opened.topic)
    }

    /// Sleeps until a publisher of the topics sends something, starts or ends, a signal interrupts it, or the
    /// timeout expires. Returns whether a publisher woke it. Only a hint: look for frames whatever it
    /// returns, and keep the timeout short enough for the frame that a late subscriber receives without a
    /// wake-up.
    ///
    /// # Errors
    /// [`IpcError::Iceoryx`].
    pub fn wait(&self, timeout: Duration) -> Result<bool, IpcError> {
        let failed = |cause| IpcError::iceoryx(format!("wait for camera `{}`", self.camera), cause);
        let deadline = deadline_after(timeout);
        loop {
            let mut woken = false;
            let left = deadline.saturating_duration_since(Instant::now());
            let over = left < SHORTEST_SLEEP;
            let note = |event: EventActivation| woken |= self.cares_for(event.id.as_value());
            let waited =
                if over { self.listener.try_wait(note) } else { self.listener.timed_wait(note, left) };
            match waited {
                // A signal: its handler may want to stop waiting.
                Err(ListenerWaitError::InterruptSignal) => return Ok(woken),
                waited => waited.map_err(failed)?,
            };
            if woken || over {
                return Ok(woken);
            }
        }
    }

    /// Without this, a daemon that reads `rgb` would be woken by its own depth maps.
    fn cares_for(&self, event: usize) -> bool {
        match Wake::ALL.get(event) {
            Some(Wake::Image) => self.topics().any(|topic| topic == Topic::Rgb),
            Some(Wake::Depth) => self.topics().any(|topic| !matches!(topic, Topic::Rgb | Topic::Attitude)),
            Some(Wake::PublisherStarted | Wake::PublisherClosed | Wake::PublisherDied) => true,
            None => false,
        }
    }

    /// The next frame of a topic that was not seen yet, if there is one.
    ///
    /// # Errors
    /// [`IpcError::TooManyFramesHeld`] when there is one but this reader holds as many as it may,
    /// [`IpcError::NoSuchTopic`], [`IpcError::BadMessage`].
    pub fn next(&self, topic: Topic) -> Result<Option<Message>, IpcError> {
        let opened = self.topic(topic)?;
        match opened.port.receive() {
            Ok(Some(sample)) => Message::new(sample, Arc::clone(&opened.port), topic).map(Some),
            Ok(None) => Ok(None),
            Err(ReceiveError::ExceedsMaxBorrows) => {
                let limit = opened.service.static_config().subscriber_max_borrowed_samples();
                Err(IpcError::TooManyFramesHeld { topic, limit })
            }
            Err(cause) => Err(IpcError::iceoryx(format!("read `{}`", self.camera.service(topic)), cause)),
        }
    }

    /// The newest frame of a topic that was not seen yet, if there is one; older ones are dropped.
    ///
    /// # Errors
    /// Those of [`next`](Self::next).
    pub fn latest(&self, topic: Topic) -> Result<Option<Message>, IpcError> {
        let mut newest = None;
        while self.has_more(topic)? {
            drop(newest.take()); // first: a reader may hold few frames
            newest = self.next(topic)?;
        }
        Ok(newest)
    }

    /// The process that publishes a topic: `None` when there is none, not alive when it was killed. It reads
    /// the file system, so call it when no frames arrive, not for every frame.
    ///
    /// # Errors
    /// [`IpcError::NoSuchTopic`].
    pub fn publisher(&self, topic: Topic) -> Result<Option<Process>, IpcError> {
        Ok(publisher_of(&self.topic(topic)?.service))
    }

    /// Whether a living process publishes each of the topics. It costs as much as
    /// [`publisher`](Self::publisher).
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.publishers().are_all_alive()
    }

    /// The publishers of the topics, for other threads.
    #[must_use]
    pub fn publishers(&self) -> Publishers {
        Publishers { services: self.topics.iter().map(|opened| Arc::clone(&opened.service)).collect() }
    }

    fn has_more(&self, topic: Topic) -> Result<bool, IpcError> {
        let failed = |cause| IpcError::iceoryx(format!("read `{}`", self.camera.service(topic)), cause);
        self.topic(topic)?.port.has_samples().map_err(failed)
    }

    fn topic(&self, topic: Topic) -> Result<&ReadTopic, IpcError> {
        let missing = || IpcError::NoSuchTopic { topic, has: self.topics().collect() };
        self.topics.iter().find(|opened| opened.topic == topic).ok_or_else(missing)
    }
}
