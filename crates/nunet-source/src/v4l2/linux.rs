//! Video devices of the Linux kernel: its requests and memory-mapped buffers, without any policy.
#![expect(unsafe_code, reason = "ioctl hands the kernel a pointer")]

use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::Duration;

use bytemuck::Pod;
use nunet_ipc::{monotonic_nanos, unix_nanos};
use nunet_types::ImageSize;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{FileType, Mode, OFlags, major};
use rustix::ioctl::{Opcode, Updater, ioctl, opcode};

use super::abi::{
    self, BufferRequest, BufferState, Capabilities, Control, ControlQuery, Description, FrameInterval,
    FrameSize, ImageFormat, PlanarFormat, Plane, StreamParameters,
};
use super::device::{
    Buffer, BufferFormat, Capability, ControlRange, Device, Errno, FourCc, Host, Interval, Intervals, Now,
    Result, Sizes,
};
use super::mapping::{MappedBuffer, Mapping};
use super::planes::{PlaneLayout, layouts};

const QUERY_CAPABILITIES: Opcode = opcode::read::<Capabilities>(b'V', 0);
const DESCRIBE_FORMAT: Opcode = opcode::read_write::<Description>(b'V', 2);
const SET_FORMAT: Opcode = opcode::read_write::<ImageFormat>(b'V', 5);
const SET_PLANAR_FORMAT: Opcode = opcode::read_write::<PlanarFormat>(b'V', 5);
const REQUEST_BUFFERS: Opcode = opcode::read_write::<BufferRequest>(b'V', 8);
const QUERY_BUFFER: Opcode = opcode::read_write::<BufferState>(b'V', 9);
const QUEUE_BUFFER: Opcode = opcode::read_write::<BufferState>(b'V', 15);
const DEQUEUE_BUFFER: Opcode = opcode::read_write::<BufferState>(b'V', 17);
const STREAM_ON: Opcode = opcode::write::<i32>(b'V', 18);
const STREAM_OFF: Opcode = opcode::write::<i32>(b'V', 19);
const GET_PARAMETERS: Opcode = opcode::read_write::<StreamParameters>(b'V', 21);
const SET_PARAMETERS: Opcode = opcode::read_write::<StreamParameters>(b'V', 22);
const SET_CONTROL: Opcode = opcode::read_write::<Control>(b'V', 28);
const QUERY_CONTROL: Opcode = opcode::read_write::<ControlQuery>(b'V', 36);
const DESCRIBE_SIZE: Opcode = opcode::read_write::<FrameSize>(b'V', 74);
const DESCRIBE_INTERVAL: Opcode = opcode::read_write::<FrameInterval>(b'V', 75);

/// All devices of V4L2 have this major number. Others are not even opened: opening a watchdog starts it.
const VIDEO_MAJOR: u32 = 81;
/// The most entries of a list that are read, in case a driver's list never ends.
const MAX_ENTRIES: u32 = 256;
/// The most buffers that are mapped; a driver may allocate more than requested.
const MAX_BUFFERS: u32 = 32;

/// This machine.
#[derive(Debug, Clone, Copy)]
pub(super) struct Linux;

impl Host for Linux {
    fn open(&mut self, path: &Path) -> Result<Box<dyn Device>> {
        let stat = rustix::fs::stat(path)?;
        let is_device = FileType::from_raw_mode(stat.st_mode) == FileType::CharacterDevice;
        if !is_device || major(stat.st_rdev) != VIDEO_MAJOR {
            return Err(Errno::NOTTY);
        }
        let file = rustix::fs::open(path, OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())?;
        Ok(Box::new(LinuxDevice::new(file)))
    }

    fn nodes(&self) -> Vec<PathBuf> {
        let Ok(entries) = Path::new("/dev").read_dir() else { return Vec::new() };
        let names = entries.flatten().filter_map(|entry| entry.file_name().into_string().ok());
        let mut numbers: Vec<u32> =
            names.filter_map(|name| name.strip_prefix("video")?.parse().ok()).collect();
        numbers.sort_unstable();
        numbers.into_iter().map(|number| format!("/dev/video{number}").into()).collect()
    }

