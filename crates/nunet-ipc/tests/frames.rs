//! Publishers and readers: which frames a reader receives, and that no process can block another.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod support;

use std::time::Duration;

use nunet_ipc::{
    CameraName, IpcError, IpcErrorKind, Limits, Message, Process, Publisher, Reader, StatsRecord, Topic,
    TopicPlan, Wake, cameras,
};
use support::{HEIGHT, TIMEOUT, WIDTH, camera, eventually, plan, publish_depth, publisher};

const SHORT: Duration = Duration::from_millis(50);

fn depth_reader(camera: &CameraName) -> Reader {
    Reader::open(camera, &[Topic::Depth], TIMEOUT).unwrap()
}

fn latest(reader: &Reader) -> Message {
    eventually("a frame", || reader.latest(Topic::Depth).unwrap())
}

#[test]
fn a_published_frame_arrives_as_it_was_filled() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    publish_depth(&publisher, 7);
    let frame = latest(&reader);
    assert_eq!(frame.header().sequence, 7);
    assert_eq!(frame.depth().unwrap(), [7.0; WIDTH * HEIGHT]);
    assert!(frame.bytes().as_ptr().addr().is_multiple_of(64));
}

#[test]
fn frames_and_readers_can_move_to_another_thread() {
    fn send<T: Send>() {}
    send::<Message>();
    send::<Reader>();
    send::<Publisher>();
    send::<nunet_ipc::Loan>();
}

#[test]
fn a_late_subscriber_receives_the_last_frame_of_a_paused_source() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    publish_depth(&publisher, 1);
    publish_depth(&publisher, 2);
    let reader = depth_reader(&camera);
    publisher.refresh().unwrap(); // as a timer would
    assert_eq!(latest(&reader).header().sequence, 2);
}

#[test]
fn a_slow_reader_gets_the_newest_frame_and_delays_nobody() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let (slow, fast) = (depth_reader(&camera), depth_reader(&camera));
    for sequence in 0..1000 {
        publish_depth(&publisher, sequence);
        publisher.notify(Wake::Depth).unwrap(); // nor do wake-ups block that no reader handles
        assert_eq!(latest(&fast).header().sequence, sequence);
    }
    assert_eq!(latest(&slow).header().sequence, 999);
    assert!(slow.latest(Topic::Depth).unwrap().is_none());
}

#[test]
fn readers_that_never_release_frames_block_neither_the_publisher_nor_others() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let limits = Limits::default();
    let mut holding_readers = Vec::new();
    for _ in 0..limits.max_readers - 1 {
        holding_readers.push((depth_reader(&camera), Vec::new()));
    }
    let releasing = depth_reader(&camera);
    for sequence in 0..100 {
        publish_depth(&publisher, sequence); // panics when there is no free chunk
        for (reader, held) in &mut holding_readers {
            if held.len() < limits.max_held_frames && sequence % 3 == 0 {
                held.push(latest(reader));
            }
        }
        assert_eq!(latest(&releasing).depth().unwrap()[0], sequence as f32);
    }
    for (reader, held) in &holding_readers {
        assert_eq!(held[0].depth().unwrap()[0], 0.0, "a held frame must not change");
        assert_eq!(held[1].depth().unwrap()[0], 3.0, "a held frame must not change");
        let error = reader.latest(Topic::Depth).unwrap_err();
        assert!(matches!(error, IpcError::TooManyFramesHeld { topic: Topic::Depth, limit: 2 }), "{error}");
    }
}

