//! Writes the inputs that the fuzzers start from into `corpus/`, where they are not there: small good files, made by
//! Drapery's own writers: `cargo run --example seeds`, in this folder. Scenes start from those of `sample_assets/scenes` and `tests/scenes`.

use std::path::Path;

use drapery_alembic::{
    ArchiveOptions, ArchiveWriter, Durability, IDENTITY, Indexed, PolyMeshSample, PolyMeshWriter, Scope, TimeSampling,
    Topology, XformWriter, write_face_set,
};
use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::Timeline;
use drapery_fuzz::targets::usd_cache;
use drapery_io::cache::{CacheFrame, CachePlan};
use drapery_io::formats;
use drapery_io::garment_mesh::GarmentMesh;
use drapery_io::mesh_data::MeshData;
use drapery_io::units::Units;

const HOUSE: &str = "# a quad, a triangle and a pentagon\nmtllib house.mtl\no house\n\
    v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 1.5e0 -0.5\nvn 0 0 1\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0.5\n\
    usemtl wall\nf 1/1/1 2/2/1 3/3/1 4/4/1\nusemtl roof\nf -2//1 -3//1 -1//1\n\ng back\nf 4 3 \\\n2 1\n";

const SHEET: &str = "v 0 0 0\nv 0.1 0 0\nv 0.2 0 0.01\nv 0 0 0.1\nv 0.1 0 0.1\nv 0.2 0 0.1\nf 1 4 5 2\nf 2 5 6 3\n";

const FLAG: &str = "drapery = 1\n[parameters]\nn = 3\nweight = \"150 g/m²\"\n[shot]\nname = \"flag\"\nfps = \"24000/1001\"\n\
    frames = \"1-4\"\npreroll = { settle = 2, blend = 2 }\n[units]\nlength = \"cm\"\nup = \"Z\"\n[gravity]\n\
    [solver]\nmax_dt = \"1 ms\"\n[[garment]]\nname = \"a\"\nrest = \"m.obj\"\ndensity = \"$weight\"\n\
    [garment.stretch]\nstiffness = \"100 N/m\"\n[[garment.pin]]\nvertices = [1, 2]\nmode = \"spring\"\n\
    stiffness = \"10 N/m\"\n[[garment]]\nname = \"b\"\npanel = { resolution = \"$n * 2\", side = 0.5, center = [1, 1, 0] }\n\
    material = \"silk_light\"\nthickness = \"2 mm\"\n[[garment.pin]]\ncorners = [\"i0j0\"]\nuntil = 0.5\n\
    [[body]]\nname = \"c\"\nfile = \"m.abc\"\nfriction = 0.4\n[[body]]\nname = \"d\"\nshape = { sphere = { radius = 0.2 } }\n\
    path = [[0, [0, 0, 0]], [1, [0, 1, 0]]]\n[self_repulsion]\n[self_collision]\n---\nn=4\ngarment.b.thickness=1 mm\n";

