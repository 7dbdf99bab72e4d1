"""A shot with a body from USD gives the caches that it gives with the same body from Alembic.

The Alembic body is written here with Alembic's own library from what Pixar's library reads of the stage.
"""

import subprocess

import h5py
import imath
import numpy as np
import pytest
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from pxr import Gf, Usd, UsdGeom, Vt

from conftest import program
from judges import SHARED

WOMAN = SHARED / "woman_walk_dance"

SCENE = """
drapery = 1
[shot]
name = "skirt"
fps = "24"
frames = "{frames}"
{units}
[gravity]
[self_repulsion]
[self_collision]
[[body]]
name = "woman"
file = "{body}"
friction = 0.3
thickness = "0.8 mm"
max_push_speed = 1.0
[[garment]]
name = "skirt"
rest = "{data}/skirt_lowres.obj"
units = {{ length = "m", up = "Y" }}
material = "wool_suiting"
[[garment.pin]]
file = "{data}/skirt_lowres_pins.json"
to = "body:woman"
bind = "nearest"
[output]
format = ["h5"]
"""

UNITS = '[units]\nlength = "m"\nup = "Y"'


def write_alembic(path, stage, prim):
    """The mesh in the world, one sample a time code; Alembic's faces run clockwise."""
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(prim))
    counts = mesh.GetFaceVertexCountsAttr().Get()
    indices, first = [], 0
    for count in counts:
        indices += reversed(mesh.GetFaceVertexIndicesAttr().Get()[first : first + count])
        first += count
    archive = Abc.OArchive(str(path))
    schema = AbcGeom.OPolyMesh(archive.getTop(), "body").getSchema()
    codes = mesh.GetPointsAttr().GetTimeSamples()
    rate = stage.GetTimeCodesPerSecond()
    schema.setTimeSampling(archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / rate, codes[0] / rate)))
    integers = lambda values: fill(imath.IntArray(len(values)), [int(value) for value in values])
    corners, faces = integers(indices), integers(counts)
    for code in codes:
        world = np.array(mesh.ComputeLocalToWorldTransform(code))
        points = np.array(mesh.GetPointsAttr().Get(code), dtype=float) @ world[:3, :3] + world[3, :3]
        positions = fill(imath.V3fArray(len(points)), [imath.V3f(*map(float, point)) for point in points])
        schema.set(AbcGeom.OPolyMeshSchemaSample(positions, corners, faces))


def fill(array, values):
    for place, value in enumerate(values):
        array[place] = value
    return array


def run(folder, body, units, frames="0-3", command="run"):
    scene = folder / "scene.toml"
    scene.write_text(SCENE.format(body=body, data=WOMAN, units=units, frames=frames))
    out = ["--out", str(folder / "out")] if command == "run" else []
    line = [program("DRAPERY", "drapery"), command, str(scene), *out]
    return subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def positions(folder):
    with h5py.File(next((folder / "out").rglob("*.h5"))) as cache:
        found = []
        cache.visititems(lambda name, item: found.append(item[()]) if name.endswith("positions") else None)
        return np.concatenate([array.reshape(-1, 3) for array in found])


@pytest.fixture(scope="module")
def alembic_body(tmp_path_factory):
    path = tmp_path_factory.mktemp("body") / "body.abc"
    stage = Usd.Stage.Open(str(WOMAN / "body_lowres.usdc"))
    prim = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    write_alembic(path, stage, prim.GetPath())
    return path


def test_a_body_from_usd_gives_the_caches_of_the_same_body_from_alembic(tmp_path, alembic_body, report_figure):
    found = {}
    for kind, body, units in [("usd", WOMAN / "body_lowres.usdc", ""), ("abc", alembic_body, UNITS)]:
        folder = tmp_path / kind
        folder.mkdir()
        checked = run(folder, body, units, command="check")
        assert checked.returncode == 0, checked.stdout + checked.stderr
        done = run(folder, body, units)
        assert done.returncode == 0, done.stdout + done.stderr
        found[kind] = positions(folder)
    assert found["usd"].shape == found["abc"].shape and found["usd"].size > 0
    apart = np.abs(found["usd"] - found["abc"]).max()
    # Positions of the Alembic body are rounded to single precision once more: 1e-7 m, which contact answers.
    assert apart < 1e-5
    report_figure(f"a skirt on a body from USD and from Alembic: at most {apart:.1e} m apart after three frames")


