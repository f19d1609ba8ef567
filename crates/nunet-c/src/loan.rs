#![expect(unsafe_code, reason = "exported names")]
//! An image that is being filled.

use std::ffi::c_void;
use std::mem::MaybeUninit;
use std::sync::{Arc, Mutex};

use nunet_ipc::{FrameHeader, Loan};

use crate::argument::{fill, place, word};
use crate::camera::{ImagePublisher, PUBLISHERS};
use crate::handle::{Table, locked};
use crate::status::{Failure, StatusCode, guard};

/// The memory of an image that is not sent yet. Any thread may fill and send it.
#[derive(Debug)]
pub struct LoanHandle;

/// A loan, and the publisher that it is of.
#[derive(Debug)]
pub(crate) struct OpenLoan {
    // Given back before its publisher may end: the order of the fields. `None` once it was sent.
    loan: Option<Loan>,
    /// Its publisher lends nothing else while this is there.
    _token: Arc<()>,
    _camera: Arc<Mutex<ImagePublisher>>,
    /// The handle of its publisher.
    publisher: usize,
}

pub(crate) static LOANS: Table<OpenLoan> = Table::new("loan");

impl OpenLoan {
    pub(crate) fn new(
        loan: Loan,
        token: Arc<()>,
        camera: Arc<Mutex<ImagePublisher>>,
        publisher: usize,
    ) -> Self {
        Self { loan: Some(loan), _token: token, _camera: camera, publisher }
    }

    fn open(&mut self) -> Result<&mut Loan, Failure> {
        self.loan.as_mut().ok_or_else(|| LOANS.closed())
    }
}

/// The header of an image that is not sent yet. Size, encoding, sequence number, and what was set for the
/// publisher are filled in; the rest is zero. It may be changed; `topic`, `payload_bytes`, `contract_version`
/// and the times are written again by `nunet_loan_send()`. The numbers of later images continue from
/// `sequence`.
///
/// `*header` is valid until the loan is sent or released; NULL after a failure.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_loan_header(
    loan: *const LoanHandle,
    header: Option<&mut MaybeUninit<*mut FrameHeader>>,
) -> StatusCode {
    guard(|| {
        let header = place(header, "header", std::ptr::null_mut())?;
        let loan = LOANS.get(loan)?;
        *header = std::ptr::from_mut(locked(&loan).open()?.header_mut());
        Ok(())
    })
}

/// The pixels of an image that is not sent yet, aligned to 64 bytes: rows from the top without padding. They
/// still contain an earlier image.
///
/// `*bytes` is valid until the loan is sent or released; NULL after a failure. `byte_count` may be NULL.
///
/// Fails with `NUNET_CLOSED`, `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_loan_bytes(
    loan: *const LoanHandle,
    bytes: Option<&mut MaybeUninit<*mut c_void>>,
    byte_count: Option<&mut MaybeUninit<usize>>,
) -> StatusCode {
    guard(|| {
        let bytes = place(bytes, "bytes", std::ptr::null_mut())?;
        let loan = LOANS.get(loan)?;
        let mut loan = locked(&loan);
        let payload = loan.open()?.bytes_mut();
        *bytes = payload.as_mut_ptr().cast();
        fill(byte_count, payload.len());
        Ok(())
    })
}

/// Sends an image and wakes its readers. The loan is closed, also when this fails.
///
/// `clock`: the `nunet_clock_t` that `capture_nanos` was read from; `NUNET_CLOCK_MONOTONIC` for V4L2's times
/// and `nunet_monotonic_nanos()`. `capture_nanos`: the capture time, 0 or more; a reader of several topics
/// joins frames with one `sequence` and one `capture_nanos`. `capture_unix_nanos` is computed where it was
/// left 0; with `NUNET_CLOCK_MEDIA` it is the time of this call.
///
/// Fails with `NUNET_CLOSED`, also when the publisher was closed before; `NUNET_SYSTEM`,
/// `NUNET_BAD_ARGUMENT`.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_loan_send(loan: *mut LoanHandle, clock: u32, capture_nanos: i64) -> StatusCode {
    guard(|| {
        LOANS.refuse_null(loan)?;
        let open = LOANS.remove(loan)?.ok_or_else(|| LOANS.closed())?;
        let mut open = locked(&open);
        let clock = word(clock, "clock")?;
        let camera = PUBLISHERS.get::<()>(std::ptr::without_provenance(open.publisher))?;
        let loan = open.loan.take().ok_or_else(|| LOANS.closed())?;
        locked(&camera).send(loan, clock, capture_nanos)
    })
}

/// Returns a loan without sending it. NULL is allowed.
///
/// Fails with `NUNET_CLOSED` when it was sent or released before.
#[unsafe(no_mangle)]
pub extern "C" fn nunet_loan_release(loan: *mut LoanHandle) -> StatusCode {
    guard(|| LOANS.remove(loan).map(drop))
}
