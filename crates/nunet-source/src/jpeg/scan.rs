//! Reads one scan of a JPEG block by block.

use super::JpegError;
use super::bits::{Bits, HuffmanTable, ScanEnd};
use super::frame::JpegFrame;

/// Some cameras write a few surplus bytes; their images are complete.
const MAX_EXTRA_BYTES: usize = 16;
/// The last blocks of a flat image may end in up to this many zero bytes.
const MAX_ZEROS_BEFORE_PADDING: usize = 2;

type Tables = [Option<HuffmanTable>; 4];

/// A component in a scan, with its tables.
struct ScanComponent<'a> {
    component: usize,
    dc: Option<&'a HuffmanTable>,
    ac: Option<&'a HuffmanTable>,
}

/// A scan header.
pub(super) struct ScanHeader<'a> {
    parts: Vec<ScanComponent<'a>>,
    /// First and last coefficient.
    band: (usize, usize),
    /// Bit position before and after the scan (T.81: Ah, Al).
    approximation: (u8, u8),
}

impl<'a> ScanHeader<'a> {
    pub(super) fn parse(
        header: &[u8],
        frame: &JpegFrame,
        dc: &'a Tables,
        ac: &'a Tables,
    ) -> Result<Self, JpegError> {
        let broken = JpegError::Header { what: "its scan header is broken" };
        let (&count, rest) = header.split_first().ok_or(broken.clone())?;
        let (parts, rest) = rest.split_at_checked(2 * usize::from(count)).ok_or(broken.clone())?;
        let &[first, last, bits] = rest.first_chunk().ok_or(broken.clone())?;
        let part = |&[id, tables]: &[u8; 2]| {
            let component = frame.components.iter().position(|component| component.id == id)?;
            let table =
                |tables: &'a Tables, offset: u8| tables.get(usize::from(offset)).and_then(Option::as_ref);
            Some(ScanComponent { component, dc: table(dc, tables >> 4), ac: table(ac, tables & 15) })
        };
        let parts: Vec<ScanComponent<'a>> =
            parts.as_chunks().0.iter().map(part).collect::<Option<_>>().ok_or(broken.clone())?;
        let band = if frame.progressive { (first.into(), last.into()) } else { (0, 63) };
        if parts.is_empty() || band.0 > band.1 || band.1 > 63 || (band.0 > 0 && parts.len() > 1) {
            return Err(broken);
        }
        let approximation = if frame.progressive { (bits >> 4, bits & 15) } else { (0, 0) };
        Ok(Self { parts, band, approximation })
    }

    /// Reads the scan's data and returns their length in bytes.
    pub(super) fn walk(
        &self,
        frame: &mut JpegFrame,
        restart_interval: u32,
        data: &[u8],
    ) -> Result<usize, JpegError> {
        if frame.progressive {
            for part in &self.parts {
                let component = &mut frame.components[part.component];
                let blocks = component.stride * frame.mcus.1 * component.sampling.1;
                component.nonzero.resize(blocks, 0);
            }
        }
        let mut walk = Walk { bits: Bits::new(data), end_of_band_run: 0, read: 0 };
        let (mcus, blocks) = self.extent(frame);
        let expected = mcus as u64 * blocks;
        let stopped = |stop, read| match stop {
            ScanEnd::Ended => JpegError::EndedEarly { read, expected },
            ScanEnd::Invalid => JpegError::InvalidCode { read, expected },
            ScanEnd::Zeros => JpegError::Zeros { read, expected },
        };
        for mcu in 0..mcus {
            let due = restart_interval > 0 && mcu > 0 && mcu.is_multiple_of(restart_interval as usize);
            if due {
                let number = ((mcu / restart_interval as usize - 1) % 8) as u8;
                walk.restart(number, expected)?;
            }
            self.mcu(frame, mcu, &mut walk).map_err(|stop| stopped(stop, walk.read))?;
        }
        walk.check_rest(expected)?;
        Ok(walk.bits.offset())
    }

    /// MCUs of the scan, and blocks of each.
    fn extent(&self, frame: &JpegFrame) -> (usize, u64) {
        match self.parts.as_slice() {
            [alone] => {
                let (columns, rows) = frame.components[alone.component].blocks;
                (columns * rows, 1)
            }
            parts => {
                let blocks = |part: &ScanComponent<'_>| {
                    let (x, y) = frame.components[part.component].sampling;
                    (x * y) as u64
                };
                (frame.mcus.0 * frame.mcus.1, parts.iter().map(blocks).sum())
            }
        }
    }

    fn mcu(&self, frame: &mut JpegFrame, mcu: usize, walk: &mut Walk<'_>) -> Result<(), ScanEnd> {
        if let [alone] = self.parts.as_slice() {
            let component = &frame.components[alone.component];
            let (columns, stride) = (component.blocks.0, component.stride);
            return self.block(frame, alone, mcu / columns * stride + mcu % columns, walk);
        }
        let (column, row) = (mcu % frame.mcus.0, mcu / frame.mcus.0);
        for part in &self.parts {
            let component = &frame.components[part.component];
            let ((wide, high), stride) = (component.sampling, component.stride);
            for y in 0..high {
                for x in 0..wide {
                    self.block(frame, part, (row * high + y) * stride + column * wide + x, walk)?;
                }
            }
        }
        Ok(())
    }

    fn block(
        &self,
        frame: &mut JpegFrame,
        part: &ScanComponent<'a>,
        offset: usize,
        walk: &mut Walk<'_>,
    ) -> Result<(), ScanEnd> {
        let table = |table: Option<&'a HuffmanTable>| table.ok_or(ScanEnd::Invalid);
        let nonzero = frame.components[part.component].nonzero.get_mut(offset);
        match (self.band, self.approximation.0, nonzero) {
            (_, _, None) => {
                walk.first_dc(table(part.dc)?)?;
                walk.baseline_ac(table(part.ac)?)?;
            }
            ((0, _), 0, Some(_)) => walk.first_dc(table(part.dc)?)?,
            ((0, _), _, Some(_)) => walk.bits.take(1).map(drop)?,
            (band, 0, Some(nonzero)) => walk.first_ac(table(part.ac)?, band, nonzero)?,
            (band, _, Some(nonzero)) => walk.refine_ac(table(part.ac)?, band, nonzero)?,
        }
        walk.read += 1;
        Ok(())
    }

    /// Records which coefficients are known now.
    pub(super) fn note(&self, frame: &mut JpegFrame) {
        for part in &self.parts {
            frame.components[part.component].known_to[self.band.0..=self.band.1]
                .fill(Some(self.approximation.1));
        }
    }
}

