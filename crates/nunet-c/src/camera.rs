//! A publisher of images behind its handle, and the checks of what the caller says about the camera.

use std::sync::{Arc, Weak};

use nunet_ipc::{
    Clock, DistortionModel, Encoding, FrameHeader, IpcError, Loan, MAX_COEFFICIENTS, MAX_SIDE_PX, Publisher,
    Topic, Wake, monotonic_nanos, unix_nanos,
};

use crate::handle::Table;
use crate::status::Failure;

/// A publisher, and what all its images have in common.
#[derive(Debug)]
pub(crate) struct ImagePublisher {
    pub(crate) publisher: Publisher,
    next_sequence: u64,
    template: FrameHeader,
    lent: Weak<()>,
}

pub(crate) static PUBLISHERS: Table<ImagePublisher> = Table::new("publisher");

impl ImagePublisher {
    /// A camera whose images all have the size and encoding of `template`.
    pub(crate) fn new(publisher: Publisher, template: FrameHeader) -> Self {
        Self { publisher, next_sequence: 0, template, lent: Weak::new() }
    }

    /// The header that all images start with.
    #[cfg(test)]
    pub(crate) fn template(&self) -> &FrameHeader {
        &self.template
    }

    /// The bytes of each image.
    pub(crate) fn image_bytes(&self) -> usize {
        usize::try_from(self.template.payload_bytes).unwrap_or(usize::MAX)
    }

    /// Sets everything or nothing, under one lock, so that what another thread sets meanwhile is kept.
    pub(crate) fn set_intrinsics(
        &mut self,
        pinhole: [f64; 4],
        model: DistortionModel,
        coefficients: &[f64],
    ) -> Result<(), Failure> {
        let mut header = self.template;
        set_lens(&mut header, model, coefficients)?;
        set_pinhole(&mut header, pinhole)?;
        self.template = header;
        Ok(())
    }

    /// Sets the name of the coordinate frame.
    pub(crate) fn set_frame_id(&mut self, name: &str) -> Result<(), Failure> {
        let (bytes, most) = (name.len(), self.template.frame_id.len());
        if bytes > most {
            let message = format!("`frame_id` has {bytes} bytes, expected at most {most}");
            return Err(Failure::argument(message).hint("give the frame a shorter name"));
        }
        self.template.set_frame_id(name);
        Ok(())
    }

    /// A loan, and a token that must live as long as it.
    pub(crate) fn lend(&mut self) -> Result<(Loan, Arc<()>), Failure> {
        let (loan, token) = (self.loan()?, Arc::new(()));
        self.lent = Arc::downgrade(&token);
        Ok((loan, token))
    }

    /// Only one loan at a time. nunet-ipc would lend more while few readers hold chunks, but how many would
    /// depend on the readers, and two open loans would have the same sequence number.
    pub(crate) fn loan(&self) -> Result<Loan, Failure> {
        if self.lent.strong_count() > 0 {
            return Err(IpcError::TooManyLoans { topic: Topic::Rgb, limit: 1 }.into());
        }
        let mut loan = self.publisher.loan(Topic::Rgb)?;
        *loan.header_mut() = FrameHeader { sequence: self.next_sequence, ..self.template };
        Ok(loan)
    }

    /// Publishes a loan and wakes the readers.
    pub(crate) fn send(&mut self, mut loan: Loan, clock: Clock, capture_nanos: i64) -> Result<(), Failure> {
        let header = loan.header_mut();
        header.set_capture_clock(clock);
        header.capture_nanos = capture_nanos;
        header.capture_unix_nanos = header.unix_of_capture(monotonic_nanos(), unix_nanos());
        let sequence = header.sequence;
        loan.publish(monotonic_nanos())?;
        self.next_sequence = sequence.wrapping_add(1);
        self.publisher.notify(Wake::Image)?;
        Ok(())
    }
}

