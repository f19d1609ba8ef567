//! Pairs images and depth whose names are time stamps, as in TUM's sequences: the nearest times belong
//! together.

use std::collections::{BTreeMap, BTreeSet};

use super::MAX_APART_NANOS;

/// How images and depth that have different names belong together.
#[derive(Debug, Default)]
pub(super) struct TimePairs {
    /// The depth of each image whose depth has another name.
    pub(super) depth_of: BTreeMap<String, String>,
    /// How many images have depth of the same name.
    pub(super) by_name: usize,
    /// If times were used: the names without a partner of the same name that are no times.
    pub(super) strays: BTreeSet<String>,
}

impl TimePairs {
    /// Images and depth with equal names belong together. Of the others, those whose names are times are
    /// joined.
    pub(super) fn find(images: &[String], depths: &[String]) -> Self {
        let known = |names: &[String]| names.iter().cloned().collect::<BTreeSet<_>>();
        let (images, depths) = (known(images), known(depths));
        let depth_of = by_time(&times(images.difference(&depths)), &times(depths.difference(&images)));
        let alone = images.symmetric_difference(&depths);
        let strays = alone.filter(|name| !depth_of.is_empty() && nanos(name).is_none()).cloned().collect();
        Self { by_name: images.intersection(&depths).count(), strays, depth_of }
    }
}

/// The depth of each image that has depth near in time.
fn by_time(images: &[(u64, &String)], depths: &[(u64, &String)]) -> BTreeMap<String, String> {
    let mut candidates = Vec::new();
    let mut first = 0;
    for &(image_nanos, image) in images {
        while depths.get(first).is_some_and(|(nanos, _)| nanos.saturating_add(MAX_APART_NANOS) < image_nanos)
        {
            first += 1;
        }
        let last = image_nanos.saturating_add(MAX_APART_NANOS);
        let near = depths[first..].iter().take_while(|(nanos, _)| *nanos <= last);
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

/// Those names that are times, as nanoseconds, in order.
fn times<'a>(names: impl Iterator<Item = &'a String>) -> Vec<(u64, &'a String)> {
    let mut times: Vec<_> = names.filter_map(|name| Some((nanos(name)?, name))).collect();
    times.sort_unstable();
    times
}

/// Seconds with a fraction, or a whole number since 1970 in milli-, micro- or nanoseconds, recognized by its
/// digits. A number with leading zeros counts images.
pub(super) fn nanos(name: &str) -> Option<u64> {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if let Some((seconds, fraction)) = name.split_once('.') {
        if !is_number(seconds) || !is_number(fraction) {
            return None;
        }
        let fraction: u64 = format!("{fraction:0<9.9}").parse().ok()?;
        return seconds.parse::<u64>().ok()?.checked_mul(1_000_000_000)?.checked_add(fraction);
    }
    let unit = match name.len() {
        _ if name.starts_with('0') => return None,
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

    fn found(images: &[&str], depths: &[&str]) -> TimePairs {
        let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        TimePairs::find(&owned(images), &owned(depths))
    }

    fn pairs(images: &[&str], depths: &[&str]) -> Vec<(String, String)> {
        found(images, depths).depth_of.into_iter().collect()
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
    fn names_that_are_no_times_are_not_joined() {
        assert!(pairs(&["0001"], &["0002"]).is_empty());
        assert!(pairs(&["a"], &["b"]).is_empty());
        assert!(pairs(&["000000000001"], &["000000000002"]).is_empty(), "they are counted, 1 ms apart");
        let none = found(&["a", "b"], &["b", "c"]);
        assert!(none.by_name == 1 && none.strays.is_empty(), "a missing file is reported: {none:?}");
    }

    #[test]
    fn equal_names_are_joined_first_and_the_others_by_time() {
        let found = found(&["1.5", "2.0", "3.0", "thumb"], &["1.5", "2.015", "3.015", "mean"]);
        let expected =
            [("2.0", "2.015"), ("3.0", "3.015")].map(|(image, depth)| (image.into(), depth.into()));
        assert_eq!((found.by_name, found.depth_of), (1, BTreeMap::from(expected)));
        assert_eq!(found.strays, BTreeSet::from(["mean", "thumb"].map(str::to_owned)));
    }

    #[test]
    fn depth_of_an_equal_name_is_not_given_to_another_image() {
        assert!(pairs(&["1.500", "1.501"], &["1.500"]).is_empty());
    }
}
