//! The fields of a message in JSON. Every error names its field.
//!
//! An image may be an array of numbers. Arrays are converted while they are read: a [`Value`] for each number
//! would take 16 times the memory of the text.

use std::collections::BTreeMap;
use std::fmt;

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use serde::de::{DeserializeSeed, Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value};

const NANOS_PER_SEC: i64 = 1_000_000_000;
/// How many characters of a value are in an error.
const SHOWN_CHARS: usize = 40;
/// The field whose array is the bytes of an image.
const BYTES: &str = "data";
/// The most numbers of another array: a projection has 12, a lens 14.
const MAX_NUMBERS: usize = 64;
/// The names of a time's parts, those of ROS and of protobuf too.
const SECONDS: [&str; 3] = ["sec", "secs", "seconds"];
const NANOSECONDS: [&str; 4] = ["nsec", "nsecs", "nanosec", "nanos"];

/// The fields of one message. They are taken out, because images are large.
pub(crate) struct Fields(BTreeMap<&'static str, Field>);

/// The content of a field.
enum Field {
    /// `null`, a truth value, a number or a text. An array or an object within another one is an empty one
    /// here.
    Single(Value),
    /// The parts of a time; others are ignored.
    Object(Map<String, Value>),
    /// An array of [`BYTES`], or the first value that is not a byte.
    Bytes(Result<Vec<u8>, String>),
    /// Any other array, or the first value that is not a number.
    Numbers(Result<Vec<f64>, String>),
}

impl Field {
    /// The value; of an array or an object only what it is.
    fn single(self) -> Value {
        match self {
            Self::Single(value) => value,
            Self::Object(_) => Value::Object(Map::new()),
            Self::Bytes(_) | Self::Numbers(_) => Value::Array(Vec::new()),
        }
    }

    fn is_null(&self) -> bool {
        matches!(self, Self::Single(Value::Null))
    }

    fn is_empty_array(&self) -> bool {
        matches!(self, Self::Numbers(Ok(numbers)) if numbers.is_empty())
    }
}

impl Fields {
    /// Reads the fields of these names; others are ignored.
    pub(crate) fn parse(message: &[u8], names: &[&'static str]) -> Result<Self, String> {
        let mut json = serde_json::Deserializer::from_slice(message);
        let fields = json.deserialize_map(FieldsVisitor(names));
        let whole = fields.and_then(|fields| json.end().map(|()| fields));
        // The error may quote a text as long as the message.
        whole.map(Self).map_err(|error| format!("{:.200}", error.to_string()))
    }

    /// The value under the first of the spellings, with its name. `null` is none, and an empty array only
    /// counts if the other spelling has none.
    fn take<'n>(&mut self, names: &[&'n str]) -> Option<(&'n str, Field)> {
        let values = names.iter().filter_map(|name| Some((*name, self.0.remove(*name)?)));
        let mut present: Vec<_> = values.filter(|(_, value)| !value.is_null()).collect();
        let place = present.iter().position(|(_, value)| !value.is_empty_array()).unwrap_or(0);
        (place < present.len()).then(|| present.swap_remove(place))
    }

    /// A required whole number.
    pub(crate) fn whole_number(&mut self, name: &str) -> Result<u32, String> {
        let (_, value) = self.take(&[name]).ok_or_else(|| format!("`{name}` is missing"))?;
        let value = value.single();
        integer(&value).and_then(|number| u32::try_from(number).ok()).ok_or_else(|| {
            format!("`{name}` is {}, expected a whole number from 0 to {}", shown(&value), u32::MAX)
        })
    }

    pub(crate) fn text(&mut self, names: &[&str]) -> Result<Option<String>, String> {
        let Some((name, value)) = self.take(names) else { return Ok(None) };
        match value.single() {
            Value::String(text) => Ok(Some(text)),
            other => Err(format!("`{name}` is {}, expected a text", shown(&other))),
        }
    }

    pub(crate) fn numbers(&mut self, names: &[&str]) -> Result<Option<Vec<f64>>, String> {
        match self.take(names) {
            None => Ok(None),
            Some((_, Field::Numbers(numbers))) => numbers.map(Some),
            Some((name, other)) => {
                Err(format!("`{name}` is {}, expected an array of numbers", shown(&other.single())))
            }
        }
    }

    /// The required bytes of an image: base64, or an array of numbers.
    pub(crate) fn bytes(&mut self) -> Result<Vec<u8>, String> {
        match self.take(&[BYTES]) {
            None => Err(format!("`{BYTES}` is missing")),
            Some((_, Field::Bytes(bytes))) => bytes,
            Some((_, Field::Single(Value::String(text)))) => {
                base64_bytes(text).map_err(|error| format!("`{BYTES}` is not base64: {error}"))
            }
            Some((_, other)) => Err(format!("`{BYTES}` is {}, expected base64", shown(&other.single()))),
        }
    }

    /// Nanoseconds of `{sec, nsec}`, with the names of ROS or of protobuf too. Any other form is 0, unknown;
    /// the time of recording replaces it.
    pub(crate) fn stamp(&mut self, name: &str) -> i64 {
        let Some((_, Field::Object(stamp))) = self.take(&[name]) else { return 0 };
        let part = |names: &[&str]| names.iter().find_map(|name| integer(stamp.get(*name)?));
        let sec = part(&SECONDS).unwrap_or_default();
        let nsec = part(&NANOSECONDS).unwrap_or_default();
        sec.saturating_mul(NANOS_PER_SEC).saturating_add(nsec)
    }
}

