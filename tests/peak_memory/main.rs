//! Memory of changes within a shot. Alone in its binary, because the measure sees every thread.

#![allow(unsafe_code)] // A global allocator cannot be written without; this is the only place.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use drapery_core::scene::Scene;
use drapery_core::settings::SettingValue;
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_io::scene_file;

/// Counts the bytes in use, and the most that ever were.
struct Peak;

static IN_USE: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

fn taken(bytes: usize) {
    MOST.fetch_max(IN_USE.fetch_add(bytes, Ordering::Relaxed) + bytes, Ordering::Relaxed);
}

// SAFETY: every call goes on to the system's allocator unchanged; counting touches no memory of the caller.
unsafe impl GlobalAlloc for Peak {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        taken(layout.size());
        // SAFETY: the caller keeps the promises of `alloc`, which are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        IN_USE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        taken(size);
        IN_USE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout, and the caller checked the size.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Peak = Peak;

const SCENE: &str = "drapery = 1\n[shot]\nframes = \"0-9\"\n[gravity]\n[self_repulsion]\n[self_collision]\n\
                     [solver]\nintegrator = \"tr_bdf2\"\n[[garment]]\nname = \"sheet\"\nmaterial = \"silk_light\"\n\
                     panel = { resolution = 40, side = 0.4, aspect = 4.0 }\nfolds = { layers = 4, gap = 0.0015 }\n";

/// One test, so that nothing else is counted.
#[test]
fn a_number_that_changes_never_has_two_simulations_in_memory() {
    let scene = scene_file::parse(SCENE, "sheet.toml", "".as_ref(), &[]).unwrap_or_else(|e| panic!("{e}"));
    let description = scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0])).scene;
    let scene = Scene::validate(description).unwrap_or_else(|problems| panic!("{problems}"));
    let before = IN_USE.load(Ordering::Relaxed);
    let mut simulation =
        Simulation::new(scene, &FrameInput::to_frame(0)).unwrap_or_else(|problems| panic!("{problems}"));
    for frame in 1..=2 {
        simulation.advance(&FrameInput::to_frame(frame)).unwrap_or_else(|error| panic!("{error}"));
    }
    let one = IN_USE.load(Ordering::Relaxed) - before;
    MOST.store(0, Ordering::Relaxed);
    let number = ("garment.sheet.stretch.stiffness".to_owned(), SettingValue::Number(70.0));
    simulation.set(&[number]).unwrap_or_else(|problem| panic!("{problem}"));
    let most = MOST.load(Ordering::Relaxed) - before;
    println!("a simulation takes {one} bytes, a change {most}");
    // Beside it stand its saved state and another form of the scene.
    assert!(most < one + one / 4, "a simulation takes {one} bytes, a change {most}");
    simulation.advance(&FrameInput::to_frame(3)).unwrap_or_else(|error| panic!("{error}"));
}
