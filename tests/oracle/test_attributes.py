"""Attributes at the points of caches (`[output] attributes`), as Alembic's official reader, Pixar's library, h5py and Blender see them:
the values are computed again from the positions, by other means.
"""

import json
import subprocess

import h5py
import numpy as np
import pytest

from farm import DRAPERY, Shot
from judges import ask, hdf5

N = 9
SPACING = 0.03
FRAMES = "1001-1004"
ALL = ["normals", "rest", "strain", "contact", "thickness"]
CENTIMETRE = 0.01
# Of the ball and of the cloth [m].
BALL, CLOTH = 0.006, 0.004
RADIUS = 0.1

SCENE = """
drapery = 1
[shot]
frames = "1001-1004"
[units]
length = "cm"
up = "Z"
[output]
format = {formats}
{attributes}
[gravity]
[self_repulsion]
thickness_clamp = 0.5
[self_collision]
[[body]]
name = "ball"
shape = {{ sphere = {{ radius = {radius} }} }}
thickness = "6 mm"
[[garment]]
name = "lower"
rest = "lower.obj"
units = {{ length = "m", up = "Y" }}
material = "cotton_shirting"
thickness = "4 mm"
[[garment]]
name = "upper"
rest = "upper.obj"
units = {{ length = "m", up = "Y" }}
material = "cotton_shirting"
thickness = "4 mm"
"""


def grid(height):
    side = (np.arange(N) - (N - 1) / 2) * SPACING
    points = "".join(f"v {x:.6f} {height} {z:.6f}\n" for z in side for x in side)
    corners = [(row * N + column + 1, (row + 1) * N + column + 1) for row in range(N - 1) for column in range(N - 1)]
    return points + "".join(f"f {a} {b} {b + 1} {a + 1}\n" for a, b in corners)


def scene(folder, attributes, formats='["abc", "h5", "usd"]'):
    folder.mkdir(exist_ok=True)
    (folder / "lower.obj").write_text(grid(RADIUS + 0.01))
    (folder / "upper.obj").write_text(grid(RADIUS + 0.0165))
    said = f"attributes = {json.dumps(attributes)}" if attributes is not None else ""
    (folder / "scene.toml").write_text(SCENE.format(formats=formats, attributes=said, radius=RADIUS))
    return Shot(folder / "scene.toml", FRAMES)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("attributes")
    scene(folder, ALL).run(folder / "out")
    return folder / "out"


def held(path):
    """Everything of an HDF5 cache; positions in metres, in its own axes."""
    with h5py.File(path, "r") as file:
        return {name: file[name][:] for name in file} | {"metres": file["positions"][:].astype(float) * CENTIMETRE}


def edges(triangles):
    sides = np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    return np.unique(np.sort(sides, axis=1), axis=0)


def expected_strain(cache, points):
    a, b = edges(cache["triangles"]).T
    rest = cache["rest"].astype(float)
    length = np.linalg.norm(points[a] - points[b], axis=1) / CENTIMETRE
    strain = length / np.linalg.norm(rest[a] - rest[b], axis=1) - 1
    greatest = np.full(len(points), -np.inf)
    for ends in (a, b):
        np.maximum.at(greatest, ends, strain)
    return greatest


def expected_normals(cache, points):
    sums = np.zeros((len(points), 3))
    for face in cache["face_indices"].reshape(-1, 4):
        corners = points[face]
        sums[face] += np.cross(corners[2] - corners[0], corners[3] - corners[1])
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def distances(points, corners):
    """Distance of each point from the nearest triangle, by the closest points of planes and edges."""
    found = np.full(len(points), np.inf)
    for a, b, c in corners:
        for p, q in ((a, b), (b, c), (c, a)):
            along = np.clip((points - p) @ (q - p) / ((q - p) @ (q - p)), 0, 1)
            found = np.minimum(found, np.linalg.norm(points - (p + along[:, None] * (q - p)), axis=1))
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        height = (points - a) @ normal
        foot = points - height[:, None] * normal
        inside = np.all([np.cross(q - p, foot - p) @ normal >= 0 for p, q in ((a, b), (b, c), (c, a))], axis=0)
        found = np.where(inside, np.minimum(found, abs(height)), found)
    return found


def expected_contact(cache, other, frame):
    points = cache["metres"][frame]
    ball = np.linalg.norm(points, axis=1) - RADIUS
    cloth = distances(points, other["metres"][frame][other["triangles"]])
    return np.maximum(np.clip(2 - ball / BALL, 0, 1), np.clip(2 - cloth / CLOTH, 0, 1))


