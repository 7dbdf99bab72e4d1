"""Outside programs see cloth 100 km from the origin where it is, as finely as at the origin."""

import numpy as np
import pytest

from farm import Shot
from judges import blender, hdf5, official

FPS = 24

# Frames before the cloth meets the ball.
FREE = 2

# Not a whole number of metres from the origin, and lengths in centimetres in the files of one of the runs.
FAR = np.array([1e5 + 0.375, -3e4, 2e4])

# Long steps look ahead, so that the cloth touches the ball a frame earlier.
SCENE = """
drapery = 1

[shot]
frames = "1-5"
fps = 24

[solver]
integrator = "semi_implicit"

[units]
length = "{length}"
up = "Y"

[gravity]

[self_repulsion]

[self_collision]

[[body]]
name = "ball"
shape = {{ sphere = {{ radius = 0.1 }} }}
position = [{x!r}, {y!r}, {z!r}]

[[garment]]
name = "upper"
panel = {{ resolution = 12, side = 0.3, aspect = 1.0, center = [{x!r}, {y!r} + 0.174, {z!r}] }}
velocity = [0, -1, 0]
material = "cotton_shirting"

[[garment]]
name = "lower"
panel = {{ resolution = 12, side = 0.3, aspect = 1.0, center = [{x!r}, {y!r} + 0.166, {z!r}] }}
velocity = [0, -1, 0]
material = "cotton_shirting"
"""


def run(folder, place, length):
    x, y, z = map(float, place)
    text = SCENE.format(x=x, y=y, z=z, length=length)
    for height in (0.174, 0.166):
        text = text.replace(f"{y!r} + {height}", repr(y + height))
    scene = folder / "scene.toml"
    scene.write_text(text)
    Shot(scene, "1-5").run(folder / "out")
    return folder / "out"


@pytest.fixture(scope="module", params=[("m", 1.0), ("cm", 0.01)], ids=["metres", "centimetres"])
def far(request, tmp_path_factory):
    """The folder of the far run, its unit in metres, and that of the same run at the origin."""
    length, metres = request.param
    there = run(tmp_path_factory.mktemp("there"), FAR, length)
    return there, metres, run(tmp_path_factory.mktemp("here"), np.zeros(3), length)


def test_the_official_reader_and_h5py_see_the_same_places_and_the_motion_at_the_origin(far):
    there, metres, here = far
    for name in ("upper", "lower"):
        archive, cache = official(there / f"{name}.abc"), hdf5(there / f"{name}.h5")
        np.testing.assert_array_equal(archive["positions"], cache["positions"])
        np.testing.assert_array_equal(archive["world_positions"], cache["world_positions"])
        np.testing.assert_array_equal(cache["origin"] * metres, np.round(FAR))
        assert np.abs(cache["positions"]).max() * metres < 1.0, "positions are counted from a place near the cloth"
        at_origin = hdf5(here / f"{name}.h5")
        assert not at_origin["origin"].any()
        # Before anything touches: afterwards the order of the vertices, which follows from where they rest, has its say.
        off = cache["world_positions"] * metres - FAR - at_origin["world_positions"] * metres
        assert np.abs(off[:FREE]).max() < 1e-6
        np.testing.assert_array_equal(archive["path"], f"/{name}/{name}Shape")


def test_bounds_of_the_mesh_are_its_own_and_those_of_the_archive_are_in_the_world(far):
    there, _, _ = far
    archive = official(there / "upper.abc")
    x, world = archive["positions"].astype(float), archive["world_positions"]
    np.testing.assert_array_equal(archive["self_bounds"], np.stack([x.min(axis=1), x.max(axis=1)], axis=1))
    expected = np.stack([world.min(axis=1), world.max(axis=1)], axis=1)
    np.testing.assert_allclose(archive["archive_bounds"], expected, rtol=0, atol=1e-8)


def test_blender_shows_the_cloth_in_its_place_with_every_fold(far):
    there, _, _ = far
    cache = hdf5(there / "upper.h5")
    shown = blender(there / "upper.abc", FPS, cache["frame_numbers"])
    x, y, z = np.moveaxis(cache["world_positions"], -1, 0)
    # Blender's transforms are of single precision too, but whole metres fit; what is left is that of the stored positions.
    atol = 1e-6 * max(1.0, np.abs(cache["positions"]).max())
    np.testing.assert_allclose(shown["positions"], np.stack([x, -z, y], axis=-1), rtol=0, atol=atol)
