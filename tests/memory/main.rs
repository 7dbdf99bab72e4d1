//! No rank ever holds a garment as a whole. Alone in its binary, because the measure sees every thread.

#![allow(unsafe_code)] // A global allocator cannot be written without; this is the only place.

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use drapery_core::Vec3;
use drapery_core::mesh::MeshStream;
use drapery_core::parallel::local_ranks::LocalRanks;
use drapery_core::parallel::ranks::Ranks;
use drapery_core::scene::{EffectRequest, Scene, SceneDescription};
use drapery_io::cache::{CacheFrame, CachePlan};
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::units::Units;
use drapery_io::{formats, scene_file};

/// Notes the largest block that is asked for.
struct Largest;

static LARGEST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes on to the system's allocator unchanged; noting touches no memory of the caller.
unsafe impl GlobalAlloc for Largest {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.fetch_max(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller keeps the promises of `alloc`, which are those of the system's allocator.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the block came from the system's allocator with this layout.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        LARGEST.fetch_max(size, Ordering::Relaxed);
        // SAFETY: the block came from the system's allocator with this layout, and the caller checked the size.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Largest = Largest;

/// Many, so that the share of a rank is far smaller than the whole.
const RANKS: usize = 16;

/// Cells along each side of the garment.
const CELLS: usize = 300;

fn resolved(folder: &Path, garment: &str) -> SceneDescription {
    let text = format!(
        "drapery = 1\n[shot]\nname = \"large\"\nfps = \"24\"\nframes = \"1-1\"\n[units]\nlength = \"m\"\nup = \"Y\"\n\
         [gravity]\n[[garment]]\nname = \"sheet\"\ndensity = 0.2\n{garment}\n\
         [garment.stretch]\nspring_stiffness = 200\n[garment.bending]\nspring_stiffness = 5\n"
    );
    let path = folder.join("large.toml");
    std::fs::write(&path, text).expect("a scene file");
    let scene = scene_file::load(&path, &[]).unwrap_or_else(|e| panic!("{e}"));
    scene.resolve().unwrap_or_else(|errors| panic!("{}", errors[0])).scene
}

/// The largest block that is taken while a scene with this garment is read and handed out, and the number of its points.
fn largest_block(folder: &Path, garment: &str) -> (usize, usize) {
    LARGEST.store(0, Ordering::Relaxed);
    let mut description = resolved(folder, garment);
    // So that vertices in one place are looked for.
    description.effects.push(EffectRequest::of_scene("self_repulsion"));
    let points = description.garments[0].point_count();
    let given = Mutex::new(Some(description));
    let sizes = LocalRanks::run(RANKS, 1, |communicator| {
        let ranks = Ranks::new(communicator);
        let description = given.lock().expect("no rank panics").take_if(|_| ranks.is_first());
        let scene = Scene::distribute(&ranks, description).unwrap_or_else(|problems| panic!("{problems}"));
        scene.parts().own().len()
    });
    assert_eq!(sizes.expect("no rank ends early").iter().sum::<usize>(), points);
    (LARGEST.load(Ordering::Relaxed), points)
}

/// One test, so that nothing else is counted.
#[test]
fn no_rank_holds_a_garment_as_a_whole_while_it_is_read_and_handed_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let panel = format!("panel = {{ resolution = {CELLS}, side = 1.0, aspect = 1.0 }}");
    let made = resolved(folder.path(), &panel);
    let stream = made.garments[0].stream.clone().expect("a generated garment is read in pieces");
    write_obj(&*stream, &folder.path().join("sheet.obj"));
    write_abc(&*stream, &folder.path().join("sheet.abc"));
    for garment in [&panel, "rest = \"sheet.obj\"", "rest = \"sheet.abc\""] {
        let (block, points) = largest_block(folder.path(), garment);
        assert!(points > CELLS * CELLS);
        println!("{garment}: {block} bytes, {:.1} a point", block as f64 / points as f64);
        // Positions of all points take 24 bytes a point, corners of all faces as many, positions of a file 12.
        assert!(block < 9 * points, "{garment}: a block of {block} bytes for {points} points");
    }
}

fn write_obj(mesh: &dyn MeshStream, path: &Path) {
    let mut text = String::new();
    mesh.points(&mut |points| points.iter().for_each(|p| text += &format!("v {} {} {}\n", p.x, p.y, p.z)))
        .expect("points");
    let face = |c: &[u32]| format!("f {} {} {}\n", c[0] + 1, c[1] + 1, c[2] + 1);
    mesh.faces(&mut |_, corners| corners.chunks(3).for_each(|corners| text += &face(corners))).expect("faces");
    std::fs::write(path, text).expect("an OBJ file");
}

fn write_abc(mesh: &dyn MeshStream, path: &Path) {
    let mut data = drapery_io::mesh_data::MeshData::default();
    mesh.points(&mut |points| data.mesh.points.extend_from_slice(points)).expect("points");
    mesh.faces(&mut |counts, corners| {
        data.mesh.face_counts.extend_from_slice(counts);
        data.mesh.face_indices.extend_from_slice(corners);
    })
    .expect("faces");
    let positions = Units::SI.stored_all(&data.mesh.points);
    let plan = CachePlan {
        garment: "sheet",
        mesh: &GarmentMesh::kept(data),
        units: Units::SI,
        origin: Vec3::zeros(),
        timeline: Default::default(),
        first_frame: 1,
        last_frame: 1,
        velocities: false,
        sub_frames: &[],
        normals: false,
        crossings: false,
        attributes: Default::default(),
    };
    let create = formats::by_extension("abc").and_then(|format| format.create).expect("Alembic is written");
    let mut writer = create(path, &plan).expect("a cache");
    writer
        .write(&CacheFrame {
            frame: 1,
            sub_frame: 0,
            positions: &positions,
            velocities: &[],
            normals: &[],
            crossings: None,
            values: Default::default(),
        })
        .expect("a frame");
    writer.finish().expect("a file");
}
