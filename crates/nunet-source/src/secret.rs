//! Passwords in names of sources and in what programs write: never part of a message. Where a password
//! cannot be separated from the rest, the rest is hidden too.

mod keys;
mod url;
mod words;

use std::borrow::Cow;
use std::ops::Range;

use percent_encoding::percent_decode_str;

use self::keys::{Next, after_flag, is_secret_before_words, start_of_value};
use self::url::{in_address, in_url};
use self::words::words;

const AFTER_SCHEME: &str = "://";
/// Replaces a password.
const HIDDEN: &str = "***";
/// Kinds of sources whose prefix is no part of a URL.
const COMMAND: &str = "exec:";
const OTHER_PREFIXES: [&str; 2] = ["ros2:", "shm:"];
/// Shorter parts of a password are in many words: hiding them would hide most of a message.
const MIN_PART_BYTES: usize = 3;

/// A text as it may be shown, such as a command or a line of its output.
#[must_use]
pub fn without_passwords(text: &str) -> Cow<'_, str> {
    hidden(text, &in_text(text))
}

/// The name of a source as it may be shown.
pub(crate) fn shown_name(name: &str) -> Cow<'_, str> {
    hidden(name, &in_name(name))
}

/// What was hidden in a source's name, and its parts: programs repeat it in other forms.
#[derive(Default)]
pub(crate) struct Secrets(Vec<String>);

impl Secrets {
    pub(crate) fn of_name(name: &str) -> Self {
        Self::at(name, in_name(name)).sorted()
    }

    /// Those in the arguments of a program.
    pub(crate) fn of_arguments(arguments: &[String]) -> Self {
        // A URL is one argument, and may have spaces.
        let ranges = |text: &str| if text.starts_with("rtsp") { in_word(text) } else { in_text(text) };
        let all = arguments.iter().flat_map(|text| Self::at(text, ranges(text)).0);
        Self(all.collect()).sorted()
    }

    /// Four forms of what is at `ranges`: all of it, and the part after its first `:`, both as they are
    /// written and with the escapes of a URL decoded. Of each form, also its parts between characters that
    /// are neither letters nor digits: programs cut a URL at other places than `ranges` does.
    fn at(text: &str, ranges: Vec<Range<usize>>) -> Self {
        // As the output of programs is read: bytes that are not UTF-8 are replaced.
        let decoded = |form: &str| percent_decode_str(form).decode_utf8_lossy().into_owned();
        let mut all = Vec::new();
        for secret in ranges.into_iter().filter_map(|range| text.get(range)) {
            let password = secret.split_once(':').map_or(secret, |(_, password)| password);
            for form in [decoded(secret), decoded(password), secret.to_owned(), password.to_owned()] {
                all.extend(form.split(|c: char| !c.is_alphanumeric()).map(str::to_owned));
                all.push(form);
            }
        }
        Self(all)
    }

    /// The longest first: it may contain others.
    fn sorted(mut self) -> Self {
        self.0.retain(|secret| secret.len() >= MIN_PART_BYTES);
        self.0.sort_by_key(|secret| std::cmp::Reverse(secret.len()));
        self
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The length of the longest one, bytes.
    pub(crate) fn longest(&self) -> usize {
        self.0.first().map_or(0, String::len)
    }

    /// A text without them and without other passwords.
    pub(crate) fn hide(&self, text: &str) -> String {
        let text = self.0.iter().fold(text.to_owned(), |text, secret| text.replace(secret, HIDDEN));
        without_passwords(&text).into_owned()
    }
}

/// `text` with ranges, which are in order, replaced.
fn hidden<'a>(text: &'a str, ranges: &[Range<usize>]) -> Cow<'a, str> {
    if ranges.is_empty() {
        return text.into();
    }
    let (mut shown, mut end) = (String::with_capacity(text.len()), 0);
    for range in ranges {
        shown.extend([text.get(end..range.start).unwrap_or_default(), HIDDEN]);
        end = range.end;
    }
    shown.push_str(text.get(end..).unwrap_or_default());
    shown.into()
}