proptest::proptest! {
    #![proptest_config(proptest::prelude::ProptestConfig { cases: 8, failure_persistence: None, ..Default::default() })]

    /// The bound of `Limits::chunks_of` is lower than iceoryx2's own: here readers open, hold, release and
    /// close in any order, and the publisher must still find a free chunk for every frame.
    #[test]
    fn a_loan_always_succeeds_independent_of_readers(actions in proptest::collection::vec((0_usize..4, 0_u8..6), 200)) {
        let camera = camera();
        let publisher = publisher(&camera, &[Topic::Depth]);
        let mut readers: [Option<Reader>; 4] = std::array::from_fn(|_| None);
        let mut held: [Vec<Message>; 4] = Default::default();
        let max_held_frames = Limits::default().max_held_frames;
        for (sequence, (who, action)) in actions.into_iter().enumerate() {
            match (action, &readers[who]) {
                (0, None) => readers[who] = Some(depth_reader(&camera)),
                (1, Some(_)) => {
                    held[who].clear(); // a frame keeps its reader's place in the service
                    readers[who] = None;
                }
                (2 | 3, Some(reader)) => match reader.latest(Topic::Depth) {
                    Ok(frame) => held[who].extend(frame),
                    Err(error) => {
                        let is_refusal = matches!(error, IpcError::TooManyFramesHeld { .. });
                        assert!(is_refusal && held[who].len() == max_held_frames, "{error}");
                    }
                },
                (4, Some(_)) if !held[who].is_empty() => drop(held[who].remove(0)),
                _ => {}
            }
            publish_depth(&publisher, sequence as u64); // panics when there is no free chunk
        }
    }
}

#[test]
fn a_reader_that_held_all_its_frames_continues_with_the_newest_after_a_release() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    let max_held_frames = Limits::default().max_held_frames;
    let mut held = Vec::new();
    for sequence in 0..max_held_frames as u64 {
        publish_depth(&publisher, sequence);
        held.push(latest(&reader));
    }
    for more in 0..3 {
        publish_depth(&publisher, 100 + more);
        let error = reader.latest(Topic::Depth).unwrap_err();
        let IpcError::TooManyFramesHeld { topic: Topic::Depth, limit } = error else { panic!("{error}") };
        assert_eq!(limit, max_held_frames);
    }
    held.remove(0);
    assert_eq!(latest(&reader).header().sequence, 102);
}

#[test]
fn a_second_publisher_of_the_same_camera_is_refused_by_name() {
    let camera = camera();
    let first = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    let error = Publisher::create(&camera, &[plan(Topic::Depth)], &Limits::default()).unwrap_err();
    assert_eq!(error.kind(), IpcErrorKind::AlreadyPublished);
    let this_process = Process { pid: std::process::id(), alive: true };
    assert!(
        matches!(
            &error,
            IpcError::AlreadyPublished { camera: taken, topic: Topic::Depth, publisher }
                if (taken, *publisher) == (&camera, this_process)
        ),
        "{error}"
    );
    publish_depth(&first, 1); // unharmed
    assert_eq!(latest(&reader).header().sequence, 1);
}

#[test]
fn a_camera_and_a_daemon_share_a_name_with_different_topics() {
    let camera = camera();
    let _camera_driver = publisher(&camera, &[Topic::Rgb]);
    let daemon = publisher(&camera, &[Topic::Depth, Topic::Labels]);
    assert!(matches!(daemon.loan(Topic::Rgb), Err(IpcError::NoSuchTopic { topic: Topic::Rgb, .. })));
}

#[test]
fn a_reader_continues_with_the_next_publisher_of_its_camera() {
    let camera = camera();
    let first = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    publish_depth(&first, 41);
    assert_eq!(latest(&reader).header().sequence, 41);
    assert!(reader.is_connected());
    drop(first);
    assert!(!reader.is_connected());
    assert_eq!(reader.publisher(Topic::Depth).unwrap(), None);
    let second = publisher(&camera, &[Topic::Depth]);
    publish_depth(&second, 1);
    assert_eq!(latest(&reader).header().sequence, 1);
    assert!(reader.is_connected());
}

#[test]
fn a_frame_outlives_its_reader_and_its_publisher() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    publish_depth(&publisher, 5);
    let frame = latest(&reader);
    drop(reader);
    (6..40).for_each(|sequence| publish_depth(&publisher, sequence)); // every chunk comes round
    assert_eq!(frame.depth().unwrap(), [5.0; WIDTH * HEIGHT]);
    drop(publisher);
    assert_eq!(frame.depth().unwrap(), [5.0; WIDTH * HEIGHT]);
}

#[test]
fn one_reader_more_than_planned_is_refused() {
    let camera = camera();
    let _publisher = publisher(&camera, &[Topic::Depth]);
    let readers: Vec<_> = (0..Limits::default().max_readers).map(|_| depth_reader(&camera)).collect();
    let error = Reader::open(&camera, &[Topic::Depth], SHORT).unwrap_err();
    assert!(matches!(error, IpcError::TooManyReaders { limit: 4, .. }), "{error}");
    drop(readers);
    depth_reader(&camera);
}

