"""Files of other programs as Drapery reads them: rates, frames, visibility and attributes. Alembic's and Pixar's libraries write them."""

import subprocess

import imath
import numpy as np
import pytest
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from pxr import Gf, Sdf, Usd, UsdGeom

from conftest import program

POINTS = [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)]

SCENE = """
drapery = 1
[shot]
name = "sheet"
fps = "24"
frames = "1-2"
[units]
length = "m"
up = "Y"
[gravity]
[[garment]]
name = "sheet"
rest = "rest.abc"
material = "cotton_shirting"
start = "{start}"
"""


def drapery(*arguments):
    line = [program("DRAPERY", "drapery"), *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL)


def filled(array, values):
    for place, value in enumerate(values):
        array[place] = value
    return array


def alembic(path, first, samples, rate=24.0, moves="points", visible=()):
    """A square that rises by 1 a frame of 24, from the frame `first` on, by itself or with its parent; `visible` are values of the
    visibility of the parent, frame by frame."""
    archive = Abc.CreateArchiveWithInfo(str(path), rate, "studio", "") if rate else Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, first / 24))
    parent = AbcGeom.OXform(archive.getTop(), "set")
    mesh = AbcGeom.OPolyMesh(parent, "cloth")
    schema = mesh.getSchema()
    if moves == "points":
        schema.setTimeSampling(sampling)
    else:
        parent.getSchema().setTimeSampling(sampling)
    corners, faces = filled(imath.IntArray(4), [0, 1, 2, 3]), filled(imath.IntArray(1), [4])
    for sample in range(samples):
        y = first + sample
        if moves == "points" or sample == 0:
            points = [imath.V3f(x, y if moves == "points" else 0, z) for x, _, z in POINTS]
            schema.set(AbcGeom.OPolyMeshSchemaSample(filled(imath.V3fArray(4), points), corners, faces))
        if moves == "parent":
            place = AbcGeom.XformSample()
            place.setTranslation(imath.V3d(0, y, 0))
            parent.getSchema().set(place)
    if visible:
        property = AbcGeom.CreateVisibilityProperty(parent, sampling)
        for value in visible:
            property.setValue(value)
    return path


