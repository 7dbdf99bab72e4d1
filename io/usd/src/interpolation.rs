//! Part of the mesh that one value of a primvar belongs to, read and written.

/// Part of the mesh that one value of a primvar belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interpolation {
    /// The whole mesh.
    Constant,
    /// A face.
    Uniform,
    /// A point, blended linearly on subdivision surfaces.
    Varying,
    /// A point.
    Vertex,
    /// A corner of a face, counter-clockwise seen from outside.
    FaceVarying,
}

impl Interpolation {
    const ALL: [Self; 5] = [Self::Constant, Self::Uniform, Self::Varying, Self::Vertex, Self::FaceVarying];

    /// USD's word for it.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Constant => "constant",
            Self::Uniform => "uniform",
            Self::Varying => "varying",
            Self::Vertex => "vertex",
            Self::FaceVarying => "faceVarying",
        }
    }

    /// The interpolation with this word; anything else is constant, as in USD.
    pub(crate) fn named(word: &str) -> Self {
        Self::ALL.into_iter().find(|interpolation| interpolation.word() == word).unwrap_or(Self::Constant)
    }
}