/// Reads the fields of these names of a message.
struct FieldsVisitor<'n>(&'n [&'static str]);

impl<'de> Visitor<'de> for FieldsVisitor<'_> {
    type Value = BTreeMap<&'static str, Field>;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut message: A) -> Result<Self::Value, A::Error> {
        let mut fields = BTreeMap::new();
        while let Some(name) = message.next_key::<String>()? {
            match self.0.iter().find(|known| **known == name) {
                Some(&name) => {
                    fields.insert(name, message.next_value_seed(Place::In(name))?);
                }
                None => {
                    message.next_value::<IgnoredAny>()?;
                }
            }
        }
        Ok(fields)
    }
}

/// Where a value stands.
#[derive(Clone, Copy)]
enum Place {
    /// It is the field of this name.
    In(&'static str),
    /// In an array, or in an object that is a field. Arrays and objects are ignored here.
    Within,
}

impl<'de> DeserializeSeed<'de> for Place {
    type Value = Field;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Field, D::Error> {
        deserializer.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Place {
    type Value = Field;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<Field, E> {
        Ok(Field::Single(Value::Null))
    }

    fn visit_bool<E>(self, value: bool) -> Result<Field, E> {
        Ok(Field::Single(value.into()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Field, E> {
        Ok(Field::Single(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Field, E> {
        Ok(Field::Single(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Field, E> {
        Ok(Field::Single(value.into()))
    }

    fn visit_str<E>(self, value: &str) -> Result<Field, E> {
        Ok(Field::Single(value.into()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut array: A) -> Result<Field, A::Error> {
        match self {
            Self::In(name) if name == BYTES => {
                let byte = |value: &Value| integer(value).and_then(|number| u8::try_from(number).ok());
                each(name, array, ("0 to 255", usize::MAX), byte).map(Field::Bytes)
            }
            Self::In(name) => each(name, array, ("a number", MAX_NUMBERS), number).map(Field::Numbers),
            Self::Within => {
                while array.next_element::<IgnoredAny>()?.is_some() {}
                Ok(Field::Single(Value::Array(Vec::new())))
            }
        }
    }

    fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<Field, A::Error> {
        let mut parts = Map::new();
        while let Some(name) = object.next_key::<String>()? {
            let is_part = SECONDS.iter().chain(&NANOSECONDS).any(|known| *known == name);
            if is_part && matches!(self, Self::In(_)) {
                parts.insert(name, object.next_value_seed(Self::Within)?.single());
            } else {
                object.next_value::<IgnoredAny>()?;
            }
        }
        Ok(match self {
            Self::In(_) => Field::Object(parts),
            Self::Within => Field::Single(Value::Object(parts)),
        })
    }
}

/// The converted values of an array, `most` at most. After one that is not as `expected`, the others are
/// ignored.
fn each<'de, A: SeqAccess<'de>, T>(
    name: &str,
    mut values: A,
    (expected, most): (&str, usize),
    convert: impl Fn(&Value) -> Option<T>,
) -> Result<Result<Vec<T>, String>, A::Error> {
    let (mut converted, mut error) = (Vec::new(), None);
    while error.is_none()
        && let Some(value) = values.next_element_seed(Place::Within)?
    {
        let (value, place) = (value.single(), converted.len() + 1);
        match convert(&value) {
            Some(_) if place > most => error = Some(format!("`{name}` has more than {most} values")),
            Some(value) => converted.push(value),
            None => {
                error = Some(format!("value {place} of `{name}` is {}, expected {expected}", shown(&value)));
            }
        }
    }
    while values.next_element::<IgnoredAny>()?.is_some() {}
    Ok(error.map_or(Ok(converted), Err))
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

/// As protobuf's JSON mapping asks of readers: standard or URL-safe, with or without padding. MIME tools
/// break the lines.
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
