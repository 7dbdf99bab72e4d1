//! USD meshes: those of a stage that are rendered, in the world at the time asked for. Objects are chosen by a pattern over the
//! paths of their prims; several are merged in the order of their paths.
//!
//! Unlike Alembic, a stage says what it is at any time: between samples its own interpolation holds (rotations and joints turn,
//! and do not cut corners). Times in seconds are time codes divided by `timeCodesPerSecond`.

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_usd::Interpolation;
use drapery_usd::read::{About, Chosen, Element, Entry, Faces, Meaning, MeshSample, Primvar, Stage};

use crate::error::IoError;
use crate::formats::fitting;
use crate::input_file;
use crate::mesh_data::{
    BoundMaterial, Connectivity, DataType, FaceSet, MeshData, MeshParam, MeshReader, PodType, Scope, Uvs, merge,
    reverse,
};
use crate::normals::SplitNormals;
use crate::units::{StatedUnits, UpAxis};

/// A code this close to a stored one, in sample steps, is that sample: 1001/24 s times 24 is not 1001.
const SAME_SAMPLE: f64 = 1e-3;

/// Interpretation of texts that are words of USD, to tell them from others.
pub(super) const TOKEN: &str = "token";

/// Name of the UV set that is taken before others.
const UV: &str = "st";

/// Meshes of a stage, read as one.
pub(super) struct UsdMesh {
    path: PathBuf,
    stage: Stage,
    objects: Vec<String>,
    stated: StatedUnits,
    codes_per_second: f64,
    chosen: Chosen,
    times: Vec<f64>,
    notes: Vec<String>,
}

impl UsdMesh {
    /// Opens the meshes whose path fits `pattern` (`*` stands for any letters, also over several levels); all that are rendered
    /// without a pattern.
    ///
    /// # Errors
    /// The file or a layer that the meshes need is missing or damaged, the pattern is malformed, or fits no mesh that is rendered.
    pub(super) fn open(path: &Path, pattern: Option<&str>) -> Result<Self, IoError> {
        input_file::open(path)?;
        let stage = Stage::open(path)?;
        let about = stage.about();
        let places = choose(path, pattern, &stage, Entry::skipped)?;
        let objects: Vec<String> = places.iter().map(|place| about.meshes[*place].path.clone()).collect();
        let needs = |prim: &str| {
            let below = |object: &String| {
                object.strip_prefix(prim).is_some_and(|rest| rest.starts_with('/') || rest.is_empty())
            };
            prim.is_empty() || prim == "/" || pattern.is_none() || objects.iter().any(below)
        };
        let mut notes = Vec::new();
        for (prim, flaw) in &about.flaws {
            if needs(prim) {
                return Err(flaw.clone().into());
            }
            notes.push(format!("{}: {}", flaw.place, flaw.what));
        }
        let stated = stated_units(path, about)?;
        let codes_per_second = about.codes_per_second;
        let chosen = stage.choose(&places)?;
        let countable = codes_per_second.is_finite() && codes_per_second > 0.0;
        if !countable && !chosen.codes.is_empty() {
            let what = format!("timeCodesPerSecond is {codes_per_second}, so its samples have no times");
            return Err(IoError::data(
                path,
                "stage",
                what,
                "set it to the number of time codes per second, for example 24",
            ));
        }
        let times = chosen.codes.iter().map(|code| code / codes_per_second).collect();
        notes.extend(chosen.notes.iter().cloned());
        Ok(Self { path: path.to_owned(), objects, stated, codes_per_second, chosen, times, notes, stage })
    }

    /// The time code of a time [s]; that of a sample if it is meant.
    fn code(&self, time: f64) -> f64 {
        let codes = &self.chosen.codes;
        let (Some(first), Some(last)) = (codes.first(), codes.last()) else { return 0.0 };
        let code = time * self.codes_per_second;
        let step = (last - first) / (codes.len() - 1).max(1) as f64;
        let after = codes.partition_point(|sample| *sample < code);
        let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|place| codes.get(place));
        around.copied().find(|sample| (sample - code).abs() <= SAME_SAMPLE * step).unwrap_or(code)
    }

    fn read(&self, mesh: usize, code: f64) -> Result<MeshData, IoError> {
        let sample = self.stage.mesh(mesh, code)?;
        Ok(mesh_data(self.objects[mesh].clone(), sample))
    }

    fn points(&self, mesh: usize, code: f64) -> Result<Vec<Vec3>, IoError> {
        Ok(self.stage.points(mesh, code)?.into_iter().map(Vec3::from).collect())
    }
}

