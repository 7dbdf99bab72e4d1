//! Errors: what went wrong, in parts.

use std::any::Any;
use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr;

use drapery_shot::fault::{Fault, FaultKind};

use crate::handles::{self, Object};
use crate::objects::{ErrorParts, c_text};

/// Error of a call. Functions that can fail take the address of such a pointer as their last argument; it is set to null where
/// nothing went wrong. Null in its place is allowed: the code that is returned then says all.
pub struct drapery_error {
    _opaque: [u8; 0],
}

/// Does the work of a function. What goes wrong, panics included, is handed to `error`; returns the code.
pub(crate) fn guarded(error: *mut *mut drapery_error, work: impl FnOnce() -> Result<i32, Fault>) -> i32 {
    put(error, ptr::null_mut());
    let fault = match catch_unwind(AssertUnwindSafe(work)) {
        Ok(Ok(code)) => return code,
        Ok(Err(fault)) => fault,
        Err(panic) => Fault::new(
            FaultKind::Internal,
            format!("this is a bug in Drapery; please report it with this text: {}", words(&*panic)),
        ),
    };
    let code = fault.kind as i32;
    if !error.is_null() {
        let (message, object) = (c_text(&fault.message), fault.object.as_deref().map(c_text));
        put(error, handles::give(Object::Error(ErrorParts { fault, message, object }.into())));
    }
    code
}

fn put(error: *mut *mut drapery_error, value: *mut drapery_error) {
    if !error.is_null() {
        // SAFETY: the caller gives null or the address of a pointer, as the header says of every function with an error.
        unsafe { error.write(value) }
    }
}

/// Returns the message of a panic.
fn words(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no words")
}

/// One of the codes above; DRAPERY_DONE for null.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_error_code(error: *const drapery_error) -> i32 {
    handles::error(error).map_or(crate::DRAPERY_DONE, |parts| parts.fault.kind as i32)
}

/// All of it in words, in UTF-8: what, where, and what to do. Lives as long as the error; null for null.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_error_message(error: *const drapery_error) -> *const c_char {
    handles::error(error).map_or(ptr::null(), |parts| parts.message.as_ptr())
}

/// Name of the garment or body, or path of the file, that is meant; null if there is none. Lives as long as the error.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_error_object(error: *const drapery_error) -> *const c_char {
    handles::error(error).and_then(|parts| Some(parts.object.as_ref()?.as_ptr())).unwrap_or(ptr::null())
}

/// Whether a frame is meant; `frame` then gets its number.
///
/// # Safety
/// `frame` is null or the address of a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_error_frame(error: *const drapery_error, frame: *mut i64) -> bool {
    let found = handles::error(error).and_then(|parts| parts.fault.frame);
    // SAFETY: the caller promises it.
    unsafe { give_number(found, frame) }
}

/// Whether a vertex, face, edge or corner is meant, or a line of the scene; `element` then gets its number: lines are counted
/// from 1, all else from 0.
///
/// # Safety
/// `element` is null or the address of a number.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_error_element(error: *const drapery_error, element: *mut u64) -> bool {
    let found = handles::error(error).and_then(|parts| parts.fault.element);
    // SAFETY: the caller promises it.
    unsafe { give_number(found, element) }
}

/// # Safety
/// `place` is null or the address of a number.
unsafe fn give_number<T>(found: Option<T>, place: *mut T) -> bool {
    let is_there = found.is_some();
    if let Some(number) = found.filter(|_| !place.is_null()) {
        // SAFETY: the caller promises it.
        unsafe { place.write(number) }
    }
    is_there
}

/// Frees an error. Null, and what was freed before, are left alone.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_error_free(error: *mut drapery_error) {
    handles::free(error, |object| matches!(object, Object::Error(_)));
}
