//! Where frames come from.

pub mod demo;
