//! Bits of an entropy-coded segment, and Huffman codes in them.

/// A coefficient after this many zero bytes is not data. If the code of a coefficient is all zeros, that of
/// the end of a block is not, so a run of zeros has at most the 63 coefficients of a block and part of the
/// next one, or blocks without coefficients.
const MAX_ZERO_BYTES: usize = 40;

/// Codes of up to this many bits are decoded by one table lookup.
const LOOKUP_BITS: u32 = 9;

/// Why no bits can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ScanEnd {
    /// The segment has no more bits.
    Ended,
    /// No code has these bits.
    Invalid,
    /// Zero bytes that no encoder writes.
    Zeros,
}

/// A Huffman table as ITU T.81, C.2 and F.2.2.3 build it.
#[derive(Debug, Clone)]
pub(super) struct HuffmanTable {
    /// Length and symbol of the code that begins with these bits; length 0 for a longer one.
    lookup: Vec<(u8, u8)>,
    /// For each length: the first code, how many there are, and where their symbols begin.
    lengths: [(u32, u32, usize); 17],
    symbols: Vec<u8>,
}

impl HuffmanTable {
    /// Reads a table; returns the bytes behind it.
    pub(super) fn parse(bytes: &[u8]) -> Option<(Self, &[u8])> {
        let (counts, rest) = bytes.split_at_checked(16)?;
        let total: usize = counts.iter().map(|&count| usize::from(count)).sum();
        let (symbols, rest) = rest.split_at_checked(total)?;
        let mut table = Self {
            lookup: vec![(0, 0); 1 << LOOKUP_BITS],
            lengths: [(0, 0, 0); 17],
            symbols: symbols.to_vec(),
        };
        let (mut code, mut offset) = (0_u32, 0);
        for (length, &count) in (1_u32..).zip(counts) {
            let count = u32::from(count);
            if code + count > 1 << length {
                return None;
            }
            table.lengths[length as usize] = (code, count, offset);
            for index in 0..count {
                table.fill_lookup(code + index, length, symbols[offset + index as usize]);
            }
            offset += count as usize;
            code = (code + count) << 1;
        }
        Some((table, rest))
    }

    fn fill_lookup(&mut self, code: u32, length: u32, symbol: u8) {
        if length <= LOOKUP_BITS {
            let first = (code << (LOOKUP_BITS - length)) as usize;
            self.lookup[first..first + (1 << (LOOKUP_BITS - length))].fill((length as u8, symbol));
        }
    }

    /// Length and symbol of the code at the start of 16 bits.
    fn find(&self, bits: u32) -> Option<(u32, u8)> {
        let (length, symbol) = self.lookup[(bits >> (16 - LOOKUP_BITS)) as usize];
        if length > 0 {
            return Some((length.into(), symbol));
        }
        (LOOKUP_BITS + 1..=16).find_map(|length| {
            let (first, count, offset) = self.lengths[length as usize];
            let index = (bits >> (16 - length)).checked_sub(first).filter(|&index| index < count)?;
            Some((length, self.symbols[offset + index as usize]))
        })
    }
}

/// Reads bits up to a marker.
pub(super) struct Bits<'a> {
    data: &'a [u8],
    /// The next byte to take.
    offset: usize,
    held: u64,
    count: u32,
    /// Consecutive zero bytes before `offset`.
    zero_bytes: usize,
}

impl<'a> Bits<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, offset: 0, held: 0, count: 0, zero_bytes: 0 }
    }

    fn fill(&mut self) {
        while self.count <= 56 {
            let Some(&byte) = self.data.get(self.offset) else { return };
            let mut length = 1;
            if byte == 0xff {
                match self.data.get(self.offset + 1) {
                    Some(0) => length = 2,
                    // A marker, perhaps behind fill bytes.
                    _ => return,
                }
            }
            self.offset += length;
            self.zero_bytes = if byte == 0 { self.zero_bytes + 1 } else { 0 };
            self.held = self.held << 8 | u64::from(byte);
            self.count += 8;
        }
    }

    pub(super) fn take(&mut self, bits: u32) -> Result<u32, ScanEnd> {
        if self.count < bits {
            self.fill();
        }
        self.count = self.count.checked_sub(bits).ok_or(ScanEnd::Ended)?;
        Ok((self.held >> self.count) as u32 & ((1 << bits) - 1))
    }

    /// The bits of a coefficient.
    pub(super) fn coefficient(&mut self, bits: u32) -> Result<(), ScanEnd> {
        self.take(bits)?;
        if self.zero_bytes > MAX_ZERO_BYTES { Err(ScanEnd::Zeros) } else { Ok(()) }
    }

    /// How many bytes up to the current bit are zero.
    pub(super) fn zero_bytes_taken(&self) -> usize {
        self.zero_bytes.saturating_sub(self.count as usize / 8)
    }

    pub(super) fn symbol(&mut self, table: &HuffmanTable) -> Result<u8, ScanEnd> {
        if self.count < 16 {
            self.fill();
        }
        let bits =
            if self.count < 16 { self.held << (16 - self.count) } else { self.held >> (self.count - 16) };
        let found = table.find(bits as u32 & 0xffff);
        match found {
            Some((length, symbol)) if length <= self.count => {
                self.count -= length;
                Ok(symbol)
            }
            None if self.count >= 16 => Err(ScanEnd::Invalid),
            _ => Err(ScanEnd::Ended),
        }
    }

    /// The number of whole bytes before the marker that were not read, and whether they are more than
    /// padding.
    pub(super) fn rest(&mut self) -> (usize, bool) {
        let mut rest: Vec<u8> = (0..self.count / 8).map(|byte| (self.held >> (8 * byte)) as u8).collect();
        self.count = 0;
        loop {
            self.fill();
            if self.count == 0 {
                break;
            }
            rest.extend((0..self.count / 8).map(|byte| (self.held >> (8 * byte)) as u8));
            self.count = 0;
        }
        (rest.len(), rest.iter().any(|&byte| byte != 0 && byte != 0xff))
    }

    /// Skips a restart marker, which must have the next number.
    pub(super) fn restart(&mut self, number: u8) -> bool {
        (self.held, self.count, self.zero_bytes) = (0, 0, 0);
        let mut offset = self.offset;
        while self.data.get(offset + 1) == Some(&0xff) {
            offset += 1;
        }
        let is_there =
            self.data.get(offset) == Some(&0xff) && self.data.get(offset + 1) == Some(&(0xd0 + number));
        if is_there {
            self.offset = offset + 2;
        }
        is_there
    }

    /// The offset of the marker.
    pub(super) fn offset(&self) -> usize {
        self.offset
    }
}
