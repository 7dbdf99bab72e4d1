//! `verify` finds each rule that a cache breaks, and nothing in a sound one.

use std::path::Path;

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, PolyMeshSample, PolyMeshWriter, TimeSampling, Topology, XformWriter,
};
use drapery_analysis::verify::verify;

/// A cache of one rising triangle that can be spoilt.
struct Cache {
    times: TimeSampling,
    /// Velocity that is stored along y [1/s].
    velocity: f32,
    /// Replaces the bounds of the last sample.
    bounds: Option<[f64; 6]>,
    /// Replaces y of vertex 1 in sample 2.
    spoilt: Option<f32>,
}

impl Cache {
    /// Five samples at 24 a second, rising 1 unit a second.
    fn sound() -> Self {
        Self { times: TimeSampling::frames(1001.0, 24.0).unwrap(), velocity: 1.0, bounds: None, spoilt: None }
    }

    fn failures(&self) -> Vec<String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cache.abc");
        self.write(&path);
        verify(&[&path], None).unwrap().failures
    }

    fn write(&self, path: &Path) {
        let options = ArchiveOptions { frames_per_second: Some(24.0), ..ArchiveOptions::default() };
        let mut archive = ArchiveWriter::create(path, &options).unwrap();
        let sampling = archive.add_time_sampling(self.times.clone()).unwrap();
        let root = archive.root();
        let xform = XformWriter::still(&mut archive, root, "flag", None).unwrap();
        let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "flagShape", sampling).unwrap();
        for sample in 0..5 {
            let y = sample as f32 / 24.0;
            let mut points = [[0.0, y, 0.0], [1.0, y, 0.0], [0.0, y, 1.0]];
            if let (2, Some(value)) = (sample, self.spoilt) {
                points[1][1] = value;
            }
            let data = PolyMeshSample {
                topology: Some(Topology { face_counts: &[3], face_indices: &[0, 1, 2] }),
                velocities: Some(&[[0.0, self.velocity, 0.0]; 3]),
                bounds: self.bounds.filter(|_| sample == 4),
                ..PolyMeshSample::of(&points)
            };
            mesh.write(&mut archive, &data).unwrap();
        }
        archive.finish(Durability::Flushed).unwrap();
    }
}

#[test]
fn a_sound_cache_passes_and_its_frames_are_named() {
    assert!(Cache::sound().failures().is_empty());
    let folder = tempfile::tempdir().unwrap();
    Cache::sound().write(&folder.path().join("a.abc"));
    let found = verify(&[&folder.path().join("a.abc")], None).unwrap();
    assert!(found.facts.iter().any(|fact| fact.contains("41.708333 s = frame 1001.000")), "{:?}", found.facts);
}

#[test]
fn each_broken_rule_is_found() {
    let uneven = TimeSampling::acyclic(vec![1.0, 1.1, 1.2, 1.5, 1.6]).unwrap();
    let cases = [
        ("velocities a frame instead of a second", Cache { velocity: 1.0 / 24.0, ..Cache::sound() }, "per second"),
        ("velocities the wrong way", Cache { velocity: -1.0, ..Cache::sound() }, "per second"),
        ("a point that is not finite", Cache { spoilt: Some(f32::NAN), ..Cache::sound() }, "sample 2, vertex 1"),
        ("bounds of something else", Cache { bounds: Some([0.0; 6]), ..Cache::sound() }, "sample 4: the stored bounds"),
        ("uneven times", Cache { times: uneven, ..Cache::sound() }, "not evenly spaced"),
    ];
    for (name, cache, expected) in cases {
        let failures = cache.failures();
        assert!(failures.iter().any(|text| text.contains(expected)), "{name}: {failures:?}");
    }
}

#[test]
fn a_lone_sample_at_time_zero_is_found() {
    let mut times = vec![0.0];
    times.extend((0..4).map(|i| f64::from(1001 + i) / 24.0));
    let failures = Cache { times: TimeSampling::acyclic(times).unwrap(), ..Cache::sound() }.failures();
    assert!(failures.iter().any(|text| text.contains("lone sample at time 0")), "{failures:?}");
}