/// The header that all images of a camera start with.
pub(crate) fn template(encoding: Encoding, width: u32, height: u32) -> Result<FrameHeader, Failure> {
    for (name, side) in [("width", width), ("height", height)] {
        if !(1..=MAX_SIDE_PX).contains(&side) {
            return Err(Failure::argument(format!(
                "`{name}` is `{side}`, expected 1 to {MAX_SIDE_PX} pixels"
            ))
            .hint("pass the size of the camera's images, such as 640 and 480"));
        }
    }
    let Some(format) = encoding.pixel_format() else {
        return Err(Failure::argument(format!(
            "`encoding` is `{encoding}`, expected the encoding of an image"
        ))
        .hint("use rgb8, bgr8, mono8, yuyv or nv12"));
    };
    let (row_bytes, rows) = (format.min_stride(width), format.row_count(height));
    let mut header = FrameHeader { width, height, row_stride_bytes: row_bytes, ..FrameHeader::default() };
    header.set_topic(Topic::Rgb);
    header.set_encoding(encoding);
    header.payload_bytes = u64::from(row_bytes) * u64::from(rows);
    Ok(header)
}

fn set_pinhole(header: &mut FrameHeader, [fx, fy, cx, cy]: [f64; 4]) -> Result<(), Failure> {
    let focal = |value: f64| value.is_finite() && value > 0.0;
    if !focal(fx) || !focal(fy) || !cx.is_finite() || !cy.is_finite() {
        return Err(Failure::argument(format!("intrinsics `{fx}, {fy}, {cx}, {cy}`: expected positive focal lengths and a finite principal point, in \
             pixels")).hint("do not make this call without a calibration"));
    }
    (header.fx, header.fy, header.cx, header.cy) = (fx, fy, cx, cy);
    Ok(())
}

fn set_lens(header: &mut FrameHeader, model: DistortionModel, coefficients: &[f64]) -> Result<(), Failure> {
    let (count, most) = (coefficients.len(), model.max_coefficients());
    if count > most {
        return Err(Failure::argument(format!(
            "`coefficient_count` is `{count}`, but `{model}` has {most} coefficients at most"
        ))
        .hint("pass the `distortion_model` that the coefficients belong to"));
    }
    if let Some(bad) = coefficients.iter().find(|coefficient| !coefficient.is_finite()) {
        return Err(Failure::argument(format!("`coefficients` has `{bad}`, expected finite numbers"))
            .hint("initialize as many coefficients as `coefficient_count`"));
    }
    header.set_distortion_model(model);
    header.distortion = [0.0; MAX_COEFFICIENTS];
    header.distortion[..count].copy_from_slice(coefficients);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::StatusCode;

    #[test]
    fn images_have_the_bytes_that_their_encoding_needs() {
        let bytes = |encoding, width, height| template(encoding, width, height).unwrap().payload_bytes;
        assert_eq!(bytes(Encoding::Rgb8, 640, 480), 921_600);
        assert_eq!(bytes(Encoding::Mono8, 7, 5), 35);
        assert_eq!(bytes(Encoding::Yuyv, 7, 5), 80);
        assert_eq!(bytes(Encoding::Nv12, 7, 5), 64);
        assert_eq!(bytes(Encoding::Bgr8, MAX_SIDE_PX, MAX_SIDE_PX), 3 << 30);
    }

    #[test]
    fn sizes_and_encodings_that_no_image_has_are_refused() {
        for (encoding, width, height) in
            [(Encoding::Rgb8, 0, 480), (Encoding::Rgb8, 640, 32_769), (Encoding::DepthF32, 640, 480)]
        {
            let failure = template(encoding, width, height).unwrap_err();
            assert_eq!(failure.status, StatusCode::BadArgument, "{}", failure.message);
            assert!(failure.hint.is_some(), "{}", failure.message);
        }
    }

    #[test]
    fn an_invalid_lens_is_refused() {
        let mut header = FrameHeader::default();
        assert!(set_lens(&mut header, DistortionModel::None, &[0.1]).is_err());
        assert!(set_lens(&mut header, DistortionModel::KannalaBrandt, &[0.0; 5]).is_err());
        assert!(set_lens(&mut header, DistortionModel::BrownConrady, &[f64::NAN]).is_err());
        assert!(set_pinhole(&mut header, [0.0, 1.0, 0.0, 0.0]).is_err());
        assert_eq!(header, FrameHeader::default());
        set_lens(&mut header, DistortionModel::BrownConrady, &[0.1, -0.2]).unwrap();
        assert_eq!(header.distortion[..3], [0.1, -0.2, 0.0]);
    }
}