#[test]
fn a_camera_that_nobody_publishes_is_an_error_after_the_timeout() {
    let error = Reader::open(&camera(), &[Topic::Depth], SHORT).unwrap_err();
    assert!(matches!(error, IpcError::NobodyPublishes { .. }), "{error}");
}

#[test]
fn cameras_are_listed_by_topic_while_a_living_process_publishes_them() {
    let (depth, images) = (camera(), camera());
    let of_depth = publisher(&depth, &[Topic::Depth]);
    let _of_images = publisher(&images, &[Topic::Rgb]);
    let has = |topic, camera: &CameraName| cameras::list(topic).unwrap().contains(camera);
    assert!(has(Topic::Depth, &depth) && has(Topic::Rgb, &images));
    assert!(!has(Topic::Rgb, &depth) && !has(Topic::Depth, &images));
    let _reader = depth_reader(&depth);
    drop(of_depth);
    assert!(!has(Topic::Depth, &depth), "a reader that waits keeps the service, not the camera");
}

#[test]
fn a_reader_may_start_before_the_publisher() {
    let camera = camera();
    let name = camera.clone();
    let waiting = std::thread::spawn(move || depth_reader(&name));
    std::thread::sleep(SHORT);
    let _publisher = publisher(&camera, &[Topic::Depth]);
    assert!(waiting.join().unwrap().is_connected());
}

#[test]
fn a_sleeping_reader_is_woken_by_its_own_topics_only() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Rgb, Topic::Depth]);
    let reader = depth_reader(&camera);
    while reader.wait(SHORT).unwrap() {} // whatever was left of the publisher's coming
    publisher.notify(Wake::Image).unwrap();
    assert!(!reader.wait(SHORT).unwrap());
    publisher.notify(Wake::Depth).unwrap();
    assert!(reader.wait(TIMEOUT).unwrap());
}

#[test]
fn a_publisher_that_closes_wakes_its_readers() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    drop(publisher);
    assert!(reader.wait(TIMEOUT).unwrap());
}

#[test]
fn a_set_is_complete_when_every_topic_has_the_same_sequence_and_time_of_capture() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Labels, Topic::Depth]);
    let mut reader = Reader::open(&camera, &[Topic::Depth, Topic::Labels], TIMEOUT).unwrap();
    let labels = |sequence| {
        let mut loan = publisher.loan(Topic::Labels).unwrap();
        loan.header_mut().sequence = sequence;
        loan.publish(0).unwrap();
    };
    labels(1);
    assert!(reader.next_set().unwrap().is_none(), "depth is missing");
    publish_depth(&publisher, 1);
    let first = reader.next_set().unwrap().unwrap();
    labels(2); // its depth never comes
    assert!(reader.next_set().unwrap().is_none());
    labels(3);
    publish_depth(&publisher, 3);
    let second = reader.next_set().unwrap().unwrap(); // while the first is still held
    let sequences =
        |set: &nunet_ipc::FrameSet| set.iter().map(|frame| frame.header().sequence).collect::<Vec<_>>();
    assert_eq!((sequences(&first), sequences(&second)), (vec![1, 1], vec![3, 3]));
    assert!(second.get(Topic::Cloud).is_none());
}

