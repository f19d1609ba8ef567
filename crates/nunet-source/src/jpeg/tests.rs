use std::io::Cursor;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder as _, Rgb, RgbImage};

use super::*;

/// An image with detail everywhere, so that every block has coefficients.
fn noisy(width: u32, height: u32) -> RgbImage {
    let value =
        |x: u32, y: u32, seed: u32| ((x * 31 + y * 17 + seed).wrapping_mul(2_654_435_761) >> 24) as u8;
    RgbImage::from_fn(width, height, |x, y| Rgb([value(x, y, 1), value(x, y, 7), (x * 3) as u8]))
}

fn baseline(width: u32, height: u32) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let image = noisy(width, height);
    JpegEncoder::new_with_quality(&mut file, 80)
        .write_image(&image, width, height, ExtendedColorType::Rgb8)
        .unwrap();
    file.into_inner()
}

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let kinds = [
        "gray",
        "420",
        "422",
        "444",
        "restart_420",
        "restart_gray",
        "progressive_420",
        "progressive_gray",
        "progressive_restart",
        "optimized_422",
        "cmyk",
    ];
    kinds.map(|kind| (kind, nunet_testkit::cases::read(&format!("jpeg_kinds/{kind}.jpg")))).to_vec()
}

#[test]
fn whole_files_of_every_kind_and_size_pass() {
    for (width, height) in [(1, 1), (7, 5), (8, 8), (16, 16), (17, 33), (64, 48), (101, 3)] {
        let file = baseline(width, height);
        assert_eq!(check(&file), Ok(file.len()), "{width}x{height}");
    }
    for (kind, file) in files() {
        assert_eq!(check(&file), Ok(file.len()), "{kind}");
    }
}

/// Where the entropy-coded data of the first scan begin.
fn first_scan(file: &[u8]) -> usize {
    let mut offset = 2;
    loop {
        let (marker, after) = next_marker(file, offset).unwrap();
        offset = after + 2 + segment(file, after).unwrap().len();
        if marker == START_OF_SCAN {
            return offset;
        }
    }
}

#[test]
fn a_file_that_ends_anywhere_is_refused_also_with_an_end_marker_behind_it() {
    for (kind, file) in files() {
        let start = first_scan(&file);
        for keep in (start..file.len() - 4).step_by(1 + file.len() / 60) {
            assert!(check(&file[..keep]).is_err(), "{kind}: {keep} of {} bytes", file.len());
            let ended = [&file[..keep], &[MARKER, END_OF_IMAGE]].concat();
            assert!(check(&ended).is_err(), "{kind}: {keep} of {} bytes and an end", file.len());
        }
    }
}

#[test]
fn bytes_that_were_lost_anywhere_in_the_middle_are_noticed() {
    for (kind, file) in files() {
        let start = first_scan(&file);
        let lost = 40.max(file.len() / 10);
        let mut passed = 0;
        let places: Vec<usize> = (start..file.len() - lost - 4).step_by(1 + file.len() / 60).collect();
        for &offset in &places {
            passed += usize::from(check(&[&file[..offset], &file[offset + lost..]].concat()).is_ok());
        }
        assert_eq!(passed, 0, "{kind}: of {} places", places.len());
    }
}

#[test]
fn a_restart_interval_that_is_missing_is_named() {
    let file = nunet_testkit::cases::read("jpeg_kinds/restart_420.jpg");
    let markers: Vec<usize> = (first_scan(&file)..file.len() - 1)
        .filter(|&at| file[at] == 0xff && (0xd0..=0xd7).contains(&file[at + 1]))
        .collect();
    assert!(markers.len() > 9, "the case is too small");
    let without = [&file[..markers[2]], &file[markers[3]..]].concat();
    assert!(
        matches!(check(&without), Err(JpegError::NoRestart { expected: 2, .. })),
        "{:?}",
        check(&without)
    );
    // Eight of them are one round of the numbers.
    let without = [&file[..markers[0]], &file[markers[8]..]].concat();
    assert!(check(&without).is_err());
}

