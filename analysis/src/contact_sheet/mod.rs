//! Contact sheets: pictures of a few frames of runs, drawn from their caches, all from one camera.

mod raster;

use std::collections::BTreeSet;

use drapery_core::Vec3;
use drapery_io::shot_description::ShotDescription;
use drapery_shot::run_record::folder::RunFolder;

use crate::drawn::bodies::{self, BodyMesh};
use crate::drawn::cloth::{self, COLOURS, Garment, simulated};
use crate::drawn::scene;
use crate::page::base64::encode;
use crate::page::text::escape;
use raster::{Picture, Surface, View, render};

/// Most frames on the sheet of one run.
const PICTURES: usize = 12;

/// Fewest frames on the sheet of one run that has as many, however large their pictures are.
const LEAST: usize = 6;

/// Width of a picture [pixels].
const WIDTH: usize = 340;

/// Bytes of all pictures of a sheet in the page.
const BUDGET: usize = 1_200_000;

/// Bodies larger than this many times the cloth are scenery: the picture does not have to hold them.
const SCENERY: f64 = 2.5;

/// Colour of bodies.
const BODY: [f64; 3] = [176.0, 174.0, 168.0];

/// Colour of the ground.
const GROUND: [f64; 3] = [172.0, 171.0, 166.0];

/// Garments and bodies of a run.
struct Cast {
    garments: Vec<Garment>,
    /// The scene with its bodies, where it can still be read.
    shot: Option<ShotDescription>,
}

/// Positions of a run at one frame [m].
struct Pose {
    /// Positions of each mesh of each garment.
    cloth: Vec<Vec<Vec<Vec3>>>,
    bodies: Vec<BodyMesh>,
}

/// A picture as a PNG file.
struct Png {
    bytes: Vec<u8>,
    size: [usize; 2],
}

/// The sheet of one run as a part of its page; empty when no cache can be read.
pub(crate) fn of_run(folder: &RunFolder) -> String {
    let cast = Cast::of(folder);
    let frames = spread(&cast.frames(), PICTURES);
    let pictures = draw(std::slice::from_ref(&cast), &frames).into_iter().flatten();
    let drawn: Vec<(i64, Png)> =
        frames.iter().zip(pictures).filter_map(|(frame, picture)| Some((*frame, picture?))).collect();
    if drawn.is_empty() {
        return String::new();
    }
    let cells: String =
        within_budget(drawn).iter().map(|(frame, picture)| figure(picture, *frame, &frame.to_string())).collect();
    format!("<section><h2>Contact sheet</h2>{}<div class=\"sheet\">{cells}</div></section>", legend(folder))
}

/// The sheet of several runs: each frame with the pictures of all runs, each under its name. Empty when no cache can be read.
pub(crate) fn of_runs(runs: &[(String, RunFolder)]) -> String {
    let casts: Vec<Cast> = runs.iter().map(|(_, folder)| Cast::of(folder)).collect();
    let frames: BTreeSet<i64> = casts.iter().flat_map(Cast::frames).collect();
    let frames: Vec<i64> = frames.into_iter().collect();
    let most = (PICTURES / runs.len().max(1)).clamp(1, LEAST);
    // Runs differ once the cloth has moved: the sheet ends with the last frame, and leaves out the first.
    let mut chosen = spread(&frames, most + 1);
    if chosen.len() > most {
        chosen.remove(0);
    }
    let pictures = draw(&casts, &chosen);
    let mut sheet = String::new();
    for (index, frame) in chosen.iter().enumerate() {
        let cell = |((name, _), drawn): (&(String, RunFolder), &Vec<Option<Png>>)| match &drawn[index] {
            Some(picture) => figure(picture, *frame, name),
            None => format!("<figure><figcaption>{}: no such frame</figcaption></figure>", escape(name)),
        };
        let cells: String = runs.iter().zip(&pictures).map(cell).collect();
        sheet += &format!("<h3>frame {frame}</h3><div class=\"sheet\">{cells}</div>");
    }
    match runs.first() {
        Some((_, first)) if !sheet.is_empty() => {
            format!("<section><h2>Contact sheet</h2>{}{sheet}</section>\n", legend(first))
        }
        _ => String::new(),
    }
}

