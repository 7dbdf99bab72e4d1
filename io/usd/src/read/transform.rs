//! Transforms of prims: stacks of operations, each of which may move, down from the first ancestor that counts.

use openusd::sdf::Value;
use openusd::usd::{AttributeQuery, Prim};

use super::error::UsdError;
use super::matrix::{
    IDENTITY, Matrix, from_quaternion, inverse, multiply, rotation, scale, transform_point, translation,
};
use super::reading::Reading;
use super::values::{matrix, number, quaternion, vector};

/// Entry in the order of operations where all ancestors are left out.
const RESET: &str = "!resetXformStack!";

/// Prefix of an inverted operation.
const INVERT: &str = "!invert!";

/// Types of prims that have no transform, whatever they hold.
const WITHOUT: [&str; 8] =
    ["", "Scope", "Material", "Shader", "NodeGraph", "GeomSubset", "SkelAnimation", "BlendShape"];

/// Kind of an operation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Translate(Axes),
    Scale(Axes),
    /// About one axis.
    Rotate(usize),
    /// About three axes, in this order.
    RotateAll([usize; 3]),
    Orient,
    Matrix,
}

/// All three axes, or one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Axes {
    All,
    One(usize),
}

impl Kind {
    /// The kind with this name.
    fn named(name: &str) -> Option<Self> {
        let axis = |letter: char| "XYZ".find(letter);
        let one = |name: &str| axis(name.chars().next()?).filter(|_| name.len() == 1);
        if let Some(axes) = name.strip_prefix("rotate") {
            let order: Vec<usize> = axes.chars().map(axis).collect::<Option<_>>()?;
            return match order[..] {
                [axis] => Some(Self::Rotate(axis)),
                [a, b, c] if a != b && b != c && a != c => Some(Self::RotateAll([a, b, c])),
                _ => None,
            };
        }
        Some(match name {
            "translate" => Self::Translate(Axes::All),
            "scale" => Self::Scale(Axes::All),
            "orient" => Self::Orient,
            "transform" => Self::Matrix,
            _ => match (name.strip_prefix("translate"), name.strip_prefix("scale")) {
                (Some(rest), _) => Self::Translate(Axes::One(one(rest)?)),
                (_, Some(rest)) => Self::Scale(Axes::One(one(rest)?)),
                _ => return None,
            },
        })
    }

    /// The type that exporters give it.
    fn type_name(self) -> &'static str {
        match self {
            Self::Translate(Axes::All) => "double3",
            Self::Translate(Axes::One(_)) => "double",
            Self::Scale(Axes::All) | Self::RotateAll(_) => "float3",
            Self::Scale(Axes::One(_)) | Self::Rotate(_) => "float",
            Self::Orient => "quatf",
            Self::Matrix => "matrix4d",
        }
    }

    fn matrix(self, value: &Value) -> Option<Matrix> {
        let along = |axis: usize, rest: f64| -> Option<[f64; 3]> {
            let mut all = [rest; 3];
            all[axis] = number(value)?;
            Some(all)
        };
        Some(match self {
            Self::Translate(Axes::All) => translation(vector(value)?),
            Self::Translate(Axes::One(axis)) => translation(along(axis, 0.0)?),
            Self::Scale(Axes::All) => scale(vector(value)?),
            Self::Scale(Axes::One(axis)) => scale(along(axis, 1.0)?),
            Self::Rotate(axis) => rotation(axis, number(value)?),
            Self::RotateAll(order) => {
                let angles = vector(value)?;
                order.iter().fold(IDENTITY, |turned, axis| multiply(&turned, &rotation(*axis, angles[*axis])))
            }
            Self::Orient => from_quaternion(quaternion(value)?),
            Self::Matrix => matrix(value)?,
        })
    }
}

/// One operation of a prim.
struct Operation {
    kind: Kind,
    inverted: bool,
    value: AttributeQuery,
    /// Path of its attribute.
    path: String,
}

/// Transforms from the space of a prim to that of the world.
pub(crate) struct Transform {
    /// From the prim outwards.
    operations: Vec<Operation>,
}

impl Transform {
    /// The transform of a prim and its ancestors.
    pub(crate) fn of(reading: &Reading, prim: &Prim) -> Result<Self, UsdError> {
        Self::below(reading, prim, "/")
    }

