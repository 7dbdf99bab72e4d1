//! Words that may not appear anywhere: notes to oneself, and places of one machine.

use crate::tree::{report, rust_files, text_files};
use drapery_tests::source_text::code_only;

/// The words in two halves, so that this file does not hold them itself.
const NOTES: [[&str; 2]; 3] = [["TO", "DO"], ["FIX", "ME"], ["X", "XX"]];

/// Folders that exist on one machine only.
const PLACES: [[&str; 2]; 4] = [["/wo", "rk/"], ["/tm", "p/"], ["/ro", "ot/"], ["/ho", "me/"]];

/// Macros that stand for unfinished code.
const MACROS: [&str; 3] = ["todo!", "unimplemented!", "dbg!"];

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Lines (from 1) that hold `word`, not as a part of a longer one.
fn lines_with(text: &str, word: &str) -> Vec<usize> {
    let holds = |line: &str| {
        line.match_indices(word).any(|(i, _)| {
            let before = line[..i].chars().next_back().is_some_and(is_word);
            let after = line[i + word.len()..].chars().next().is_some_and(is_word);
            let begins_with_word = word.starts_with(is_word);
            let ends_with_word = word.ends_with(is_word);
            !(begins_with_word && before || ends_with_word && after)
        })
    };
    text.lines().enumerate().filter(|(_, line)| holds(line)).map(|(number, _)| number + 1).collect()
}

#[test]
fn no_file_holds_notes_to_oneself() {
    let mut complaints = Vec::new();
    for file in text_files() {
        for word in NOTES.map(|halves| halves.concat()) {
            let lines = lines_with(&file.text, &word);
            complaints.extend(lines.iter().map(|line| format!("{}:{line}: {word}", file.name)));
        }
    }
    report(&complaints);
}

#[test]
fn no_file_names_a_place_of_one_machine() {
    let mut complaints = Vec::new();
    for file in text_files() {
        for place in PLACES.map(|halves| halves.concat()) {
            for (number, line) in file.text.lines().enumerate() {
                // A relative path such as `frame/home/x` is not a place of a machine.
                let absolute =
                    |(i, _): (usize, &str)| !line[..i].ends_with(|c: char| is_word(c) || c == '.' || c == '/');
                if line.match_indices(&place).any(absolute) {
                    complaints.push(format!("{}:{}: {place}", file.name, number + 1));
                }
            }
        }
    }
    report(&complaints);
}

#[test]
fn no_code_is_unfinished() {
    let mut complaints = Vec::new();
    for file in rust_files() {
        let code = code_only(&file.text);
        for word in MACROS {
            let lines = lines_with(&code, word);
            complaints.extend(lines.iter().map(|line| format!("{}:{line}: {word}", file.name)));
        }
    }
    report(&complaints);
}

#[test]
fn no_page_holds_both_sides_of_a_merge() {
    let sides = ["<<<<<<< ", ">>>>>>> "];
    let is_side = |line: &str| sides.iter().any(|side| line.starts_with(side));
    let unmerged = text_files().into_iter().filter(|file| file.text.lines().any(is_side));
    let complaints: Vec<String> = unmerged.map(|file| file.name).collect();
    report(&complaints);
}

#[test]
fn whole_words_are_found_and_parts_of_words_are_not() {
    assert_eq!(lines_with("a word\nwordy\nsword\n(word)", "word"), [1, 4]);
}

/// Words of our own that code once had where the field has a term (`docs/guide/glossary.md`).
const RETIRED: [&str; 47] = [
    "Around",
    "Borders",
    "Care",
    "CatchUp",
    "Crew",
    "Fitted",
    "Follower",
    "HandingOut",
    "Hit",
    "Homes",
    "Lanes",
    "Neighbour",
    "Neighbours",
    "Placed",
    "Pressed",
    "Remembered",
    "Renumber",
    "Rung",
    "Sided",
    "Sound",
    "StepControl",
    "Supports",
    "Told",
    "Touching",
    "Trouble",
    "Wire",
    "blame",
    "calm_down",
    "catch_up",
    "climb",
    "crew",
    "foresee",
    "give_up",
    "give_way",
    "holders",
    "hopeless",
    "impose",
    "invite",
    "lay_down",
    "note_way",
    "rung",
    "take_back",
    "thinned",
    "told",
    "travellers",
    "visitors",
    "wear",
];

