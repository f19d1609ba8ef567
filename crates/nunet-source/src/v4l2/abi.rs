//! The kernel's structures (`linux/videodev2.h`), in the layout of a 64-bit kernel. Of a union, only the
//! member that is used here is named.

use std::mem::{offset_of, size_of};

use bytemuck::{Pod, Zeroable};

/// Images, each in one buffer (`V4L2_BUF_TYPE_VIDEO_CAPTURE`).
pub(super) const CAPTURE: u32 = 1;
/// Images whose planes may be in a buffer each (`V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE`).
pub(super) const CAPTURE_PLANES: u32 = 9;
/// `VIDEO_MAX_PLANES`
pub(super) const MAX_PLANES: usize = 8;
/// Buffers of the driver that we map (`V4L2_MEMORY_MMAP`).
pub(super) const MMAP: u32 = 1;
/// Whole images, not every second row (`V4L2_FIELD_NONE`).
pub(super) const PROGRESSIVE: u32 = 1;
/// Of frame sizes and intervals: this one, not a range (`V4L2_FRMSIZE_TYPE_DISCRETE`,
/// `V4L2_FRMIVAL_TYPE_DISCRETE`).
pub(super) const DISCRETE: u32 = 1;

/// `V4L2_CAP_VIDEO_CAPTURE`
pub(super) const CAN_CAPTURE: u32 = 0x1;
/// `V4L2_CAP_VIDEO_CAPTURE_MPLANE`
pub(super) const CAN_CAPTURE_PLANES: u32 = 0x1000;
/// `V4L2_CAP_STREAMING`
pub(super) const CAN_STREAM: u32 = 0x0400_0000;
/// `device_caps` are this device's, `capabilities` those of all devices of the camera
/// (`V4L2_CAP_DEVICE_CAPS`).
pub(super) const HAS_DEVICE_CAPS: u32 = 0x8000_0000;
/// `V4L2_CAP_TIMEPERFRAME`
pub(super) const CAN_SET_INTERVAL: u32 = 0x1000;

/// Of a control: it cannot be used (`V4L2_CTRL_FLAG_DISABLED`, `V4L2_CTRL_FLAG_READ_ONLY`).
pub(super) const UNUSABLE: u32 = 0x1 | 0x4;

/// `V4L2_BUF_FLAG_ERROR`
pub(super) const FLAWED: u32 = 0x40;
/// `V4L2_BUF_FLAG_TIMESTAMP_MASK`
pub(super) const CLOCK_MASK: u32 = 0xe000;
/// `V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC`
pub(super) const CLOCK_MONOTONIC: u32 = 0x2000;

// The structures that a request reads and writes: only numbers, without padding, so that all bits are valid.
// The derive checks both.
macro_rules! plain {
    ($($name:ident is $kernel:literal, $bytes:literal bytes { $($field:ident: $kind:ty = $zero:expr,)* })+) => { $(
        #[doc = concat!("`struct ", $kernel, "`")]
        #[repr(C)]
        #[allow(dead_code, reason = "the fields are the kernel's, not all of use here")]
        #[derive(Debug, Clone, Copy, Pod, Zeroable)]
        pub(super) struct $name { $(pub(super) $field: $kind,)* }

        impl $name {
            #[allow(dead_code, reason = "some are only made with all of their fields")]
            pub(super) const ZERO: Self = Self { $($field: $zero,)* };
        }

        const _: () = assert!(size_of::<$name>() == $bytes);
    )+ };
}

