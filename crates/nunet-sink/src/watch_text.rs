//! A frame in shared memory and the stats of its camera as text, for `nunetd watch`.

use nunet_files::{BIRDS_EYE_LEGEND, BirdsEye};
use nunet_ipc::{
    CameraName, FrameHeader, Message, ObstacleRecord, SectorState, StatsRecord, Units, monotonic_nanos,
    unix_nanos,
};
use nunet_types::{counted, printable, shortest};
use serde_json::{Map, Value, json};

/// The newest messages beside depth that are read for a terminal.
#[derive(Debug, Default)]
pub struct BesideDepth {
    /// The confidence of depth.
    pub confidence: Option<Message>,
    /// The obstacles.
    pub obstacles: Option<Message>,
}

/// Milliseconds since the image was taken; `None` if its capture time is unknown.
fn age_ms(header: &FrameHeader) -> Option<f64> {
    header.age_nanos(monotonic_nanos(), unix_nanos()).map(|nanos| nanos as f64 / 1e6)
}

fn age_of(header: &FrameHeader) -> String {
    age_ms(header).map_or_else(|| "unknown".to_owned(), |age| format!("{age:.1} ms"))
}

/// Depth at the center of the image; `None` if there is no measurement.
fn depth_center(frame: &Message) -> anyhow::Result<Option<f32>> {
    let (width, height) = (frame.header().width as usize, frame.header().height as usize);
    let depth = frame.depth()?.get(height / 2 * width + width / 2).copied();
    Ok(depth.filter(|value| value.is_finite()))
}

/// One object per frame, for scripts.
///
/// # Errors
/// The message is damaged, or has a value that this version does not know.
pub fn json_of(frame: &Message, stats: &StatsRecord) -> anyhow::Result<Value> {
    let header = frame.header();
    let metric = header.units()? == Units::Metre;
    let stages: Map<_, _> =
        stats.stage_names().zip(header.stages()).map(|(name, us)| (name.into_owned(), json!(us))).collect();
    Ok(json!({
        "contract": header.contract_version,
        "sequence": header.sequence,
        "capture_nanos": header.capture_nanos,
        "age_ms": age_ms(header),
        "quality": header.quality()?.name(),
        "units": header.units()?.name(),
        "scale_source": header.scale_source()?.name(),
        "scale_factor": (header.scale_factor > 0.0).then_some(header.scale_factor),
        "scale_age_s": header.scale_age_nanos as f64 / 1e9,
        "depth_center_m": depth_center(frame)?.filter(|_| metric).map(shortest),
        "invalid_pixels": header.invalid_pixels,
        "drift": stats.stability().map(|[drift, _]| drift),
        "flicker": stats.stability().map(|[_, flicker]| flicker),
        "unstable": stats.is_unstable == 1,
        "bytes_copied": header.bytes_copied,
        "stages": stages,
        "frames": {
            "captured": stats.captured,
            "published": stats.published,
            "superseded": stats.superseded,
            "failed": stats.failed,
            "in_flight": stats.in_flight,
        },
    }))
}

fn center_of(frame: &Message) -> anyhow::Result<String> {
    let unit = if frame.header().units()? == Units::Metre { " m" } else { " (no unit)" };
    Ok(depth_center(frame)?.map_or_else(|| "none".to_owned(), |depth| format!("{depth:.3}{unit}")))
}

/// One line per frame.
///
/// # Errors
/// As [`json_of`].
pub fn line_of(frame: &Message) -> anyhow::Result<String> {
    let header = frame.header();
    Ok(format!(
        "frame {} age {} center {} quality {}",
        header.sequence,
        age_of(header),
        center_of(frame)?,
        header.quality()?.name()
    ))
}

/// The model and its provider. Another process chose these names, so they must not control the terminal.
fn model_of(stats: &StatsRecord) -> String {
    printable::one_line(&format!("{} on {}", stats.model_name(), stats.provider())).into_owned()
}

/// Where the scale comes from, its factor, and its age if it was measured.
fn scale_of(header: &FrameHeader) -> anyhow::Result<String> {
    let mut text = header.scale_source()?.name().to_owned();
    if header.scale_factor > 0.0 {
        text += &format!(" x{:.3}", header.scale_factor);
    }
    if header.scale_age_nanos > 0 {
        text += &format!(" ({:.1} s old)", header.scale_age_nanos as f64 / 1e9);
    }
    Ok(text)
}

/// The view of a terminal.
///
/// # Errors
/// As [`json_of`].
pub fn screen_of(
    camera: &CameraName,
    frame: &Message,
    stats: &StatsRecord,
    beside: &BesideDepth,
) -> anyhow::Result<String> {
    let header = frame.header();
    let mut text = format!(
        "camera {camera} · {} · {}x{} · {:.1} frames/s\n\
         frame {} · age {} · center {} · scale {} · quality {}\n\
         captured {} = published {} + superseded {} + failed {} + in flight {}\n\
         {}\n\
         {:<14} {:>9} {:>9} {:>9} {:>9}\n",
        model_of(stats),
        header.width,
        header.height,
        stats.fps,
        header.sequence,
        age_of(header),
        center_of(frame)?,
        scale_of(header)?,
        header.quality()?.name(),
        stats.captured,
        stats.published,
        stats.superseded,
        stats.failed,
        stats.in_flight,
        depth_of(header, stats),
        "stage, ms",
        "p50",
        "p90",
        "p99",
        "max"
    );
    for (index, name) in stats.stage_names().enumerate() {
        let quantiles = [stats.stage_p50_us, stats.stage_p90_us, stats.stage_p99_us, stats.stage_max_us];
        text += &row_of(&name, quantiles.map(|all| all[index]));
    }
    text +=
        &row_of("total", [stats.total_p50_us, stats.total_p90_us, stats.total_p99_us, stats.total_max_us]);
    text += &text_beside_depth(beside)?;
    Ok(text)
}

