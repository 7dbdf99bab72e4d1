//! Channels of an archive: user properties and other properties of objects that hold numbers.

use std::path::Path;

use drapery_alembic::{AlembicError, Archive, Compound, PodType, PropertyKind, Samples};

use crate::error::IoError;
use crate::formats::ChannelSamples;

/// Compounds of a property whose values are indexed keep them under this name.
const VALUES: &str = ".vals";

/// Samples of a property of an object, wherever among its properties it is, at their times [s].
///
/// # Errors
/// The archive is missing or damaged, or has no such property; it holds no numbers.
pub(super) fn read(path: &Path, object: &str, property: &str) -> Result<ChannelSamples, IoError> {
    let archive = Archive::open(path)?;
    let properties = archive.object(object)?.properties()?;
    let place = format!("{object}.{property}");
    let Some(samples) = find(&properties, property) else {
        let mut names = Vec::new();
        collect(&properties, &mut names);
        let advice = match names.is_empty() {
            true => "the object has no properties of numbers; export them as user properties".to_owned(),
            false => format!("its properties of numbers are {}", names.join(", ")),
        };
        return Err(IoError::data(path, place, "there is no such property", advice));
    };
    if samples.is_empty() {
        return Err(IoError::data(path, place, "it has no samples", "export it again"));
    }
    let count = if samples.is_constant() { 1 } else { samples.len() };
    let sample = |index: usize| {
        let numbers = numbers(samples, index)?;
        let advice = "name a property of one number, or of three";
        let numbers = numbers.ok_or_else(|| IoError::data(path, &place, "it does not hold numbers", advice))?;
        Ok((samples.time_sampling().time(index), numbers))
    };
    (0..count).map(sample).collect()
}

/// The first property of this name that has samples, in the object's own compound or in one inside.
fn find<'a>(compound: &'a Compound, name: &str) -> Option<&'a Samples> {
    let own = compound.samples(name).or_else(|| compound.compound(name)?.samples(VALUES));
    own.or_else(|| {
        compound.iter().find_map(|property| match property.kind() {
            PropertyKind::Compound(inside) => find(inside, name),
            PropertyKind::Scalar(_) | PropertyKind::Array(_) => None,
        })
    })
}

/// Names of user properties and attributes: those without a dot in front, which Alembic itself puts.
fn collect(compound: &Compound, names: &mut Vec<String>) {
    for property in compound.iter() {
        match property.kind() {
            PropertyKind::Compound(inside) => collect(inside, names),
            PropertyKind::Scalar(_) | PropertyKind::Array(_) if !property.name().starts_with('.') => {
                names.push(property.name().to_owned());
            }
            PropertyKind::Scalar(_) | PropertyKind::Array(_) => {}
        }
    }
}

/// Numbers of a sample; `None` where it holds something else.
fn numbers(samples: &Samples, index: usize) -> Result<Option<Vec<f64>>, AlembicError> {
    let plain = |values: Vec<f64>| Ok(Some(values));
    match samples.data_type().pod {
        PodType::F64 => plain(samples.values::<f64>(index)?),
        PodType::F32 => plain(samples.values::<f32>(index)?.into_iter().map(f64::from).collect()),
        PodType::I32 => plain(samples.values::<i32>(index)?.into_iter().map(f64::from).collect()),
        PodType::U32 => plain(samples.values::<u32>(index)?.into_iter().map(f64::from).collect()),
        PodType::I16 => plain(samples.values::<i16>(index)?.into_iter().map(f64::from).collect()),
        PodType::U8 => plain(samples.values::<u8>(index)?.into_iter().map(f64::from).collect()),
        _ => Ok(None),
    }
}
