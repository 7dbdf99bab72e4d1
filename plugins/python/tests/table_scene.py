"""The scene of most tests: a cloth over a table that the program moves."""

from typing import Any

import numpy as np
import numpy.typing as npt

import drapery

SCENE: dict[str, Any] = {
    "drapery": 1,
    "shot": {"name": "table", "frames": "1001-1004", "preroll": {"settle": 1, "blend": 0}},
    "gravity": {},
    "self_repulsion": {},
    "self_collision": {},
    "body": [{"name": "table", "file": "memory:table"}],
    "garment": [{
        "name": "cloth", "material": "cotton_shirting",
        "panel": {"resolution": 6, "side": 0.8, "aspect": 1, "center": [0, 0.01, 0]},
    }],
}
FACES = [[0, 1, 2, 3], [1, 0, 4], [2, 1, 4], [3, 2, 4], [0, 3, 4]]


def table(frame: int) -> npt.NDArray[np.float64]:
    """Vertices of the table at a frame, of the shape (5, 3) [m]."""
    y = -0.02 + 0.01 * (frame - 1001)
    return np.array([[-0.3, y, -0.3], [-0.3, y, 0.3], [0.3, y, 0.3], [0.3, y, -0.3], [0, -0.5, 0]])


def scene(last: int = 1004) -> drapery.Scene:
    """The scene up to a frame."""
    content = {**SCENE, "shot": {**SCENE["shot"], "frames": f"1001-{last}"}}
    made = drapery.Scene.from_dict(content, "table.toml")
    made.add_mesh("table", table(1001), FACES)
    return made


def advance(simulation: drapery.Simulation, frame: int) -> None:
    """Goes on to a frame with the table moving."""
    while simulation.frame < frame:
        simulation.move_body("table", table(simulation.frame + 1))
        simulation.advance()


SHEET = """drapery = 1
[parameters]
resolution = 4
[shot]
name = "sheet"
frames = "1-6"
[gravity]
[self_repulsion]
[self_collision]
[[garment]]
name = "sheet"
panel = { resolution = "$resolution", aspect = 1 }
material = "cotton_shirting"
[[garment.pin]]
corners = ["i0j0"]
[output]
format = ["abc", "h5", "usd"]
"""
"""A sheet of a file, without meshes in memory, in all formats."""
