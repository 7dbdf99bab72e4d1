//! The state of a simulation as named arrays, for checkpoints.
//!
//! A snapshot holds what time has changed and nothing else: positions and velocities, and of every effect what it remembers
//! across collision steps. It is in the order of the scene (garment by garment, each in its own vertex order), so any number
//! of threads and ranks may go on from it. Files are the caller's business.
//!
//! A snapshot need not be in memory as a whole: the solver gives its arrays row by row to a [`SnapshotSink`] and takes them back
//! from a [`SnapshotSource`]. [`Snapshot`] is both.

pub(crate) mod elements;
pub(crate) mod rows;
pub(crate) mod saved_section;
#[cfg(test)]
mod tests;

use std::ops::Range;

use bytemuck::Pod;

use crate::parallel::message::Codec;

/// Saved state of a simulation: everything that it needs to continue, beside its scene.
///
/// ```
/// # use drapery_core::{EffectRequest, GarmentDescription, PolygonMesh, SceneDescription, Vec3};
/// # let mesh = PolygonMesh::from_triangles(vec![Vec3::zeros(), Vec3::x(), Vec3::z()], &[[0, 2, 1]]);
/// # let mut description = SceneDescription::new("fall");
/// # description.garments.push(GarmentDescription::new("cloth", mesh, 0.2));
/// # description.effects.push(EffectRequest::of_scene("gravity"));
/// use drapery_core::{FrameInput, Scene, Simulation, Snapshot};
/// let mut simulation = Simulation::new(Scene::validate(description).unwrap(), &FrameInput::to_frame(0)).unwrap();
/// simulation.advance(&FrameInput::to_frame(1)).unwrap();
/// let saved: Snapshot = simulation.snapshot();
/// let scene = simulation.shared_scene();
/// let restored = Simulation::restore(scene, &FrameInput::to_frame(1), &saved).expect("a snapshot of this scene");
/// assert_eq!(restored.state(), simulation.state());
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Snapshot {
    /// Sections, in a fixed order; an effect that remembers nothing has none.
    pub sections: Vec<Section>,
}

/// State of one part of the solver.
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

/// Kinds of the values of arrays, each with the type of one value.
macro_rules! kinds {
    ($(#[doc = $doc:literal] $kind:ident($type:ty),)+) => {
        /// Values of an array.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Values {
            $(#[doc = $doc] $kind(Vec<$type>),)+
        }

        /// Type of the values of an array.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum ValueKind {
            $(#[doc = concat!("[`Values::", stringify!($kind), "`].")] $kind,)+
        }

        impl ValueKind {
            /// Bytes that one value takes.
            pub fn size(self) -> usize {
                match self {
                    $(Self::$kind => size_of::<$type>(),)+
                }
            }

            /// No values of this kind.
            pub fn empty(self) -> Values {
                match self {
                    $(Self::$kind => Values::$kind(Vec::new()),)+
                }
            }
        }

        impl Values {
            /// Their type.
            pub fn kind(&self) -> ValueKind {
                match self {
                    $(Self::$kind(_) => ValueKind::$kind,)+
                }
            }

            /// Appends values of the same kind.
            ///
            /// # Panics
            /// They are of another kind.
            pub fn append(&mut self, more: Self) {
                match (self, more) {
                    $((Self::$kind(values), Self::$kind(more)) => values.extend(more),)+
                    (values, more) => panic!("an array of {:?} gets {:?}", values.kind(), more.kind()),
                }
            }
        }

        $(impl Value for $type {
            fn wrap(values: Vec<Self>) -> Values {
                Values::$kind(values)
            }

            fn of(values: &Values) -> Option<&[Self]> {
                if let Values::$kind(values) = values { Some(values) } else { None }
            }
        })+
    };
}

kinds! {
    /// Real numbers.
    F64(f64),
    /// Counts and flags.
    U64(u64),
    /// Frame numbers.
    I64(i64),
    /// Vertex numbers.
    U32(u32),
    /// Marks.
    U8(u8),
}

/// Type of a value of an array.
pub(crate) trait Value: Pod + Codec {
    /// Values as those of an array.
    fn wrap(values: Vec<Self>) -> Values;

    /// The values of an array; `None` if they are of another type.
    fn of(values: &Values) -> Option<&[Self]>;
}

/// Does the same with values of any type.
macro_rules! of_any_kind {
    ($values:expr, $own:ident => $work:expr) => {
        match $values {
            $crate::snapshot::Values::F64($own) => $work,
            $crate::snapshot::Values::U64($own) => $work,
            $crate::snapshot::Values::I64($own) => $work,
            $crate::snapshot::Values::U32($own) => $work,
            $crate::snapshot::Values::U8($own) => $work,
        }
    };
}
pub(crate) use of_any_kind;

/// Outline of a section, without the values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SectionOutline {
    /// Name of the section.
    pub name: String,
    /// Version of its layout.
    pub version: u32,
    /// Its arrays, in order.
    pub datasets: Vec<DatasetOutline>,
}