/// Colours of the garments of a run, and of bodies.
fn legend(folder: &RunFolder) -> String {
    let keys = simulated(folder).zip(COLOURS.iter().cycle()).map(|(garment, [r, g, b])| {
        format!("<li><i style=\"background:rgb({r},{g},{b})\"></i>{}</li>", escape(&garment.name))
    });
    let keys: String = keys.collect();
    format!("<ul class=\"legend\">{keys}<li><i class=\"body\"></i>bodies</li></ul>")
}

impl Cast {
    /// Opens the caches of a run. Those that cannot be read have no pictures; `drapery verify` says why.
    fn of(folder: &RunFolder) -> Self {
        let garments = cloth::garments(folder).into_iter().filter_map(Result::ok).collect();
        Self { garments, shot: scene(folder).ok() }
    }

    /// Frames that every garment has.
    fn frames(&self) -> Vec<i64> {
        cloth::common_frames(&self.garments)
    }

    /// The cloth at a frame; `None` if it cannot be read.
    fn pose(&self, frame: i64) -> Option<Pose> {
        let cloth: Vec<Vec<Vec<Vec3>>> =
            self.garments.iter().map(|garment| garment.positions(frame).ok()).collect::<Option<_>>()?;
        (!cloth.is_empty()).then_some(Pose { cloth, bodies: Vec::new() })
    }

    /// All bodies at a frame; those that cannot be read are left out. `around` are middle and size of the cloth [m].
    fn bodies(&self, frame: i64, around: (Vec3, f64)) -> Vec<BodyMesh> {
        let of_shot = |shot: &ShotDescription| {
            let bodies = 0..shot.scene.bodies.len();
            bodies.filter_map(|body| bodies::at(shot, body, frame, around).ok().flatten()).collect()
        };
        self.shot.as_ref().map_or(Vec::new(), of_shot)
    }

    fn picture(&self, pose: &Pose, view: &View) -> Option<Png> {
        let cloth = self.garments.iter().zip(&pose.cloth).flat_map(|(garment, meshes)| {
            garment.cache.meshes.iter().zip(meshes).map(|(mesh, positions)| Surface {
                positions,
                triangles: &mesh.triangles,
                colour: garment.colour.map(f64::from),
                solid: false,
            })
        });
        let bodies = pose.bodies.iter().map(|mesh| Surface {
            positions: &mesh.positions,
            triangles: &mesh.triangles,
            colour: if mesh.is_ground { GROUND } else { BODY },
            solid: true,
        });
        png(&render(view, &bodies.chain(cloth).collect::<Vec<_>>()))
    }
}

/// A few of many, evenly, with the first and the last.
fn spread(frames: &[i64], most: usize) -> Vec<i64> {
    let count = frames.len().min(most);
    let index = |i: usize| if count < 2 { 0 } else { i * (frames.len() - 1) / (count - 1) };
    (0..count).map(|i| frames[index(i)]).collect()
}

/// Draws the frames of each run, all from the same place; `None` for a frame that cannot be read.
fn draw(casts: &[Cast], frames: &[i64]) -> Vec<Vec<Option<Png>>> {
    let mut poses: Vec<Vec<Option<Pose>>> =
        casts.iter().map(|cast| frames.iter().map(|frame| cast.pose(*frame)).collect()).collect();
    let cloth = poses.iter().flatten().flatten().flat_map(|pose| pose.cloth.iter().flatten().flatten());
    let mut points: Vec<Vec3> = cloth.filter(|p| p.iter().all(|x| x.is_finite())).copied().collect();
    let subject = View::fitting(&points, WIDTH).subject();
    for (cast, poses) in casts.iter().zip(&mut poses) {
        for (frame, pose) in frames.iter().zip(poses) {
            pose.iter_mut().for_each(|pose| pose.bodies = cast.bodies(*frame, subject));
        }
    }
    let near = |p: &Vec3| (*p - subject.0).norm() < SCENERY * subject.1;
    for mesh in poses.iter().flatten().flatten().flat_map(|pose| &pose.bodies).filter(|mesh| !mesh.is_ground) {
        if mesh.positions.iter().all(near) {
            points.extend(&mesh.positions);
        }
    }
    let view = View::fitting(&points, WIDTH);
    let of_cast = |(cast, poses): (&Cast, &Vec<Option<Pose>>)| {
        poses.iter().map(|pose| cast.picture(pose.as_ref()?, &view)).collect()
    };
    casts.iter().zip(&poses).map(of_cast).collect()
}

