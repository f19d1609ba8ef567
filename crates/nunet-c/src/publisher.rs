#![expect(unsafe_code, reason = "exported names, and texts that come as bare pointers")]
#![expect(clippy::missing_safety_doc, reason = "the header says once for all what pointers must be")]
//! A camera that publishes its images.

use std::ffi::{c_char, c_void};
use std::mem::MaybeUninit;
use std::sync::Arc;

use nunet_ipc::{Limits, Publisher, Topic, TopicPlan};

use crate::argument::{camera, place, slice, text, word};
use crate::camera::{ImagePublisher, PUBLISHERS, template};
use crate::handle::locked;
use crate::loan::{LOANS, LoanHandle, OpenLoan};
use crate::status::{Failure, StatusCode, guard};

/// The publisher of a camera's topic `rgb`. Calls with one publisher run one after the other, from any
/// threads.
#[derive(Debug)]
pub struct PublisherHandle;

/// Becomes the publisher of a camera, whose images `nunetd --source shm:CAMERA` reads; reserves the shared
/// memory for them.
///
/// `encoding`: a `nunet_encoding_t` of images (rgb8, bgr8, mono8, yuyv, nv12). `width`, `height`: pixels.
/// `max_readers`: how many may read the camera at a time; 0 for 4, and at most 64. `*publisher` is the
/// caller's, to be closed with `nunet_publisher_close()`; NULL after a failure.
///
/// Fails with `NUNET_ALREADY_PUBLISHED` when another process publishes this camera, `NUNET_SHARED_MEMORY`
/// when its memory does not fit, `NUNET_OTHER_LIMITS`, `NUNET_WRONG_CONTRACT_VERSION`, `NUNET_SYSTEM`,
/// `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_publisher_open(
    camera: *const c_char,
    encoding: u32,
    width: u32,
    height: u32,
    max_readers: u32,
    publisher: Option<&mut MaybeUninit<*mut PublisherHandle>>,
) -> StatusCode {
    guard(|| {
        let publisher = place(publisher, "publisher", std::ptr::null_mut())?;
        // SAFETY: the caller passes a text or NULL.
        let camera = unsafe { self::camera(camera) }?;
        let template = template(word(encoding, "encoding")?, width, height)?;
        let payload_bytes = usize::try_from(template.payload_bytes).unwrap_or(usize::MAX);
        let plan = TopicPlan { topic: Topic::Rgb, payload_bytes };
        let mut limits = Limits::DEFAULT;
        if max_readers != 0 {
            limits.max_readers = max_readers as usize;
        }
        let opened = Publisher::create(&camera, &[plan], &limits)?;
        *publisher = PUBLISHERS.insert(ImagePublisher::new(opened, template));
        Ok(())
    })
}

/// Sets the camera's intrinsics, which every later image carries. They are needed for depth in meters;
/// without this call the camera is unknown.
///
/// `fx`, `fy`: focal lengths in pixels at the publisher's size. `cx`, `cy`: principal point in pixels; the
/// center of the first pixel is 0. `distortion_model`: a `nunet_distortion_model_t`; `coefficients`:
/// `coefficient_count` of its coefficients (at most 14; `NUNET_DISTORTION_MODEL_NONE` has none), copied.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_publisher_set_camera(
    publisher: *const PublisherHandle,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion_model: u32,
    coefficients: *const f64,
    coefficient_count: usize,
) -> StatusCode {
    guard(|| {
        let owned = PUBLISHERS.get(publisher)?;
        // SAFETY: the caller passes an array of that length or NULL.
        let coefficients = unsafe { slice(coefficients, coefficient_count, "coefficients") }?;
        let model = word(distortion_model, "distortion_model")?;
        locked(&owned).set_intrinsics([fx, fy, cx, cy], model, coefficients)
    })
}

/// Sets the name of the camera's coordinate frame, which every later image carries: UTF-8, at most 64 bytes,
/// copied.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_publisher_set_frame_id(
    publisher: *const PublisherHandle,
    frame_id: *const c_char,
) -> StatusCode {
    guard(|| {
        let owned = PUBLISHERS.get(publisher)?;
        // SAFETY: the caller passes a text or NULL.
        let name = unsafe { text(frame_id, "frame_id") }?;
        locked(&owned).set_frame_id(name)
    })
}

/// Borrows the memory of the next image, to be filled in place: readers see the same memory, and nothing is
/// copied. One loan may be open at a time.
///
/// `*loan` is the caller's, to be sent with `nunet_loan_send()` or given back with `nunet_loan_release()`;
/// NULL after a failure.
///
/// Fails with `NUNET_TOO_MANY_LOANS`, `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_publisher_loan(
    publisher: *const PublisherHandle,
    loan: Option<&mut MaybeUninit<*mut LoanHandle>>,
) -> StatusCode {
    guard(|| {
        let loan = place(loan, "loan", std::ptr::null_mut())?;
        let owned = PUBLISHERS.get(publisher)?;
        let mut camera = locked(&owned);
        let (image, token) = camera.lend()?;
        *loan = LOANS.insert(OpenLoan::new(image, token, Arc::clone(&owned), publisher.addr()));
        Ok(())
    })
}