def test_units_that_contradict_the_file_are_told(tmp_path):
    done = run(tmp_path, WOMAN / "body_lowres.usdc", '[units]\nlength = "cm"\nup = "Z"', command="check")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the file states metres, Y up, which overrides [units]" in done.stdout + done.stderr


def test_a_body_that_ends_too_early_or_changes_its_points_is_refused_by_name(tmp_path):
    done = run(tmp_path, WOMAN / "body_lowres.usdc", "", frames="90-120", command="check")
    assert done.returncode == 65, done.stdout + done.stderr
    assert 'body "woman"' in done.stdout + done.stderr
    body = tmp_path / "body.usda"
    points = ["[(0,0,0), (1,0,0), (0,1,0)]", "[(0,0,0), (1,0,0), (0,1,0), (1,1,1)]"]
    body.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Y"\n)\ndef Mesh "m" {\n point3f[] points.timeSamples = {'
        f" 0: {points[0]}, 2: {points[1]} }}\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n}}"
    )
    done = run(tmp_path, body, "", command="check")
    assert done.returncode == 65, done.stdout + done.stderr
    assert "body.usda, /m), frame 2: 4 points, but there were 3 at the start" in done.stdout + done.stderr


@pytest.mark.parametrize("ending", ["h5", "abc", "usd", "usdc"])
def test_velocities_that_do_not_match_the_points_are_refused_by_name(ending, tmp_path):
    cache = tmp_path / "cache.usda"
    cache.write_text(
        '#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Y"\n framesPerSecond = 24\n timeCodesPerSecond = 24\n)\ndef Mesh "m" {\n'
        " point3f[] points.timeSamples = { 0: [(0,0,0), (1,0,0), (0,1,0)], 1: [(0,0,1), (1,0,1), (0,1,1)] }\n"
        " vector3f[] velocities = [(0,0,1), (0,0,1)]\n int[] faceVertexCounts = [3]\n int[] faceVertexIndices = [0, 1, 2]\n}"
    )
    command = [program("DRAPERY", "drapery"), "convert", cache, tmp_path / f"out.{ending}"]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 65 and "/m: 2 velocities for 3 points" in done.stderr, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["cache.usda"]


def test_a_small_layer_that_promises_gigabytes_is_refused(tmp_path):
    """Samples that are alike are one array on disk, and would be as many in memory."""
    body = tmp_path / "body.usdc"
    stage = Usd.Stage.CreateNew(str(body))
    mesh = UsdGeom.Mesh.Define(stage, "/still")
    points = Vt.Vec3fArray.FromNumpy(np.random.default_rng(1).normal(size=(20_000, 3)).astype(np.float32))
    for code in range(6000):
        mesh.GetPointsAttr().Set(points, code)
    stage.Save()
    assert body.stat().st_size < 1_000_000
    done = run(tmp_path, body, UNITS, command="check")
    assert done.returncode == 65, done.stdout + done.stderr
    assert "timeSamples of an attribute take 1440 MB" in done.stdout + done.stderr


