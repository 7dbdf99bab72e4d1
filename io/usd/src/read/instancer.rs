//! Point instancers: the meshes of a prototype at the places of its instances.
//!
//! Places are those of Pixar's `ComputeInstanceTransformsAtTime` at the codes of samples. Between them positions and scales are
//! linear, orientations turn, and which prototypes are where is that of the sample before; velocities of instances are not used.

use openusd::sdf::Value;
use openusd::usd::{AttributeQuery, Prim};

use super::error::UsdError;
use super::matrix::{IDENTITY, Matrix, from_quaternion_as_is, multiply, scale, translation};
use super::reading::Reading;
use super::transform::Transform;
use super::values::{all_integers, quaternions, reverse, vectors};
use super::{Faces, Primvar, Subset};
use crate::Interpolation;

/// Most points of one mesh at all its places.
const MOST_POINTS: usize = if cfg!(fuzzing) { 100_000 } else { 100_000_000 };

/// Prototype that a mesh belongs to, and the instancer of that prototype.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Prototype {
    /// Path of the instancer.
    pub(crate) instancer: String,
    /// Path of the prototype's root.
    pub(crate) root: String,
    /// Its numbers among the prototypes of the instancer.
    pub(crate) numbers: Vec<i64>,
    /// Path of the mesh.
    pub(crate) mesh: String,
}

/// The places of a mesh.
pub(crate) struct Instances {
    path: String,
    numbers: Vec<i64>,
    /// From the mesh to the parent of the prototype's root.
    in_prototype: Transform,
    to_world: Transform,
    prototypes: AttributeQuery,
    positions: AttributeQuery,
    /// Single precision, or half where there is none of it.
    orientations: [AttributeQuery; 2],
    scales: AttributeQuery,
    ids: AttributeQuery,
    invisible: AttributeQuery,
    inactive: Vec<i64>,
}

impl Instances {
    /// The places of a mesh of a prototype.
    pub(crate) fn of(reading: &Reading, prototype: &Prototype, mesh: &Prim) -> Result<Self, UsdError> {
        let path = prototype.instancer.clone();
        let prim = reading.stage.prim(path.as_str());
        let prim = prim.map_err(|error| reading.bad(path.as_str(), error.to_string(), "export it again"))?;
        let query = |name: &str| prim.attribute(name).query();
        Ok(Self {
            numbers: prototype.numbers.clone(),
            in_prototype: Transform::below(reading, mesh, &prototype.root)?,
            to_world: Transform::of(reading, &prim)?,
            prototypes: query("protoIndices"),
            positions: query("positions"),
            orientations: ["orientationsf", "orientations"].map(query),
            scales: query("scales"),
            ids: query("ids"),
            invisible: query("invisibleIds"),
            inactive: inactive(reading, &prim)?,
            path,
        })
    }

    /// Codes at which something of the places is stored.
    pub(crate) fn times(&self, reading: &Reading) -> Result<Vec<f64>, UsdError> {
        let mut times = self.in_prototype.times(reading)?;
        times.extend(self.to_world.times(reading)?);
        let [single, half] = &self.orientations;
        for query in [&self.prototypes, &self.positions, single, half, &self.scales, &self.ids, &self.invisible] {
            times.extend(reading.times(query)?);
        }
        Ok(times)
    }

    /// Whether there may be more or fewer of them from time to time.
    pub(crate) fn come_and_go(&self, reading: &Reading) -> Result<bool, UsdError> {
        let mut may = false;
        for query in [&self.prototypes, &self.ids, &self.invisible] {
            may |= !reading.times(query)?.is_empty();
        }
        Ok(may)
    }

