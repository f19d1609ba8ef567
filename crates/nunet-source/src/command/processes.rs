//! The processes of this machine, from `/proc`, and those that a program started outside of its own group.

use std::collections::BTreeSet;
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};

/// A process that runs.
#[derive(Clone, Copy)]
struct Process {
    pid: i32,
    parent: i32,
    group: i32,
    /// Clock ticks since the machine started. Numbers of processes are used again.
    started: u64,
}

impl Process {
    /// From its folder in `/proc`; `None` if it has ended. It keeps its number until it is collected.
    fn read(folder: &Path) -> Option<Self> {
        let pid = folder.file_name()?.to_str()?.parse().ok()?;
        let stat = std::fs::read(folder.join("stat")).ok()?;
        let stat = String::from_utf8_lossy(&stat);
        // `PID (NAME) STATE PARENT GROUP ...`; the name may have any character.
        let mut fields = stat.rsplit(')').next()?.split_ascii_whitespace();
        let is_running = !matches!(fields.next()?, "Z" | "X");
        let (parent, group) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
        // The 22nd field (proc_pid_stat(5)); the group is the 5th.
        let started = fields.nth(16)?.parse().ok()?;
        is_running.then_some(Self { pid, parent, group, started })
    }

    /// All of them; `None` without `/proc`.
    fn all() -> Option<Vec<Self>> {
        let folders = std::fs::read_dir("/proc").ok()?.flatten();
        Some(folders.filter_map(|folder| Self::read(&folder.path())).collect())
    }

    fn is_running(self) -> bool {
        let now = Self::read(&Path::new("/proc").join(self.pid.to_string()));
        now.is_some_and(|now| now.started == self.started)
    }

    /// A handle, which never means another process, unlike the number.
    fn handle(self) -> Option<OwnedFd> {
        let handle = pidfd_open(Pid::from_raw(self.pid)?, PidfdFlags::empty()).ok()?;
        // It may have ended before the handle was opened.
        self.is_running().then_some(handle)
    }
}

/// Whether a process of a group runs. Without `/proc`, one may.
pub(super) fn is_group_running(group: Pid) -> bool {
    let group = group.as_raw_pid();
    Process::all().is_none_or(|all| all.iter().any(|process| process.group == group))
}

/// The processes that a program has started, and that are not in its group: by `setsid`, `timeout`, or a shell with job
/// control. A signal to the group does not reach them.
pub(super) struct Strays(Vec<(Process, OwnedFd)>);

impl Strays {
    /// Those below a program, which leads its group. To be called while it runs: a process whose parent has ended belongs
    /// to nobody. A daemon is such a process on purpose.
    pub(super) fn below(program: Pid) -> Self {
        let root = program.as_raw_pid();
        let all = Process::all().unwrap_or_default();
        let mut below = BTreeSet::from([root]);
        loop {
            let children = all.iter().filter(|process| below.contains(&process.parent));
            let children: Vec<_> =
                children.map(|process| process.pid).filter(|pid| !below.contains(pid)).collect();
            if children.is_empty() {
                break;
            }
            below.extend(children);
        }
        let strays = all.into_iter().filter(|process| below.contains(&process.pid) && process.group != root);
        Self(strays.filter_map(|process| Some((process, process.handle()?))).collect())
    }

    /// Sends a signal to those that still run.
    pub(super) fn signal(&self, signal: Signal) {
        for (_, handle) in &self.0 {
            // Fails if it has ended.
            let _ = pidfd_send_signal(handle, signal);
        }
    }

    /// Whether one of them runs.
    pub(super) fn are_running(&self) -> bool {
        self.0.iter().any(|(process, _)| process.is_running())
    }
}
