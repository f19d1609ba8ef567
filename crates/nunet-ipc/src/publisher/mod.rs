//! The publisher's side: creates a camera's services and fills frames in place.

mod checks;
mod loan;
mod prefault;
mod sent;
mod services;

use std::time::Duration;

use iceoryx2::port::LoanError;
use iceoryx2::port::event_id::EventId;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher as IoxPublisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections as _;
use iceoryx2::prelude::{BackpressureStrategy, MessagingPattern};
use iceoryx2::service::port_factory::PortFactory as _;
use nunet_types::{Topic, Wake};

use crate::access;
use crate::contract::{Block64, FrameHeader, blocks_for};
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, record_of};
use crate::name::CameraName;
use crate::plan::{Limits, Reservation, TopicPlan};
use crate::process::Process;
use crate::recovery::{CreationLock, create_node};
use crate::service::{TopicService, WakeService, publisher_of};

pub use checks::free_shared_memory_bytes;
pub use loan::{Loan, check_capture_time};
pub use sent::SentPayload;

/// How soon a late subscriber receives the last frame while the source is paused: the period of
/// [`Publisher::refresh`].
pub const LATE_JOINER_PERIOD: Duration = Duration::from_millis(200);
/// How long to wait for another process that is cleaning up after a dead publisher.
const CLEAN_UP_TIMEOUT: Duration = Duration::from_secs(1);

/// The publisher of some of a camera's topics.
///
/// Creating one creates the services, reserves all the memory they will ever use, and backs it with pages.
/// Readers that are slow, keep their frames or crash cannot block the publisher or each other. Dropping it
/// removes the services, unless readers still have them open: then the next publisher takes them over, and
/// the readers receive its frames.
#[derive(Debug)]
pub struct Publisher {
    camera: CameraName,
    // Fields are dropped in this order: ports, then services, then the node inside of them.
    notifier: Notifier<Iceoryx>,
    topics: Vec<OwnedTopic>,
    reservation: Reservation,
    limits: Limits,
}

#[derive(Debug)]
struct OwnedTopic {
    plan: TopicPlan,
    port: IoxPublisher<Iceoryx, [Block64], FrameHeader>,
    service: TopicService,
}

impl Publisher {
    /// Becomes the publisher of these topics of a camera.
    ///
    /// # Errors
    /// [`IpcError::AlreadyPublished`] when another process publishes one of them,
    /// [`IpcError::SharedMemoryTooSmall`] when they do not fit, [`IpcError::ContractVersion`] and
    /// [`IpcError::OtherLimits`] when readers keep services open that this publisher cannot take over.
    pub fn create(camera: &CameraName, plans: &[TopicPlan], limits: &Limits) -> Result<Self, IpcError> {
        Self::create_within(camera, plans, limits, free_shared_memory_bytes()?)
    }

    /// [`create`](Self::create) for a program that may be asked to stop meanwhile: it stops waiting for other
    /// publishers when `given_up` returns true. That wait can take a minute if one of them hangs.
    ///
    /// # Errors
    /// Those of [`create`](Self::create), and [`IpcError::Locked`] when it gave up.
    pub fn create_unless(
        camera: &CameraName,
        plans: &[TopicPlan],
        limits: &Limits,
        given_up: &dyn Fn() -> bool,
    ) -> Result<Self, IpcError> {
        Self::create_with(camera, plans, limits, free_shared_memory_bytes()?, given_up)
    }

    /// [`create`](Self::create) with the free shared memory as an argument.
    ///
    /// # Errors
    /// Those of [`create`](Self::create).
    pub fn create_within(
        camera: &CameraName,
        plans: &[TopicPlan],
        limits: &Limits,
        free_bytes: u64,
    ) -> Result<Self, IpcError> {
        Self::create_with(camera, plans, limits, free_bytes, &|| false)
    }

    fn create_with(
        camera: &CameraName,
        plans: &[TopicPlan],
        limits: &Limits,
        free_bytes: u64,
        given_up: &dyn Fn() -> bool,
    ) -> Result<Self, IpcError> {
        limits.check()?;
        checks::refuse_repetition(plans)?;
        let reservation = Reservation::new(plans, limits);
        let node = create_node()?;
        let lock = CreationLock::take(given_up)?;
        let mut services = Vec::with_capacity(plans.len());
        for plan in plans {
            let service = services::create_topic(&lock, &node, camera, plan.topic, limits)?;
            refuse_living_publisher(&service, camera, plan.topic)?;
            services.push((*plan, service));
        }
        let wake = services::create_wake(&lock, &node, camera)?;
        share_services(camera, &services, &wake)?;
        drop(lock);
        // Only the records of the services exist so far. This is checked after the publishers: if the camera
        // is already published, that is the error to report, not that its memory does not fit twice.
        reservation.check(free_bytes)?;
        let topics = services
            .into_iter()
            .map(|(plan, service)| OwnedTopic::create(camera, plan, service, limits))
            .collect::<Result<Vec<_>, _>>()?;
        let notifier = wake
            .notifier_builder()
            .create()
            .map_err(|cause| IpcError::iceoryx(format!("notify the readers of camera `{camera}`"), cause))?;
        access::share_published(&[], &[])?;
        Ok(Self { camera: camera.clone(), notifier, topics, reservation, limits: *limits })
    }

    /// The camera's name.
    #[must_use]
    pub fn camera(&self) -> &CameraName {
        &self.camera
    }

    /// The shared memory that was reserved.
    #[must_use]
    pub fn reservation(&self) -> &Reservation {
        &self.reservation
    }

    /// Whether a topic has readers; false for a topic that is not this publisher's. It costs two loads from
    /// shared memory, so it can be asked before every frame. A killed reader counts until some process cleans
    /// up after it.
    #[must_use]
    pub fn has_readers(&self, topic: Topic) -> bool {
        self.owned(topic).is_some_and(|owned| owned.service.dynamic_config().number_of_subscribers() > 0)
    }

