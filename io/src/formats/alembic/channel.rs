//! Channels of an archive: user properties and other properties of objects that hold numbers.

use std::path::Path;

use drapery_alembic::{AlembicError, Archive, Compound, PodType, PropertyKind, Samples};

use super::write::METRES_PER_UNIT;
use crate::error::IoError;
use crate::file_summary::ChannelSummary;
use crate::formats::ChannelSamples;

/// Compounds of a property whose values are indexed keep them under these names. Those of a transform have values alone.
const VALUES: &str = ".vals";
const INDICES: &str = ".indices";

/// The compound of the properties that artists add.
const USER: &str = ".userProperties";

/// A property with samples.
struct Found<'a> {
    name: &'a str,
    samples: &'a Samples,
    /// Whether an artist has added it.
    is_user: bool,
}

/// Samples of a property of an object, wherever among its properties it is, at their times [s].
///
/// # Errors
/// The archive is missing or damaged, or has no such property; it holds no numbers.
pub(super) fn read(path: &Path, object: &str, property: &str) -> Result<ChannelSamples, IoError> {
    let archive = Archive::open(path)?;
    let properties = archive.object(object)?.properties()?;
    let place = format!("{object}.{property}");
    let Some(samples) = find(&properties, property) else {
        let mut found = Vec::new();
        collect(&properties, false, &mut found);
        let numbers = found.into_iter().filter(|property| is_number(property.samples));
        let names: Vec<&str> = numbers.map(|property| property.name).collect();
        let advice = match names.is_empty() {
            true => "the object has no properties of numbers; export them as user properties".to_owned(),
            false => format!("its properties of numbers are {}", names.join(", ")),
        };
        return Err(IoError::data(path, place, "there is no such property", advice));
    };
    if samples.is_empty() {
        return Err(IoError::data(path, place, "it has no samples", "export it again"));
    }
    let sample = |index: usize| {
        let numbers = numbers(samples, index)?;
        let advice = "name a property of one number, or of three";
        let numbers = numbers.ok_or_else(|| IoError::data(path, &place, "it does not hold numbers", advice))?;
        Ok((samples.time_sampling().time(index), numbers))
    };
    let values = (0..sample_count(samples)).map(sample).collect::<Result<_, IoError>>()?;
    Ok(ChannelSamples { up: None, stated_rate: archive.frames_per_second_hint(), values })
}

/// Channels of an archive: the properties of its objects that hold one number or three, and change or were added by an artist.
///
/// # Errors
/// The archive is damaged.
pub(super) fn all(archive: &Archive) -> Result<Vec<ChannelSummary>, AlembicError> {
    let mut channels = Vec::new();
    for object in archive.objects() {
        let (properties, mut found) = (object.properties()?, Vec::new());
        collect(&properties, false, &mut found);
        for Found { name, samples, is_user } in found {
            let count = sample_count(samples);
            let is_listed = count > 1 || (count == 1 && is_user && name != METRES_PER_UNIT);
            if is_listed && is_number(samples) {
                let numbers = samples.element_count(0)? * usize::from(samples.data_type().extent);
                channels.extend(ChannelSummary::of(object.path(), name, numbers, count));
            }
        }
    }
    Ok(channels)
}

/// Number of samples; one for a value that never changes.
fn sample_count(samples: &Samples) -> usize {
    if samples.is_constant() { samples.len().min(1) } else { samples.len() }
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

/// Properties with samples, by the names that [`find`] takes: user properties and attributes, without those with a dot in front,
/// which Alembic itself puts.
fn collect<'a>(compound: &'a Compound, is_user: bool, found: &mut Vec<Found<'a>>) {
    for property in compound.iter() {
        match property.kind() {
            PropertyKind::Compound(inside) => {
                match inside.samples(VALUES).filter(|_| inside.samples(INDICES).is_some()) {
                    Some(samples) => found.push(Found { name: property.name(), samples, is_user }),
                    None => collect(inside, is_user || property.name() == USER, found),
                }
            }
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples) if !property.name().starts_with('.') => {
                found.push(Found { name: property.name(), samples, is_user });
            }
            PropertyKind::Scalar(_) | PropertyKind::Array(_) => {}
        }
    }
}

/// Whether a property holds numbers that [`numbers`] reads.
fn is_number(samples: &Samples) -> bool {
    use PodType::{F32, F64, I16, I32, U8, U32};
    matches!(samples.data_type().pod, F64 | F32 | I32 | U32 | I16 | U8)
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
