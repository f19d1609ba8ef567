//! The progress of a long subcommand; shown on a terminal only.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar with rate and time left; a counter if the total is unknown.
pub(super) fn progress(what: &'static str, count: Option<u64>) -> ProgressBar {
    let (bar, template) = match count {
        Some(count) => (ProgressBar::new(count), "{prefix} {wide_bar} {pos}/{len} {per_sec} {eta} left"),
        None => (ProgressBar::new_spinner(), "{prefix} frame {pos} {per_sec}"),
    };
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.with_style(style).with_prefix(what)
}
