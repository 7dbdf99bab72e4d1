//! Memory of the program. Large blocks go back to the system when they are freed. Running out of memory has an exit code of its own,
//! instead of the signal by which an allocation that fails ends a program.
//!
//! An allocation that the system refuses is detected here. Memory that the system has promised and cannot supply ends the process
//! by a signal that nobody can catch (137 in a shell). `drapery plan` reports beforehand how much memory a shot needs.

#![allow(unsafe_code)] // A global allocator, and options of the system's, need it; this is the only place of the command.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGABRT;

use crate::exit_code::ExitCode;
use crate::failure::Failure;

/// Blocks of this size and more go back to the system when they are freed [bytes]. By itself glibc raises its limit up to 32 MiB, and
/// lists of pairs, made in pieces of a few megabytes, leave holes that nothing else fills (`docs/dev/decisions/0073-memory.md`).
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const RETURNED: i32 = 1 << 20;

/// Whether the system has refused memory.
static REFUSED: AtomicBool = AtomicBool::new(false);

/// The system's allocator, which takes note of what it refuses.
struct Noting;

#[global_allocator]
static ALLOCATOR: Noting = Noting;

fn noted(pointer: *mut u8) -> *mut u8 {
    if pointer.is_null() {
        REFUSED.store(true, Ordering::SeqCst);
    }
    pointer
}

// SAFETY: every call goes on to the system's allocator unchanged; what it answers is returned and never followed.
unsafe impl GlobalAlloc for Noting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the promises of `alloc`, which are those of the system's allocator.
        noted(unsafe { System.alloc(layout) })
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as for `alloc`.
        noted(unsafe { System.alloc_zeroed(layout) })
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the block came from the system's allocator with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: the block came from the system's allocator with this layout, and the caller checked the size.
        noted(unsafe { System.realloc(pointer, layout, size) })
    }
}

/// From now on large blocks go back to the system when they are freed.
pub(crate) fn return_large_blocks() {
    // SAFETY: glibc locks its options while it changes one. Where it refuses the value, the program takes more memory and does the same.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, RETURNED);
    }
}

/// From now on a program that aborts after memory was refused ends with its exit code. The standard library has then said how
/// much was asked for.
pub(crate) fn watch() -> Result<(), Failure> {
    let failure = |error| Failure::refused("aborts cannot be watched", &error);
    signal_hook::flag::register_conditional_shutdown(SIGABRT, ExitCode::NoMemory as i32, &REFUSED).map_err(failure)?;
    Ok(())
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
mod tests {
    use super::*;

    #[test]
    fn large_blocks_between_small_ones_go_back_to_the_system() {
        const LARGE: usize = 3 << 19;
        const COUNT: usize = 200;
        return_large_blocks();
        // glibc would raise its limit above the size of a block that is freed.
        drop(std::hint::black_box(vec![1u8; 2 * LARGE]));
        let before = drapery_io::memory::resident_bytes().unwrap();
        let (large, small): (Vec<_>, Vec<_>) = (0..COUNT).map(|_| (vec![1u8; LARGE], vec![1u8; 64])).unzip();
        let filled = drapery_io::memory::resident_bytes().unwrap();
        assert!(filled > before + (COUNT * LARGE / 2) as u64, "{before} {filled}");
        drop(std::hint::black_box(large));
        let after = drapery_io::memory::resident_bytes().unwrap();
        drop(std::hint::black_box(small));
        assert!(after < before + (COUNT * LARGE / 4) as u64, "{before} {filled} {after}");
    }
}
