//! Wavefront OBJ meshes: points in the order of the file, polygons of any size, texture coordinates with their own
//! indices. Materials (`usemtl`), or else groups and objects, become face sets. Edges are hard where the normals (`vn`) of the faces
//! beside them differ, or in a file without normals their smoothing groups (`s`). The file has no time and no units.
//!
//! Lines that describe curves, lines or material libraries are passed over.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;

use crate::error::IoError;
use crate::input_file::{self, LONGEST_LINE, MARK};
use crate::mesh_data::{Connectivity, FaceSet, MeshData, MeshReader, Uvs};
use crate::normals::SplitNormals;

/// An OBJ file. It is kept in memory once its positions are asked for as a whole, as those of bodies are with every frame.
#[derive(Debug)]
pub(super) struct ObjMesh {
    path: PathBuf,
    name: String,
    data: OnceLock<MeshData>,
}

/// Index that stands for "this corner has no texture coordinate", or no normal.
const NONE: u32 = u32::MAX;

/// Content that is collected while reading.
#[derive(Default)]
struct Parsed {
    points: Vec<Vec3>,
    uv_values: Vec<[f32; 2]>,
    uv_indices: Vec<u32>,
    normals: Vec<[f32; 3]>,
    /// Normal of each corner; empty in a file without normals.
    normal_indices: Vec<u32>,
    /// Smoothing group of each corner; empty in a file without such groups.
    smoothing: Vec<Smoothing>,
    says_smoothing: bool,
    /// Numbers of the smoothing groups by their names.
    smoothing_groups: HashMap<String, u32>,
    /// The group of the next faces; `None` where they are faceted.
    smoothing_group: Option<u32>,
    face_counts: Vec<u32>,
    face_indices: Vec<u32>,
    materials: SetOfFaces,
    groups: SetOfFaces,
}

/// Faces that are smooth where they meet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Smoothing {
    /// Faces of a smoothing group.
    Group(u32),
    /// The face alone: smoothing is off.
    Face(u32),
}

/// Faces by the name that was current when they were read.
#[derive(Default)]
struct SetOfFaces {
    sets: Vec<FaceSet>,
    current: Option<usize>,
}

impl SetOfFaces {
    fn begin(&mut self, name: &str) {
        let known = self.sets.iter().position(|set| set.name == name);
        self.current = Some(known.unwrap_or_else(|| {
            self.sets.push(FaceSet { name: name.to_owned(), faces: Vec::new(), material: None });
            self.sets.len() - 1
        }));
    }

    fn add(&mut self, face: u32) {
        if let Some(current) = self.current {
            self.sets[current].faces.push(face);
        }
    }

    fn used(self) -> Vec<FaceSet> {
        self.sets.into_iter().filter(|set| !set.faces.is_empty()).collect()
    }
}

impl ObjMesh {
    /// Looks for a file; it is read when something is asked of it.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub(super) fn open(path: &Path) -> Result<Self, IoError> {
        lines(path)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Self { path: path.to_owned(), name, data: OnceLock::new() })
    }

    /// Whether the file states normals.
    ///
    /// # Errors
    /// It cannot be read or is damaged.
    pub(super) fn has_normals(&self) -> Result<bool, IoError> {
        let mut found = false;
        scan(lines(&self.path)?, &self.path, &mut |line| found |= matches!(line, Line::Normal(_)))?;
        Ok(found)
    }

    fn data(&self) -> Result<&MeshData, IoError> {
        if let Some(data) = self.data.get() {
            return Ok(data);
        }
        let data = parse(lines(&self.path)?, &self.path)?;
        Ok(self.data.get_or_init(|| data))
    }
}

/// The text of a file.
fn lines(path: &Path) -> Result<BufReader<File>, IoError> {
    input_file::open(path).map(BufReader::new)
}

impl MeshReader for ObjMesh {
    fn objects(&self) -> Vec<String> {
        vec![self.name.clone()]
    }

    fn sample_times(&self) -> &[f64] {
        &[]
    }

