//! Damaged input for parsers: truncated files, and copies with damaged bytes. Deterministic.
//!
//! `NUNET_SWEEP=N` asks for N copies of each file instead of the few of an ordinary test, and for every cut.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Copies of each file in an ordinary test, which takes seconds.
const COPIES: u64 = 150;
/// Cuts of each file in an ordinary test. A file that is not longer is cut at every byte.
const CUTS: usize = 500;
/// The most damages in one copy.
const DAMAGES: u64 = 4;
/// The most failures that are reported; one fault often has hundreds.
const MAX_REPORTED: usize = 5;

/// Pseudorandom numbers from a seed: splitmix64.
#[derive(Debug, Clone)]
pub struct Chance(u64);

impl Chance {
    /// The numbers of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// The next number.
    #[expect(clippy::should_implement_trait, reason = "an iterator without an end is not what callers want")]
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number below `end`; 0 if `end` is 0.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % (end as u64).max(1)) as usize
    }
}

/// The number of copies in `NUNET_SWEEP`.
fn asked() -> Option<u64> {
    let text = std::env::var("NUNET_SWEEP").ok().filter(|text| !text.is_empty())?;
    Some(text.parse().unwrap_or_else(|_| panic!("NUNET_SWEEP is `{text}`; expected a number of copies")))
}

/// A copy with one to four damages: wrong bits, bytes and integers, missing or repeated slices.
#[must_use]
pub fn damaged(whole: &[u8], seed: u64) -> Vec<u8> {
    let mut chance = Chance::new(seed);
    let mut bytes = whole.to_vec();
    for _ in 0..=chance.next() % DAMAGES {
        damage(&mut bytes, &mut chance);
    }
    bytes
}

fn damage(bytes: &mut Vec<u8>, chance: &mut Chance) {
    const TELLING: [u8; 16] = *b"\0\xff\x7f\x80[]{}\"'-.:,9\n";
    const NUMBERS: [u64; 6] = [0, 1, u64::MAX, i64::MAX as u64, u32::MAX as u64, 1 << 31];
    let at = chance.below(bytes.len());
    let length = (1 + chance.below(16)).min(bytes.len() - at);
    match chance.below(8) {
        _ if bytes.is_empty() => bytes.push(chance.next() as u8),
        0..=2 => bytes[at] ^= 1 << chance.below(8),
        3 => bytes[at] = TELLING[chance.below(TELLING.len())],
        4 => bytes[at] = chance.next() as u8,
        // Lengths and counts are 2, 4 or 8 bytes in most formats.
        5 => {
            let number = NUMBERS[chance.below(NUMBERS.len())].to_le_bytes();
            let width = [2, 4, 8][chance.below(3)].min(bytes.len() - at);
            bytes[at..at + width].copy_from_slice(&number[..width]);
        }
        6 => drop(bytes.drain(at..at + length)),
        _ => {
            let again = bytes[at..at + length].to_vec();
            bytes.splice(at..at, again);
        }
    }
}

/// Passes the file, truncated files and damaged copies to `take`, which must not panic.
///
/// # Panics
/// If `take` does, with the length or the seed of the first few inputs for which it did.
pub fn feed_damaged(name: &str, whole: &[u8], mut take: impl FnMut(&[u8])) {
    take(whole);
    let mut failures = Vec::new();
    let mut try_one = |what: String, bytes: &[u8]| {
        if let Err(panic) = catch_unwind(AssertUnwindSafe(|| take(bytes))) {
            let message = panic.downcast_ref::<String>().map(String::as_str);
            let message = message.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no text");
            failures.push(format!("{what}: {message}"));
        }
    };
    let step = if asked().is_some() { 1 } else { whole.len().div_ceil(CUTS).max(1) };
    for length in (0..whole.len()).step_by(step) {
        try_one(format!("cut to {length} bytes"), &whole[..length]);
    }
    for seed in 0..asked().unwrap_or(COPIES) {
        try_one(format!("seed {seed}"), &damaged(whole, seed));
    }
    let count = failures.len();
    failures.truncate(MAX_REPORTED);
    assert!(failures.is_empty(), "{name}: {count} inputs failed, the first:\n{}", failures.join("\n"));
}

/// Writes a valid file as a seed of a fuzz target, into the folder in `NUNET_CORPUS` (`fuzz/corpus`).
///
/// # Panics
/// The folder cannot be written.
pub fn keep_for_fuzzing(target: &str, name: &str, bytes: &[u8]) {
    // Tests run in the folder of their package.
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let Some(corpus) = std::env::var_os("NUNET_CORPUS").filter(|path| !path.is_empty()) else { return };
    let folder = checkout.join(corpus).join(target);
    let written = std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(folder.join(name), bytes));
    written.unwrap_or_else(|error| panic!("cannot write into `{}`: {error}", folder.display()));
}

/// Small texts that are expensive to parse: deep nesting, endless names and numbers, aliases that expand.
#[must_use]
pub fn greedy_texts() -> Vec<String> {
    const DEEP: usize = 30_000;
    let nested = |open: &str, close: &str| format!("a{}1{}", open.repeat(DEEP), close.repeat(DEEP));
    let aliases: String = (0..30).map(|n| format!("l{}: &l{} [*l{n}, *l{n}]\n", n + 1, n + 1)).collect();
    vec![
        nested(" = [", "]"),
        format!("a = {}1{}", "[".repeat(DEEP), "]".repeat(DEEP)),
        format!("a = {}1{}", "{a=".repeat(DEEP), "}".repeat(DEEP)),
        format!("{}1", "a.".repeat(DEEP)),
        format!("[{}]\nb = 1", vec!["a"; DEEP].join(".")),
        format!("a: {}", "[".repeat(DEEP)),
        format!("a: {}", "{a: ".repeat(DEEP)),
        "- ".repeat(DEEP),
        "? ".repeat(DEEP),
        (0..300).map(|depth| format!("{}a:\n", " ".repeat(depth))).collect(),
        format!("l0: &l0 [x]\n{aliases}"),
        "[".repeat(DEEP),
        r#"{"a":"#.repeat(DEEP),
        "9".repeat(DEEP),
        format!("a = {}", "9".repeat(DEEP)),
        format!("a: 1e{}", "9".repeat(DEEP)),
        format!("{} = 1", "k".repeat(DEEP)),
        format!("a = \"{}", "x".repeat(DEEP)),
        "\u{feff}\u{0}\r\t".repeat(DEEP / 8),
        "!!binary ".repeat(DEEP / 8),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damage_follows_from_the_seed_and_differs_from_seed_to_seed() {
        let whole: Vec<u8> = (0..=255).collect();
        assert_eq!(damaged(&whole, 7), damaged(&whole, 7));
        let all: std::collections::BTreeSet<_> = (0..500).map(|seed| damaged(&whole, seed)).collect();
        assert!(all.len() > 490, "{} different copies of 500", all.len());
        for seed in 0..100 {
            assert!(damaged(&[], seed).len() <= 16 * DAMAGES as usize);
            assert!(damaged(&[1], seed).len() <= 16 * DAMAGES as usize + 1);
        }
    }

    #[test]
    #[should_panic(expected = "three: 2 inputs failed, the first:\ncut to 2 bytes: two bytes")]
    fn an_input_that_panics_is_reported() {
        feed_damaged("three", b"abc", |bytes| assert!(bytes != b"ab", "two bytes"));
    }
}