/// Inputs of the run folder's files: the first byte says which file it is.
const RUN_FOLDER: [(&str, &str); 7] = [
    (
        "manifest",
        "\0{\"application\":\"Drapery 0.1.0\",\"shot\":\"s\",\"state\":\"stopped\",\"first_frame\":1,\"last_frame\":4,\
         \"last_complete_frame\":2,\"fps\":\"24/1\",\"garments\":[{\"name\":\"a\",\"object_path\":\"/a\",\"points\":9,\
         \"files\":[\"a.abc\"]}],\"threads\":2,\"command\":\"drapery run\",\"checkpoint\":{\"file\":\"c.h5\",\"frame\":2,\
         \"sub_step\":0},\"attempts\":[{\"attempt\":1,\"host\":\"h\",\"pid\":7,\"seconds\":1.5,\"last_frame\":2}]}",
    ),
    (
        "record",
        "\x01{\"record\":\"header\",\"application\":\"d\",\"start_frame\":0,\"effects\":[{\"effect\":\"gravity\",\
         \"because\":\"b\",\"bytes\":9}]}\n{\"record\":\"start\",\"frame\":0,\"seconds\":0.1}\n\
         {\"record\":\"frame\",\"frame\":1,\"seconds\":0.5,\"steps\":4,\"dt_min\":0.01,\"dt_max\":0.02,\"cg_iterations\":9,\
         \"max_strain\":{\"garment\":\"a\",\"vertices\":[0,1],\"strain\":0.01},\"kinetic_energy\":1.5,\
         \"potential_energy\":-2.5,\"stages\":[{\"stage\":\"B.1 velocity\",\"seconds\":0.2,\"calls\":4}],\
         \"counts\":{\"crossings\":0,\"body_pinched\":3},\"resident_bytes\":9}\n\
         {\"record\":\"sample\",\"frame\":1,\"sub_frame\":1,\"digests\":{\"a\":{\"positions\":\"00\"}}}\n\
         {\"record\":\"checkpoint\",\"frame\":1,\"seconds\":0.1,\"bytes\":7}\n{\"record\":\"stop\",\"reason\":\"signal\"}\n\
         {\"record\":\"resume\",\"frame\":1,\"attempt\":2}\n{\"record\":\"end\",\"state\":\"failed\",\"error\":\"e\"}\n",
    ),
    (
        "lock",
        "\x02{\"host\":\"h\",\"pid\":7,\"started\":5,\"boot\":\"b\",\"namespace\":\"n\",\"heartbeat\":2000000000}",
    ),
    (
        "site",
        "\x03threads = 16\nprogress = \"tr\"\nresumable_exit_code = 99\non_term = \"signal\"\ncheckpoint_every = \"10m\"\n\
         keep = 5\nmax_wall = \"11h50m\"\nmaterials = [\"cloth\"]\n[paths]\n\"X:/\" = \"/mnt/x/\"\n",
    ),
    (
        "material",
        "\x04summary = \"velvet\"\ndensity = \"420 g/m²\"\nthickness = \"1.2 mm\"\nstretch_stiffness = \"300 N/m\"\n\
         bending_stiffness = \"15 N/m\"\ndamping_ratio = 2.0\nfriction = 0.45\nprovenance = \"measured\"\n",
    ),
    ("duration", "\x051h30m20.5s"),
    ("time", "\x052026-11-20T16:30:00Z"),
];

/// Edits of good HDF5 files: other types, extents, names, attributes.
const EDITS: [(&str, &[u8]); 5] = [
    ("good", b""),
    ("shape", &[1, 0, 0, 2, 3, 7]),
    ("huge", &[1, 8, 0, 1, 255, 255, 255, 255, 255, 0, 0, 0, 0]),
    ("type", &[2, 1, 0, 6, 7, 0, 1, 1, 5, 0, 0, 0, 0, 0, 0, 0]),
    ("chunked", &[5, 3, 0, 9, 2, 0, 1, b'n', 4, 1, 0, 2, b'a', b'b']),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    put(&corpus, "obj/house.obj", HOUSE.as_bytes())?;
    put(&corpus, "obj/sheet.obj", SHEET.as_bytes())?;
    put(&corpus, "scene/flag.toml", FLAG.as_bytes())?;
    for (name, text) in RUN_FOLDER {
        put(&corpus, &format!("run_folder/{name}"), text.as_bytes())?;
    }
    for (name, edits) in EDITS {
        put(&corpus, &format!("hdf5_cache/{name}"), edits)?;
        for kind in 1..3 {
            put(&corpus, &format!("checkpoint/{name}_{kind}"), &[&[kind], edits].concat())?;
        }
    }
    put(&corpus, "checkpoint/seal", b"\0Drapery checkpoint 1\nbytes 512\nsha256 00\n")?;
    std::fs::create_dir_all(corpus.join("alembic"))?;
    for (name, frames) in [("small.abc", 3), ("still.abc", 1)] {
        let path = corpus.join("alembic").join(name);
        if !path.exists() {
            archive(&path, frames)?;
        }
    }
    for (name, sub_frames) in [("flag", &[][..]), ("samples", &[0.5][..])] {
        if !corpus.join("usd_cache").join(name).exists() {
            put(&corpus, &format!("usd_cache/{name}"), &usd_cache(sub_frames)?)?;
        }
    }
    Ok(())
}

