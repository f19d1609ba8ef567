//! The binary under test, with a world of its own around it.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use nunet_mcap::{DepthRecord, EncodedImage, FrameRecord, RecordingWriter, ScaleRecord, WriterOptions};
use nunet_testkit::demo::DemoScene;
use nunet_testkit::models;
use nunet_testkit::onnx::ModelBuilder;

/// No test waits longer for anything.
pub(crate) const TIMEOUT: Duration = Duration::from_secs(60);

/// Width and height of the demo scene, which is that of the test networks too.
pub(crate) const SIZE: (u32, u32) = (640, 480);

/// The folder of the shared memory of these tests.
pub(crate) fn ipc_root() -> &'static Path {
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| {
        let root = nunet_testkit::ipc_root();
        nunet_ipc::use_root(&root).unwrap();
        root
    })
}

/// `nunetd` with the library and the models of this checkout, a cache and shared memory of its own, and no
/// colors.
pub(crate) fn nunetd(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_nunetd"));
    command.args(arguments).stdin(Stdio::null()).env("NO_COLOR", "1");
    command.env(nunet_ipc::ROOT_VARIABLE, ipc_root());
    command.env("ORT_DYLIB_PATH", nunet_testkit::runtime_library());
    command.env("XDG_CACHE_HOME", Path::new(env!("CARGO_TARGET_TMPDIR")).join("cache"));
    command.env("NUNET_MODELS", repository().join("models/tiny"));
    command
}

/// Runs to the end, within [`TIMEOUT`].
pub(crate) fn run(command: Command) -> Output {
    run_into(command, Stdio::piped())
}

/// The same with another stdout.
pub(crate) fn run_into(mut command: Command, stdout: Stdio) -> Output {
    let child = command.stdout(stdout).stderr(Stdio::piped()).spawn().unwrap();
    let pid = child.id();
    let (sender, receiver) = std::sync::mpsc::channel();
    std::thread::spawn(move || sender.send(child.wait_with_output().unwrap()));
    receiver.recv_timeout(TIMEOUT).unwrap_or_else(|_| {
        signal(pid, "KILL");
        panic!("{command:?} did not end within {TIMEOUT:?}")
    })
}

/// Runs to the end and asks for exit code 0.
pub(crate) fn run_well(command: Command) -> Output {
    let shown = format!("{command:?}");
    let output = run(command);
    assert_eq!(output.status.code(), Some(0), "{shown}\n{}", text(&output.stderr));
    output
}

/// Exit code and stderr of a command that has no results, with the places of this run replaced.
pub(crate) fn outcome(bench: &Bench, command: Command) -> String {
    let output = run(command);
    assert!(output.stdout.is_empty(), "stdout is data: {}", text(&output.stdout));
    seen(bench, &output)
}

/// Exit code and stderr, with the places of this run replaced.
pub(crate) fn seen(bench: &Bench, output: &Output) -> String {
    let stderr = bench.redact(&text(&output.stderr));
    let code = output.status.code().map_or("none".to_owned(), |code| code.to_string());
    format!("exit code {code}\n{}", stderr.trim_end())
}

/// Compares with the file in `snapshots/` that has the test's name. Only names of cameras, hashes, times and
/// the last digits of numbers may differ.
macro_rules! snapshot {
    ($outcome:expr) => {
        insta::with_settings!({
            filters => vec![
                (r"bad_(model|arguments)_\d+_\d+", "[CAMERA]"),
                (r"[0-9a-f]{64}", "[HASH]"),
                (r"\b\d+\.\d{9,}", "[NUMBER]"),
                (r"\b\d{4}-\d\d-\d\dT[\d:.]+Z", "[TIME]"),
            ],
            prepend_module_to_snapshot => false,
            omit_expression => true,
            snapshot_path => std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/snapshots"),
        }, { insta::assert_snapshot!($outcome) })
    };
}
pub(crate) use snapshot;

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A `camera_info` file of ROS: a camera of `fx, fy, cx, cy` at a size, and its lens.
pub(crate) fn calibration(
    (width, height): (u32, u32),
    [fx, fy, cx, cy]: [f64; 4],
    model: &str,
    lens: &[f64],
) -> String {
    let cols = lens.len();
    format!(
        "image_width: {width}\nimage_height: {height}\ncamera_name: test\ncamera_matrix:\n  rows: 3\n  cols: 3\n  \
         data: [{fx}, 0, {cx}, 0, {fy}, {cy}, 0, 0, 1]\ndistortion_model: {model}\ndistortion_coefficients:\n  \
         rows: 1\n  cols: {cols}\n  data: {lens:?}\n"
    )
}

