//! Wind on a grid from an HDF5 file, read sample by sample (`docs/reference/wind_grid.md`).
//!
//! | dataset | shape | content |
//! |---|---|---|
//! | `origin` | (3) | place of the first node [m], Y up |
//! | `spacing` | (3) | distance between nodes along x, y and z [m] |
//! | `times` | (samples) | frame / fps [s], ascending |
//! | `velocity` | (samples, z, y, x, 3) | velocity of the air [m/s], Y up |

use std::path::{Path, PathBuf};

use drapery_core::Vec3;
use drapery_core::error::Problem;
use drapery_core::scene::{FARTHEST, Timeline, WindGridShape, is_possible};
use drapery_core::wind_grid::WindSample;
use hdf5::{Dataset, Hyperslab};

use crate::error::IoError;
use crate::formats::hdf5::datasets;
use crate::input_file;

/// Times closer than this share of a sample step are the same: programs round frame / fps differently.
const SAME_SAMPLE: f64 = 1e-3;

/// Advice on the content that a file of wind has to hold.
const ADVICE: &str = "write the datasets origin (3), spacing (3), times (samples) and velocity (samples, z, y, x, 3), in \
                      metres and seconds with Y up; see docs/reference/wind_grid.md";

/// An opened file of wind.
#[derive(Debug)]
pub struct WindFile {
    path: PathBuf,
    shape: WindGridShape,
    times: Vec<f64>,
    velocity: Dataset,
}

impl WindFile {
    /// Opens the file and checks all but the velocities.
    ///
    /// # Errors
    /// The file is missing, is not HDF5, or its datasets are not those of wind.
    pub fn open(path: &Path) -> Result<Self, IoError> {
        // The library's own message for a missing file is long and says little.
        input_file::check_for_hdf5(path)?;
        let damaged = |error: hdf5::Error| IoError::data(path, "HDF5", error.to_string(), ADVICE);
        let file = hdf5::File::open(path).map_err(damaged)?;
        let numbers = |name: &str| {
            let dataset = file.dataset(name)?;
            datasets::check_stored(&dataset)?;
            dataset.read_raw::<f64>()
        };
        let [origin, spacing, times] = [numbers("origin"), numbers("spacing"), numbers("times")];
        let (origin, spacing, times) = (origin.map_err(damaged)?, spacing.map_err(damaged)?, times.map_err(damaged)?);
        let velocity = file.dataset("velocity").map_err(damaged)?;
        datasets::check_stored(&velocity).map_err(damaged)?;
        let wrong = |place: &str, what: String| Err(IoError::data(path, place, what, ADVICE));
        let vector = |numbers: &[f64]| {
            let vector = <[f64; 3]>::try_from(numbers).ok().map(Vec3::from);
            vector.filter(is_possible)
        };
        let Some(origin) = vector(&origin) else {
            return wrong("`origin`", format!("it is not three numbers up to {FARTHEST:e} m"));
        };
        let Some(spacing) = vector(&spacing).filter(|s| s.iter().all(|c| *c > 0.0)) else {
            return wrong("`spacing`", format!("it is not three numbers above zero and up to {FARTHEST:e} m"));
        };
        if times.is_empty() || times.windows(2).any(|w| w[0] >= w[1]) || times.iter().any(|t| !t.is_finite()) {
            return wrong("`times`", "they do not increase".into());
        }
        let counts = match velocity.shape().as_slice() {
            &[samples, z, y, x, 3] if samples == times.len() && x > 0 && y > 0 && z > 0 => [x, y, z],
            other => return wrong("`velocity`", format!("its shape is {other:?} with {} times", times.len())),
        };
        let shape = WindGridShape { origin, spacing, counts };
        Ok(Self { path: path.to_owned(), shape, times, velocity })
    }

    /// Returns the origin, the spacing and the numbers of nodes of the grid.
    pub fn shape(&self) -> WindGridShape {
        self.shape
    }

    /// Samples that lead from the frame before to `frame`, in solver time: those of the file inside the frame, and one exactly
    /// at its end. Before the first frame the wind is that of the first frame.
    ///
    /// # Errors
    /// The file is damaged.
    pub fn samples(&self, timeline: Timeline, frame: i64) -> Result<Vec<WindSample>, IoError> {
        let origin = timeline.file_time(timeline.origin);
        let mut samples = Vec::new();
        if frame > timeline.origin {
            let (from, to) = (timeline.file_time(frame - 1), timeline.file_time(frame));
            let margin = self.margin();
            for (number, time) in self.times.iter().enumerate() {
                if *time > from + margin && *time < to - margin {
                    samples.push(WindSample { time: time - origin, velocities: self.sample(number)? });
                }
            }
        }
        let velocities = self.at(timeline.file_time(frame.max(timeline.origin)))?;
        samples.push(WindSample { time: timeline.time(frame), velocities });
        Ok(samples)
    }

