//! The macro that declares an enumeration with its numbers, names and documentation, and its errors.

use std::error::Error;
use std::fmt;

use crate::error_kind::TypesErrorKind;

/// A number that no variant of an enumeration has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnknownValue {
    /// The enumeration, as `contract --json` names it.
    pub field: &'static str,
    /// The number found.
    pub value: u32,
    /// The largest number that has a meaning.
    pub last: u32,
}

impl UnknownValue {
    /// [`TypesErrorKind::Contract`].
    #[must_use]
    pub const fn kind(&self) -> TypesErrorKind {
        TypesErrorKind::Contract
    }
}

impl fmt::Display for UnknownValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { field, value, last } = self;
        write!(f, "field `{field}` is `{value}`, but contract 1 defines only 0 to {last}")
    }
}

impl Error for UnknownValue {}

/// A word that names no variant of an enumeration.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnknownWord {
    /// The enumeration, as `contract --json` names it.
    pub field: &'static str,
    /// What was given.
    pub word: String,
    /// Every known word.
    pub choices: Vec<&'static str>,
}

impl UnknownWord {
    /// [`TypesErrorKind::Argument`].
    #[must_use]
    pub const fn kind(&self) -> TypesErrorKind {
        TypesErrorKind::Argument
    }
}

impl fmt::Display for UnknownWord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, choices) = (self.field.replace('_', " "), self.choices.join("`, `"));
        write!(f, "unknown {what} `{}`, expected one of `{choices}`", self.word)
    }
}

impl Error for UnknownWord {}

// One macro, so that numbers, names, documentation and the table of `contract --json` cannot differ.
macro_rules! vocabulary {
    ($(#[$doc:meta])* $name:ident as $field:literal {
        $($(#[doc = $variant_doc:literal])* $variant:ident = $number:literal $word:literal,)+
    }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u32)]
        pub enum $name { $($(#[doc = $variant_doc])* $variant = $number,)+ }

        impl $name {
            /// The enumeration's name in `contract --json`.
            pub const FIELD: &'static str = $field;
            /// Every variant, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];
            /// Every name with its number.
            pub const NUMBERS: &'static [(&'static str, u32)] = &[$(($word, $number),)+];
            /// The documentation of each variant, in the order of their numbers.
            pub const DOCS: &'static [&'static str] = &[$(concat!($($variant_doc, "\n"),*),)+];

            /// The name on the command line, in files and in messages.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $word,)+ }
            }
        }

        impl From<$name> for u32 {
            fn from(value: $name) -> Self {
                value as Self
            }
        }

        impl TryFrom<u32> for $name {
            type Error = $crate::UnknownValue;

            fn try_from(value: u32) -> Result<Self, $crate::UnknownValue> {
                let last = Self::ALL.len() as u32 - 1;
                let known = Self::ALL.get(value as usize).copied();
                known.ok_or($crate::UnknownValue { field: $field, value, last })
            }
        }

        impl std::str::FromStr for $name {
            type Err = $crate::UnknownWord;

            fn from_str(word: &str) -> Result<Self, $crate::UnknownWord> {
                let known = Self::ALL.iter().copied().find(|value| value.name() == word);
                known.ok_or_else(|| $crate::UnknownWord {
                    field: $field,
                    word: word.to_owned(),
                    choices: Self::ALL.iter().map(|value| value.name()).collect(),
                })
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }
    };
}
pub(crate) use vocabulary;

#[cfg(test)]
mod tests {
    use crate::{
        Clock, DistortionModel, Encoding, PixelFormat, Quality, ScaleSource, SectorState, Topic,
        TypesErrorKind, Units, Wake,
    };

    #[test]
    fn every_number_equals_its_position_in_the_table() {
        for numbers in [
            Topic::NUMBERS,
            Encoding::NUMBERS,
            Units::NUMBERS,
            ScaleSource::NUMBERS,
            Clock::NUMBERS,
            DistortionModel::NUMBERS,
            Quality::NUMBERS,
            Wake::NUMBERS,
            PixelFormat::NUMBERS,
            SectorState::NUMBERS,
        ] {
            for (position, (word, number)) in numbers.iter().enumerate() {
                assert_eq!(*number as usize, position, "{word}");
            }
        }
    }

    #[test]
    fn a_word_reads_back_as_the_value_it_names() {
        for topic in Topic::ALL {
            assert_eq!(topic.name().parse(), Ok(*topic));
        }
        for format in PixelFormat::ALL {
            assert_eq!(format.to_string().parse(), Ok(*format));
        }
    }

    #[test]
    fn an_unknown_number_says_what_was_expected() {
        let error = Quality::try_from(9).unwrap_err();
        assert_eq!(error.kind(), TypesErrorKind::Contract);
        let message = error.to_string();
        assert_eq!(message, "field `quality` is `9`, but contract 1 defines only 0 to 1");
    }

    #[test]
    fn an_unknown_word_lists_the_choices() {
        let error = "rgb".parse::<PixelFormat>().unwrap_err();
        assert_eq!(error.kind(), TypesErrorKind::Argument);
        let message = error.to_string();
        assert_eq!(
            message,
            "unknown pixel format `rgb`, expected one of `rgb8`, `bgr8`, `mono8`, `yuyv`, `nv12`"
        );
    }
}
