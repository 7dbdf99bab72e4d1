//! Faces that cross at the start if they are cut along the other diagonal.

use crate::written_faces::OtherCut;

use super::Finding;

pub(super) fn find(cuts: &[OtherCut]) -> Vec<Finding> {
    let finding = |cut: &OtherCut| Finding {
        object: String::new(),
        message: format!("{}, at the start", cut.in_words()),
        line: cut.line().to_owned(),
    };
    cuts.iter().map(finding).collect()
}
