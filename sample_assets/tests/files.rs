//! Properties that the written files promise.

use std::path::PathBuf;

use drapery_alembic::{Archive, PolyMesh};
use drapery_assets::export::{Order, Wardrobe, clockwise, write_mannequin};
use drapery_assets::pins::Pin;
use drapery_assets::sdf::Vec3;

/// A folder of its own that goes away with the test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("drapery_assets_{name}_{}", std::process::id()));
        Folder(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Nothing depends on it; a folder left behind is only untidy.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn order() -> Order {
    Order { resolution: 0.5, frames: [1001, 1030], ..Order::default() }
}

#[test]
fn the_same_order_gives_the_same_bytes() {
    let folders = [Folder::new("first"), Folder::new("second")];
    let [first, second] = folders.each_ref().map(|folder| write_mannequin(&order(), &folder.0).unwrap());
    assert_eq!(first.len(), 9);
    for (a, b) in first.iter().zip(&second) {
        assert!(std::fs::read(&a.path).unwrap() == std::fs::read(&b.path).unwrap(), "{}", a.path.display());
    }
    let names = std::fs::read_dir(&folders[0].0).unwrap().count();
    assert_eq!(names, first.len(), "no partial file stays");
}

#[test]
fn the_body_reads_back_in_the_world_through_its_parents() {
    let folder = Folder::new("body");
    write_mannequin(&order(), &folder.0).unwrap();
    let archive = Archive::open(folder.0.join("body.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/mannequin/body/bodyShape").unwrap();
    let mannequin = Wardrobe::make(&order()).unwrap().mannequin;
    assert_eq!(mesh.sample_count(), 30);
    for sample in [0, 17, 29] {
        let time = sample as f64 / 24.0;
        assert!((mesh.time(sample) - (1001.0 / 24.0 + time)).abs() < 1e-9);
        let world = mesh.world_positions(sample).unwrap();
        let off = world
            .iter()
            .zip(mannequin.points(time))
            .map(|(a, b)| (nalgebra::Vector3::from(*a) - b).norm())
            .fold(0.0, f64::max);
        // Points within 1 m of the pelvis in single precision: half of 2^-24, on three axes.
        assert!(off < 1.1e-7, "sample {sample}: {off} m");
        let local = mesh.positions(sample).unwrap();
        assert!((f64::from(local[0][1]) - world[0][1]).abs() > 0.5, "the parents matter");
    }
    let faces = mesh.faces(0).unwrap();
    let x = mesh.world_positions(0).unwrap().into_iter().map(nalgebra::Vector3::from).collect::<Vec<_>>();
    let mut volume = 0.0;
    let mut corners = faces.face_indices.as_slice();
    for count in &faces.face_counts {
        let (face, rest) = corners.split_at(*count as usize);
        corners = rest;
        for i in 2..face.len() {
            let [a, b, c] = [face[0], face[i - 1], face[i]].map(|v| x[v as usize]);
            volume += a.dot(&b.cross(&c)) / 6.0;
        }
    }
    assert!(volume < -0.045, "Alembic faces are clockwise seen from outside: {volume} m3");
}

#[test]
fn garments_read_back_with_texture_coordinates_and_face_sets() {
    let folder = Folder::new("garments");
    write_mannequin(&order(), &folder.0).unwrap();
    let wardrobe = Wardrobe::make(&order()).unwrap();
    for garment in &wardrobe.garments {
        let archive = Archive::open(folder.0.join(format!("{}.abc", garment.name))).unwrap();
        let mesh = PolyMesh::open(&archive, &format!("/{0}/{0}Shape", garment.name)).unwrap();
        assert_eq!(mesh.positions(0).unwrap().len(), garment.mesh.points.len());
        let uv = mesh.uv().unwrap();
        assert!(uv.is_indexed());
        let stored: Vec<[f32; 2]> = uv.expanded(0).unwrap();
        let corners = garment.uv_corners.iter().flat_map(|face| clockwise(face));
        assert!(stored.into_iter().eq(corners.map(|corner| garment.uvs[corner].map(|value| value as f32))));
        let mut names: Vec<String> = mesh.face_sets().unwrap().into_iter().map(|set| set.name).collect();
        let mut expected: Vec<String> = garment.face_sets.iter().map(|(name, _)| name.to_string()).collect();
        names.sort();
        expected.sort();
        assert_eq!(names, expected);
    }
}

#[test]
fn the_pin_file_rebuilds_the_obj_from_the_alembic_body() {
    let folder = Folder::new("pins");
    write_mannequin(&order(), &folder.0).unwrap();
    let archive = Archive::open(folder.0.join("body.abc")).unwrap();
    let mesh = PolyMesh::open(&archive, "/mannequin/body/bodyShape").unwrap();
    let body: Vec<Vec3> = mesh.world_positions(0).unwrap().into_iter().map(Vec3::from).collect();
    let text = |name: &str| std::fs::read_to_string(folder.0.join(name)).unwrap();
    let cloth: Vec<Vec3> = text("skirt.obj")
        .lines()
        .filter_map(|line| line.strip_prefix("v "))
        .map(|line| Vec3::from_iterator(line.split(' ').map(|number| number.parse::<f64>().unwrap())))
        .collect();
    let file: serde_json::Value = serde_json::from_str(&text("skirt_pins.json")).unwrap();
    let pins = file["pins"].as_array().unwrap();
    assert!(pins.len() > 20 && file["body"] == "body.abc");
    for pin in pins {
        let index = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
        let three = |name: &str| std::array::from_fn::<f64, 3, _>(|i| pin[name][i].as_f64().unwrap());
        let pin = Pin {
            vertex: index(&pin["vertex"]),
            body_vertices: std::array::from_fn(|i| index(&pin["body_vertices"][i])),
            weights: three("weights"),
            offset: three("offset_tangent_bitangent_normal"),
        };
        let off = (pin.position(&body) - cloth[pin.vertex]).norm();
        assert!(off < 1e-6, "vertex {}: {off} m", pin.vertex);
    }
}