/// The root of the checkout.
pub(crate) fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// A camera's name that no other test has.
pub(crate) fn camera(test: &str) -> String {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    ipc_root();
    format!("{test}_{}_{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed))
}

pub(crate) fn signal(pid: u32, name: &str) {
    let sent = Command::new("kill").args([format!("-{name}"), pid.to_string()]).status().unwrap();
    assert!(sent.success(), "kill -{name} {pid}");
}

/// Waits until `wanted` gives something, at most [`TIMEOUT`].
pub(crate) fn wait_for<T>(what: &str, mut wanted: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = wanted() {
            return found;
        }
        assert!(start.elapsed() < TIMEOUT, "{what} did not come within {TIMEOUT:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// A process that ends with the test, whatever the test does.
pub(crate) struct Guarded(Child);

impl Guarded {
    pub(crate) fn start(mut command: Command) -> Self {
        Self(command.spawn().unwrap())
    }

    pub(crate) fn pid(&self) -> u32 {
        self.0.id()
    }

    /// Waits for its end and returns the exit code; `None` after a signal.
    pub(crate) fn wait(&mut self) -> Option<i32> {
        let end = format!("the end of process {}", self.pid());
        wait_for(&end, || self.0.try_wait().unwrap()).code()
    }

    /// Asks it to end, waits for that and returns the exit code.
    pub(crate) fn stop(&mut self) -> Option<i32> {
        signal(self.pid(), "TERM");
        self.wait()
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        // Fails after the process has ended, as expected.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Drop for Bench {
    /// Removes the shared memory of this bench: after its folder is gone, no process could clean it up.
    fn drop(&mut self) {
        for file in self.shared_memory() {
            let _ = std::fs::remove_file(file);
        }
    }
}

/// A folder with a model, whose depth is 0.5 + (r + 2g + 3b) / 64 meters and whose labels are the brightest
/// channel.
pub(crate) struct Bench {
    folder: tempfile::TempDir,
    /// How the files of its own shared memory begin, where it has one.
    prefix: OnceLock<String>,
}

impl Bench {
    pub(crate) fn new() -> Self {
        let bench = Self { folder: tempfile::tempdir().unwrap(), prefix: OnceLock::new() };
        bench.add_model("model.onnx", &models::wnet(SIZE, true));
        bench
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The same as text, for arguments.
    pub(crate) fn arg(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().to_owned()
    }

    /// The text with the places of this run replaced.
    pub(crate) fn redact(&self, text: &str) -> String {
        let folder = self.path("");
        let library = nunet_testkit::runtime_library();
        text.replace(folder.to_str().unwrap().trim_end_matches('/'), "[DIR]")
            .replace(library.to_str().unwrap(), "[LIBRARY]")
            .replace(env!("CARGO_TARGET_TMPDIR"), "[CACHE]")
    }

    /// Lets a command see the shared memory of this bench only.
    pub(crate) fn enclose(&self, command: &mut Command) {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        self.prefix.get_or_init(|| {
            let prefix =
                format!("nunetbench{}x{}_", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
            let config = format!("[global]\nroot-path = \"{}\"\nprefix = \"{prefix}\"\n", self.arg("shared"));
            std::fs::create_dir_all(self.path("config")).unwrap();
            std::fs::write(self.path("config/iceoryx2.toml"), config).unwrap();
            prefix
        });
        command.current_dir(self.path("")).env_remove(nunet_ipc::ROOT_VARIABLE);
    }

    /// The files of this bench's own shared memory.
    pub(crate) fn shared_memory(&self) -> Vec<PathBuf> {
        let Some(prefix) = self.prefix.get() else { return Vec::new() };
        let files = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let own = files.filter(|file| file.file_name().to_string_lossy().starts_with(prefix.as_str()));
        own.map(|file| file.path()).collect()
    }

    /// The depth map in a folder of results.
    pub(crate) fn depth(&self, folder: &str) -> Vec<f32> {
        let file = std::fs::read(self.path(folder).join("depth.npy")).unwrap();
        let depth = npyz::NpyFile::new(&file[..]).unwrap();
        assert_eq!(depth.shape(), [u64::from(SIZE.1), u64::from(SIZE.0)]);
        depth.into_vec().unwrap()
    }

    /// Saves a recording of images of one color, each with depth of one value in meters (32FC1), at these
    /// times. Without a color there is depth only.
    pub(crate) fn add_recording(
        &self,
        name: &str,
        frames: &[(i64, Option<[u8; 3]>, f32)],
        (width, height): (u32, u32),
    ) {
        let (camera, frame_id) = ("front".to_owned(), "front_optical_frame".to_owned());
        let options = WriterOptions { camera, frame_id, mount: None, about: BTreeMap::new(), force: false };
        let mut writer = RecordingWriter::create(&self.path(name), options).unwrap();
        for (log_nanos, &(seconds, color, depth_m)) in (1..).zip(frames) {
            let image = color.map(|color| {
                let (mut png, rgb) = (Cursor::new(Vec::new()), image::Rgb(color));
                image::RgbImage::from_pixel(SIZE.0, SIZE.1, rgb)
                    .write_to(&mut png, image::ImageFormat::Png)
                    .unwrap();
                png.into_inner()
            });
            let bytes = depth_m.to_le_bytes().repeat((width * height) as usize);
            let frame = FrameRecord {
                log_nanos,
                stamp_nanos: seconds * 1_000_000_000,
                image: image.as_deref().map(|data| EncodedImage { format: "png", data }),
                camera: None,
                depth: DepthRecord { scale: ScaleRecord::default(), width, height, bytes: &bytes },
                depth_camera: None,
                labels: None,
                confidence: None,
                cloud: None,
            };
            writer.write(&frame).unwrap();
        }
        writer.finish().unwrap();
    }

    pub(crate) fn add_model(&self, name: &str, model: &ModelBuilder) {
        model.write(self.path(name));
    }

    /// Saves an image of the demo scene.
    pub(crate) fn add_image(&self, name: &str, frame: u64) {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut rgb = vec![0; 3 * (SIZE.0 * SIZE.1) as usize];
        DemoScene::new(1, SIZE.0, SIZE.1).render(frame, &mut rgb, None, None);
        image::save_buffer(path, &rgb, SIZE.0, SIZE.1, image::ExtendedColorType::Rgb8).unwrap();
    }
}
