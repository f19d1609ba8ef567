//! Several users: members of the group can read but not write, others can do neither.
//!
//! Needs root to switch users, and `setpriv` of util-linux. Users and groups are unused numbers.

use std::fs::{self, File, Permissions};
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _, chown};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use nunet_testkit::models;
use serde_json::Value;

use crate::support::{Guarded, SIZE, camera, run, signal, text, wait_for};

const OWNER: u32 = 61_001;
const READER: u32 = 61_002;
const OUTSIDER: u32 = 61_003;
/// What owner and reader have in common.
const GROUP: u32 = 61_100;

/// A folder that all users can read, with all files of nunetd, and its own iceoryx2 root.
struct World(tempfile::TempDir);

impl Drop for World {
    /// What the killed left, and a failed test.
    fn drop(&mut self) {
        let prefix = self.prefix();
        for entry in fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&prefix) {
                // Its owner may be faster.
                let _ = fs::remove_file(entry.path());
            }
        }
    }
}

impl World {
    fn new() -> Self {
        let uid = Command::new("id").arg("-u").output().unwrap();
        assert_eq!(text(&uid.stdout).trim(), "0", "this test becomes other users: run it as root");
        let world = Self(tempfile::tempdir().unwrap());
        fs::set_permissions(world.0.path(), Permissions::from_mode(0o755)).unwrap();
        fs::copy(env!("CARGO_BIN_EXE_nunetd"), world.path("nunetd")).unwrap();
        fs::copy(nunet_testkit::runtime_library(), world.path("libonnxruntime.so")).unwrap();
        models::wnet(SIZE, true).write(world.path("model.onnx"));
        world.install_demo();
        let root = world.path("shared");
        world.folder("config");
        let config =
            format!("[global]\nroot-path = \"{}\"\nprefix = \"{}\"\n", root.display(), world.prefix());
        fs::write(world.path("config/iceoryx2.toml"), config).unwrap();
        // As /tmp is.
        fs::set_permissions(world.0.path(), Permissions::from_mode(0o1777)).unwrap();
        for user in [OWNER, READER, OUTSIDER] {
            chown(world.folder(&user.to_string()), Some(user), Some(user)).unwrap();
        }
        world
    }

    /// The demo's images, where the copy of nunetd looks for them.
    fn install_demo(&self) {
        let clip = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/clip"));
        fs::create_dir_all(self.path("models/clip/rgb")).unwrap();
        fs::copy(clip.join("camera.json"), self.path("models/clip/camera.json")).unwrap();
        for image in fs::read_dir(clip.join("rgb")).unwrap() {
            let image = image.unwrap();
            fs::copy(image.path(), self.path("models/clip/rgb").join(image.file_name())).unwrap();
        }
    }

