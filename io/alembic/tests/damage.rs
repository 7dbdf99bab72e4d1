//! Damaged archives give errors: no panic, no hang, no allocation beyond the size of the file.

use drapery_alembic::*;

/// A small archive with one of everything.
fn small_archive() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.abc");
    let mut archive = ArchiveWriter::create(&path, &ArchiveOptions::default()).unwrap();
    let sampling = archive.add_time_sampling(TimeSampling::frames(1.0, 24.0).unwrap()).unwrap();
    let root = archive.root();
    let xform = XformWriter::declare(&mut archive, root, "x", sampling).unwrap();
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "m", sampling).unwrap();
    write_face_set(&mut archive, mesh.object(), "s", &[0], true).unwrap();
    let user = mesh.user_properties(&mut archive).unwrap();
    archive.write_static_string(user, "text", "words").unwrap();
    for frame in 0..3 {
        let height = frame as f32;
        let positions = [[0.0, height, 0.0], [1.0, height, 0.0], [0.0, height, 1.0]];
        let topology = Topology { face_counts: &[3], face_indices: &[0, 1, 2] };
        let uv = Indexed { values: &[[0.0; 2]], indices: Some(&[0; 3]), scope: Scope::FaceVarying, source_name: None };
        let sample = PolyMeshSample { topology: Some(topology), uv: Some(uv), ..PolyMeshSample::of(&positions) };
        mesh.write(&mut archive, &sample).unwrap();
        let mut matrix = IDENTITY;
        matrix[12] = f64::from(frame);
        xform.write(&mut archive, &matrix).unwrap();
    }
    archive.finish(Durability::Flushed).unwrap();
    std::fs::read(path).unwrap()
}

/// Reads everything; the result does not matter, only that there is one.
fn read_all(bytes: Vec<u8>) -> Result<(), AlembicError> {
    let archive = Archive::from_bytes(bytes, "memory")?;
    for object in archive.objects() {
        // One damaged object does not stop the others.
        let _ = read_object(&object);
    }
    Ok(())
}

fn read_object(object: &Object) -> Result<(), AlembicError> {
    let _ = object.visibility_at(0.1);
    let _ = read_compound(&object.properties()?);
    let _ = world_matrix_at(object, 0.06);
    let mesh = PolyMesh::of(object)?;
    for index in 0..mesh.sample_count().min(4) {
        let _ = mesh.world_positions(index);
        let _ = mesh.faces(index);
        let _ = mesh.bounds(index);
    }
    let _ = mesh.face_sets();
    let _ = mesh.uv().map(|uv| uv.expanded::<f32, 2>(0));
    Ok(())
}

fn read_compound(compound: &Compound) -> Result<(), AlembicError> {
    for property in compound.iter() {
        match property.kind() {
            PropertyKind::Compound(inside) => read_compound(inside)?,
            PropertyKind::Scalar(samples) | PropertyKind::Array(samples) => {
                for index in 0..samples.len().min(4) {
                    samples.raw(index)?;
                    samples.element_count(index)?;
                }
            }
        }
    }
    Ok(())
}

#[test]
fn an_archive_cut_off_at_any_byte_is_an_error() {
    let bytes = small_archive();
    assert!(read_all(bytes.clone()).is_ok());
    for end in 0..bytes.len() {
        // The root group is the last thing in the file.
        assert!(read_all(bytes[..end].to_vec()).is_err(), "cut off at {end} of {}", bytes.len());
    }
}

#[test]
fn no_flipped_bit_leads_to_a_panic() {
    let bytes = small_archive();
    for position in 0..bytes.len() {
        for bit in 0..8 {
            let mut damaged = bytes.clone();
            damaged[position] ^= 1 << bit;
            let _ = read_all(damaged);
        }
    }
}

#[test]
fn no_flipped_byte_leads_to_a_panic_when_continuing() {
    let bytes = small_archive();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.abc");
    for position in 0..bytes.len() {
        let mut damaged = bytes.clone();
        damaged[position] ^= 0xff;
        std::fs::write(&path, &damaged).unwrap();
        if let Ok(mut archive) = ArchiveWriter::append(&path) {
            archive.commit(Durability::Flushed).unwrap();
        }
    }
}

#[test]
fn the_largest_lies_about_size_are_refused() {
    let bytes = small_archive();
    for position in (16..bytes.len() - 8).step_by(4) {
        for lie in [u64::MAX, u64::MAX >> 1, 1 << 40, u64::from(u32::MAX)] {
            let mut damaged = bytes.clone();
            damaged[position..position + 8].copy_from_slice(&lie.to_le_bytes());
            let _ = read_all(damaged);
        }
    }
}

#[test]
fn an_object_that_contains_itself_is_an_error() {
    let bytes = small_archive();
    let u64_at = |offset: usize| {
        let mut word = [0; 8];
        word.copy_from_slice(&bytes[offset..offset + 8]);
        u64::from_le_bytes(word)
    };
    // Root group, third slot: top object; its second slot: the transform; its second slot: the mesh.
    let top = u64_at(u64_at(8) as usize + 8 + 2 * 8) as usize;
    let xform = u64_at(top + 16) as usize;
    let mut looped = bytes.clone();
    looped[xform + 16..xform + 24].copy_from_slice(&(xform as u64).to_le_bytes());
    let message = read_all(looped).unwrap_err().to_string();
    assert!(message.contains("contains itself"), "{message}");
}
