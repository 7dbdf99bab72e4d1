//! Words shared by geometry readers and writers: scopes, interpretations, visibility, bounds, matrices.

/// Axis-aligned box: least x, y, z, then greatest x, y, z.
pub type Bounds = [f64; 6];

/// The box of nothing.
pub const EMPTY_BOUNDS: Bounds = [f64::MAX, f64::MAX, f64::MAX, -f64::MAX, -f64::MAX, -f64::MAX];

/// 4×4 matrix, row by row, for row vectors: `p' = p M`, translation in elements 12..=14.
pub type Matrix = [f64; 16];

/// The matrix that changes nothing.
pub const IDENTITY: Matrix = [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1.];

/// `a b`: for row vectors, the map that applies `a` first.
pub fn multiply(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| (0..4).map(|k| a[i / 4 * 4 + k] * b[k * 4 + i % 4]).sum())
}

/// `p M` for a point, without the projective division (transforms of scenes are affine).
pub fn transform_point(p: [f64; 3], m: &Matrix) -> [f64; 3] {
    std::array::from_fn(|i| p[0] * m[i] + p[1] * m[4 + i] + p[2] * m[8 + i] + m[12 + i])
}

/// Box of `positions`; [`EMPTY_BOUNDS`] when there are none. Positions that are not finite are left out.
pub(crate) fn bounds_of(positions: &[[f32; 3]]) -> Bounds {
    let mut bounds = EMPTY_BOUNDS;
    for p in positions {
        for axis in 0..3 {
            let x = f64::from(p[axis]);
            bounds[axis] = bounds[axis].min(x);
            bounds[axis + 3] = bounds[axis + 3].max(x);
        }
    }
    bounds
}

/// Part of the object that one value of a geometry parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// One value for the whole object.
    Constant,
    /// One value a face.
    Uniform,
    /// One value a vertex, for parametric surfaces.
    Varying,
    /// One value a vertex.
    Vertex,
    /// One value a face corner.
    FaceVarying,
}

impl Scope {
    /// Its spelling in metadata.
    pub fn name(self) -> &'static str {
        match self {
            Scope::Constant => "con",
            Scope::Uniform => "uni",
            Scope::Varying => "var",
            Scope::Vertex => "vtx",
            Scope::FaceVarying => "fvr",
        }
    }

    /// The scope with this spelling; anything else is constant, as in the official library.
    pub fn from_name(name: &str) -> Self {
        [Scope::Uniform, Scope::Varying, Scope::Vertex, Scope::FaceVarying]
            .into_iter()
            .find(|scope| scope.name() == name)
            .unwrap_or(Scope::Constant)
    }
}

/// Meaning of the numbers of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)] // the names say all
pub enum Interpretation {
    Plain,
    Point,
    Vector,
    Normal,
    Rgb,
    Rgba,
    Matrix,
    Quaternion,
}

impl Interpretation {
    /// Its spelling in metadata; empty for plain numbers.
    pub fn name(self) -> &'static str {
        match self {
            Interpretation::Plain => "",
            Interpretation::Point => "point",
            Interpretation::Vector => "vector",
            Interpretation::Normal => "normal",
            Interpretation::Rgb => "rgb",
            Interpretation::Rgba => "rgba",
            Interpretation::Matrix => "matrix",
            Interpretation::Quaternion => "quat",
        }
    }
}

/// Value of an object's `visible` property.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visibility {
    /// As the parent.
    Inherited,
    /// Not shown.
    Hidden,
    /// Shown.
    Visible,
}

impl Visibility {
    /// The stored number.
    pub fn value(self) -> i8 {
        match self {
            Visibility::Inherited => -1,
            Visibility::Hidden => 0,
            Visibility::Visible => 1,
        }
    }

    /// Meaning of a stored number.
    pub fn from_value(value: i8) -> Self {
        match value {
            0 => Visibility::Hidden,
            1.. => Visibility::Visible,
            _ => Visibility::Inherited,
        }
    }
}
