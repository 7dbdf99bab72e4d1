//! Whether the figures of a study can be believed: what has to hold of them whatever the scene, and whether it does.

use crate::page::text::{self, millimetres};
use crate::study::analysis::{Analysis, NOISY, Row, Validity, error_over, mean_step};
use crate::study::balance;
use crate::study::record::{Machine, Role, Sample, Study};
use crate::study::vary::{RANKS, THREADS};
use crate::study::verdict::Check;

/// Least number of compared frames that can be split into earlier and later ones.
const SPLIT: usize = 6;

/// Share of the frames, the earliest ones, from which the error of later ones is foretold.
const EARLIER: f64 = 2.0 / 3.0;

/// Ratios above this are only called large.
const LARGE: f64 = 100.0;

/// Largest ratio allowed of the error of later frames to the error of earlier ones.
const HELD_OUT: f64 = 2.0;

/// Share of its time that a finer run may be faster than a coarser one, at least: less is nothing.
const SAME_TIME: f64 = 0.1;

/// Running processes for each processor before the study from which times are not to be trusted.
const BUSY: f64 = 0.5;

/// All checks, in the order of what they are about.
pub(super) fn checks(study: &Study, analysis: &Analysis<'_>) -> Vec<Check> {
    vec![
        reference(analysis),
        falling(study, analysis),
        held_out(study, analysis),
        balance::momentum(study),
        balance::energy(study),
        same_bits(study),
        dearer(study, analysis),
        steady(study, analysis),
    ]
}

/// The reference tells the error of the scene as it is.
fn reference(analysis: &Analysis<'_>) -> Check {
    let name = "The reference is converged";
    let base = analysis.rows.first().and_then(|row| row.error);
    let (Some(own), Some(base)) = (analysis.own, base) else {
        return Check::new(name, None, "the time limit left no room for the reference and its checks".to_owned());
    };
    let rms = base.rms.max(f64::MIN_POSITIVE);
    let why = format!("self-error {}, {} % of the error of the scene as it is", millimetres(own), percent(own / rms));
    Check::new(name, Some(base.validity != Validity::NotConverged), why)
}

/// Rows of the scene as it is and of settings of accuracy that differ in their steps alone, the coarsest first.
fn by_step<'a, 'b>(study: &Study, analysis: &'b Analysis<'a>) -> Vec<Vec<&'b Row<'a>>> {
    let mut groups: Vec<Vec<&Row<'_>>> = Vec::new();
    for group in &analysis.groups {
        let mut rows: Vec<&Row<'_>> = group.iter().map(|index| &analysis.rows[*index]).collect();
        rows.sort_by(|a, b| mean_step(study, b.sample).total_cmp(&mean_step(study, a.sample)));
        groups.push(rows);
    }
    groups
}

/// Shorter steps reduce the error, as long as the reference resolves it.
fn falling(study: &Study, analysis: &Analysis<'_>) -> Check {
    let name = "Shorter steps reduce the error";
    let groups = by_step(study, analysis);
    let valid = |row: &&Row<'_>| row.error.filter(|error| error.validity == Validity::Yes);
    let mut pairs = 0;
    for pair in groups.iter().flat_map(|rows| rows.windows(2)) {
        let (Some(coarse), Some(fine)) = (valid(&pair[0]), valid(&pair[1])) else { continue };
        pairs += 1;
        if fine.rms > coarse.rms {
            let [coarser, finer] = [0, 1].map(|at| &pair[at].sample.setting.label);
            let why = format!(
                "{} with \"{coarser}\" and {} with \"{finer}\": another setting limits the error, such as cg_tolerance",
                millimetres(coarse.rms),
                millimetres(fine.rms)
            );
            return Check::new(name, Some(false), why);
        }
    }
    match pairs {
        0 => Check::new(name, None, "no pair of settings has errors that the reference resolves".to_owned()),
        1 => Check::new(name, Some(true), "in the one pair of settings with resolved errors".to_owned()),
        some => Check::new(name, Some(true), format!("in all {some} pairs of settings with resolved errors")),
    }
}

