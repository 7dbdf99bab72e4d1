//! A step allocates nothing after warm-up, and a check no more than there is to check. Alone in its binary, because the counter sees
//! every thread.

#![allow(unsafe_code)] // A global allocator cannot be written without; this is the only place.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use drapery_core::Vec3;
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, RigidMotion, Scene, SceneDescription,
};
use drapery_core::simulation::{FrameInput, Simulation};
use drapery_shot::scene_source::SceneSource;
use drapery_tests::*;

/// Counts allocations of the whole process.
struct Counting;

static ALLOCATIONS: AtomicU64 = AtomicU64::new(0);

/// One test counts at a time.
static COUNTING: Mutex<()> = Mutex::new(());

// SAFETY: every call goes on to the system's allocator unchanged; counting touches no memory of the caller.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the promises of `alloc`, which are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the block came from the system's allocator with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout, and the caller checked the size.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// A sheet of several parts, hung from two corners, in short steps.
fn cloth(max_dt: f64) -> SceneDescription {
    let mut mesh = sheet(70, 70, 1.0 / 70.0);
    mesh.points.iter_mut().for_each(|p| p.y += 0.21);
    let mut description = scene_of(GarmentDescription::new("sheet", mesh, 0.2), 24);
    description.solver.max_dt = Some(max_dt);
    add_gravity(&mut description, [0.0, -9.81, 0.0]);
    description.effects.push(EffectRequest::of_garment("stretch", 0).with("stiffness", 200.0));
    description.effects.push(EffectRequest::of_garment("bending", 0).with("stiffness", 5.0));
    add_pins(&mut description, vec![0, 70]);
    description
}

/// The same on a ball and a deforming surface.
fn draped(max_dt: f64) -> SceneDescription {
    let mut description = cloth(max_dt);
    let (triangles, points) = swelling_ball(0.0);
    let shape = BodyShape::Surface { triangles, point_count: points.len() };
    let body = BodyDescription::new("swelling", shape, RigidMotion::at(Vec3::zeros()));
    description.bodies.push(BodyDescription { friction: 0.4, thickness: 1e-3, ..body });
    let ball = BodyShape::Rigid(Shape::Sphere { radius: 0.2 });
    description.bodies.push(BodyDescription::new("ball", ball, RigidMotion::at(Vec3::new(0.3, -0.01, 0.0))));
    description.effects.push(EffectRequest::of_scene("body_collision"));
    description
}

/// Input of a frame; the second body is analytic and takes no samples.
fn input(frame: i64, bodies: bool) -> FrameInput {
    if !bodies {
        return FrameInput::to_frame(frame);
    }
    let mut input = ball_input(frame);
    input.bodies.push(Vec::new());
    input
}

/// Steps and allocations of the fourth frame.
fn fourth_frame(description: SceneDescription) -> (u64, u64) {
    let bodies = !description.bodies.is_empty();
    let scene = Scene::validate(description).unwrap_or_else(|p| panic!("{p}"));
    let mut simulation = Simulation::new(scene, &input(0, bodies)).unwrap_or_else(|p| panic!("{p}"));
    for frame in 1..=3 {
        simulation.advance(&input(frame, bodies)).unwrap_or_else(|e| panic!("{e}"));
    }
    let input = input(4, bodies);
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    let summary = simulation.advance(&input).unwrap_or_else(|e| panic!("{e}"));
    let after = ALLOCATIONS.load(Ordering::Relaxed);
    assert_eq!(bodies, summary.metrics.counted("body_contacts") > 0, "cloth touches bodies where there are some");
    (summary.steps, after - before)
}

/// One test, so that no other thread of the test harness allocates at the same time.
#[test]
fn the_allocations_of_a_frame_do_not_depend_on_its_number_of_steps() {
    let _alone = COUNTING.lock().expect("no test has panicked");
    for make in [cloth as fn(f64) -> SceneDescription, draped] {
        for threads in [1, 2] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool of threads");
            let [(few, once), (many, more)] = [4e-4, 8e-5].map(|max_dt| pool.install(|| fourth_frame(make(max_dt))));
            println!("{threads} threads: {once} allocations in {few} steps, {more} in {many}");
            assert!(many > 4 * few, "{few} and {many} steps");
            // A frame allocates its summary and takes its samples; a step nothing.
            assert_eq!(more, once, "{threads} threads: {} allocations in {} more steps", more - once, many - few);
        }
    }
}

/// Allocations of a check of small garments with everything that a check looks at.
fn of_check(garments: usize) -> u64 {
    let mut text =
        String::from("drapery = 1\n[shot]\nframes = \"1-2\"\n[gravity]\n[self_repulsion]\n[self_collision]\n");
    for number in 0..garments {
        text += &format!(
            "[[garment]]\nname = \"g{number}\"\ndensity = 0.1\npanel = {{ resolution = 2, center = [{}, 0, 0] }}\n\
             [garment.stretch]\nstiffness = 40\n",
            4 * number
        );
    }
    let before = ALLOCATIONS.load(Ordering::Relaxed);
    SceneSource::text(text, "many.toml", "").prepare(None).expect("a scene without problems");
    ALLOCATIONS.load(Ordering::Relaxed) - before
}

#[test]
fn a_check_does_work_in_proportion_to_the_garments() {
    let _alone = COUNTING.lock().expect("no test has panicked");
    let [few, many] = [100, 800].map(of_check);
    // Eight times as many, and as much again for lists that grow and trees that get deeper.
    assert!(many < 16 * few, "{few} allocations for 100 garments, {many} for 800");
}