@pytest.mark.parametrize("garment, other, height", [("lower", "upper", 0.11), ("upper", "lower", 0.1165)])
def test_values_are_those_that_the_positions_give_by_other_means(shot, garment, other, height):
    cache, others = held(shot / f"{garment}.h5"), held(shot / f"{other}.h5")
    side = (np.arange(N) - (N - 1) / 2) * SPACING
    # Z up: (x, -z, y).
    rest = [(x / CENTIMETRE, -z / CENTIMETRE, height / CENTIMETRE) for z in side for x in side]
    assert np.allclose(cache["rest"], rest, rtol=0, atol=1e-5)
    assert np.allclose(cache["thickness"], 0.4, rtol=1e-6, atol=0)
    seen = []
    for frame in range(4):
        points = cache["metres"][frame]
        assert np.allclose(cache["strain"][frame], expected_strain(cache, points), rtol=0, atol=1e-5)
        assert np.allclose(cache["normals"][frame], expected_normals(cache, points), rtol=0, atol=1e-5)
        # The search stores distances in single precision, and the solver adds a hundred-thousandth of an edge to the ball's.
        assert np.allclose(cache["contact"][frame], expected_contact(cache, others, frame), rtol=0, atol=1e-3)
        seen.append(cache["contact"][frame])
    seen = np.array(seen)
    assert seen.min() == 0 and seen.max() > 0.9 and ((seen > 0.1) & (seen < 0.9)).any(), "touching, free, and between"


def test_the_largest_strain_is_that_of_the_record(shot):
    lines = [json.loads(line) for line in (shot / "run.jsonl").read_text().splitlines()]
    frames = {line["frame"]: line for line in lines if line["record"] == "frame"}
    for garment in ("lower", "upper"):
        cache = held(shot / f"{garment}.h5")
        for frame in (1002, 1004):
            (strain,) = [entry["largest"] for entry in frames[frame]["strains"] if entry["garment"] == garment]
            assert cache["strain"][frame - 1001].max() == pytest.approx(strain, abs=1e-5)


@pytest.mark.parametrize("ending", ["abc", "usd"])
def test_official_readers_see_the_values_of_the_hdf5_cache(shot, ending):
    cache, seen = held(shot / "lower.h5"), ask("point_attributes.py", shot / f"lower.{ending}")
    for name in ALL:
        assert np.array_equal(np.array(seen[name], np.float32), cache[name]), name
    rest = "Pref" if ending == "abc" else "rest"
    assert {rest, "strain", "contact", "thickness"} <= set(seen["held"])


def test_blender_sees_the_attributes_of_a_stage(shot):
    cache, seen = held(shot / "lower.h5"), ask("point_attributes.py", shot / "lower.usd", 1002, 1004)
    for name in ("strain", "contact"):
        assert np.array_equal(seen[name], cache[name][[1, 3]]), name
    assert np.array_equal(seen["thickness"][0], cache["thickness"]) and np.array_equal(seen["rest"][0], cache["rest"])


def bytes_of(out):
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*"))
            if path.suffix in (".abc", ".h5", ".usd", ".usdc") and "checkpoints" not in path.parts}


def test_attributes_change_nothing_else_and_are_there_only_where_they_are_asked_for(shot, tmp_path):
    scene(tmp_path / "none", None).run(tmp_path / "none" / "out")
    scene(tmp_path / "empty", []).run(tmp_path / "empty" / "out")
    none = bytes_of(tmp_path / "none" / "out")
    assert none == bytes_of(tmp_path / "empty" / "out")
    for garment in ("lower", "upper"):
        plain, asked = held(tmp_path / "none" / "out" / f"{garment}.h5"), held(shot / f"{garment}.h5")
        assert set(asked) - set(plain) == set(ALL)
        assert all(np.array_equal(plain[name], asked[name]) for name in plain), "the same motion"


def test_bytes_are_the_same_on_other_threads_and_after_a_stop(shot, tmp_path):
    again = scene(tmp_path / "again", ALL)
    out = tmp_path / "again" / "out"
    again.run(out, "--checkpoint-every", "1f", last=1002, threads=1)
    again.run(out, threads=1)
    assert bytes_of(out) == bytes_of(shot)


