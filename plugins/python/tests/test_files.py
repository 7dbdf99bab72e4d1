"""Work of the command on files, from Python: convert, diff, report, info; and scenes that are read."""

import json
import re
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import drapery
from table_scene import SHEET, scene

POINTS = np.array([[0, 0, 0], [0, 0, 1.5], [1, 0, 1], [1, 0, 0]])


def written(path: Path, raised: float = 0.0, frames: tuple[int, int] = (1, 3)) -> Path:
    """A quad that rises by a quarter of a metre a frame; in the second frame one corner by `raised` [m] more."""
    with drapery.CacheWriter(path, POINTS, [[0, 1, 2, 3]], frames) as writer:
        for frame in range(frames[0], frames[1] + 1):
            positions = POINTS + [0, 0.25 * frame, 0]
            positions[2, 1] += raised if frame == 2 else 0.0
            writer.write(positions)
    return path


def test_a_conversion_has_the_cloth_in_another_unit_and_format(tmp_path: Path) -> None:
    source, out = written(tmp_path / "cloth.abc"), tmp_path / "cloth.h5"
    done = drapery.convert(source, out, frames=(2, 3), length="cm", up="Z")
    assert (done.path, done.frames, done.points, done.units) == (out, (2, 3), 4, ("cm", "Z"))
    assert not done.left_out and not done.doubts
    mesh = drapery.open_cache(out).mesh
    assert drapery.open_cache(out).units == ("cm", "Z") and mesh.frames == [2, 3]
    # A quarter of a metre is a whole number of centimetres.
    assert np.array_equal(mesh[3], POINTS + [0, 0.75, 0])
    with pytest.raises(drapery.OutputError):
        drapery.convert(source, out)
    assert drapery.convert(source, out, overwrite=True).frames == (1, 3)
    for name, word in (("length", "yard"), ("up", "X"), ("from_length", "yard"), ("from_up", "X")):
        with pytest.raises(drapery.UsageError, match=f"`{name}`"):
            drapery.convert(source, tmp_path / "other.h5", **{name: word})  # type: ignore[arg-type]
    with pytest.raises(drapery.InputError) as caught:
        drapery.convert(tmp_path / "none.abc", tmp_path / "other.h5")
    assert caught.value.code == 66


