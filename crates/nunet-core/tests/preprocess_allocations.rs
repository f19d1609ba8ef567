//! After the first frame of a size, preprocessing takes no memory.
#![expect(unsafe_code, reason = "a counting allocator is an unsafe trait")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use nunet_core::frame::{ImageView, PixelFormat};
use nunet_core::preprocess::Preprocessor;

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the pointer came from `alloc` above, which had it from the system.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

// The only test of this file: another thread's allocations would be counted too.
#[test]
fn later_frames_of_a_size_allocate_nothing() {
    for format in PixelFormat::ALL {
        for (width, height) in [(64, 48), (131, 97), (40, 20)] {
            let bytes = vec![100; format.byte_len(width, height, format.min_stride(width))];
            let frame = ImageView::packed(&bytes, width, height, format).unwrap();
            let mut preprocessor = Preprocessor::new(64, 48);
            preprocessor.prepare(&frame);
            let before = ALLOCATIONS.load(Ordering::Relaxed);
            for _ in 0..3 {
                preprocessor.prepare(&frame);
            }
            let allocations = ALLOCATIONS.load(Ordering::Relaxed) - before;
            assert_eq!(allocations, 0, "{format} {width}x{height}");
        }
    }
}