/// Those that have another meaning outside the solver: serde's visitors, an observer that has heard, rays that hit.
const RETIRED_IN_THE_SOLVER: [&str; 10] =
    ["AtHome", "ClothShare", "Visitor", "followers", "heard", "hits", "home", "homes", "inert", "is_home"];

/// The same in comments and pages, where a word alone may be plain English.
const RETIRED_PHRASES: [&str; 10] = [
    "at home",
    "is told",
    "are told",
    "was told",
    "were told",
    "told to all",
    "tell ranks",
    "tells ranks",
    "rungs of the ladder",
    "same trouble",
];

/// What makes plain English of a phrase that it follows: to be told apart, to be told to stop.
const PLAIN: [&str; 3] = [" apart", " from", " to "];

/// Pages that say how it was: decisions, and what has changed.
const PAST: [&str; 2] = ["docs/dev/decisions/", "CHANGELOG.md"];

#[test]
fn code_uses_the_terms_of_the_field() {
    let mut complaints = Vec::new();
    for file in rust_files().into_iter().filter(|file| file.name != "tests/tidy/words.rs") {
        let code = code_only(&file.text);
        let of_solver = RETIRED_IN_THE_SOLVER.iter().filter(|_| file.name.starts_with("core/src/"));
        for word in RETIRED.iter().chain(of_solver) {
            let lines = lines_with(&code, word).into_iter();
            complaints.extend(
                lines.map(|line| format!("{}:{line}: `{word}` is retired; see docs/guide/glossary.md", file.name)),
            );
        }
    }
    report(&complaints);
}

/// Lines (from 1) of prose that hold a retired phrase, with it.
fn private_phrases<'a>(prose: impl Iterator<Item = (usize, &'a str)>) -> Vec<(usize, &'static str)> {
    let holds = |line: &str, phrase: &str| {
        let is_plain = |rest: &str| PLAIN.iter().any(|plain| rest.starts_with(plain));
        let at_word = |at: usize| !line[..at].chars().next_back().is_some_and(is_word);
        line.match_indices(phrase).any(|(at, _)| at_word(at) && !is_plain(&line[at + phrase.len()..]))
    };
    let found = |(number, line): (usize, &'a str)| {
        RETIRED_PHRASES.into_iter().filter(move |phrase| holds(line, phrase)).map(move |phrase| (number, phrase))
    };
    prose.flat_map(found).collect()
}

#[test]
fn comments_and_pages_use_the_terms_of_the_field() {
    let mut complaints = Vec::new();
    for file in text_files().into_iter().filter(|file| !PAST.iter().any(|past| file.name.starts_with(past))) {
        let is_page = file.name.ends_with(".md");
        if file.name == "tests/tidy/words.rs" || !(is_page || file.name.ends_with(".rs")) {
            continue;
        }
        let lines = (1..).zip(file.text.lines());
        let prose = lines.filter(|(_, line)| is_page || line.trim_start().starts_with("//"));
        let found = private_phrases(prose);
        complaints.extend(found.iter().map(|(line, phrase)| {
            format!("{}:{line}: \"{phrase}\" is a phrase of our own; see docs/guide/glossary.md", file.name)
        }));
    }
    report(&complaints);
}

