"""Archives of the `write_demo` example, read by the official Alembic library.

Needs the Python package `alembic3d`. Write the files and run:

    cargo run -p drapery-alembic --example write_demo demo_archives
    DRAPERY_ALEMBIC_DEMO=demo_archives pytest tests/oracle/test_alembic_official.py
"""

import itertools
import math
import os
import pathlib
import shutil

import pytest

alembic3d = pytest.importorskip("alembic3d", reason="skipped: no alembic3d")
from alembic3d import Abc, AbcGeom  # noqa: E402

FOLDER = os.environ.get("DRAPERY_ALEMBIC_DEMO")
pytestmark = pytest.mark.skipif(not FOLDER, reason="skipped: DRAPERY_ALEMBIC_DEMO names no folder")

SIDE = 5
WRAP = Abc.WrapExistingFlag.kWrapExisting


def archive(name):
    return Abc.IArchive(str(pathlib.Path(FOLDER) / name))


def at(schema_or_property, index):
    """The library takes an int in a selector for a time, so samples are chosen by their exact time."""
    return Abc.ISampleSelector(schema_or_property.getTimeSampling().getSampleTime(index))


def descend(opened, *names):
    found = opened.getTop()
    for name in names:
        found = found.getChild(name)
    return found


def demo_mesh(name="demo.abc"):
    opened = archive(name)
    # The archive has to stay alive as long as its objects.
    return opened, AbcGeom.IPolyMesh(descend(opened, "cloth", "clothShape"), WRAP).getSchema()


def flat(vectors):
    return [x for vector in vectors for x in vector]


@pytest.mark.parametrize("name, frames", [("demo.abc", 6), ("continued.abc", 6), ("killed.abc", 3)])
def test_positions_and_velocities_of_every_committed_frame(name, frames):
    opened, mesh = demo_mesh(name)
    assert mesh.getNumSamples() == frames
    assert mesh.getTopologyVariance() == AbcGeom.MeshTopologyVariance.kHomogenousTopology
    for frame in range(frames):
        time = mesh.getTimeSampling().getSampleTime(frame)
        assert time == pytest.approx((1001 + frame) / 24, abs=1e-12)
        sample = mesh.getValue(at(mesh, frame))
        grid = [(c / (SIDE - 1), r / (SIDE - 1)) for r in range(SIDE) for c in range(SIDE)]
        expected = flat((x, 0.125 * x * frame, z) for x, z in grid)
        assert flat(sample.getPositions()) == pytest.approx(expected, abs=1e-6)
        assert flat(sample.getVelocities()) == pytest.approx(flat((0, 3 * x, 0) for x, _ in grid), abs=1e-6)
        corners = [r * SIDE + c + d for r in range(4) for c in range(4) for d in (0, 1, SIDE + 1, SIDE)]
        assert list(sample.getFaceIndices()) == corners
        assert list(sample.getFaceCounts()) == [4] * 16
        box = sample.getSelfBounds()
        assert tuple(box.min()) == (0, 0, 0)
        assert tuple(box.max()) == (1, 0.125 * frame, 1)


