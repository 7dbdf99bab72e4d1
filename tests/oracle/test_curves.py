"""Numbers over time in runs of the command: the law of free fall, the same bytes after stops and on two processes, and bad curves."""

import json
import os
import shutil
import subprocess

import h5py
import numpy as np
import pytest

from farm import BAD_INPUT, BAD_SCENE, DRAPERY, MISSING_INPUT, assert_same, results
from howto import said
from test_mpi import AS_ROOT, MORE_THAN_CORES

SCENE = """drapery = 1
[shot]
name = "curves"
fps = "24"
frames = "1-9"
[output]
format = ["abc", "h5"]
[gravity]
acceleration = [[2, [0, 0, 0]], [6, [0, -8, 0]]]
[self_repulsion]
friction = [[1, 0.4], [9, 0.1]]
[self_collision]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
friction = [[3, 0.5], [7, 0]]
thickness = "3 mm"
[[garment]]
name = "sheet"
density = 0.2
thickness = "2 mm"
panel = { resolution = 16, side = 0.5, aspect = 1, center = [0, 0.205, 0] }
[garment.stretch]
stiffness = [[1, "400 N/m"], [9, "60 N/m"]]
[garment.dihedral_bending]
stiffness = 1e-5
"""

ENVIRONMENT = {**os.environ, **AS_ROOT, **MORE_THAN_CORES, "OMPI_MCA_mpi_yield_when_idle": "1"}


@pytest.fixture(params=["semi_implicit", "tr_bdf2"])
def scene(request, tmp_path):
    path = tmp_path / "curves.toml"
    path.write_text(SCENE.replace("[gravity]", f'[solver]\nintegrator = "{request.param}"\n[gravity]'))
    return path


def test_runs_that_stop_and_runs_of_two_processes_have_the_same_bytes(scene, tmp_path):
    said("run", scene, "--out", tmp_path / "whole")
    whole = results(tmp_path / "whole")
    for last in (2, 5, 9):
        said("run", scene, "--out", tmp_path / "parts", "--frames", f"1-{last}", *([] if last == 2 else ["--resume-with-changes"]))
    caches = {name for name in whole if not name.startswith("frame_")}
    parts = results(tmp_path / "parts")
    assert all(parts[name] == whole[name] for name in caches)
    if shutil.which("mpirun"):
        line = ["mpirun", "-n", "2", DRAPERY, "run", scene, "--out", tmp_path / "two", "--threads", "1"]
        done = subprocess.run(list(map(str, line)), capture_output=True, text=True, env=ENVIRONMENT, stdin=subprocess.DEVNULL)
        assert done.returncode == 0, done.stderr
        assert_same(tmp_path / "two", whole)
    # The written-out scene runs to the same bytes.
    said("run", tmp_path / "whole" / "resolved.toml", "--out", tmp_path / "again")
    assert all(results(tmp_path / "again")[name] == whole[name] for name in caches)


def test_cloth_falls_with_the_gravity_of_each_frame(tmp_path):
    path = tmp_path / "fall.toml"
    path.write_text('drapery = 1\n[shot]\nframes = "1-9"\n[output]\nformat = ["h5"]\n[gravity]\nacceleration = [[2, [0, 0, 0]], [6, [0, -8, 0]]]\n'
                    '[[garment]]\nname = "sheet"\ndensity = 0.2\npanel = { resolution = 4, side = 0.5, aspect = 1, center = [0, 1, 0] }\n')
    said("run", path, "--out", tmp_path / "out")
    [cache] = (tmp_path / "out").glob("*.h5")
    with h5py.File(cache) as file:
        heights = file["positions"][:, :, 1].mean(axis=1)
    dt, v, y, expected = 1 / 24, 0.0, 1.0, [1.0]
    for frame in range(2, 10):
        g = np.interp(frame, [2, 6], [0, 8])
        y, v = y - v * dt - g * dt * dt / 2, v + g * dt
        expected.append(y)
    assert np.allclose(heights, expected, rtol=0, atol=1e-6), heights - expected


def test_the_plan_lists_the_curves(scene):
    text, listed = said("plan", scene), json.loads(said("plan", scene, "--json"))["curves"]
    assert "garment.sheet.stretch.stiffness: 400 at 1, 60 at 9" in text
    assert listed["body.ball.friction"] == [[3, 0.5], [7, 0]] and listed["gravity.acceleration"] == [[2, [0, 0, 0]], [6, [0, -8, 0]]]


@pytest.mark.parametrize(("old", "new", "message"), [
    ("[[3, 0.5], [7, 0]]", "[[3, 0.5], [3, 0]]", "frames of `friction` have to increase"),
    ("[[3, 0.5], [7, 0]]", "[[-9, 0.5], [-3, 0]]", "ends at frame -3, before the first frame"),
    ("[[3, 0.5], [7, 0]]", "[[30, 0.5], [70, 0]]", "begins at frame 30, after the last frame of the shot, 9"),
    ("[[3, 0.5], [7, 0]]", "[[3, nan]]", "at frame 3"),
    ('[[1, "400 N/m"], [9, "60 N/m"]]', '[[1, "400 N"], [9, "60 N/m"]]', "at frame 1"),
])  # fmt: skip
def test_bad_curves_are_named(old, new, message, tmp_path):
    path = tmp_path / "bad.toml"
    path.write_text(SCENE.replace(old, new))
    text = said("check", path, code=BAD_SCENE)
    assert message in text and "bad.toml:" in text, text


