//! How fast datagrams are sent: what does not fit into a reader's receive buffer is lost.

use std::net::{IpAddr, Ipv4Addr, SocketAddrV4};
use std::time::{Duration, Instant};

use procfs::process::Process;

/// After this number of bytes, the sender gives readers time.
const BURST_BYTES: usize = 48 * 1024;
/// What may be left in the receive buffer of a reader when the next burst begins. The default buffer of Linux
/// holds 208 KiB.
const QUEUED_BYTES: u32 = 96 * 1024;
/// Time for readers to empty their receive buffers: of other machines after each burst, of this one at most.
const PAUSE: Duration = Duration::from_micros(500);
/// How often the receive buffers of this machine are looked at.
const CHECK_PERIOD: Duration = Duration::from_micros(50);

/// Sees how full the receive buffers of this machine are, and pauses where it cannot.
pub(super) struct Pace {
    burst_bytes: usize,
    /// Readers on this machine that got a part of the burst.
    local: Vec<SocketAddrV4>,
    /// Whether another machine got a part of it.
    is_remote: bool,
    /// Has the table of sockets, unless `/proc` is hidden.
    process: Option<Process>,
}

impl Pace {
    pub(super) fn new() -> Self {
        Self { burst_bytes: 0, local: Vec::new(), is_remote: false, process: Process::myself().ok() }
    }

    /// Call it after each datagram. It returns when readers can take the next one.
    pub(super) fn sent(&mut self, bytes: usize, to: SocketAddrV4, is_local: bool) {
        self.burst_bytes += bytes;
        if !is_local {
            self.is_remote = true;
        } else if !self.local.contains(&to) {
            self.local.push(to);
        }
        if self.burst_bytes > BURST_BYTES {
            self.pause();
            self.burst_bytes = 0;
            self.is_remote = false;
            self.local.clear();
        }
    }

    fn pause(&self) {
        let end = Instant::now() + PAUSE;
        while let Some(left) = end.checked_duration_since(Instant::now()) {
            match self.queued_bytes() {
                Some(bytes) if bytes <= QUEUED_BYTES => return,
                Some(_) => std::thread::sleep(CHECK_PERIOD),
                None => std::thread::sleep(left),
            }
        }
    }

    /// Bytes in the fullest receive buffer; `None` if one of them cannot be seen.
    fn queued_bytes(&self) -> Option<u32> {
        let process = self.process.as_ref().filter(|_| !self.is_remote)?;
        let sockets = process.udp().ok()?;
        let queued = self.local.iter().map(|reader| {
            let is_its = |local| local == IpAddr::V4(*reader.ip()) || local == Ipv4Addr::UNSPECIFIED;
            let found = sockets.iter().filter(|socket| {
                socket.local_address.port() == reader.port() && is_its(socket.local_address.ip())
            });
            found.map(|socket| socket.rx_queue).max()
        });
        queued.collect::<Option<Vec<_>>>()?.into_iter().max()
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;

    use super::*;

    /// A reader on any address of this machine, and where it is reached.
    fn reader() -> (UdpSocket, SocketAddrV4) {
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).unwrap();
        let port = socket.local_addr().unwrap().port();
        (socket, SocketAddrV4::new(Ipv4Addr::LOCALHOST, port))
    }

    #[test]
    fn the_fullest_receive_buffer_counts() {
        let (reader, slow) = reader();
        let (_idle, idle) = self::reader();
        let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let mut pace = Pace::new();
        for _ in 0..4 {
            sender.send_to(&[7; 10_000], slow).unwrap();
            pace.sent(10_000, slow, true);
        }
        pace.sent(100, idle, true);
        let queued = pace.queued_bytes().unwrap();
        assert!((40_000..100_000).contains(&queued), "{queued}");
        for _ in 0..4 {
            assert_eq!(reader.recv(&mut [0; 20_000]).unwrap(), 10_000);
        }
        assert_eq!(pace.queued_bytes(), Some(0));
    }

    #[test]
    fn of_other_machines_and_containers_nothing_is_known() {
        let (_socket, known) = reader();
        let mut pace = Pace::new();
        pace.sent(1, known, true);
        assert_eq!(pace.queued_bytes(), Some(0));
        // Nothing is bound to this port, as if it were forwarded into a container.
        let mut forwarded = Pace::new();
        forwarded.sent(1, SocketAddrV4::new(Ipv4Addr::LOCALHOST, 1), true);
        assert_eq!(forwarded.queued_bytes(), None);
        pace.sent(1, SocketAddrV4::new(Ipv4Addr::new(192, 0, 2, 1), 7411), false);
        assert_eq!(pace.queued_bytes(), None);
    }

    #[test]
    fn a_reader_that_does_not_read_is_not_waited_for_forever() {
        let (_socket, stopped) = reader();
        let sender = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let mut pace = Pace::new();
        for _ in 0..40 {
            sender.send_to(&[7; 16_000], stopped).unwrap();
            pace.sent(16_000, stopped, true);
        }
        assert_eq!(pace.burst_bytes, 0, "each burst ended");
    }
}
