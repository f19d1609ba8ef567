//! `libnunet`: reading and publishing `nunetd`'s shared memory from C and C++.
//!
//! A thin shell around [`nunet_ipc`]: it turns handles, numbers and pointers into that crate's types and its errors
//! into numbers and texts, and adds nothing of its own but the joining of waiting and looking. The header
//! `include/nunet.h` is written from this source by `tests/header.rs`, and is where users read.
//!
//! | module | what |
//! |--------|------|
//! | [`status`] | what went wrong, as a number and a text; no panic passes it |
//! | [`handle`] | numbers dressed as pointers, so that a closed one is an error |
//! | [`argument`] | what a caller gave, checked |
//! | [`process`] | versions, the clock |
//! | [`reader`], [`frame`] | the reader's side |
//! | [`publisher`], [`loan`], `camera` | the camera's side |

pub mod argument;
mod camera;
pub mod handle;

// In the order of the header's functions.
pub mod status;

pub mod process;

pub mod reader;

pub mod frame;

pub mod publisher;

pub mod loan;