#[test]
fn bytes_after_the_end_and_padding_before_it_are_ignored() {
    let file = baseline(64, 48);
    let behind = [&file[..], b"....ftypmp42\xff\xda\xff\xd8"].concat();
    assert_eq!(check(&behind), Ok(file.len()));
    let (scan, end) = file.split_at(file.len() - 2);
    for padding in [&[0_u8; 100][..], &[0xff; 100], &[1, 2, 3]] {
        assert!(check(&[scan, padding, end].concat()).is_ok(), "{padding:?}");
    }
    let more: Vec<u8> = (1..200).collect();
    assert!(matches!(check(&[scan, &more, end].concat()), Err(JpegError::TooMuch { .. })));
}

#[test]
fn zeros_that_replace_the_rest_of_a_scan_are_noticed() {
    let end = [MARKER, END_OF_IMAGE];
    for (kind, file) in files() {
        let start = first_scan(&file);
        for keep in (start..file.len() - 6).step_by(1 + file.len() / 60) {
            let zeros = [&file[..keep], &[0; 100_000], &end].concat();
            assert!(check(&zeros).is_err(), "{kind}: {keep} of {} bytes", file.len());
            let video = [&file[..keep], b"\0\0\0\x18ftypmp42", &[0; 5000], &end].concat();
            assert!(check(&video).is_err(), "{kind}: {keep} of {} bytes and a video", file.len());
        }
    }
    let file = baseline(64, 48);
    let lost = [&file[..file.len() - 200], &[0; 5000], &end].concat();
    assert!(matches!(check(&lost), Err(JpegError::Zeros { .. })), "{:?}", check(&lost));
}

#[test]
fn a_flat_image_is_mostly_zeros_and_passes() {
    for color in [[0; 3], [255; 3], [128; 3], [200, 30, 90]] {
        let mut file = Cursor::new(Vec::new());
        RgbImage::from_pixel(640, 480, Rgb(color)).write_to(&mut file, image::ImageFormat::Jpeg).unwrap();
        assert!(check(file.get_ref()).is_ok(), "{color:?}");
    }
    // Tables with one code for each kind: `0`. All blocks of this image are zeros.
    let table = |class| [&[MARKER, TABLES, 0, 20, class, 1][..], &[0; 15], &[0]].concat();
    let frame = [MARKER, 0xc0, 0, 11, 8, 0x01, 0xe0, 0x02, 0x80, 1, 1, 0x11, 0];
    let scan = [MARKER, START_OF_SCAN, 0, 8, 1, 1, 0, 0, 63, 0];
    let head = [&[MARKER, START_OF_IMAGE][..], &frame, &table(0), &table(0x10), &scan].concat();
    let flat = [&head[..], &[0; 80 * 60 * 2 / 8], &END].concat();
    assert_eq!(check(&flat), Ok(flat.len()));
    let padded = [&head[..], &[0; 80 * 60 * 2 / 8 + 5000], &END].concat();
    assert!(matches!(check(&padded), Err(JpegError::Zeros { .. })));
}

#[test]
fn a_whole_image_needs_no_end_marker() {
    for (kind, file) in files() {
        let whole = file.len() - 2;
        assert_eq!(check(&file[..whole]), Ok(whole), "{kind}");
        assert!(check(&[&file[..whole], &[0; 3000]].concat()).is_ok(), "{kind} with padding");
    }
}

#[test]
fn scans_are_limited() {
    let file = nunet_testkit::cases::read("jpeg_kinds/progressive_gray.jpg");
    let data = first_scan(&file);
    let start = file[..data].windows(2).rposition(|bytes| bytes == [MARKER, START_OF_SCAN]).unwrap();
    let end = next_marker(&file, data).unwrap().1 - 2;
    // The first scan gives the mean of each block, and can be repeated. Fewer than ten scans follow it.
    let repeated = |times| [&file[..start], &file[start..end].repeat(times), &file[end..]].concat();
    let many = repeated(MAX_SCANS - 10);
    assert_eq!(check(&many), Ok(many.len()));
    assert_eq!(check(&repeated(MAX_SCANS + 1)), Err(JpegError::TooManyScans));
}

#[test]
fn no_damage_panics() {
    for (_, file) in files() {
        for offset in 2..file.len().min(700) {
            for value in [0, 1, 0x7f, 0xff] {
                let mut damaged = file.clone();
                damaged[offset] = value;
                let _ = check(&damaged);
            }
        }
    }
}