/// Checks whether the error of earlier frames holds for later ones as well, with the recommended setting, or else
/// with the scene as it is.
fn held_out(study: &Study, analysis: &Analysis<'_>) -> Check {
    let name = "The error is representative of later frames";
    let unknown = |why: &str| Check::new(name, None, why.to_owned());
    if analysis.window < SPLIT {
        return unknown("too few frames were compared");
    }
    let index = analysis.recommended(study.budget).unwrap_or(0);
    let Some(row) = analysis.rows.get(index) else { return unknown("nothing has run") };
    let split = ((analysis.window as f64 * EARLIER) as usize).clamp(1, analysis.window - 1);
    let distances = &row.sample.from_reference;
    let earlier = error_over(distances, split);
    let later = distances.get(split..analysis.window).and_then(|later| error_over(later, later.len()));
    let (Some(earlier), Some(later)) = (earlier, later) else { return unknown("there is no reference") };
    let ratio = later.rms / earlier.rms.max(f64::MIN_POSITIVE);
    let why = format!(
        "\"{}\": {} over the last {} compared frames, {} times the error of the {split} before",
        row.sample.setting.label,
        millimetres(later.rms),
        analysis.window - split,
        if ratio > LARGE { format!("more than {LARGE}") } else { text::digits(ratio) }
    );
    Check::new(name, Some(ratio <= HELD_OUT), why)
}

/// Runs of one setting, and runs on other numbers of threads and ranks, have the same bits.
fn same_bits(study: &Study) -> Check {
    let name = "Repeats and different numbers of threads and ranks give the same bits";
    let first = |of: &Sample| {
        let is_first = |sample: &&Sample| match of.role {
            Role::Threads => sample.role == Role::Base && sample.is_own(),
            role => sample.role == role && sample.setting == of.setting && sample.is_own(),
        };
        study.samples.iter().find(is_first).map(|sample| sample.bits.clone())
    };
    let again = |sample: &&Sample| {
        let plain = sample.setting.changes.iter().all(|(name, _)| [THREADS, RANKS].contains(&name.as_str()));
        let plain = sample.role != Role::Threads || plain;
        sample.is_whole() && sample.copy == 0 && plain && (sample.repeat > 0 || sample.role == Role::Threads)
    };
    let all: Vec<&Sample> = study.samples.iter().filter(again).collect();
    let other: Vec<&Sample> = all.iter().copied().filter(|s| first(s).is_none_or(|bits| bits != s.bits)).collect();
    let others = all.iter().filter(|sample| sample.role == Role::Threads);
    let (ranks, threads): (Vec<&Sample>, Vec<&Sample>) = others.partition(|sample| sample.setting.ranks > 1);
    let (ranks, threads) = (ranks.len(), threads.len());
    match (all.len(), other.first()) {
        (0, _) => Check::new(name, None, "nothing was run twice".to_owned()),
        (_, Some(sample)) => {
            let why = format!("\"{}\" differs: please report this bug", sample.setting.label);
            Check::new(name, Some(false), why)
        }
        (some, None) => {
            let repeats = some - threads - ranks;
            let why = format!(
                "{repeats} repeats, {threads} with a different number of threads, {ranks} with a different number of ranks"
            );
            Check::new(name, Some(true), why)
        }
    }
}

