//! Small scenes built in code, for the hard cases and for the project's tests.

use std::collections::BTreeMap;

use drapery_core::Vec3;
use drapery_core::mesh::PolygonMesh;
use drapery_core::scene::{
    BodyDescription, BodyShape, EffectRequest, GarmentDescription, PinAnchor, PinDescription, PinHold, PinTarget,
    RigidMotion, SceneDescription,
};

/// A flat rectangle of `nx` by `nz` cells in the plane y = 0, around the origin, `dx` apart [m].
pub fn sheet(nx: usize, nz: usize, dx: f64) -> PolygonMesh {
    let at = |i: usize, k: usize| (i + (nx + 1) * k) as u32;
    let mut points = Vec::new();
    let mut triangles = Vec::new();
    for k in 0..=nz {
        for i in 0..=nx {
            points.push(Vec3::new((i as f64 - 0.5 * nx as f64) * dx, 0.0, (k as f64 - 0.5 * nz as f64) * dx));
            if i < nx && k < nz {
                // Diagonals alternate, so that the sheet has no direction of its own.
                let (a, b, c, d) = (at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1));
                triangles.extend(if (i + k) % 2 == 0 { [[a, c, b], [a, d, c]] } else { [[a, d, b], [b, d, c]] });
            }
        }
    }
    PolygonMesh::from_triangles(points, &triangles)
}

/// A scene with one garment, at `fps` frames per second from frame 0.
pub fn scene_of(garment: GarmentDescription, fps: u32) -> SceneDescription {
    let mut description = SceneDescription::new("test");
    description.timeline.fps_numerator = fps;
    description.garments.push(garment);
    description
}

/// Adds gravity [m/s²].
pub fn add_gravity(description: &mut SceneDescription, acceleration: [f64; 3]) {
    description.effects.push(EffectRequest::of_scene("gravity").with_vector("acceleration", acceleration));
}

/// Adds a stretch effect with the authors' constant spring stiffness [N] to garment 0.
pub fn add_springs(description: &mut SceneDescription, stiffness: f64, damping_ratio: f64) {
    let request = EffectRequest::of_garment("stretch", 0);
    description.effects.push(request.with("spring_stiffness", stiffness).with("damping_ratio", damping_ratio));
}

/// Adds a body and the effect that it needs.
pub fn add_body(description: &mut SceneDescription, shape: BodyShape, motion: RigidMotion, friction: f64) {
    let name = format!("body{}", description.bodies.len());
    description.bodies.push(BodyDescription { friction, ..BodyDescription::new(&name, shape, motion) });
    if description.bodies.len() == 1 {
        description.effects.push(EffectRequest::of_scene("body_collision"));
    }
}

/// Pins vertices of garment 0 where they start.
pub fn add_pins(description: &mut SceneDescription, vertices: Vec<u32>) {
    description.pins.push(PinDescription {
        garment: 0,
        target: PinTarget::Path { anchor: PinAnchor::Start, vertices, offsets: Vec::new() },
        axes: [true; 3],
        from: f64::NEG_INFINITY,
        until: f64::INFINITY,
        hold: PinHold::Hard,
    });
    if description.pins.len() == 1 {
        description.effects.push(EffectRequest::of_scene("pins"));
    }
}

/// The unit ball as a closed surface of triangles, poles on y: triangles and points.
pub fn unit_ball(rings: usize, sectors: usize) -> (Vec<[u32; 3]>, Vec<Vec3>) {
    let mut points = vec![Vec3::y()];
    for r in 1..rings {
        let (sin, cos) = (std::f64::consts::PI * r as f64 / rings as f64).sin_cos();
        points.extend((0..sectors).map(|s| {
            let (east, north) = (std::f64::consts::TAU * s as f64 / sectors as f64).sin_cos();
            Vec3::new(sin * north, cos, -sin * east)
        }));
    }
    points.push(-Vec3::y());
    let last = points.len() as u32 - 1;
    let at = |r: usize, s: usize| (1 + (r - 1) * sectors + s % sectors) as u32;
    let mut triangles = Vec::new();
    for s in 0..sectors {
        triangles.push([0, at(1, s), at(1, s + 1)]);
        triangles.push([last, at(rings - 1, s + 1), at(rings - 1, s)]);
        for r in 1..rings - 1 {
            triangles.push([at(r, s), at(r + 1, s), at(r + 1, s + 1)]);
            triangles.push([at(r, s), at(r + 1, s + 1), at(r, s + 1)]);
        }
    }
    (triangles, points)
}