    /// From the space of the mesh to the world, for each place, of a mesh with this number of points.
    pub(crate) fn at(&self, reading: &Reading, code: f64, points: usize) -> Result<Vec<Matrix>, UsdError> {
        let list = |query: &AttributeQuery| reading.value_at(query, code);
        let whole = |query: &AttributeQuery| Ok::<_, UsdError>(list(query)?.as_ref().and_then(all_integers));
        let indices = whole(&self.prototypes)?.unwrap_or_default();
        let positions =
            self.of_each(reading, "positions", list(&self.positions)?.as_ref().and_then(vectors), &indices)?;
        let turns = match list(&self.orientations[0])?.as_ref().and_then(quaternions).filter(|all| !all.is_empty()) {
            None => list(&self.orientations[1])?.as_ref().and_then(quaternions),
            turns => turns,
        };
        let turns = self.of_each(reading, "orientations", turns, &indices)?;
        let scales = self.of_each(reading, "scales", list(&self.scales)?.as_ref().and_then(vectors), &indices)?;
        if positions.is_empty() && !indices.is_empty() {
            return Err(self.bad(reading, format!("at time code {code}: it has no positions")));
        }
        let ids = self.of_each(reading, "ids", whole(&self.ids)?, &indices)?;
        let invisible = whole(&self.invisible)?.unwrap_or_default();
        let is_shown = |place: &usize| {
            let id = ids.get(*place).copied().unwrap_or(*place as i64);
            self.numbers.contains(&indices[*place]) && !invisible.contains(&id) && !self.inactive.contains(&id)
        };
        let shown: Vec<usize> = (0..indices.len()).filter(is_shown).collect();
        if shown.len().saturating_mul(points) > MOST_POINTS {
            let what = format!("{} instances of {points} points are more than {MOST_POINTS} points", shown.len());
            return Err(self.bad(reading, what));
        }
        let (before, after) = (self.in_prototype.at(reading, code)?, self.to_world.at(reading, code)?);
        let place = |place: usize| {
            let stretched = scales.get(place).map_or(IDENTITY, |by| scale(*by));
            let turned = turns.get(place).map_or(IDENTITY, |turn| from_quaternion_as_is(*turn));
            let own = multiply(&multiply(&stretched, &turned), &translation(positions[place]));
            multiply(&multiply(&before, &own), &after)
        };
        let matrices: Vec<Matrix> = shown.into_iter().map(place).collect();
        match matrices.iter().flatten().all(|x| x.is_finite()) {
            true => Ok(matrices),
            false => Err(self.bad(reading, format!("at time code {code}: the place of an instance is not finite"))),
        }
    }

    /// A list that has nothing, or something for each instance.
    fn of_each<T>(
        &self,
        reading: &Reading,
        name: &str,
        list: Option<Vec<T>>,
        indices: &[i64],
    ) -> Result<Vec<T>, UsdError> {
        let list = list.unwrap_or_default();
        if !list.is_empty() && list.len() != indices.len() {
            return Err(self.bad(reading, format!("it has {} {name}, and {} protoIndices", list.len(), indices.len())));
        }
        Ok(list)
    }

    fn bad(&self, reading: &Reading, what: String) -> UsdError {
        reading.bad(self.path.as_str(), what, "export the instancer again")
    }
}

/// Instances that are switched off for all times.
fn inactive(reading: &Reading, prim: &Prim) -> Result<Vec<i64>, UsdError> {
    Ok(match reading.ok(prim.get_metadata::<Value>("inactiveIds"), prim)? {
        Some(Value::Int64ListOp(ids)) => {
            let lists = [ids.explicit_items, ids.added_items, ids.prepended_items, ids.appended_items];
            lists.into_iter().flatten().filter(|id| !ids.deleted_items.contains(id)).collect()
        }
        _ => Vec::new(),
    })
}

/// Faces of a mesh at all its places; `turned` says of each whether they run the other way there.
pub(crate) fn repeat_faces(faces: &Faces, points: usize, turned: &[bool]) -> Faces {
    let mut all = Faces::default();
    for (place, turned) in turned.iter().enumerate() {
        let first = (place * points) as u32;
        let mut indices = faces.indices.clone();
        if *turned {
            reverse(&faces.counts, &mut indices);
        }
        all.indices.extend(indices.into_iter().map(|point| point + first));
        all.counts.extend(&faces.counts);
    }
    all
}

/// Subsets of the faces of a mesh at all its places.
pub(crate) fn repeat_subset(subset: &mut Subset, faces: usize, places: usize) {
    let each = |place: usize| subset.faces.iter().map(move |face| face + (place * faces) as u32);
    subset.faces = (0..places).flat_map(each).collect();
}

/// An attribute of a mesh at all its places; `None` if its values do not fit the corners that have to be turned.
pub(crate) fn repeat_primvar(mut primvar: Primvar, counts: &[u32], turned: &[bool]) -> Option<Primvar> {
    if primvar.interpolation == Interpolation::Constant {
        return Some(primvar);
    }
    let corners: usize = counts.iter().map(|count| *count as usize).sum();
    let by_corner = primvar.interpolation == Interpolation::FaceVarying;
    let held = primvar.indices.as_ref().map_or_else(|| primvar.pieces().len(), Vec::len);
    if by_corner && held != corners && turned.contains(&true) {
        return None;
    }
    match &primvar.indices {
        Some(indices) => {
            let mut backwards = indices.clone();
            if by_corner && held == corners {
                reverse(counts, &mut backwards);
            }
            let each = turned.iter().map(|turned| if *turned && by_corner { &backwards } else { indices });
            primvar.indices = Some(each.flatten().copied().collect());
        }
        None => {
            let forwards = primvar.pieces();
            let mut backwards = forwards.clone();
            if by_corner && held == corners {
                reverse(counts, &mut backwards);
            }
            let each = turned.iter().map(|turned| if *turned && by_corner { &backwards } else { &forwards });
            primvar.values = each.flat_map(|pieces| pieces.concat()).collect();
        }
    }
    Some(primvar)
}
