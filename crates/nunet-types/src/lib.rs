//! The vocabulary that all nunet crates share: plain data types without behavior of their own.

mod hint;

pub use hint::Hint;
