//! Archives of other programs read as the official library reads them.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use drapery_alembic::*;
use serde_json::Value;

fn shared_data() -> Option<PathBuf> {
    let folder = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data"));
    if !folder.is_dir() {
        println!("skipped: no shared data");
        return None;
    }
    Some(folder)
}

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[track_caller]
fn assert_close(ours: impl IntoIterator<Item = f64>, expected: &Value, what: &str) {
    let (ours, expected): (Vec<f64>, Vec<f64>) = (ours.into_iter().collect(), numbers(expected));
    assert_eq!(ours.len(), expected.len(), "{what}");
    for (a, b) in ours.iter().zip(&expected) {
        // f32 of a scene of this size, or the nine decimals of the expected file.
        assert!((a - b).abs() <= 1e-6 * b.abs().max(1.0), "{what}: {ours:?} instead of {expected:?}");
    }
}

/// Least and greatest coordinates.
fn extremes(points: &[[f64; 3]]) -> ([f64; 3], [f64; 3]) {
    let fold = |start: f64, pick: fn(f64, f64) -> f64| -> [f64; 3] {
        std::array::from_fn(|axis| points.iter().map(|p| p[axis]).fold(start, pick))
    };
    (fold(f64::INFINITY, f64::min), fold(f64::NEG_INFINITY, f64::max))
}

/// The expected file ignores transforms of instance roots (its script asked the header of the instance, which has no
/// schema). The official library gives `/rootNode/instance0/f/g` the transform of its source: translate x by -2.
fn instance_shift(path: &str) -> f64 {
    if path.contains("/f/g/") { -2.0 } else { 0.0 }
}

fn check_mesh(mesh: &PolyMesh, expected: &Value, what: &str) {
    assert_eq!(mesh.sample_count() as u64, expected["num_samples"].as_u64().unwrap(), "{what}");
    let variance = match mesh.topology_variance() {
        TopologyVariance::Constant => "kConstantTopology",
        TopologyVariance::Homogeneous => "kHomogenousTopology",
        TopologyVariance::Heterogeneous => "kHeterogenousTopology",
    };
    assert_eq!(variance, expected["topology_variance"], "{what}");
    let times = expected["times"].as_array().unwrap();
    if times.iter().all(Value::is_number) {
        assert_close(mesh.times(), &expected["times"], what);
    } else {
        let last = times.last().unwrap().as_f64().unwrap();
        assert!((mesh.time(mesh.sample_count() - 1) - last).abs() < 1e-6, "{what}");
        assert_close(mesh.times().into_iter().take(4), &Value::from(times[..4].to_vec()), what);
    }
    for sample in expected["samples"].as_array().unwrap() {
        check_sample(mesh, sample, what);
    }
    match expected["uv"].as_object() {
        None => assert!(mesh.uv().is_none(), "{what}"),
        Some(expected) => {
            let uv = mesh.uv().unwrap();
            assert_eq!(uv.is_indexed(), expected["indexed"].as_bool().unwrap(), "{what}");
            assert_eq!(uv.scope(), Scope::FaceVarying, "{what}");
            assert_eq!(uv.sample_count() as u64, expected["num"].as_u64().unwrap(), "{what}");
            let corners = mesh.face_indices(0).unwrap().len();
            assert_eq!(uv.expanded::<f32, 2>(0).unwrap().len(), corners, "{what}");
        }
    }
}

fn check_sample(mesh: &PolyMesh, expected: &Value, what: &str) {
    let index = expected["index"].as_u64().unwrap() as usize;
    let what = format!("{what} sample {index}");
    let (positions, faces) = (mesh.positions(index).unwrap(), mesh.faces(index).unwrap());
    assert_eq!(positions.len() as u64, expected["num_points"].as_u64().unwrap(), "{what}");
    assert_eq!(faces.face_counts.len() as u64, expected["num_faces"].as_u64().unwrap(), "{what}");
    assert_eq!(faces.face_indices.len() as u64, expected["num_face_indices"].as_u64().unwrap(), "{what}");
    let first = |values: &[u32], key: &str| {
        let count = expected[key].as_array().unwrap().len();
        assert_close(values[..count].iter().map(|&v| f64::from(v)), &expected[key], &what);
    };
    first(&faces.face_counts, "first_face_counts");
    first(&faces.face_indices, "first_face_indices");
    if positions.is_empty() {
        return;
    }
    let local: Vec<[f64; 3]> = positions.iter().map(|p| p.map(f64::from)).collect();
    assert_close(local[0], &expected["first_point"], &what);
    assert_close(local[local.len() - 1], &expected["last_point"], &what);
    let (min, max) = extremes(&local);
    assert_close(min, &expected["min"], &what);
    assert_close(max, &expected["max"], &what);
    let mut world = mesh.world_positions(index).unwrap();
    world.iter_mut().for_each(|p| p[0] -= instance_shift(mesh.object().path()));
    let (min, max) = extremes(&world);
    assert_close(world[0], &expected["first_world"], &what);
    assert_close(min, &expected["world_min"], &what);
    assert_close(max, &expected["world_max"], &what);
}