    /// Borrows a chunk for a frame of the planned size. It contains the bytes of an earlier frame.
    ///
    /// # Errors
    /// [`IpcError::NoSuchTopic`], and [`IpcError::TooManyLoans`] when [`Limits::max_loans`] are open. While
    /// fewer are open, a loan always succeeds.
    pub fn loan(&self, topic: Topic) -> Result<Loan, IpcError> {
        self.loan_bytes(topic, self.topic(topic)?.plan.payload_bytes)
    }

    /// Borrows a chunk for a frame that is smaller than planned.
    ///
    /// # Errors
    /// Those of [`loan`](Self::loan), and [`IpcError::PayloadTooLarge`].
    pub fn loan_bytes(&self, topic: Topic, payload_bytes: usize) -> Result<Loan, IpcError> {
        let owned = self.topic(topic)?;
        let planned = owned.plan.payload_bytes;
        if payload_bytes > planned {
            return Err(IpcError::PayloadTooLarge { topic, payload_bytes, planned });
        }
        match owned.port.loan_slice_uninit(blocks_for(payload_bytes)) {
            Ok(sample) => Ok(Loan::new(sample, topic, payload_bytes)),
            Err(LoanError::OutOfMemory | LoanError::ExceedsMaxLoans) => {
                Err(IpcError::TooManyLoans { topic, limit: self.limits.max_loans })
            }
            Err(cause) => Err(IpcError::iceoryx(format!("loan a chunk of topic `{topic}`"), cause)),
        }
    }

    /// Wakes the readers: [`Wake::Image`] after `rgb`, [`Wake::Depth`] after a frame's last topic, `depth`.
    ///
    /// # Errors
    /// [`IpcError::Iceoryx`].
    pub fn notify(&self, wake: Wake) -> Result<(), IpcError> {
        self.notifier.notify_with_custom_event_id(EventId::new(wake as usize)).map(drop).map_err(|cause| {
            IpcError::iceoryx(format!("wake the readers of camera `{}`", self.camera), cause)
        })
    }

    /// Connects readers that opened since the last frame, and sends them the newest one. Publishing does the
    /// same. Call it every [`LATE_JOINER_PERIOD`], so that a late subscriber receives the last frame while
    /// the source is paused.
    ///
    /// # Errors
    /// [`IpcError::Iceoryx`].
    pub fn refresh(&self) -> Result<(), IpcError> {
        for topic in &self.topics {
            topic.port.update_connections().map_err(|cause| {
                IpcError::iceoryx(format!("connect readers of camera `{}`", self.camera), cause)
            })?;
        }
        Ok(())
    }

    fn topic(&self, topic: Topic) -> Result<&OwnedTopic, IpcError> {
        let has = || self.topics.iter().map(|owned| owned.plan.topic).collect();
        self.owned(topic).ok_or_else(|| IpcError::NoSuchTopic { topic, has: has() })
    }

    fn owned(&self, topic: Topic) -> Option<&OwnedTopic> {
        self.topics.iter().find(|owned| owned.plan.topic == topic)
    }
}

impl OwnedTopic {
    fn create(
        camera: &CameraName,
        plan: TopicPlan,
        service: TopicService,
        limits: &Limits,
    ) -> Result<Self, IpcError> {
        let chunks = limits.chunks_of(plan.topic);
        let created = service
            .publisher_builder()
            .initial_max_slice_len(blocks_for(plan.payload_bytes))
            .override_sample_preallocation(move |_| chunks)
            .max_loaned_samples(chunks) // all of them, for `prefault`; afterwards the number of chunks is the limit
            .backpressure_strategy(BackpressureStrategy::DiscardData) // the publisher never waits
            .create();
        let port = match created {
            Ok(port) => port,
            Err(PublisherCreateError::ExceedsMaxSupportedPublishers) => {
                let publisher = publisher_of(&service).unwrap_or(Process { pid: 0, alive: true });
                return Err(IpcError::AlreadyPublished {
                    camera: camera.clone(),
                    topic: plan.topic,
                    publisher,
                });
            }
            Err(cause) => {
                return Err(IpcError::iceoryx(format!("publish `{}`", camera.service(plan.topic)), cause));
            }
        };
        // Before the slow work, because readers of an earlier publisher wait for it.
        access::share_published(&[], &[])?;
        prefault::every_chunk(&port, plan, chunks)?;
        Ok(Self { plan, port, service })
    }
}

/// Shares the services with the group, if there is one. They may be older than this publisher, so they are
/// named.
fn share_services(
    camera: &CameraName,
    services: &[(TopicPlan, TopicService)],
    wake: &WakeService,
) -> Result<(), IpcError> {
    let mut ids = vec![wake.unique_service_id().value()];
    let mut records = vec![record_of(&camera.wake_service(), MessagingPattern::Event)?];
    for (plan, service) in services {
        ids.push(service.unique_service_id().value());
        records.push(record_of(&camera.service(plan.topic), MessagingPattern::PublishSubscribe)?);
    }
    access::share_published(&ids, &records)
}

/// Refuses a topic that a living process publishes; cleans up after a dead one.
fn refuse_living_publisher(
    service: &TopicService,
    camera: &CameraName,
    topic: Topic,
) -> Result<(), IpcError> {
    match publisher_of(service) {
        Some(publisher) if publisher.alive => {
            Err(IpcError::AlreadyPublished { camera: camera.clone(), topic, publisher })
        }
        Some(_) => {
            service.blocking_cleanup_dead_nodes(CLEAN_UP_TIMEOUT);
            Ok(())
        }
        None => Ok(()),
    }
}
