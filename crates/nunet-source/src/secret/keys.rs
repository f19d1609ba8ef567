//! Keys and flags whose values are passwords.

/// What the next word may be.
pub(super) enum Next {
    Any,
    Password,
    /// A user, perhaps with a password after a colon.
    User,
}

/// What comes after a word that may be a flag.
pub(super) fn after_flag(word: &str) -> Next {
    let flag = word.trim_start_matches('-');
    let is_flag = flag.len() < word.len() && !flag.contains(['=', ':']);
    if is_flag && is_secret(flag) {
        Next::Password
    } else if is_flag && is_user(flag) {
        Next::User
    } else {
        Next::Any
    }
}

/// Where the value of the first key begins that names a password. It has no certain end: the value may have
/// any character.
pub(super) fn start_of_value(word: &str) -> Option<usize> {
    let keys = word.match_indices(['=', ':']).find_map(|(at, _)| {
        let (key, value) = (last_key(word.get(..at)?), word.get(at + 1..)?);
        (is_secret(key) || key == "p" || (is_user(key) && value.contains(':'))).then_some(at + 1)
    });
    // `curl -uUSER:PASSWORD`
    keys.or_else(|| word.strip_prefix("-u").filter(|user| user.contains(':')).map(|_| "-u".len()))
}

/// The key at the end of a text.
fn last_key(text: &str) -> &str {
    text.rsplit(|c: char| !c.is_alphanumeric() && !matches!(c, '-' | '_' | '.')).next().unwrap_or_default()
}

/// Whether a key or a flag is one of a password.
fn is_secret(key: &str) -> bool {
    const PARTS: [&str; 7] =
        ["passw", "passphrase", "secret", "token", "credential", "apikey", "authorization"];
    const ENDS: [&str; 5] = ["pass", "pas", "pwd", "psw", "psk"];
    let key = key.to_ascii_lowercase();
    let last = key.rsplit(['-', '_', '.']).next().unwrap_or_default();
    PARTS.iter().any(|part| key.contains(part))
        || ENDS.iter().any(|end| key.ends_with(end))
        || matches!(last, "pw" | "auth" | "key")
}

/// Whether a key and a colon may come before a password, and not only before a sentence.
pub(super) fn is_secret_before_words(text: &str) -> bool {
    let key = last_key(text);
    key != "key" && is_secret(key)
}

fn is_user(key: &str) -> bool {
    let last = key.rsplit(['-', '_', '.']).next().unwrap_or_default();
    last.eq_ignore_ascii_case("user") || last.eq_ignore_ascii_case("u")
}
