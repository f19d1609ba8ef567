//! The shared-memory contract of `nunetd`.