def test_uvs_are_indexed_and_named_and_normals_follow_the_frames():
    opened, mesh = demo_mesh()
    uv = mesh.getUVsParam()
    assert uv.isIndexed() and uv.getScope() == AbcGeom.GeometryScope.kFacevaryingScope
    assert uv.getMetaData().get("sourceName") == "map1"
    corners = [r * SIDE + c + d for r in range(4) for c in range(4) for d in (0, 1, SIDE + 1, SIDE)]
    expected = flat((v % SIDE / 4, v // SIDE / 4) for v in corners)
    for frame in (0, 5):
        assert flat(uv.getExpandedValue(at(uv, frame)).getVals()) == pytest.approx(expected)
    normals = mesh.getNormalsParam()
    assert normals.getScope() == AbcGeom.GeometryScope.kVertexScope
    for frame in range(6):
        slope = 0.125 * frame
        length = math.hypot(1, slope)
        expected = flat([(-slope / length, 1 / length, 0)] * SIDE**2)
        assert flat(normals.getExpandedValue(at(normals, frame)).getVals()) == pytest.approx(expected, abs=1e-6)


def test_the_transform_moves_and_the_archive_bounds_follow():
    opened = archive("demo.abc")
    xform = AbcGeom.IXform(descend(opened, "cloth"), WRAP).getSchema()
    assert xform.getNumSamples() == 6 and not xform.isConstant()
    bounds = Abc.IBox3dProperty(opened.getTop().getProperties(), ".childBnds")
    for frame in range(6):
        sample = xform.getValue(at(xform, frame))
        assert sample.getInheritsXforms()
        assert tuple(sample.getTranslation()) == pytest.approx((0, 0, 0.25 * frame))
        box = bounds.getValue(at(bounds, frame))
        assert tuple(box.min()) == pytest.approx((0, 0, 0.25 * frame))
        assert tuple(box.max()) == pytest.approx((1, 0.125 * frame, 1 + 0.25 * frame))
    assert AbcGeom.GetVisibility(descend(opened, "cloth")) == AbcGeom.ObjectVisibility.kVisibilityVisible


def test_face_sets_attributes_and_user_properties():
    opened, mesh = demo_mesh()
    assert sorted(mesh.getFaceSetNames()) == ["back", "front"]
    for name, keep in (("front", lambda f: f % 4 < 2), ("back", lambda f: f % 4 >= 2)):
        faces = mesh.getFaceSet(name).getSchema().getValue().getFaces()
        assert list(faces) == [f for f in range(16) if keep(f)]

    attributes = mesh.getArbGeomParams()
    weight = AbcGeom.IFloatGeomParam(attributes, "weight")
    assert weight.getScope() == AbcGeom.GeometryScope.kVertexScope
    assert list(weight.getExpandedValue().getVals()) == pytest.approx([v / 25 for v in range(25)])
    colour = AbcGeom.IC3fGeomParam(attributes, "colour")
    assert colour.getScope() == AbcGeom.GeometryScope.kConstantScope
    assert flat((c.r, c.g, c.b) for c in colour.getExpandedValue().getVals()) == [0.25, 0.5, 1.0]
    panel = AbcGeom.IInt32GeomParam(attributes, "panel")
    assert list(panel.getExpandedValue().getVals()) == [f % 3 for f in range(16)]
    fabric = AbcGeom.IStringGeomParam(attributes, "fabric")
    assert fabric.isIndexed() and fabric.getScope() == AbcGeom.GeometryScope.kUniformScope
    assert list(fabric.getExpandedValue().getVals()) == ["wool", "silk"] * 8

    user = mesh.getUserProperties()
    assert Abc.IStringProperty(user, "solver").getValue() == "Drapery"
    assert Abc.IDoubleProperty(user, "metersPerUnit").getValue() == 1.0
    assert list(Abc.IScalarProperty(user, "gravity").getValue()) == [0.0, -9.81, 0.0]


def test_a_continued_archive_has_the_bytes_of_one_written_at_once():
    whole, continued = (pathlib.Path(FOLDER, name).read_bytes() for name in ("demo.abc", "continued.abc"))
    assert continued == whole


def test_bytes_cut_off_behind_the_last_commit_do_no_harm(tmp_path):
    cut = tmp_path / "cut.abc"
    shutil.copy(pathlib.Path(FOLDER) / "killed.abc", cut)
    with open(cut, "r+b") as file:
        file.truncate(cut.stat().st_size - 100)
    opened = Abc.IArchive(str(cut))
    mesh = AbcGeom.IPolyMesh(descend(opened, "cloth", "clothShape"), WRAP).getSchema()
    assert mesh.getNumSamples() == 3
    assert len(mesh.getValue(at(mesh, 2)).getPositions()) == SIDE**2


def test_point_counts_may_change_at_irregular_times():
    opened = archive("changing.abc")
    mesh = AbcGeom.IPolyMesh(descend(opened, "fan", "fanShape"), WRAP).getSchema()
    assert mesh.getTopologyVariance() == AbcGeom.MeshTopologyVariance.kHeterogenousTopology
    times = [mesh.getTimeSampling().getSampleTime(i) for i in range(mesh.getNumSamples())]
    assert times == [0.0, 0.1, 0.25, 0.7]
    for triangles in range(4):
        sample = mesh.getValue(at(mesh, triangles))
        assert len(sample.getPositions()) == (triangles + 2 if triangles else 0)
        assert list(sample.getFaceCounts()) == [3] * triangles


def test_every_pattern_of_repeated_samples_is_found_again():
    opened = archive("patterns.abc")
    top = opened.getTop().getProperties()
    looked_up = 0
    for length in range(1, 7):
        for values in itertools.product(range(3), repeat=length):
            name = "".join(f"_{value}" for value in values)
            scalar, array = Abc.IScalarProperty(top, "s" + name), Abc.IArrayProperty(top, "a" + name)
            assert scalar.getNumSamples() == array.getNumSamples() == length
            assert scalar.isConstant() == array.isConstant() == (len(set(values)) == 1)
            for index, value in enumerate(values):
                assert scalar.getValue(at(scalar, index)) == value
                assert len(array.getValue(at(array, index))) == value
                looked_up += 1
    assert looked_up == sum(length * 3**length for length in range(1, 7))
