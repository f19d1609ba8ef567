//! Ends a program if this process dies before it can: killed, or out of memory.

use std::os::unix::process::CommandExt as _;
use std::process::{Child, Command, Stdio};

use rustix::process::Pid;

/// Waits for the end of its input, which only this process holds, and then ends a group of processes.
const SCRIPT: &str = "read -r _; kill -s TERM -- \"-$1\" && sleep 1 && kill -s KILL -- \"-$1\"";

/// A shell that watches over a program. `PR_SET_PDEATHSIG` would need unsafe code in the child, would end
/// only the first process of a pipeline, and would already end it with the thread that has started it.
pub(super) struct Guard(Option<Child>);

impl Guard {
    /// Guards the group of `leader`. If no process can be started, nothing does.
    pub(super) fn of(leader: Pid) -> Self {
        let mut shell = Command::new("/bin/sh");
        shell.args(["-c", SCRIPT, "nunetd-guard"]).arg(leader.as_raw_pid().to_string());
        shell.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        // A group of its own: a signal for another one does not reach it.
        Self(shell.process_group(0).spawn().ok())
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        if let Some(mut shell) = self.0.take() {
            // Before its input is closed. Fails if it has ended.
            let _ = shell.kill();
            let _ = shell.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn start(command: &str) -> (Child, Pid) {
        let child = Command::new("/bin/sh").args(["-c", command]).process_group(0).spawn().unwrap();
        let pid = Pid::from_child(&child);
        (child, pid)
    }

    /// Whether a process ends within a minute.
    fn ends(child: &mut Child) -> bool {
        (0..6000).any(|_| {
            std::thread::sleep(Duration::from_millis(10));
            child.try_wait().unwrap().is_some()
        })
    }

    #[test]
    fn a_program_that_ignores_signals_ends_when_the_input_of_its_guard_does() {
        let (mut program, pid) = start("trap '' TERM; sleep 1000; sleep 1000");
        let mut guard = Guard::of(pid);
        // The kernel does this when the process dies.
        drop(guard.0.as_mut().unwrap().stdin.take());
        assert!(ends(&mut program));
        assert!(ends(guard.0.as_mut().unwrap()));
    }

    #[test]
    fn a_guard_that_is_dropped_leaves_the_program_alone() {
        let (mut program, pid) = start("exec sleep 1000");
        drop(Guard::of(pid));
        assert!(program.try_wait().unwrap().is_none());
        program.kill().unwrap();
        assert!(ends(&mut program));
    }
}