SLIDE = """drapery = 1
[shot]
fps = "24"
frames = "1001-1009"
[output]
format = ["h5"]
[gravity]
acceleration = {gravity}
[ether_drag]
rate = {rate}
[[garment]]
name = "sheet"
density = 0.2
panel = {{ resolution = 4, side = 0.5, aspect = 1, center = [0, 1, 0] }}
"""


def usd_channels(path):
    """A stage of 48 time codes a second, Z up, with an attribute of one number and one of three, written by Pixar's library."""
    from pxr import Gf, Sdf, Usd, UsdGeom

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.SetTimeCodesPerSecond(48)
    stage.SetFramesPerSecond(24)
    control = stage.DefinePrim("/shot/control")
    rate = control.CreateAttribute("rate", Sdf.ValueTypeNames.Float)
    fall = control.CreateAttribute("fall", Sdf.ValueTypeNames.Vector3d)
    for frame, value in ((1001, 0.0), (1005, 400.0)):
        rate.Set(value, 2 * frame)
        fall.Set(Gf.Vec3d(0, 0, -0.02 * value), 2 * frame)
    control.CreateAttribute("word", Sdf.ValueTypeNames.String).Set("wet")
    control.CreateAttribute("still", Sdf.ValueTypeNames.Double, custom=True).Set(2.5)
    UsdGeom.Xformable(control).AddTranslateOp().Set(Gf.Vec3d(1, 0, 0))
    stage.Save()


def alembic_channels(path):
    """The same as user properties of a transform, written by the reference library."""
    import imath
    from alembic3d import Abc, AbcCoreAbstract, AbcGeom

    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 1001 / 24))
    control = AbcGeom.OXform(AbcGeom.OXform(archive.getTop(), "shot"), "control")
    # The property stands beside the values of a transform.
    sample = AbcGeom.XformSample()
    sample.setTranslation(imath.V3d(1, 0, 0))
    control.getSchema().set(sample)
    properties = control.getSchema().getUserProperties()
    rate, fall = Abc.OFloatProperty(properties, "rate", sampling), Abc.OV3dProperty(properties, "fall", sampling)
    for frame in range(1001, 1006):
        rate.setValue(100.0 * (frame - 1001))
        fall.setValue(imath.V3d(0, 0, -2.0 * (frame - 1001)))
    Abc.OStringProperty(properties, "word").setValue("wet")
    Abc.ODoubleProperty(properties, "still").setValue(2.5)


@pytest.mark.parametrize(("name", "write"), [("control.usda", usd_channels), ("control.usdc", usd_channels), ("control.abc", alembic_channels)])
def test_channels_of_files_are_the_keys_that_they_hold(name, write, tmp_path):
    write(tmp_path / name)
    held = subprocess.run([DRAPERY, "info", str(tmp_path / name)], capture_output=True, text=True, check=True).stdout
    samples = 5 if name == "control.abc" else 2
    for line in (f"rate: one number, {samples} samples", f"fall: three numbers, {samples} samples", "still: one number, one sample"):
        assert f"\nchannel /shot/control.{line}\n" in held, held
    assert held.count("channel ") == 3, "neither the word nor the transform that stands still is one"
    # A stage says that Z is up.
    turned = ', up = "Z"' if name == "control.abc" else ""
    channel = lambda property, more="": f'{{ file = "{name}", channel = "/shot/control.{property}"{more} }}'
    (tmp_path / "channels.toml").write_text(SLIDE.format(gravity=channel("fall", turned), rate=channel("rate", ", scale = 0.01")))
    keys = "[[1001, {}], [1005, {}]]"
    (tmp_path / "keys.toml").write_text(SLIDE.format(gravity=keys.format([0, 0, 0], [0, -8, 0]), rate=keys.format(0, 4.0)))
    plan = subprocess.run([DRAPERY, "plan", str(tmp_path / "channels.toml"), "--json"], capture_output=True, text=True, check=True)
    listed = json.loads(plan.stdout)["curves"]
    assert listed["ether_drag.rate"][0] == [1001, 0] and np.allclose(listed["ether_drag.rate"][-1], [1005, 4])
    positions = {}
    for scene in ("channels", "keys", "resolved"):
        file = tmp_path / f"{scene}.toml" if scene != "resolved" else tmp_path / "channels" / "resolved.toml"
        said("run", file, "--out", tmp_path / scene)
        with h5py.File(tmp_path / scene / "sheet.h5") as cache:
            positions[scene] = cache["positions"][()]
    assert np.ptp(positions["keys"][:, 0, 1]) > 0.05
    np.testing.assert_allclose(positions["channels"], positions["keys"], rtol=0, atol=1e-6)
    assert np.array_equal(positions["channels"], positions["resolved"])
    # Five samples, or a stage, say which rate is theirs.
    rate = "the samples of the file are at 24 frames per second" if name == "control.abc" else "the file states 24 frames per second"
    (tmp_path / "pal.toml").write_text((tmp_path / "channels.toml").read_text().replace('"24"', '"25"').replace("1001-1009", "1040-1049"))
    warned = said("check", tmp_path / "pal.toml")
    assert f"frame_rate: {tmp_path / 'pal.toml'}:" in warned and f"curve of ether_drag.rate: {tmp_path / name}: {rate}" in warned, warned
    # The file is an input.
    (tmp_path / name).unlink()
    said("run", tmp_path / "channels.toml", "--out", tmp_path / "other", code=MISSING_INPUT)


