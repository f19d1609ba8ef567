//! Pairs images and depth whose names are time stamps, as in TUM's sequences: the nearest times belong
//! together.

use std::collections::{BTreeMap, BTreeSet};

use super::MAX_APART_NANOS;

/// The depth of each image whose depth has another name. Empty if any image has depth with its own name: then
/// pairs are found by name.
pub(super) fn by_time(images: &[String], depths: &[String]) -> BTreeMap<String, String> {
    let names: BTreeSet<&String> = depths.iter().collect();
    if images.iter().any(|image| names.contains(image)) {
        return BTreeMap::new();
    }
    let (Some(images), Some(depths)) = (times(images), times(depths)) else { return BTreeMap::new() };
    let mut candidates = Vec::new();
    let mut first = 0;
    for &(image_nanos, image) in &images {
        while depths.get(first).is_some_and(|(nanos, _)| nanos + MAX_APART_NANOS < image_nanos) {
            first += 1;
        }
        let near = depths[first..].iter().take_while(|(nanos, _)| *nanos <= image_nanos + MAX_APART_NANOS);
        candidates.extend(near.map(|&(nanos, depth)| (nanos.abs_diff(image_nanos), image, depth)));
    }
    // The nearest first; each image and each depth is used once.
    candidates.sort_unstable();
    let (mut pairs, mut used) = (BTreeMap::new(), BTreeSet::new());
    for (_, image, depth) in candidates {
        if !pairs.contains_key(image) && used.insert(depth) {
            pairs.insert(image.clone(), depth.clone());
        }
    }
    pairs
}

/// Names as nanoseconds, in order; `None` unless all are times.
fn times(names: &[String]) -> Option<Vec<(u64, &String)>> {
    let mut times: Vec<_> = names.iter().map(|name| Some((nanos(name)?, name))).collect::<Option<_>>()?;
    times.sort_unstable();
    Some(times)
}

/// Seconds with a fraction, or a whole number since 1970 in milli-, micro- or nanoseconds, recognized by its digits.
fn nanos(name: &str) -> Option<u64> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((seconds, fraction)) = name.split_once('.') {
        if !is_number(seconds) || !is_number(fraction) {
            return None;
        }
        let fraction: u64 = format!("{fraction:0<9.9}").parse().ok()?;
        return seconds.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(fraction);
    }
    let unit = match name.len() {
        12..=14 => 1_000_000,
        15..=17 => 1_000,
        18..=19 => 1,
        _ => return None,
    };
    is_number(name).then(|| name.parse::<u64>().ok()?.checked_mul(unit)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(images: &[&str], depths: &[&str]) -> Vec<(String, String)> {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        by_time(&owned(images), &owned(depths)).into_iter().collect()
    }

    #[test]
    fn times_within_20_ms_are_joined_each_once_and_the_nearest_first() {
        let found = pairs(
            &["1305031100.175304", "1305031100.211", "1305031101.000"],
            &["1305031100.160407", "1305031100.19", "1305031101.021"],
        );
        let expected = [("1305031100.175304", "1305031100.19"), ("1305031100.211", "")];
        assert_eq!(found[0], (expected[0].0.to_owned(), expected[0].1.to_owned()));
        assert_eq!(
            found.len(),
            1,
            "the next is 21 ms from what is left, and the last 21 ms from any: {found:?}"
        );
    }

    #[test]
    fn units_of_whole_numbers_follow_from_their_digits() {
        assert_eq!(pairs(&["1403636579763555584"], &["1403636579770000000"]).len(), 1);
        assert_eq!(pairs(&["1403636579763555"], &["1403636579790000"]).len(), 0, "microseconds, 26 ms apart");
        assert_eq!(pairs(&["1403636579763"], &["1403636579770"]).len(), 1, "milliseconds");
    }

    #[test]
    fn names_that_are_no_times_or_are_equal_are_not_joined() {
        assert!(pairs(&["0001"], &["0002"]).is_empty());
        assert!(pairs(&["a"], &["b"]).is_empty());
        assert!(pairs(&["1.5", "2.0"], &["1.5", "2.01"]).is_empty());
    }
}
