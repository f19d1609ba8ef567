//! A process that takes part in a service.

use std::fmt;

/// A process that takes part in a service.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Process {
    /// Its id; 0 when iceoryx2 does not know it.
    pub pid: u32,
    /// Whether it runs. A killed process keeps its place until another process cleans up after it.
    pub alive: bool,
}

impl fmt::Display for Process {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = if self.alive { "" } else { ", which is dead" };
        write!(f, "process {}{state}", self.pid)
    }
}
