//! `nunetd`: turns a camera into a depth sensor.

use std::process::ExitCode;

use nunet_engine::{Installation, Telemetry};
use nunet_telemetry::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    // First, because the environment can be changed only while there is one thread.
    Telemetry::turn_off_by_default();
    Installation::of_nunetd().describe();
    nunet_daemon::main(std::env::args_os())
}