fn check_xform(object: &Object, expected: &Value, what: &str) {
    let xform = Xform::of(object).unwrap();
    assert_eq!(xform.sample_count() as u64, expected["num_samples"].as_u64().unwrap(), "{what}");
    let time = xform.time(0);
    assert_eq!(xform.inherits_at(time).unwrap(), expected["inherits"].as_bool().unwrap_or(true), "{what}");
    if let Some(rows) = expected["matrix0"].as_array() {
        let flat: Vec<Value> = rows.iter().flat_map(|row| row.as_array().unwrap().clone()).collect();
        assert_close(xform.matrix_at(time).unwrap(), &Value::from(flat), what);
    }
}

#[test]
fn every_foreign_archive_reads_as_in_the_official_library() {
    let Some(folder) = shared_data() else { return };
    let folder = folder.join("foreign_caches");
    let expected = json(folder.join("expected.json"));
    let (mut files, mut meshes) = (0, 0);
    for archive_expected in expected["abc"].as_array().unwrap() {
        let file = archive_expected["file"].as_str().unwrap();
        let opened = Archive::open(folder.join("abc").join(file));
        files += 1;
        if archive_expected["container"] == "HDF5" {
            assert!(matches!(opened, Err(AlembicError::Hdf5Container { .. })), "{file}");
            continue;
        }
        let archive = opened.unwrap();
        assert_eq!(archive.application(), archive_expected["application"], "{file}");
        let samplings = (0..).take_while(|&index| archive.max_samples(index).is_some()).count() as u64;
        assert_eq!(samplings, archive_expected["time_samplings"].as_u64().unwrap(), "{file}");
        let objects: Vec<Object> = archive.objects().collect();
        let expected_objects = archive_expected["objects"].as_array().unwrap();
        assert_eq!(objects.len(), expected_objects.len(), "{file}");
        for (object, expected) in objects.iter().zip(expected_objects) {
            assert_eq!(object.path(), expected["path"], "{file}");
            let what = format!("{file} {}", object.path());
            if object.instance_of().is_none() {
                assert_eq!(object.schema_name(), expected["schema"], "{what}");
            }
            match object.schema() {
                Schema::PolyMesh | Schema::SubD if expected["samples"].is_array() => {
                    check_mesh(&PolyMesh::of(object).unwrap(), expected, &what);
                    meshes += 1;
                }
                Schema::Xform if object.instance_of().is_none() => check_xform(object, expected, &what),
                _ => {}
            }
        }
    }
    assert!(files >= 20 && meshes >= 20, "only {files} files and {meshes} meshes were checked");
}

#[test]
fn an_instance_has_the_content_and_the_transform_of_its_source() {
    let Some(folder) = shared_data() else { return };
    let archive = Archive::open(folder.join("foreign_caches/abc/openusd_nestedInstancing.abc")).unwrap();
    let instance = archive.object("/rootNode/instance0/f/g").unwrap();
    assert_eq!(instance.instance_of(), Some("/rootNode/instance0/a"));
    assert_eq!(instance.schema(), Schema::Xform);
    // Official library: translation (-2, 0, 0) of the source, under (0, 5, 0) of the parent.
    assert_eq!(world_matrix_at(&instance, 0.0).unwrap()[12..15], [-2.0, 5.0, 0.0]);
}