    fn now(&self) -> Now {
        Now { monotonic_nanos: monotonic_nanos(), unix_nanos: unix_nanos() }
    }

    fn pause(&self, time: Duration) {
        std::thread::sleep(time);
    }
}

/// An open device. The buffers come first: they are unmapped before the device is closed.
struct LinuxDevice {
    buffers: Vec<MappedBuffer>,
    /// Whether buffers have planes, by the driver's interface for them.
    is_planar: bool,
    /// Planes of a buffer.
    plane_count: usize,
    /// How planes are joined; empty if an image is in one buffer.
    layouts: Vec<PlaneLayout>,
    file: OwnedFd,
}

impl LinuxDevice {
    fn new(file: OwnedFd) -> Self {
        Self { buffers: Vec::new(), is_planar: false, plane_count: 1, layouts: Vec::new(), file }
    }

    /// The kind of buffers.
    fn kind(&self) -> u32 {
        if self.is_planar { abi::CAPTURE_PLANES } else { abi::CAPTURE }
    }

    /// Sends a request about a buffer, and returns its state and planes.
    fn control_buffer<const OPCODE: Opcode>(
        &self,
        index: u32,
    ) -> Result<(BufferState, [Plane; abi::MAX_PLANES])> {
        let mut planes = [Plane::ZERO; abi::MAX_PLANES];
        let mut state = BufferState { index, kind: self.kind(), ..BufferState::ZERO };
        if self.is_planar {
            // The kernel reads and writes the array during the request, which it outlives.
            let address = planes.as_mut_ptr().expose_provenance() as u64;
            (state.offset, state.gap_behind_offset) = (address as u32, (address >> 32) as u32);
            state.length = self.plane_count as u32;
            self.control::<OPCODE, _>(&mut state)?;
        } else {
            self.control::<OPCODE, _>(&mut state)?;
            let BufferState { used, length, offset, .. } = state;
            planes[0] = Plane { used, length, offset, ..Plane::ZERO };
        }
        Ok((state, planes))
    }

    /// As [`Device::set_format`], for planes.
    fn set_planar_format(&mut self, format: FourCc, size: ImageSize) -> Result<BufferFormat> {
        let ImageSize { width, height } = size;
        let mut answer = PlanarFormat { width, height, format: format.0, ..PlanarFormat::ZERO };
        self.control::<SET_PLANAR_FORMAT, _>(&mut answer)?;
        let PlanarFormat { width, height, format, planes, plane_count, .. } = answer;
        let (format, size) = (FourCc(format), ImageSize { width, height });
        self.plane_count = usize::from(plane_count).clamp(1, abi::MAX_PLANES);
        let strides = [0, 1, 2].map(|plane: usize| planes[plane][1]);
        self.layouts = layouts(format, size, strides, self.plane_count).unwrap_or_default();
        if self.plane_count > 1 && self.layouts.is_empty() {
            return Err(Errno::NOTSUP);
        }
        Ok(BufferFormat { format, size, row_stride: strides[0] })
    }

    /// Sends a request (`ioctl`). The reply overwrites the argument.
    fn control<const OPCODE: Opcode, T: Pod>(&self, argument: &mut T) -> Result<()> {
        const {
            assert!(
                (OPCODE >> 16) as usize & 0x1fff == size_of::<T>(),
                "the argument must have the size of the request"
            );
        };
        loop {
            // SAFETY: the opcodes of this file are V4L2's, and carry the size of the structure that the
            // kernel reads and writes (asserted above); plain data stays valid whatever the kernel writes.
            let request = unsafe { Updater::<OPCODE, T>::new(argument) };
            // SAFETY: the device is one of V4L2 (its major number was checked), so it knows these opcodes. Of
            // the arguments, only the state of a buffer with planes holds a pointer: to an array that is as
            // long as the state says, and that its caller keeps.
            match unsafe { ioctl(&self.file, request) } {
                Err(Errno::INTR) => {}
                result => return result,
            }
        }
    }
}

