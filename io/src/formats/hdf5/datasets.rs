//! Datasets of HDF5 files that somebody else may have written or changed: nothing is taken from a dataset before it is
//! certain that the file holds all of it, so that memory is taken for what is there and not for what a header says.

use hdf5::{Dataset, H5Type};

/// Offset of the values of a dataset in a file of `length` bytes; `None` if there are none.
///
/// # Errors
/// They are not in one place (no file of this program has compressed or scattered datasets), or not all in the file.
pub(crate) fn place_of(dataset: &Dataset, length: u64) -> hdf5::Result<Option<u64>> {
    let size = dataset.dtype()?.size() as u64;
    let bytes = dataset.shape().iter().try_fold(size, |bytes, extent| bytes.checked_mul(*extent as u64));
    if bytes == Some(0) {
        return Ok(None);
    }
    let Some(offset) = dataset.offset() else {
        return Err(format!("dataset {} has no fixed place", dataset.name()).into());
    };
    match bytes.and_then(|bytes| offset.checked_add(bytes)) {
        Some(end) if end <= length => Ok(Some(offset)),
        _ => Err(format!("dataset {} is larger than the file", dataset.name()).into()),
    }
}

/// Most by which a compressed dataset is smaller than its values, as a factor; zlib reaches 1032.
const DENSEST: u64 = 4096;

/// Refuses a dataset that other programs have written, perhaps compressed, if its values cannot all have been stored.
///
/// # Errors
/// They have not.
pub(crate) fn check_stored(dataset: &Dataset) -> hdf5::Result<()> {
    let size = dataset.dtype()?.size() as u64;
    let bytes = dataset.shape().iter().try_fold(size, |bytes, extent| bytes.checked_mul(*extent as u64));
    match bytes {
        Some(bytes) if bytes <= dataset.storage_size().saturating_mul(DENSEST) => Ok(()),
        _ => Err(format!("dataset {} is larger than what is stored of it", dataset.name()).into()),
    }
}

/// The dataset of this name, with as many extents as it has to have. All of its values are in the file.
///
/// # Errors
/// There is none, it has other extents, or it is larger than the file.
pub(crate) fn dataset<const N: usize>(file: &hdf5::File, name: &str) -> hdf5::Result<(Dataset, [usize; N])> {
    let dataset = file.dataset(name)?;
    let shape = dataset.shape();
    let Ok(extents) = <[usize; N]>::try_from(shape.as_slice()) else {
        return Err(format!("dataset {name} has {} extents instead of {N}", shape.len()).into());
    };
    place_of(&dataset, file.size())?;
    Ok((dataset, extents))
}

/// All values of a dataset with one extent.
///
/// # Errors
/// As [`dataset`]; values of another kind.
pub(crate) fn values<T: H5Type>(file: &hdf5::File, name: &str) -> hdf5::Result<Vec<T>> {
    dataset::<1>(file, name)?.0.read_raw()
}

/// Attribute: what the positions of a cache are counted from, in its unit and axes. Only in caches with an origin of their own.
pub(super) const ORIGIN: &str = "origin";

/// Origin that the positions of a cache are counted from, in its unit and axes; `None` where that is the origin of the world.
///
/// # Errors
/// It is not three numbers.
pub(crate) fn origin(file: &hdf5::File) -> hdf5::Result<Option<[f64; 3]>> {
    if !file.attr_names()?.iter().any(|name| name == ORIGIN) {
        return Ok(None);
    }
    let attribute = file.attr(ORIGIN)?;
    if attribute.shape() != [3] {
        return Err(format!("attribute {ORIGIN} has the extents {:?} instead of 3", attribute.shape()).into());
    }
    let values = attribute.read_raw::<f64>()?;
    <[f64; 3]>::try_from(values).map(Some).map_err(|values| format!("attribute {ORIGIN} is {values:?}").into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dataset_that_the_file_does_not_hold_takes_no_memory() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("promises.h5");
        let file = hdf5::File::create(&path).unwrap();
        // Two of these would not fit into the memory of any machine; the file has some hundred bytes.
        file.new_dataset::<f32>().no_chunk().shape([1 << 50]).create("promised").unwrap();
        file.new_dataset::<f32>().chunk([2]).shape([4]).create("scattered").unwrap().write_raw(&[1.0f32; 4]).unwrap();
        file.new_dataset::<f32>().no_chunk().shape([2]).create("held").unwrap().write_raw(&[1.0f32, 2.0]).unwrap();
        file.new_dataset::<f32>().no_chunk().shape([0]).create("empty").unwrap();
        drop(file);
        let file = hdf5::File::open(&path).unwrap();
        for name in ["promised", "scattered", "missing"] {
            assert!(values::<f32>(&file, name).is_err(), "{name}");
        }
        assert_eq!(values::<f32>(&file, "held").unwrap(), [1.0, 2.0]);
        assert_eq!(values::<f32>(&file, "empty").unwrap(), [0.0; 0]);
        for (name, is_stored) in [("promised", false), ("scattered", true), ("held", true), ("empty", true)] {
            assert_eq!(check_stored(&file.dataset(name).unwrap()).is_ok(), is_stored, "{name}");
        }
        assert!(dataset::<2>(&file, "held").unwrap_err().to_string().contains("1 extents instead of 2"));
    }
}