    /// Of this world's files in shared memory.
    fn prefix(&self) -> String {
        let folder = self.0.path().file_name().unwrap().to_string_lossy();
        format!("nunet{}_", folder.replace('.', ""))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn folder(&self, name: &str) -> PathBuf {
        fs::create_dir_all(self.path(name)).unwrap();
        self.path(name)
    }

    /// A program as another user: only the stranger is not in the group.
    fn command(&self, user: u32, program: &Path, arguments: &[&str]) -> Command {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", &user.to_string(), "--regid", &user.to_string()]);
        if user == OUTSIDER {
            command.arg("--clear-groups");
        } else {
            command.args(["--groups", &GROUP.to_string()]);
        }
        command.arg(program).args(arguments).stdin(Stdio::null()).current_dir(self.0.path());
        command.env("HOME", self.path(&user.to_string())).env("XDG_CACHE_HOME", self.path(&user.to_string()));
        command.env("NO_COLOR", "1").env("ORT_DYLIB_PATH", self.path("libonnxruntime.so"));
        command
    }

    fn nunetd(&self, user: u32, arguments: &[&str]) -> Command {
        self.command(user, &self.path("nunetd"), arguments)
    }

    fn daemon(&self, name: &str, rest: &[&str]) -> Guarded {
        let mut arguments =
            vec!["-q", "--model", "model.onnx", "--source", "demo", "--rate", "20", "--camera", name];
        arguments.extend(rest);
        Guarded::start(self.nunetd(OWNER, &arguments))
    }

    fn watch(&self, user: u32, name: &str, frames: &str) -> Output {
        run(self.nunetd(user, &["watch", name, "--json", "--frames", frames, "--timeout", "20"]))
    }

    /// Kills a reader that has read a frame.
    fn kill_a_reader(&self, name: &str) {
        let mut watcher = self.nunetd(READER, &["watch", name, "--json", "--timeout", "60"]);
        watcher.stdout(File::create(self.path("watched")).unwrap()).stderr(Stdio::null());
        let mut killed = Guarded::start(watcher);
        wait_for("a frame that it reads", || (self.path("watched").metadata().ok()?.len() > 0).then_some(()));
        signal(killed.pid(), "KILL");
        killed.wait();
    }

    /// The owner's payload in shared memory, once there is some.
    fn payload(&self) -> Vec<PathBuf> {
        wait_for("the daemon's payload", || {
            let entries = fs::read_dir("/dev/shm").unwrap().map(|entry| entry.unwrap().path());
            let is_payload = |path: &PathBuf| {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let owner = path.metadata().map(|found| found.uid());
                name.starts_with(&self.prefix())
                    && name.ends_with(".data")
                    && owner.is_ok_and(|uid| uid == OWNER)
            };
            let payload: Vec<_> = entries.filter(is_payload).collect();
            (payload.len() >= 4).then_some(payload)
        })
    }

    /// Whether a user may open a file for reading, and for writing.
    fn rights(&self, user: u32, path: &Path) -> (bool, bool) {
        let path = path.to_str().unwrap();
        let dd = |arguments: &[&str]| {
            let mut command = self.command(user, Path::new("dd"), arguments);
            run({
                command.arg("count=1").arg("bs=1");
                command
            })
            .status
            .success()
        };
        let (from, to) = (format!("if={path}"), format!("of={path}"));
        (dd(&[&from, "of=/dev/null"]), dd(&["if=/dev/null", &to, "conv=nocreat,notrunc"]))
    }
}

fn frames(output: &Output) -> Vec<Value> {
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    text(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

// One test: payload is found by its owner, who must not have two daemons at once.
#[test]
#[ignore = "needs root: it becomes other users; `cargo xtask test` runs it as root"]
fn the_group_can_read_but_not_write_and_others_can_do_neither() {
    let world = World::new();

    // Without a group, only the own user.
    let name = camera("private");
    let mut daemon = world.daemon(&name, &[]);
    assert_eq!(frames(&world.watch(OWNER, &name, "3")).len(), 3);
    for path in world.payload() {
        assert_eq!(world.rights(OWNER, &path), (true, true));
        assert_eq!(world.rights(READER, &path), (false, false));
    }
    let refused = world.watch(READER, &name, "1");
    assert_eq!(refused.status.code(), Some(1));
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));

    let name = camera("shared");
    let group = GROUP.to_string();
    let mut daemon = world.daemon(&name, &["--access-group", &group]);
    world.payload();
    let seen = frames(&world.watch(READER, &name, "10"));
    assert_eq!(seen.len(), 10);
    assert!(seen.iter().all(|frame| frame["depth_center_m"].as_f64().unwrap() >= 0.5), "{seen:?}");
    for path in world.payload() {
        assert_eq!(world.rights(OWNER, &path), (true, true));
        assert_eq!(world.rights(READER, &path), (true, false), "{}", path.display());
        assert_eq!(world.rights(OUTSIDER, &path), (false, false));
    }
    let refused = world.watch(OUTSIDER, &name, "1");
    assert_eq!(refused.status.code(), Some(1));
    let stderr = text(&refused.stderr);
    assert!(stderr.contains(&format!("it belongs to user {OWNER} and group {GROUP}\nhint: ")), "{stderr}");

    // A reader that is killed, and an owner that begins again while a reader stays.
    world.kill_a_reader(&name);
    assert_eq!(frames(&world.watch(READER, &name, "5")).len(), 5, "a killed reader is in nobody's way");
    signal(daemon.pid(), "KILL");
    daemon.wait();
    let mut daemon = world.daemon(&name, &["--access-group", &group, "--access-mode", "0640"]);
    let seen = world.nunetd(READER, &["watch", &name, "--json", "--timeout", "3"]);
    let seen = std::thread::spawn(move || run(seen));
    assert_eq!(frames(&world.watch(READER, &name, "5")).len(), 5);
    signal(daemon.pid(), "TERM");
    assert_eq!(daemon.wait(), Some(0));
    // The reader is the last to leave, and may not remove what is the owner's: the next owner does.
    let seen = seen.join().unwrap();
    assert!(text(&seen.stdout).lines().count() > 0, "{}", text(&seen.stderr));
    let _daemon = world.daemon(&name, &["--access-group", &group]);
    assert_eq!(frames(&world.watch(READER, &name, "5")).len(), 5);
}

#[test]
#[ignore = "needs root: it becomes other users; `cargo xtask test` runs it as root"]
fn an_invalid_group_or_mode_is_a_bad_argument() {
    let world = World::new();
    let refused = |rest: &[&str]| {
        let mut arguments = vec!["-q", "--model", "model.onnx", "--source", "demo"];
        arguments.extend(rest);
        let output = run(world.nunetd(OWNER, &arguments));
        (output.status.code(), text(&output.stderr))
    };
    let (code, stderr) = refused(&["--access-group", "no-such-group"]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(stderr.contains("`no-such-group` in `/etc/group`\nhint: "), "{stderr}");
    let (code, stderr) = refused(&["--access-group", "61100", "--access-mode", "0644"]);
    assert_eq!(code, Some(2), "{stderr}");
    assert!(["0644", "0640", "0660\nhint: "].iter().all(|named| stderr.contains(named)), "{stderr}");
    let (code, stderr) = refused(&["--access-mode", "0640"]);
    assert_eq!(code, Some(2), "{stderr}");
    // The owner is in no such group, and may not give it anything.
    let (code, stderr) = refused(&["--access-group", "61999"]);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("to group 61999\n") && stderr.contains("\nhint: "), "{stderr}");
}