impl MeshReader for UsdMesh {
    fn objects(&self) -> Vec<String> {
        self.objects.clone()
    }

    fn sample_times(&self) -> &[f64] {
        &self.times
    }

    fn frame_rate(&self) -> Option<f64> {
        Some(self.codes_per_second)
    }

    fn mesh_at(&self, time: f64) -> Result<MeshData, IoError> {
        let code = self.code(time);
        let mut merged = self.read(0, code)?;
        for mesh in 1..self.objects.len() {
            merged = merge(merged, self.read(mesh, code)?);
        }
        Ok(merged)
    }

    fn positions_at(&self, time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        positions.clear();
        self.points_at(time, &mut |points| positions.extend_from_slice(points))
    }

    fn points_at(&self, time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        for mesh in 0..self.objects.len() {
            take(&self.points(mesh, self.code(time))?);
        }
        Ok(())
    }

    fn faces_at(&self, time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        let code = self.code(time);
        let mut first = 0;
        for mesh in 0..self.objects.len() {
            let mut faces = self.stage.faces(mesh, code)?;
            faces.indices.iter_mut().for_each(|point| *point += first);
            take(&faces.counts, &faces.indices);
            if mesh + 1 < self.objects.len() {
                first += self.points(mesh, code)?.len() as u32;
            }
        }
        Ok(())
    }

    fn check_attributes_at(&self, time: f64) -> Result<(), IoError> {
        (0..self.objects.len()).try_for_each(|mesh| self.read(mesh, self.code(time)).map(drop))
    }

    fn connectivity_at(&self, time: f64) -> Result<Option<Connectivity>, IoError> {
        let mut all = Connectivity::default();
        let mut moving = false;
        for mesh in 0..self.objects.len() {
            moving |= self.stage.faces_move(mesh)?;
        }
        if !moving {
            return Ok(None);
        }
        for mesh in 0..self.objects.len() {
            let faces = self.stage.faces(mesh, self.code(time))?;
            all.face_counts.extend(faces.counts);
            all.face_indices.extend(faces.indices);
        }
        Ok(Some(all))
    }

    fn stated_units(&self) -> Option<StatedUnits> {
        Some(self.stated)
    }

    fn other_files(&self) -> Vec<PathBuf> {
        // The file itself is known under the name that the scene gives it.
        let own = self.path.canonicalize().ok();
        self.chosen.layers.iter().filter(|layer| Some(*layer) != own.as_ref()).cloned().collect()
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
    }

    fn left_out(&self) -> Vec<String> {
        let each = self.objects.iter().zip(&self.chosen.left_out_of_each);
        // Normals and accelerations belong to a pose, and whatever is made of the mesh has others.
        let stays = |name: &&String| !name.starts_with("normals") && *name != "accelerations";
        let of = |(object, names): (&String, &Vec<String>)| {
            names.iter().filter(stays).map(|name| left_out(object, name)).collect::<Vec<_>>()
        };
        each.flat_map(of).collect()
    }
}

/// Says that something of an object is not handed through.
pub(super) fn left_out(object: &str, name: &str) -> String {
    format!("{object}: {name} is not copied to the cache")
}

/// Returns the units that a stage states.
///
/// # Errors
/// Its up axis is none.
pub(super) fn stated_units(path: &Path, about: &About) -> Result<StatedUnits, IoError> {
    let up = match about.up_axis.as_deref() {
        None => None,
        Some("Y") => Some(UpAxis::Y),
        Some("Z") => Some(UpAxis::Z),
        Some(other) => {
            let what = format!("upAxis is {other:?}; it has to be \"Y\" or \"Z\"");
            return Err(IoError::data(path, "stage", what, "set it in the program that wrote the file"));
        }
    };
    Ok(StatedUnits { metres: about.metres_per_unit, up })
}

/// Frames a second of a stage, and time codes a frame.
///
/// # Errors
/// One of its rates is none.
pub(super) fn frame_rate(path: &Path, about: &About) -> Result<(f64, f64), IoError> {
    let codes = about.codes_per_second;
    let frames = about.frames_per_second.unwrap_or(codes);
    for (name, rate) in [("timeCodesPerSecond", codes), ("framesPerSecond", frames)] {
        if !(rate.is_finite() && rate > 0.0) {
            let what = format!("{name} is {rate}, so its samples have no frames");
            return Err(IoError::data(path, "stage", what, "set it to the number per second, for example 24"));
        }
    }
    Ok((frames, codes / frames))
}