/// The state of reading a scan.
struct Walk<'a> {
    bits: Bits<'a>,
    /// Blocks whose band has ended.
    end_of_band_run: u32,
    /// Blocks that were read.
    read: u64,
}

impl Walk<'_> {
    fn restart(&mut self, number: u8, expected: u64) -> Result<(), JpegError> {
        self.check_rest(expected)?;
        self.end_of_band_run = 0;
        if self.bits.restart(number) {
            return Ok(());
        }
        Err(JpegError::NoRestart { expected: number, read: self.read })
    }

    /// Checks what follows the last block. A few zeros are padding. Zeros that begin within the blocks and
    /// continue after them replaced lost data.
    fn check_rest(&mut self, expected: u64) -> Result<(), JpegError> {
        let began_before = self.bits.zero_bytes_taken() > MAX_ZEROS_BEFORE_PADDING;
        let (bytes, is_more_than_padding) = self.bits.rest();
        match bytes > MAX_EXTRA_BYTES {
            true if is_more_than_padding => Err(JpegError::TooMuch { bytes }),
            true if began_before => Err(JpegError::Zeros { read: self.read, expected }),
            _ => Ok(()),
        }
    }

    fn first_dc(&mut self, table: &HuffmanTable) -> Result<(), ScanEnd> {
        let size = self.bits.symbol(table)?;
        if size > 16 {
            return Err(ScanEnd::Invalid);
        }
        self.bits.take(size.into()).map(drop)
    }

    fn baseline_ac(&mut self, table: &HuffmanTable) -> Result<(), ScanEnd> {
        let mut offset = 1;
        while offset < 64 {
            let symbol = self.bits.symbol(table)?;
            let (run, size) = (symbol >> 4, symbol & 15);
            match (run, size) {
                (15, 0) => offset += 16,
                (_, 0) => break,
                (run, size) => {
                    offset += u32::from(run) + 1;
                    self.bits.coefficient(size.into())?;
                }
            }
        }
        if offset > 64 { Err(ScanEnd::Invalid) } else { Ok(()) }
    }

    /// Figure G.3.
    fn first_ac(
        &mut self,
        table: &HuffmanTable,
        (first, last): (usize, usize),
        nonzero: &mut u64,
    ) -> Result<(), ScanEnd> {
        if self.end_of_band_run > 0 {
            self.end_of_band_run -= 1;
            return Ok(());
        }
        let mut offset = first;
        while offset <= last {
            let symbol = self.bits.symbol(table)?;
            let (run, size) = (symbol >> 4, symbol & 15);
            match (run, size) {
                (15, 0) => offset += 16,
                (run, 0) => {
                    self.end_of_band_run = (1 << run) - 1 + self.bits.take(run.into())?;
                    return Ok(());
                }
                (run, size) => {
                    offset += usize::from(run);
                    if offset > last {
                        return Err(ScanEnd::Invalid);
                    }
                    self.bits.coefficient(size.into())?;
                    *nonzero |= 1 << offset;
                    offset += 1;
                }
            }
        }
        Ok(())
    }

    /// Figure G.7: each nonzero coefficient that is skipped is followed by a correction bit.
    fn refine_ac(
        &mut self,
        table: &HuffmanTable,
        (first, last): (usize, usize),
        nonzero: &mut u64,
    ) -> Result<(), ScanEnd> {
        let mut offset = first;
        if self.end_of_band_run == 0 {
            while offset <= last {
                let symbol = self.bits.symbol(table)?;
                let (run, size) = (symbol >> 4, symbol & 15);
                match (run, size) {
                    (15, 0) => {}
                    (run, 0) => {
                        self.end_of_band_run = (1 << run) + self.bits.take(run.into())?;
                        break;
                    }
                    (_, 1) => drop(self.bits.take(1)?),
                    _ => return Err(ScanEnd::Invalid),
                }
                offset = self.pass(run, offset, last, *nonzero)?;
                if size == 1 {
                    if offset > last {
                        return Err(ScanEnd::Invalid);
                    }
                    *nonzero |= 1 << offset;
                }
                offset += 1;
            }
        }
        if self.end_of_band_run > 0 {
            self.pass(u8::MAX, offset, last, *nonzero)?;
            self.end_of_band_run -= 1;
        }
        Ok(())
    }

    /// Skips `zeros` zero coefficients, and stops at the next one.
    fn pass(&mut self, zeros: u8, mut offset: usize, last: usize, nonzero: u64) -> Result<usize, ScanEnd> {
        let mut left = zeros;
        while offset <= last {
            if nonzero >> offset & 1 == 1 {
                self.bits.take(1)?;
            } else if left == 0 {
                break;
            } else {
                left -= 1;
            }
            offset += 1;
        }
        Ok(offset)
    }
}