/// Pictures, evenly spread, that are small enough together.
fn within_budget(pictures: Vec<(i64, Png)>) -> Vec<(i64, Png)> {
    let indices: Vec<i64> = (0..pictures.len() as i64).collect();
    let size =
        |chosen: &[i64]| -> usize { chosen.iter().map(|i| pictures[*i as usize].1.bytes.len().div_ceil(3) * 4).sum() };
    let mut chosen = indices.clone();
    while chosen.len() > LEAST && size(&chosen) > BUDGET {
        chosen = spread(&indices, chosen.len() - 1);
    }
    let is_chosen = |index: i64| chosen.binary_search(&index).is_ok();
    indices.iter().zip(pictures).filter(|(index, _)| is_chosen(**index)).map(|(_, picture)| picture).collect()
}

fn figure(Png { bytes, size: [width, height] }: &Png, frame: i64, caption: &str) -> String {
    format!(
        "<figure><img src=\"data:image/png;base64,{}\" width=\"{width}\" height=\"{height}\" \
         alt=\"cloth at frame {frame}\"><figcaption>{}</figcaption></figure>",
        encode(bytes),
        escape(caption)
    )
}

/// The picture as a PNG file; `None` if it cannot be one, such as without any pixel.
fn png(picture: &Picture) -> Option<Png> {
    let mut bytes = Vec::new();
    let (width, height) = (u32::try_from(picture.width).ok()?, u32::try_from(picture.height).ok()?);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&picture.pixels).ok()?;
    writer.finish().ok()?;
    Some(Png { bytes, size: [picture.width, picture.height] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_evenly_with_the_first_and_the_last() {
        let frames: Vec<i64> = (1001..=1100).collect();
        let chosen = spread(&frames, 12);
        assert_eq!((chosen.len(), chosen[0], chosen[11]), (12, 1001, 1100));
        assert!(chosen.windows(2).all(|pair| (8..=10).contains(&(pair[1] - pair[0]))), "{chosen:?}");
        assert_eq!(spread(&frames[..3], 12), [1001, 1002, 1003]);
        assert_eq!(spread(&frames[..1], 12), [1001]);
        assert!(spread(&[], 12).is_empty());
    }

    #[test]
    fn pictures_that_are_too_large_make_a_shorter_sheet() {
        let pictures = |bytes: usize| {
            (0..12).map(|frame| (frame, Png { bytes: vec![0; bytes], size: [1, 1] })).collect::<Vec<_>>()
        };
        assert_eq!(within_budget(pictures(1000)).len(), 12);
        let kept: Vec<i64> = within_budget(pictures(120_000)).into_iter().map(|(frame, _)| frame).collect();
        assert_eq!(kept, [0, 1, 3, 5, 7, 9, 11]); // seven of 160 000 letters each
        assert_eq!(within_budget(pictures(900_000)).len(), LEAST);
    }

    #[test]
    fn a_picture_becomes_a_file_that_decodes_to_the_same_pixels() {
        let picture = Picture { width: 3, height: 2, pixels: (0..24).collect() };
        let file = png(&picture).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file.bytes)).read_info().unwrap();
        let mut pixels = vec![0; 24];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, picture.pixels);
    }
}
