//! What the tests of this crate share: cameras of their own, small plans, and other processes.
#![allow(dead_code, reason = "each test binary uses its own part of this")]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test may stop at the first thing that is wrong"
)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use nunet_ipc::{CameraName, Encoding, Limits, Loan, Publisher, Topic, TopicPlan, Units};

/// Long enough for any machine; nothing waits for it unless the test fails.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(30);

/// Pixels of the test frames.
pub(crate) const WIDTH: usize = 32;
/// Rows of the test frames.
pub(crate) const HEIGHT: usize = 24;

/// The root of all tests of this user.
pub(crate) fn private_root() -> PathBuf {
    let root = nunet_testkit::ipc_root();
    nunet_ipc::use_root(&root).unwrap();
    root
}

/// A camera name in the private root that no other test, of this or another process, uses.
pub(crate) fn camera() -> CameraName {
    private_root();
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    let number = COUNTER.fetch_add(1, Ordering::Relaxed);
    CameraName::new(&format!("test-{}-{number}", std::process::id())).unwrap()
}

/// The planned size of a test frame's topic.
pub(crate) fn plan(topic: Topic) -> TopicPlan {
    let pixel_bytes = match topic {
        Topic::Rgb => 3,
        Topic::Depth => 4,
        Topic::Cloud => 16,
        _ => 1,
    };
    TopicPlan { topic, payload_bytes: WIDTH * HEIGHT * pixel_bytes }
}

/// A publisher of small frames with the default limits.
pub(crate) fn publisher(camera: &CameraName, topics: &[Topic]) -> Publisher {
    let plans: Vec<_> = topics.iter().map(|topic| plan(*topic)).collect();
    Publisher::create(camera, &plans, &Limits::default()).unwrap()
}

/// Publishes a depth map whose every pixel is the frame's number.
pub(crate) fn publish_depth(publisher: &Publisher, sequence: u64) {
    let mut loan = publisher.loan(Topic::Depth).unwrap();
    describe(&mut loan, sequence);
    loan.slice_mut::<f32>().unwrap().fill(sequence as f32);
    loan.publish(0).unwrap();
}

/// Fills in the fields that all headers of depth maps have.
pub(crate) fn describe(loan: &mut Loan, sequence: u64) {
    let header = loan.header_mut();
    header.sequence = sequence;
    header.width = WIDTH as u32;
    header.height = HEIGHT as u32;
    header.row_stride_bytes = header.width * 4;
    header.set_encoding(Encoding::DepthF32);
    header.set_units(Units::Metre);
}

/// Polls until something is there.
pub(crate) fn eventually<T>(what: &str, mut poll: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = poll() {
            return found;
        }
        assert!(start.elapsed() < TIMEOUT, "{what} did not happen");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A folder with its own iceoryx2 root: processes that run in it share services with each other only, not
/// with anything else, so that what they leave behind can be counted.
pub(crate) struct Sandbox {
    folder: tempfile::TempDir,
    prefix: String,
}

impl Sandbox {
    pub(crate) fn new() -> Self {
        static COUNTER: AtomicU32 = AtomicU32::new(0);
        let prefix = format!("nunet_{}_{}_", std::process::id(), COUNTER.fetch_add(1, Ordering::Relaxed));
        let folder = tempfile::tempdir().unwrap();
        let config = folder.path().join("config");
        std::fs::create_dir(&config).unwrap();
        let root = folder.path().join("iceoryx2");
        let text = format!("[global]\nprefix = \"{prefix}\"\nroot-path = \"{}\"\n", root.display());
        std::fs::write(config.join("iceoryx2.toml"), text).unwrap();
        Self { folder, prefix }
    }

    /// The folder of iceoryx2's files.
    pub(crate) fn root(&self) -> PathBuf {
        self.folder.path().join("iceoryx2")
    }

    /// Runs a role of this test binary (see [`role`]) in another process.
    pub(crate) fn spawn(&self, test: &str, role: &str, argument: &str) -> Peer {
        let child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", test, "--nocapture"])
            .env(ROLE, role)
            .env(ARGUMENT, argument)
            .env_remove(nunet_ipc::ROOT_VARIABLE)
            .current_dir(self.folder.path())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        Peer::new(child)
    }

    /// Files in `/dev/shm` that belong to this sandbox, with the bytes they really take.
    pub(crate) fn shared_memory(&self) -> Vec<(PathBuf, u64)> {
        use std::os::unix::fs::MetadataExt;
        let entries = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let ours = entries.filter(|entry| entry.file_name().to_string_lossy().starts_with(&self.prefix));
        ours.filter_map(|entry| Some((entry.path(), entry.metadata().ok()?.blocks() * 512))).collect()
    }

    /// Files of iceoryx2's own, outside of shared memory.
    pub(crate) fn other_files(&self) -> Vec<PathBuf> {
        fn walk(folder: &Path, found: &mut Vec<PathBuf>) {
            for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
                match entry.file_type() {
                    Ok(kind) if kind.is_dir() => walk(&entry.path(), found),
                    _ => found.push(entry.path()),
                }
            }
        }
        let mut found = Vec::new();
        walk(&self.root(), &mut found);
        found
    }
}

impl Drop for Sandbox {
    fn drop(&mut self) {
        for (file, _) in self.shared_memory() {
            let _ = std::fs::remove_file(file); // a failed test must not fill the machine's memory
        }
    }
}

const ROLE: &str = "NUNET_IPC_TEST_ROLE";
const ARGUMENT: &str = "NUNET_IPC_TEST_ARGUMENT";

/// The role that this process was started for, with its argument; `None` in the test itself.
pub(crate) fn role() -> Option<(String, String)> {
    Some((std::env::var(ROLE).ok()?, std::env::var(ARGUMENT).unwrap_or_default()))
}

/// Prints a line for the test to read with [`Peer::line`].
pub(crate) fn say(line: &str) {
    println!("{PREFIX}{line}");
}

/// Waits until the test says something, or is gone.
pub(crate) fn listen() -> String {
    let mut line = String::new();
    std::io::stdin().read_line(&mut line).unwrap();
    line.trim_end().to_owned()
}

const PREFIX: &str = "peer says: ";

/// Another process; killed when dropped.
pub(crate) struct Peer {
    child: Child,
    output: std::io::BufReader<std::process::ChildStdout>,
}

impl Peer {
    fn new(mut child: Child) -> Self {
        let output = std::io::BufReader::new(child.stdout.take().unwrap());
        Self { child, output }
    }

    /// The next line that the role printed.
    pub(crate) fn line(&mut self) -> String {
        use std::io::BufRead;
        loop {
            let mut line = String::new();
            assert_ne!(self.output.read_line(&mut line).unwrap(), 0, "the other process ended");
            if let Some((_, line)) = line.trim_end().split_once(PREFIX) {
                return line.to_owned();
            }
        }
    }

    pub(crate) fn send_line(&mut self, line: &str) {
        use std::io::Write;
        writeln!(self.child.stdin.as_mut().unwrap(), "{line}").unwrap();
    }

    pub(crate) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// SIGKILL, and waits until it is gone.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Waits for a good end.
    pub(crate) fn finish(&mut self) {
        drop(self.child.stdin.take());
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
