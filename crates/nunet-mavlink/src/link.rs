//! A connection to an autopilot.

use std::fs::{File, OpenOptions};
use std::io::{self, Read as _, Write as _};
use std::net::{Ipv6Addr, SocketAddr, TcpStream, UdpSocket};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::fs::OFlags;
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};

use crate::address::{MavlinkAddress, MavlinkTransport};
use crate::lookup::HostLookup;
use crate::messages::MessageWriter;
use crate::ring::DistanceRing;

/// Autopilots consider a computer lost that sends nothing for a few seconds.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// At most 15 distances per second.
const MIN_PERIOD: Duration = Duration::from_micros(66_000);
/// Bits on a serial line of the longest message, 280 bytes with a start and a stop bit each.
const MESSAGE_BITS: f64 = 2800.0;
/// The pause before a lost connection is reopened.
const RETRY: Duration = Duration::from_secs(2);
/// How long opening a connection, to all addresses of its host, or a write may take.
const TIMEOUT: Duration = Duration::from_secs(1);

/// What happened to the connection.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LinkEvent {
    /// It was opened.
    Opened,
    /// It could not be opened, or a write failed. It is retried; further failures are not reported until it
    /// is open again.
    Lost(String),
}

/// Sends heartbeats and distances. A connection that fails is opened again. Calls may block for a second, so
/// it belongs on a thread of its own. They do not wait for the lookup of a host: they send nothing until it
/// has ended.
#[derive(Debug)]
pub struct MavlinkLink {
    address: MavlinkAddress,
    lookup: HostLookup,
    messages: MessageWriter,
    port: Option<Connection>,
    retry_at: Option<Instant>,
    heartbeat_at: Option<Instant>,
    distance_at: Option<Instant>,
    is_reported: bool,
}

impl MavlinkLink {
    /// Stores the address. The connection is opened by the first call of [`Self::send`] or
    /// [`Self::keep_alive`].
    #[must_use]
    pub fn new(address: MavlinkAddress) -> Self {
        Self {
            messages: MessageWriter::new(address.system_id, address.component_id),
            address,
            lookup: HostLookup::default(),
            port: None,
            retry_at: None,
            heartbeat_at: None,
            distance_at: None,
            is_reported: false,
        }
    }

    /// The address of the autopilot.
    #[must_use]
    pub fn address(&self) -> &MavlinkAddress {
        &self.address
    }

    /// The shortest time between distances: 1/15 s, or what a slow serial line needs. More messages than it
    /// carries would fill its buffer and be torn.
    #[must_use]
    pub fn period(&self) -> Duration {
        match self.address.transport {
            MavlinkTransport::Serial { baud, .. } => {
                MIN_PERIOD.max(Duration::from_secs_f64(MESSAGE_BITS / f64::from(baud)))
            }
            MavlinkTransport::Udp(_) | MavlinkTransport::Tcp(_) => MIN_PERIOD,
        }
    }

    /// Sends the distances of an image, unless less than [`Self::period`] has passed since the last ones. Old
    /// ones are never sent again.
    pub fn send(&mut self, ring: &DistanceRing, unix_micros: u64, now: Instant) -> Option<LinkEvent> {
        let event = self.keep_alive(now);
        if self.distance_at.is_some_and(|next| now < next) || self.port.is_none() {
            return event;
        }
        self.distance_at = Some(now + self.period());
        let bytes = self.messages.obstacle_distance(ring, unix_micros);
        self.write(&bytes, now).or(event)
    }

    /// Opens the connection if there is none, and sends a heartbeat once per second.
    pub fn keep_alive(&mut self, now: Instant) -> Option<LinkEvent> {
        let opened = self.open(now);
        if self.port.is_none() || self.heartbeat_at.is_some_and(|next| now < next) {
            return opened;
        }
        self.heartbeat_at = Some(now + HEARTBEAT);
        let bytes = self.messages.heartbeat();
        self.write(&bytes, now).or(opened)
    }

    fn open(&mut self, now: Instant) -> Option<LinkEvent> {
        if self.port.is_some() || self.retry_at.is_some_and(|next| now < next) {
            return None;
        }
        match Connection::open(&self.address.transport, &mut self.lookup) {
            Ok(None) => None,
            Ok(port) => {
                self.port = port;
                self.is_reported = false;
                Some(LinkEvent::Opened)
            }
            Err(error) => self.lose(&error, now),
        }
    }

    fn write(&mut self, bytes: &[u8], now: Instant) -> Option<LinkEvent> {
        let result = self.port.as_mut()?.write(bytes);
        result.err().and_then(|error| self.lose(&error, now))
    }

