//! The reader's side: opens what an owner created and looks at its frames.

use std::sync::Arc;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::port::ReceiveError;
use iceoryx2::port::listener::{Listener, ListenerCreateError, ListenerWaitError};
use iceoryx2::port::subscriber::SubscriberCreateError;
use iceoryx2::prelude::EventActivation;
use iceoryx2::service::port_factory::PortFactory;

use crate::access;
use crate::error::IpcError;
use crate::frame::{Frame, FrameSet, Port};
use crate::name::CameraName;
use crate::node::{self, Iceoryx, Process};
use crate::service::{TopicService, open_topic, open_wake, owner_of};
use nunet_types::{Topic, Wake};

/// How often to look for services that are not there yet. There is nothing to wait on before they exist.
const RETRY_PERIOD: Duration = Duration::from_millis(10);

/// iceoryx2 hands the time to the socket in microseconds, and there 0 means for ever.
const SHORTEST_SLEEP: Duration = Duration::from_micros(10);

/// A reader of some of a camera's topics.
///
/// It gets the newest frame of each topic and never waits for, nor delays, anybody. When the owner ends, it stays
/// connected to the services; when a new owner comes, its frames arrive here without further ado. `Send`.
///
/// ```no_run
/// use std::time::Duration;
/// use nunet_ipc::{CameraName, Reader, Topic};
///
/// let mut reader = Reader::open(&CameraName::new("front")?, &[Topic::Depth], Duration::from_secs(5))?;
/// loop {
///     reader.wait(Duration::from_secs(1))?; // a hint: look for frames whatever it says
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
    joining: [Option<Frame>; Topic::ALL.len()],
}

#[derive(Debug)]
struct ReadTopic {
    topic: Topic,
    port: Arc<Port>,
    service: Arc<TopicService>,
}

/// Tells who publishes a reader's topics while another thread has the reader: [`Reader::owners`].
///
/// It keeps the services open, so it should end with its reader.
#[derive(Debug, Clone)]
pub struct Owners {
    services: Vec<Arc<TopicService>>,
}

impl Owners {
    /// As [`Reader::is_connected`].
    #[must_use]
    pub fn are_all_alive(&self) -> bool {
        self.services.iter().all(|service| owner_of(service).is_some_and(|owner| owner.alive))
    }
}

impl Reader {
    /// Opens topics of a camera, and tries again until they are there or the time is over.
    ///
    /// # Errors
    /// [`IpcError::NobodyPublishes`] after the timeout, [`IpcError::TooManyReaders`], [`IpcError::ContractVersion`].
    pub fn open(camera: &CameraName, topics: &[Topic], timeout: Duration) -> Result<Self, IpcError> {
        Self::open_unless(camera, topics, timeout, || false)
    }

    /// As [`open`](Self::open), but gives up early when `interrupted` says so. It is asked before each new try, some ten
    /// milliseconds apart.
    ///
    /// # Errors
    /// Those of [`open`](Self::open); [`IpcError::NobodyPublishes`] also when it was interrupted.
    pub fn open_unless(
        camera: &CameraName,
        topics: &[Topic],
        timeout: Duration,
        mut interrupted: impl FnMut() -> bool,
    ) -> Result<Self, IpcError> {
        let mut patience = Patience { deadline: deadline_after(timeout), interrupted: &mut interrupted };
        if let Some(topic) = topics.first() {
            // A reader must not be the one who makes iceoryx2's folder: it would be for the reader's user alone.
            let missing = IpcError::NobodyPublishes { service: camera.service(*topic), timeout };
            patience.retry(missing, || Ok(access::has_folder().then_some(())))?;
        }
        let node = node::create()?;
        let mut opened = Vec::with_capacity(topics.len());
        for topic in topics {
            let missing = IpcError::NobodyPublishes { service: camera.service(*topic), timeout };
            let service = patience.retry(missing, || open_topic(&node, camera, *topic))?;
            opened.push(ReadTopic::subscribe(camera, *topic, service)?);
            // At once: the owner waits until it may open the connection.
            access::share_read()?;
        }
        let listener = Self::listen(&node, camera, timeout, &mut patience)?;
        Ok(Self { camera: camera.clone(), listener, topics: opened, joining: Default::default() })
    }

    fn listen(
        node: &Node<Iceoryx>,
        camera: &CameraName,
        timeout: Duration,
        patience: &mut Patience<'_>,
    ) -> Result<Listener<Iceoryx>, IpcError> {
        let missing = IpcError::NobodyPublishes { service: camera.wake_service(), timeout };
        let service = patience.retry(missing, || open_wake(node, camera))?;
        let listener = service.listener_builder().create().map_err(|cause| match cause {
            ListenerCreateError::ExceedsMaxSupportedListeners => IpcError::TooManyListeners {
                camera: camera.clone(),
                limit: service.static_config().max_listeners(),
            },
            cause => IpcError::iceoryx(format!("listen to `{}`", camera.wake_service()), cause),
        })?;
        if access::is_shared() {
            access::share_read()?;
            // An owner who looked before the group was let in does not look again until a listener comes or goes. Where
            // there is no room for one more, frames come without being announced, as after any lost wake-up.
            drop(service.listener_builder().create());
        }
        Ok(listener)
    }

    /// The camera's name.
    #[must_use]
    pub fn camera(&self) -> &CameraName {
        &self.camera
    }

    /// The topics that were opened.
    pub fn topics(&self) -> impl ExactSizeIterator<Item = Topic> {
        self.topics.iter().map(|opened| opened.topic)
    }

