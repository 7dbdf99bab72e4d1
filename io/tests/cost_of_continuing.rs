//! Cost of continuing a long cache. Run by hand:
//! `cargo test --release -p drapery-io --test cost_of_continuing -- --ignored --nocapture`

use std::time::Instant;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::Timeline;
use drapery_io::cache::{CacheFrame, CachePlan};
use drapery_io::formats::by_extension;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::units::{LengthUnit, Units, UpAxis};

const FRAMES: i64 = 1000;
const SIDE: usize = 316;

/// A grid of about 10⁵ points.
fn sheet() -> PolygonMesh {
    let points = (0..SIDE * SIDE).map(|i| Vec3::new((i % SIDE) as f64, (i / SIDE) as f64, 0.0)).collect();
    let corner = |x: usize, y: usize| (y * SIDE + x) as u32;
    let cells = (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| (x, y)));
    let triangles: Vec<[u32; 3]> = cells
        .flat_map(|(x, y)| {
            let [a, b, c, d] = [corner(x, y), corner(x + 1, y), corner(x + 1, y + 1), corner(x, y + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    PolygonMesh::from_triangles(points, &triangles)
}

#[test]
#[ignore = "writes 2.4 GB for each format"]
fn continuing_a_thousand_frames_of_a_hundred_thousand_points_takes_seconds() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = MeshData::new(sheet());
    let kept = GarmentMesh::kept(mesh.clone());
    let mut plan = CachePlan {
        sub_frames: &[],
        garment: "sheet",
        mesh: &kept,
        units: Units { length: LengthUnit::Centimetre, up: UpAxis::Y },
        origin: Vec3::zeros(),
        timeline: Timeline::default(),
        first_frame: 1,
        last_frame: FRAMES,
        velocities: true,
        normals: false,
        crossings: true,
        attributes: Default::default(),
    };
    for extension in ["abc", "h5"] {
        let path = folder.path().join(format!("sheet.{extension}"));
        let format = by_extension(extension).unwrap();
        let (create, resume) = (format.create.unwrap(), format.resume.unwrap());
        let start = Instant::now();
        let mut writer = create(&path, &plan).unwrap();
        let mut last = 0.0;
        let mut marks = Vec::new();
        for frame in 1..=FRAMES {
            let positions: Vec<Vec3> = mesh.mesh.points.iter().map(|p| p + Vec3::z() * frame as f64).collect();
            let [positions, velocities] = [&positions, &mesh.mesh.points].map(|vectors| plan.units.stored_all(vectors));
            let now = Instant::now();
            let frame = CacheFrame {
                frame,
                sub_frame: 0,
                positions: &positions,
                velocities: &velocities,
                normals: &[],
                crossings: Some(0),
                values: Default::default(),
            };
            writer.write(&frame).unwrap();
            last = now.elapsed().as_secs_f64();
            marks.push(writer.mark());
        }
        println!("{extension}: {FRAMES} frames in {:.1} s, the last in {last:.4} s", start.elapsed().as_secs_f64());
        let start = Instant::now();
        writer.finish().unwrap();
        println!("{extension}: brought to the disk in {:.1} s", start.elapsed().as_secs_f64());
        for kept in [1000, 990, 500] {
            let start = Instant::now();
            drop(resume(&path, &plan, &marks[kept - 1]).unwrap());
            let seconds = start.elapsed().as_secs_f64();
            println!("{extension}: continued at frame {kept} in {seconds:.2} s");
            assert!(seconds < 60.0);
        }
        plan.last_frame = FRAMES + 100;
        let start = Instant::now();
        drop(resume(&path, &plan, &marks[499]).unwrap());
        println!("{extension}: extended at frame 500 in {:.2} s", start.elapsed().as_secs_f64());
        plan.last_frame = FRAMES;
        println!("{extension}: {} bytes", std::fs::metadata(&path).unwrap().len());
        std::fs::remove_file(&path).unwrap();
    }
}
