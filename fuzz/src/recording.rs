//! MCAP files: container, CDR, protobuf, JSON, images and cameras.

use std::io::Write as _;

use nunet_mcap::{ImageEncoding, Next, RecordedImage, Recording, RecordingError};

/// No valid file of a few kilobytes has more; a chunk that unpacks to millions may end here.
const MAX_STEPS: usize = 100_000;

/// Reads every image and the camera of a file, once as images and once as depth.
pub fn recording(data: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("there is room for a small file");
    file.write_all(data).expect("there is room for a small file");
    read(Recording::open(file.path(), None));
    read(Recording::open_depth(file.path(), None));
}

fn read(opened: Result<Recording, RecordingError>) {
    let mut recording = match opened {
        Ok(recording) => recording,
        Err(error) => return check_message(&error),
    };
    let first = drain(&mut recording);
    if recording.rewind().is_ok() {
        assert_eq!(drain(&mut recording), first, "reading a file twice gives the same images");
    }
}

/// The number of images, valid and invalid.
fn drain(recording: &mut Recording) -> (u64, u64) {
    let mut image = RecordedImage::default();
    let (mut good, mut bad) = (0, 0);
    for _ in 0..MAX_STEPS {
        match recording.next(&mut image) {
            Next::Image => {
                check(&image);
                good += 1;
            }
            Next::Bad(error) => {
                check_message(&error);
                bad += 1;
            }
            Next::Nothing => {}
            Next::End => break,
            Next::Cut(error) => {
                check_message(&error);
                break;
            }
        }
    }
    (good, bad)
}

/// Checks that an image's description matches its bytes.
fn check(image: &RecordedImage) {
    let encoding = image.encoding.expect("an image that was read has an encoding");
    let rows = image.height as usize * image.row_stride as usize;
    match encoding {
        ImageEncoding::File | ImageEncoding::BayerFile(_) => assert!(image.data.len() > 3),
        ImageEncoding::Nv12 => assert!(image.data.len() >= rows / 2 * 3),
        _ => assert!(rows > 0 && image.data.len() >= rows),
    }
    let pixels = image.width as usize * image.height as usize;
    let depth = image.depth_m();
    assert_eq!(depth.len(), if encoding.is_depth() { pixels } else { 0 });
    assert!(depth.iter().all(|&meters| meters.is_nan() || meters > 0.0), "depth is positive, or it is none");
    let _ = image.unix_nanos();
}

/// An error has a text, and does not repeat the file.
fn check_message(error: &RecordingError) {
    let length = error.to_string().len();
    assert!((1..10_000).contains(&length), "an error of {length} bytes");
}
