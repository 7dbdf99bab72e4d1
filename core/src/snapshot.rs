//! The state of a simulation as named arrays, for checkpoints.
//!
//! A snapshot holds what time has changed and nothing else: positions and velocities, and of every effect what it remembers
//! across collision steps. It is in the order of the scene (garment by garment, each in its own vertex order), so any number
//! of threads may go on from it. Files are the caller's business.

use crate::Vec3;

/// Everything that a simulation needs to go on, beside its scene.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Snapshot {
    /// Sections, in a fixed order; an effect that remembers nothing has none.
    pub sections: Vec<Section>,
}

/// What one part of the solver remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct Section {
    /// Name: `state`, or that of the effect.
    pub name: String,
    /// Version of the section's layout.
    pub version: u32,
    /// Arrays, in a fixed order.
    pub datasets: Vec<Dataset>,
}

/// An array with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Dataset {
    /// Name, unique within the section.
    pub name: String,
    /// Extents; their product is the number of values.
    pub shape: Vec<usize>,
    /// The values, last extent fastest.
    pub values: Values,
}

/// Values of an array.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// Real numbers.
    F64(Vec<f64>),
    /// Counts and flags.
    U64(Vec<u64>),
    /// Frame numbers.
    I64(Vec<i64>),
    /// Vertex numbers.
    U32(Vec<u32>),
    /// Marks.
    U8(Vec<u8>),
}

/// Why a snapshot cannot be continued.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("section `{section}` of the saved state: {what}\n  help: it belongs to another scene or version; start anew")]
pub struct SnapshotError {
    /// Section that does not fit.
    pub section: String,
    /// What is wrong with it.
    pub what: String,
}

impl Snapshot {
    /// The section of this name and version.
    ///
    /// # Errors
    /// There is none, or it has another version.
    pub fn section(&self, name: &str, version: u32) -> Result<&Section, SnapshotError> {
        let error = |what: String| SnapshotError { section: name.to_owned(), what };
        let section = self.sections.iter().find(|section| section.name == name);
        let section = section.ok_or_else(|| error("it is missing".into()))?;
        if section.version != version {
            return Err(error(format!("it has version {}, this program reads {version}", section.version)));
        }
        Ok(section)
    }

    /// Memory held by the values [bytes].
    pub fn bytes(&self) -> usize {
        self.sections.iter().flat_map(|section| &section.datasets).map(|dataset| dataset.values.bytes()).sum()
    }
}

impl Section {
    /// An empty section.
    pub fn new(name: &str, version: u32) -> Self {
        Self { name: name.to_owned(), version, datasets: Vec::new() }
    }

    /// Adds a single real number.
    pub(crate) fn number(mut self, name: &str, value: f64) -> Self {
        self.push(name, vec![1], Values::F64(vec![value]));
        self
    }

    /// Adds a single count.
    pub(crate) fn integer(mut self, name: &str, value: u64) -> Self {
        self.push(name, vec![1], Values::U64(vec![value]));
        self
    }

    /// Adds one real number a row.
    pub(crate) fn numbers(mut self, name: &str, values: Vec<f64>) -> Self {
        self.push(name, vec![values.len()], Values::F64(values));
        self
    }

    /// Adds one vector a row.
    pub(crate) fn vectors(mut self, name: &str, values: impl ExactSizeIterator<Item = Vec3>) -> Self {
        let mut flat = Vec::with_capacity(3 * values.len());
        values.for_each(|v| flat.extend(<[f64; 3]>::from(v)));
        self.push(name, vec![flat.len() / 3, 3], Values::F64(flat));
        self
    }

    /// Adds rows of `width` vertex numbers.
    pub(crate) fn vertices(mut self, name: &str, width: usize, values: Vec<u32>) -> Self {
        self.push(name, vec![values.len() / width, width], Values::U32(values));
        self
    }

    /// Adds one mark a row.
    pub(crate) fn marks(mut self, name: &str, values: Vec<u8>) -> Self {
        self.push(name, vec![values.len()], Values::U8(values));
        self
    }

