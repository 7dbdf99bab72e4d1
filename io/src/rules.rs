//! Rules of a scene that is right the first time: what is looked for before anything is simulated. What they find is a warning by
//! the name of the rule, which a scene can silence: `[check] silence = ["no_gravity"]`.
//!
//! This is the table; `drapery-shot` looks. `docs/reference/warnings.md` is made of it.

/// A rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rule {
    /// Its word in the scene file.
    pub name: &'static str,
    /// Condition that it finds.
    pub finds: &'static str,
    /// Its assumptions, and the cases that it leaves alone.
    pub exactly: &'static str,
    /// The line of a scene that mends it, as an example.
    pub line: &'static str,
}

/// All rules, in the order of their warnings.
pub static RULES: [Rule; 28] = [
    Rule {
        name: "no_gravity",
        finds: "a scene without gravity",
        exactly: "Silent if the scene has `[gravity]`, with any acceleration, or leaves it out by `[effects]` or \
                  `--without`.",
        line: "[gravity]",
    },
    Rule {
        name: "no_self_collision",
        finds: "two or more garments, or one that can fold, without self-collision: they may pass through themselves \
                and each other",
        exactly: "A garment counts as able to fold if it has 100 points or more: fewer are a patch of less than ten by \
                  ten. Silent if the scene leaves `self_collision` out by `[effects]` or `--without`.",
        line: "[self_collision]",
    },
    Rule {
        name: "up_axis",
        finds: "a body that stands along another axis than `up`, or gravity that does not pull down",
        exactly: "A body contradicts `up` in its first pose if three conditions hold. It is at least twice as high \
                  along the other axis as along `up`. Its feet are on the ground there: within a tenth of this height \
                  from zero. Along `up` it reaches both below and above zero by a fifth of its extent, like the depth \
                  of a standing figure. A figure that lies, sits or crouches on the ground does not reach below it. \
                  Ground is no figure: a body that is wider than 1.2 times this height, or flatter than 0.06 of it. \
                  Gravity, like every number of a scene, counts with Y up in metres; `[units]` applies to files only. \
                  Gravity is reported if less than half of it pulls downwards.",
        line: "up = \"Z\"",
    },
    Rule {
        name: "frame_rate",
        finds: "`shot.fps` differs from the frame rate of a file that a body, a pin or a channel follows",
        exactly: "A file states its rate (`DCC_FPS` or `FramesPerTimeUnit` of an Alembic archive, `timeCodesPerSecond` \
                  of a stage). Otherwise the rate of its samples counts, if they are evenly spaced and neither several \
                  to a frame nor several frames apart.",
        line: "fps = \"25\"",
    },
    Rule {
        name: "sparse_samples",
        finds: "a file that a body or a pin follows has samples several frames apart, so that frames between are interpolated",
        exactly: "Between samples every point moves on a straight line, at a velocity that jumps at each sample: turns are cut short, and \
                  cloth feels the jerks. It is the usual step between the samples in the shot that counts, from one and a half frames on. \
                  Export a sample for every frame. Silence the rule if the motion is animated on twos and meant to be so. Two samples alone \
                  are a straight motion on purpose, and a rate that `frame_rate` finds is not reported twice.",
        line: "file = \"hero_every_frame.abc\"",
    },
    Rule {
        name: "thickness_lowered",
        finds: "garments whose thickness is lowered because edges are short",
        exactly: "Layers keep at most `self_repulsion.thickness_clamp` times the shortest edge around a vertex, whether the garment or a \
                  `[[contact]]` between garments says their thickness. Silent \
                  if the scene sets `thickness_clamp`, or if at most one vertex in a hundred is affected. `plan` \
                  always notes it.",
        line: "thickness = \"0.8 mm\"",
    },
    Rule {
        name: "thin_body",
        finds: "a mesh body, a sphere or a capsule whose `thickness` is too small for coarse faces, so that it shows through the cloth",
        exactly: "Contact keeps the vertices of cloth out of a body. The thickness that the faces of cloth and body \
                  need, over 95 % of the body's area in its first frame, follows from the sizes of the faces and from \
                  the angles between the body's faces ([the scene file](scene.md)). Nine tenths of it are enough. \
                  Silent if the scene sets no thickness: the default is at least the needed one. Garments that are modelled closer to \
                  the body are pushed out by it, as `start_close` tells.",
        line: "thickness = \"4 mm\"",
    },
    Rule {
        name: "other_diagonal",
        finds: "garments that intersect cloth or a body at the start if their faces are cut along the other diagonal",
        exactly: "Caches hold the faces, and renderers cut them into triangles. The test covers both diagonals of \
                  quads, and for larger faces the fans from the first and the last corner, of garments and of bodies. \
                  Bodies are tested in scenes with bodies, cloth with cloth in scenes with `[self_collision]`. With \
                  `faces = \"triangles\"` garments have no other diagonal. A run counts later intersections of this \
                  kind as `crossings_other_diagonal`.",
        line: "faces = \"triangles\"",
    },
    Rule {
        name: "body_friction",
        finds: "a body whose `friction` overrides the friction of the garments' materials",
        exactly: "A body without `friction` has the friction of each garment's material. Silent if it equals the friction \
                  of the material, and for garments with a `[[contact]]` that sets it.",
        line: "friction = 0.4",
    },
    Rule {
        name: "shape_units",
        finds: "sizes, positions and paths of shapes and pins that seem to be in the units of the files",
        exactly: "Numbers of the scene are in metres with Y up; `[units]` applies to files only. If `[units]` differs, \
                  the rule finds two things: lengths more than five times as large as the content of the files (a \
                  person, without files) that would not be as large in the unit of the files, and ground that stands \
                  upright under `up = \"Z\"`. Gravity is compared with the earth's in each unit of length.",
        line: "shape = { sphere = { radius = \"25 cm\" } }",
    },
    Rule {
        name: "garment_units",
        finds: "a garment from a file that is far too small or too large for the bodies, but would fit one in another unit",
        exactly: "The diagonals of bounding boxes at rest are compared, with bodies in their first pose: those from files, balls, capsules \
                  and cylinders. Boxes and half-spaces do not count, since ground may be of any size. A garment is found if \
                  three conditions hold. It is less than a twentieth or more than twenty times as large as every body. In another \
                  unit of length it would be between a fifth and five times as large as one of them. Its box would then overlap \
                  that body's. A handkerchief or a patch where it belongs is not found: in another unit it would lie far away.",
        line: "length = \"m\"",
    },
    Rule {
        name: "wind_speed",
        finds: "a wind faster than the fastest gust measured outside a tornado, 113 m/s",
        exactly: "Velocities of the scene are in metres per second; `[units]` applies to files only. The rule checks \
                  `velocity` and `keys`, not the grid of a `file`.",
        line: "velocity = [6, 0, 0]",
    },
    Rule {
        name: "start_speed",
        finds: "a garment that starts faster than 100 m/s",
        exactly: "Velocities of the scene are in metres per second; `[units]` applies to files only. `velocity` and \
                  the speed of `random_velocity` count together.",
        line: "velocity = [0, 0, 2]",
    },
    Rule {
        name: "density",
        finds: "a garment lighter than 5 g/m² or heavier than 20 kg/m²",
        exactly: "A bare number is in kg/m²: 150 is a lead plate, \"150 g/m²\" is a shirt. Gauze has 15 g/m², chain \
                  mail 10 kg/m². `total_mass` is not tested.",
        line: "density = \"150 g/m²\"",
    },
    Rule {
        name: "start_crossed",
        finds: "garments that intersect themselves, each other or a body at the start",
        exactly: "Scenes with `[self_collision]` are tested exactly, edges against triangles. Intersections at the \
                  start never increase. They are resolved once the solver knows a direction out; until then they \
                  remain visible.",
        line: "start = \"coat.abc@990\"",
    },
    Rule {
        name: "start_inside",
        finds: "garments that are partly inside a body at the start",
        exactly: "Free vertices of garments that collide with the body are tested. The body draws them out at the start. A garment \
                  with more vertices inside than outside, or deeper than ten edges, is refused.",
        line: "start = \"coat.abc@990\"",
    },
    Rule {
        name: "start_close",
        finds: "garments of which many vertices start closer to a body than its thickness, so that they are pushed out",
        exactly: "A garment is found if more than one in twenty of its vertices without a pin are closer than nine tenths of the thickness, \
                  and the closest is pushed by a millimetre or more. It is the thickness of the body, which is chosen automatically if the \
                  scene sets none, or of a `[[contact]]` with the garment or a part of it. Less thickness strains the garment less, but may let the body show through \
                  coarse cloth, as `thin_body` tells. Where both matter, model the garment further off, or give it smaller faces.",
        line: "thickness = \"1.5 mm\"",
    },
    Rule {
        name: "start_layers",
        finds: "garments that lie the other way round at the start than their `layer`s say",
        exactly: "Points of one garment within half an edge of a face of another with a smaller `layer` have to be on the side to which \
                  its normals point. The rule fires if more of them are on the other side: the layers are swapped, or the faces of \
                  a garment look inwards.",
        line: "layer = 2",
    },
    Rule {
        name: "start_lengths",
        finds: "edges of a garment that are more than three times as long at the start as at rest, or have no length",
        exactly: "`start`, `jitter` and the targets of pins move vertices away from the rest shape. One edge is \
                  enough: it pulls or pushes harder than any fabric bears.",
        line: "start = \"coat.abc@990\"",
    },
    Rule {
        name: "idle_setting",
        finds: "settings that change nothing in this scene, because of another setting",
        exactly: "The rule checks `ambient` of `[garment.pressure]` without `gas`, `rest` of a body without a pre-roll, `rest_gap` and \
                  `zip` of a seam with `keep_gap`, and a \
                  `[[contact]]` of a garment whose parts all have a `[[contact]]` of their own with the same object. Numbers that \
                  equal the default are ignored.",
        line: "gas = true",
    },
    Rule {
        name: "outside_shot",
        finds: "pins, seams, paths and winds whose times lie outside the shot, so that they never act",
        exactly: "Times count in seconds since the first frame; with a pre-roll the shot starts below zero. The rule \
                  finds pins that are released before the start, or caught or to be released after the last frame; seams that are open \
                  or closed before the start, or never close or open; spins that never start; and paths and keys of \
                  the wind of which none lies in the shot. One key alone is a place and no motion. It looks at all \
                  frames of the scene, even if a run asks for fewer. Curves by frame are refused instead.",
        line: "until = 1.5",
    },
    Rule {
        name: "seam_gap",
        finds: "a seam with `pairing = \"surface\"` whose vertices start far from the surface that they are sewn to",
        exactly: "A vertex is far if its gap is more than three edges of the face there and ten thicknesses of both \
                  garments, or more than 5 cm. The stitch then pulls over that distance, or keeps it with `keep_gap`. \
                  Other seams are meant to close a gap, and are not tested.",
        line: "start = \"patch.abc@1\"",
    },
    Rule {
        name: "seam_lengths",
        finds: "a seam or a zip of which one side is longer than the other by more than a third",
        exactly: "Lengths count along the sewn vertices at rest. Up to a tenth is the ease of a sleeve, up to a quarter the stretch of a \
                  knitted band; gathers begin at a half. A ruffle is gathered on purpose: silence the rule. Sides of fewer than four \
                  vertices, such as buttons, and seams to a surface are not tested.",
        line: "where = { box = { min = [-0.002, 0, -1], max = [0.002, 0.74, 1] } }",
    },
    Rule {
        name: "seam_through_body",
        finds: "a seam, a zip or a button that starts with a body between its two sides: closing presses the cloth into the body",
        exactly: "The straight line of a stitch is inside the body, and its depth there is more than a sixth of its length there and twice \
                  the body's thickness. Seams that close around a belly or an arm cut through it by less. Ideal shapes stand where their path \
                  begins. Silent for seams with `keep_gap` and where a `[[contact]]` ignores the body.",
        line: "to = { garment = \"front\", where = { box = { min = [-0.01, 0.9, 0], max = [0.01, 1.4, 1] } } }",
    },
    Rule {
        name: "unopened_format",
        finds: "no caches, or only caches in formats that no application opens",
        exactly: "HDF5 is for analysis. Silent if another format is written beside it.",
        line: "format = [\"abc\"]",
    },
    Rule {
        name: "render_mesh_distance",
        finds: "points of a render mesh farther than `max_distance` from the cloth at rest: they follow it only \
                loosely",
        exactly: "A rigid part is measured at its closest point. Model the mesh around the rest shape of the garment, \
                  in the right units. If it is meant to stand off, set `max_distance` to that distance.",
        line: "max_distance = \"4 cm\"",
    },
    Rule {
        name: "render_mesh_layers",
        finds: "edges of a render mesh whose ends are bound to different layers of the cloth, such as front and back",
        exactly: "Such edges are stretched when the layers part: one of their points lies between two layers, closer \
                  to the wrong one. Edges with an end beyond `max_distance` are not checked.",
        line: "file = \"coat_render.abc\"",
    },
    Rule {
        name: "render_mesh_flipped",
        finds: "a render mesh whose faces point the opposite way to the faces of the cloth",
        exactly: "Reported if more than nine tenths of its area do. A shell with two sides has one half that does, and \
                  is not reported. Reverse the faces of one of the two meshes.",
        line: "file = \"coat_render.abc\"",
    },
];

/// The rule of this name.
pub fn find(name: &str) -> Option<&'static Rule> {
    RULES.iter().find(|rule| rule.name == name)
}