/// A closed box as a triangle mesh of `cells` by `cells` squares a side, counter-clockwise seen from outside.
pub fn box_mesh(half: Vec3, cells: i32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut numbers = BTreeMap::new();
    let mut points = Vec::new();
    let mut point = |lattice: [i32; 3]| {
        *numbers.entry(lattice).or_insert_with(|| {
            let share = lattice.map(|i| 2.0 * f64::from(i) / f64::from(cells) - 1.0);
            points.push(Vec3::from(share).component_mul(&half));
            points.len() as u32 - 1
        })
    };
    let mut triangles = Vec::new();
    for axis in 0..3 {
        for (side, k) in [(0, 0), (1, cells)] {
            for i in 0..cells {
                for j in 0..cells {
                    let mut at = |di: i32, dj: i32| {
                        let mut lattice = [0; 3];
                        (lattice[axis], lattice[(axis + 1) % 3], lattice[(axis + 2) % 3]) = (k, i + di, j + dj);
                        point(lattice)
                    };
                    let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                    triangles.extend(if side == 1 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] });
                }
            }
        }
    }
    (points, triangles)
}

/// A sheet of `cells` by `cells` squares of `dx` [m] that weighs 0.2 kg/m², with this membrane stiffness [N/m] and a
/// twentieth of it against bending.
pub fn cloth(cells: usize, dx: f64, stiffness: f64) -> SceneDescription {
    let mut description = scene_of(GarmentDescription::new("sheet", sheet(cells, cells, dx), 0.2), 24);
    add_cloth(&mut description, 0, stiffness);
    description
}

/// Stretch of this membrane stiffness [N/m], and a twentieth of it against bending.
pub fn add_cloth(description: &mut SceneDescription, garment: usize, stiffness: f64) {
    for (effect, stiffness) in [("stretch", stiffness), ("bending", 0.05 * stiffness)] {
        description.effects.push(EffectRequest::of_garment(effect, garment).with("stiffness", stiffness));
    }
}

/// Cloth that never passes through cloth.
pub fn add_self_contact(description: &mut SceneDescription) {
    for effect in ["self_repulsion", "self_collision"] {
        description.effects.push(EffectRequest::of_scene(effect));
    }
}

/// The gravity of the earth [m/s²].
pub const GRAVITY: f64 = 9.81;

/// Adds the gravity of the earth.
pub fn add_weight(description: &mut SceneDescription) {
    add_gravity(description, [0.0, -GRAVITY, 0.0]);
}

/// Numbers between -1 and 1 that look random, always the same for a seed.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The numbers of this seed.
    pub fn new(seed: u64) -> Self {
        // Any odd constant does; it keeps seed 0 from being a fixed point.
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    /// The next number, from -1 to 1.
    pub fn number(&mut self) -> f64 {
        2.0 * (self.bits() >> 11) as f64 / (1u64 << 53) as f64 - 1.0
    }

    /// One of `count` numbers from 0.
    pub fn pick(&mut self, count: usize) -> usize {
        (self.bits() >> 33) as usize % count.max(1)
    }

    /// A vector of three numbers from -1 to 1.
    pub fn vector(&mut self) -> Vec3 {
        Vec3::new(self.number(), self.number(), self.number())
    }

    fn bits(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
}

/// Adds the ground y = 0 with this friction.
pub fn add_floor(description: &mut SceneDescription, friction: f64) {
    let floor = BodyShape::Rigid(drapery_core::geometry::shapes::Shape::HalfSpace);
    add_body(description, floor, RigidMotion::at(Vec3::zeros()), friction);
}