impl Device for LinuxDevice {
    fn capability(&mut self) -> Result<Capability> {
        let mut answer = Capabilities::ZERO;
        self.control::<QUERY_CAPABILITIES, _>(&mut answer)?;
        let own = answer.capabilities & abi::HAS_DEVICE_CAPS != 0;
        let can = if own { answer.device_caps } else { answer.capabilities };
        self.is_planar = can & abi::CAN_CAPTURE == 0 && can & abi::CAN_CAPTURE_PLANES != 0;
        Ok(Capability {
            name: text(&answer.card),
            captures: can & (abi::CAN_CAPTURE | abi::CAN_CAPTURE_PLANES) != 0,
            streams: can & abi::CAN_STREAM != 0,
        })
    }

    fn formats(&mut self) -> Result<Vec<FourCc>> {
        list(|index| {
            let mut entry = Description { index, kind: self.kind(), ..Description::ZERO };
            self.control::<DESCRIBE_FORMAT, _>(&mut entry)?;
            Ok(FourCc(entry.format))
        })
    }

    fn sizes(&mut self, format: FourCc) -> Result<Vec<Sizes>> {
        list(|index| {
            let mut entry = FrameSize { index, format: format.0, ..FrameSize::ZERO };
            self.control::<DESCRIBE_SIZE, _>(&mut entry)?;
            let [a, b, c, d, e, f] = entry.sides;
            Ok(match entry.kind {
                abi::DISCRETE => Sizes::One(ImageSize::new(a, b)),
                _ => Sizes::Range {
                    least: ImageSize::new(a, d),
                    most: ImageSize::new(b, e),
                    step: ImageSize::new(c, f),
                },
            })
        })
    }

    fn intervals(
        &mut self,
        format: FourCc,
        ImageSize { width, height }: ImageSize,
    ) -> Result<Vec<Intervals>> {
        list(|index| {
            let mut entry = FrameInterval { index, format: format.0, width, height, ..FrameInterval::ZERO };
            self.control::<DESCRIBE_INTERVAL, _>(&mut entry)?;
            let [a, b, c, d, ..] = entry.seconds;
            let first = Interval { numerator: a, denominator: b };
            let second = Interval { numerator: c, denominator: d };
            Ok(match entry.kind {
                abi::DISCRETE => Intervals::One(first),
                _ => Intervals::Range { shortest: first, longest: second },
            })
        })
    }

    fn set_format(&mut self, format: FourCc, size: ImageSize) -> Result<BufferFormat> {
        if self.is_planar {
            return self.set_planar_format(format, size);
        }
        let ImageSize { width, height } = size;
        let mut answer = ImageFormat { width, height, format: format.0, ..ImageFormat::ZERO };
        self.control::<SET_FORMAT, _>(&mut answer)?;
        let ImageFormat { width, height, format, row_stride, .. } = answer;
        Ok(BufferFormat { format: FourCc(format), size: ImageSize { width, height }, row_stride })
    }

    fn set_interval(&mut self, interval: Interval) -> Result<Option<Interval>> {
        let mut answer = StreamParameters { kind: self.kind(), ..StreamParameters::ZERO };
        match self.control::<GET_PARAMETERS, _>(&mut answer) {
            Err(Errno::NOTTY | Errno::INVAL) => return Ok(None),
            result => result?,
        }
        if answer.capability & abi::CAN_SET_INTERVAL != 0 {
            (answer.numerator, answer.denominator) = (interval.numerator, interval.denominator);
            self.control::<SET_PARAMETERS, _>(&mut answer)?;
        }
        Ok(Some(Interval { numerator: answer.numerator, denominator: answer.denominator }))
    }

