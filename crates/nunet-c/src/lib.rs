//! `libnunet`: reading and publishing `nunetd`'s shared memory from C and C++.
//!
//! A thin layer around [`nunet_ipc`]: it converts handles, numbers and pointers to that crate's types, and
//! its errors to numbers and texts. It adds only calls that wait for a frame and return it. The header
//! `include/nunet.h` is written from this source by `tests/header.rs`. It is the documentation for users.
//!
//! | module | what |
//! |--------|------|
//! | [`status`] | errors as a number and a text; panics are caught here |
//! | [`handle`] | numbers that C sees as pointers, so that using a closed one is an error |
//! | [`argument`] | checks of arguments |
//! | [`process`] | versions, the clock |
//! | [`reader`], [`frame`] | the reader's side |
//! | [`publisher`], [`loan`], `camera` | the camera's side |
//! | [`attitude`] | the side of an inertial sensor |

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

pub mod attitude;