    fn mesh_at(&self, _time: f64) -> Result<MeshData, IoError> {
        match self.data.get() {
            Some(data) => Ok(data.clone()),
            None => parse(lines(&self.path)?, &self.path),
        }
    }

    fn positions_at(&self, _time: f64, positions: &mut Vec<Vec3>) -> Result<(), IoError> {
        positions.clone_from(&self.data()?.mesh.points);
        Ok(())
    }

    fn points_at(&self, _time: f64, take: &mut dyn FnMut(&[Vec3])) -> Result<(), IoError> {
        scan(lines(&self.path)?, &self.path, &mut |line| {
            if let Line::Point(point) = line {
                take(&[point]);
            }
        })
    }

    fn faces_at(&self, _time: f64, take: &mut dyn FnMut(&[u32], &[u32])) -> Result<(), IoError> {
        scan(lines(&self.path)?, &self.path, &mut |line| {
            if let Line::Face { points, .. } = line {
                take(&[points.len() as u32], points);
            }
        })
    }

    fn check_attributes_at(&self, _time: f64) -> Result<(), IoError> {
        // They stand in the lines between points and faces, all of which are looked at with either.
        Ok(())
    }

    fn connectivity_at(&self, _time: f64) -> Result<Option<Connectivity>, IoError> {
        Ok(None)
    }
}

/// A line of the file, for messages.
struct Place<'a> {
    path: &'a Path,
    line: usize,
}

impl Place<'_> {
    fn error(&self, what: impl Into<String>) -> IoError {
        IoError::Data {
            path: PathBuf::from(self.path),
            place: format!("line {}", self.line),
            what: what.into(),
            advice: "the file is cut off or damaged; export it again".into(),
        }
    }
}