    fn start(&mut self, buffers: u32) -> Result<()> {
        let mut request = BufferRequest { count: buffers, kind: self.kind(), ..BufferRequest::ZERO };
        self.control::<REQUEST_BUFFERS, _>(&mut request)?;
        if request.count == 0 {
            return Err(Errno::NOMEM);
        }
        for index in 0..request.count.min(MAX_BUFFERS) {
            let (_, planes) = self.control_buffer::<QUERY_BUFFER>(index)?;
            let planes = planes.iter().take(self.plane_count);
            let mapped = planes.map(|plane| Mapping::of(&self.file, plane.offset, plane.length as usize));
            self.buffers.push(MappedBuffer::new(mapped.collect::<Result<_>>()?));
            self.control_buffer::<QUEUE_BUFFER>(index)?;
        }
        self.control::<STREAM_ON, _>(&mut (self.kind() as i32))
    }

    fn wait(&mut self, timeout: Duration) -> Result<bool> {
        let timeout = Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
        let mut files = [PollFd::new(&self.file, PollFlags::IN)];
        match poll(&mut files, Some(&timeout)) {
            Ok(0) | Err(Errno::INTR) => return Ok(false),
            result => result?,
        };
        let [file] = files;
        if file.revents().contains(PollFlags::IN) {
            return Ok(true);
        }
        // An unplugged device fails the next request, whose error is more specific than that of poll.
        self.capability()?;
        Err(Errno::IO)
    }

    fn dequeue(&mut self) -> Result<Option<Buffer>> {
        let (state, planes) = match self.control_buffer::<DEQUEUE_BUFFER>(0) {
            Err(Errno::AGAIN) => return Ok(None),
            result => result?,
        };
        let mapped = self.buffers.get_mut(state.index as usize).ok_or(Errno::IO)?;
        let used = mapped.take(&planes[..self.plane_count], &self.layouts);
        let fraction = state.microseconds.saturating_mul(1000);
        let nanos = state.seconds.saturating_mul(1_000_000_000).saturating_add(fraction);
        let monotonic = state.flags & abi::CLOCK_MASK == abi::CLOCK_MONOTONIC;
        Ok(Some(Buffer {
            index: state.index,
            used,
            flawed: state.flags & abi::FLAWED != 0,
            taken_nanos: monotonic.then_some(nanos),
        }))
    }

    fn bytes(&self, buffer: &Buffer) -> &[u8] {
        let mapped = self.buffers.get(buffer.index as usize);
        mapped.and_then(|mapped| mapped.bytes()?.get(..buffer.used)).unwrap_or_default()
    }

    fn queue(&mut self, buffer: Buffer) -> Result<()> {
        self.buffers.get_mut(buffer.index as usize).ok_or(Errno::INVAL)?.release();
        self.control_buffer::<QUEUE_BUFFER>(buffer.index).map(drop)
    }

    fn control_range(&mut self, id: u32) -> Result<Option<ControlRange>> {
        let mut answer = ControlQuery { id, ..ControlQuery::ZERO };
        match self.control::<QUERY_CONTROL, _>(&mut answer) {
            Err(Errno::INVAL | Errno::NOTTY) => return Ok(None),
            result => result?,
        }
        let is_usable = answer.flags & abi::UNUSABLE == 0;
        Ok(is_usable.then_some(ControlRange { least: answer.least, most: answer.most }))
    }

    fn set_control(&mut self, id: u32, value: i32) -> Result<()> {
        self.control::<SET_CONTROL, _>(&mut Control { id, value })
    }
}

impl Drop for LinuxDevice {
    fn drop(&mut self) {
        // An unplugged device has no stream to end, and other failures cannot be handled here.
        let _ = self.control::<STREAM_OFF, _>(&mut (self.kind() as i32));
    }
}

/// The entries of one of the driver's lists; empty if the driver has no such list.
fn list<T>(mut entry: impl FnMut(u32) -> Result<T>) -> Result<Vec<T>> {
    let mut entries = Vec::new();
    for index in 0..MAX_ENTRIES {
        match entry(index) {
            Err(Errno::INVAL | Errno::NOTTY) => break,
            result => entries.push(result?),
        }
    }
    Ok(entries)
}