/// Outline of an array, without the values.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DatasetOutline {
    /// Name, unique within the section.
    pub name: String,
    /// Extents; their product is the number of values.
    pub shape: Vec<usize>,
    /// Type of the values.
    pub kind: ValueKind,
}

/// Takes a snapshot piece by piece. An error is kept and returned at the end, so that the caller need not stop in the middle.
pub trait SnapshotSink {
    /// Begins a section.
    fn section(&mut self, name: &str, version: u32);

    /// Begins an array of the section begun last. All its rows follow before anything else.
    fn dataset(&mut self, name: &str, shape: &[usize], kind: ValueKind);

    /// The next rows of the array begun last, in order, of its kind; any number of whole rows.
    fn rows(&mut self, values: Values);
}

/// Gives a snapshot piece by piece.
pub trait SnapshotSource {
    /// All sections in order.
    fn outline(&self) -> Vec<SectionOutline>;

    /// Values of some rows of an array: as many for each row as the extents behind the first say.
    ///
    /// # Errors
    /// There is no such array, it has fewer rows, or it cannot be read.
    fn values(&mut self, section: &str, dataset: &str, rows: Range<usize>) -> Result<Values, SnapshotError>;

    /// Version of a section, if there is one of this name.
    fn version(&self, section: &str) -> Option<u32> {
        self.outline().iter().find(|known| known.name == section).map(|known| known.version)
    }

    /// Number of rows of an array.
    ///
    /// # Errors
    /// There is no such array.
    fn rows_of(&self, section: &str, dataset: &str) -> Result<usize, SnapshotError> {
        let error = |what: String| SnapshotError { section: section.to_owned(), what };
        let outline = self.outline();
        let found = outline.iter().find(|known| known.name == section).ok_or_else(|| error("it is missing".into()))?;
        let found = found.datasets.iter().find(|known| known.name == dataset);
        Ok(found.ok_or_else(|| error(format!("`{dataset}` is missing")))?.rows())
    }
}

/// Why a snapshot cannot be continued.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "section `{section}` of the saved state: {what}\n  help: it belongs to a different scene or version; start over"
)]
pub struct SnapshotError {
    /// Section that does not fit.
    pub section: String,
    /// Fault of the section.
    pub what: String,
}

impl Snapshot {
    /// Gives all of it to a sink.
    pub fn give(&self, sink: &mut dyn SnapshotSink) {
        for section in &self.sections {
            sink.section(&section.name, section.version);
            for dataset in &section.datasets {
                sink.dataset(&dataset.name, &dataset.shape, dataset.values.kind());
                sink.rows(dataset.values.clone());
            }
        }
    }