def instanced_stage(path):
    """Two prototypes with transforms of their own at six places each, some hidden, under a parent that moves."""
    random = np.random.default_rng(7)
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(3)
    world = UsdGeom.Xform.Define(stage, "/set")
    stage.SetDefaultPrim(world.GetPrim())
    turn = world.AddRotateXYZOp()
    for code in (1, 2, 3):
        turn.Set((10.0 * code, 20.0, -5.0 * code), code)
    instancer = UsdGeom.PointInstancer.Define(stage, "/set/scatter")
    instancer.AddTranslateOp().Set((1.0, 2.0, 3.0))
    for number, (name, shift) in enumerate([("leaf", (0.5, 0, 0)), ("stone", (0, -0.25, 1))]):
        root = UsdGeom.Xform.Define(stage, f"/set/scatter/{name}")
        root.AddTranslateOp().Set(shift)
        root.AddScaleOp().Set((1.0, 1.5, 0.5 + number))
        mesh = UsdGeom.Mesh.Define(stage, f"/set/scatter/{name}/shape")
        mesh.AddRotateYOp().Set(33.0)
        mesh.GetPointsAttr().Set(Vt.Vec3fArray.FromNumpy(random.normal(size=(4, 3)).astype(np.float32)))
        mesh.GetFaceVertexCountsAttr().Set([3, 3])
        mesh.GetFaceVertexIndicesAttr().Set([0, 1, 2, 2, 1, 3])
        mesh.GetSubdivisionSchemeAttr().Set("none")
        instancer.GetPrototypesRel().AddTarget(root.GetPath())
    instancer.GetProtoIndicesAttr().Set([0, 1, 0, 1, 1, 0])
    instancer.GetIdsAttr().Set([10, 11, 12, 13, 14, 15])
    instancer.GetInvisibleIdsAttr().Set([13])
    instancer.DeactivateId(12)
    quaternions = random.normal(size=(6, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    instancer.GetOrientationsAttr().Set([Gf.Quath(float(w), Gf.Vec3h(float(x), float(y), float(z))) for w, x, y, z in quaternions])
    # One of them mirrors.
    scales = random.uniform(0.5, 2.0, size=(6, 3)) * np.where(np.arange(6) == 4, -1, 1)[:, None]
    instancer.GetScalesAttr().Set(Vt.Vec3fArray.FromNumpy(scales.astype(np.float32)))
    for code in (1, 2, 3):
        positions = random.normal(size=(6, 3)).astype(np.float32)
        instancer.GetPositionsAttr().Set(Vt.Vec3fArray.FromNumpy(positions), code)
    stage.Save()
    return stage


def test_instances_are_where_pixars_library_places_them(tmp_path):
    stage = instanced_stage(tmp_path / "scatter.usdc")
    line = [program("DRAPERY", "drapery"), "convert", tmp_path / "scatter.usdc", tmp_path / "placed.usdc"]
    done = subprocess.run(list(map(str, line)), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stdout + done.stderr
    placed = Usd.Stage.Open(str(tmp_path / "placed.usdc"))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/set/scatter"))
    indices = np.array(instancer.GetProtoIndicesAttr().Get())
    for number, name in enumerate(["leaf", "stone"]):
        ours = UsdGeom.Mesh(placed.GetPrimAtPath(f"/set/scatter/{name}/shape"))
        mesh = stage.GetPrimAtPath(f"/set/scatter/{name}/shape")
        points = np.array(UsdGeom.Mesh(mesh).GetPointsAttr().Get(), float)
        for code in (1, 2, 3):
            everywhere = instancer.ComputeInstanceTransformsAtTime(
                code, code, UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask)
            mask = np.array(instancer.ComputeMaskAtTime(code))
            to_root = np.array(UsdGeom.Xformable(mesh).GetLocalTransformation(code))
            to_world = np.array(instancer.ComputeLocalToWorldTransform(code))
            expected, normals = [], []
            for place in np.flatnonzero((indices == number) & mask):
                matrix = to_root @ np.array(everywhere[int(place)]) @ to_world
                expected.append(points @ matrix[:3, :3] + matrix[3, :3])
                a, b, c = expected[-1][[0, 1, 2]]
                normals.append(np.cross(b - a, c - a) * np.sign(np.linalg.det(matrix[:3, :3])))
            expected = np.concatenate(expected)
            shown = np.array(ours.GetPointsAttr().Get(code), float)
            assert shown.shape == expected.shape
            np.testing.assert_allclose(shown, expected, atol=2e-6)
        # Faces look outwards also where an instance mirrors them.
        corners = np.array(ours.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)
        assert len(corners) == 2 * len(normals)
        for face, normal in zip(corners[::2], normals):
            a, b, c = shown[face]
            assert np.dot(np.cross(b - a, c - a), normal) > 0


def test_an_incomplete_stage_ends_the_command_with_the_exit_code_of_a_missing_file(tmp_path):
    body = tmp_path / "body.usda"
    for text, code, told in [
        ('#usda 1.0\ndef "hero" ( references = @./nowhere.usda@ ) {}', 66, "nowhere.usda"),
        ('#usda 1.0\ndef Mesh "hero" { int[] faceVertexCounts = [3] }', 65, "/hero"),
        ("not USD", 65, "body.usda"),
    ]:
        body.write_text(text)
        done = run(tmp_path, body, "", command="check")
        assert done.returncode == code, done.stdout + done.stderr
        assert told in done.stdout + done.stderr
        assert "panicked" not in done.stderr
