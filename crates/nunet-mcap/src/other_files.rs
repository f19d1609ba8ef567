//! Recognizes recordings in other formats, and how to convert them.

use std::borrow::Cow;
use std::path::Path;

/// The first bytes of known other formats, and their names.
const KNOWN: [(&[u8], &str); 4] = [
    (b"#ROSBAG V", ROS1_BAG),
    (b"SQLite format 3\0", SQLITE_BAG),
    (b"\x28\xb5\x2f\xfd", ZSTD_FILE),
    (b"\x04\x22\x4d\x18", LZ4_FILE),
];
const ROS1_BAG: &str = "it is a ROS 1 bag";
const SQLITE_BAG: &str = "it is a ROS 2 bag in SQLite";
const ZSTD_FILE: &str = "it is compressed with zstd as a whole";
const LZ4_FILE: &str = "it is compressed with lz4 as a whole";

/// Why a file is not an MCAP file, by its first bytes.
pub(crate) fn what_it_is(start: &[u8]) -> &'static str {
    let known = KNOWN.iter().find(|(magic, _)| start.starts_with(&magic[..magic.len().min(8)]));
    match known {
        Some((_, what)) => what,
        None if start.is_empty() => "it is empty",
        None => "it does not begin with MCAP's magic bytes",
    }
}

/// The format of a recording that is not MCAP, by its first 16 bytes; `None` for an unknown one.
#[must_use]
pub fn recording_of_another_format(start: &[u8]) -> Option<&'static str> {
    KNOWN.iter().find(|(magic, _)| start.starts_with(magic)).map(|&(_, what)| what)
}

/// How to convert a recording that [`recording_of_another_format`] knows into MCAP.
#[must_use]
pub fn conversion_hint(path: &Path, what: &str) -> Option<Cow<'static, str>> {
    let shown = path.display();
    let stem = path.with_extension("");
    let stem = stem.display();
    let is_mcap = path.extension().is_some_and(|ending| ending == "mcap");
    Some(match what {
        ROS1_BAG => format!(
            "convert it: `pip install rosbags`, then `rosbags-convert --src {shown} --dst {stem} --dst-storage mcap`, and \
             name the folder `{stem}`"
        ),
        // The tools check the extension.
        SQLITE_BAG if is_mcap => {
            format!("convert it: `mv {shown} {stem}.db3`, then `mcap convert {stem}.db3 {shown}`, or `ros2 bag convert`")
        }
        SQLITE_BAG => format!("convert it: `mcap convert {shown} {stem}.mcap`, or `ros2 bag convert`"),
        ZSTD_FILE if is_mcap => format!("decompress it: `zstd -d {shown} -o {stem}_plain.mcap`"),
        ZSTD_FILE => format!("decompress it: `zstd -d {shown}`"),
        LZ4_FILE if is_mcap => format!("decompress it: `lz4 -d {shown} {stem}_plain.mcap`"),
        LZ4_FILE => format!("decompress it: `lz4 -d {shown}`"),
        _ => return None,
    }
    .into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_file_is_converted_onto_itself() {
        for what in [SQLITE_BAG, ZSTD_FILE, LZ4_FILE] {
            let hint = conversion_hint(Path::new("run.mcap"), what).unwrap();
            assert!(!hint.contains("run.mcap run.mcap") && !hint.ends_with("-d run.mcap`"), "{hint}");
            assert!(conversion_hint(Path::new("run.db3"), what).unwrap().contains(" run.db3"));
        }
    }
}