/// Places of all meshes that are to be seen, whatever they are for.
///
/// # Errors
/// There are none.
pub(super) fn seen(path: &Path, stage: &Stage) -> Result<Vec<usize>, IoError> {
    choose(path, None, stage, |entry| entry.hidden.clone())
}

/// Places of the meshes that fit a pattern and are not skipped.
fn choose(
    path: &Path,
    pattern: Option<&str>,
    stage: &Stage,
    skipped: impl Fn(&Entry) -> Option<String>,
) -> Result<Vec<usize>, IoError> {
    let about = stage.about();
    let fits = pattern.map(|pattern| fitting(path, pattern)).transpose()?;
    let fitting = |entry: &Entry| fits.as_ref().is_none_or(|fits| fits.is_match(&entry.path));
    let all = || about.meshes.iter().enumerate().filter(|(_, entry)| fitting(entry));
    let places: Vec<usize> = all().filter(|(_, entry)| skipped(entry).is_none()).map(|(place, _)| place).collect();
    if !places.is_empty() {
        return Ok(places);
    }
    // Whatever is missing may be the reason.
    if let Some((_, flaw)) = about.flaws.first() {
        return Err(flaw.clone().into());
    }
    let rendered: Vec<&str> =
        about.meshes.iter().filter(|entry| skipped(entry).is_none()).map(|entry| entry.path.as_str()).collect();
    let advice = match rendered.is_empty() {
        true => "export the meshes themselves".to_owned(),
        false => format!("its meshes are {}", rendered.join(", ")),
    };
    let first = all().next().and_then(|(_, entry)| Some((&entry.path, skipped(entry)?)));
    let what = match (first, pattern) {
        (Some((path, why)), _) => format!("the mesh {path} is not rendered: {why}"),
        (_, Some(pattern)) if !about.meshes.is_empty() => format!("no mesh path matches {pattern}"),
        _ => without_meshes(&about.others),
    };
    Err(IoError::data(path, "objects", what, advice))
}

/// Says what a stage holds instead of meshes.
fn without_meshes(others: &[(String, String)]) -> String {
    let some: Vec<String> = others.iter().take(5).map(|(path, kind)| format!("{path} ({kind})")).collect();
    if some.is_empty() {
        "it contains no mesh".into()
    } else {
        format!("it contains no mesh, only {}", some.join(", "))
    }
}

/// A mesh of a stage as the rest of the program knows it.
pub(super) fn mesh_data(object_path: String, sample: MeshSample) -> MeshData {
    let MeshSample {
        points,
        faces,
        subsets,
        mut primvars,
        normals,
        subdivision,
        material,
        double_sided,
        render_mesh_of,
    } = sample;
    let split_normals = normals.and_then(|normals| split_normals(&normals, &faces, points.len()));
    let counts = faces.counts;
    let found = primvars.iter().position(|primvar| primvar.name == UV && is_uv(primvar));
    let found = found.or_else(|| {
        let means = |primvar: &Primvar| primvar.meaning == Meaning::TextureCoordinate && is_uv(primvar);
        primvars.iter().position(means)
    });
    let uvs = found.and_then(|place| {
        let uvs = uvs(&primvars[place], &faces.indices)?;
        primvars.remove(place);
        Some(uvs)
    });
    let params = primvars.into_iter().map(|primvar| param(primvar, &counts)).collect();
    MeshData {
        object_path,
        uvs,
        split_normals,
        params,
        params_in: None,
        face_sets: subsets
            .into_iter()
            .map(|subset| FaceSet { name: subset.name, faces: subset.faces, material: subset.material.map(bound) })
            .collect(),
        mesh: PolygonMesh {
            points: points.into_iter().map(Vec3::from).collect(),
            face_counts: counts,
            face_indices: faces.indices,
        },
        material: material.map(bound),
        purpose: None,
        double_sided,
        render_mesh_of,
        subdivision: Some(subdivision),
        triangles: None,
    }
}

