//! `nunetd`: one camera becomes a depth sensor.

use std::process::ExitCode;

use nunet_engine::{Installation, Telemetry};
use nunet_telemetry::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    // First of all: while there is one thread, the environment can be written.
    Telemetry::turn_off_by_default();
    Installation::of_nunetd().describe();
    nunet_daemon::main(std::env::args_os())
}
