//! Reads depth from a running `nunetd`: `subscribe CAMERA [FRAMES]`.
//!
//! Prints each frame's sequence number, its age from capture to now, and the depth at the picture's centre.

#![expect(clippy::print_stdout, clippy::print_stderr, reason = "stdout is its data, stderr is for people")]

use std::time::Duration;

use nunet_ipc::{CameraName, Clock, Frame, Reader, Topic};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let camera = CameraName::new(&arguments.next().unwrap_or_else(|| "demo".to_owned()))?;
    let frames: u64 = arguments.next().map_or(Ok(u64::MAX), |count| count.parse())?;

    let reader = Reader::open(&camera, &[Topic::Depth], Duration::from_secs(10))?;
    let mut seen = 0;
    while seen < frames {
        // A hint: look for a frame whatever it says.
        let woken = reader.wait(Duration::from_secs(1))?;
        if let Some(frame) = reader.latest(Topic::Depth)? {
            println!("{}", line(&frame)?);
            seen += 1;
        } else if !woken && !reader.is_connected() {
            eprintln!("nobody publishes camera `{camera}` any more; waiting for the next one");
        }
    }
    Ok(())
}

fn line(frame: &Frame) -> Result<String, Box<dyn std::error::Error>> {
    let header = frame.header();
    let depth = frame.depth()?; // a view of shared memory: `[height, width]`
    let centre = depth[(header.height as usize / 2) * header.width as usize + header.width as usize / 2];
    let units = header.units()?;
    Ok(format!("frame {}: {}, centre {centre:.3} ({units})", header.sequence, age(frame)?))
}

/// Time since capture. Only clocks that this machine shares with the camera can say.
fn age(frame: &Frame) -> Result<String, Box<dyn std::error::Error>> {
    let header = frame.header();
    let now = match header.capture_clock()? {
        Clock::Unix => i64::try_from(std::time::UNIX_EPOCH.elapsed()?.as_nanos())?,
        Clock::Monotonic => nunet_ipc::monotonic_nanos(),
        Clock::Media => return Ok("from a recording".to_owned()),
    };
    Ok(format!("{:.1} ms old", (now - header.capture_nanos) as f64 / 1e6))
}
