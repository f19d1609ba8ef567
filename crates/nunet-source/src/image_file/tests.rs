use image::{Rgb, RgbImage};

use super::*;

fn image(color: [u8; 3]) -> RgbImage {
    RgbImage::from_pixel(4, 2, Rgb(color))
}

/// An EXIF block that says nothing but the orientation 6: the camera was turned a quarter to the right.
const EXIF_TURNED: [u8; 36] =
    *b"\xff\xe1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";

/// The text of the error for a file that cannot be decoded.
#[track_caller]
fn refused(path: &Path) -> String {
    bad_frame(decode(path, &mut Frame::default()).unwrap_err())
}

/// The text of the error for a frame.
#[track_caller]
fn bad_frame(error: SourceError) -> String {
    assert_eq!(error.kind(), SourceErrorKind::BadFrame, "{error:#}");
    error.to_string()
}

#[test]
fn gray_and_transparent_images_become_rgb() {
    let folder = tempfile::tempdir().unwrap();
    let rgb = DynamicImage::ImageRgb8(image([70, 70, 70]));
    rgb.to_luma8().save(folder.path().join("1.png")).unwrap();
    rgb.to_rgba8().save(folder.path().join("2.png")).unwrap();
    rgb.to_rgb16().save(folder.path().join("3.png")).unwrap();
    for name in ["1.png", "2.png", "3.png"] {
        let mut frame = Frame::default();
        decode(&folder.path().join(name), &mut frame).unwrap();
        assert_eq!(frame.view().unwrap().bytes()[..3], [70, 70, 70], "{name}");
    }
}

#[test]
fn the_largest_16_bit_value_is_known_without_alpha() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let maximum = |image: DynamicImage| {
        image.save(&path).unwrap();
        decode(&path, &mut Frame::default()).unwrap().maximum_16_bit
    };
    let rgba = image::ImageBuffer::from_pixel(2, 1, image::Rgba([7_u16, 4095, 8, u16::MAX]));
    let gray = image::ImageBuffer::from_pixel(2, 1, image::LumaA([1023_u16, u16::MAX]));
    assert_eq!(maximum(DynamicImage::ImageRgba16(rgba.clone())), Some(4095));
    assert_eq!(maximum(DynamicImage::ImageRgba16(rgba).to_rgb16().into()), Some(4095));
    assert_eq!(maximum(DynamicImage::ImageLumaA16(gray.clone())), Some(1023));
    assert_eq!(maximum(DynamicImage::ImageLumaA16(gray).to_luma16().into()), Some(1023));
    assert_eq!(maximum(DynamicImage::ImageRgb8(image([70, 70, 70]))), None);
}

#[test]
fn an_image_beyond_the_limits_is_refused_before_it_is_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wide.png");
    image::GrayImage::new(MAX_SIDE_PX + 1, 1).save(&path).unwrap();
    insta::assert_snapshot!(refused(&path), @"an image of 32769x1 pixels, expected at most 32768 a side");
    image::GrayImage::new(1, MAX_SIDE_PX + 1).save(path.with_extension("jpg")).unwrap();
    insta::assert_snapshot!(
        refused(&path.with_extension("jpg")),
        @"an image of 1x32769 pixels, expected at most 32768 a side"
    );
    image::GrayImage::new(MAX_SIDE_PX, 1).save(&path).unwrap();
    decode(&path, &mut Frame::default()).unwrap();
}

#[test]
fn the_error_for_another_file_type_has_the_type_found_and_the_types_expected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let refused = |content: &[u8]| {
        std::fs::write(&path, content).unwrap();
        refused(&path)
    };
    insta::assert_snapshot!(refused(b"BM\x46\0\0\0"), @"the image is Bmp, expected JPEG or PNG");
    insta::assert_snapshot!(
        refused(b"no image"),
        @"the file is not an image of a known format, expected JPEG or PNG"
    );
    insta::assert_snapshot!(refused(b""), @"the file is empty, expected JPEG or PNG");
    std::fs::write(&path, b"GIF89a").unwrap();
    insta::assert_snapshot!(
        bad_frame(decode_numbers(&path).unwrap_err()),
        @"the image is Gif, expected JPEG or PNG"
    );
}

#[test]
fn an_image_that_needs_too_much_memory_is_refused_before_it_is_decoded() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.png");
    image::GrayImage::new(12_000, 12_000).save(&path).unwrap();
    insta::assert_snapshot!(
        refused(&path),
        @"an image of 12000x12000 takes 549 MB to decode, over the limit of 512 MB"
    );
}