/// A name from the device, without control characters.
fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).chars().filter(|letter| !letter.is_control()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As a C program prints them that includes the kernel's header.
    #[test]
    fn the_requests_are_the_kernel_s() {
        let known = [
            (QUERY_CAPABILITIES, 0x8068_5600),
            (DESCRIBE_FORMAT, 0xc040_5602),
            (SET_FORMAT, 0xc0d0_5605),
            (SET_PLANAR_FORMAT, 0xc0d0_5605),
            (SET_CONTROL, 0xc008_561c),
            (QUERY_CONTROL, 0xc044_5624),
            (REQUEST_BUFFERS, 0xc014_5608),
            (QUERY_BUFFER, 0xc058_5609),
            (QUEUE_BUFFER, 0xc058_560f),
            (DEQUEUE_BUFFER, 0xc058_5611),
            (STREAM_ON, 0x4004_5612),
            (STREAM_OFF, 0x4004_5613),
            (GET_PARAMETERS, 0xc0cc_5615),
            (SET_PARAMETERS, 0xc0cc_5616),
            (DESCRIBE_SIZE, 0xc02c_564a),
            (DESCRIBE_INTERVAL, 0xc034_564b),
        ];
        for (opcode, expected) in known {
            assert_eq!(opcode, expected, "{opcode:#x}");
        }
    }

    #[test]
    fn only_video_devices_are_opened() {
        let open = |path: &Path| Linux.open(path).err();
        assert_eq!(open(Path::new("/dev/null")), Some(Errno::NOTTY));
        assert_eq!(open(&std::env::temp_dir()), Some(Errno::NOTTY));
        assert_eq!(open(Path::new("/dev/video_that_is_not_there")), Some(Errno::NOENT));
    }

    /// A pipe replaces a driver without these requests: lists are empty, buffers fail, and dropping logs
    /// nothing.
    #[test]
    fn a_file_that_supports_no_request_returns_errors() {
        let (file, _other) = std::io::pipe().unwrap();
        let mut device = LinuxDevice::new(file.into());
        assert_eq!(device.capability(), Err(Errno::NOTTY));
        assert_eq!(device.formats(), Ok(vec![]));
        assert_eq!(device.set_interval(Interval::of_hz(30.0)), Ok(None));
        assert_eq!(device.start(4), Err(Errno::NOTTY));
        assert_eq!(device.control_range(1), Ok(None));
        assert_eq!(device.set_control(1, 1), Err(Errno::NOTTY));
        device.is_planar = true;
        assert_eq!(device.set_format(FourCc::new(b"NM12"), ImageSize::new(4, 2)), Err(Errno::NOTTY));
        assert_eq!(device.start(4), Err(Errno::NOTTY));
        assert_eq!(device.wait(Duration::ZERO), Ok(false));
        let buffer = Buffer { index: 0, used: 5, flawed: false, taken_nanos: None };
        assert!(device.bytes(&buffer).is_empty());
        assert_eq!(device.queue(buffer), Err(Errno::INVAL));
    }

    /// A file in memory replaces a driver's buffers, which are mapped the same way.
    #[test]
    fn a_buffer_is_readable_only_until_it_is_queued_again() {
        let file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut &file, &[7; 4096]).unwrap();
        let file = OwnedFd::from(file);
        let mut mapped = MappedBuffer::new(vec![Mapping::of(&file, 0, 4096).unwrap()]);
        assert_eq!(mapped.take(&[Plane { used: 5, ..Plane::ZERO }], &[]), 5);
        let mut device = LinuxDevice::new(file);
        device.buffers.push(mapped);
        let buffer = Buffer { index: 0, used: 5, flawed: false, taken_nanos: None };
        assert_eq!(device.bytes(&buffer), [7; 5]);
        assert_eq!(device.queue(buffer), Err(Errno::NOTTY), "a file takes no buffers back");
        let buffer = Buffer { index: 0, used: 5, flawed: false, taken_nanos: None };
        assert!(device.bytes(&buffer).is_empty(), "it was given back");
    }

    #[test]
    fn names_contain_no_control_characters() {
        assert_eq!(text(b"HD \x1b[2JWebcam\0rest"), "HD [2JWebcam");
        assert_eq!(text(b"full"), "full");
    }
}
