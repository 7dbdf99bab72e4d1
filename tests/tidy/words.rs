//! Words that may not appear: notes to oneself, paths of one machine, and words of our own where the field and the trade have terms.

use crate::tree::{SourceFile, report, rust_files, text_files};
use drapery_tests::source_text::code_only;

/// Notes to oneself and folders that exist on one machine only, in two halves, so that this file does not hold them itself.
const FORBIDDEN: [[&str; 2]; 7] =
    [["TO", "DO"], ["FIX", "ME"], ["X", "XX"], ["/wo", "rk/"], ["/tm", "p/"], ["/ro", "ot/"], ["/ho", "me/"]];

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Whether a line holds `word`, not as a part of a longer word or path.
fn holds(line: &str, word: &str) -> bool {
    line.match_indices(word).any(|(i, _)| {
        let before = line[..i].chars().next_back();
        let is_inside = if word.starts_with('/') {
            before.is_some_and(|c| is_word(c) || c == '.' || c == '/')
        } else {
            before.is_some_and(is_word) && word.starts_with(is_word)
        };
        let after = line[i + word.len()..].chars().next();
        !(is_inside || word.ends_with(is_word) && after.is_some_and(is_word))
    })
}

/// Complaints about the lines of a file, each with its number.
fn complaints<'a>(file: &'a SourceFile, wrong: impl Fn(&'a str) -> Vec<String>) -> Vec<String> {
    let lines = (1..).zip(file.text.lines());
    let found = lines.flat_map(|(number, line)| wrong(line).into_iter().map(move |what| (number, what)));
    found.map(|(number, what)| format!("{}:{number}: {what}", file.name)).collect()
}

#[test]
fn no_file_holds_notes_to_oneself_paths_of_one_machine_or_sides_of_a_merge() {
    let words = FORBIDDEN.map(|halves| halves.concat());
    let wrong = |line: &str| {
        let sides = ["<<<<<<< ", ">>>>>>> "].into_iter().filter(|side| line.starts_with(side)).map(str::to_owned);
        words.iter().filter(|word| holds(line, word)).cloned().chain(sides).collect()
    };
    report(&text_files().iter().flat_map(|file| complaints(file, wrong)).collect::<Vec<_>>());
}

/// Words of our own that code once had where the field has a term (`docs/guide/glossary.md`).
const RETIRED: &str = "Around Borders Care CatchUp Crew Fitted Follower HandingOut Hit Homes Lanes Neighbour Neighbours Placed \
    Pressed Remembered Renumber Rung Sided Sound StepControl Supports Told Touching Trouble Wire blame calm_down catch_up climb \
    crew foresee give_up give_way holders hopeless impose invite lay_down note_way rung take_back thinned told travellers visitors \
    wear";

/// Words that have another meaning outside the solver: serde's visitors, an observer that has heard, rays that hit.
const RETIRED_IN_THE_SOLVER: &str = "AtHome ClothShare Visitor followers heard hits home homes inert is_home";

/// Phrases that may not appear in comments and pages, in lower case: retired words, which alone may be plain English, and words that take
/// the noun for granted.
const RETIRED_PHRASES: [&str; 12] = [
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
    "so many",
    "whoever",
];

/// Continuations that make plain English of a phrase: to be told apart, to be told to stop.
const PLAIN: [&str; 3] = [" apart", " from", " to "];

/// Pages that say how it was: decisions, and what has changed.
const PAST: [&str; 2] = ["docs/dev/decisions/", "CHANGELOG.md"];

/// This file, which holds the words itself.
const OWN: &str = "tests/tidy/words.rs";

/// Retired words that no type may have within its name.
const RETIRED_IN_TYPES: &str =
    "AtHome CatchUp ClothShare Crew HandingOut Hit Homes Remembered Rung StepControl Told Touching Trouble";

/// Retired words that no function, field or constant may have within its name.
const RETIRED_IN_NAMES: &str = "blame calm_down catch_up crew foresee foresees give_up give_way holders hopeless impose invite \
    is_hit lay_down note_way rung take_back tell thinned told travellers visitors";

/// Words in names of the solver alone.
const RETIRED_IN_NAMES_OF_THE_SOLVER: &str = "followers heard inert is_home";

/// Names that hold a retired word in another meaning: a ray that hits a surface.
const OTHER_MEANING: [&str; 1] = ["PathHit"];

/// Words of a longest name; longer ones are sentences, such as those of tests.
const LONGEST_NAME: usize = 4;

/// Words of an identifier in lower case, between underscores: `exchange_ghosts`, `BodyContact` and `MAX_STEPS` have two each.
fn words_of(identifier: &str) -> String {
    let mut words = String::from("_");
    let mut before = '_';
    for c in identifier.chars() {
        if c.is_uppercase() && before.is_lowercase() {
            words.push('_');
        }
        words.extend(c.to_lowercase());
        before = c;
    }
    words + "_"
}

/// The retired word within an identifier.
fn retired_within<'a>(identifier: &str, is_solver: bool) -> Option<&'a str> {
    let words = words_of(identifier);
    if OTHER_MEANING.contains(&identifier) || words.matches('_').count() > LONGEST_NAME + 1 {
        return None;
    }
    let is_type = identifier.starts_with(char::is_uppercase) && identifier.contains(char::is_lowercase);
    let retired = if is_type { RETIRED_IN_TYPES } else { RETIRED_IN_NAMES };
    let more = if is_solver && !is_type { RETIRED_IN_NAMES_OF_THE_SOLVER } else { "" };
    let mut all = retired.split_whitespace().chain(more.split_whitespace());
    all.find(|word| words.contains(&words_of(word)))
}

