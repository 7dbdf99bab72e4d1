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
pub static RULES: [Rule; 19] = [
    Rule {
        name: "no_gravity",
        finds: "nothing pulls the cloth down",
        exactly: "Silent where the scene has `[gravity]`, of any acceleration, or leaves it out by `[effects]` or `--without`.",
        line: "[gravity]",
    },
    Rule {
        name: "no_self_collision",
        finds: "two garments, or one that can fold, that may pass through themselves and each other",
        exactly: "A garment can fold if it has 100 points or more: fewer are a patch of less than ten by ten. Silent where the scene \
                  leaves `self_collision` out by `[effects]` or `--without`.",
        line: "[self_collision]",
    },
    Rule {
        name: "up_axis",
        finds: "a body that stands along the axis that is not `up`, or gravity that does not pull down",
        exactly: "A body contradicts `up` in its first pose if all three hold: along the other axis it is at least twice as high; \
                  there its feet are on the ground, within a tenth of that height of zero; and along `up` it reaches below zero and \
                  above by a fifth of its extent each, as the depth of a standing figure does. A figure that lies, sits or crouches \
                  on the ground does not reach below it. Gravity, and everything else in a scene, counts with Y up in metres, \
                  whatever `[units]` says of files: it contradicts that if it pulls by less than half downwards.",
        line: "up = \"Z\"",
    },
    Rule {
        name: "frame_rate",
        finds: "`shot.fps` other than the rate of the archive that a body or a pin follows",
        exactly: "The rate of a file is what it states (`DCC_FPS` or `FramesPerTimeUnit` of an Alembic archive, `timeCodesPerSecond` of a stage), or else that \
                  of its samples, if they are evenly spaced and neither several to a frame nor several frames apart.",
        line: "fps = \"25\"",
    },
    Rule {
        name: "thickness_lowered",
        finds: "garments whose thickness is lowered where edges are short",
        exactly: "Layers keep at most `self_repulsion.thickness_clamp` times the shortest edge around a vertex. Silent \
                  where the scene writes `thickness_clamp`, and where fewer than one vertex in a hundred is affected; \
                  `plan` always notes it.",
        line: "thickness = \"0.8 mm\"",
    },
    Rule {
        name: "thin_body",
        finds: "a mesh body whose `thickness` is too small for coarse faces, so that it shows through the cloth",
        exactly: "Cloth is kept out at its vertices. The thickness that its faces and those of the body need over 95 % \
                  of the body's area in its first frame follows from their sizes and from the angles between the \
                  body's faces ([the scene file](scene.md)); nine tenths of it are enough. Silent where the scene sets \
                  no thickness: the default is at least that.",
        line: "thickness = \"4 mm\"",
    },
    Rule {
        name: "other_diagonal",
        finds: "garments that intersect cloth or a body at the start if their faces are cut along the other diagonal",
        exactly: "Caches hold the faces, which renderers cut into triangles. Both diagonals of quads are tested, of \
                  garments and of bodies, and the fans of larger faces from the first and the last corner: bodies in \
                  scenes with bodies, cloth with cloth in scenes with `[self_collision]`; with `faces = \"triangles\"` \
                  garments have no other diagonal. A run counts later intersections of this kind as \
                  `crossings_other_diagonal`.",
        line: "faces = \"triangles\"",
    },
    Rule {
        name: "body_friction",
        finds: "a body whose `friction` overrides that of the garments' materials",
        exactly: "Friction is one number per body. Silent where it is the one that the material has, or comes from the \
                  materials.",
        line: "friction = 0.4",
    },
    Rule {
        name: "shape_units",
        finds: "sizes, positions and paths of shapes and pins that look as if they were in the units of the files",
        exactly: "Numbers of the scene are in metres with Y up; `[units]` applies to files only. Where `[units]` \
                  differs, the rule finds lengths more than five times as large as the content of the files (a person, \
                  if there are none) which are not as large in the unit of the files, and ground that stands upright \
                  under `up = \"Z\"`. Gravity is compared with the earth's in each unit of length.",
        line: "shape = { sphere = { radius = \"25 cm\" } }",
    },
    Rule {
        name: "wind_speed",
        finds: "a wind that is faster than any gust ever measured, 113 m/s",
        exactly: "Numbers of the scene are in metres per second; `[units]` applies to files only. `velocity` and \
                  `keys` are checked, the grid of a `file` is not.",
        line: "velocity = [6, 0, 0]",
    },
    Rule {
        name: "start_speed",
        finds: "a garment that starts faster than 100 m/s",
        exactly: "Numbers of the scene are in metres per second; `[units]` applies to files only. `velocity` and the \
                  speed of `random_velocity` count together.",
        line: "velocity = [0, 0, 2]",
    },
    Rule {
        name: "density",
        finds: "a garment lighter than 5 g/m² or heavier than 20 kg/m²",
        exactly: "A bare number is in kg/m²: 150 is a lead plate, \"150 g/m²\" is a shirt. Gauze has 15 g/m², chain \
                  mail 10 kg/m². `total_mass` is not checked.",
        line: "density = \"150 g/m²\"",
    },
    Rule {
        name: "start_crossed",
        finds: "garments that intersect themselves, each other or a body at the start",
        exactly: "Edges are tested exactly against triangles, in scenes with `[self_collision]`. Intersections at the \
                  start never get worse, and are resolved where the solver knows how to separate them; until then they \
                  stay visible.",
        line: "start = \"coat.abc@990\"",
    },
    Rule {
        name: "start_lengths",
        finds: "edges of a garment that are three times as long at the start as at rest, or have no length",
        exactly: "`start`, `jitter` and what pins follow move vertices away from the rest shape. One edge is enough: such an edge pulls \
                  or pushes harder than any fabric bears.",
        line: "start = \"coat.abc@990\"",
    },
    Rule {
        name: "idle_setting",
        finds: "numbers that change nothing in this scene, because of another setting",
        exactly: "The rule checks `ambient` of `[garment.pressure]` without `gas`, and `rest` of a body without a \
                  pre-roll. Numbers that equal the default are ignored.",
        line: "gas = true",
    },
    Rule {
        name: "unopened_format",
        finds: "no caches, or only caches in formats that no application opens",
        exactly: "HDF5 is for analysis. Silent where another format is written beside it.",
        line: "format = [\"abc\"]",
    },
    Rule {
        name: "render_mesh_distance",
        finds: "points of a render mesh that are farther than `max_distance` from the cloth at rest, which they follow loosely",
        exactly: "For a rigid part, its closest point counts. The mesh belongs around the rest shape of the garment, \
                  in the right units; if it is meant to stand off, `max_distance` sets how far.",
        line: "max_distance = \"4 cm\"",
    },
    Rule {
        name: "render_mesh_layers",
        finds: "edges of a render mesh whose ends are bound to different layers of the cloth, such as front and back",
        exactly: "Such edges are stretched where the layers part: a point between two layers is closer to the wrong \
                  one. Edges with an end beyond `max_distance` are not checked.",
        line: "file = \"coat_render.abc\"",
    },
    Rule {
        name: "render_mesh_flipped",
        finds: "a render mesh whose faces point the opposite way to the faces of the cloth",
        exactly: "Reported if nine tenths of its area do; in a shell with two sides, one half does. Reverse the faces \
                  of one of the two meshes.",
        line: "file = \"coat_render.abc\"",
    },
];

/// The rule of this name.
pub fn find(name: &str) -> Option<&'static Rule> {
    RULES.iter().find(|rule| rule.name == name)
}