/// Not every publisher counts its images, and one that begins again counts from 0.
#[test]
fn frames_with_one_sequence_and_other_capture_times_are_no_set() {
    let camera = camera();
    let (driver, daemon) =
        (publisher(&camera, &[Topic::Rgb]), publisher(&camera, &[Topic::Labels, Topic::Depth]));
    let publish = |publisher: &Publisher, topic, capture_nanos| {
        let mut loan = publisher.loan(topic).unwrap();
        loan.header_mut().sequence = 7;
        loan.header_mut().capture_nanos = capture_nanos;
        loan.publish(0).unwrap();
    };
    let times = |reader: &mut Reader| {
        let set = reader.next_set().unwrap();
        set.map(|set| set.iter().map(|frame| frame.header().capture_nanos).collect::<Vec<_>>())
    };
    let mut results = Reader::open(&camera, &[Topic::Depth, Topic::Labels], TIMEOUT).unwrap();
    let mut all = Reader::open(&camera, &[Topic::Rgb, Topic::Depth, Topic::Labels], TIMEOUT).unwrap();
    publish(&driver, Topic::Rgb, 100);
    publish(&daemon, Topic::Labels, 100);
    publish(&daemon, Topic::Depth, 200);
    assert_eq!((times(&mut results), times(&mut all)), (None, None));
    publish(&driver, Topic::Rgb, 200);
    publish(&daemon, Topic::Labels, 200);
    assert_eq!(times(&mut results), Some(vec![200, 200]));
    assert_eq!(times(&mut all), Some(vec![200, 200, 200]));
    // A image is kept for its depth, although the next one has the same number.
    publish(&driver, Topic::Rgb, 300);
    assert_eq!(times(&mut all), None);
    publish(&driver, Topic::Rgb, 400);
    publish(&daemon, Topic::Labels, 300);
    publish(&daemon, Topic::Depth, 300);
    assert_eq!(times(&mut all), Some(vec![300, 300, 300]));
}

#[test]
fn results_are_joined_with_their_image_although_the_camera_is_ahead() {
    let camera = camera();
    let (driver, daemon) = (publisher(&camera, &[Topic::Rgb]), publisher(&camera, &[Topic::Depth]));
    let mut reader = Reader::open(&camera, &[Topic::Rgb, Topic::Depth], TIMEOUT).unwrap();
    let image = |sequence| {
        let mut loan = driver.loan(Topic::Rgb).unwrap();
        loan.header_mut().sequence = sequence;
        loan.publish(0).unwrap();
    };
    let sequences = |set: Option<nunet_ipc::FrameSet>| {
        set.map(|set| set.iter().map(|frame| frame.header().sequence).collect::<Vec<_>>())
    };
    image(1);
    assert_eq!(sequences(reader.next_set().unwrap()), None);
    image(2);
    assert_eq!(sequences(reader.next_set().unwrap()), None, "image 1 is kept for its depth");
    publish_depth(&daemon, 1);
    assert_eq!(sequences(reader.next_set().unwrap()), Some(vec![1, 1]));

    assert_eq!(sequences(reader.next_set().unwrap()), None, "image 2 is kept");
    image(3);
    publish_depth(&daemon, 3); // image 2 was passed over
    assert_eq!(sequences(reader.next_set().unwrap()), Some(vec![3, 3]));

    image(9);
    assert_eq!(sequences(reader.next_set().unwrap()), None);
    image(0); // the camera restarts
    publish_depth(&daemon, 0);
    assert_eq!(sequences(reader.next_set().unwrap()), Some(vec![0, 0]));
}

#[test]
fn demand_is_visible_to_the_publisher() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth, Topic::Labels]);
    assert!(!publisher.has_readers(Topic::Depth));
    let reader = depth_reader(&camera);
    assert!(publisher.has_readers(Topic::Depth));
    assert!(!publisher.has_readers(Topic::Labels));
    drop(reader);
    assert!(!publisher.has_readers(Topic::Depth));
}

#[test]
fn a_view_of_the_wrong_kind_is_refused() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    publish_depth(&publisher, 1);
    let frame = latest(&reader);
    assert!(matches!(frame.labels(), Err(IpcError::WrongEncoding { .. })));
    assert!(matches!(frame.points(), Err(IpcError::WrongEncoding { .. })));
    assert!(matches!(frame.stats(), Err(IpcError::WrongEncoding { .. })));
}

#[test]
fn a_header_that_contradicts_its_payload_is_refused() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    let mut loan = publisher.loan(Topic::Depth).unwrap();
    support::describe(&mut loan, 1);
    loan.header_mut().height += 1;
    loan.publish(0).unwrap();
    let frame = latest(&reader);
    assert!(matches!(frame.depth(), Err(IpcError::BadMessage { .. })));
}

#[test]
fn a_negative_capture_time_is_not_sent() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    for nanos in [-1, i64::MIN] {
        let mut loan = publisher.loan(Topic::Depth).unwrap();
        support::describe(&mut loan, 1);
        loan.header_mut().capture_nanos = nanos;
        let error = loan.publish(0).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::Argument, "{error}");
    }
    assert!(reader.latest(Topic::Depth).unwrap().is_none());
    publish_depth(&publisher, 2); // at 0
    assert_eq!(latest(&reader).header().sequence, 2);
}

