//! Checks of the machine itself: folders, memory, clock.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

use super::report::{Finding, Problem};

/// Folders in which all users can write, but cannot remove each other's files.
const SHARED_FOLDERS: [&str; 2] = ["/dev/shm", "/tmp"];
const STICKY: u32 = 0o1000;
const OTHERS_WRITE: u32 = 0o002;
/// The clock is wrong if it shows an earlier time, because this program did not exist then.
const EARLIEST_UNIX_SECONDS: u64 = 1_767_225_600; // 2026-01-01

/// All checks by name.
pub(super) fn checks() -> Vec<(String, Finding)> {
    let folder = |folder: &&str| (format!("sticky bit of {folder}"), shared_folder(Path::new(folder)));
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let machine = [
        ("permissions", nunet_ipc::access::check_folder().map_err(Problem::of)),
        ("access", nunet_ipc::access::check_files().map_err(Problem::of)),
        ("overcommit", overcommit(&read("/proc/sys/vm/overcommit_memory"))),
        ("clock", clock(now)),
        ("logout", logout(rustix::process::geteuid().as_raw(), &logind())),
    ];
    let machine = machine.map(|(name, finding)| (name.to_owned(), finding));
    SHARED_FOLDERS.iter().map(folder).chain(machine).collect()
}

fn read(path: &str) -> String {
    fs::read_to_string(path).unwrap_or_default()
}

fn shared_folder(folder: &Path) -> Finding {
    let shown = folder.display();
    let mode = match fs::metadata(folder) {
        Ok(metadata) => metadata.mode(),
        Err(error) => {
            return Err(Problem::of(anyhow::Error::from(error).context(format!("cannot read `{shown}`"))));
        }
    };
    if mode & OTHERS_WRITE != 0 && mode & STICKY == 0 {
        return Err(Problem::new(
            format!("all users may remove each other's files in `{shown}`: its mode is {:o}", mode & 0o7777),
            format!("run `chmod 1777 {shown}`"),
        ));
    }
    Ok(format!("`{shown}` has mode {:o}", mode & 0o7777))
}

fn overcommit(mode: &str) -> Finding {
    let meaning = match mode.trim() {
        "0" => "heuristic",
        "1" => "always",
        "2" => "never",
        _ => "unknown",
    };
    Ok(format!("{meaning}; a camera's memory is prefaulted at startup, so it cannot fail later"))
}

fn clock(unix_seconds: u64) -> Finding {
    if unix_seconds < EARLIEST_UNIX_SECONDS {
        return Err(Problem::new(
            format!(
                "the clock is at {unix_seconds} s since 1970: stamps of recordings and of ROS will be wrong"
            ),
            "set the clock, or start nunetd after it is synchronized (After=time-sync.target)",
        ));
    }
    Ok(format!("{unix_seconds} s since 1970"))
}

/// The text of logind's configuration; empty if there is none.
fn logind() -> String {
    let parts = fs::read_dir("/etc/systemd/logind.conf.d").into_iter().flatten().flatten();
    let parts = parts.map(|part| fs::read_to_string(part.path()).unwrap_or_default());
    std::iter::once(read("/etc/systemd/logind.conf")).chain(parts).collect::<Vec<_>>().join("\n")
}

/// logind removes the shared memory of users who log out, but not of system users (logind.conf(5),
/// `RemoveIPC`).
fn logout(user: u32, logind: &str) -> Finding {
    const FIRST_REGULAR_USER: u32 = 1000;
    let set = |value: &str| {
        logind.lines().any(|line| line.trim().eq_ignore_ascii_case(&format!("RemoveIPC={value}")))
    };
    Ok(if logind.is_empty() || user < FIRST_REGULAR_USER || set("no") {
        "shared memory outlives the session".to_owned()
    } else {
        "shared memory is removed with the last session of this user: use a system user for a service, or set \
         RemoveIPC=no in logind.conf"
            .to_owned()
    })
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn folder(mode: u32) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(mode)).unwrap();
        folder
    }

    #[test]
    fn a_shared_folder_without_the_sticky_bit_is_a_problem() {
        assert!(shared_folder(folder(0o1777).path()).is_ok());
        assert!(shared_folder(folder(0o700).path()).is_ok());
        let problem = shared_folder(folder(0o777).path()).unwrap_err();
        assert!(problem.hint.is_some_and(|hint| hint.contains("chmod 1777 ")));
    }

    #[test]
    fn a_clock_that_was_never_set_is_a_problem() {
        assert!(clock(1_800_000_000).is_ok());
        assert!(clock(12).unwrap_err().detail.contains("12 s since 1970"));
    }

    #[test]
    fn shared_memory_of_regular_users_ends_with_their_last_session() {
        let ends =
            |user, logind: &str| logout(user, logind).unwrap().contains("removed with the last session");
        assert!(ends(1000, "[Login]\n#RemoveIPC=yes\n"));
        assert!(!ends(1000, "[Login]\nRemoveIPC=no\n"));
        assert!(!ends(999, "[Login]\n"));
        assert!(!ends(1000, ""));
    }
}
