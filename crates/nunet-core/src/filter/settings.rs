//! `key:value,key:value`, read once.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

use super::FilterError;

/// The settings of one filter as they were written.
pub(super) struct Settings<'a> {
    filter: &'static str,
    pairs: Vec<(&'static str, &'a str)>,
}

impl<'a> Settings<'a> {
    /// Reads `text`, empty for none. `bare` is the setting that a value without a key belongs to, where there
    /// is one.
    pub(super) fn parse(
        filter: &'static str,
        text: &'a str,
        known: &'static [&'static str],
        bare: Option<&'static str>,
        example: &'static str,
    ) -> Result<Self, FilterError> {
        let mut pairs: Vec<(&'static str, &'a str)> = Vec::new();
        for part in text.split(',').filter(|_| !text.is_empty()) {
            let (key, value) = match (part.split_once(':'), bare) {
                (Some((key, value)), _) => (key.trim(), value.trim()),
                (None, Some(key)) => (key, part.trim()),
                (None, None) => {
                    return Err(FilterError::NoSetting { filter, text: part.to_owned(), example });
                }
            };
            let known_key = known.iter().find(|name| **name == key);
            let key =
                *known_key.ok_or_else(|| FilterError::UnknownKey { filter, key: key.to_owned(), known })?;
            if pairs.iter().any(|(earlier, _)| *earlier == key) {
                return Err(FilterError::KeyTwice { filter, key });
            }
            pairs.push((key, value));
        }
        Ok(Self { filter, pairs })
    }

    /// The text of a setting.
    pub(super) fn text(&self, key: &'static str) -> Option<&'a str> {
        self.pairs.iter().find(|(name, _)| *name == key).map(|(_, value)| *value)
    }

    /// The number of a setting, `default` where it was not written.
    pub(super) fn number<T>(
        &self,
        key: &'static str,
        range: &RangeInclusive<T>,
        default: T,
    ) -> Result<T, FilterError>
    where
        T: FromStr + PartialOrd + Display,
    {
        let Some(text) = self.text(key) else { return Ok(default) };
        // NaN lies in no range.
        let number: Option<T> = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| {
            self.refuse(key, text, format!("a number from `{}` to `{}`", range.start(), range.end()))
        })
    }

    pub(super) fn refuse(&self, key: &'static str, text: &str, expected: String) -> FilterError {
        FilterError::Value { filter: self.filter, key, text: text.to_owned(), expected }
    }
}
