//! Pictures of a few frames, drawn from the caches.

use drapery_core::Vec3;
use drapery_io::shot_description::ShotDescription;
use drapery_shot::run_record::folder::RunFolder;

use super::raster::{Picture, Surface, View, render};
use crate::drawn::bodies::{self, BodyMesh};
use crate::drawn::cloth::{self, COLOURS, Garment, simulated};
use crate::drawn::scene;
use crate::page::base64::encode;
use crate::page::text::escape;

/// Frames that are shown at most.
const PICTURES: usize = 12;

/// Frames that are shown at least, if there are as many, however large their pictures are.
const LEAST: usize = 6;

/// Pixels across a picture.
const WIDTH: usize = 340;

/// Bytes that all pictures together may take in the page.
const BUDGET: usize = 1_200_000;

/// Bodies larger than this many times the cloth are scenery: the picture does not have to hold them.
const SCENERY: f64 = 2.5;

/// Colour of bodies.
const BODY: [f64; 3] = [176.0, 174.0, 168.0];

/// Colour of the ground.
const GROUND: [f64; 3] = [172.0, 171.0, 166.0];

/// The sheet as a part of the page; empty when no cache can be read.
pub(super) fn sheet(folder: &RunFolder) -> String {
    // Caches that cannot be read have no pictures; `drapery verify` says why.
    let garments: Vec<Garment> = cloth::garments(folder).into_iter().filter_map(Result::ok).collect();
    let chosen = spread(&cloth::common_frames(&garments), PICTURES);
    if chosen.is_empty() {
        return String::new();
    }
    let pictures = within_budget(draw(folder, &garments, &chosen));
    let cells: String = pictures.iter().map(|(frame, picture)| cell(*frame, picture)).collect();
    let keys = simulated(folder).zip(COLOURS.iter().cycle()).map(|(garment, [r, g, b])| {
        format!("<li><i style=\"background:rgb({r},{g},{b})\"></i>{}</li>", escape(&garment.name))
    });
    let keys: String = keys.collect();
    format!(
        "<section><h2>Contact sheet</h2><ul class=\"legend\">{keys}<li><i class=\"body\"></i>bodies</li></ul>\
         <div class=\"sheet\">{cells}</div></section>"
    )
}

/// A few of many, evenly, with the first and the last.
fn spread(frames: &[i64], most: usize) -> Vec<i64> {
    let count = frames.len().min(most);
    let index = |i: usize| if count < 2 { 0 } else { i * (frames.len() - 1) / (count - 1) };
    (0..count).map(|i| frames[index(i)]).collect()
}

/// One picture a frame, all from the same place; frames that cannot be read are left out.
fn draw(folder: &RunFolder, garments: &[Garment], frames: &[i64]) -> Vec<(i64, Vec<u8>, [usize; 2])> {
    let mut poses = Vec::new();
    for &frame in frames {
        let all: Option<Vec<Vec<Vec<Vec3>>>> = garments.iter().map(|garment| garment.positions(frame).ok()).collect();
        poses.extend(all.map(|all| (frame, all)));
    }
    let shot = scene(folder).ok();
    let mut points: Vec<Vec3> = poses.iter().flat_map(|(_, pose)| pose.iter().flatten().flatten()).copied().collect();
    points.retain(|p| p.iter().all(|x| x.is_finite()));
    let subject = View::fitting(&points, WIDTH).subject();
    let meshes: Vec<Vec<BodyMesh>> = poses
        .iter()
        .map(|(frame, _)| shot.as_ref().map_or(Vec::new(), |shot| bodies_at(shot, *frame, subject)))
        .collect();
    let near = |p: &&Vec3| (**p - subject.0).norm() < SCENERY * subject.1;
    for mesh in meshes.iter().flatten().filter(|mesh| !mesh.is_ground) {
        if mesh.positions.iter().all(|p| near(&p)) {
            points.extend(&mesh.positions);
        }
    }
    let view = View::fitting(&points, WIDTH);
    let mut pictures = Vec::new();
    for ((frame, pose), bodies) in poses.iter().zip(&meshes) {
        let cloth = garments.iter().zip(pose).flat_map(|(garment, pose)| {
            garment.cache.meshes.iter().zip(pose).map(|(mesh, positions)| Surface {
                positions,
                triangles: &mesh.triangles,
                colour: garment.colour.map(f64::from),
                solid: false,
            })
        });
        let body = |mesh: &'_ BodyMesh| if mesh.is_ground { GROUND } else { BODY };
        let bodies = bodies.iter().map(|mesh| Surface {
            positions: &mesh.positions,
            triangles: &mesh.triangles,
            colour: body(mesh),
            solid: true,
        });
        let picture = render(&view, &bodies.chain(cloth).collect::<Vec<_>>());
        pictures.extend(png(&picture).map(|bytes| (*frame, bytes, [picture.width, picture.height])));
    }
    pictures
}

/// All bodies at a frame; those that cannot be read are left out.
fn bodies_at(shot: &ShotDescription, frame: i64, around: (Vec3, f64)) -> Vec<BodyMesh> {
    let bodies = 0..shot.scene.bodies.len();
    bodies.filter_map(|body| bodies::at(shot, body, frame, around).ok().flatten()).collect()
}

/// As many pictures as are small enough together, evenly spread.
fn within_budget(pictures: Vec<(i64, Vec<u8>, [usize; 2])>) -> Vec<(i64, (String, [usize; 2]))> {
    let indices: Vec<i64> = (0..pictures.len() as i64).collect();
    let size = |chosen: &[i64]| -> usize { chosen.iter().map(|i| pictures[*i as usize].1.len().div_ceil(3) * 4).sum() };
    let mut chosen = indices.clone();
    while chosen.len() > LEAST && size(&chosen) > BUDGET {
        chosen = spread(&indices, chosen.len() - 1);
    }
    let encoded = |i: &i64| {
        let (frame, bytes, size) = &pictures[*i as usize];
        (*frame, (encode(bytes), *size))
    };
    chosen.iter().map(encoded).collect()
}

fn cell(frame: i64, (picture, [width, height]): &(String, [usize; 2])) -> String {
    format!(
        "<figure><img src=\"data:image/png;base64,{picture}\" width=\"{width}\" height=\"{height}\" \
         alt=\"cloth at frame {frame}\"><figcaption>{frame}</figcaption></figure>"
    )
}

/// The picture as a PNG file; `None` if it cannot be one, such as without any pixel.
fn png(picture: &Picture) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let (width, height) = (u32::try_from(picture.width).ok()?, u32::try_from(picture.height).ok()?);
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().ok()?;
    writer.write_image_data(&picture.pixels).ok()?;
    writer.finish().ok()?;
    Some(bytes)
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
        let pictures = |bytes: usize| (0..12).map(|frame| (frame, vec![0; bytes], [1, 1])).collect::<Vec<_>>();
        assert_eq!(within_budget(pictures(1000)).len(), 12);
        let kept: Vec<i64> = within_budget(pictures(120_000)).into_iter().map(|(frame, _)| frame).collect();
        assert_eq!(kept, [0, 1, 3, 5, 7, 9, 11]); // seven of 160 000 letters each
        assert_eq!(within_budget(pictures(900_000)).len(), LEAST);
    }

    #[test]
    fn a_picture_becomes_a_file_that_decodes_to_the_same_pixels() {
        let picture = Picture { width: 3, height: 2, pixels: (0..24).collect() };
        let file = png(&picture).unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(file)).read_info().unwrap();
        let mut pixels = vec![0; 24];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, picture.pixels);
    }
}
