//! The fields of a message in JSON. Every error names its field.

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde_json::{Map, Value};

const NANOS_PER_SEC: i64 = 1_000_000_000;
/// How many characters of a value are in an error.
const SHOWN_CHARS: usize = 40;

/// The fields of one message. They are taken out, because images are large.
pub(crate) struct Fields(Map<String, Value>);

impl Fields {
    pub(crate) fn parse(message: &[u8]) -> Result<Self, String> {
        match serde_json::from_slice(message).map_err(|error| format!("{error:.200}"))? {
            Value::Object(fields) => Ok(Self(fields)),
            other => Err(format!("the message is {}, expected an object", shown(&other))),
        }
    }

    /// The value under the first of the spellings, with its name. `null` is none, and an empty array only counts if the
    /// other spelling has none.
    fn take<'n>(&mut self, names: &[&'n str]) -> Option<(&'n str, Value)> {
        let is_empty = |value: &Value| value.as_array().is_some_and(Vec::is_empty);
        let values = names.iter().filter_map(|name| Some((*name, self.0.remove(*name)?)));
        let mut present: Vec<_> = values.filter(|(_, value)| !value.is_null()).collect();
        let place = present.iter().position(|(_, value)| !is_empty(value)).unwrap_or(0);
        (place < present.len()).then(|| present.swap_remove(place))
    }

    /// A required whole number.
    pub(crate) fn whole_number(&mut self, name: &str) -> Result<u32, String> {
        let (_, value) = self.take(&[name]).ok_or_else(|| format!("`{name}` is missing"))?;
        integer(&value).and_then(|number| u32::try_from(number).ok()).ok_or_else(|| {
            format!("`{name}` is {}, expected a whole number from 0 to {}", shown(&value), u32::MAX)
        })
    }

    pub(crate) fn text(&mut self, names: &[&str]) -> Result<Option<String>, String> {
        match self.take(names) {
            None => Ok(None),
            Some((_, Value::String(text))) => Ok(Some(text)),
            Some((name, other)) => Err(format!("`{name}` is {}, expected a text", shown(&other))),
        }
    }

    pub(crate) fn numbers(&mut self, names: &[&str]) -> Result<Option<Vec<f64>>, String> {
        let Some((name, value)) = self.take(names) else { return Ok(None) };
        let Value::Array(values) = value else {
            return Err(format!("`{name}` is {}, expected an array of numbers", shown(&value)));
        };
        each(name, &values, "a number", number).map(Some)
    }

    /// Required bytes: base64, or an array of numbers.
    pub(crate) fn bytes(&mut self, name: &str) -> Result<Vec<u8>, String> {
        match self.take(&[name]) {
            None => Err(format!("`{name}` is missing")),
            Some((_, Value::String(text))) => {
                base64_bytes(text).map_err(|error| format!("`{name}` is not base64: {error}"))
            }
            Some((_, Value::Array(values))) => each(name, &values, "0 to 255", |value| {
                integer(value).and_then(|number| u8::try_from(number).ok())
            }),
            Some((_, other)) => Err(format!("`{name}` is {}, expected base64", shown(&other))),
        }
    }

    /// Nanoseconds of `{sec, nsec}`, with the names of ROS or of protobuf too. Any other form is 0, unknown; the
    /// time of recording replaces it.
    pub(crate) fn stamp(&mut self, name: &str) -> i64 {
        let Some((_, stamp)) = self.take(&[name]) else { return 0 };
        let field = |names: &[&str]| names.iter().find_map(|name| integer(stamp.get(*name)?));
        let sec = field(&["sec", "secs", "seconds"]).unwrap_or_default();
        let nsec = field(&["nsec", "nsecs", "nanosec", "nanos"]).unwrap_or_default();
        sec.saturating_mul(NANOS_PER_SEC).saturating_add(nsec)
    }
}

fn each<T>(
    name: &str,
    values: &[Value],
    expected: &str,
    convert: impl Fn(&Value) -> Option<T>,
) -> Result<Vec<T>, String> {
    let convert = |(place, value): (usize, &Value)| {
        let error = || format!("value {place} of `{name}` is {}, expected {expected}", shown(value));
        convert(value).ok_or_else(error)
    };
    (1..).zip(values).map(convert).collect()
}

/// A number, or a text with one.
fn number(value: &Value) -> Option<f64> {
    value.as_f64().or_else(|| value.as_str()?.trim().parse().ok())
}

/// A whole number, in any notation.
fn integer(value: &Value) -> Option<i64> {
    /// Larger whole numbers are not exact in `f64`.
    const EXACT: f64 = 9_007_199_254_740_992.0;
    let exact = value.as_i64().or_else(|| value.as_str()?.trim().parse().ok());
    exact.or_else(|| {
        let number = number(value).filter(|number| number.fract() == 0.0 && number.abs() <= EXACT)?;
        Some(number as i64)
    })
}

/// As protobuf's JSON mapping asks of readers: standard or URL-safe, with or without padding. MIME tools break the lines.
fn base64_bytes(mut text: String) -> Result<Vec<u8>, base64::DecodeError> {
    const ANY_PADDING: GeneralPurposeConfig =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    text.retain(|character| !character.is_ascii_whitespace());
    let alphabet = if text.contains(['-', '_']) { alphabet::URL_SAFE } else { alphabet::STANDARD };
    GeneralPurpose::new(&alphabet, ANY_PADDING).decode(text)
}

/// A value for an error, without the content of large ones.
fn shown(value: &Value) -> String {
    match value {
        Value::Array(_) => "an array".to_owned(),
        Value::Object(_) => "an object".to_owned(),
        Value::String(text) => format!("{:?}", text.chars().take(SHOWN_CHARS).collect::<String>()),
        other => other.to_string(),
    }
}