/// A cache in USD with one frame and the samples behind it: its layers, one behind the other.
fn usd_cache(sub_frames: &[f64]) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let folder = std::env::temp_dir().join(format!("drapery-seeds-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]];
    let mesh =
        PolygonMesh { points: points.map(Vec3::from).to_vec(), face_counts: vec![4], face_indices: vec![0, 1, 3, 2] };
    let plan = CachePlan {
        garment: "cloth",
        mesh: &GarmentMesh::kept(MeshData::new(mesh)),
        units: Units::SI,
        origin: Vec3::new(1e5, 0.0, 0.0),
        timeline: Timeline::default(),
        first_frame: 1,
        last_frame: 1,
        velocities: true,
        normals: false,
        sub_frames,
        crossings: true,
        attributes: Default::default(),
    };
    let create = formats::by_extension("usd").and_then(|format| format.create).ok_or("a build without USD")?;
    let path = folder.join("cloth.usd");
    let mut writer = create(&path, &plan)?;
    let positions = points.map(|point| point.map(|x| x as f32));
    for sub_frame in 0..=sub_frames.len() {
        writer.write(&CacheFrame {
            frame: 1,
            sub_frame,
            positions: &positions,
            velocities: &positions,
            normals: &[],
            crossings: Some(0),
            values: Default::default(),
        })?;
    }
    writer.finish()?;
    let clips = std::fs::read_dir(folder.join("cloth.clips"))?.next().ok_or("no clips")??;
    let digest = clips.file_name().to_string_lossy().into_owned();
    let named = format!("cloth.clips/{digest}");
    let mut seed = std::fs::read_to_string(&path)?.replace(&named, usd_cache::FOLDER).into_bytes();
    for name in usd_cache::LAYERS.iter().take(2 + sub_frames.len()) {
        seed.extend(usd_cache::BETWEEN);
        seed.extend(std::fs::read(clips.path().join(name))?);
    }
    std::fs::remove_dir_all(folder)?;
    Ok(seed)
}

fn put(corpus: &Path, name: &str, content: &[u8]) -> std::io::Result<()> {
    let path = corpus.join(name);
    if path.exists() {
        return Ok(());
    }
    std::fs::create_dir_all(path.parent().unwrap_or(corpus))?;
    std::fs::write(path, content)
}

/// An archive with one of everything: a transform, a mesh with texture coordinates, a face set, a text.
fn archive(path: &Path, frames: u8) -> Result<(), Box<dyn std::error::Error>> {
    let mut archive = ArchiveWriter::create(path, &ArchiveOptions::default())?;
    let sampling = archive.add_time_sampling(TimeSampling::frames(1.0, 24.0)?)?;
    let root = archive.root();
    let xform = XformWriter::declare(&mut archive, root, "x", sampling)?;
    let mut mesh = PolyMeshWriter::declare(&mut archive, xform.object(), "m", sampling)?;
    write_face_set(&mut archive, mesh.object(), "s", &[0], true)?;
    let user = mesh.user_properties(&mut archive)?;
    archive.write_static_string(user, "text", "words")?;
    for frame in 0..frames {
        let height = f32::from(frame);
        let positions = [[0.0, height, 0.0], [1.0, height, 0.0], [0.0, height, 1.0], [1.0, height, 1.0]];
        let topology = Topology { face_counts: &[3, 3], face_indices: &[0, 1, 2, 2, 1, 3] };
        let uv = Indexed { values: &[[0.0; 2]], indices: Some(&[0; 6]), scope: Scope::FaceVarying, source_name: None };
        let sample = PolyMeshSample { topology: Some(topology), uv: Some(uv), ..PolyMeshSample::of(&positions) };
        mesh.write(&mut archive, &sample)?;
        let mut matrix = IDENTITY;
        matrix[12] = f64::from(frame);
        xform.write(&mut archive, &matrix)?;
    }
    archive.finish(Durability::Flushed)?;
    Ok(())
}
