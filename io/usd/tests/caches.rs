//! Caches as they are written and read back; and what is left of them when bytes are lost or changed.

use std::fs;
use std::path::{Path, PathBuf};

use drapery_usd::cache::{Cache, CacheError};
use drapery_usd::write::{
    CacheLayer, FaceSubset, Members, MeshPath, Moving, Primvar, StillMesh, Subdivision, Units, Values, cache_layer,
    clip, clip_manifest, topology,
};
use drapery_usd::{BoundMaterial, Interpolation};

const UNITS: Units = Units { metres_per_unit: 0.01, z_up: true, time_codes_per_second: 24000.0 / 1001.0 };

fn points(frame: i64) -> Vec<[f32; 3]> {
    let z = frame as f32 * 0.5;
    vec![[0.0, 0.0, z], [1.0, 0.0, z], [1.0, 1.0, -z], [0.0, 1.0, z], [2.0, 0.5, f32::MIN_POSITIVE]]
}

/// Strain at these points.
fn strain(frame: i64) -> Vec<f32> {
    vec![0.0, 0.25, -0.5, 1.0, frame as f32]
}

fn bound(path: &str) -> BoundMaterial {
    BoundMaterial { path: path.to_owned(), ..BoundMaterial::default() }
}

fn still(path: &MeshPath) -> StillMesh<'_> {
    StillMesh {
        path,
        origin: Some([1e5, -2.5, 0.0]),
        face_counts: vec![4, 3],
        face_indices: vec![0, 1, 2, 3, 1, 4, 2],
        subdivision: Subdivision::CatmullClark,
        uvs: Some((vec![[0.0, 0.0], [1.0, 0.25]], vec![0, 1, 1, 0, 0, 1, 0])),
        primvars: vec![Primvar {
            name: "panel id".to_owned(),
            interpolation: Interpolation::Uniform,
            values: Values::Int(vec![7, 8]),
            extent: 1,
            role: "",
            indices: None,
        }],
        subsets: vec![
            FaceSubset { name: "front".to_owned(), faces: vec![0], material: Some(bound("/mtl/denim")) },
            FaceSubset { name: "none".to_owned(), faces: Vec::new(), material: None },
        ],
        material: Some(bound("/hero/mtl/lining")),
        purpose: None,
        double_sided: Some(true),
        render_mesh_of: None,
        triangles: Some(vec![[0, 1, 2], [0, 2, 3], [1, 4, 2]]),
        velocities: true,
        normals: true,
        normal_indices: None,
        crossings: true,
        numbers: vec!["strain"],
        attributes: Some("strain".to_owned()),
    }
}

/// Writes a cache of two frames; returns its layer and the folder of its clips.
fn write(folder: &Path) -> (PathBuf, PathBuf) {
    let path = MeshPath::of("/hero/geo/skirtShape");
    let clips = folder.join("skirt.clips/0");
    fs::create_dir_all(&clips).unwrap();
    fs::write(clips.join(CacheLayer::TOPOLOGY), topology(UNITS, still(&path)).unwrap()).unwrap();
    fs::write(
        clips.join(CacheLayer::MANIFEST),
        clip_manifest(UNITS, &path, Members { velocities: true, normals: true, crossings: true, numbers: &["strain"] }),
    )
    .unwrap();
    for frame in [-1, 0] {
        let points = points(frame);
        let time_code = frame as f64;
        let (velocities, normals) = (Some(&points[..]), Some(&points[..]));
        let strain = strain(frame);
        let numbers: &[(&str, &[f32])] = &[("strain", &strain)];
        let moving = Moving { time_code, points: &points, velocities, normals, crossings: Some(3), numbers };
        fs::write(clips.join(CacheLayer::clip(frame, 0)), clip(UNITS, &path, &moving).unwrap()).unwrap();
    }
    let layer = CacheLayer {
        units: UNITS,
        path: &path,
        documentation: "Garment \"skirt\"",
        properties: &[("garment", "skirt".to_owned())],
        folder: "skirt.clips/0",
        frames: [-1, 0],
        sub_frames: &[],
        last_sub_frame: 0,
    };
    let file = folder.join("skirt.usd");
    fs::write(&file, cache_layer(&layer)).unwrap();
    (file, clips)
}

