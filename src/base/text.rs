//! Bytes as text. Names in models and paths are bytes; text is made of them here alone, for people,
//! for shells and for columns of the catalogue.

use std::borrow::Cow;
use std::ffi::OsStr;
use std::fmt::Write;
use std::os::unix::ffi::OsStrExt;

/// Bytes of a name that are shown at most.
const LONGEST_SHOWN: usize = 120;

/// A path or word as people see it: UTF-8 as it is, other bytes as `\xe9`, and what would steer a
/// terminal (control characters, turns of direction) as `\u{1b}`. One line, whatever it holds.
#[must_use]
pub fn shown(word: impl AsRef<OsStr>) -> String {
    escaped(word.as_ref().as_bytes(), steers)
}

/// [`shown`] for a name or a word from a model; of an endless one the beginning.
#[must_use]
pub fn shown_name(name: &[u8]) -> String {
    match name.get(..LONGEST_SHOWN) {
        Some(start) if name.len() > LONGEST_SHOWN => escaped(start, steers) + "...",
        _ => escaped(name, steers),
    }
}

/// A message without what would steer a terminal, its lines kept.
#[must_use]
pub fn harmless(message: &str) -> Cow<'_, str> {
    let harms = |c: char| steers(c) && c != '\n';
    if message.contains(harms) { Cow::Owned(escaped(message.as_bytes(), harms)) } else { Cow::Borrowed(message) }
}

/// A word as a shell reads it back, byte for byte: bare where that will do, else in single quotes.
/// Bytes that are no text, and what would steer a terminal, need `$'...'` (POSIX 2024; bash, zsh).
#[must_use]
pub fn for_shell(word: impl AsRef<OsStr>) -> String {
    let bytes = word.as_ref().as_bytes();
    match std::str::from_utf8(bytes) {
        Ok(text) if !text.is_empty() && text.chars().all(is_bare) => text.to_owned(),
        Ok(text) if !text.contains(steers) => format!("'{}'", text.replace('\'', r"'\''")),
        _ => {
            let mut out = "$'".to_owned();
            for byte in bytes {
                match byte {
                    b'\'' | b'\\' => out.extend(['\\', char::from(*byte)]),
                    b' '..=b'~' => out.push(char::from(*byte)),
                    _ => write!(out, "\\{byte:03o}").expect("a string takes all"),
                }
            }
            out + "'"
        }
    }
}

/// A name or path as the catalogue keeps it: as [`shown`], and a backslash doubled, so that different
/// bytes always make different text and [`from_stored`] finds them again.
#[must_use]
pub fn stored(bytes: &[u8]) -> String {
    escaped(bytes, |c| c == '\\' || steers(c))
}

/// The bytes that [`stored`] made this text of; `None` for text that it never makes.
#[must_use]
pub fn from_stored(text: &str) -> Option<Vec<u8>> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text;
    while let Some((plain, escape)) = rest.split_once('\\') {
        bytes.extend_from_slice(plain.as_bytes());
        if let Some(after) = escape.strip_prefix('\\') {
            bytes.push(b'\\');
            rest = after;
        } else if let Some(code) = escape.strip_prefix('x') {
            bytes.push(u8::from_str_radix(code.get(..2)?, 16).ok()?);
            rest = &code[2..];
        } else {
            let (code, after) = escape.strip_prefix("u{")?.split_once('}')?;
            let c = char::from_u32(u32::from_str_radix(code, 16).ok()?)?;
            bytes.extend_from_slice(c.encode_utf8(&mut [0; 4]).as_bytes());
            rest = after;
        }
    }
    bytes.extend_from_slice(rest.as_bytes());
    Some(bytes)
}

fn escaped(bytes: &[u8], is_escaped: impl Fn(char) -> bool) -> String {
    let mut out = String::with_capacity(bytes.len());
    for chunk in bytes.utf8_chunks() {
        for c in chunk.valid().chars() {
            match c {
                '\\' if is_escaped(c) => out.push_str("\\\\"),
                _ if is_escaped(c) => write!(out, "\\u{{{:x}}}", u32::from(c)).expect("a string takes all"),
                _ => out.push(c),
            }
        }
        for byte in chunk.invalid() {
            write!(out, "\\x{byte:02x}").expect("a string takes all");
        }
    }
    out
}

/// Control characters, line and paragraph separators, and turns of the writing direction.
fn steers(c: char) -> bool {
    c.is_control() || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

fn is_bare(c: char) -> bool {
    c.is_alphanumeric() || "_-./,:+@%=".contains(c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_shown_without_what_steers_a_terminal_and_other_bytes_can_be_told_apart() {
        assert_eq!(shown_name("Wand ß\\1".as_bytes()), "Wand ß\\1");
        assert_eq!(shown_name(b"caf\xe9"), "caf\\xe9");
        assert_eq!(shown_name(b"\x1b[2J\x07\n"), "\\u{1b}[2J\\u{7}\\u{a}");
        assert_eq!(shown_name("\u{9b}31m\u{202e}".as_bytes()), "\\u{9b}31m\\u{202e}");
        assert_eq!(shown_name(&[b'a'; 1000]), "a".repeat(120) + "...");
        assert_eq!(harmless("one\ntwo\x1b[31m"), "one\ntwo\\u{1b}[31m");
    }

    #[test]
    fn every_name_comes_back_from_the_text_that_is_stored_of_it() {
        let names: [&[u8]; 7] =
            [b"", b"wall", b"a\\xe9", b"a\xe9", b"\\u{1b}\x1b\\", "ß\u{202e}".as_bytes(), b"\xff\xfe\xc3"];
        for (i, name) in names.iter().enumerate() {
            let text = stored(name);
            assert_eq!(from_stored(&text).as_deref(), Some(*name), "{text}");
            assert!(names[..i].iter().all(|other| stored(other) != text), "{text}");
        }
        for never in ["a\\", "\\x4", "\\q", "\\u{110000}", "\\u{41"] {
            assert_eq!(from_stored(never), None, "{never}");
        }
    }

    #[test]
    fn a_shell_reads_every_quoted_word_back_byte_for_byte() {
        let words: [&[u8]; 8] =
            [b"", b"plain/a-b.clr", b"a b", b"$(rm x)", b"it's", b"~", b"a\xe9\n7", "große Halle".as_bytes()];
        for word in words {
            let quoted = for_shell(OsStr::from_bytes(word));
            let script = format!("printf %s {quoted}");
            let out = std::process::Command::new("bash").args(["-c", &script]).output().unwrap();
            assert_eq!(out.stdout, word, "{quoted}");
        }
        assert_eq!(for_shell("plain/a-b.clr"), "plain/a-b.clr");
        assert_eq!(for_shell("a b"), "'a b'");
    }
}