/// Content of a line.
enum Line<'a> {
    Point(Vec3),
    Uv([f32; 2]),
    Normal([f32; 3]),
    /// Point, texture coordinate and normal of each corner.
    Face {
        points: &'a [u32],
        uvs: &'a [u32],
        normals: &'a [u32],
    },
    /// `off`, or the name of a group.
    Smoothing(&'a str),
    Material(&'a str),
    Group(&'a str),
}

/// Reads a text line by line.
fn scan(mut text: impl BufRead, path: &Path, take: &mut dyn FnMut(Line<'_>)) -> Result<(), IoError> {
    let mut scanner = Scanner::default();
    let (mut bytes, mut continued) = (Vec::new(), String::new());
    let mut number = 0;
    while input_file::read_line(path, &mut text, &mut bytes)? {
        number += 1;
        let place = Place { path, line: number };
        if bytes.contains(&0) {
            return Err(place.error("it contains a zero byte: not a text file, or one in UTF-16"));
        }
        // Some programs mark a text as UTF-8 by its first bytes; the first point must not be lost by them.
        let start = if number == 1 && bytes.starts_with(MARK) { MARK.len() } else { 0 };
        let line = String::from_utf8_lossy(&bytes[start..]);
        let line = line.trim_end();
        // A backslash at the end of a line joins the next one.
        if let Some(start) = line.strip_suffix('\\') {
            continued.push_str(start);
            continued.push(' ');
            if continued.len() as u64 > LONGEST_LINE {
                return Err(place.error("too many lines are joined by backslashes"));
            }
        } else if continued.is_empty() {
            scanner.take_line(line, &place, take)?;
        } else {
            continued.push_str(line);
            scanner.take_line(&continued, &place, take)?;
            continued.clear();
        }
    }
    // The file may end where a line is to go on.
    scanner.take_line(&continued, &Place { path, line: number }, take)
}

fn parse(text: impl BufRead, path: &Path) -> Result<MeshData, IoError> {
    let mut parsed = Parsed::default();
    scan(text, path, &mut |line| parsed.take(line))?;
    Ok(parsed.finish())
}

/// State from the preceding lines that is needed to read a line.
#[derive(Default)]
struct Scanner {
    points: usize,
    uvs: usize,
    normals: usize,
    /// Point of each corner of the face being read.
    face_points: Vec<u32>,
    face_uvs: Vec<u32>,
    face_normals: Vec<u32>,
}

impl Scanner {
    fn take_line(&mut self, line: &str, place: &Place<'_>, take: &mut dyn FnMut(Line<'_>)) -> Result<(), IoError> {
        let mut words = line.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let [x, y, z] = numbers::<3>(&mut words, place)?;
                // A weight or a colour may follow, or a comment. Another word is that of a next line, where lines have other ends:
                // the points after this one would be lost.
                let mut more = words.take_while(|word| !word.starts_with('#'));
                more.try_for_each(|word| number(word, place).map(drop))?;
                self.points += 1;
                take(Line::Point(Vec3::new(x, y, z)));
            }
            Some("vt") => {
                let [u] = numbers::<1>(&mut words, place)?;
                // A texture coordinate may have one number only; the second then is 0.
                let v = words.next().map_or(Ok(0.0), |word| number(word, place))?;
                self.uvs += 1;
                take(Line::Uv([u as f32, v as f32]));
            }
            Some("f") => {
                self.take_face(words, place)?;
                take(Line::Face { points: &self.face_points, uvs: &self.face_uvs, normals: &self.face_normals });
            }
            Some("vn") => {
                let normal = numbers::<3>(&mut words, place)?;
                self.normals += 1;
                take(Line::Normal(normal.map(|c| c as f32)));
            }
            Some("s") => take(Line::Smoothing(words.next().unwrap_or("off"))),
            Some("usemtl") => take(Line::Material(words.next().unwrap_or_default())),
            Some("g" | "o") => take(Line::Group(words.next().unwrap_or("default"))),
            _ => {}
        }
        Ok(())
    }

    fn take_face<'a>(&mut self, corners: impl Iterator<Item = &'a str>, place: &Place<'_>) -> Result<(), IoError> {
        self.face_points.clear();
        self.face_uvs.clear();
        self.face_normals.clear();
        for corner in corners {
            let mut parts = corner.split('/');
            let point = index(parts.next().unwrap_or_default(), self.points, "point", place)?;
            let mut other = |count, what| match parts.next() {
                None | Some("") => Ok(NONE),
                Some(word) => index(word, count, what, place),
            };
            let (uv, normal) = (other(self.uvs, "texture coordinate")?, other(self.normals, "normal")?);
            self.face_points.push(point);
            self.face_uvs.push(uv);
            self.face_normals.push(normal);
        }
        let count = self.face_points.len();
        if count < 3 {
            return Err(place.error(format!("a face has {count} corners; at least 3 are needed")));
        }
        Ok(())
    }
}

impl Parsed {
    fn take(&mut self, line: Line<'_>) {
        match line {
            Line::Point(point) => self.points.push(point),
            Line::Uv(value) => self.uv_values.push(value),
            Line::Normal(value) => self.normals.push(value),
            Line::Smoothing(name) => self.begin_smoothing(name),
            Line::Face { points, uvs, normals } => {
                let face = self.face_counts.len() as u32;
                self.add_edges(face, normals);
                self.face_counts.push(points.len() as u32);
                self.face_indices.extend_from_slice(points);
                self.uv_indices.extend_from_slice(uvs);
                self.materials.add(face);
                self.groups.add(face);
            }
            Line::Material(name) => self.materials.begin(name),
            Line::Group(name) => self.groups.begin(name),
        }
    }

    /// Begins a smoothing group. Faces before the first one have smoothing off, as the format says.
    fn begin_smoothing(&mut self, name: &str) {
        if self.smoothing.is_empty() {
            let faces = self.face_counts.iter().zip(0..);
            self.smoothing = faces.flat_map(|(count, face)| vec![Smoothing::Face(face); *count as usize]).collect();
            self.says_smoothing = true;
        }
        let next = self.smoothing_groups.len() as u32;
        let group = || *self.smoothing_groups.entry(name.to_owned()).or_insert(next);
        self.smoothing_group = (!["off", "0"].contains(&name)).then(group);
    }