def drapery(*arguments):
    return subprocess.run([DRAPERY, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def test_convert_keeps_them_between_formats_and_units(shot, tmp_path):
    cache = held(shot / "lower.h5")
    for source, target in (("abc", "usd"), ("usd", "h5"), ("h5", "abc")):
        done = drapery("convert", shot / f"lower.{source}", tmp_path / f"lower.{target}")
        assert done.returncode == 0 and "left out" not in done.stdout + done.stderr, done.stdout + done.stderr
    for target in ("abc", "usd"):
        seen = ask("point_attributes.py", tmp_path / f"lower.{target}")
        assert all(np.array_equal(np.array(seen[name], np.float32), cache[name]) for name in ALL)
    assert all(np.array_equal(held(tmp_path / "lower.h5")[name], cache[name]) for name in ALL)
    done = drapery("convert", shot / "lower.abc", tmp_path / "metres.abc", "--length", "m", "--up", "Y")
    assert done.returncode == 0, done.stderr
    seen = ask("point_attributes.py", tmp_path / "metres.abc")
    x, y, z = cache["rest"].T * CENTIMETRE
    assert np.allclose(seen["rest"], np.stack([x, z, -y], axis=1), rtol=0, atol=1e-6)
    assert np.allclose(seen["thickness"], CLOTH, rtol=1e-6) and np.array_equal(seen["strain"], cache["strain"])


def test_the_stage_of_the_shot_as_one_layer_keeps_all_their_values(shot, tmp_path):
    from pxr import Usd

    (stage,) = shot.glob("*.usda")
    layer = tmp_path / "all.usdc"
    done = drapery("convert", stage, layer)
    assert done.returncode == 0 and "left out" not in done.stdout + done.stderr and "animated" not in done.stdout + done.stderr, done
    for garment in ("lower", "upper"):
        cache, path = held(shot / f"{garment}.h5"), f"/{stage.stem}/{garment}/{garment}Shape"
        opened = Usd.Stage.Open(str(layer))
        prim = opened.GetPrimAtPath(path)
        for name in ("strain", "contact"):
            seen = np.array([prim.GetAttribute(f"primvars:{name}").Get(frame) for frame in range(1001, 1005)])
            assert np.array_equal(seen, cache[name]) and not np.array_equal(seen[0], seen[-1]), name
        for source in (stage, layer):
            back = tmp_path / f"{source.suffix[1:]}_{garment}.h5"
            assert drapery("convert", source, back, "--object", path).returncode == 0
            assert all(np.array_equal(held(back)[name], cache[name]) for name in ALL), source


def test_info_lists_them_and_verify_judges_them(shot, tmp_path):
    for name, rest in (("lower.abc", "Pref"), ("lower.usd", "rest"), ("lower.h5", "rest")):
        said = drapery("info", shot / name).stdout
        assert all(word in said for word in (rest, "strain", "contact", "thickness", "  normals: smooth\n")), said
    for name in ("lower.abc", "lower.usd"):
        verified = drapery("verify", shot / name)
        assert verified.returncode == 0, verified.stdout + verified.stderr
    # A strain of the last frame that is no number.
    number = held(shot / "lower.h5")["strain"][3][:4].tobytes()
    damaged = (shot / "lower.abc").read_bytes()
    assert damaged.count(number) == 1
    (tmp_path / "damaged.abc").write_bytes(damaged.replace(number, np.full(4, np.nan, np.float32).tobytes()))
    verified = drapery("verify", tmp_path / "damaged.abc")
    assert verified.returncode != 0 and "attribute strain, sample 3, vertex 0" in verified.stdout + verified.stderr


@pytest.mark.parametrize("ending", ["pc2", "mdd"])
def test_point_caches_move_a_mesh_in_blender_as_the_cache_does(shot, tmp_path, ending):
    path = tmp_path / f"lower.{ending}"
    done = drapery("convert", shot / "lower.abc", path)
    assert done.returncode == 0 and "the format holds points alone" in done.stdout + done.stderr, done.stderr
    (tmp_path / "cage.obj").write_text(grid(0.11))
    seen = ask("point_attributes.py", path, 1001, 1002, 1004)
    assert np.allclose(seen["positions"], hdf5(shot / "lower.h5")["positions"][[0, 1, 3]], rtol=0, atol=1e-5)
    said = drapery("info", path).stdout
    assert f"{N * N}" in said and "4" in said, said


def test_what_cannot_be_is_named(tmp_path):
    scene(tmp_path, ["normals", "tension"])
    done = drapery("check", tmp_path / "scene.toml")
    assert done.returncode == 78 and "tension" in done.stderr and "strain" in done.stderr, done.stderr
    scene(tmp_path, ["rest", "rest"])
    done = drapery("check", tmp_path / "scene.toml")
    assert done.returncode == 78 and 'the attribute "rest" is listed twice' in done.stderr, done.stderr
