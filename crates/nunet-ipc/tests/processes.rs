//! Publishers and readers in processes of their own: the same memory, and what is left when they are killed.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod support;

use std::path::PathBuf;
use std::time::Duration;

use nunet_ipc::{
    CameraName, IpcError, IpcErrorKind, Limits, Publisher, Reader, Topic, TopicPlan, Wake, orphans,
};
use support::{
    HEIGHT, Sandbox, TIMEOUT, WIDTH, describe, eventually, listen, plan, publish_depth, role, say,
};

/// Not a test: what this binary does when [`Sandbox::spawn`] runs it in another process.
#[test]
fn peer() {
    let Some((role, argument)) = role() else { return };
    match role.as_str() {
        "own" => own(&argument),
        "fail to create" => match create(&argument).unwrap_err() {
            IpcError::AlreadyPublished { publisher, .. } => say(&publisher.pid.to_string()),
            error => panic!("{error}"),
        },
        "read" => read(&argument),
        "follow" => follow(&argument),
        "look once" => {
            Reader::open(&CameraName::new(&argument).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
            say("ready");
        }
        "wait for absent camera" => wait_for_absent_camera(&argument),
        "show a pointer" => show_a_pointer(&argument),
        "look at a pointer" => look_at_a_pointer(&argument),
        "publish everything of vga" => publish_everything_of_vga(&argument),
        "list orphans" => {
            say(&format!("{:?}", orphans::list().unwrap().iter().map(|o| o.pid).collect::<Vec<_>>()));
        }
        "clean" => say(&format!("{:?}", orphans::clean().unwrap())),
        other => panic!("no role `{other}`"),
    }
}

fn create(camera: &str) -> Result<Publisher, IpcError> {
    Publisher::create(&CameraName::new(camera).unwrap(), &[plan(Topic::Depth)], &Limits::default())
}

/// Publishes until the test ends it.
fn own(camera: &str) {
    let publisher = create(camera).unwrap();
    say("ready");
    for sequence in 0.. {
        publish_depth(&publisher, sequence);
        publisher.notify(Wake::Depth).unwrap();
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Reads until the test ends it, holding as many frames as it may.
fn read(camera: &str) {
    let mut reader = Reader::open(&CameraName::new(camera).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    say("ready");
    let mut held = Vec::new();
    loop {
        reader.wait(Duration::from_millis(20)).unwrap();
        if let Some(set) = reader.next_set().unwrap() {
            held.push(set);
            held.drain(..held.len() - 1);
        }
    }
}

/// Waits for a new frame whenever the test asks for one.
fn follow(camera: &str) {
    let reader = Reader::open(&CameraName::new(camera).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    say("ready");
    while !listen().is_empty() {
        while reader.latest(Topic::Depth).unwrap().is_some() {}
        eventually("a new frame", || reader.latest(Topic::Depth).unwrap());
        say("a new frame");
    }
}

/// Opens a camera that is never published again and again, as programs do that wait for one.
fn wait_for_absent_camera(camera: &str) {
    let camera = CameraName::new(camera).unwrap();
    for _ in 0..10 {
        let error = Reader::open(&camera, &[Topic::Depth], Duration::from_millis(20)).unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::NobodyPublishes, "{error}");
    }
    say("waited");
}

/// The location of an address: the file of its mapping, by inode, and the offset in it.
fn place_of<T>(pointer: *const T) -> String {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    for line in maps.lines() {
        let fields: Vec<_> = line.split_whitespace().collect();
        let (start, end) = fields[0].split_once('-').unwrap();
        let number = |text| usize::from_str_radix(text, 16).unwrap();
        if (number(start)..number(end)).contains(&pointer.addr()) {
            assert!(fields[5].starts_with("/dev/shm/"), "{line}");
            return format!(
                "inode {} offset {}",
                fields[4],
                pointer.addr() - number(start) + number(fields[2])
            );
        }
    }
    panic!("the address is not mapped");
}

fn show_a_pointer(camera: &str) {
    let publisher = create(camera).unwrap();
    say("ready");
    for sequence in 1..=20 {
        listen();
        let mut loan = publisher.loan(Topic::Depth).unwrap();
        describe(&mut loan, sequence);
        let depth = loan.slice_mut::<f32>().unwrap();
        depth.iter_mut().enumerate().for_each(|(index, cell)| *cell = (index as u64 * sequence) as f32);
        let place = place_of(depth.as_ptr());
        loan.publish(0).unwrap();
        say(&place);
    }
    listen();
}

fn look_at_a_pointer(camera: &str) {
    let reader = Reader::open(&CameraName::new(camera).unwrap(), &[Topic::Depth], TIMEOUT).unwrap();
    say("ready");
    for sequence in 1..=20 {
        let frame = eventually("a frame", || reader.latest(Topic::Depth).unwrap());
        assert_eq!(frame.header().sequence, sequence);
        let depth = frame.depth().unwrap();
        assert!(depth.iter().enumerate().all(|(index, cell)| *cell == (index as u64 * sequence) as f32));
        assert_eq!(depth.len(), WIDTH * HEIGHT);
        say(&place_of(depth.as_ptr()));
    }
}

fn publish_everything_of_vga(camera: &str) {
    let pixels = 640 * 480;
    let plans = [(Topic::Rgb, 3), (Topic::Depth, 4), (Topic::Labels, 1), (Topic::Cloud, 16)]
        .map(|(topic, bytes)| TopicPlan { topic, payload_bytes: pixels * bytes });
    let publisher = Publisher::create(&CameraName::new(camera).unwrap(), &plans, &Limits::default()).unwrap();
    say(&publisher.reservation().total_bytes().to_string());
    let faults_before = minor_faults();
    for _ in 0..100 {
        for plan in plans {
            let mut loan = publisher.loan(plan.topic).unwrap();
            loan.bytes_mut().fill(1);
            loan.publish(0).unwrap();
        }
    }
    say(&(minor_faults() - faults_before).to_string());
    let readers: Vec<_> = (0..2)
        .map(|_| Reader::open(publisher.camera(), &plans.map(|plan| plan.topic), TIMEOUT).unwrap())
        .collect();
    publisher.refresh().unwrap();
    assert!(readers.iter().all(|reader| reader.latest(Topic::Cloud).unwrap().is_some()));
    say("everything is in use");
    listen();
}

fn minor_faults() -> u64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap();
    let after_name = stat.rsplit_once(')').unwrap().1; // field 3 and on; minflt is field 10
    after_name.split_whitespace().nth(7).unwrap().parse().unwrap()
}

/// All that may remain in a sandbox after all processes ended: iceoryx2's counter of nodes, which it keeps on
/// purpose.
fn leftovers(sandbox: &Sandbox) -> Vec<PathBuf> {
    let shared = sandbox.shared_memory().into_iter().map(|(file, _)| file);
    let kept = |file: &PathBuf| file.to_string_lossy().ends_with(".global_mgmt");
    shared.filter(|file| !kept(file)).chain(sandbox.other_files()).collect()
}

#[test]
fn a_reader_in_another_process_maps_the_memory_that_the_publisher_filled() {
    let sandbox = Sandbox::new();
    let mut publisher = sandbox.spawn("peer", "show a pointer", "front");
    publisher.line();
    let mut reader = sandbox.spawn("peer", "look at a pointer", "front");
    reader.line();
    for _ in 0..20 {
        publisher.send_line("next");
        assert_eq!(publisher.line(), reader.line());
    }
    reader.finish();
    publisher.finish();
    assert_eq!(leftovers(&sandbox), Vec::<PathBuf>::new());
}

#[test]
fn a_camera_uses_no_more_shared_memory_than_it_reserved_and_touches_it_at_start() {
    let sandbox = Sandbox::new();
    let mut publisher = sandbox.spawn("peer", "publish everything of vga", "front");
    let reserved: u64 = publisher.line().parse().unwrap();
    let used_at_start: u64 = sandbox.shared_memory().iter().map(|(_, bytes)| bytes).sum();
    let faults: u64 = publisher.line().parse().unwrap();
    assert_eq!(publisher.line(), "everything is in use");
    let used: u64 = sandbox.shared_memory().iter().map(|(_, bytes)| bytes).sum();
    println!(
        "reserved {reserved}, at start {used_at_start}, in use {used}, {faults} minor faults in 400 frames"
    );
    assert!(used <= reserved, "{used} of {reserved} bytes: {:#?}", sandbox.shared_memory());
    assert!(used_at_start > reserved * 98 / 100, "{used_at_start} of {reserved} bytes");
    assert!(used_at_start > used * 99 / 100, "frames and readers needed {} bytes more", used - used_at_start);
    // 400 frames of 1.8 MB on average are 180 000 pages.
    assert!(faults < 1000, "{faults} pages were first touched by a frame");
    publisher.finish();
    assert_eq!(leftovers(&sandbox), Vec::<PathBuf>::new());
}

#[test]
fn a_second_publisher_gets_the_process_that_has_the_camera() {
    let sandbox = Sandbox::new();
    let mut first = sandbox.spawn("peer", "own", "front");
    first.line();
    let mut second = sandbox.spawn("peer", "fail to create", "front");
    assert_eq!(second.line(), first.pid().to_string());
}

#[test]
fn after_a_publisher_was_killed_the_next_one_serves_its_readers() {
    let sandbox = Sandbox::new();
    let mut first = sandbox.spawn("peer", "own", "front");
    first.line();
    let mut reader = sandbox.spawn("peer", "follow", "front");
    assert_eq!(reader.line(), "ready");
    first.kill();
    let mut second = sandbox.spawn("peer", "own", "front");
    assert_eq!(second.line(), "ready");
    reader.send_line("next");
    assert_eq!(reader.line(), "a new frame");
    reader.finish();
}

#[test]
fn dead_processes_are_listed_and_cleaned_up() {
    let sandbox = Sandbox::new();
    let mut publisher = sandbox.spawn("peer", "own", "front");
    publisher.line();
    publisher.kill();
    assert_eq!(sandbox.spawn("peer", "list orphans", "").line(), format!("[{}]", publisher.pid()));
    assert_ne!(leftovers(&sandbox), Vec::<PathBuf>::new());
    let mut cleaner = sandbox.spawn("peer", "clean", "");
    assert_eq!(cleaner.line(), "Cleaning { removed: 1, failed: 0 }");
    cleaner.finish();
    assert_eq!(leftovers(&sandbox), Vec::<PathBuf>::new());
}

#[test]
fn nothing_is_left_after_publishers_and_readers_were_killed_at_any_moment() {
    let sandbox = Sandbox::new();
    for round in 0..24_u64 {
        let mut publisher = sandbox.spawn("peer", "own", "front");
        let mut readers = [sandbox.spawn("peer", "read", "front"), sandbox.spawn("peer", "read", "front")];
        // From before the first service to the midst of the stream; spread evenly, so that a failure comes
        // again.
        std::thread::sleep(Duration::from_micros(round * 2700));
        if round % 3 != 0 {
            publisher.kill();
        }
        if round % 3 != 1 {
            readers.iter_mut().for_each(support::Peer::kill);
        }
    }
    let mut next = sandbox.spawn("peer", "show a pointer", "front");
    assert_eq!(next.line(), "ready", "the camera's name is usable again");
    let mut reader = sandbox.spawn("peer", "look at a pointer", "front");
    reader.line();
    for _ in 0..20 {
        next.send_line("next");
        assert_eq!(next.line(), reader.line());
    }
    reader.finish();
    next.finish();
    let left: Vec<_> = leftovers(&sandbox).into_iter().filter(|file| file.starts_with("/dev/shm")).collect();
    assert_eq!(left, Vec::<PathBuf>::new());
}

/// A node of iceoryx2 is a few files that are written, synced and removed: once is fine, ten times a second
/// is not.
#[test]
fn waiting_for_an_absent_publisher_creates_no_files() {
    let sandbox = Sandbox::new();
    let mut other = sandbox.spawn("peer", "own", "other");
    assert_eq!(other.line(), "ready");
    let nodes = sandbox.root().join("nodes");
    let changed = || std::fs::metadata(&nodes).unwrap().modified().unwrap();
    let before = changed();
    assert_eq!(sandbox.spawn("peer", "wait for absent camera", "absent").line(), "waited");
    assert_eq!(changed(), before, "a node was created or removed");
    assert_eq!(sandbox.spawn("peer", "look once", "other").line(), "ready");
    assert_ne!(changed(), before, "opening what is there does create one");
}
