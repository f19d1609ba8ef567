//! Buffers of a driver that are mapped into our memory.
#![expect(unsafe_code, reason = "a driver's buffers are mapped into our memory")]

use std::os::fd::OwnedFd;
use std::ptr::{self, NonNull};

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

use super::abi::Plane;
use super::device::{Errno, Result};
use super::planes::{PlaneLayout, join};

/// A buffer of the driver.
pub(super) struct MappedBuffer {
    planes: Vec<Mapping>,
    /// Whether the driver has returned it and does not write into it.
    is_ours: bool,
    /// The planes one after the other, if the image is not in one buffer from its beginning.
    joined: Option<Vec<u8>>,
}

impl MappedBuffer {
    pub(super) fn new(planes: Vec<Mapping>) -> Self {
        Self { planes, is_ours: false, joined: None }
    }

    /// Takes over a filled buffer, and returns how many bytes its image has.
    pub(super) fn take(&mut self, filled: &[Plane], layouts: &[PlaneLayout]) -> usize {
        self.is_ours = true;
        let content = |(mapping, plane): (&Mapping, &Plane)| {
            let used = (plane.used as usize).min(mapping.bytes);
            (plane.data_offset as usize).min(used)..used
        };
        let mut contents = self.planes.iter().zip(filled).map(content);
        if layouts.is_empty()
            && let Some(only) = contents.next().filter(|only| only.start == 0)
        {
            self.joined = None;
            return only.end;
        }
        let mut joined = self.joined.take().unwrap_or_default();
        let planes = self.planes.iter().zip(filled).map(|pair| (pair.0, content(pair)));
        // SAFETY: the driver has returned the buffer, and does not write into it before it is queued again.
        let planes = planes.map(|(mapping, content)| unsafe { &mapping.bytes()[content] });
        if layouts.is_empty() {
            joined.clear();
            planes.for_each(|plane| joined.extend_from_slice(plane));
        } else {
            join(planes.zip(layouts.iter().copied()), &mut joined);
        }
        let used = joined.len();
        self.joined = Some(joined);
        used
    }

    /// To be called before the buffer is queued.
    pub(super) fn release(&mut self) {
        self.is_ours = false;
    }

    /// Its content; `None` while the driver owns it.
    pub(super) fn bytes(&self) -> Option<&[u8]> {
        if !self.is_ours {
            return None;
        }
        // SAFETY: the driver fills only buffers that are queued, and queueing this one clears `is_ours`
        // through an exclusive borrow, when no slice of it is left.
        let mapped = || self.planes.first().map(|plane| unsafe { plane.bytes() });
        self.joined.as_deref().or_else(mapped)
    }
}

/// Memory of the driver that is mapped into ours.
pub(super) struct Mapping {
    start: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the mapping belongs to the process, not to a thread, and only this value has its address.
unsafe impl Send for Mapping {}

impl Mapping {
    pub(super) fn of(file: &OwnedFd, offset: u32, bytes: usize) -> Result<Self> {
        // SAFETY: the kernel chooses a free address range, so no memory in use changes.
        let start = unsafe {
            mmap(ptr::null_mut(), bytes, ProtFlags::READ, MapFlags::SHARED, file, u64::from(offset))
        }?;
        let start = NonNull::new(start.cast()).ok_or(Errno::NOMEM)?;
        Ok(Self { start, bytes })
    }

    /// Its content.
    ///
    /// # Safety
    /// The driver must not write into it while the slice is used.
    unsafe fn bytes(&self) -> &[u8] {
        // SAFETY: the range stays mapped for as long as `self` lives; the caller keeps the driver out.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.bytes) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: the range is the one that was mapped, and no slice of it outlives `self`.
        let unmapped = unsafe { munmap(self.start.as_ptr().cast(), self.bytes) };
        debug_assert!(unmapped.is_ok(), "a range that was mapped can be unmapped");
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::ImageSize;

    use super::super::device::FourCc;
    use super::super::planes::layouts;
    use super::*;

    #[test]
    fn planes_are_joined_and_data_may_begin_later() {
        let file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut &file, &[[1; 4096], [2; 4096]].concat()).unwrap();
        let file = OwnedFd::from(file);
        let mapped = [0, 4096].map(|offset| Mapping::of(&file, offset, 4096).unwrap());
        let mut mapped = MappedBuffer::new(mapped.into());
        let filled = [8, 6].map(|used| Plane { used, data_offset: used - 4, ..Plane::ZERO });
        let joined = layouts(FourCc::new(b"NM12"), ImageSize::new(2, 2), [2, 2, 0], 2).unwrap();
        assert_eq!(mapped.take(&filled, &joined), 6);
        assert_eq!(mapped.bytes(), Some(&[1, 1, 1, 1, 2, 2][..]));
        assert_eq!(mapped.take(&filled[..1], &[]), 4, "one plane whose data does not begin with it");
        assert_eq!(mapped.bytes(), Some(&[1; 4][..]));
    }
}
