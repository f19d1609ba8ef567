//! Parsers of untrusted bytes, each as one function that must not panic for any input.
//!
//! `fuzz_targets/` calls them with the inputs of libFuzzer. The same files are compiled into the tests of the
//! crates that they test, which call them with truncated and damaged files and random bytes: so they always
//! compile.

pub mod daemon;
pub mod description;
pub mod header;
pub mod recording;
pub mod ros2;
pub mod view;
