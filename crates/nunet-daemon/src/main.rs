//! `nunetd`: one camera becomes a depth sensor.

use std::process::ExitCode;

use nunet_daemon::telemetry::CountingAllocator;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

fn main() -> ExitCode {
    nunet_daemon::main(std::env::args_os())
}
