//! Just enough of Rust's grammar to look at code without its comments and texts.

/// The code with comments, texts and characters blanked; every line and column stays where it was.
pub fn code_only(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut i = 0;
    while i < chars.len() {
        let end = skipped_until(&chars, i);
        if end == i {
            out.push(chars[i]);
            i += 1;
        } else {
            chars[i..end].iter().for_each(|c| out.push(if *c == '\n' { '\n' } else { ' ' }));
            i = end;
        }
    }
    out
}

/// End of the comment, text or character that starts at `i`; `i` itself if none does.
fn skipped_until(chars: &[char], i: usize) -> usize {
    let at = |k: usize| chars.get(k).copied().unwrap_or('\0');
    let after_word = i > 0 && is_word(chars[i - 1]);
    match chars[i] {
        '/' if at(i + 1) == '/' => find(chars, i, &['\n']).unwrap_or(chars.len()),
        '/' if at(i + 1) == '*' => find(chars, i + 2, &['*', '/']).map_or(chars.len(), |end| end + 2),
        '"' => end_of_text(chars, i + 1),
        'b' if at(i + 1) == '"' && !after_word => end_of_text(chars, i + 2),
        'r' if !after_word => raw_text(chars, i).unwrap_or(i),
        '\'' if at(i + 1) == '\\' => find(chars, i + 3, &['\'']).map_or(chars.len(), |end| end + 1),
        // A lifetime has no closing quote after its first letter.
        '\'' if at(i + 2) == '\'' => i + 3,
        _ => i,
    }
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

fn find(chars: &[char], from: usize, what: &[char]) -> Option<usize> {
    (from..chars.len().saturating_sub(what.len() - 1)).find(|k| chars[*k..].starts_with(what))
}

fn end_of_text(chars: &[char], mut i: usize) -> usize {
    while i < chars.len() && chars[i] != '"' {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    (i + 1).min(chars.len())
}

/// End of `r"…"` or `r#"…"#`.
fn raw_text(chars: &[char], start: usize) -> Option<usize> {
    let hashes = chars[start + 1..].iter().take_while(|c| **c == '#').count();
    if chars.get(start + 1 + hashes) != Some(&'"') {
        return None;
    }
    let mut closing = vec!['"'];
    closing.resize(1 + hashes, '#');
    find(chars, start + 2 + hashes, &closing).map(|end| end + closing.len())
}

/// The code before its test module.
pub fn without_tests(code: &str) -> &str {
    let module = ["mod tests", "pub(crate) mod tests", "pub(super) mod tests"]
        .iter()
        .filter_map(|module| code.find(&format!("#[cfg(test)]\n{module}")));
    module.min().map_or(code, |end| &code[..end])
}

/// Numbers in code that are written with a negative power of ten, and their lines.
pub fn small_numbers(code: &str) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (number, line) in code.lines().enumerate() {
        for (i, _) in line.match_indices("e-") {
            let mantissa: String =
                line[..i].chars().rev().take_while(|c| c.is_ascii_digit() || ".+_".contains(*c)).collect();
            let exponent: String = line[i + 2..].chars().take_while(char::is_ascii_digit).collect();
            if !mantissa.is_empty() && !exponent.is_empty() {
                found.push((number + 1, format!("{}e-{exponent}", mantissa.chars().rev().collect::<String>())));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_texts_and_characters_are_blanked_and_lifetimes_are_not() {
        let code = code_only(
            "let a: &'static str = \"fn b() { // }\"; // fn c\nlet d = '{'; let e = r#\"\"\"#; /* { */ '\\''",
        );
        assert!(code.contains("&'static str"));
        assert!(!code.contains("fn") && !code.contains('{'));
        assert_eq!(code.matches('\n').count(), 1);
    }

    #[test]
    fn small_numbers_are_found() {
        assert_eq!(small_numbers("a\nlet x = 1.5e-8 + b; like-this e-7"), [(2, "1.5e-8".to_owned())]);
    }
}
