//! A JPEG's frame: its size and its components' blocks.

use super::JpegError;

/// The body of the segment whose length is at `offset`.
pub(super) fn segment(file: &[u8], offset: usize) -> Option<&[u8]> {
    let length = usize::from(u16::from_be_bytes(*file.get(offset..)?.first_chunk()?));
    file.get(offset + 2..offset + length.max(2))
}

/// A component's blocks.
#[derive(Debug)]
pub(super) struct FrameComponent {
    pub(super) id: u8,
    /// Blocks of an MCU in x and y.
    pub(super) sampling: (usize, usize),
    /// Blocks in x and y where the component is alone in a scan.
    pub(super) blocks: (usize, usize),
    /// Blocks from one row to the next, where scans interleave.
    pub(super) stride: usize,
    /// In a progressive image, a bit for each coefficient of each block: whether it is not zero.
    pub(super) nonzero: Vec<u64>,
    /// The lowest known bit of each coefficient.
    pub(super) known_to: [Option<u8>; 64],
}

/// A frame header.
#[derive(Debug)]
pub(super) struct JpegFrame {
    pub(super) progressive: bool,
    size: (usize, usize),
    /// MCUs in x and y.
    pub(super) mcus: (usize, usize),
    pub(super) components: Vec<FrameComponent>,
}

impl JpegFrame {
    pub(super) fn parse(body: &[u8], progressive: bool) -> Result<Self, JpegError> {
        let broken = JpegError::Header { what: "its frame header is broken" };
        let (&[_precision, y1, y2, x1, x2, count], rest) = body.split_first_chunk().ok_or(broken.clone())?;
        let (width, height) = (u16::from_be_bytes([x1, x2]).into(), u16::from_be_bytes([y1, y2]).into());
        let described = rest.as_chunks::<3>().0;
        let sampling = |byte: u8| (usize::from(byte >> 4), usize::from(byte & 15));
        let is_possible = |&[_, byte, _]: &[u8; 3]| {
            let (x, y) = sampling(byte);
            (1..=4).contains(&x) && (1..=4).contains(&y)
        };
        let count = usize::from(count);
        if !(1..=4).contains(&count) || described.len() < count || !described[..count].iter().all(is_possible)
        {
            return Err(broken);
        }
        let described = &described[..count];
        let most_x = described.iter().map(|[_, byte, _]| sampling(*byte).0).max().unwrap_or(1);
        let most_y = described.iter().map(|[_, byte, _]| sampling(*byte).1).max().unwrap_or(1);
        let mcus = (usize::div_ceil(width, 8 * most_x), usize::div_ceil(height, 8 * most_y));
        let component = |&[id, byte, _]: &[u8; 3]| {
            let (x, y) = sampling(byte);
            let blocks =
                ((width * x).div_ceil(most_x).div_ceil(8), (height * y).div_ceil(most_y).div_ceil(8));
            let stride = mcus.0 * x;
            FrameComponent { id, sampling: (x, y), blocks, stride, nonzero: Vec::new(), known_to: [None; 64] }
        };
        let components = described.iter().map(component).collect();
        Ok(Self { progressive, size: (width, height), mcus, components })
    }

    pub(super) fn pixels(&self) -> u64 {
        self.size.0 as u64 * self.size.1 as u64
    }

    /// A progressive image has several scans of increasing detail. The last ones may be missing
    /// although all blocks of the others are complete.
    pub(super) fn check_complete(&self) -> Result<(), JpegError> {
        let is_missing = |component: &FrameComponent| {
            let known = &component.known_to;
            known[0].is_none() || known.iter().flatten().any(|&bit| bit != 0)
        };
        match self.components.iter().position(is_missing) {
            Some(component) => Err(JpegError::ScansMissing { component: component + 1 }),
            None => Ok(()),
        }
    }
}