#[test]
fn names_hold_no_retired_word_among_theirs() {
    let mut found = Vec::new();
    for file in rust_files().into_iter().filter(|file| file.name != OWN) {
        let wrong = |line: &str| {
            let names = line.split(|c| !is_word(c)).filter_map(|name| {
                let word = retired_within(name, file.name.starts_with("core/src/"))?;
                Some(format!("`{name}` holds `{word}`, which is retired; see docs/guide/glossary.md"))
            });
            names.collect()
        };
        found.extend(complaints(&SourceFile { text: code_only(&file.text), name: file.name.clone() }, wrong));
    }
    report(&found);
}

#[test]
fn code_uses_the_terms_of_the_field() {
    let mut found = Vec::new();
    for file in rust_files().into_iter().filter(|file| file.name != OWN) {
        let more = if file.name.starts_with("core/src/") { RETIRED_IN_THE_SOLVER } else { "" };
        let wrong = |line: &str| {
            let words = RETIRED.split_whitespace().chain(more.split_whitespace()).filter(|word| holds(line, word));
            words.map(|word| format!("`{word}` is retired; see docs/guide/glossary.md")).collect()
        };
        found.extend(complaints(&SourceFile { text: code_only(&file.text), name: file.name }, wrong));
    }
    report(&found);
}

/// Retired phrases in a line of prose.
fn private_phrases(line: &str) -> Vec<&'static str> {
    let is_plain = |rest: &str| PLAIN.iter().any(|plain| rest.starts_with(plain));
    let at_word = |at: usize| !line[..at].chars().next_back().is_some_and(is_word);
    let found =
        |phrase: &&str| line.match_indices(*phrase).any(|(at, _)| at_word(at) && !is_plain(&line[at + phrase.len()..]));
    RETIRED_PHRASES.into_iter().filter(found).collect()
}

#[test]
fn comments_and_pages_use_the_terms_of_the_field() {
    let mut found = Vec::new();
    for file in text_files().into_iter().filter(|file| !PAST.iter().any(|past| file.name.starts_with(past))) {
        let is_page = file.name.ends_with(".md");
        if file.name == OWN || !(is_page || file.name.ends_with(".rs")) {
            continue;
        }
        let wrong = |line: &str| {
            let phrases = if is_page || line.trim_start().starts_with("//") {
                private_phrases(&line.to_lowercase())
            } else {
                Vec::new()
            };
            let said = |phrase| format!("\"{phrase}\" is a phrase of our own; see docs/guide/glossary.md");
            phrases.into_iter().map(said).collect()
        };
        found.extend(complaints(&file, wrong));
    }
    report(&found);
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

/// Returns whether a file holds texts for users: code of the program without its tests, or a page for users.
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
    HOME_MADE.into_iter().filter(|(phrase, _)| holds(text, phrase)).collect()
}

/// Whether a line of a page says "crossing" in prose: the names of counts and fields stand in marks of code.
fn says_crossing(line: &str) -> bool {
    let prose = line.split('`').step_by(2).flat_map(|text| text.split(|c: char| !is_word(c)));
    prose.into_iter().any(|word| ["crossing", "crossings"].contains(&word.to_lowercase().as_str()))
}

#[test]
fn texts_for_users_use_the_words_of_the_trade() {
    let mut found = Vec::new();
    for file in text_files().into_iter().filter(|file| is_for_users(&file.name)) {
        let is_page = file.name.ends_with(".md");
        let is_example = std::cell::Cell::new(false);
        let wrong = |line: &str| {
            is_example.set(is_example.get() ^ (is_page && line.starts_with("```")));
            let phrases =
                home_made(line, is_page).into_iter().map(|(phrase, word)| format!("\"{phrase}\": say {word}"));
            let crossing = is_page && !is_example.get() && says_crossing(line);
            phrases.chain(crossing.then(|| "say intersection".to_owned())).collect()
        };
        found.extend(complaints(&file, wrong));
    }
    report(&found);
}

#[test]
fn words_are_found_and_parts_of_words_names_and_plain_english_are_not() {
    let lines = ["a word", "wordy", "sword", "(word)", "frame/word/x"].map(|line| holds(line, "word"));
    assert_eq!(lines, [true, false, false, true, true]);
    assert!(holds("see /wor/d", "/wor/") && !holds("frame/wor/d", "/wor/") && !holds("../wor/d", "/wor/"));
    assert_eq!(home_made("say(\"the run goes on\");", false), [("goes on", "resumes, continues")]);
    assert_eq!(home_made("// the run goes on", false), []);
    assert_eq!(home_made("A run that goes on.", true), [("goes on", "resumes, continues")]);
    assert!(says_crossing("| Crossings are counted |") && !says_crossing("`crossings` counts them"));
    assert!(is_for_users("docs/guide/farm.md") && is_for_users("shot/src/quality.rs"));
    assert!(!is_for_users("docs/dev/fuzzing.md") && !is_for_users("cli/tests/command/farm.rs"));
    assert_eq!(words_of("HitNodes2"), "_hit_nodes2_");
    let within = ["HitNodes", "GIVE_UP_FROM", "told_strain", "is_white", "PathHit", "it_was_told_to_stop_at_once"];
    let retired = [Some("Hit"), Some("give_up"), Some("told"), None, None, None];
    assert_eq!(within.map(|name| retired_within(name, false)), retired);
    assert_eq!([true, false].map(|is_solver| retired_within("stop_inert", is_solver)), [Some("inert"), None]);
    assert_eq!(private_phrases("pairs at home here"), ["at home"]);
    assert_eq!(private_phrases("what a rank is told after a colour"), ["is told"]);
    for plain in ["it was told to stop", "the two are told apart", "this told us", "words are told from others"] {
        assert!(private_phrases(plain).is_empty(), "{plain}");
    }
}
