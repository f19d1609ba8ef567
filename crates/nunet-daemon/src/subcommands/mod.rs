//! The subcommands, one file each: the options as plain values, and the function that runs it.

pub(crate) mod bench;
pub(crate) mod calibrate;
pub(crate) mod check_model;
pub(crate) mod config;
pub(crate) mod contract;
pub(crate) mod doctor;
pub(crate) mod eval;
pub(crate) mod feed;
pub(crate) mod infer;
pub(crate) mod inspect;
mod load;
mod progress;
pub(crate) mod replay;
pub(crate) mod run;
pub(crate) mod tune;
pub(crate) mod watch;