#[test]
fn a_jpeg_that_is_cut_off_anywhere_is_refused_and_a_whole_one_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.jpg");
    RgbImage::from_fn(64, 48, |x, y| Rgb([x as u8 * 3, y as u8 * 5, 90])).save(&path).unwrap();
    let whole = std::fs::read(&path).unwrap();
    decode(&path, &mut Frame::default()).unwrap();
    for keep in (0..whole.len() - 4).step_by(7) {
        std::fs::write(&path, &whole[..keep]).unwrap();
        assert!(decode(&path, &mut Frame::default()).is_err(), "{keep} of {} bytes pass", whole.len());
    }
}

#[test]
fn a_photograph_with_an_exif_rotation_becomes_upright() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("turned.jpg");
    RgbImage::from_fn(32, 16, |x, _| Rgb([if x < 16 { 0 } else { 255 }; 3])).save(&path).unwrap();
    let plain = std::fs::read(&path).unwrap();
    std::fs::write(&path, [&plain[..2], &EXIF_TURNED, &plain[2..]].concat()).unwrap();
    let mut frame = Frame::default();
    decode(&path, &mut frame).unwrap();
    assert_eq!(frame.size, (16, 32).into(), "what lay is standing");
    let bytes = frame.view().unwrap().bytes();
    assert!(bytes[0] < 20 && bytes[bytes.len() - 1] > 235, "the left edge is the upper one now");
}

#[test]
fn a_motion_jpeg_without_tables_is_read_and_kept_with_them() {
    let case = |name| nunet_testkit::cases::read(name);
    let mut frame = Frame { file: case("mjpeg_without_tables/no_dht.jpg"), ..Frame::default() };
    let before = frame.file.len();
    decode_file(&mut frame).unwrap();
    assert_eq!(frame.size, (64, 48).into());
    assert_eq!(frame.file.len(), before + 420, "a recording of it can be read by others");
}

#[test]
fn a_video_behind_a_photograph_is_cut_off_and_the_image_is_the_same() {
    let decoded = |name| {
        let mut frame = Frame { file: nunet_testkit::cases::read(name), ..Frame::default() };
        decode_file(&mut frame).unwrap();
        (frame.view().unwrap().bytes().to_vec(), frame.file)
    };
    assert_eq!(decoded("motion_photo/motion_photo.jpg"), decoded("motion_photo/plain.jpg"));
}

#[test]
fn a_jpeg_with_all_blocks_but_without_an_end_is_read_and_gets_one() {
    let whole = nunet_testkit::cases::read("jpeg_lost_middle/whole.jpg");
    let decoded = |file: Vec<u8>| {
        let mut frame = Frame { file, ..Frame::default() };
        decode_file(&mut frame).unwrap();
        (frame.view().unwrap().bytes().to_vec(), frame.file)
    };
    assert_eq!(decoded(whole[..whole.len() - 2].to_vec()), decoded(whole));
}

#[test]
fn bytes_before_a_jpeg_are_counted_in_the_error() {
    let whole = nunet_testkit::cases::read("jpeg_lost_middle/whole.jpg");
    let refused = |before: &[u8]| {
        let mut frame = Frame { file: [before, &whole].concat(), ..Frame::default() };
        bad_frame(decode_file(&mut frame).unwrap_err())
    };
    insta::assert_snapshot!(
        refused(&[0; 2]),
        @"the file has 2 bytes before a JPEG, expected JPEG or PNG"
    );
    insta::assert_snapshot!(
        refused(&[0; 16]),
        @"the file has 16 bytes before a JPEG, expected JPEG or PNG"
    );
    insta::assert_snapshot!(refused(&[0xff]), @"the file has 1 byte before a JPEG, expected JPEG or PNG");
}

#[test]
fn a_jpeg_that_lost_its_middle_or_its_rest_fails_with_the_reason() {
    let decoded = |file: Vec<u8>| decode_file(&mut Frame { file, ..Frame::default() });
    assert!(decoded(nunet_testkit::cases::read("jpeg_lost_middle/whole.jpg")).is_ok());
    for name in ["jpeg_lost_middle/lost.jpg", "jpeg_lost_middle/rest_grey.jpg"] {
        let file = nunet_testkit::cases::read(name);
        let reason = jpeg::check(&file).unwrap_err();
        assert!(matches!(reason, jpeg::JpegError::EndedEarly { .. }), "{name}: {reason}");
        assert_eq!(bad_frame(decoded(file).unwrap_err()), reason.to_string(), "{name}");
    }
}
