//! Scene files and meshes that cases of the command start from.

/// A garment from an OBJ file over a body from an OBJ file, frames 1 to 3.
pub const FROM_FILES: &str = r#"drapery = 1
[shot]
name = "files"
frames = "1-3"
[units]
length = "m"
[gravity]
[[body]]
name = "hero"
file = "body.obj"
[[garment]]
name = "skirt"
rest = "skirt.obj"
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[output]
format = ["abc"]
"#;

/// A falling panel over a ball, frames 1001 to 1004.
pub const SHEET: &str = r#"drapery = 1
[parameters]
resolution = 6
[shot]
name = "sheet"
frames = "1001-1004"
[gravity]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
position = [0.8, 0.0, 0.5]
friction = 0.4
[[garment]]
name = "sheet"
panel = { resolution = "$resolution" }
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[output]
format = ["abc"]
"#;

/// A closed body 1.7 m high, faces outwards.
pub const BODY: &str = "v 0 0 0\nv 0.5 0 0\nv 0 0 0.5\nv 0 1.7 0\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";

/// A square of cloth beside the body.
pub const SKIRT: &str = "v 2 1 0\nv 3 1 0\nv 3 1 1\nv 2 1 1\nf 1 4 3 2\n";