    /// Sleeps until an owner has something new on one of the topics, or comes or goes, a signal interrupts it, or the
    /// time is over; says whether an owner woke it. Only a hint: look for frames whatever it says, and keep the timeout short enough for
    /// the frame that a late joiner gets without a wake-up.
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
                // A signal: whoever handles it may want to stop waiting.
                Err(ListenerWaitError::InterruptSignal) => return Ok(woken),
                waited => waited.map_err(failed)?,
            };
            if woken || over {
                return Ok(woken);
            }
        }
    }

    /// Without this a daemon that reads `rgb` would be woken by its own depth maps.
    fn cares_for(&self, event: usize) -> bool {
        match Wake::ALL.get(event) {
            Some(Wake::Picture) => self.topics().any(|topic| topic == Topic::Rgb),
            Some(Wake::Depth) => self.topics().any(|topic| topic != Topic::Rgb),
            Some(Wake::OwnerCame | Wake::OwnerLeft | Wake::OwnerDied) => true,
            None => false,
        }
    }

    /// The next frame of a topic that was not seen yet, if there is one.
    ///
    /// # Errors
    /// [`IpcError::TooManyFramesHeld`] when there is one but this reader holds as many as it may,
    /// [`IpcError::NoSuchTopic`], [`IpcError::BadMessage`].
    pub fn next(&self, topic: Topic) -> Result<Option<Frame>, IpcError> {
        let opened = self.topic(topic)?;
        match opened.port.receive() {
            Ok(Some(sample)) => Frame::new(sample, Arc::clone(&opened.port), topic).map(Some),
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
    pub fn latest(&self, topic: Topic) -> Result<Option<Frame>, IpcError> {
        let mut newest = None;
        while self.has_more(topic)? {
            drop(newest.take()); // given back first: a reader may hold few frames
            newest = self.next(topic)?;
        }
        Ok(newest)
    }

    /// The newest frames of all topics but `stats` that belong together, if they are all there: all of one
    /// [`key`](crate::FrameHeader::key). What came so far is kept for the next call; what can no longer become complete is
    /// dropped.
    ///
    /// A picture (`rgb`) is older than its results by the time they are made. So the one that came with the last
    /// results is kept until the next ones come, and newer ones are passed over: it is likely the one that is being
    /// worked on.
    ///
    /// # Errors
    /// Those of [`next`](Self::next).
    pub fn next_set(&mut self) -> Result<Option<FrameSet>, IpcError> {
        let mut came = None;
        for index in 0..self.topics.len() {
            let topic = self.topics[index].topic;
            if !matches!(topic, Topic::Stats | Topic::Rgb) && self.follow(topic)? {
                came = self.joining_key(topic);
            }
        }
        if self.topics().any(|topic| topic == Topic::Rgb) {
            let alone = self.topics().all(|topic| matches!(topic, Topic::Stats | Topic::Rgb));
            let held = self.joining_key(Topic::Rgb);
            if alone || held.is_none() || (came.is_some() && came != held) {
                self.follow(Topic::Rgb)?;
            }
        }
        if self.is_joined() {
            Ok(Some(FrameSet { frames: std::mem::take(&mut self.joining) }))
        } else {
            Ok(None)
        }
    }

    /// Whether every topic has a frame, all of one key.
    fn is_joined(&self) -> bool {
        let joined = self.topics().filter(|topic| *topic != Topic::Stats);
        let mut joined = joined.map(|topic| self.joining_key(topic));
        let first = joined.next().flatten();
        first.is_some() && joined.all(|key| key == first)
    }

    /// Replaces what is kept of a topic by what is newer; says whether there was anything.
    fn follow(&mut self, topic: Topic) -> Result<bool, IpcError> {
        let more = self.has_more(topic)?;
        if more {
            drop(self.joining[topic as usize].take()); // given back first: a reader may hold few frames
            self.joining[topic as usize] = self.latest(topic)?;
        }
        Ok(more)
    }

    fn joining_key(&self, topic: Topic) -> Option<(u64, i64)> {
        self.joining[topic as usize].as_ref().map(|frame| frame.header().key())
    }

    /// The process that publishes a topic: `None` when there is none, not alive when it was killed. Asks the file
    /// system: for the moments when no frames come, not for every frame.
    ///
    /// # Errors
    /// [`IpcError::NoSuchTopic`].
    pub fn owner(&self, topic: Topic) -> Result<Option<Process>, IpcError> {
        Ok(owner_of(&self.topic(topic)?.service))
    }

    /// Whether a living process publishes each of the topics. As costly as [`owner`](Self::owner).
    #[must_use]
    pub fn is_connected(&self) -> bool {
        self.owners().are_all_alive()
    }

    /// Who publishes the topics, for other threads to ask.
    #[must_use]
    pub fn owners(&self) -> Owners {
        Owners { services: self.topics.iter().map(|opened| Arc::clone(&opened.service)).collect() }
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

/// A timeout beyond what a clock can count is one that nobody will live to see.
fn deadline_after(timeout: Duration) -> Instant {
    const FOR_EVER: Duration = Duration::from_secs(100 * 365 * 24 * 60 * 60);
    let now = Instant::now();
    now.checked_add(timeout).unwrap_or(now + FOR_EVER)
}

/// When to stop trying.
struct Patience<'a> {
    deadline: Instant,
    interrupted: &'a mut dyn FnMut() -> bool,
}

impl Patience<'_> {
    /// Tries until there is something, the time is over, or nobody waits any more; tries at least once.
    fn retry<T>(
        &mut self,
        missing: IpcError,
        mut attempt: impl FnMut() -> Result<Option<T>, IpcError>,
    ) -> Result<T, IpcError> {
        loop {
            if let Some(found) = attempt()? {
                return Ok(found);
            }
            let left = self.deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || (self.interrupted)() {
                return Err(missing);
            }
            std::thread::sleep(RETRY_PERIOD.min(left));
        }
    }
}
