#![expect(unsafe_code, reason = "asks the kernel about pages of this process, and advises it")]

//! Huge pages for the memory that a network works in.
//!
//! A network reads its weights and activations for each frame: tens of megabytes, tens of thousands of 4 KiB
//! pages. In a virtual machine, looking up those pages costs 5 % of a frame, and a third of it on a busy
//! host. Most distributions use huge pages only on request, and ONNX Runtime does not request them. This
//! module does, once, after the first run has touched the memory that is used. It is only advice: if the
//! kernel does not follow it, nothing else changes.

use std::fs;
use std::ops::Range;

use nunet_types::counted;
use tracing::debug;

/// A huge page of x86-64, and of aarch64 with pages of 4 KiB.
const HUGE: usize = 2 << 20;

/// `MADV_COLLAPSE` of Linux 6.1: synchronous, and independent of
/// `/sys/kernel/mm/transparent_hugepage/enabled`.
const COLLAPSE: libc::c_int = 25;

/// Moves the private memory of this process that is in use into huge pages. No page is added.
pub(crate) fn collapse_resident() {
    let Ok(maps) = fs::read_to_string("/proc/self/maps") else { return };
    let blocks = maps.lines().filter_map(private_memory).flat_map(blocks).filter(is_resident);
    let moved = blocks.filter(collapse).count();
    debug!("{} of {} MiB", counted(moved, "huge page"), HUGE >> 20);
}

/// The addresses in a line of `maps`, if it is private memory without a file: the heap, or an anonymous
/// mapping.
fn private_memory(line: &str) -> Option<Range<usize>> {
    let mut fields = line.split_ascii_whitespace();
    let (start, end) = fields.next()?.split_once('-')?;
    let private = fields.next()? == "rw-p";
    let inode = fields.nth(2)?;
    let anonymous = inode == "0" && matches!(fields.next(), None | Some("[heap]"));
    let address = |text| usize::from_str_radix(text, 16).ok();
    (private && anonymous).then_some(address(start)?..address(end)?)
}

/// The addresses of the huge pages that fit into `memory`.
fn blocks(memory: Range<usize>) -> impl Iterator<Item = usize> {
    (memory.start.next_multiple_of(HUGE)..memory.end)
        .step_by(HUGE)
        .filter(move |block| block + HUGE <= memory.end)
}

/// Whether every page of the block is in memory.
fn is_resident(block: &usize) -> bool {
    let mut pages = vec![0_u8; HUGE / rustix::param::page_size()];
    // SAFETY: `pages` has a byte for each page of the range; the kernel answers for any range, mapped or not.
    let status = unsafe { libc::mincore(*block as *mut libc::c_void, HUGE, pages.as_mut_ptr()) };
    status == 0 && pages.iter().all(|page| page & 1 == 1)
}

fn collapse(block: &usize) -> bool {
    // SAFETY: the advice changes where bytes lie in memory, not what they are, and is refused where nothing
    // is mapped.
    unsafe { libc::madvise(*block as *mut libc::c_void, HUGE, COLLAPSE) == 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_private_memory_without_a_file_is_moved() {
        let heap = "55e7f7d44000-55e7fb8ad000 rw-p 00000000 00:00 0                          [heap]";
        assert_eq!(private_memory(heap), Some(0x55e7_f7d4_4000..0x55e7_fb8a_d000));
        assert_eq!(private_memory("1000-3000 rw-p 00000000 00:00 0"), Some(0x1000..0x3000));
        for other in [
            "1000-3000 rw-s 00000000 00:1a 77     /dev/shm/iox2_1",
            "1000-3000 rw-p 00001000 fe:00 9      /usr/lib/libc.so.6",
            "1000-3000 rw-p 00000000 00:00 0      [stack]",
            "1000-3000 r--p 00000000 00:00 0",
            "1000-3000 ---p 00000000 00:00 0",
            "",
        ] {
            assert_eq!(private_memory(other), None, "{other}");
        }
    }

    #[test]
    fn blocks_lie_within_the_memory_at_multiples_of_their_size() {
        assert_eq!(blocks(HUGE - 1..4 * HUGE).collect::<Vec<_>>(), [HUGE, 2 * HUGE, 3 * HUGE]);
        assert_eq!(blocks(HUGE + 1..3 * HUGE - 1).count(), 0);
        assert_eq!(blocks(HUGE..2 * HUGE - 1).count(), 0);
    }

    #[test]
    fn memory_keeps_its_bytes_and_unmapped_memory_is_refused() {
        let bytes: Vec<u8> = (0..4 * HUGE).map(|index| (index % 251) as u8).collect();
        let start = bytes.as_ptr() as usize;
        let inside: Vec<usize> = blocks(start..start + bytes.len()).collect();
        assert_eq!(inside.len(), 3);
        assert!(inside.iter().all(is_resident));
        collapse_resident();
        assert!(bytes.iter().enumerate().all(|(index, &byte)| byte == (index % 251) as u8));
        assert!(!is_resident(&HUGE) && !collapse(&HUGE));
    }
}
