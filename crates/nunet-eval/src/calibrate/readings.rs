//! A table of range-sensor readings: points of images with their distances.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::{CalibrateError, Point};
use crate::dataset::wrong_separator;
use crate::error::Cause;
use crate::event::{Event, OnEvent};
use crate::text_file::read_list;

/// The distance of a point in an image.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Reading {
    /// The image, resolved from the folder of the table.
    pub(super) image: PathBuf,
    pub(super) point: Point,
    /// Its line in the table.
    pub(super) line: u64,
}

/// The lines of readings that give no factor.
#[derive(Debug, Default)]
pub(super) struct SkippedReadings {
    /// The point is outside the part of the image that the network sees.
    pub(super) outside_view: Vec<u64>,
    /// The network has no depth around the point.
    pub(super) without_depth: Vec<u64>,
}

impl SkippedReadings {
    pub(super) fn count(&self) -> usize {
        self.outside_view.len() + self.without_depth.len()
    }

    /// One warning for each reason.
    pub(super) fn report(&self, on_event: OnEvent<'_>) {
        for (lines, which) in [
            (&self.outside_view, "outside the part of the image that the network sees"),
            (&self.without_depth, "where the network has no depth"),
        ] {
            if let Some(first) = lines.iter().min() {
                let count = lines.len();
                let text = format!("readings {which} are skipped: {count}, the first in line {first}");
                on_event(Event::Warning(&text));
            }
        }
    }
}

const COLUMNS: [&str; 4] = ["image", "u", "v", "distance"];

/// The text of a table whose columns are separated by commas.
fn text(path: &Path) -> Result<String, Cause> {
    let text = read_list(path)?;
    match wrong_separator(&text) {
        _ if text.trim().is_empty() => Err("it is empty".into()),
        Some(reason) => Err(reason.into()),
        None => Ok(text),
    }
}

/// Reads a table with the columns `image`, `u`, `v` and `distance`, in any order; others are ignored. Every
/// image must exist.
pub(super) fn read(path: &Path) -> Result<Vec<Reading>, CalibrateError> {
    let wrong = |reason: String| CalibrateError::Readings { path: path.to_owned(), reason };
    let text = text(path).map_err(|error| wrong(error.to_string()))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| wrong(error.to_string()))?.clone();
    let place = |name: &str| {
        let found = header.iter().position(|column| column.eq_ignore_ascii_case(name));
        found.ok_or_else(|| {
            let columns: Vec<_> = header.iter().map(|column| format!("`{column:.40}`")).collect();
            wrong(format!("it has no column `{name}`; its columns are {}", columns.join(", ")))
        })
    };
    let [image, u, v, distance] = COLUMNS.map(place);
    let (image, numbers) = (image?, [u?, v?, distance?]);
    let folder = path.parent().unwrap_or(Path::new(""));
    let reading = |record: Result<csv::StringRecord, csv::Error>| {
        let record = record.map_err(|error| wrong(error.to_string()))?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |place: usize| {
            let text = record.get(place).unwrap_or_default();
            let number = text.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| wrong(format!("line {line}: `{text}` is not a number")))
        };
        let [u, v, distance_m] = numbers.map(number);
        let point = Point { at: Some([u?, v?]), distance_m: distance_m? };
        point.check().map_err(|error| wrong(format!("line {line}: {error}")))?;
        let image = folder.join(record.get(image).unwrap_or_default());
        if !image.is_file() {
            return Err(wrong(format!("line {line}: there is no image `{}`", image.display())));
        }
        Ok(Reading { image, point, line })
    };
    let readings: Vec<Reading> = reader.records().map(reading).collect::<Result<_, _>>()?;
    if readings.is_empty() {
        return Err(wrong("it has no rows below its header".to_owned()));
    }
    Ok(readings)
}

/// A table of readings, and its images.
///
/// # Errors
/// A table that cannot be used.
pub fn files(table: &Path) -> Result<Vec<PathBuf>, CalibrateError> {
    let images: BTreeSet<PathBuf> = read(table)?.into_iter().map(|reading| reading.image).collect();
    Ok(images.into_iter().chain([table.to_owned()]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn readings(text: &str) -> Result<Vec<Reading>, CalibrateError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pairs.csv");
        std::fs::write(&path, text).unwrap();
        std::fs::create_dir(folder.path().join("a")).unwrap();
        for image in ["a.jpg", "a/b.jpg"] {
            std::fs::write(folder.path().join(image), "").unwrap();
        }
        let readings = read(&path)?;
        let relative = |reading: Reading| Reading {
            image: reading.image.strip_prefix(folder.path()).unwrap().to_owned(),
            ..reading
        };
        Ok(readings.into_iter().map(relative).collect())
    }

    #[test]
    fn columns_may_have_any_order_and_images_are_beside_the_table() {
        let found = readings("distance, u,v,note, image\n2.5,10,20.5,chair,a/b.jpg\n").unwrap();
        let point = Point { at: Some([10.0, 20.5]), distance_m: 2.5 };
        assert_eq!(found, [Reading { image: "a/b.jpg".into(), point, line: 2 }]);
    }

    #[test]
    fn a_wrong_table_is_refused_with_its_line() {
        for (text, words) in [
            ("", "it is empty"),
            ("\u{feff}\r\n", "it is empty"),
            ("image;u;v;distance\na.jpg;1;2;1,5\n", "semicolons, expected commas: `image;u;v;distance`"),
            ("image\tu\tv\tdistance\na.jpg\t1\t2\t1\n", "tabs, expected commas"),
            ("image,u,v,distance\n", "no rows"),
            ("image,u,v\na.jpg,1,2\n", "no column `distance`; its columns are `image`, `u`, `v`"),
            ("image,u,v,distance\na.jpg,1,x,2\n", "line 2: `x` is not a number"),
            ("image,u,v,distance\na.jpg,1,2\n", "line: 2"),
            ("image,u,v,distance\na.jpg,1,2,-1\n", "line 2: the distance -1 "),
            ("image,u,v,distance\na.jpg,1,2,1\na/c.jpg,1,2,1\n", "line 3: there is no image `"),
            ("image,u,v,distance\na,1,2,1\n", "line 2: there is no image `"),
            ("image,u,v,distance\n,1,2,1\n", "line 2: there is no image `"),
        ] {
            for text in [text, &text.replace('\n', "\r\n")] {
                let error = readings(text).unwrap_err().to_string();
                assert!(error.contains(words), "{error}");
            }
        }
        for (path, words) in [("missing.csv", "No such file"), ("/dev/zero", "it is not a regular file")] {
            let error = read(Path::new(path)).unwrap_err().to_string();
            assert!(error.contains(path) && error.contains(words), "{error}");
        }
    }
}
