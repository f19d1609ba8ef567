//! `nunetd`.

fn main() {}
