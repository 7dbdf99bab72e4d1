"""Normals that hard edges split, from files that say by every means which edges are hard: as Alembic's official reader, Pixar's library,
h5py and Blender have them, against means of face normals by hand."""

import subprocess
import sys

import h5py
import numpy as np
import pytest

from farm import DRAPERY, Shot
from judges import HERE, ask
from split_normals import DIRECTIONS, FACES, POINTS

FRAMES = "1-3"
SCENE = """
drapery = 1
[shot]
frames = "1-3"
[units]
length = "m"
up = "Y"
[gravity]
[output]
format = ["abc", "h5", "usd"]
attributes = ["normals"]
"""
GARMENT = """
[[garment]]
name = "{name}"
rest = "{file}"
material = "cotton_shirting"
[[garment.pin]]
vertices = [0]
{more}
"""
# By the name of the garment: groups of the faces that are smooth with each other; none where all are.
HARD = [0, 1, 2, 3, 4, 5]
CUBES = {
    "vn": HARD, "same_vn": None, "silent": None, "faceted": HARD, "groups": [0, 1, 2, 2, 2, 2], "alembic": HARD, "usd": HARD, "uniform": HARD,
    "indexed": HARD, "subdivided": None,
}  # fmt: skip


def obj(face, before=""):
    points = "".join("v {:.6f} {:.6f} {:.6f}\n".format(*point) for point in POINTS)
    return points + before + "".join(face(number, [corner + 1 for corner in corners]) for number, corners in enumerate(FACES))


def plain(number, corners):
    return "f {} {} {} {}\n".format(*corners)


def usd(normals, scheme="none"):
    numbers = ", ".join(str(corner) for face in FACES for corner in face)
    points = ", ".join("({:.6f}, {:.6f}, {:.6f})".format(*point) for point in POINTS)
    return f"""#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Y"
)
def Mesh "cube"
{{
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [{numbers}]
    point3f[] points = [{points}]
    uniform token subdivisionScheme = "{scheme}"
{normals}
}}
"""


def files(folder):
    """The same cube with its hard edges told by other means, and without any."""
    vectors = ", ".join(str(tuple(direction)) for direction in DIRECTIONS)
    corners = ", ".join(str(tuple(direction)) for direction in DIRECTIONS for _ in range(4))
    listed = "".join("vn {} {} {}\n".format(*direction) for direction in DIRECTIONS)
    indices = ", ".join(str(face) for face in range(6) for _ in range(4))
    of_points = "".join("vn {:.4f} {:.4f} {:.4f}\n".format(*POINTS[corner] * 7) for face in FACES for corner in face)
    groups = ["off", "0", "7", "7", "7", "7"]
    varying = f'    normal3f[] normals = [{corners}] ( interpolation = "faceVarying" )'
    texts = {
        "vn.obj": obj(lambda n, c: "f " + " ".join(f"{corner}//{n + 1}" for corner in c) + "\n", listed),
        # A number for each corner, but the same direction at each point.
        "same_vn.obj": obj(lambda n, c: "f " + " ".join(f"{corner}//{4 * n + k + 1}" for k, corner in enumerate(c)) + "\n", of_points),
        "silent.obj": obj(plain),
        "faceted.obj": obj(plain, "s off\n"),
        "groups.obj": obj(lambda n, c: f"s {groups[n]}\n" + plain(n, c)),
        "usd.usda": usd(varying),
        "uniform.usda": usd(f'    normal3f[] normals = [{vectors}] ( interpolation = "uniform" )'),
        "indexed.usda": usd(f'    normal3f[] primvars:normals = [{vectors}] ( interpolation = "faceVarying" )\n'
                            f"    int[] primvars:normals:indices = [{indices}]"),
        "subdivided.usda": usd(varying, "catmullClark"),
    }  # fmt: skip
    for name, text in texts.items():
        (folder / name).write_text(text)
    subprocess.run([sys.executable, HERE / "split_normals.py", "make", folder / "alembic.abc"], check=True, cwd=folder)
    return {name.split(".")[0]: name for name in (*texts, "alembic.abc")}


def scene(folder, more=""):
    folder.mkdir(exist_ok=True)
    names = files(folder)
    (folder / "scene.toml").write_text(SCENE + "".join(GARMENT.format(name=name, file=names[name], more=more) for name in CUBES))
    return Shot(folder / "scene.toml", FRAMES)


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("split_normals")
    scene(folder, '[garment.render_mesh]\nfile = "groups.obj"\n').run(folder / "out")
    return folder / "out"


def expected(positions, groups):
    """Normals of the corners: the mean by area of the faces at the point that are smooth with its own."""
    area = [np.cross(positions[c] - positions[a], positions[d] - positions[b]) for a, b, c, d in FACES]
    found = []
    for face, corners in enumerate(FACES):
        for corner in corners:
            of_point = [other for other, others in enumerate(FACES) if corner in others]
            total = sum(area[other] for other in of_point if groups is None or groups[other] == groups[face])
            found.append(total / np.linalg.norm(total))
    return np.array(found)