#[test]
fn statistics_travel_as_a_record() {
    let camera = camera();
    let plan = TopicPlan { topic: Topic::Stats, payload_bytes: size_of::<StatsRecord>() };
    let publisher = Publisher::create(&camera, &[plan], &Limits::default()).unwrap();
    let reader = Reader::open(&camera, &[Topic::Stats], TIMEOUT).unwrap();
    let mut loan = publisher.loan(Topic::Stats).unwrap();
    loan.header_mut().set_encoding(nunet_ipc::Encoding::StatsRecord);
    loan.slice_mut::<StatsRecord>().unwrap()[0] =
        StatsRecord { captured: 3, published: 2, ..Default::default() };
    loan.publish(0).unwrap();
    let frame = reader.latest(Topic::Stats).unwrap().unwrap();
    assert_eq!(frame.stats().unwrap().captured, 3);
}

#[test]
fn more_bytes_than_planned_are_refused_and_fewer_are_not() {
    let camera = camera();
    let publisher = publisher(&camera, &[Topic::Depth]);
    let planned = plan(Topic::Depth).payload_bytes;
    assert!(matches!(publisher.loan_bytes(Topic::Depth, planned + 1), Err(IpcError::PayloadTooLarge { .. })));
    assert_eq!(publisher.loan_bytes(Topic::Depth, 10).unwrap().bytes_mut().len(), 10);
}

#[test]
fn a_lack_of_memory_is_refused_before_anything_is_reserved() {
    let camera = camera();
    let error =
        Publisher::create_within(&camera, &[plan(Topic::Depth)], &Limits::default(), 1000).unwrap_err();
    assert!(matches!(error, IpcError::SharedMemoryTooSmall { free_bytes: 1000, .. }), "{error}");
    publisher(&camera, &[Topic::Depth]); // and nothing is in the way of a smaller one
}

#[test]
fn a_publisher_with_other_limits_cannot_take_over_services_that_readers_keep_open() {
    let camera = camera();
    let first = publisher(&camera, &[Topic::Depth]);
    let reader = depth_reader(&camera);
    drop(first);
    let limited = |max_readers| Limits { max_readers, ..Limits::default() };
    for limits in [limited(2), limited(9), Limits { max_held_frames: 3, ..Limits::default() }] {
        let error = Publisher::create(&camera, &[plan(Topic::Depth)], &limits).unwrap_err();
        assert!(matches!(error, IpcError::OtherLimits { .. }), "{limits:?}: {error}");
    }
    drop(reader);
    Publisher::create(&camera, &[plan(Topic::Depth)], &limited(9)).unwrap();
}

#[test]
fn a_publisher_with_other_limits_gets_the_running_publisher_in_its_error() {
    let camera = camera();
    let _publisher = publisher(&camera, &[Topic::Depth]);
    for max_readers in [2, 9] {
        let limits = Limits { max_readers, ..Limits::default() };
        let error = Publisher::create(&camera, &[plan(Topic::Depth)], &limits).unwrap_err();
        assert!(matches!(error, IpcError::AlreadyPublished { .. }), "{max_readers}: {error}");
    }
}

#[test]
fn a_publisher_that_waits_for_the_creation_lock_can_be_canceled() {
    let camera = camera();
    drop(publisher(&camera, &[Topic::Depth])); // the folder is there from now on
    let folder = std::fs::File::open(nunet_ipc::root()).unwrap();
    folder.lock().unwrap();
    let asked = std::cell::Cell::new(0);
    let third_time = || asked.replace(asked.get() + 1) == 2;
    let refused = Publisher::create_unless(&camera, &[plan(Topic::Depth)], &Limits::default(), &third_time);
    drop(folder);
    assert!(matches!(refused, Err(IpcError::Locked { .. })));
    assert_eq!(asked.get(), 3, "it waited until then");
    let again = Publisher::create_unless(&camera, &[plan(Topic::Depth)], &Limits::default(), &|| false);
    assert!(again.is_ok(), "nothing is left of the first try");
}