    fn lose(&mut self, error: &io::Error, now: Instant) -> Option<LinkEvent> {
        self.port = None;
        self.retry_at = Some(now + RETRY);
        (!std::mem::replace(&mut self.is_reported, true)).then(|| LinkEvent::Lost(error.to_string()))
    }
}

/// An open connection.
#[derive(Debug)]
enum Connection {
    Udp(UdpSocket),
    Tcp(TcpStream),
    Serial(File),
}

impl Connection {
    /// `None` while the host is looked up.
    fn open(transport: &MavlinkTransport, lookup: &mut HostLookup) -> io::Result<Option<Self>> {
        match transport {
            MavlinkTransport::Udp(host) => lookup.poll(host)?.map(|to| first(&to, Self::udp)).transpose(),
            MavlinkTransport::Tcp(host) => lookup.poll(host)?.map(|to| Self::tcp(&to)).transpose(),
            MavlinkTransport::Serial { device, baud } => Ok(Some(Self::Serial(serial(device, *baud)?))),
        }
    }

    fn udp(to: SocketAddr) -> io::Result<Self> {
        let any: SocketAddr = match to {
            SocketAddr::V4(_) => ([0; 4], 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(any)?;
        socket.connect(to)?;
        socket.set_nonblocking(true)?;
        Ok(Self::Udp(socket))
    }

    fn tcp(addresses: &[SocketAddr]) -> io::Result<Self> {
        let count = u32::try_from(addresses.len()).unwrap_or(u32::MAX).max(1);
        let stream = first(addresses, |to| TcpStream::connect_timeout(&to, TIMEOUT / count))?;
        stream.set_write_timeout(Some(TIMEOUT))?;
        stream.set_read_timeout(Some(Duration::from_millis(1)))?;
        stream.set_nodelay(true)?;
        Ok(Self::Tcp(stream))
    }

    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            // No program listens yet, or the buffer is full: treat it as a lost datagram.
            Self::Udp(socket) => match socket.send(bytes) {
                Err(error)
                    if matches!(
                        error.kind(),
                        io::ErrorKind::ConnectionRefused | io::ErrorKind::WouldBlock
                    ) =>
                {
                    Ok(())
                }
                sent => sent.map(drop),
            },
            Self::Tcp(stream) => {
                discard_input(stream);
                stream.write_all(bytes)
            }
            Self::Serial(line) => line.write_all(bytes),
        }
    }
}

/// Opens the first of a host's addresses that can be opened, or returns the error of the last one.
fn first<T>(addresses: &[SocketAddr], open: impl Fn(SocketAddr) -> io::Result<T>) -> io::Result<T> {
    let mut opened = Err(io::ErrorKind::AddrNotAvailable.into());
    for &address in addresses {
        opened = open(address);
        if opened.is_ok() {
            break;
        }
    }
    opened
}

/// Discards what the autopilot sends. If the buffer filled up, the autopilot could not send anymore.
fn discard_input(stream: &mut TcpStream) {
    const MOST: usize = 16;
    let mut buffer = [0; 4096];
    for _ in 0..MOST {
        if !matches!(stream.read(&mut buffer), Ok(read) if read == buffer.len()) {
            return;
        }
    }
}

