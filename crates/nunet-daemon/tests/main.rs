//! `nunetd` as its users meet it: the real binary, real files, real shared memory, other processes.
#![expect(clippy::unwrap_used, reason = "a test may stop at the first thing that is wrong")]

mod access;
mod aspect;
mod bad_input;
mod calibrate;
mod cases;
mod command_line;
mod confidence;
mod doctor;
mod end_to_end;
mod eval;
mod filters;
#[cfg(feature = "foxglove")]
mod foxglove;
#[cfg(feature = "foxglove")]
mod foxglove_subscription;
mod hostile;
mod infer;
mod lens;
mod loss;
mod obstacles;
mod password;
mod processes;
mod recurrent;
mod rotate;
mod scale;
mod several;
mod support;
mod truth;
mod tune;
