//! What is done with other people's bytes, each as one function that must not panic whatever it is given.
//!
//! `fuzz_targets/` hands them what libFuzzer finds. The same files are compiled into the tests of the crates that they
//! are about, which hand them cut and damaged files and random bytes with the ordinary compiler: so they cannot rot.

pub mod daemon;
pub mod description;
pub mod header;
pub mod recording;
pub mod view;
