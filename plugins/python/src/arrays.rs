//! Arrays of NumPy, in and out.

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_io::mesh_data::Connectivity;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray2,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::usage;

/// Numbers of corners of faces, and the point of each corner.
pub(crate) type Faces<'py> = (Bound<'py, PyArray1<u32>>, Bound<'py, PyArray1<u32>>);

/// Points of an array of the shape (points, 3).
pub(crate) fn points(array: &PyReadonlyArray2<'_, f64>, name: &str) -> PyResult<Vec<Vec3>> {
    let [count, width] = [array.shape()[0], array.shape()[1]];
    if width != 3 {
        return Err(usage(format!("`{name}` has the shape ({count}, {width}), and (points, 3) is needed")));
    }
    let array = array.as_array();
    Ok(array.rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect())
}

/// An array of rows of three or two that owns these numbers; nothing is copied. It cannot be written to, because nothing would
/// come of it.
pub(crate) fn rows<T: Element>(py: Python<'_>, numbers: Vec<T>, width: usize) -> PyResult<Bound<'_, PyArray2<T>>> {
    let count = numbers.len() / width;
    let array = PyArray1::from_vec(py, numbers).reshape([count, width])?;
    let held: PyReadwriteArray2<'_, T> = array.try_readwrite()?;
    held.make_nonwriteable();
    Ok(array)
}

/// An array of the shape (points, 3) that owns these vectors.
pub(crate) fn vectors(py: Python<'_>, vectors: Vec<Vec3>) -> PyResult<Bound<'_, PyArray2<f64>>> {
    rows(py, bytemuck::allocation::cast_vec::<Vec3, [f64; 3]>(vectors).into_flattened(), 3)
}

/// A mesh of points and faces.
pub(crate) fn mesh(
    positions: &PyReadonlyArray2<'_, f64>,
    face_counts: &PyReadonlyArray1<'_, u32>,
    corners: &PyReadonlyArray1<'_, u32>,
) -> PyResult<PolygonMesh> {
    let list = |array: &PyReadonlyArray1<'_, u32>| array.as_array().to_vec();
    Ok(PolygonMesh {
        points: points(positions, "positions")?,
        face_counts: list(face_counts),
        face_indices: list(corners),
    })
}

/// Faces that own their numbers.
pub(crate) fn faces(py: Python<'_>, faces: Connectivity) -> Faces<'_> {
    (PyArray1::from_vec(py, faces.face_counts), PyArray1::from_vec(py, faces.face_indices))
}
