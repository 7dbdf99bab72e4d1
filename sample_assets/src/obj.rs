//! Wavefront OBJ of a garment, as an artist would export it.

use std::fmt::Write;

use crate::garments::Garment;

/// The garment as OBJ text: one object, texture coordinates per corner, faces counter-clockwise seen from outside.
pub fn obj_text(garment: &Garment) -> String {
    let mut text = format!("# {}: rest shape = shape at the first frame, metres, y up\no {0}\n", garment.name);
    let mut line = |arguments: std::fmt::Arguments| {
        text.write_fmt(arguments).expect("a string takes any text");
    };
    for p in &garment.mesh.points {
        line(format_args!("v {:.7} {:.7} {:.7}\n", p.x, p.y, p.z));
    }
    for uv in &garment.uvs {
        line(format_args!("vt {:.6} {:.6}\n", uv[0], uv[1]));
    }
    for (face, corners) in garment.mesh.faces.iter().zip(&garment.uv_corners) {
        line(format_args!("f"));
        for (v, uv) in face.iter().zip(corners) {
            line(format_args!(" {}/{}", v + 1, uv + 1));
        }
        line(format_args!("\n"));
    }
    text
}