    /// Takes of a face what says which of its edges are hard.
    fn add_edges(&mut self, face: u32, normals: &[u32]) {
        if self.says_smoothing {
            let smoothing = self.smoothing_group.map_or(Smoothing::Face(face), Smoothing::Group);
            self.smoothing.extend(normals.iter().map(|_| smoothing));
        }
        if !self.normals.is_empty() {
            self.normal_indices.resize(self.face_indices.len(), NONE);
            self.normal_indices.extend_from_slice(normals);
        }
    }

    /// Normals that are split at hard edges, if there are any.
    fn split_normals(&mut self) -> Option<SplitNormals> {
        let (corners, points) = (&self.face_indices, self.points.len());
        if self.normal_indices.iter().all(|index| *index == NONE) {
            let smoothing = std::mem::take(&mut self.smoothing);
            return SplitNormals::between(corners, points, |a, b| smoothing.get(a) == smoothing.get(b));
        }
        let none = [0.0; 3];
        let of = |index: &u32| self.normals.get(*index as usize).copied().unwrap_or(none);
        let directions: Vec<[f32; 3]> = self.normal_indices.iter().map(of).collect();
        SplitNormals::of_directions(corners, points, &directions)
    }

    fn finish(mut self) -> MeshData {
        let uvs = self.uvs();
        let split_normals = self.split_normals();
        let materials = self.materials.used();
        let groups = self.groups.used();
        // One group around everything says nothing.
        let groups = if groups.len() > 1 { groups } else { Vec::new() };
        MeshData {
            mesh: PolygonMesh { points: self.points, face_counts: self.face_counts, face_indices: self.face_indices },
            uvs,
            split_normals,
            face_sets: if materials.is_empty() { groups } else { materials },
            ..MeshData::default()
        }
    }

    /// Corners without a texture coordinate, if only some have none, get the value (0, 0).
    fn uvs(&mut self) -> Option<Uvs> {
        if self.uv_indices.iter().all(|&i| i == NONE) {
            return None;
        }
        let mut values = std::mem::take(&mut self.uv_values);
        let mut indices = std::mem::take(&mut self.uv_indices);
        if indices.contains(&NONE) {
            let origin = values.len() as u32;
            values.push([0.0, 0.0]);
            indices.iter_mut().filter(|i| **i == NONE).for_each(|i| *i = origin);
        }
        Some(Uvs { name: String::new(), values, indices })
    }
}

fn number(word: &str, place: &Place<'_>) -> Result<f64, IoError> {
    word.parse().map_err(|_| place.error(format!("`{word}` is not a number")))
}

fn numbers<'a, const N: usize>(
    words: &mut impl Iterator<Item = &'a str>,
    place: &Place<'_>,
) -> Result<[f64; N], IoError> {
    let mut values = [0.0; N];
    for value in &mut values {
        *value = number(words.next().ok_or_else(|| place.error(format!("{N} numbers are expected")))?, place)?;
    }
    Ok(values)
}