#[test]
fn what_is_written_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let cache = Cache::open(&write(folder.path()).0).unwrap();
    assert_eq!((cache.mesh_path(), &cache.frames[..]), ("/hero/geo/skirtShape", &[-1, 0][..]));
    assert_eq!((cache.metres_per_unit, cache.z_up, cache.fps), (0.01, true, 24000.0 / 1001.0));
    assert_eq!(cache.properties, [("garment".to_owned(), "skirt".to_owned())]);
    let still = &cache.still;
    assert_eq!((&still.face_counts[..], &still.face_indices[..]), (&[4, 3][..], &[0, 1, 2, 3, 1, 4, 2][..]));
    assert_eq!(still.origin, [1e5, -2.5, 0.0]);
    assert_eq!(still.triangles.as_deref(), Some(&[[0, 1, 2], [0, 2, 3], [1, 4, 2]][..]));
    assert_eq!(still.attributes.as_deref(), Some("strain"));
    for (index, frame) in [-1, 0].into_iter().enumerate() {
        let read = cache.frame(index).unwrap();
        assert_eq!(read.numbers["strain"], strain(frame));
        assert_eq!(
            (&read.points, read.velocities.as_ref(), read.crossings),
            (&points(frame), Some(&points(frame)), Some(3))
        );
        let [low, high] = if frame == 0 { [0.0, f32::MIN_POSITIVE] } else { [-0.5, 0.5] };
        assert_eq!(read.extent, [[0.0, 0.0, low], [2.0, 1.0, high]]);
    }
}

#[test]
fn equal_meshes_make_equal_bytes() {
    let [a, b] = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let ((_, a), (_, b)) = (write(a.path()), write(b.path()));
    for name in [CacheLayer::TOPOLOGY.to_owned(), CacheLayer::clip(0, 0)] {
        assert!(fs::read(a.join(&name)).unwrap() == fs::read(b.join(&name)).unwrap(), "{name}");
    }
}

#[test]
fn stages_of_others_are_told_from_damaged_caches() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("other.usd");
    let of = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        Cache::open(&path).map(|_| ()).unwrap_err()
    };
    assert!(matches!(of(b"#usda 1.0\n\ndef Xform \"a\"\n{\n}\n"), CacheError::NotOurs { .. }));
    assert!(matches!(of(b"PXR-USDC\0\0\0\0"), CacheError::NotOurs { .. }));
    assert!(matches!(of(&[0xff, 0xfe]), CacheError::NotOurs { .. }));
    assert!(matches!(of(b"#usda 1.0\n(\n"), CacheError::Damaged { .. }));
    let missing = Cache::open(&folder.path().join("none.usd")).map(|_| ()).unwrap_err();
    assert!(matches!(missing, CacheError::Io { .. }));
}

/// Numbers that look random and are the same every time (xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end as u64) as usize
    }
}

/// Every file of a cache, cut off at and changed in many places: an answer or an error, and never more than that.
#[test]
fn caches_with_bytes_lost_or_changed_are_read_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (layer, clips) = write(folder.path());
    let mut random = Random(7);
    let mut refused = 0;
    for file in [layer.clone(), clips.join(CacheLayer::TOPOLOGY), clips.join(CacheLayer::clip(0, 0))] {
        let good = fs::read(&file).unwrap();
        for round in 0..3000 {
            let mut bad = good.clone();
            match round % 3 {
                0 => bad.truncate(random.below(good.len())),
                1 => (0..=random.below(4)).for_each(|_| bad[random.below(good.len())] = random.below(256) as u8),
                _ => {
                    let place = random.below(good.len());
                    bad[place] ^= 1 << random.below(8);
                }
            }
            fs::write(&file, &bad).unwrap();
            let read = Cache::open(&layer)
                .and_then(|cache| (0..cache.frames.len()).try_for_each(|index| cache.frame(index).map(drop)));
            refused += usize::from(read.is_err());
        }
        fs::write(&file, &good).unwrap();
    }
    // Those that were cut off, at least the most.
    assert!(refused > 2500, "{refused} refused");
}