    /// The transform of a prim and its ancestors up to one of them, that one's included.
    pub(crate) fn below(reading: &Reading, prim: &Prim, root: &str) -> Result<Self, UsdError> {
        let mut operations = Vec::new();
        let mut next = Some(prim.clone());
        while let Some(prim) = next {
            if Self::has_one(reading, &prim)? && Self::add(reading, &prim, &mut operations)? {
                break;
            }
            next = if prim.path().as_str() == root { None } else { prim.parent() };
        }
        Ok(Self { operations })
    }

    fn has_one(reading: &Reading, prim: &Prim) -> Result<bool, UsdError> {
        Ok(prim.path().as_str() != "/" && {
            let kind = reading.ok(prim.type_name(), prim)?;
            !WITHOUT.contains(&kind.as_ref().map_or("", |kind| kind.as_str()))
        })
    }

    /// Adds the operations of one prim; whether its ancestors do not count.
    fn add(reading: &Reading, prim: &Prim, operations: &mut Vec<Operation>) -> Result<bool, UsdError> {
        let order = reading.value(&prim.attribute("xformOpOrder"))?;
        let mut order = order.as_ref().and_then(super::values::words).unwrap_or_default();
        let reset = order.iter().rposition(|name| name == RESET);
        if let Some(last) = reset {
            order.drain(..=last);
        }
        // The last of the list is nearest to the prim.
        for name in order.iter().rev() {
            let (inverted, name) = name.strip_prefix(INVERT).map_or((false, name.as_str()), |name| (true, name));
            let attribute = prim.attribute(name);
            let path = attribute.path().as_str().to_owned();
            let kind = name.strip_prefix("xformOp:").and_then(|name| Kind::named(name.split(':').next()?));
            let Some(kind) = kind else {
                let what = format!("`{name}` is not a known operation");
                return Err(reading.bad(path, what, "use translate, scale, rotate…, orient or transform"));
            };
            reading.declare(prim, &[(name, kind.type_name())])?;
            operations.push(Operation { kind, inverted, value: attribute.query(), path });
        }
        Ok(reset.is_some())
    }

    /// Codes at which something of it is stored.
    pub(crate) fn times(&self, reading: &Reading) -> Result<Vec<f64>, UsdError> {
        let mut times = Vec::new();
        for operation in &self.operations {
            times.extend(reading.times(&operation.value)?);
        }
        Ok(times)
    }

    /// The matrix to the world at a time code.
    pub(crate) fn at(&self, reading: &Reading, code: f64) -> Result<Matrix, UsdError> {
        let mut world = IDENTITY;
        for Operation { kind, inverted, value, path } in &self.operations {
            // An operation without a value does nothing.
            let Some(value) = reading.value_at(value, code)? else { continue };
            let wrong = |what: &str| reading.bad(path, format!("at time code {code}: {what}"), "export it again");
            let mut matrix =
                kind.matrix(&value).ok_or_else(|| wrong("the type of its value does not match its name"))?;
            if *inverted {
                matrix = inverse(&matrix).ok_or_else(|| wrong("the operation to invert has no inverse"))?;
            }
            world = multiply(&world, &matrix);
        }
        if world.iter().all(|x| x.is_finite()) {
            return Ok(world);
        }
        let place = self.operations.first().map_or_else(String::new, |first| first.path.clone());
        Err(reading.bad(place, format!("at time code {code}: the transform is not finite"), "export it again"))
    }
}

/// Moves points by a matrix.
pub(crate) fn transform_all(points: &mut [[f64; 3]], matrix: &Matrix) {
    if *matrix != IDENTITY {
        points.iter_mut().for_each(|point| *point = transform_point(*point, matrix));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_known_by_their_names() {
        assert_eq!(Kind::named("rotateZYX"), Some(Kind::RotateAll([2, 1, 0])));
        assert_eq!(Kind::named("rotateY"), Some(Kind::Rotate(1)));
        assert_eq!(Kind::named("translateX"), Some(Kind::Translate(Axes::One(0))));
        assert_eq!(Kind::named("scale"), Some(Kind::Scale(Axes::All)));
        for unknown in ["rotateXXY", "rotate", "translateXY", "scaleW", "shear"] {
            assert_eq!(Kind::named(unknown), None, "{unknown}");
        }
    }
}
