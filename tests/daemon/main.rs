//! `nunetd` as its users meet it: the real binary, real files, real shared memory, other processes.

mod bad_input;
mod infer;
mod journey;
mod loss;
mod processes;
mod support;
mod truth;