def stored(path):
    """Positions of the frames, and the normals of their corners."""
    with h5py.File(path) as file:
        corners = file["face_indices"][:]
        assert np.array_equal(corners, np.ravel(FACES))
        numbers = file["normal_indices"][:] if "normal_indices" in file else corners
        return file["positions"][:].astype(float), file["normals"][:][:, numbers], "normal_indices" in file


@pytest.mark.parametrize("name", [*CUBES, "vn_render"])
def test_normals_are_those_of_the_faces_that_are_smooth_with_each_other(shot, name):
    groups = CUBES.get(name, CUBES["groups"])
    positions, normals, is_split = stored(shot / f"{name}.h5")
    assert is_split == (groups is not None)
    for frame in range(3):
        np.testing.assert_allclose(normals[frame], expected(positions[frame], groups), rtol=0, atol=2e-6)
    assert np.abs(normals[2] - normals[0]).max() > 1e-4, "they follow the cloth"


@pytest.mark.parametrize("name", ["vn", "groups", "silent", "vn_render"])
@pytest.mark.parametrize("ending", ["abc", "usd"])
def test_official_readers_see_normals_that_hard_edges_split(shot, name, ending):
    _, normals, is_split = stored(shot / f"{name}.h5")
    assert f"  normals: {'split by hard edges' if is_split else 'smooth'}\n" in drapery("info", shot / f"{name}.{ending}")
    seen = ask("split_normals.py", shot / f"{name}.{ending}")
    assert seen["of_corners"] == is_split
    if is_split:
        assert np.array_equal(seen["normals"].astype(np.float32), normals)
    else:
        assert np.array_equal(seen["normals"][:, np.ravel(FACES)].astype(np.float32), normals)


@pytest.mark.parametrize("ending", ["abc", "usd"])
def test_blender_shades_hard_edges(shot, ending):
    seen = ask("split_normals.py", shot / f"groups.{ending}", 2, 3)
    for positions, normals, corners in zip(seen["positions"], seen["normals"], seen["corners"], strict=True):
        wanted = {(face, corner): normal for (face, corner), normal in zip(
            [(face, corner) for face, corners in enumerate(FACES) for corner in corners], expected(positions.astype(float), CUBES["groups"]))}  # fmt: skip
        # Blender keeps directions in 16 bits.
        for place, corner in enumerate(corners):
            np.testing.assert_allclose(normals[place], wanted[place // 4, corner], rtol=0, atol=2e-3)


def bytes_of(out):
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*"))
            if path.suffix in (".abc", ".h5", ".usd", ".usdc") and "checkpoints" not in path.parts}  # fmt: skip


def test_a_run_that_stops_and_one_that_writes_a_format_later_leave_the_same_bytes(shot, tmp_path):
    again, out = scene(tmp_path, '[garment.render_mesh]\nfile = "groups.obj"\n'), tmp_path / "out"
    again.run(out, "--checkpoint-every", "1f", "--set", 'output.format=["abc"]', last=2, threads=1)
    again.run(out, "--resume-with-changes")
    assert bytes_of(out) == bytes_of(shot)


def drapery(*arguments):
    done = subprocess.run([DRAPERY, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def test_convert_and_verify_know_them(shot, tmp_path):
    _, normals, _ = stored(shot / "groups.h5")
    for source, target in (("abc", "usd"), ("usd", "h5"), ("h5", "abc"), ("abc", "usdc")):
        assert "left out" not in drapery("convert", shot / f"groups.{source}", tmp_path / f"groups.{target}")
    assert np.array_equal(stored(tmp_path / "groups.h5")[1], normals)
    for target in ("abc", "usd", "usdc"):
        seen = ask("split_normals.py", tmp_path / f"groups.{target}")
        assert seen["of_corners"] and np.array_equal(seen["normals"].astype(np.float32), normals)
    (stage,) = shot.glob("*.usda")
    said = drapery("convert", stage, tmp_path / "one.usdc", "--object", f"/{stage.stem}/groups/groupsShape")
    seen = ask("split_normals.py", tmp_path / "one.usdc")
    assert seen["of_corners"] and np.array_equal(seen["normals"].astype(np.float32), normals) and "not copied" not in said
    drapery("convert", shot / "groups.abc", tmp_path / "cut.abc", "--triangles")
    seen = ask("split_normals.py", tmp_path / "cut.abc")
    assert seen["of_corners"] and seen["normals"].shape == (3, 36, 3)
    drapery("verify", shot / "groups.abc", "--record", shot)
    # A normal that is another one's.
    number, other = (normals[2][place].tobytes() for place in (0, 4))
    damaged = (shot / "groups.h5").read_bytes()
    assert number in damaged
    (shot / "groups.h5").write_bytes(damaged.replace(number, other, 1))
    done = subprocess.run([DRAPERY, "verify", shot / "groups.h5", "--record", shot], capture_output=True, text=True)
    (shot / "groups.h5").write_bytes(damaged)
    assert done.returncode != 0 and "normals do not match the points" in done.stdout + done.stderr, done.stdout + done.stderr
