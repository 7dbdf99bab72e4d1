//! Scenes, from files or from memory.

use std::ffi::c_char;

use drapery_core::mesh::PolygonMesh;
use drapery_shot::scene_source::SceneSource;

use crate::DRAPERY_DONE;
use crate::arguments::{array, place, points, text};
use crate::errors::{drapery_error, guarded};
use crate::handles::{self, Object, freed};

/// A scene: where it comes from, and what is set in it. Nothing is read before it is checked, simulated or run.
pub struct drapery_scene {
    _opaque: [u8; 0],
}

/// A scene of the file at `path`.
///
/// # Safety
/// `path` is a text that ends with a zero, `scene` the address of a pointer, `error` that of one or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_open(
    path: *const c_char,
    scene: *mut *mut drapery_scene,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let scene = place(scene, "scene")?;
        // SAFETY: the caller promises it.
        let path = unsafe { text(path, "path") }?;
        let handle = handles::give(Object::Scene(std::sync::Arc::new(SceneSource::file(path).into())));
        // SAFETY: it is not null, and the caller promises the rest.
        unsafe { scene.write(handle) };
        Ok(DRAPERY_DONE)
    })
}

/// A scene of the text of a scene file, `toml`. `name` is what messages call it, and the shot where it has none; files that it
/// names are relative to `folder` ("" for the folder of the process). Meshes that are added to it, it names "memory:NAME" in the
/// place of files.
///
/// # Safety
/// The texts end with a zero, `scene` is the address of a pointer, `error` that of one or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_parse(
    toml: *const c_char,
    name: *const c_char,
    folder: *const c_char,
    scene: *mut *mut drapery_scene,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        let scene = place(scene, "scene")?;
        // SAFETY: the caller promises it.
        let (toml, name, folder) = unsafe { (text(toml, "toml")?, text(name, "name")?, text(folder, "folder")?) };
        let source = SceneSource::text(toml, name, folder);
        source.read()?;
        let handle = handles::give(Object::Scene(std::sync::Arc::new(source.into())));
        // SAFETY: it is not null, and the caller promises the rest.
        unsafe { scene.write(handle) };
        Ok(DRAPERY_DONE)
    })
}

/// Sets a value of the scene, as `--set KEY=VALUE` of the command: a parameter or a dotted key, and its value in TOML.
///
/// Errors: the scene cannot be read, or has no place for it; nothing is set then.
///
/// # Safety
/// The texts end with a zero; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_set(
    scene: *mut drapery_scene,
    key: *const c_char,
    value: *const c_char,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let setting = unsafe { (text(key, "key")?.to_owned(), text(value, "value")?.to_owned()) };
        handles::with(scene, |source: &mut SceneSource| {
            let mut changed = source.clone();
            changed.settings.push(setting);
            changed.read()?;
            *source = changed;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Adds a folder in which the materials that the scene names are looked for.
///
/// # Safety
/// `folder` ends with a zero; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_add_materials(
    scene: *mut drapery_scene,
    folder: *const c_char,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let folder = unsafe { text(folder, "folder") }?;
        handles::with(scene, |source: &mut SceneSource| {
            source.search.materials.push(folder.into());
            Ok(DRAPERY_DONE)
        })
    })
}

/// Adds a mesh, which the scene names "memory:NAME", in the place of one of the same name: `point_count` points of three numbers
/// each, in metres with Y up; `face_count` numbers of corners; and `corner_count` numbers of points, face by face,
/// counter-clockwise seen from outside. All is copied.
///
/// Errors: the numbers do not fit each other, with the face, corner or vertex.
///
/// # Safety
/// The arrays are as long as it says; `name` ends with a zero; `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_add_mesh(
    scene: *mut drapery_scene,
    name: *const c_char,
    positions: *const f64,
    point_count: usize,
    face_counts: *const u32,
    face_count: usize,
    corners: *const u32,
    corner_count: usize,
    error: *mut *mut drapery_error,
) -> i32 {
    guarded(error, || {
        // SAFETY: the caller promises it.
        let (name, mesh) = unsafe {
            let points = points(positions, point_count, "positions")?;
            let face_counts = array(face_counts, face_count, "face_counts")?.to_vec();
            let face_indices = array(corners, corner_count, "corners")?.to_vec();
            (text(name, "name")?, PolygonMesh { points, face_counts, face_indices })
        };
        handles::with(scene, |source: &mut SceneSource| {
            source.meshes.insert(name, mesh)?;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Reads the scene and all its inputs over all frames, as `drapery check` does, and keeps nothing of it.
///
/// Errors: everything that is wrong, in one message; object and element are those of the first.
///
/// # Safety
/// `error` is the address of a pointer or null.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn drapery_scene_check(scene: *const drapery_scene, error: *mut *mut drapery_error) -> i32 {
    guarded(error, || {
        handles::with(scene, |source: &mut SceneSource| {
            source.prepare(None)?;
            Ok(DRAPERY_DONE)
        })
    })
}

/// Frees a scene. Simulations of it stay valid. Returns DRAPERY_USAGE for what is no handle of a scene, was freed before, or
/// is used by a call that has not returned, and leaves it alone; null is allowed.
#[unsafe(no_mangle)]
pub extern "C" fn drapery_scene_free(scene: *mut drapery_scene) -> i32 {
    freed(scene, |object| matches!(object, Object::Scene(_)))
}
