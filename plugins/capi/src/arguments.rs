//! Arguments from C: texts, arrays, and places for results. Null where a value is needed, and an array that cannot be in memory,
//! are errors.

use std::ffi::{CStr, c_char};

use drapery_core::Vec3;
use drapery_shot::fault::{Fault, FaultKind};

/// An argument that cannot be used.
pub(crate) fn refused(name: &str, what: &str) -> Fault {
    Fault::new(FaultKind::Usage, format!("argument `{name}`: {what}"))
}

/// A text.
///
/// # Safety
/// `text` is null or the address of a text that ends with a zero.
pub(crate) unsafe fn text<'a>(text: *const c_char, name: &str) -> Result<&'a str, Fault> {
    if text.is_null() {
        return Err(refused(name, "it is null, and a text is needed"));
    }
    // SAFETY: the caller promises it.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| refused(name, "it is not UTF-8"))
}

/// An array; null stands for an empty one.
///
/// # Safety
/// `values` is null or the address of `count` values.
pub(crate) unsafe fn array<'a, T>(values: *const T, count: usize, name: &str) -> Result<&'a [T], Fault> {
    if count == 0 {
        return Ok(&[]);
    }
    if values.is_null() {
        return Err(refused(name, "it is null, and its length is not 0"));
    }
    if !values.is_aligned() || count.checked_mul(size_of::<T>()).is_none_or(|bytes| bytes > isize::MAX as usize) {
        return Err(refused(name, "no array of this length can be there"));
    }
    // SAFETY: the caller promises it.
    Ok(unsafe { std::slice::from_raw_parts(values, count) })
}

/// Points, of which each is three numbers.
///
/// # Safety
/// `values` is null or the address of `3 * count` numbers.
pub(crate) unsafe fn points(values: *const f64, count: usize, name: &str) -> Result<Vec<Vec3>, Fault> {
    let numbers = count.checked_mul(3).ok_or_else(|| refused(name, "no array of this length can be there"))?;
    // SAFETY: the caller promises it.
    let numbers = unsafe { array(values, numbers, name) }?;
    Ok(numbers.as_chunks().0.iter().map(|point: &[f64; 3]| Vec3::from(*point)).collect())
}

/// Gives a result its place; null is allowed where nobody wants it.
///
/// # Safety
/// `place` is null or the address of a value.
pub(crate) unsafe fn give<T>(place: *mut T, value: T) {
    if !place.is_null() {
        // SAFETY: the caller promises it.
        unsafe { place.write(value) }
    }
}

/// A place for a handle, which has to be there: it would be lost.
pub(crate) fn place<T>(place: *mut *mut T, name: &str) -> Result<*mut *mut T, Fault> {
    if place.is_null() { Err(refused(name, "it is null, and the handle would be lost")) } else { Ok(place) }
}
