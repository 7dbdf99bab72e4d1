//! A small file must not take gigabytes: the allocator of the targets counts, and ends the process where an input asks
//! for more than [`LIMIT`].

#![allow(unsafe_code)] // A global allocator cannot be written without; this is the only place.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most memory that reading one input may take [bytes]; inputs are shorter than a thousandth of it.
pub const LIMIT: usize = 128 << 20;

/// Text that identifies a refusal.
pub const REFUSAL: &str = "MB are in use";

/// Memory that is in use [bytes].
static USED: AtomicUsize = AtomicUsize::new(0);

/// More than this is refused [bytes]; everything is allowed outside of [`bounded`].
static ALLOWED: AtomicUsize = AtomicUsize::new(usize::MAX);

struct Counting;

impl Counting {
    fn take(size: usize) {
        let used = USED.fetch_add(size, Ordering::Relaxed).saturating_add(size);
        if used > ALLOWED.load(Ordering::Relaxed) {
            // The message itself needs memory.
            ALLOWED.store(usize::MAX, Ordering::Relaxed);
            // The hook of the panic ends the process before anything unwinds, and shows where the memory was asked for.
            panic!("{} {REFUSAL}, the last of them for a block of {size} bytes", used >> 20);
        }
    }
}

// SAFETY: every call goes on to the system's allocator unchanged; counting touches no memory of the caller, and a
// refusal ends the process.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        Self::take(layout.size());
        // SAFETY: the caller keeps the promises of `alloc`, which are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        Self::take(layout.size());
        // SAFETY: as in `alloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        Self::take(size.saturating_sub(layout.size()));
        USED.fetch_sub(layout.size().saturating_sub(size), Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout, and the caller checked the size.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Reads an input with its memory bounded.
pub fn bounded<T>(read: impl FnOnce() -> T) -> T {
    ALLOWED.store(USED.load(Ordering::Relaxed) + LIMIT, Ordering::Relaxed);
    let result = read();
    ALLOWED.store(usize::MAX, Ordering::Relaxed);
    result
}
