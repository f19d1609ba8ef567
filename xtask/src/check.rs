//! `cargo xtask check`: checks of the source that do not run it.

use anyhow::Result;

use crate::run::{cargo, run_all};

/// Format, lints (benches and examples are compiled by them), documentation, structure.
pub(crate) fn check() -> Result<()> {
    let mut docs = cargo(&["doc", "--workspace", "--no-deps"]);
    docs.env("RUSTDOCFLAGS", "-D warnings");
    run_all(
        "check",
        &mut [
            ("format", cargo(&["fmt", "--all", "--check"])),
            ("lints", cargo(&["clippy", "--workspace", "--all-targets", "--", "-D", "warnings"])),
            ("documentation", docs),
            ("structure", cargo(&["test", "--package", "xtask"])),
        ],
    )
}
