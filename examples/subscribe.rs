//! Reads depth from a running `nunetd`: `subscribe CAMERA [FRAMES]`.
//!
//! Prints each frame's sequence number, the time since its capture, and the depth at the image's center.

#![expect(clippy::print_stderr, reason = "messages go to stderr")]

use std::io::{ErrorKind, Write as _};
use std::time::Duration;

use nunet_ipc::{CameraName, Message, Reader, Topic, monotonic_nanos, unix_nanos};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let camera = CameraName::new(&arguments.next().unwrap_or_else(|| "demo".to_owned()))?;
    let frames: u64 = arguments.next().map_or(Ok(u64::MAX), |count| count.parse())?;

    let reader = Reader::open(&camera, &[Topic::Depth], Duration::from_secs(10))?;
    let mut seen = 0;
    while seen < frames {
        // May return early or late, so check for a frame in any case.
        let woken = reader.wait(Duration::from_secs(1))?;
        if let Some(frame) = reader.latest(Topic::Depth)? {
            match writeln!(std::io::stdout(), "{}", line(&frame)?) {
                // The pipe was closed, as in `subscribe demo | head -1`.
                Err(error) if error.kind() == ErrorKind::BrokenPipe => break,
                written => written?,
            }
            seen += 1;
        } else if !woken && !reader.is_connected() {
            eprintln!("no process publishes camera `{camera}` any more; waiting for the next one");
        }
    }
    Ok(())
}

fn line(frame: &Message) -> Result<String, Box<dyn std::error::Error>> {
    let header = frame.header();
    let age = header.age_nanos(monotonic_nanos(), unix_nanos());
    let age =
        age.map_or_else(|| "of unknown age".to_owned(), |nanos| format!("{:.2} ms old", nanos as f64 / 1e6));
    let depth = frame.depth()?; // a view of shared memory: `[height, width]`
    let (width, height) = (header.width as usize, header.height as usize);
    let center = depth[height / 2 * width + width / 2];
    Ok(format!("frame {}: {age}, center {center:.3} ({})", header.sequence, header.units()?))
}