/// Finer settings take more time.
fn dearer(study: &Study, analysis: &Analysis<'_>) -> Check {
    let name = "Shorter steps take more time";
    let noise = analysis.noise.unwrap_or(0.0).max(SAME_TIME);
    let groups = by_step(study, analysis);
    let pairs: Vec<&[&Row<'_>]> = groups.iter().flat_map(|rows| rows.windows(2)).collect();
    let cheaper = pairs.iter().find(|pair| pair[1].seconds < pair[0].seconds * (1.0 - noise));
    match cheaper {
        _ if pairs.is_empty() => Check::new(name, None, "no two settings differ in their steps".to_owned()),
        None if pairs.len() == 1 => Check::new(name, Some(true), "in the one pair of settings".to_owned()),
        None => Check::new(name, Some(true), format!("in all {} pairs of settings", pairs.len())),
        Some(pair) => {
            let why = format!(
                "\"{}\" took less time than \"{}\": the machine was busy, or longer steps needed more retries",
                pair[1].sample.setting.label, pair[0].sample.setting.label
            );
            Check::new(name, Some(false), why)
        }
    }
}

/// Times of equal runs agree.
fn steady(study: &Study, analysis: &Analysis<'_>) -> Check {
    let name = "Times of equal runs agree";
    let Machine { load, processors, .. } = study.machine;
    match analysis.noise {
        None if load > BUSY * processors as f64 => {
            let why = format!(
                "the machine was busy: load {} on {processors} processors before the study; compare processor times instead",
                text::digits(load)
            );
            Check::new(name, Some(false), why)
        }
        None => Check::new(name, None, "no setting has run three times".to_owned()),
        Some(noise) => {
            let why = format!("spread {} %; {} % is allowed", percent(noise), percent(NOISY));
            Check::new(name, Some(noise <= NOISY), why)
        }
    }
}

fn percent(share: f64) -> String {
    text::digits(100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::analysis::{analyse, tests::convergent};
    use crate::study::verdict::Verdict;

    fn verdict(study: &Study, name: &str) -> Verdict {
        let all = checks(study, &analyse(study));
        all.into_iter().find(|check| check.name.contains(name)).unwrap().verdict
    }

    #[test]
    fn a_study_of_a_convergent_method_holds_and_each_check_fails_by_itself() {
        let study = convergent();
        for (name, expected) in [
            ("reference", Verdict::Holds),
            ("reduce the error", Verdict::Holds),
            ("later frames", Verdict::Holds),
            ("more time", Verdict::Holds),
            ("same bits", Verdict::Unknown),
            ("Times", Verdict::Unknown),
        ] {
            assert_eq!(verdict(&study, name), expected, "{name}");
        }
        let mut unconverged = convergent();
        unconverged.own_error = vec![2e-4; 10];
        assert_eq!(verdict(&unconverged, "reference"), Verdict::Fails);
        let mut rising = convergent();
        rising.samples[2].from_reference.iter_mut().for_each(|distance| distance.rms = 9e-4);
        assert_eq!(verdict(&rising, "reduce the error"), Verdict::Fails);
        let mut late = convergent();
        // Nothing but the scene as it is fits into that.
        late.budget = Some(1.5);
        late.samples[0].from_reference[8..].iter_mut().for_each(|distance| distance.rms *= 3.0);
        assert_eq!(verdict(&late, "later frames"), Verdict::Fails);
        let mut busy = convergent();
        (busy.machine.load, busy.machine.processors) = (3.0, 2);
        assert_eq!(verdict(&busy, "Times"), Verdict::Fails);
        let mut cheap = convergent();
        cheap.samples[2].cost.seconds *= 0.2;
        assert_eq!(verdict(&cheap, "more time"), Verdict::Fails);
    }

    #[test]
    fn a_repeat_or_a_number_of_threads_with_other_bits_is_noticed() {
        let mut study = convergent();
        study.samples[0].bits = "a".to_owned();
        let mut again = study.samples[0].clone();
        again.repeat = 1;
        study.samples.push(again.clone());
        assert_eq!(verdict(&study, "same bits"), Verdict::Holds);
        let mut threads = again.clone();
        (threads.role, threads.repeat) = (Role::Threads, 0);
        threads.setting.changes = vec![("threads".into(), "1".into())];
        study.samples.push(threads);
        assert_eq!(verdict(&study, "same bits"), Verdict::Holds);
        let mut other = study.clone();
        other.samples[4].bits = "b".to_owned();
        assert_eq!(verdict(&other, "same bits"), Verdict::Fails);
        study.samples[5].bits = "b".to_owned();
        assert_eq!(verdict(&study, "same bits"), Verdict::Fails);
    }
}
