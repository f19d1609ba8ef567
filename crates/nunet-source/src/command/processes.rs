//! The processes of this machine, from `/proc`, and those that a program started outside of its own group.

use std::collections::BTreeSet;
use std::os::fd::OwnedFd;
use std::path::Path;

use rustix::process::{Pid, PidfdFlags, Signal, kill_process, pidfd_open, pidfd_send_signal};

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

    /// A handle, which never means another process, unlike the number. `None` for a process that has ended,
    /// before Linux 5.3, and where a sandbox forbids it.
    fn handle(self) -> Option<OwnedFd> {
        pidfd_open(Pid::from_raw(self.pid)?, PidfdFlags::empty()).ok()
    }
}

/// Whether a process of a group runs. Without `/proc`, one may.
pub(super) fn is_group_running(group: Pid) -> bool {
    let group = group.as_raw_pid();
    Process::all().is_none_or(|all| all.iter().any(|process| process.group == group))
}

/// The processes that a program has started, and that are not in its group: by `setsid`, `timeout`, or a
/// shell with job control. A signal to the group does not reach them.
#[derive(Default)]
pub(super) struct Strays(Vec<(Process, Option<OwnedFd>)>);

impl Strays {
    /// Those below the processes of a group. To be called while these run: a process whose parent has ended
    /// belongs to nobody. A daemon is such a process on purpose.
    pub(super) fn below(group: Pid) -> Self {
        let mut strays = Self::default();
        strays.update(group);
        strays
    }

    /// Adds those that were started since. The known ones stay, even if their parents have ended.
    pub(super) fn update(&mut self, group: Pid) {
        let group = group.as_raw_pid();
        let all = Process::all().unwrap_or_default();
        let known = self.0.iter().map(|(process, _)| process).filter(|process| process.is_running());
        let mut below: BTreeSet<i32> = known.map(|process| process.pid).chain([group]).collect();
        loop {
            let count = below.len();
            let is_below = |process: &&Process| process.group == group || below.contains(&process.parent);
            let found: Vec<i32> = all.iter().filter(is_below).map(|process| process.pid).collect();
            below.extend(found);
            if below.len() == count {
                break;
            }
        }
        let strays = all.into_iter().filter(|process| below.contains(&process.pid) && process.group != group);
        let with_handle = strays.map(|process| (process, process.handle()));
        // It may have ended before the handle was opened.
        self.0 = with_handle.filter(|(process, _)| process.is_running()).collect();
    }

    /// Sends a signal to those that still run.
    pub(super) fn signal(&self, signal: Signal) {
        for (process, handle) in &self.0 {
            // Fails if it has ended.
            let _ = match (handle, Pid::from_raw(process.pid)) {
                (Some(handle), _) => pidfd_send_signal(handle, signal),
                // Almost safe: the number would have to be used again at this moment.
                (None, Some(pid)) if process.is_running() => kill_process(pid, signal),
                _ => Ok(()),
            };
        }
    }

    /// Whether one of them runs.
    pub(super) fn are_running(&self) -> bool {
        self.0.iter().any(|(process, _)| process.is_running())
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::{CommandExt as _, ExitStatusExt as _};
    use std::process::{Child, Command};
    use std::time::Duration;

    use rustix::process::kill_process_group;

    use super::*;

    /// Bounds a wait, in steps of 10 ms.
    const MAX_STEPS: u32 = 6000;

    fn start(command: &str) -> (Child, Pid) {
        let child = Command::new("/bin/sh").args(["-c", command]).process_group(0).spawn().unwrap();
        let pid = Pid::from_child(&child);
        (child, pid)
    }

    /// What `step` finds within a minute.
    fn wait_for<T>(mut step: impl FnMut() -> Option<T>) -> Option<T> {
        (0..MAX_STEPS).find_map(|_| {
            std::thread::sleep(Duration::from_millis(10));
            step()
        })
    }

    fn folder(pid: Pid) -> std::path::PathBuf {
        Path::new("/proc").join(pid.as_raw_pid().to_string())
    }

    /// The leader of the group has ended; the parent of the stray is another process of the group.
    #[test]
    fn strays_below_any_process_of_the_group_are_found() {
        let (mut leader, group) = start("(setsid sleep 1000 & wait) & exit");
        let strays = wait_for(|| {
            let has_ended = Process::read(&folder(group)).is_none();
            Some(Strays::below(group)).filter(|strays| has_ended && strays.are_running())
        });
        strays.iter().for_each(|strays| strays.signal(Signal::KILL));
        let _ = kill_process_group(group, Signal::KILL);
        leader.wait().unwrap();
        assert_eq!(strays.map(|strays| strays.0.len()), Some(1));
    }

    /// A stray that survives SIGTERM, and starts a program again.
    #[test]
    fn what_strays_start_later_is_found_although_their_parent_has_ended() {
        let (mut leader, group) = start("setsid sh -c 'trap : TERM; while :; do sleep 1000; done' & wait");
        let strays = wait_for(|| Some(Strays::below(group)).filter(|strays| strays.0.len() == 2));
        let _ = kill_process_group(group, Signal::KILL);
        leader.wait().unwrap();
        let mut strays = strays.unwrap();
        let pids = |strays: &Strays| strays.0.iter().map(|(process, _)| process.pid).collect::<BTreeSet<_>>();
        let first = pids(&strays);
        let is_found = wait_for(|| {
            strays.signal(Signal::TERM);
            strays.update(group);
            (!pids(&strays).is_subset(&first)).then_some(())
        });
        let are_gone = wait_for(|| {
            strays.signal(Signal::KILL);
            strays.update(group);
            (!strays.are_running()).then_some(())
        });
        assert!(is_found.is_some() && are_gone.is_some());
    }

    #[test]
    fn without_a_handle_only_the_process_that_was_seen_gets_a_signal() {
        let (mut child, pid) = start("exec sleep 1000");
        let seen = Process::read(&folder(pid)).unwrap();
        let another = Process { started: seen.started - 1, ..seen };
        Strays(vec![(another, None)]).signal(Signal::KILL);
        Strays(vec![(seen, None)]).signal(Signal::TERM);
        assert_eq!(child.wait().unwrap().signal(), Some(Signal::TERM.as_raw()));
    }
}