/// Index of a list that counts from 1, or backwards from -1.
fn index(word: &str, count: usize, what: &str, place: &Place<'_>) -> Result<u32, IoError> {
    let written: i64 = word.parse().map_err(|_| place.error(format!("`{word}` is not an index of a {what}")))?;
    let count = count as i64;
    let index = if written < 0 { count + written } else { written - 1 };
    if index < 0 || index >= count {
        return Err(place.error(format!("{what} {written} does not exist; {count} are defined before this line")));
    }
    Ok(index as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOUSE: &str = "# a quad, a triangle and a pentagon\n\
        v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 1.5 0\nv 9 9 9\n\
        vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n\
        usemtl wall\nf 1/1 2/2 3/3 4/4\nusemtl roof\nf -3/4 -4/3 -2/1\nusemtl wall\nf 1 2 \\\n3 5 4\n";

    fn parsed(text: &str) -> Result<MeshData, IoError> {
        parse(text.as_bytes(), Path::new("house.obj"))
    }

    #[test]
    fn point_order_polygons_and_uv_indices_stay_as_in_the_file() {
        let data = parsed(HOUSE).unwrap();
        // The sixth point belongs to no face and stays where it is.
        assert_eq!(data.mesh.points.len(), 6);
        assert_eq!(data.mesh.face_counts, [4, 3, 5]);
        assert_eq!(data.mesh.face_indices, [0, 1, 2, 3, 3, 2, 4, 0, 1, 2, 4, 3]);
        let uvs = data.uvs.unwrap();
        assert_eq!(uvs.indices, [0, 1, 2, 3, 3, 2, 0, 4, 4, 4, 4, 4]);
        assert_eq!(uvs.values[4], [0.0, 0.0]);
    }

    #[test]
    fn materials_become_face_sets() {
        let sets = parsed(HOUSE).unwrap().face_sets;
        assert_eq!(sets[0], FaceSet { name: "wall".into(), faces: vec![0, 2], material: None });
        assert_eq!(sets[1], FaceSet { name: "roof".into(), faces: vec![1], material: None });
    }

    #[test]
    fn edges_are_hard_where_normals_or_smoothing_groups_differ() {
        // Two quads that share the edge between points 2 and 3.
        let points = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 1\nv 0 1 1\n";
        let normals = "vn 0 0 1\nvn 0 2 0\nvn 0 0 1.0001\n";
        let split = |faces: &str| parsed(&format!("{points}{faces}")).unwrap().split_normals.map(|split| split.indices);
        let hard = Some(vec![0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(split(&format!("{normals}f 1//1 2//1 3//1 4//1\nf 4//2 3//2 5//2 6//-2\n")), hard);
        assert_eq!(
            split(&format!("{normals}f 1//1 2//1 3//1 4//1\nf 4//2 3//3 5//2 6//2\n")),
            Some(vec![0, 1, 2, 3, 4, 2, 5, 6])
        );
        // Equal normals of other numbers, and corners without any, are smooth; so is a file that says nothing.
        assert_eq!(split(&format!("{normals}f 1//1 2//1 3//1 4//3\nf 4//1 3//3 5 6\n")), None);
        assert_eq!(split("f 1 2 3 4\nf 4 3 5 6\n"), None);
        for (first, second, expected) in [
            ("s 1\n", "s 2\n", &hard),
            ("s 1\n", "s 1\n", &None),
            ("s 0\n", "", &hard),
            ("", "s off\n", &hard),
            ("", "s 1\n", &hard),
        ] {
            assert_eq!(split(&format!("{first}f 1 2 3 4\n{second}f 4 3 5 6\n")), *expected, "{first}{second}");
        }
        // Normals count where there are both.
        assert_eq!(split(&format!("{normals}s off\nf 1//1 2//1 3//1 4//1\nf 4//1 3//1 5//1 6//1\n")), None);
        let message = parsed(&format!("{points}f 1//1 2//1 3//1\n")).unwrap_err().to_string();
        assert!(message.contains("normal 1 does not exist"), "{message}");
    }

    #[test]
    fn the_first_and_the_last_line_count_behind_a_mark_and_before_a_backslash() {
        let data = parsed("\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 \\\n3 \\").unwrap();
        assert_eq!((data.mesh.points.len(), data.mesh.face_indices), (3, vec![0, 1, 2]));
    }

    #[test]
    fn a_broken_line_is_named() {
        for (text, expected) in [
            ("v 0 0 0\nv 0 zero 0\n", "line 2: `zero` is not a number"),
            ("v 0 0 0\nf 1 1 2\n", "line 2: point 2 does not exist; 1 are defined before this line"),
            ("v 0 0\n", "line 1: 3 numbers are expected"),
            ("v 0 0 0\nf 1 1\n", "line 2: a face has 2 corners"),
            ("v 0 0 0\nf 0 1 1\n", "point 0 does not exist"),
            ("v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r", "line 1: `v` is not a number"),
            ("\u{feff}v\0 \u{0}0", "line 1: it contains a zero byte"),
        ] {
            let message = parsed(text).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }
}