fn shifted(ranges: Vec<Range<usize>>, by: usize) -> impl Iterator<Item = Range<usize>> {
    ranges.into_iter().map(move |range| range.start + by..range.end + by)
}

/// The passwords in a source's name. Except for a command, the whole name is one word, with spaces and
/// quotes.
fn in_name(name: &str) -> Vec<Range<usize>> {
    if let Some(command) = name.strip_prefix(COMMAND) {
        return shifted(in_text(command), COMMAND.len()).collect();
    }
    let prefix = OTHER_PREFIXES.iter().find(|prefix| name.starts_with(**prefix));
    let start = prefix.map_or(0, |prefix| prefix.len());
    shifted(in_word(name.get(start..).unwrap_or_default()), start).collect()
}

/// The passwords in a command, or in a line of its output.
fn in_text(text: &str) -> Vec<Range<usize>> {
    let (mut found, mut next) = (Vec::new(), Next::Any);
    for range in words(text) {
        let word = text.get(range.clone()).unwrap_or_default();
        let is_hidden = match next {
            Next::Any => false,
            Next::Password => true,
            Next::User => word.contains(':'),
        };
        next = Next::Any;
        if is_hidden {
            found.push(range);
        } else if word.strip_suffix([':', '=']).is_some_and(is_secret_before_words) {
            found.push(range.end..text.len());
            break;
        } else {
            found.extend(shifted(in_word(word), range.start));
            next = after_flag(word);
        }
    }
    found.retain(|range| !range.is_empty());
    found
}

