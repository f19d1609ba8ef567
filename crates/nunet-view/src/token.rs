//! The secret that viewers present.

use std::fmt;

use subtle::ConstantTimeEq as _;

use crate::error::ViewError;

/// The longest token that is accepted.
const MAX_TOKEN_BYTES: usize = 256;

/// A secret that viewers present in a cookie, in the header `Authorization: Bearer`, or as `?token=` in the
/// address.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A token of 1 to 256 letters, digits or `-._~+/=`: what HTTP's bearer tokens may consist of.
    ///
    /// # Errors
    /// It is empty, too long, or has another character.
    pub fn new(text: impl Into<String>) -> Result<Self, ViewError> {
        let text = text.into();
        let is_allowed = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~+/=".contains(&byte);
        let reason = match text.len() {
            0 => "is empty",
            length if length > MAX_TOKEN_BYTES => "is longer than 256 characters",
            _ if !text.bytes().all(is_allowed) => "has a character that is not allowed",
            _ => return Ok(Self(text)),
        };
        Err(ViewError::Token { reason })
    }

    /// The token that is the value of an environment variable; `None` if it is not set or empty.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_variable(name: &str) -> Result<Option<Self>, ViewError> {
        let text = std::env::var_os(name).filter(|text| !text.is_empty());
        // Bytes that are not Unicode become a character that is not allowed.
        text.map(|text| Self::new(text.to_string_lossy())).transpose()
    }

    /// Whether `presented` is the token. How long it takes does not depend on where the two differ.
    #[must_use]
    pub fn matches(&self, presented: &str) -> bool {
        self.0.as_bytes().ct_eq(presented.as_bytes()).into()
    }

    /// The token as the value of a cookie.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }
}

impl std::str::FromStr for Token {
    type Err = ViewError;

    fn from_str(text: &str) -> Result<Self, ViewError> {
        Self::new(text)
    }
}

impl fmt::Debug for Token {
    /// Never shows the token, so that it does not reach logs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

/// The text of a token before it is checked: an error of a parser would show the text.
#[derive(Clone, serde::Deserialize)]
pub struct UncheckedToken(String);

impl UncheckedToken {
    /// The token.
    ///
    /// # Errors
    /// As [`Token::new`].
    pub fn check(&self) -> Result<Token, ViewError> {
        Token::new(self.0.as_str())
    }
}

impl std::str::FromStr for UncheckedToken {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self(text.to_owned()))
    }
}

impl fmt::Debug for UncheckedToken {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("UncheckedToken(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ViewErrorKind;

    #[test]
    fn only_the_same_token_matches() {
        let token = Token::new("a-b._~+/=9").unwrap();
        assert!(token.matches("a-b._~+/=9"));
        for other in ["", "a", "a-b._~+/=8", "a-b._~+/=99", "A-b._~+/=9"] {
            assert!(!token.matches(other), "{other}");
        }
    }

    #[test]
    fn tokens_with_characters_that_urls_or_cookies_forbid_are_refused() {
        for text in ["", "a b", "a;b", "a\"b", "a\nb", "ü", "a%20", &"x".repeat(257)] {
            assert_eq!(Token::new(text).unwrap_err().kind(), ViewErrorKind::Token, "{text}");
        }
        assert!(Token::new("x".repeat(256)).is_ok());
    }

    #[test]
    fn a_token_is_never_printed() {
        assert_eq!(format!("{:?}", Token::new("secret").unwrap()), "Token(..)");
    }
}