/// Phrases of our own that users met in messages, help texts and pages, with the word of the trade.
const HOME_MADE: [(&str, &str); 12] = [
    ("goes on", "resumes, continues"),
    ("go on", "resume, continue"),
    ("going on", "resuming, in progress"),
    ("went on", "resumed, continued"),
    ("the authors", "Selle et al. (2009)"),
    ("authors'", "of Selle et al. (2009)"),
    ("passed over", "ignored"),
    ("let pass", "accepted"),
    ("ideal shape", "analytic shape"),
    ("takes hold", "is active from"),
    ("lets go", "releases, is active until"),
    ("who said", "source"),
];

/// Where texts for users stand: the program without what only tests hold, and their pages.
fn is_for_users(name: &str) -> bool {
    const PAGES: [&str; 6] =
        ["README.md", "docs/README.md", "docs/start/", "docs/howto/", "docs/guide/", "docs/reference/"];
    const CRATES: [&str; 7] = ["core/src/", "io/", "shot/", "analysis/", "cli/", "plugins/", "sample_assets/"];
    let is_code =
        (name.ends_with(".rs") || name.ends_with(".py")) && !name.contains("tests") && !name.contains("examples/");
    name.ends_with(".md") && PAGES.iter().any(|page| name.starts_with(page))
        || is_code && CRATES.iter().any(|folder| name.starts_with(folder))
}

/// Home-made phrases in the texts of a line, with the word of the trade; comments of code are not looked at.
fn home_made(line: &str, is_page: bool) -> Vec<(&'static str, &'static str)> {
    let trimmed = line.trim_start();
    if !is_page && (trimmed.starts_with("//") || trimmed.starts_with('#')) {
        return Vec::new();
    }
    let text = if is_page { line } else { line.split(" // ").next().unwrap_or_default() };
    HOME_MADE.into_iter().filter(|(phrase, _)| !lines_with(text, phrase).is_empty()).collect()
}

/// Whether a line of a page says "crossing" in prose: the names of counts and fields stand in marks of code.
fn says_crossing(line: &str) -> bool {
    let prose = line.split('`').step_by(2).flat_map(|text| text.split(|c: char| !is_word(c)));
    prose.into_iter().any(|word| ["crossing", "crossings"].contains(&word.to_lowercase().as_str()))
}

#[test]
fn texts_for_users_use_the_words_of_the_trade() {
    let mut complaints = Vec::new();
    for file in text_files().into_iter().filter(|file| is_for_users(&file.name)) {
        let is_page = file.name.ends_with(".md");
        let mut is_example = false;
        for (number, line) in (1..).zip(file.text.lines()) {
            is_example ^= is_page && line.starts_with("```");
            let found = home_made(line, is_page).into_iter();
            complaints.extend(found.map(|(phrase, word)| format!("{}:{number}: \"{phrase}\": say {word}", file.name)));
            if is_page && !is_example && says_crossing(line) {
                complaints.push(format!("{}:{number}: say intersection", file.name));
            }
        }
    }
    report(&complaints);
}

#[test]
fn home_made_words_are_found_in_texts_and_names_are_not() {
    assert_eq!(home_made("say(\"the run goes on\");", false), [("goes on", "resumes, continues")]);
    assert_eq!(home_made("// the run goes on", false), []);
    assert_eq!(home_made("A run that goes on.", true), [("goes on", "resumes, continues")]);
    assert!(says_crossing("| Crossings are counted |") && !says_crossing("`crossings` counts them"));
    assert!(is_for_users("docs/guide/farm.md") && is_for_users("shot/src/quality.rs"));
    assert!(!is_for_users("docs/dev/fuzzing.md") && !is_for_users("cli/tests/command/farm.rs"));
}

#[test]
fn private_phrases_are_found_and_plain_english_is_not() {
    let found = |line: &'static str| private_phrases([(7, line)].into_iter());
    assert_eq!(found("pairs at home here"), [(7, "at home")]);
    assert_eq!(found("what a rank is told after a colour"), [(7, "is told")]);
    for plain in ["it was told to stop", "the two are told apart", "this told us", "words are told from others"] {
        assert_eq!(found(plain), [], "{plain}");
    }
}