/// Opens a serial line in raw mode. A write fails instead of blocking if the buffer is full.
fn serial(device: &Path, baud: u32) -> io::Result<File> {
    let flags = (OFlags::NOCTTY | OFlags::NONBLOCK).bits();
    let line = OpenOptions::new().read(true).write(true).custom_flags(flags.cast_signed()).open(device)?;
    let mut settings = tcgetattr(&line)?;
    settings.make_raw();
    settings.set_speed(baud)?;
    tcsetattr(&line, OptionalActions::Now, &settings)?;
    Ok(line)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;
    use std::sync::mpsc::channel;

    use super::*;

    fn received(socket: &UdpSocket) -> Vec<u8> {
        let mut buffer = [0; 300];
        let length = socket.recv(&mut buffer).unwrap();
        buffer[..length].to_vec()
    }

    /// The number of a message, in bytes 7 to 9 of MAVLink 2.
    fn number(message: &[u8]) -> u32 {
        u32::from_le_bytes([message[7], message[8], message[9], 0])
    }

    const HEARTBEAT_NUMBER: u32 = 0;
    const DISTANCE_NUMBER: u32 = 330;

    #[test]
    fn heartbeats_come_once_per_second_and_distances_15_times_at_most() {
        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        autopilot.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let mut link =
            MavlinkLink::new(MavlinkTransport::Udp(autopilot.local_addr().unwrap().to_string()).into());
        let (start, ring) = (Instant::now(), DistanceRing::default());
        assert_eq!(link.send(&ring, 1, start), Some(LinkEvent::Opened));
        // 100 frames per second for two seconds, by a clock of the test's own.
        for frame in 1..200 {
            assert_eq!(link.send(&ring, 1, start + Duration::from_millis(10 * frame)), None);
        }
        link.keep_alive(start + Duration::from_secs(60)); // marks the end
        let mut numbers = Vec::new();
        while numbers.iter().filter(|&&number| number == HEARTBEAT_NUMBER).count() < 3 {
            numbers.push(number(&received(&autopilot)));
        }
        let distances = numbers.iter().filter(|&&number| number == DISTANCE_NUMBER).count();
        assert!((28..=30).contains(&distances), "{distances} in two seconds");
        assert_eq!(numbers[0], HEARTBEAT_NUMBER, "the autopilot knows first who speaks");
    }

    #[test]
    fn a_lost_connection_is_reported_once_and_opened_again() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = server.local_addr().unwrap();
        drop(server);
        let mut link = MavlinkLink::new(MavlinkTransport::Tcp(address.to_string()).into());
        let start = Instant::now();
        assert!(matches!(link.keep_alive(start), Some(LinkEvent::Lost(_))));
        assert_eq!(link.keep_alive(start + RETRY), None, "it was reported");
        let server = TcpListener::bind(address).unwrap();
        assert_eq!(link.keep_alive(start + RETRY), None, "it rests");
        assert_eq!(link.keep_alive(start + 2 * RETRY), Some(LinkEvent::Opened));
        let (mut accepted, _) = server.accept().unwrap();
        let mut heartbeat = [0; 10];
        accepted.read_exact(&mut heartbeat).unwrap();
        assert_eq!((heartbeat[0], number(&heartbeat)), (0xfd, HEARTBEAT_NUMBER));
    }

    #[test]
    fn a_host_is_tried_at_each_of_its_addresses() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let closed = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let open = server.local_addr().unwrap();
        assert!(Connection::tcp(&[closed, open]).is_ok());
        assert_eq!(Connection::tcp(&[closed]).unwrap_err().kind(), io::ErrorKind::ConnectionRefused);
        server.accept().unwrap();
    }

    #[test]
    fn a_lookup_that_does_not_end_holds_nobody_up() {
        let (answer, answered) = channel();
        let mut link = MavlinkLink::new(MavlinkTransport::Udp("autopilot:14550".to_owned()).into());
        let looked = link.lookup.poll_with(move || answered.recv().map_err(io::Error::other));
        assert_eq!(looked.unwrap(), None);
        let start = Instant::now();
        assert_eq!(link.keep_alive(start), None);
        assert_eq!(link.send(&DistanceRing::default(), 1, start), None);

        let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
        autopilot.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        answer.send(vec![autopilot.local_addr().unwrap()]).unwrap();
        let event = loop {
            if let Some(event) = link.keep_alive(Instant::now()) {
                break event;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "the answer is not taken");
            std::thread::sleep(Duration::from_millis(1));
        };
        assert_eq!(event, LinkEvent::Opened);
        assert_eq!(number(&received(&autopilot)), HEARTBEAT_NUMBER);
    }

    #[test]
    fn a_slow_serial_line_gets_fewer_messages_and_never_more_than_it_carries() {
        let period = |baud| {
            let transport = MavlinkTransport::Serial { device: "/dev/ttyS0".into(), baud };
            MavlinkLink::new(transport.into()).period().as_secs_f64()
        };
        // A period has whole nanoseconds.
        let longest_bits = 10.0 * 280.0 - 1.0;
        for baud in [1, 9600, 19_200, 38_400, 57_600, 921_600, u32::MAX] {
            assert!(period(baud) * f64::from(baud) >= longest_bits, "{baud}");
        }
        assert!((period(9600) - 0.292).abs() < 0.001 && period(57_600) < 1.0 / 15.0);
        let udp = MavlinkLink::new(MavlinkTransport::Udp("127.0.0.1:14550".to_owned()).into());
        assert_eq!(udp.period(), MIN_PERIOD);
    }

    #[test]
    fn a_device_that_is_no_serial_line_is_an_error() {
        let line = MavlinkTransport::Serial { device: "/dev/null".into(), baud: 57_600 };
        let mut link = MavlinkLink::new(line.into());
        assert!(matches!(link.keep_alive(Instant::now()), Some(LinkEvent::Lost(_))));
    }
}
