//! Command lines that can be pasted into a shell.

use std::ffi::OsStr;
use std::fmt::Write;

/// A word as a shell wants it: as it is where that is safe, in `'…'`, or in `$'…'` with escapes where it holds bytes that are not
/// UTF-8 or characters that cannot be seen. bash, zsh and ksh understand the last form, and so does POSIX since 2024.
pub fn quoted(word: &OsStr) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=,:+@%".contains(c);
    match word.to_str() {
        Some(word) if !word.is_empty() && word.chars().all(is_plain) => word.to_owned(),
        Some(word) if !word.contains(char::is_control) => format!("'{}'", word.replace('\'', "'\\''")),
        _ => escaped(word.as_encoded_bytes()),
    }
}

fn escaped(bytes: &[u8]) -> String {
    let mut text = "$'".to_owned();
    let escape = |text: &mut String, byte: &u8| {
        // Writing into a text cannot fail. A byte takes all three digits, so that one behind it is none of them.
        let _ = write!(text, "\\{byte:03o}");
    };
    for chunk in bytes.utf8_chunks() {
        for c in chunk.valid().chars() {
            match c {
                '\'' | '\\' => text.extend(['\\', c]),
                c if c.is_control() => c.encode_utf8(&mut [0; 4]).bytes().for_each(|byte| escape(&mut text, &byte)),
                c => text.push(c),
            }
        }
        chunk.invalid().iter().for_each(|byte| escape(&mut text, byte));
    }
    text + "'"
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::ffi::OsStrExt;
    use std::process::Command;

    #[test]
    fn a_shell_reads_every_quoted_word_as_it_was() {
        if !Command::new("bash").arg("--version").output().is_ok_and(|output| output.status.success()) {
            println!("skipped: no bash");
            return;
        }
        let words: [&[u8]; 9] = [
            b"scene.toml",
            b"",
            b"my scene.toml",
            b"it's",
            b"$(id) `id` \"$HOME\" *",
            b"caf\xe9.toml",
            b"\xff1'\\",
            b"two\nlines\t\x1b[31m",
            "sc\u{e8}ne \u{85}.toml".as_bytes(),
        ];
        for word in words {
            let quoted = quoted(OsStr::from_bytes(word));
            assert!(!quoted.contains(char::is_control), "{quoted:?}");
            let output = Command::new("bash").arg("-c").arg(format!("printf %s {quoted}")).output().unwrap();
            assert_eq!(output.stdout, word, "{quoted}");
        }
    }
}
