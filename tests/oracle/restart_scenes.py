"""The shots that are stopped and continued: small scenes with everything that has state."""

from farm import Shot
from judges import ROOT

SAMPLES = ROOT / "sample_assets" / "scenes"

# Cloth with itself and with another garment, pins and a spring that move, a body with friction, a pre-roll.
HELD = """
drapery = 1

[parameters]
resolution = 14
push = 0.4

[shot]
frames = "1001-1016"
preroll = { settle = 2 }

[gravity]

[self_repulsion]

[self_collision]

[[body]]
name = "ball"
shape = { sphere = { radius = 0.15 } }
path = [[0.0, [0, 0.8, 0.3]], [0.25, [0, 0.8, -0.2]], [0.5, [0.1, 0.9, 0.3]]]
friction = "$push"

[[garment]]
name = "flag"
panel = { resolution = "$resolution", side = 0.5, aspect = 1.2, center = [0, 1.0, 0] }
material = "cotton_shirting"
jitter = { axis = "y", amplitude = 0.002, seed = 3 }

[[garment.pin]]
corners = ["i0j0", "inj0"]

[[garment.pin]]
corners = ["i0jn"]
mode = "spring"
stiffness = 20.0
damping_ratio = 0.5
path = [[0.0, [0, 0, 0]], [0.3, [0.1, 0.1, 0]], [0.5, [0, 0, 0.1]]]

[[garment]]
name = "patch"
panel = { resolution = "$resolution", side = 0.3, aspect = 1.1, center = [0, 1.06, 0.05] }
material = "cotton_shirting"
velocity = [0, -1, 0]
"""

# A garment from a file, with a parameter to change.
CLOTH = """
drapery = 1

[parameters]
g = -9.81

[shot]
frames = "1-6"

[units]
length = "m"

[gravity]
acceleration = [0, "$g", 0]

[[garment]]
name = "cloth"
rest = "cloth.obj"
material = "cotton_shirting"

[[garment.pin]]
vertices = [0, 5]
"""


def grid(side):
    """A square of cloth as an OBJ file."""
    points = [f"v {x / 10} {1.0} {z / 10}" for x in range(side) for z in range(side)]
    corner = [x * side + z + 1 for x in range(side - 1) for z in range(side - 1)]
    faces = [f"f {c} {c + 1} {c + side + 1} {c + side}" for c in corner]
    return "\n".join([*points, *faces]) + "\n"


def changed(path, old, new):
    """The text of a scene of the project with one change."""
    text = path.read_text()
    assert old in text, f"{path} has no {old}"
    return text.replace(old, new)


def make_shots(folder, mannequin):
    """Writes the scenes into a folder; returns the shots by name."""

    def scene(name, text):
        path = folder / f"{name}.toml"
        path.write_text(text)
        return path

    twister = changed(SAMPLES / "twister.toml", "from = 3.0", "from = 0.1")  # the ends are caught in frame 6
    return {
        "held": Shot(scene("held", HELD), "1001-1016"),
        "mannequin": Shot(SAMPLES / "dressed_mannequin.toml", "1001-1005", assets=mannequin),
        "twister": Shot(scene("twister", twister), "0-12", resolution=16),
        "two sheets": Shot(ROOT / "tests" / "scenes" / "two_sheets.toml", "0-12", resolution=16),
        "sheet": Shot(SAMPLES / "hanging_sheet.toml", "1001-1024", resolution=40),
        "long": Shot(SAMPLES / "hanging_sheet.toml", "1001-1200", resolution=60, **{"shot.frames": "1001-1200"}),
    }