/// Normals that hard edges split; none where normals do not fit the mesh.
fn split_normals(normals: &Primvar, faces: &Faces, points: usize) -> Option<SplitNormals> {
    let (counts, corners) = (&faces.counts, &faces.indices);
    let pieces = normals.pieces();
    let at = |place: usize| match &normals.indices {
        Some(indices) => pieces.get(*indices.get(place)? as usize),
        None => pieces.get(place),
    };
    if normals.element == Element::I32 {
        return SplitNormals::between(corners, points, |a, b| at(a) == at(b));
    }
    let number = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    let vector = |place| <[f32; 3]>::try_from(at(place)?.as_chunks().0.iter().map(number).collect::<Vec<_>>()).ok();
    let places: Vec<usize> = match normals.interpolation {
        Interpolation::Uniform => {
            counts.iter().enumerate().flat_map(|(face, count)| std::iter::repeat_n(face, *count as usize)).collect()
        }
        _ => (0..corners.len()).collect(),
    };
    let directions: Vec<[f32; 3]> = places.into_iter().map(vector).collect::<Option<_>>()?;
    SplitNormals::of_directions(corners, points, &directions)
}

/// A binding as the rest of the program knows it.
fn bound(material: drapery_usd::BoundMaterial) -> BoundMaterial {
    let drapery_usd::BoundMaterial { path, source, is_stronger } = material;
    BoundMaterial { path, source, is_stronger }
}

fn is_uv(primvar: &Primvar) -> bool {
    primvar.element == Element::F32 && primvar.extent == 2
}

/// UVs as one index a face corner; none when they do not fit the mesh.
fn uvs(primvar: &Primvar, face_indices: &[u32]) -> Option<Uvs> {
    let values: Vec<[f32; 2]> = primvar
        .values
        .chunks_exact(8)
        .map(|v| [[v[0], v[1], v[2], v[3]], [v[4], v[5], v[6], v[7]]].map(f32::from_le_bytes))
        .collect();
    let own = || (0..values.len() as u32).collect();
    let indices: Vec<u32> = primvar.indices.clone().unwrap_or_else(own);
    let corners: Vec<u32> = match primvar.interpolation {
        Interpolation::FaceVarying => indices,
        Interpolation::Vertex | Interpolation::Varying => {
            face_indices.iter().map(|point| indices.get(*point as usize).copied()).collect::<Option<_>>()?
        }
        Interpolation::Constant | Interpolation::Uniform => return None,
    };
    let fits = corners.len() == face_indices.len() && corners.iter().all(|index| (*index as usize) < values.len());
    fits.then(|| Uvs { name: primvar.name.clone(), values, indices: corners })
}

/// An attribute as Alembic has it, which counts corners clockwise.
fn param(mut primvar: Primvar, face_counts: &[u32]) -> MeshParam {
    let pod = match primvar.element {
        Element::Bool => PodType::Bool,
        Element::U8 => PodType::U8,
        Element::I32 => PodType::I32,
        Element::U32 => PodType::U32,
        Element::I64 => PodType::I64,
        Element::U64 => PodType::U64,
        Element::F16 => PodType::F16,
        Element::F32 => PodType::F32,
        Element::F64 => PodType::F64,
        Element::Text => PodType::String,
    };
    let data_type = DataType { pod, extent: primvar.extent };
    let corners: usize = face_counts.iter().map(|count| *count as usize).sum();
    if primvar.interpolation == Interpolation::FaceVarying {
        let held = primvar.pieces().len();
        match &mut primvar.indices {
            Some(indices) if indices.len() == corners => reverse(face_counts, indices),
            None if held == corners => {
                let values = primvar.pieces();
                let mut order: Vec<u32> = (0..corners as u32).collect();
                reverse(face_counts, &mut order);
                primvar.values = order.iter().flat_map(|corner| values[*corner as usize]).copied().collect();
            }
            _ => {}
        }
    }
    let interpretation = match primvar.meaning {
        Meaning::Colour if primvar.extent == 4 => "rgba",
        Meaning::Colour => "rgb",
        Meaning::Point => "point",
        Meaning::Normal => "normal",
        Meaning::Vector => "vector",
        Meaning::Token => TOKEN,
        // Alembic has it for UVs alone.
        Meaning::TextureCoordinate if primvar.extent == 2 => "vector",
        Meaning::Numbers | Meaning::TextureCoordinate => "",
    };
    MeshParam {
        scope: match primvar.interpolation {
            Interpolation::Constant => Scope::Constant,
            Interpolation::Uniform => Scope::Uniform,
            Interpolation::Varying => Scope::Varying,
            Interpolation::Vertex => Scope::Vertex,
            Interpolation::FaceVarying => Scope::FaceVarying,
        },
        data_type,
        interpretation: interpretation.to_owned(),
        source_name: None,
        name: primvar.name,
        values: primvar.values,
        indices: primvar.indices,
    }
}