def usd_mesh(path, primvars=(), frames=(), up="Y", metres=1.0):
    """A square with these primvars: name, type, interpolation and values."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres)
    mesh = UsdGeom.Mesh.Define(stage, "/cloth")
    stage.SetDefaultPrim(mesh.GetPrim())
    mesh.CreateFaceVertexCountsAttr([4])
    mesh.CreateFaceVertexIndicesAttr([3, 2, 1, 0])
    mesh.CreateSubdivisionSchemeAttr("none")
    if frames:
        stage.SetStartTimeCode(frames[0])
        stage.SetEndTimeCode(frames[-1])
        for frame in frames:
            mesh.CreatePointsAttr().Set([Gf.Vec3f(x, frame, z) for x, _, z in POINTS], frame)
    else:
        mesh.CreatePointsAttr([Gf.Vec3f(*point) for point in POINTS])
    for name, kind, interpolation, values in primvars:
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, kind, interpolation).Set(values)
    return stage


@pytest.mark.parametrize(("frame", "is_there"), [(1, True), (2.5, True), (5, True), (0, False), (5.25, False), (990, False)])
def test_a_start_pose_outside_of_the_samples_of_its_file_is_refused(tmp_path, frame, is_there):
    alembic(tmp_path / "rest.abc", 1, 1)
    alembic(tmp_path / "pose.abc", 1, 5)
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(start=f"pose.abc@{frame}"))
    done = drapery("check", scene)
    said = done.stdout + done.stderr
    if is_there:
        assert done.returncode == 0, said
    else:
        assert done.returncode != 0 and f"frame {frame} is outside of the samples of" in said, said
        assert "which cover frames 1 to 5 at 24.000000 fps" in said and "start" in said


def test_a_rate_against_the_one_that_an_alembic_file_states_is_refused_and_one_in_its_place_is_taken(tmp_path):
    stated = alembic(tmp_path / "stated.abc", 1, 9)
    refused = drapery("convert", stated, tmp_path / "a.usdc", "--fps", 12)
    assert refused.returncode != 0 and "at 24 fps, not at 12" in refused.stdout + refused.stderr
    assert not (tmp_path / "a.usdc").exists()
    assert drapery("convert", stated, tmp_path / "b.usdc", "--fps", 24).returncode == 0
    silent = alembic(tmp_path / "silent.abc", 2, 9, rate=None)
    taken = drapery("convert", silent, tmp_path / "c.usdc", "--fps", 24)
    assert taken.returncode == 0, taken.stdout + taken.stderr
    stage = Usd.Stage.Open(str(tmp_path / "c.usdc"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (2, 10)


def test_differences_are_named_by_the_times_of_samples_of_which_none_is_at_a_whole_frame(tmp_path):
    a = alembic(tmp_path / "a.abc", 1001.5, 4)
    assert drapery("diff", a, alembic(tmp_path / "same.abc", 1001.5, 4)).returncode == 0
    other = drapery("diff", a, alembic(tmp_path / "late.abc", 1002.5, 4))
    assert other.returncode != 0
    assert "only the first has 1 samples between frames, the first at frame 1001.5" in other.stdout, other.stdout
    assert "only the second has 1 samples between frames, the first at frame 1005.5" in other.stdout, other.stdout


def test_texture_coordinates_are_compared(tmp_path):
    kind, corners = Sdf.ValueTypeNames.TexCoord2fArray, [(0, 0), (1, 0), (1, 1), (0, 1)]
    for name, last in [("a", (0, 1)), ("b", (0, 1)), ("c", (0, 0.5))]:
        usd_mesh(tmp_path / f"{name}.usda", [("st", kind, "faceVarying", [*corners[:3], last])]).Save()
    assert drapery("diff", tmp_path / "a.usda", tmp_path / "b.usda").returncode == 0
    other = drapery("diff", tmp_path / "a.usda", tmp_path / "c.usda")
    assert other.returncode != 0 and "the texture coordinates of 1 of 4 face corners differ" in other.stdout, other.stdout


def test_primvars_that_do_not_fit_the_mesh_are_left_out_and_named_and_colours_with_alpha_stay_colours(tmp_path):
    floats, colours = Sdf.ValueTypeNames.FloatArray, Sdf.ValueTypeNames.Color4fArray
    primvars = [
        ("points", floats, "vertex", [1, 2, 3, 4]),
        ("fewer", floats, "vertex", [1, 2, 3]),
        ("faces", floats, "uniform", [1, 2]),
        ("corners", floats, "faceVarying", [1, 2, 3, 4, 5]),
        ("whole", floats, "constant", [1, 2]),
        ("rgba", colours, "vertex", [(1, 0, 0, 1), (0, 1, 0, 1), (0, 0, 1, 1), (1, 1, 1, 0.5)]),
    ]
    usd_mesh(tmp_path / "a.usda", primvars).Save()
    done = drapery("convert", tmp_path / "a.usda", tmp_path / "b.usdc")
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    for what in ("fewer (3 values for 4 points)", "faces (2 values for 1 faces)", "corners (5 values for 4 face corners)"):
        assert f"primvars:{what} is not copied" in said, said
    stage = Usd.Stage.Open(str(tmp_path / "b.usdc"))
    mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    held = {primvar.GetPrimvarName(): primvar for primvar in UsdGeom.PrimvarsAPI(mesh).GetAuthoredPrimvars()}
    assert {"points", "whole", "rgba"} <= set(held) and not {"fewer", "faces", "corners"} & set(held)
    assert held["rgba"].GetTypeName() == colours
    assert np.array_equal(np.array(held["rgba"].Get()), np.array(primvars[-1][-1], np.float32))


@pytest.mark.parametrize("extension", ["usdc", "abc"])
def test_positions_and_normals_among_primvars_go_with_the_geometry(tmp_path, extension):
    names, points = Sdf.ValueTypeNames, [(10, 20, 30), (40, 50, 60), (70, 80, 90), (1, 2, 3)]
    primvars = [
        ("rest_place", names.Point3fArray, "vertex", points),
        ("flow", names.Vector3fArray, "vertex", points),
        ("rest_normal", names.Normal3fArray, "vertex", [(0, 0, 1)] * 4),
        ("weights", names.Float3Array, "vertex", points),
    ]
    usd_mesh(tmp_path / "a.usda", primvars, up="Z", metres=0.01).Save()
    done = drapery("convert", tmp_path / "a.usda", tmp_path / f"b.{extension}", "--length", "m", "--up", "Y", "--fps", 24)
    assert done.returncode == 0, done.stdout + done.stderr
    turned = [(x / 100, z / 100, -y / 100) for x, y, z in points]
    if extension == "usdc":
        stage = Usd.Stage.Open(str(tmp_path / "b.usdc"))
        mesh = next(prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
        found = {name: UsdGeom.PrimvarsAPI(mesh).GetPrimvar(name).Get() for name, *_ in primvars}
    else:
        top = Abc.IArchive(str(tmp_path / "b.abc")).getTop()
        while not AbcGeom.IPolyMesh.matches(top.getHeader()):
            top = top.getChild(0)
        params = AbcGeom.IPolyMesh(top, Abc.WrapExistingFlag.kWrapExisting).getSchema().getArbGeomParams()
        kinds = {"rest_place": AbcGeom.IP3fGeomParam, "flow": AbcGeom.IV3fGeomParam, "rest_normal": AbcGeom.IN3fGeomParam}
        found = {name: [tuple(v) for v in kind(params, name).getExpandedValue().getVals()] for name, kind in kinds.items()}
        found["weights"] = points
    for name, expected in [("rest_place", turned), ("flow", turned), ("rest_normal", [(0, 1, 0)] * 4), ("weights", points)]:
        assert np.allclose(np.array(found[name]), expected, rtol=1e-6, atol=1e-7), name


def test_info_names_the_frames_of_one_frame_of_parents_that_move_and_of_other_time_codes(tmp_path):
    usd_mesh(tmp_path / "one.usda", frames=[1001]).Save()
    assert "frames 1001.000 to 1001.000 at 24 fps" in drapery("info", tmp_path / "one.usda").stdout
    usd_mesh(tmp_path / "still.usda").Save()
    still = drapery("info", tmp_path / "still.usda").stdout
    assert "samples: 1\n" in still, still
    parent = drapery("info", alembic(tmp_path / "parent.abc", 1001, 5, moves="parent")).stdout
    assert "samples: 5 from" in parent and "frames 1001.000 to 1005.000 at 24" in parent, parent
    assert "moved by its parents" in parent
    codes = usd_mesh(tmp_path / "codes.usda", frames=[2002, 2010])
    codes.SetTimeCodesPerSecond(48)
    codes.SetFramesPerSecond(24)
    codes.Save()
    # 2002/48 s are 1001 frames of 1/24 s.
    shown = drapery("info", tmp_path / "codes.usda").stdout
    assert "frames 1001.000 to 1005.000 at 24 fps" in shown, shown


@pytest.mark.parametrize(("visible", "is_seen"), [((), True), ((-1,), True), ((1,), True), ((0,), False), ((0, 0, 0), False), ((0, 1, 0), True)])
def test_meshes_of_an_archive_that_are_hidden_at_all_times_are_not_read(tmp_path, visible, is_seen):
    alembic(tmp_path / "rest.abc", 1, 1)
    hidden = alembic(tmp_path / "hidden.abc", 1, 3, visible=visible)
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE.format(start="hidden.abc@1"))
    checked, converted = drapery("check", scene), drapery("convert", hidden, tmp_path / "out.usdc")
    assert (checked.returncode == 0, converted.returncode == 0) == (is_seen, is_seen), checked.stdout + converted.stderr
    why = "the mesh /set/cloth is not rendered: it is invisible"
    for done in (checked, converted):
        assert (why in done.stdout + done.stderr) != is_seen
    assert ("(not read: it is invisible)" in drapery("info", hidden).stdout) != is_seen
