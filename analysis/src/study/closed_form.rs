//! Results that a scene must reach by a formula, where there is one: cloth in free flight, and cloth that slides on
//! an inclined plane. Whatever the cloth does within itself, its centre of mass follows these.

use drapery_core::Vec3;
use drapery_core::effects::{body_collision, find as find_effect, gravity};
use drapery_core::geometry::shapes::Shape;
use drapery_core::scene::{BodyShape, SceneDescription};
use drapery_core::simulation::Simulation;

use crate::study::record::{ClosedForm, Sample, Study};

/// Whether an effect moves no centre of mass but as gravity does.
pub(super) fn is_internal(effect: &str) -> bool {
    find_effect(effect).is_some_and(|spec| spec.study.is_internal)
}

/// Cloth lies on a plane if no vertex is farther from it than its thickness and this share of the cloth's size.
const ON_PLANE: f64 = 1e-4;

/// The closed forms of a scene, of which `simulation` is the start; `size` is that of the cloth [m].
pub(super) fn find(scene: &SceneDescription, simulation: &Simulation, size: f64) -> Vec<ClosedForm> {
    let plan = simulation.plan();
    let weight = plan.iter().find(|effect| effect.name == gravity::SPEC.name);
    let acceleration = weight.map_or(Vec3::zeros(), |effect| Vec3::from(effect.settings.vector("acceleration")));
    let others: Vec<&str> = plan.iter().map(|effect| effect.name).filter(|name| !is_internal(name)).collect();
    // Of garments that start with different velocities each would have its own centre.
    let velocity = scene.garments.first().map_or(Vec3::zeros(), |garment| garment.velocity);
    let alike = |garment: &drapery_core::scene::GarmentDescription| {
        garment.velocity == velocity && garment.start_velocities.is_none()
    };
    if !scene.garments.iter().all(alike) || !scene.pins.is_empty() {
        return Vec::new();
    }
    let centre = centre_of(simulation);
    match (scene.bodies.as_slice(), others.as_slice()) {
        ([], []) => flight(acceleration, velocity, centre).into_iter().collect(),
        ([plane], [only]) if *only == body_collision::SPEC.name => {
            let at_rest = plane.motion.path.len() <= 1 && plane.motion.angular_velocity == Vec3::zeros();
            if !matches!(plane.shape, BodyShape::Rigid(Shape::HalfSpace)) || !at_rest {
                return Vec::new();
            }
            let normal = plane.motion.rotation * Vec3::y();
            let origin = plane.motion.path.first().map_or(Vec3::zeros(), |(_, place)| *place);
            let reach = plane.thickness + ON_PLANE * size;
            let lies = simulation.state().x.iter().all(|x| normal.dot(&(x - origin)) <= reach);
            let slide = slide(acceleration, velocity, normal, plane.friction, centre);
            slide.filter(|_| lies).into_iter().collect()
        }
        _ => Vec::new(),
    }
}

/// Centre of mass of a simulation on one rank [m].
fn centre_of(simulation: &Simulation) -> Vec3 {
    let masses = simulation.scene().masses();
    let weighted: Vec3 = simulation.state().x.iter().zip(masses).map(|(x, mass)| x * *mass).sum();
    weighted / masses.iter().sum::<f64>().max(f64::MIN_POSITIVE)
}

/// The way along the acceleration: speed and half the acceleration by the square of time.
fn flight(acceleration: Vec3, velocity: Vec3, start: Vec3) -> Option<ClosedForm> {
    let direction = acceleration.try_normalize(f64::MIN_POSITIVE)?;
    Some(ClosedForm {
        name: "fall of the centre of mass".to_owned(),
        start: start.into(),
        direction: direction.into(),
        speed: velocity.dot(&direction),
        acceleration: acceleration.norm(),
    })
}

/// The way down an inclined plane with Coulomb's friction, from rest or with a speed down the plane.
fn slide(acceleration: Vec3, velocity: Vec3, normal: Vec3, friction: f64, start: Vec3) -> Option<ClosedForm> {
    let press = -acceleration.dot(&normal);
    let along = acceleration + normal * press;
    let direction = along.try_normalize(f64::MIN_POSITIVE)?;
    let speed = velocity.dot(&direction);
    // A start across the slope or off the plane is another motion.
    if press <= 0.0 || (velocity - direction * speed).norm() > f64::EPSILON * velocity.norm() * 8.0 || speed < 0.0 {
        return None;
    }
    let net = along.norm() - friction * press;
    Some(ClosedForm {
        name: "slide of the centre of mass down the plane".to_owned(),
        start: start.into(),
        direction: direction.into(),
        speed,
        acceleration: if speed == 0.0 { net.max(0.0) } else { net },
    })
}

impl ClosedForm {
    /// The way after a time [s] [m]. What friction has brought to rest stays there.
    pub fn exact(&self, time: f64) -> f64 {
        let stop = if self.acceleration < 0.0 { -self.speed / self.acceleration } else { f64::INFINITY };
        let time = time.min(stop);
        self.speed * time + 0.5 * self.acceleration * time * time
    }

    /// Exact way and that of a run at the last compared frame [m].
    pub fn compare(&self, study: &Study, sample: &Sample) -> Option<[f64; 2]> {
        let (frame, figures) = (study.compared.last()?, sample.figures.last()?);
        let (start, direction) = (Vec3::from(self.start), Vec3::from(self.direction));
        Some([self.exact(study.time(*frame)), (Vec3::from(figures.centre) - start).dot(&direction)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(degrees: f64, friction: f64, speed: f64) -> ClosedForm {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        let velocity = Vec3::new(cosine, -sine, 0.0) * speed;
        let gravity = Vec3::new(0.0, -9.8, 0.0);
        slide(gravity, velocity, Vec3::new(sine, cosine, 0.0), friction, Vec3::zeros()).unwrap()
    }

    #[test]
    fn cloth_on_an_incline_goes_as_far_as_coulomb_says() {
        // 9.8 (sin 36° - 0.6 cos 36°) / 2 = 0.50164 in the first second.
        assert!((plane(36.0, 0.6, 0.0).exact(1.0) - 0.501638).abs() < 1e-5);
        assert_eq!(plane(36.0, 0.8, 0.0).exact(1.0), 0.0);
        // 1 m/s against 9.8 (cos 36° - sin 36°) = 2.168 m/s²: stops after 1/2/2.168 = 0.23062 m.
        let stopping = plane(36.0, 1.0, 1.0);
        assert!((stopping.exact(5.0) - 0.230620).abs() < 1e-5 && stopping.exact(5.0) == stopping.exact(9.0));
    }

    #[test]
    fn free_flight_is_a_parabola() {
        let fall = flight(Vec3::new(0.0, -10.0, 0.0), Vec3::new(3.0, 2.0, 0.0), Vec3::zeros()).unwrap();
        assert!((fall.exact(2.0) - (20.0 - 4.0)).abs() < 1e-12);
        assert!(flight(Vec3::zeros(), Vec3::x(), Vec3::zeros()).is_none());
    }
}
