use nunet_core::camera::{Distortion, Intrinsics};

use super::*;

/// Three columns and two rows:
/// ```text
/// 1 2 3
/// 4 5 6
/// ```
const SIZE: ImageSize = ImageSize { width: 3, height: 2 };
const GRAY: [u8; 6] = [1, 2, 3, 4, 5, 6];
/// The same after each rotation, by hand.
const EXPECTED: [(Rotation, [u8; 6]); 3] = [
    (Rotation::Quarter, [4, 1, 5, 2, 6, 3]),
    (Rotation::Half, [6, 5, 4, 3, 2, 1]),
    (Rotation::ThreeQuarters, [3, 6, 2, 5, 1, 4]),
];

/// A frame of rows that are two bytes longer than their pixels.
fn padded(format: PixelFormat, rows: [&[u8]; 2]) -> Frame {
    let row_stride = format.min_stride(SIZE.width) + 2;
    let bytes = rows.map(|row| [row, &[99, 99]].concat()).concat();
    let pixels = Pixels::Owned(bytes);
    Frame { pixels, size: SIZE, row_stride, format: Some(format), ..Frame::default() }
}

fn spread(gray: &[u8]) -> Vec<u8> {
    gray.iter().flat_map(|&value| [value, value + 10, value + 20]).collect()
}

#[test]
fn every_pixel_is_where_it_belongs_after_each_rotation() {
    for (rotation, expected) in EXPECTED {
        let mut frame = padded(PixelFormat::Mono8, [&GRAY[..3], &GRAY[3..]]);
        Rotator::new(rotation).rotate(&mut frame).unwrap();
        let view = frame.view().unwrap();
        assert_eq!((view.bytes(), view.is_packed()), (&expected[..], true), "{rotation}");
        assert_eq!(view.size(), rotation.size(SIZE));
        assert_eq!(frame.bytes_copied, 6);
        assert_eq!(rotation.values(SIZE, &GRAY.map(u16::from)), expected.map(u16::from));
        for format in [PixelFormat::Rgb8, PixelFormat::Bgr8] {
            let mut frame = padded(format, [&spread(&GRAY[..3]), &spread(&GRAY[3..])]);
            Rotator::new(rotation).rotate(&mut frame).unwrap();
            assert_eq!(frame.view().unwrap().bytes(), spread(&expected), "{rotation} {format}");
            assert_eq!(frame.format, Some(format));
        }
    }
}

#[test]
fn images_larger_than_a_tile_are_rotated_as_a_whole() {
    let size = ImageSize::new(2 * TILE_PX as u32 + 5, TILE_PX as u32 + 3);
    let values: Vec<u32> = (0..).take(size.pixel_count()).collect();
    for rotation in Rotation::ALL {
        let rotated = rotation.values(size, &values);
        assert_ne!(rotated, values);
        assert_eq!(rotation.inverse().values(rotation.size(size), &rotated), values, "{rotation}");
    }
}

/// Formats with shared color become RGB, with the colors that the pipeline gives them.
#[test]
fn formats_that_share_color_are_converted_and_rotated() {
    for format in [PixelFormat::Yuyv, PixelFormat::Nv12] {
        for size in [ImageSize::new(6, 4), ImageSize::new(5, 3)] {
            let row_stride = format.min_stride(size.width);
            let bytes: Vec<u8> = (0..format.byte_len(size.width, size.height, row_stride))
                .map(|index| (40 + 5 * index % 150) as u8)
                .collect();
            let view = ImageView::packed(&bytes, size.width, size.height, format).unwrap();
            let rgb = Preprocessor::new(size.width, size.height).prepare(&view).rgb.to_vec();
            for rotation in Rotation::ALL {
                let pixels = Pixels::Owned(bytes.clone());
                let mut frame = Frame { pixels, size, row_stride, format: Some(format), ..Frame::default() };
                Rotator::new(rotation).rotate(&mut frame).unwrap();
                let expected = rotation.values(size, rgb.as_chunks::<3>().0).concat();
                assert_eq!(frame.view().unwrap().bytes(), expected, "{format} {size} {rotation}");
                assert_eq!(frame.format, Some(PixelFormat::Rgb8));
            }
        }
    }
}

#[test]
fn the_camera_is_rotated_and_a_file_does_not_stay() {
    let camera = Camera::pinhole(Intrinsics::new(50.0, 60.0, 1.0, 0.25, 3, 2).unwrap());
    let expected = [
        (Rotation::Quarter, [60.0, 50.0, 0.75, 1.0]),
        (Rotation::Half, [50.0, 60.0, 1.0, 0.75]),
        (Rotation::ThreeQuarters, [60.0, 50.0, 0.25, 1.0]),
    ];
    for (rotation, [fx, fy, cx, cy]) in expected {
        let mut frame = padded(PixelFormat::Mono8, [&GRAY[..3], &GRAY[3..]]);
        (frame.camera, frame.file) = (Some(camera), vec![0xff, 0xd8]);
        Rotator::new(rotation).rotate(&mut frame).unwrap();
        let ImageSize { width, height } = rotation.size(SIZE);
        let intrinsics = Intrinsics::new(fx, fy, cx, cy, width, height).unwrap();
        assert_eq!(frame.camera, Some(Camera { intrinsics, distortion: Distortion::None }), "{rotation}");
        assert!(frame.file.is_empty() && frame.is_turned);
        assert_eq!(rotation.inverse().camera(&frame.camera.unwrap()), Ok(camera));
    }
}

#[test]
fn steady_frames_reuse_two_buffers() {
    let mut rotator = Rotator::new(Rotation::Quarter);
    let mut frame = Frame::default();
    let mut places = Vec::new();
    for _ in 0..6 {
        frame.rgb_buffer(SIZE).fill(7);
        rotator.rotate(&mut frame).unwrap();
        places.push(frame.view().unwrap().bytes().as_ptr());
    }
    places.dedup();
    assert_eq!((places[2], places[3]), (places[4], places[5]));
}

#[test]
fn only_three_angles_are_rotations() {
    for (text, rotation) in [("90", Rotation::Quarter), ("180", Rotation::Half)] {
        assert_eq!(text.parse(), Ok(rotation));
    }
    for text in ["", "0", "45", "360", "-90", "90.0", "left", "090"] {
        let error = text.parse::<Rotation>().unwrap_err();
        assert_eq!(error, format!("expected 90, 180 or 270 (degrees clockwise), got `{text}`"));
    }
}