@pytest.mark.parametrize(("channel", "message"), [
    ('{ file = "control.abc", channel = "/shot/control.rte" }', "there is no such property"),
    ('{ file = "control.abc", channel = "/shot/controls.rate" }', "/shot/controls"),
    ('{ file = "control.abc", channel = "/shot/control.word" }', "it does not hold numbers"),
    ('{ file = "control.usda", channel = "/shot/control.rte" }', "there is no such attribute"),
    ('{ file = "control.usda", channel = "/shot/control.rte" }', "its attributes of numbers are"),
    ('{ file = "control.usda", channel = "/shot/controls.rate" }', "the stage has no such prim"),
    ('{ file = "control.usda", channel = "/shot/control.word" }', "it does not hold numbers"),
    ('{ file = "control.usda", channel = "/shot/control.fall" }', "`rate`"),
    ('{ file = "control.usda", channel = "/shot/control.rate", scale = -1 }', "at frame 1005 of the channel"),
    ('{ file = "control.usda", channel = "rate" }', "is not the path of an object and the name of its property"),
    ('{ file = "control.obj", channel = "/a.rate" }', "channels are not read from"),
    ('{ file = "none.abc", channel = "/a.rate" }', "none.abc"),
    ('{ channel = "/a.rate" }', "a channel needs `file`"),
    ('{ file = "control.abc", channel = "/a.rate", up = "X" }', '`up` of a channel has to be "Y" or "Z"'),
    ('{ file = "control.abc", channel = "/a.rate", frames = 3 }', "unknown key `frames`"),
    ('{ file = "control.abc", chanel = "/a.rate" }', "did you mean `channel`"),
])  # fmt: skip
def test_channels_that_cannot_be_are_named(channel, message, tmp_path):
    usd_channels(tmp_path / "control.usda")
    alembic_channels(tmp_path / "control.abc")
    (tmp_path / "bad.toml").write_text(SLIDE.format(gravity="[0, -9.81, 0]", rate=channel))
    done = subprocess.run([DRAPERY, "check", str(tmp_path / "bad.toml")], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode in (BAD_SCENE, BAD_INPUT, MISSING_INPUT), done
    assert message in done.stderr and "help:" in done.stderr, done.stderr


def test_maps_by_frame_are_straight_between_and_run_again_from_the_resolved_scene(tmp_path):
    """A map of the drag's rate goes from nothing to 8 1/s; free cloth slows by it as by a curve of the rate where the map is even."""
    for name, value in (("dry", 0.0), ("wet", 1.0)):
        (tmp_path / f"{name}.txt").write_text("\n".join([str(value)] * 25))
    text = SLIDE.format(gravity="[0, -9.81, 0]", rate=8.0)
    line = '[[1002, "file:dry.txt"], [1006, "file:wet.txt"]]'
    maps = f"{text}maps.ether_drag = {line}\n"
    curve = text.replace("rate = 8.0", "rate = [[1002, 0], [1006, 8.0]]")
    found = {}
    for name, scene in (("maps", maps), ("curve", curve)):
        (tmp_path / f"{name}.toml").write_text(scene)
        said("run", tmp_path / f"{name}.toml", "--out", tmp_path / name)
        found[name] = h5py.File(tmp_path / name / "sheet.h5")["positions"][()]
    np.testing.assert_allclose(found["maps"], found["curve"], rtol=0, atol=1e-6)
    said("run", tmp_path / "maps" / "resolved.toml", "--out", tmp_path / "again")
    assert np.array_equal(h5py.File(tmp_path / "again" / "sheet.h5")["positions"][()], found["maps"])
    assert "garment.sheet.maps.ether_drag: maps at 1002, 1006" in said("plan", tmp_path / "maps.toml")
    for new, message in (('[[1002, "file:dry.txt"], [1002, "file:wet.txt"]]', "frames of `ether_drag` have to increase"),
                         ('[[1002, "file:dry.txt"], [1006, 3]]', "has to be a name or a file"),
                         ('[[1002, "file:dry.txt"], [1006, "file:gone.txt"]]', "gone.txt"),
                         ('[[9, "file:dry.txt"]]', "this list of maps ends at frame 9"), ("[]", "has no keys")):  # fmt: skip
        (tmp_path / "bad.toml").write_text(maps.replace(line, new))
        done = subprocess.run([DRAPERY, "check", str(tmp_path / "bad.toml")], capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert done.returncode in (BAD_SCENE, BAD_INPUT, MISSING_INPUT) and message in done.stderr, done
