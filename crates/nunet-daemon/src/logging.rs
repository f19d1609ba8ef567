//! Log lines on stderr.

use std::io::IsTerminal as _;

use nunet_sink::stdout::LogLine;
use tracing::level_filters::LevelFilter;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::filter::Directive;
use tracing_subscriber::fmt::format::FmtSpan;

use crate::config::LogOptions;

/// Starts logging; a second call in one process (the Python package) changes nothing.
pub(crate) fn start(options: LogOptions) {
    let level = match (options.quiet, options.verbose) {
        (true, _) => LevelFilter::ERROR,
        (false, 0) => LevelFilter::INFO,
        (false, 1) => LevelFilter::DEBUG,
        (false, _) => LevelFilter::TRACE,
    };
    // They log every message that arrives, every try to reach a router, an error for each client that sends
    // nonsense.
    let quiet_libraries = ["dust_dds=warn", "zenoh=off", "foxglove=off"];
    let quiet_libraries = quiet_libraries.into_iter().flat_map(str::parse::<Directive>);
    let filter = EnvFilter::default().add_directive(level.into());
    let filter = quiet_libraries.fold(filter, EnvFilter::add_directive);
    let color = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|v| v.is_empty());
    // Without `log_internal_errors(false)`, a closed stderr would end the daemon with a panic.
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(move || LogLine { color: color && !options.json })
        .with_span_events(if options.verbose > 1 { FmtSpan::CLOSE } else { FmtSpan::NONE })
        .log_internal_errors(false);
    let started = if options.json {
        lines.json().flatten_event(true).try_init()
    } else {
        lines.with_ansi(color).with_target(false).try_init()
    };
    drop(started);
}