    /// Finds a fault of the samples that the frames up to `last_frame` use.
    pub fn check(&self, timeline: Timeline, last_frame: i64) -> Option<Problem> {
        let (first, last) = (timeline.file_time(timeline.origin), timeline.file_time(last_frame));
        let place = format!("wind ({})", self.path.display());
        let margin = self.margin();
        let covered = [self.times[0], self.times[self.times.len() - 1]];
        // A single sample is wind that does not change.
        if self.times.len() > 1 && (covered[0] > first + margin || covered[1] < last - margin) {
            let what = format!(
                "its samples cover {} s to {} s, but the simulation needs {first} s to {last} s (frame / fps)",
                covered[0], covered[1]
            );
            return Some(Problem::data(place, what, "write the whole range, or choose frames inside it"));
        }
        let used = |w: usize| {
            let after = self.times.get(w + 1).is_none_or(|next| *next > first - margin);
            let before = w == 0 || self.times[w - 1] < last + margin;
            after && before
        };
        for number in (0..self.times.len()).filter(|number| used(*number)) {
            let place = || format!("{place}, sample {number} at {} s", self.times[number]);
            match self.sample(number) {
                Err(error) => return Some(Problem::data(place(), error.to_string(), ADVICE)),
                Ok(velocities) => {
                    if let Some(node) = velocities.iter().position(|v| !is_possible(v)) {
                        let [x, y, _] = self.shape.counts;
                        let (i, j, k) = (node % x, node / x % y, node / (x * y));
                        let what = format!(
                            "the velocity at node x {i}, y {j}, z {k} is not finite, or above {FARTHEST:e} m/s"
                        );
                        return Some(Problem::data(
                            place(),
                            what,
                            "write the file again with finite numbers within this bound",
                        ));
                    }
                }
            }
        }
        None
    }

    /// Velocities at a time of the file [m/s]: linear between samples, held outside.
    fn at(&self, time: f64) -> Result<Vec<Vec3>, IoError> {
        let margin = self.margin();
        let next = self.times.partition_point(|t| *t < time - margin);
        if next == 0 || next == self.times.len() || self.times[next] <= time + margin {
            return self.sample(next.min(self.times.len() - 1));
        }
        let (a, b) = (self.times[next - 1], self.times[next]);
        let share = (time - a) / (b - a);
        let (low, high) = (self.sample(next - 1)?, self.sample(next)?);
        Ok(low.iter().zip(&high).map(|(low, high)| low.lerp(high, share)).collect())
    }

    fn margin(&self) -> f64 {
        match self.times.as_slice() {
            [first, .., last] => SAME_SAMPLE * (last - first) / (self.times.len() - 1) as f64,
            _ => SAME_SAMPLE,
        }
    }

    /// One sample, x fastest.
    fn sample(&self, number: usize) -> Result<Vec<Vec3>, IoError> {
        let slab = Hyperslab::from((number..number + 1, .., .., .., ..));
        let read = like(|dataset| dataset.read_dyn(), self.velocity.read_slice(slab));
        let numbers: Vec<f64> = read
            .map_err(|error| IoError::data(&self.path, format!("sample {number}"), error.to_string(), ADVICE))?
            .into_iter()
            .collect();
        Ok(numbers.as_chunks::<3>().0.iter().map(|v| Vec3::from(*v)).collect())
    }
}

/// The value, of the type that the function would give: names the library's arrays of any rank without depending on the crate
/// that they come from.
fn like<T>(_: fn(&Dataset) -> hdf5::Result<T>, value: hdf5::Result<T>) -> hdf5::Result<T> {
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two samples of a grid of 2 × 3 × 4 nodes: velocities [x, y, t], at frames 10 and 12 of 24 a second.
    fn write(path: &Path, change: impl Fn(&mut Vec<f32>)) {
        let file = hdf5::File::create(path).unwrap();
        let put = |name: &str, values: &[f64]| {
            let dataset = file.new_dataset::<f64>().shape(values.len()).create(name).unwrap();
            dataset.write_raw(values).unwrap();
        };
        put("origin", &[-1.0, 0.0, 2.0]);
        put("spacing", &[0.5, 0.5, 1.0]);
        put("times", &[10.0 / 24.0, 12.0 / 24.0]);
        let mut values = Vec::new();
        for sample in 0..2 {
            for node in 0..24 {
                values.extend([(node % 2) as f32, (node / 2 % 3) as f32, sample as f32]);
            }
        }
        change(&mut values);
        let dataset =
            file.new_dataset::<f32>().chunk((1, 2, 3, 2, 3)).shape((2, 4, 3, 2, 3)).create("velocity").unwrap();
        dataset.write_raw(&values).unwrap();
    }

    #[test]
    fn samples_are_read_in_the_order_of_the_grid_and_between_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wind.h5");
        write(&path, |_| {});
        let wind = WindFile::open(&path).unwrap();
        assert_eq!(wind.shape().counts, [2, 3, 4]);
        let timeline = Timeline { origin: 10, start: 8, ..Timeline::default() };
        assert!(wind.check(timeline, 12).is_none());
        let at = |frame| wind.samples(timeline, frame).unwrap();
        // Node x 1, y 2, z 0.
        assert_eq!(at(8)[0].velocities[5], Vec3::new(1.0, 2.0, 0.0));
        assert_eq!(at(8)[0].time, -2.0 / 24.0);
        assert!((at(11)[0].velocities[5] - Vec3::new(1.0, 2.0, 0.5)).norm() < 1e-14);
        assert_eq!((at(12).len(), at(12)[0].velocities[23]), (1, Vec3::new(1.0, 2.0, 1.0)));
        let beyond = wind.check(timeline, 14).unwrap();
        assert!(beyond.what.contains("samples cover"), "{}", beyond.what);
    }

    #[test]
    fn broken_files_of_wind_say_what_is_wrong() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wind.h5");
        assert!(matches!(WindFile::open(&path), Err(IoError::Missing { .. })));
        std::fs::write(&path, "wind").unwrap();
        assert!(WindFile::open(&path).is_err());
        write(&path, |values| values[3 * (24 + 7) + 1] = f32::NAN);
        let problem =
            WindFile::open(&path).unwrap().check(Timeline { origin: 10, start: 10, ..Timeline::default() }, 12);
        let problem = problem.unwrap();
        assert!(problem.place.contains("sample 1") && problem.what.contains("x 1, y 0, z 1"), "{problem:?}");
        let file = hdf5::File::append(&path).unwrap();
        file.unlink("spacing").unwrap();
        drop(file);
        assert!(WindFile::open(&path).unwrap_err().to_string().contains("spacing"));
    }
}