/// Publishes a copy of an image that is in other memory already; `nunet_publisher_loan()` avoids the copy.
///
/// `bytes`: `byte_count` of them, exactly as many as an image of the publisher's size and encoding has
/// without padding between rows. `clock` and `capture_nanos` as in `nunet_loan_send()`.
///
/// Fails with `NUNET_TOO_MANY_LOANS` while a loan is open, `NUNET_SYSTEM`, `NUNET_CLOSED`,
/// `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn nunet_publisher_publish(
    publisher: *const PublisherHandle,
    bytes: *const c_void,
    byte_count: usize,
    clock: u32,
    capture_nanos: i64,
) -> StatusCode {
    guard(|| {
        let owned = PUBLISHERS.get(publisher)?;
        // SAFETY: the caller passes an array of that length or NULL.
        let image = unsafe { slice(bytes.cast::<u8>(), byte_count, "bytes") }?;
        let clock = word(clock, "clock")?;
        let mut owned = locked(&owned);
        let expected = owned.image_bytes();
        if byte_count != expected {
            return Err(Failure::argument(format!("`byte_count` is `{byte_count}`, expected {expected}"))
                .hint("pass rows without padding; if the source has padding, fill a loan row by row"));
        }
        let mut loan = owned.loan()?;
        loan.bytes_mut().copy_from_slice(image);
        owned.send(loan, clock, capture_nanos)
    })
}

/// Whether the camera has readers: an image without readers need not be computed. A killed reader counts
/// until some process cleans up after it. False for a publisher that is closed or NULL.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_publisher_has_readers(publisher: *const PublisherHandle) -> bool {
    let mut read = false;
    guard(|| {
        read = locked(&*PUBLISHERS.get(publisher)?).publisher.has_readers(Topic::Rgb);
        Ok(())
    }) == StatusCode::Ok
        && read
}

/// Sends the newest image to readers that opened since. Sending an image does the same: this is for sources
/// that are paused; call it a few times per second.
///
/// Fails with `NUNET_SYSTEM`, `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_publisher_refresh(publisher: *const PublisherHandle) -> StatusCode {
    guard(|| Ok(locked(&*PUBLISHERS.get(publisher)?).publisher.refresh()?))
}

/// Closes a publisher, so that the camera may have another one. An open loan can only be released afterwards,
/// and keeps the camera until it is. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when it was closed before.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_publisher_close(publisher: *mut PublisherHandle) -> StatusCode {
    guard(|| PUBLISHERS.remove(publisher).map(drop))
}

#[cfg(test)]
mod tests {
    use std::ffi::CString;

    use nunet_ipc::Encoding;

    use super::*;

    #[test]
    fn concurrent_setters_do_not_lose_each_others_values() {
        const TURNS: u32 = 20_000;
        // One per user: a folder of another user cannot be used.
        let user = std::os::unix::fs::MetadataExt::uid(&std::fs::metadata("/proc/self").unwrap());
        nunet_ipc::use_root(&std::env::temp_dir().join(format!("nunet-{user}"))).unwrap();
        let name = CString::new(format!("test-{}-set", std::process::id())).unwrap();
        let mut opened = MaybeUninit::new(std::ptr::null_mut());
        // SAFETY: a text that outlives the call.
        let status = unsafe {
            nunet_publisher_open(name.as_ptr(), Encoding::Mono8.into(), 4, 4, 1, Some(&mut opened))
        };
        assert_eq!(status, StatusCode::Ok);
        // SAFETY: initialized above, and filled since.
        let publisher = unsafe { opened.assume_init() };
        let handle = publisher.addr();
        let lost = std::thread::scope(|scope| {
            scope.spawn(move || {
                for turn in 1..=TURNS {
                    let publisher = std::ptr::without_provenance(handle);
                    let focal = f64::from(turn);
                    // SAFETY: no coefficients.
                    unsafe {
                        nunet_publisher_set_camera(publisher, focal, focal, 0.0, 0.0, 0, std::ptr::null(), 0)
                    };
                }
            });
            let names = (0..TURNS).map(|turn| CString::new(turn.to_string()).unwrap());
            let is_lost = |name: &CString| {
                // SAFETY: a text that outlives the call.
                unsafe { nunet_publisher_set_frame_id(publisher, name.as_ptr()) };
                let camera = PUBLISHERS.get::<PublisherHandle>(publisher).unwrap();
                locked(&camera).template().frame_id().as_bytes() != name.as_bytes()
            };
            names.filter(is_lost).count()
        });
        let camera = PUBLISHERS.get::<PublisherHandle>(publisher).unwrap();
        assert_eq!((lost, locked(&camera).template().fx), (0, f64::from(TURNS)));
        drop(camera);
        assert_eq!(nunet_publisher_close(publisher), StatusCode::Ok);
    }
}