/// Confidence and obstacles, if they are read.
fn text_beside_depth(beside: &BesideDepth) -> anyhow::Result<String> {
    let mut text = String::new();
    if let Some(confidence) = &beside.confidence {
        text += &confidence_of(confidence.confidence()?, confidence.header().width as usize);
    }
    if let Some(obstacles) = &beside.obstacles {
        text += &birds_eye_of(obstacles.obstacles()?);
    }
    Ok(text)
}

/// The depth map's missing pixels, and its stability.
fn depth_of(header: &FrameHeader, stats: &StatsRecord) -> String {
    let (copied, invalid) = (counted(header.bytes_copied, "byte"), counted(header.invalid_pixels, "pixel"));
    format!("copied {copied} · without depth {invalid}\n{}", stability_of(stats))
}

/// Drift and flicker of depth, and whether they are too much.
fn stability_of(stats: &StatsRecord) -> String {
    let Some([drift, flicker]) = stats.stability() else {
        return "drift and flicker unknown: the image changes".to_owned();
    };
    let alarm = if stats.is_unstable == 1 { " · UNSTABLE" } else { "" };
    format!("per frame: drift {:+.2} % · flicker {:.2} %{alarm}", 100.0 * drift, 100.0 * flicker)
}

/// The mean confidence, the one at the center, and how many pixels are less than half certain.
fn confidence_of(values: &[u8], width: usize) -> String {
    let (count, height) = (values.len().max(1), values.len() / width.max(1));
    let percent = |value: f64| 100.0 * value / 255.0;
    let mean = values.iter().map(|&value| u64::from(value)).sum::<u64>() as f64 / count as f64;
    let center = values.get(height / 2 * width + width / 2).copied().unwrap_or_default();
    let uncertain = values.iter().filter(|value| **value < 128).count();
    format!(
        "confidence mean {:.0} % · center {:.0} % · below 50 %: {:.1} % of the pixels\n",
        percent(mean),
        percent(center.into()),
        100.0 * uncertain as f64 / count as f64
    )
}

/// The robot's surroundings from above, and the nearest obstacle.
fn birds_eye_of(record: &ObstacleRecord) -> String {
    let ends = record.sectors().iter().filter(|sector| is_end(sector.state()));
    let nearest = ends.map(|sector| sector.range_m).min_by(f32::total_cmp);
    let nearest = nearest.map_or_else(|| "none".to_owned(), |range_m| format!("{range_m:.2} m"));
    let range_m = record.max_range_m;
    format!(
        "{}obstacles up to {range_m:.1} m · nearest {nearest}\n{BIRDS_EYE_LEGEND}\n",
        BirdsEye(record.map()).text()
    )
}

fn is_end(state: SectorState) -> bool {
    matches!(state, SectorState::Occupied | SectorState::Drop)
}

fn row_of(name: &str, micros: [f64; 4]) -> String {
    let cells: String = micros.iter().map(|us| format!(" {:>9.2}", us / 1e3)).collect();
    format!("{:<14}{cells}\n", printable::one_line(name))
}

#[cfg(test)]
mod tests {
    use nunet_ipc::ObstacleSector;

    use super::*;

    #[test]
    fn drift_and_flicker_are_percent_and_an_alarm_is_named() {
        let mut stats = StatsRecord::default();
        assert!(stability_of(&stats).contains("unknown"));
        stats.set_stability(Some([-0.0123, 0.004]));
        assert_eq!(stability_of(&stats), "per frame: drift -1.23 % · flicker 0.40 %");
        stats.is_unstable = 1;
        assert!(stability_of(&stats).ends_with("UNSTABLE"));
    }

    #[test]
    fn names_in_shared_memory_cannot_control_the_terminal() {
        let mut stats = StatsRecord::default();
        stats.set_model_name("a\u{1b}[2J");
        stats.set_provider("cpu\nb");
        assert_eq!(model_of(&stats), "a\\u001b[2J on cpu\\nb");
        assert!(row_of("c\n\u{9b}2J", [0.0; 4]).starts_with("c\\n\\u009b2J  "));
    }

    #[test]
    fn confidence_is_a_share_of_certain() {
        let text = confidence_of(&[255, 255, 0, 255, 51, 255], 3);
        assert_eq!(text, "confidence mean 70 % · center 20 % · below 50 %: 33.3 % of the pixels\n");
        assert!(confidence_of(&[], 0).contains("mean 0 %"));
    }

    #[test]
    fn the_view_from_above_names_the_nearest_thing_in_the_way() {
        let sector = |state: SectorState, range_m| ObstacleSector {
            state: state.into(),
            range_m,
            ..ObstacleSector::UNKNOWN
        };
        let mut record = Box::new(ObstacleRecord::default());
        (record.angle_min_rad, record.angle_step_rad, record.max_range_m) = (-0.5, 0.5, 5.0);
        record.set_sectors(&[sector(SectorState::Unknown, 0.2), sector(SectorState::Free, 5.0)]);
        assert!(birds_eye_of(&record).contains("nearest none"), "unknown is not near");
        record.set_sectors(&[sector(SectorState::Drop, 1.25), sector(SectorState::Occupied, 2.0)]);
        let text = birds_eye_of(&record);
        assert!(text.contains("up to 5.0 m · nearest 1.25 m"), "{text}");
        assert!(text.contains('▼') && text.contains('█'), "{text}");
    }
}