def test_a_conversion_takes_a_cache_in_the_unit_that_is_said_and_doubts_a_giant(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    giant = tmp_path / "giant.abc"
    with drapery.CacheWriter(giant, 100 * POINTS, [[0, 1, 2, 3]], (1, 1)) as writer:
        writer.write(100 * POINTS)
    done = drapery.convert(giant, tmp_path / "giant.h5")
    assert any("150.000 m" in doubt and "centimetres" in doubt for doubt in done.doubts)
    assert [record.message for record in caplog.records] == done.doubts
    done = drapery.convert(giant, tmp_path / "person.h5", from_length="cm", triangles=True)
    mesh = drapery.open_cache(done.path).mesh
    assert done.doubts == [] and done.units == ("cm", "Y")
    assert np.allclose(mesh[1], POINTS, rtol=0, atol=1e-7) and mesh.faces.counts.tolist() == [3, 3]


def test_a_mesh_of_several_is_chosen_as_the_message_says(tmp_path: Path) -> None:
    stage = tmp_path / "two.usda"
    mesh = 'def Mesh "{}" {{ point3f[] points = [(0,0,0),(1,0,0),(0,{},0)] int[] faceVertexCounts = [3] int[] faceVertexIndices = [0,1,2] }}\n'
    stage.write_text('#usda 1.0\n(metersPerUnit = 1\nupAxis = "Y")\n' + mesh.format("coat", 1) + mesh.format("hat", 2))
    with pytest.raises(drapery.InputError, match="--object: /coat, /hat"):
        drapery.convert(stage, tmp_path / "hat.abc")
    drapery.convert(stage, tmp_path / "hat.abc", object="/hat")
    hat = drapery.open_cache(tmp_path / "hat.abc").mesh
    assert hat[hat.frames[0]][2, 1] == 2


def test_a_difference_names_frame_and_vertex(tmp_path: Path) -> None:
    a, b = written(tmp_path / "a.abc"), written(tmp_path / "b.abc", raised=0.125)
    assert drapery.diff(a, a).verdict == "byte-equal"
    found = drapery.diff(a, b)
    (part,) = found.parts
    assert not found.same and found.verdict == part.verdict == "differs" and part.worst is not None
    assert (part.worst.frame, part.worst.vertex, part.worst.distance) == (2, 2, 0.125)
    assert [(frame.frame, frame.max, frame.vertex) for frame in part.frames if frame.max > 0.0] == [(2, 0.125, 2)]
    # One of four corners, by an eighth of a metre.
    assert part.frames[1].rms == pytest.approx(0.0625) and part.frames[0].rms == 0.0
    assert drapery.diff(a, b, tolerance=0.2).same and drapery.diff(a, b, tolerance=0.2).verdict == "within-tolerance"
    assert drapery.diff(a, drapery.convert(a, tmp_path / "a.h5").path).verdict == "equal"
    with pytest.raises(drapery.UsageError, match="`tolerance`"):
        drapery.diff(a, b, tolerance=-1.0)
    with pytest.raises(drapery.InputError):
        drapery.diff(a, tmp_path)


def test_states_are_compared_array_by_array(tmp_path: Path) -> None:
    simulation = drapery.Scene.parse(SHEET).simulate()
    simulation.advance()
    simulation.save_file(tmp_path / "one")
    simulation.advance()
    simulation.save_file(tmp_path / "two")
    (part,) = drapery.diff(tmp_path / "one", tmp_path / "two").parts
    (positions,) = [array for array in part.arrays if array.name == "state/positions"]
    # 25 vertices, of which the pinned one stays.
    assert (positions.values, positions.count) == (75, 72) and part.worst is not None
    # Of a coordinate, and of a vertex.
    assert 0 < positions.max <= part.worst.distance <= positions.max * 3**0.5


def test_what_a_file_holds(tmp_path: Path) -> None:
    found = drapery.info(written(tmp_path / "cloth.abc"))
    (mesh,) = found.meshes
    assert "Alembic" in found.format and mesh.path == "/cloth/clothShape"
    assert (mesh.points, mesh.faces, mesh.samples, mesh.problem) == (4, (0, 1, 0), 3, None)
    assert mesh.bounds == ([0.0, 0.25, 0.0], [1.0, 0.25, 1.5]) and not mesh.velocities
    assert mesh.normals == "no" and not found.channels
    with pytest.raises(drapery.InputError):
        drapery.info(tmp_path / "none.abc")


CONTROL = """#usda 1.0
def "control"
{
    custom double slip.timeSamples = { 1: 0.5, 3: 0.25 }
    custom double3 fall.timeSamples = { 1: (0, -9.8, 0), 2: (0, 0, 0), 3: (0, 9.8, 0) }
    custom double still = 1.5
    double3 xformOp:translate = (1, 0, 0)
}
"""


def test_channels_of_a_file(tmp_path: Path) -> None:
    (tmp_path / "control.usda").write_text(CONTROL)
    channels = sorted(drapery.info(tmp_path / "control.usda").channels, key=lambda channel: channel.channel)
    fall, slip = drapery.ChannelInfo("/control.fall", 3, 3), drapery.ChannelInfo("/control.slip", 1, 2)
    still = drapery.ChannelInfo("/control.still", 1, 1)
    assert channels == [fall, slip, still], "a custom number that stands still is a channel, a transform that does is none"


def test_a_run_has_a_report_and_a_short_repr(tmp_path: Path) -> None:
    made = drapery.Scene.parse(SHEET)
    done = made.shot().run(tmp_path / "out")
    page = drapery.report(tmp_path / "out")
    assert page == tmp_path / "out" / "report.html" and "<html" in page.read_text()
    with pytest.raises(drapery.DraperyError):
        drapery.report(tmp_path)
    assert len(done.counts) > 5 and "counts" not in repr(done) and "outcome='done'" in repr(done)
    frame = made.simulate().advance()
    assert len(frame.counts) > 5 and "counts" not in repr(frame) and f"steps={frame.steps}" in repr(frame) and len(repr(frame)) < 250


def test_runs_have_a_page_side_by_side_and_one_that_plays_them(tmp_path: Path) -> None:
    for name in ("a", "b"):
        drapery.Scene.parse(SHEET).shot().run(tmp_path / name)
    page = drapery.compare([tmp_path / "a", tmp_path / "b"], tmp_path / "both.html")
    assert "2 of 2 done" in page.read_text() and (tmp_path / "both.csv").read_text().count("\n") == 3
    played = drapery.view(tmp_path / "a", tmp_path / "a.html").read_text()
    assert "three.js" in played and len(played) > 500_000
    with pytest.raises(drapery.InputError):
        drapery.compare([tmp_path / "a", tmp_path / "none"], tmp_path / "none.html")
    with pytest.raises(drapery.InputError):
        drapery.view(tmp_path / "none", tmp_path / "none.html")
    with pytest.raises(drapery.OutputError):
        drapery.view(tmp_path / "a", tmp_path / "both.csv")


def test_a_scene_is_read_with_what_was_set_in_it() -> None:
    made = drapery.Scene.parse(SHEET)
    made.set("resolution", 6)
    made.set("gravity.acceleration", [0, -1.5, 0])
    content = made.to_dict()
    assert content["shot"]["frames"] == "1-6" and content["gravity"]["acceleration"] == [0, -1.5, 0]
    (garment,) = content["garment"]
    assert garment["panel"]["resolution"] == 6 and garment["material"] == "cotton_shirting"
    # A default of the format.
    assert garment["panel"]["side"] == 1.0
    assert re.search(r"^resolution = 6 +# --set resolution$", made.to_toml(), re.MULTILINE)
    assert drapery.Scene.parse(made.to_toml()).to_dict() == content
    # What was read is the scene: it steps to the same bits.
    again = drapery.Scene.from_dict(content)
    assert again.to_dict() == content
    first, second = made.simulate(), again.simulate()
    first.advance_to(3)
    second.advance_to(3)
    assert np.array_equal(first.positions(), second.positions())


def test_files_of_a_scene_are_found_from_elsewhere(tmp_path: Path) -> None:
    with drapery.CacheWriter(tmp_path / "body.abc", POINTS - [0, 1, 0], [[0, 1, 2, 3]], (1, 6)) as writer:
        for _ in range(6):
            writer.write(POINTS - [0, 1, 0])
    text = SHEET + '[units]\nlength = "m"\nup = "Y"\n[[body]]\nname = "floor"\nfile = "body.abc"\n'
    (tmp_path / "scene.toml").write_text(text)
    content = drapery.Scene.load(tmp_path / "scene.toml").to_dict()
    assert content["body"][0]["file"] == str(tmp_path / "body.abc")
    assert drapery.Scene.from_dict(content).validate() is not None
    (tmp_path / "body.abc").unlink()
    with pytest.raises(drapery.InputError, match="body.abc"):
        drapery.Scene.load(tmp_path / "scene.toml").to_toml()


def test_a_scene_with_meshes_in_memory_is_read() -> None:
    content = scene().to_dict()
    assert content["body"][0]["file"] == "memory:table" and json.dumps(content)


def test_the_wheel_says_who_made_it_and_under_which_licence() -> None:
    said = metadata.metadata("drapery")
    assert said["Author"] == "The Drapery developers" and said["License-Expression"] == "MIT OR Apache-2.0"
    assert {"LICENSE-MIT", "LICENSE-APACHE"} <= set(said.get_all("License-File") or [])
    assert "Typing :: Typed" in (said.get_all("Classifier") or [])
    files = metadata.files("drapery") or []
    (licence,) = [file for file in files if file.name == "LICENSE-MIT"]
    assert "Permission is hereby granted" in licence.read_text()
