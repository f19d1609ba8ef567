//! The header that another process writes into shared memory.

use nunet_core::frame::{ImageView, PixelFormat};
use nunet_ipc::FrameHeader;
use nunet_source::camera_in;

/// Numbers one after the other, zeros at the end.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        let count = N.min(self.0.len());
        bytes[..count].copy_from_slice(&self.0[..count]);
        self.0 = &self.0[count..];
        bytes
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn real(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }
}

/// A header of arbitrary numbers: each word is known or an error, each text is UTF-8, and its camera is valid
/// or refused.
pub fn header(data: &[u8]) {
    let header = header_of(&mut Numbers(data));
    check_words(&header);
    assert!(header.stages().len() <= header.stage_micros.len());
    assert!(header.frame_id().len() <= 3 * header.frame_id.len(), "each bad byte becomes three");
    for format in [PixelFormat::Rgb8, PixelFormat::Mono8, PixelFormat::Yuyv, PixelFormat::Nv12] {
        let pixels = [0; 256];
        let view = ImageView::new(&pixels, header.width, header.height, header.row_stride_bytes, format);
        assert!(view.is_err() || header.height as usize <= pixels.len(), "each row has its bytes");
    }
    if let Ok(Some(camera)) = camera_in(&header) {
        assert!(camera.intrinsics.fx_px.is_finite() && camera.intrinsics.fx_px > 0.0);
        assert_eq!((camera.intrinsics.width, camera.intrinsics.height), (header.width, header.height));
    }
}

fn header_of(numbers: &mut Numbers<'_>) -> FrameHeader {
    FrameHeader {
        topic: numbers.word(),
        encoding: numbers.word(),
        units: numbers.word(),
        scale_source: numbers.word(),
        capture_clock: numbers.word(),
        quality: numbers.word(),
        distortion_model: numbers.word(),
        stage_count: numbers.word(),
        width: numbers.word(),
        height: numbers.word(),
        row_stride_bytes: numbers.word(),
        fx: numbers.real(),
        fy: numbers.real(),
        cx: numbers.real(),
        cy: numbers.real(),
        distortion: std::array::from_fn(|_| numbers.real()),
        stage_micros: std::array::from_fn(|_| numbers.word()),
        frame_id: numbers.take(),
        ..FrameHeader::default()
    }
}

/// Every word has a meaning or gives a short error.
fn check_words(header: &FrameHeader) {
    let known = [
        header.topic().map(drop),
        header.encoding().map(drop),
        header.units().map(drop),
        header.scale_source().map(drop),
        header.capture_clock().map(drop),
        header.quality().map(drop),
        header.distortion_model().map(drop),
    ];
    for unknown in known.into_iter().filter_map(Result::err) {
        assert!(unknown.to_string().len() < 200, "{unknown}");
    }
}