    /// All that a source gives.
    ///
    /// # Errors
    /// The source cannot be read.
    pub fn take(source: &mut dyn SnapshotSource) -> Result<Self, SnapshotError> {
        let outline = source.outline();
        let section = |about: &SectionOutline| {
            let mut section = Section::new(&about.name, about.version);
            for dataset in &about.datasets {
                let (name, shape) = (&dataset.name, &dataset.shape);
                section.push(name, shape.clone(), source.values(&about.name, name, 0..dataset.rows())?);
            }
            Ok(section)
        };
        Ok(Self { sections: outline.iter().map(section).collect::<Result<_, _>>()? })
    }

    /// Memory held by the values [bytes].
    pub fn bytes(&self) -> usize {
        self.sections.iter().flat_map(|section| &section.datasets).map(|dataset| dataset.values.bytes()).sum()
    }
}

impl SnapshotSink for Snapshot {
    fn section(&mut self, name: &str, version: u32) {
        self.sections.push(Section::new(name, version));
    }

    fn dataset(&mut self, name: &str, shape: &[usize], kind: ValueKind) {
        let section = self.sections.last_mut().expect("a section is begun before its arrays");
        section.push(name, shape.to_vec(), kind.empty());
    }

    fn rows(&mut self, values: Values) {
        let dataset = self.sections.last_mut().and_then(|section| section.datasets.last_mut());
        dataset.expect("an array is begun before its rows").values.append(values);
    }
}

impl SnapshotSource for Snapshot {
    fn outline(&self) -> Vec<SectionOutline> {
        let dataset = |dataset: &Dataset| DatasetOutline {
            name: dataset.name.clone(),
            shape: dataset.shape.clone(),
            kind: dataset.values.kind(),
        };
        let section = |section: &Section| SectionOutline {
            name: section.name.clone(),
            version: section.version,
            datasets: section.datasets.iter().map(dataset).collect(),
        };
        self.sections.iter().map(section).collect()
    }

    fn values(&mut self, section: &str, dataset: &str, rows: Range<usize>) -> Result<Values, SnapshotError> {
        let error = |what: String| SnapshotError { section: section.to_owned(), what };
        let found = self.sections.iter().find(|known| known.name == section);
        let found = found.ok_or_else(|| error("it is missing".into()))?;
        let found = found.datasets.iter().find(|known| known.name == dataset);
        let found = found.ok_or_else(|| error(format!("`{dataset}` is missing")))?;
        let width = found.shape.iter().skip(1).product::<usize>();
        let part = found.values.part(rows.start * width..rows.end * width);
        part.ok_or_else(|| error(format!("`{dataset}` has fewer than {} rows", rows.end)))
    }
}

impl DatasetOutline {
    /// Number of rows: the first extent, or one for a single value.
    pub fn rows(&self) -> usize {
        self.shape.first().copied().unwrap_or(1)
    }

    /// Number of values in a row.
    pub fn width(&self) -> usize {
        self.shape.iter().skip(1).product()
    }

    /// Bytes that all values take.
    pub fn bytes(&self) -> u64 {
        (self.shape.iter().product::<usize>() * self.kind.size()) as u64
    }
}

impl Section {
    /// An empty section.
    pub(crate) fn new(name: &str, version: u32) -> Self {
        Self { name: name.to_owned(), version, datasets: Vec::new() }
    }

    fn push(&mut self, name: &str, shape: Vec<usize>, values: Values) {
        self.datasets.push(Dataset { name: name.to_owned(), shape, values });
    }
}

impl Values {
    /// Number of values.
    pub fn len(&self) -> usize {
        of_any_kind!(self, values => values.len())
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Some of the values; `None` when there are fewer.
    fn part(&self, range: Range<usize>) -> Option<Self> {
        of_any_kind!(self, values => values.get(range).map(|part| Value::wrap(part.to_vec())))
    }

    /// Memory held [bytes].
    pub fn bytes(&self) -> usize {
        of_any_kind!(self, values => size_of_val(values.as_slice()))
    }
}