    fn push(&mut self, name: &str, shape: Vec<usize>, values: Values) {
        self.datasets.push(Dataset { name: name.to_owned(), shape, values });
    }

    /// An error about this section.
    pub(crate) fn error(&self, what: impl Into<String>) -> SnapshotError {
        SnapshotError { section: self.name.clone(), what: what.into() }
    }

    fn values(&self, name: &str) -> Result<&Values, SnapshotError> {
        let dataset = self.datasets.iter().find(|dataset| dataset.name == name);
        dataset.map(|dataset| &dataset.values).ok_or_else(|| self.error(format!("`{name}` is missing")))
    }

    /// Number of rows of a dataset.
    pub(crate) fn rows(&self, name: &str) -> Result<usize, SnapshotError> {
        let dataset = self.datasets.iter().find(|dataset| dataset.name == name);
        let shape = dataset.map(|dataset| &dataset.shape).ok_or_else(|| self.error(format!("`{name}` is missing")))?;
        Ok(shape.first().copied().unwrap_or(0))
    }

    /// `count` real numbers.
    fn real(&self, name: &str, count: usize) -> Result<&[f64], SnapshotError> {
        match self.values(name)? {
            Values::F64(values) if values.len() == count => Ok(values),
            Values::F64(values) => Err(self.error(format!("`{name}` has {} values, not {count}", values.len()))),
            _ => Err(self.error(format!("`{name}` is not of real numbers"))),
        }
    }

    /// A single real number.
    pub(crate) fn read_number(&self, name: &str) -> Result<f64, SnapshotError> {
        Ok(self.real(name, 1)?[0])
    }

    /// Real numbers, one a row.
    pub(crate) fn read_numbers(&self, name: &str, rows: usize) -> Result<&[f64], SnapshotError> {
        self.real(name, rows)
    }

    /// Finite vectors, one a row.
    pub(crate) fn read_vectors(&self, name: &str, rows: usize) -> Result<Vec<Vec3>, SnapshotError> {
        let flat = self.real(name, 3 * rows)?;
        if let Some(broken) = flat.iter().position(|x| !x.is_finite()) {
            return Err(self.error(format!("row {} of `{name}` is not finite", broken / 3)));
        }
        Ok(flat.as_chunks().0.iter().map(|v: &[f64; 3]| Vec3::from(*v)).collect())
    }

    /// A single count.
    pub(crate) fn read_integer(&self, name: &str) -> Result<u64, SnapshotError> {
        match self.values(name)? {
            Values::U64(values) if values.len() == 1 => Ok(values[0]),
            _ => Err(self.error(format!("`{name}` is not one count"))),
        }
    }

    /// Rows of vertex numbers below `limit`.
    pub(crate) fn read_vertices<const W: usize>(&self, name: &str, limit: usize) -> Result<&[[u32; W]], SnapshotError> {
        let Values::U32(values) = self.values(name)? else {
            return Err(self.error(format!("`{name}` is not of vertex numbers")));
        };
        let (rows, rest) = values.as_chunks();
        match values.iter().find(|v| **v as usize >= limit) {
            Some(vertex) => Err(self.error(format!("`{name}` names vertex {vertex} of {limit}"))),
            None if !rest.is_empty() => Err(self.error(format!("`{name}` has an incomplete row"))),
            None => Ok(rows),
        }
    }

    /// Marks, one a row.
    pub(crate) fn read_marks(&self, name: &str, rows: usize) -> Result<&[u8], SnapshotError> {
        match self.values(name)? {
            Values::U8(values) if values.len() == rows => Ok(values),
            _ => Err(self.error(format!("`{name}` does not hold {rows} marks"))),
        }
    }
}

impl Values {
    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        match self {
            Self::F64(values) => size_of_val(values.as_slice()),
            Self::U64(values) => size_of_val(values.as_slice()),
            Self::I64(values) => size_of_val(values.as_slice()),
            Self::U32(values) => size_of_val(values.as_slice()),
            Self::U8(values) => values.len(),
        }
    }
}
