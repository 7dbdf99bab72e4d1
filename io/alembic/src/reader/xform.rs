//! Transforms: local matrices of single objects and world matrices.

use super::object::{Object, Schema};
use super::properties::Samples;
use crate::error::AlembicError;
use crate::geom::{IDENTITY, Matrix, multiply};

/// One entry of the operation list; the discriminants are the stored types.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Op {
    Scale,
    Translate,
    Rotate,
    Matrix,
    RotateX,
    RotateY,
    RotateZ,
}

impl Op {
    fn from_code(code: u8) -> Option<Self> {
        use Op::*;
        [Scale, Translate, Rotate, Matrix, RotateX, RotateY, RotateZ].get(usize::from(code >> 4)).copied()
    }

    fn channels(self) -> usize {
        match self {
            Op::Scale | Op::Translate => 3,
            Op::Rotate => 4,
            Op::Matrix => 16,
            Op::RotateX | Op::RotateY | Op::RotateZ => 1,
        }
    }

    /// Its matrix; `c` has as many values as `channels` says.
    fn matrix(self, c: &[f64]) -> Matrix {
        let mut m = IDENTITY;
        match self {
            Op::Scale => (m[0], m[5], m[10]) = (c[0], c[1], c[2]),
            Op::Translate => m[12..15].copy_from_slice(c),
            Op::Rotate => m = rotation([c[0], c[1], c[2]], c[3]),
            Op::Matrix => m.copy_from_slice(c),
            Op::RotateX => m = rotation([1., 0., 0.], c[0]),
            Op::RotateY => m = rotation([0., 1., 0.], c[0]),
            Op::RotateZ => m = rotation([0., 0., 1.], c[0]),
        }
        m
    }
}

/// Rotation by `degrees` around `axis` (any length), right-handed: Rodrigues' formula, transposed for row vectors.
fn rotation(axis: [f64; 3], degrees: f64) -> Matrix {
    let length = axis.iter().map(|a| a * a).sum::<f64>().sqrt();
    if length == 0.0 {
        return IDENTITY;
    }
    let [x, y, z] = axis.map(|a| a / length);
    let (s, c) = degrees.to_radians().sin_cos();
    let d = 1.0 - c;
    [
        d * x * x + c,
        d * x * y + s * z,
        d * x * z - s * y,
        0.,
        d * x * y - s * z,
        d * y * y + c,
        d * y * z + s * x,
        0.,
        d * x * z + s * y,
        d * y * z - s * x,
        d * z * z + c,
        0.,
        0.,
        0.,
        0.,
        1.,
    ]
}

/// A transform object.
#[derive(Debug, Clone)]
pub struct Xform {
    object: Object,
    ops: Vec<Op>,
    values: Option<Samples>,
    inherits: Option<Samples>,
}

impl Xform {
    /// Reads the operation list of a transform object.
    pub fn of(object: &Object) -> Result<Self, AlembicError> {
        let compound = object.schema_compound(".xform", "transform")?;
        let codes = match compound.samples(".ops").filter(|samples| !samples.is_empty()) {
            Some(samples) => samples.values::<u8>(0)?,
            None => Vec::new(),
        };
        let unknown = || object.damaged(".xform/.ops", format!("unknown operations in {codes:?}"));
        let ops: Vec<Op> = codes.iter().map(|&code| Op::from_code(code)).collect::<Option<_>>().ok_or_else(unknown)?;
        let values = compound.samples(".vals").filter(|samples| !samples.is_empty()).cloned();
        if !ops.is_empty() && values.is_none() {
            return Err(object.damaged(".xform/.vals", "operations without values".into()));
        }
        let inherits = compound.samples(".inherits").filter(|samples| !samples.is_empty()).cloned();
        Ok(Self { object: object.clone(), ops, values, inherits })
    }

    /// Number of samples; 0 for a transform that was never set (identity).
    pub fn sample_count(&self) -> usize {
        self.values.iter().chain(&self.inherits).map(Samples::len).max().unwrap_or(0)
    }

    /// True when the local matrix never changes.
    pub fn is_constant(&self) -> bool {
        self.values.as_ref().is_none_or(Samples::is_constant)
    }

    /// Time of sample `index` (s).
    pub fn time(&self, index: usize) -> f64 {
        self.values.as_ref().or(self.inherits.as_ref()).map_or(0.0, |samples| samples.time_sampling().time(index))
    }

    /// Whether the matrices of the parents apply too, at `time` (s).
    pub fn inherits_at(&self, time: f64) -> Result<bool, AlembicError> {
        match &self.inherits {
            Some(samples) => Ok(samples.values::<bool>(samples.floor_index(time))?.first() != Some(&false)),
            None => Ok(true),
        }
    }

    /// Local matrix at `time` (s), for row vectors.
    ///
    /// Between two samples the values of the operations (angles, translations, matrix elements) are interpolated
    /// linearly. For a matrix operation that turns fast this shrinks the object slightly half way.
    pub fn matrix_at(&self, time: f64) -> Result<Matrix, AlembicError> {
        let Some(samples) = &self.values else {
            return Ok(IDENTITY);
        };
        let (below, above, share) = samples.time_sampling().bracket(time, samples.len());
        let mut values = self.sample(samples, below)?;
        if above != below && !samples.is_constant() {
            for (value, next) in values.iter_mut().zip(self.sample(samples, above)?) {
                *value += (next - *value) * share;
            }
        }
        let mut result = IDENTITY;
        let mut rest = &values[..];
        for &op in &self.ops {
            let (channels, after) = rest.split_at(op.channels()); // `sample` has checked the total
            result = multiply(&op.matrix(channels), &result);
            rest = after;
        }
        Ok(result)
    }

    fn sample(&self, samples: &Samples, index: usize) -> Result<Vec<f64>, AlembicError> {
        let values = samples.values::<f64>(index)?;
        let wanted: usize = self.ops.iter().map(|op| op.channels()).sum();
        if values.len() < wanted {
            let reason = format!("{} values where the operations need {wanted}", values.len());
            return Err(self.object.damaged(".xform/.vals", reason));
        }
        Ok(values)
    }
}

/// World matrix of `object` at `time` (s): its own transform, if it is one, and those above it as far as they inherit.
pub fn world_matrix_at(object: &Object, time: f64) -> Result<Matrix, AlembicError> {
    let mut world = IDENTITY;
    let mut next = Some(object.clone());
    while let Some(current) = next {
        if current.schema() == Schema::Xform {
            let xform = Xform::of(&current)?;
            world = multiply(&world, &xform.matrix_at(time)?);
            if !xform.inherits_at(time)? {
                break;
            }
        }
        next = current.parent();
    }
    Ok(world)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::transform_point;

    #[test]
    fn rotations_are_right_handed_for_row_vectors() {
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-15);
        assert!(close(transform_point([1., 0., 0.], &Op::RotateZ.matrix(&[90.])), [0., 1., 0.]));
        assert!(close(transform_point([0., 1., 0.], &Op::RotateX.matrix(&[90.])), [0., 0., 1.]));
        assert!(close(transform_point([0., 0., 1.], &Op::RotateY.matrix(&[90.])), [1., 0., 0.]));
        let third = Op::Rotate.matrix(&[2., 2., 2., 120.]);
        assert!(close(transform_point([1., 2., 3.], &third), [3., 1., 2.]));
    }
}