plain! {
    Capabilities is "v4l2_capability", 104 bytes {
        driver: [u8; 16] = [0; 16],
        card: [u8; 32] = [0; 32],
        bus: [u8; 32] = [0; 32],
        version: u32 = 0,
        capabilities: u32 = 0,
        device_caps: u32 = 0,
        reserved: [u32; 3] = [0; 3],
    }
    Description is "v4l2_fmtdesc", 64 bytes {
        index: u32 = 0,
        kind: u32 = CAPTURE,
        flags: u32 = 0,
        text: [u8; 32] = [0; 32],
        format: u32 = 0,
        bus_code: u32 = 0,
        reserved: [u32; 3] = [0; 3],
    }
    FrameSize is "v4l2_frmsizeenum", 44 bytes {
        index: u32 = 0,
        format: u32 = 0,
        kind: u32 = 0,
        // Discrete: width, height. Else least, most, step of the width, then of the height.
        sides: [u32; 6] = [0; 6],
        reserved: [u32; 2] = [0; 2],
    }
    FrameInterval is "v4l2_frmivalenum", 52 bytes {
        index: u32 = 0,
        format: u32 = 0,
        width: u32 = 0,
        height: u32 = 0,
        kind: u32 = 0,
        // Fractions. Discrete: one. Else shortest, longest, step.
        seconds: [u32; 6] = [0; 6],
        reserved: [u32; 2] = [0; 2],
    }
    ImageFormat is "v4l2_format", 208 bytes {
        kind: u32 = CAPTURE,
        gap: u32 = 0,
        width: u32 = 0,
        height: u32 = 0,
        format: u32 = 0,
        field: u32 = PROGRESSIVE,
        row_stride: u32 = 0,
        bytes: u32 = 0,
        rest: [u32; 44] = [0; 44],
    }
    PlanarFormat is "v4l2_format", 208 bytes {
        kind: u32 = CAPTURE_PLANES,
        gap: u32 = 0,
        width: u32 = 0,
        height: u32 = 0,
        format: u32 = 0,
        field: u32 = PROGRESSIVE,
        color_space: u32 = 0,
        // Of each plane: its bytes, bytes from row to row, three reserved.
        planes: [[u32; 5]; MAX_PLANES] = [[0; 5]; MAX_PLANES],
        plane_count: u8 = 0,
        flags: [u8; 11] = [0; 11],
        rest: [u8; 8] = [0; 8],
    }
    StreamParameters is "v4l2_streamparm", 204 bytes {
        kind: u32 = CAPTURE,
        capability: u32 = 0,
        mode: u32 = 0,
        numerator: u32 = 0,
        denominator: u32 = 0,
        rest: [u32; 46] = [0; 46],
    }
    BufferRequest is "v4l2_requestbuffers", 20 bytes {
        count: u32 = 0,
        kind: u32 = CAPTURE,
        memory: u32 = MMAP,
        capabilities: u32 = 0,
        flags: u32 = 0,
    }
    Plane is "v4l2_plane", 64 bytes {
        used: u32 = 0,
        length: u32 = 0,
        offset: u32 = 0,
        gap_behind_offset: u32 = 0,
        data_offset: u32 = 0,
        reserved: [u32; 11] = [0; 11],
    }
    Control is "v4l2_control", 8 bytes {
        id: u32 = 0,
        value: i32 = 0,
    }
    ControlQuery is "v4l2_queryctrl", 68 bytes {
        id: u32 = 0,
        kind: u32 = 0,
        name: [u8; 32] = [0; 32],
        least: i32 = 0,
        most: i32 = 0,
        step: i32 = 0,
        usual: i32 = 0,
        flags: u32 = 0,
        reserved: [u32; 2] = [0; 2],
    }
    BufferState is "v4l2_buffer", 88 bytes {
        index: u32 = 0,
        kind: u32 = CAPTURE,
        used: u32 = 0,
        flags: u32 = 0,
        field: u32 = 0,
        gap: u32 = 0,
        seconds: i64 = 0,
        microseconds: i64 = 0,
        timecode: [u32; 4] = [0; 4],
        sequence: u32 = 0,
        memory: u32 = MMAP,
        // With planes, both halves of the address of an array of `Plane`.
        offset: u32 = 0,
        gap_behind_offset: u32 = 0,
        length: u32 = 0,
        reserved: [u32; 3] = [0; 3],
    }
}

const _: () = {
    assert!(size_of::<usize>() == 8, "a 32-bit kernel has another layout of `v4l2_format` and `v4l2_buffer`");
    assert!(offset_of!(Capabilities, capabilities) == 84);
    assert!(offset_of!(Description, format) == 44);
    assert!(offset_of!(FrameSize, sides) == 12);
    assert!(offset_of!(FrameInterval, seconds) == 20);
    assert!(offset_of!(ImageFormat, width) == 8);
    assert!(offset_of!(PlanarFormat, planes) == 28);
    assert!(offset_of!(PlanarFormat, plane_count) == 188);
    assert!(offset_of!(Plane, data_offset) == 16);
    assert!(offset_of!(ControlQuery, least) == 40);
    assert!(offset_of!(ControlQuery, flags) == 56);
    assert!(offset_of!(StreamParameters, numerator) == 12);
    assert!(offset_of!(BufferState, seconds) == 24);
    assert!(offset_of!(BufferState, sequence) == 56);
    assert!(offset_of!(BufferState, offset) == 64);
    assert!(offset_of!(BufferState, length) == 72);
};