/// The passwords in one word, in order.
fn in_word(word: &str) -> Vec<Range<usize>> {
    let mut found: Vec<_> = match word.find(AFTER_SCHEME).map(|scheme| scheme + AFTER_SCHEME.len()) {
        Some(start) => shifted(in_url(word.get(start..).unwrap_or_default()), start).collect(),
        None => in_address(word).into_iter().collect(),
    };
    if let Some(start) = start_of_value(word) {
        // What comes after it may be a part of it.
        found.retain(|range| range.start < start);
        found.iter_mut().for_each(|range| range.end = range.end.min(start));
        found.push(start..word.len());
    }
    found.retain(|range| !range.is_empty());
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn users_and_passwords_are_replaced_wherever_a_url_is() {
        for (text, shown) in [
            ("rtsp://10.0.0.4/front", "rtsp://10.0.0.4/front"),
            ("rtsp://10.0.0.4:554/a@b", "rtsp://10.0.0.4:554/a@b"),
            ("rtsp://[fe80::1]:554/a@b", "rtsp://[fe80::1]:554/a@b"),
            ("rtsp://admin:s3cret@10.0.0.4:554/a@b", "rtsp://***@10.0.0.4:554/a@b"),
            ("rtsp://admin:p@ss@cam", "rtsp://***@cam"),
            ("rtsp://admin:p/ss@cam/a", "rtsp://***@cam/a"),
            ("ffmpeg -i 'rtsp://a:b@c/d' -i http://e:f@g", "ffmpeg -i 'rtsp://***@c/d' -i http://***@g"),
            ("write to me@example.org", "write to me@example.org"),
            ("", ""),
        ] {
            assert_eq!(without_passwords(text), shown);
        }
    }

    #[test]
    fn what_is_no_password_is_shown() {
        for name in [
            "demo",
            "-",
            "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
            "drive/*.jpg",
            "shm:front",
            "ros2:/a@7",
            "ros2:/a@zenoh:tcp/10.0.0.1:7447",
            "rtsp://cam.local:554/front?channel=1",
            "rtsps://[fe80::1]:322/front",
            "exec:rpicam-vid -n -t 0 --codec mjpeg --width 640 --height 480 -o -",
            "exec:ffmpeg -i http://localhost:8080/a -vf scale=640:480 -f yuv4mpegpipe -",
        ] {
            assert_eq!(shown_name(name), name);
            assert!(Secrets::of_name(name).is_empty());
        }
    }

    /// Passwords of any characters, also those that a URL would have to escape.
    #[test]
    fn a_password_in_a_name_is_neither_shown_nor_in_the_output_of_its_program() {
        let passwords = "12#s3cret 12?s3cret 12/s3cret x's3cret x<s3cret 12:s3cret s3cret@ %40s3cret";
        let passwords = passwords.split(' ').chain(["x\"s3cret", "s3cret it", "it s3cret"]);
        let url = |password: &str| format!("rtsp://admin:{password}@10.0.0.4/front");
        let names = passwords.map(url).collect::<Vec<_>>();
        for name in names.iter().map(String::as_str).chain([
            "rtsp://john.doe:12/s3cret@cam.local/front",
            "rtsp://admin:s3cret",
            "rtsp://10.0.0.4/cam?user=admin&password=s3cret",
            "rtsp://10.0.0.4/cam?user=admin&password=p@s3cret",
            "rtsp://cam.local/cam?user=admin&pwd=p@s3cret",
            "rtsp://10.0.0.4/user=admin_password=s3cret_channel=1.sdp",
            "rtsp://10.0.0.4/11?u=admin&p=s3cret",
            "rtsp://10.0.0.4/admin:s3cret@front",
            "rtsp:/admin:s3cret@10.0.0.4/front",
            "rstp://admin:s3cret@10.0.0.4/front",
            "exec:curl -u admin:s3cret http://10.0.0.4/video",
            "exec:curl -uadmin:s3cret http://10.0.0.4/video",
            "exec:curl --user=admin:s3cret http://10.0.0.4/video",
            "exec:curl --user 'admin:a s3cret' http://10.0.0.4/video",
            "exec:curl -H 'Authorization: Basic s3cret' http://10.0.0.4/video",
            "exec:wget --http-password s3cret -O - http://10.0.0.4/video",
            "exec:RTSP_PASS=s3cret camera.sh",
            "exec:gst-launch-1.0 rtspsrc location=rtsp://10.0.0.4 user-id=admin user-pw=s3cret ! fdsink",
            "exec:ffmpeg -i 'rtsp://admin:a s3cret@10.0.0.4/a' -f mjpeg -",
            "exec:ffmpeg -i \"rtsp://admin:x's3cret@10.0.0.4/a\" -f mjpeg -",
        ]) {
            let shown = shown_name(name);
            assert!(!shown.contains("s3cret") && shown.contains(HIDDEN), "{name}: {shown}");
            let secrets = Secrets::of_name(name);
            for printed in ["s3cret", "no host s3cret@10.0.0.4", name] {
                let shown = secrets.hide(printed);
                assert!(!shown.contains("s3cret"), "{name}: {shown}");
            }
        }
    }

    #[test]
    fn the_host_is_shown_if_it_is_certain() {
        for (name, shown) in [
            ("rtsp://admin:12#s3cret@10.0.0.4/front", "rtsp://***@10.0.0.4/front"),
            ("rtsp://admin:s3cret it@10.0.0.4:554/front", "rtsp://***@10.0.0.4:554/front"),
            ("rtsp://10.0.0.4/cam?user=admin&password=s3cret", "rtsp://10.0.0.4/cam?user=admin&password=***"),
            ("exec:curl -u admin:s3cret http://10.0.0.4/a", "exec:curl -u *** http://10.0.0.4/a"),
        ] {
            assert_eq!(shown_name(name), shown);
        }
    }

    #[test]
    fn an_escaped_password_is_hidden_in_both_forms() {
        let secrets = Secrets::of_name("rtsp://admin:%23s%25t@10.0.0.4/a");
        assert_eq!(secrets.hide("admin, %23s%25t or #s%t"), "***, *** or ***");
    }

    #[test]
    fn an_escaped_password_is_decoded_even_if_parts_of_it_cannot_be() {
        let secrets = Secrets::of_name("rtsp://admin:1%zz%23%+fs@10.0.0.4/a");
        assert_eq!(secrets.hide("1%zz#%+fs is wrong"), "*** is wrong");
        // Latin-1, in a line that was read as UTF-8.
        let secrets = Secrets::of_name("rtsp://admin:%e9%e8@10.0.0.4/a");
        assert_eq!(secrets.hide("\u{fffd}\u{fffd} is wrong"), "*** is wrong");
    }
}