#[test]
fn face_sets_of_a_maya_export_cover_every_face_once() {
    let Some(folder) = shared_data() else { return };
    let archive = Archive::open(folder.join("foreign_caches/abc/cortex_sphereWithShadingGroups.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/pSphere1/pSphereShape1").unwrap();
    let sets = mesh.face_sets().unwrap();
    assert_eq!(sets.iter().map(|set| set.name.as_str()).collect::<Vec<_>>(), ["blinn2SG", "blinn1SG"]);
    let mut faces: Vec<i32> = sets.iter().flat_map(|set| set.faces.clone()).collect();
    faces.sort_unstable();
    let all: Vec<i32> = (0..mesh.face_counts(0).unwrap().len() as i32).collect();
    assert_eq!(faces, all);
}

#[test]
fn colour_sets_of_a_maya_export_are_listed_as_attributes() {
    let Some(folder) = shared_data() else { return };
    let archive = Archive::open(folder.join("foreign_caches/abc/openusd_hasColorSet.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/hasColorSet/hasColorSetShape").unwrap();
    let attributes = mesh.attributes();
    assert!(!attributes.is_empty());
    for attribute in attributes.iter().filter(|attribute| attribute.data_type().pod == PodType::F32) {
        assert!(!attribute.values(0).unwrap().is_empty(), "{}", attribute.name());
    }
}

#[test]
fn velocities_of_a_foreign_archive_are_read() {
    let Some(folder) = shared_data() else { return };
    let archive = Archive::open(folder.join("foreign_caches/abc/cortex_velocityCube.abc")).unwrap();
    let mesh = PolyMesh::all(&archive).unwrap().remove(0);
    assert_eq!(mesh.velocities(0).unwrap().map(|v| v.len()), Some(mesh.positions(0).unwrap().len()));
}

#[test]
fn the_walking_body_has_its_expected_world_positions() {
    let Some(folder) = shared_data() else { return };
    let folder = folder.join("woman_walk_dance");
    let expected = json(folder.join("body_expected.json"));
    let archive = Archive::open(folder.join("body.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/woman/woman").unwrap();
    assert_eq!(mesh.sample_count() as u64, expected["frames"].as_u64().unwrap());
    assert_eq!(mesh.topology_variance(), TopologyVariance::Homogeneous);
    for sample in expected["samples"].as_array().unwrap() {
        let frame = sample["frame"].as_u64().unwrap() as usize;
        let what = format!("frame {frame}");
        assert!((mesh.time(frame) - sample["time_s"].as_f64().unwrap()).abs() < 1e-6);
        let world = mesh.world_positions(frame).unwrap();
        assert_eq!(world.len() as u64, expected["vertices"].as_u64().unwrap());
        assert_close(world[0], &sample["vertex_0"], &what);
        assert_close(world[world.len() - 1], &sample["vertex_last"], &what);
        let (min, max) = extremes(&world);
        assert_close(min, &sample["min"], &what);
        assert_close(max, &sample["max"], &what);
        let centroid: [f64; 3] =
            std::array::from_fn(|axis| world.iter().map(|p| p[axis]).sum::<f64>() / world.len() as f64);
        assert_close(centroid, &sample["centroid"], &what);
    }
}

#[test]
fn a_turning_transform_moves_the_sphere_as_described() {
    let Some(folder) = shared_data() else { return };
    let archive = Archive::open(folder.join("drape/sphere_spin.abc")).unwrap();
    let mesh = PolyMesh::all(&archive).unwrap().remove(0);
    let at_rest: Vec<[f64; 3]> = mesh.positions(0).unwrap().iter().map(|p| p.map(f64::from)).collect();
    for (frame, moved) in
        [(24, (|[x, y, z]| [x, y, z]) as fn([f64; 3]) -> [f64; 3]), (36, |[x, y, z]| [z, y, -x]), (72, |p| p)]
    {
        let matrix = mesh.world_matrix_at(f64::from(frame) / 24.0).unwrap();
        for p in &at_rest {
            let (ours, right) = (transform_point(*p, &matrix), moved(*p));
            let off = (0..3).map(|axis| (ours[axis] - right[axis]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6, "frame {frame}: {ours:?} instead of {right:?}");
        }
    }
}

/// Reads everything there is, so that every check is reached.
fn read_all(archive: &Archive) -> Result<usize, AlembicError> {
    let mut objects = 0;
    for object in archive.objects() {
        objects += 1;
        object.visibility_at(0.0)?;
        match object.schema() {
            Schema::Xform => {
                Xform::of(&object)?.matrix_at(0.5)?;
            }
            Schema::PolyMesh | Schema::SubD => read_mesh(&PolyMesh::of(&object)?)?,
            _ => read_compound(&object.properties()?)?,
        }
    }
    Ok(objects)
}

fn read_mesh(mesh: &PolyMesh) -> Result<(), AlembicError> {
    read_compound(mesh.geom())?;
    for index in 0..mesh.sample_count().min(3) {
        mesh.world_positions(index)?;
        mesh.faces(index)?;
        mesh.velocities(index)?;
        mesh.bounds(index)?;
    }
    mesh.face_sets()?;
    for param in mesh.attributes().into_iter().chain(mesh.uv()).chain(mesh.normals()) {
        if param.sample_count() > 0 {
            param.values(0)?;
            param.indices(0)?;
        }
    }
    Ok(())
}

fn read_compound(compound: &Compound) -> Result<(), AlembicError> {
    for property in compound.iter() {
        match property.kind() {
            PropertyKind::Compound(inside) => read_compound(inside)?,
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples) => {
                for index in 0..samples.len().min(3) {
                    samples.raw(index)?;
                }
            }
        }
    }
    Ok(())
}

#[test]
fn malformed_archives_give_an_error_or_what_is_left_in_bounded_time() {
    let Some(folder) = shared_data() else { return };
    let folder = folder.join("foreign_caches/malformed_abc");
    let behaviour = json(folder.join("reference_behaviour.json"));
    let behaviour = behaviour.as_object().unwrap();
    assert_eq!(behaviour.len(), 28);
    for (file, reference) in behaviour {
        let started = Instant::now();
        let result = Archive::open(folder.join(file)).and_then(|archive| read_all(&archive));
        println!("{file}: {reference}\n    ours: {result:?}");
        assert!(started.elapsed() < Duration::from_secs(5), "{file}");
        if let Some(opens) = reference.as_str().unwrap().strip_prefix("opens, ") {
            let objects: usize = opens.trim_end_matches(" objects").parse().unwrap();
            if let Ok(ours) = result {
                assert!(ours <= objects, "{file}: {ours} objects, the official library sees {objects}");
            }
        } else {
            assert!(result.is_err() || result.is_ok_and(|objects| objects == 0), "{file}");
        }
    }
}

/// Declares all properties of `from` in `into` as static ones and writes their first samples.
fn copy_properties(archive: &mut ArchiveWriter, into: CompoundId, from: &Compound) {
    for property in from.iter() {
        let (name, metadata) = (property.name(), property.metadata());
        let (copy, samples) = match property.kind() {
            PropertyKind::Compound(inside) => {
                let compound = archive.add_compound(into, name, metadata).unwrap();
                copy_properties(archive, compound, inside);
                continue;
            }
            PropertyKind::Scalar(samples) => {
                (archive.add_scalar_property(into, name, metadata, samples.data_type(), 0).unwrap(), samples)
            }
            PropertyKind::Array(samples) => {
                (archive.add_array_property(into, name, metadata, samples.data_type(), 0).unwrap(), samples)
            }
        };
        if !samples.is_empty() {
            archive.write_static_raw(copy, &samples.raw(0).unwrap()).unwrap();
        }
    }
}

#[test]
fn attributes_and_properties_of_a_foreign_mesh_can_be_passed_on_unchanged() {
    let Some(folder) = shared_data() else { return };
    let source = Archive::open(folder.join("foreign_caches/abc/openusd_hasColorSet.abc")).unwrap();
    let garment = PolyMesh::open(&source, "/hasColorSet/hasColorSetShape").unwrap();
    let target = tempfile::tempdir().unwrap();
    let path = target.path().join("copy.abc");
    let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default()).unwrap();
    let root = archive.root();
    let mesh = PolyMeshWriter::declare(&mut archive, root, "mesh", 0).unwrap();
    let attributes = mesh.attributes(&mut archive).unwrap();
    for attribute in garment.attributes() {
        let copy = GeomParamWriter::declare(&mut archive, attributes, &attribute.spec(0)).unwrap();
        let indices = attribute.indices(0).unwrap();
        copy.write_static(&mut archive, &attribute.values(0).unwrap(), indices.as_deref()).unwrap();
    }
    let user = mesh.user_properties(&mut archive).unwrap();
    copy_properties(&mut archive, user, garment.geom());
    archive.finish(Durability::Flushed).unwrap();

    let archive = Archive::open(&path).unwrap();
    let copy = PolyMesh::open(&archive, "/mesh").unwrap();
    let (before, after) = (garment.attributes(), copy.attributes());
    assert_eq!(before.len(), after.len());
    for (before, after) in before.iter().zip(&after) {
        assert_eq!(before.spec(0), after.spec(0));
        assert_eq!(before.values(0).unwrap(), after.values(0).unwrap());
        assert_eq!(before.indices(0).unwrap(), after.indices(0).unwrap());
    }
    let positions = copy.user_properties().unwrap().samples("P").unwrap();
    assert_eq!(positions.elements::<f32, 3>(0).unwrap(), garment.positions(0).unwrap());
}
