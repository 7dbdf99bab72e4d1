"""Caches as arrays: read, written, refused."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import drapery
from table_scene import SHEET

FORMATS = ["abc", "h5", "usd"]
POINTS = np.array([[0, 0, 0], [0, 0, 1.5], [1, 0, 1], [1, 0, 0], [2, 0.25, 0]])
FACES = [[0, 1, 2, 3], [3, 2, 4]]
UVS = (np.array([[0, 0], [0, 1], [1, 1], [1, 0], [0.5, 0.5]]), np.array([0, 1, 2, 3, 3, 2, 4]))


def moved(frame: float) -> npt.NDArray[np.float64]:
    """The points at a frame [m]; exact in single precision, also in centimetres."""
    return POINTS + [0, 0.25 * (frame - 10), 0]


@pytest.mark.parametrize("extension", FORMATS)
def test_what_a_run_writes_is_what_a_simulation_has(tmp_path: Path, extension: str) -> None:
    made = drapery.Scene.parse(SHEET)
    made.shot().run(tmp_path)
    cache, simulation = drapery.open_cache(tmp_path / f"sheet.{extension}"), made.simulate()
    mesh = cache.mesh
    assert cache.fps == 24 and mesh.frames == [1, 2, 3, 4, 5, 6] and mesh.point_count == 25 and cache.units == ("m", "Y")
    assert np.array_equal(mesh.faces.corners, simulation.faces().corners) and mesh.triangles.shape == (32, 3)
    assert "frames 1 to 6" in repr(cache) and mesh.read().shape == (6, 25, 3)
    assert len(mesh) == 6 and 6 in mesh and 7 not in mesh and np.array_equal(mesh[6], mesh.positions(6))
    assert len(cache) == 1 and [found.name for found in cache] == [mesh.name] and cache[mesh.name].name == mesh.name
    assert cache[mesh.name.rpartition("/")[2]].name == mesh.name
    with pytest.raises(drapery.UsageError, match="no mesh has this name"):
        cache["skirt"]
    for frame, positions in mesh:
        simulation.advance_to(int(frame))
        velocities = mesh.velocities(frame)
        assert velocities is not None and not positions.flags.writeable
        # Caches are in single precision.
        assert np.array_equal(positions, simulation.positions().astype(np.float32).astype(float))
        assert np.array_equal(velocities, simulation.velocities().astype(np.float32).astype(float))
    with pytest.raises(drapery.UsageError, match="frames 1 to 6") as caught:
        mesh.positions(7)
    assert caught.value.frame == 7


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("units", ["", '[units]\nlength = "cm"\nup = "Z"\n'])
def test_attributes_are_those_of_the_positions(tmp_path: Path, extension: str, units: str) -> None:
    # Two quads of 1 x 1 at a right angle; the edge between them is hard by its normals.
    (tmp_path / "angle.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 1 1 -1\nv 0 1 -1\nvn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1 4//1\nf 4//2 3//2 5//2 6//2\n"
    )
    words = ["normals", "rest", "strain", "contact", "thickness"]
    made = drapery.Scene.parse(
        f'drapery = 1\n[shot]\nframes = "1-3"\n{units}[gravity]\n[output]\nformat = ["{extension}"]\n'
        f'attributes = {words}\n[[garment]]\nname = "angle"\nrest = "angle.obj"\nunits = {{ length = "m", up = "Y" }}\n'
        'material = "cotton_shirting"\nthickness = "2 mm"\n[[garment.pin]]\nvertices = [0]\n',
        folder=tmp_path,
    )
    made.shot().run(tmp_path / "out")
    mesh = drapery.open_cache(tmp_path / "out" / f"angle.{extension}").mesh
    found = mesh.attributes(3)
    assert set(found) == set(words) and found["thickness"].shape == (6,) and np.allclose(found["thickness"], 0.002, rtol=1e-6)
    rest = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [1, 1, -1], [0, 1, -1]], float)
    assert np.allclose(found["rest"], rest, rtol=0, atol=1e-7) and (found["contact"] == 0).all()
    place, expected = mesh[3], []
    for face in mesh.faces.corners.reshape(-1, 4):
        normal = np.cross(place[face[2]] - place[face[0]], place[face[3]] - place[face[1]])
        expected += 4 * [normal / np.linalg.norm(normal)]
    assert np.allclose(found["normals"], expected, rtol=0, atol=1e-5)
    assert abs(found["strain"]).max() > 1e-9 and set(drapery.open_cache(tmp_path / "out" / f"angle.{extension}").mesh.attributes(1)) == set(words)
    with pytest.raises(drapery.UsageError, match="frames 1 to 3"):
        mesh.attributes(4)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("length, up", [("m", "Y"), ("cm", "Z")])
def test_a_cache_that_is_written_is_read_back(tmp_path: Path, extension: str, length: str, up: str) -> None:
    path = tmp_path / f"hero.{extension}"
    rates = np.full_like(POINTS, 0.5)
    with drapery.CacheWriter(
        path, POINTS, FACES, (10, 12), fps=23.976, name="hero", uvs=UVS, velocities=True, length=length, up=up,
    ) as writer:
        assert [writer.write(moved(frame), rates) for frame in (10, 11, 12)] == [10, 11, 12]
    mesh = drapery.open_cache(path).mesh
    assert drapery.open_cache(path).units == drapery.Units(length, up)
    assert mesh.name == "/hero/heroShape" and mesh.frames == [10, 11, 12]
    assert drapery.open_cache(path).fps == pytest.approx(24000 / 1001)
    assert all(np.array_equal(positions, moved(frame)) for frame, positions in mesh)
    velocities, uvs = mesh.velocities(11), mesh.uvs
    assert velocities is not None and np.array_equal(velocities, rates) and uvs is not None
    assert mesh.faces.counts.tolist() == [4, 3] and mesh.faces.corners.tolist() == [0, 1, 2, 3, 3, 2, 4]
    assert np.array_equal(uvs.values[uvs.indices], UVS[0][UVS[1]].astype(np.float32))
    if extension != "h5":
        found = drapery.verify(path)
        # Its velocities are not those of its motion, which is for this test alone.
        assert not [line for line in found.failures if "velocities" not in line], found


def test_samples_of_which_none_is_at_a_whole_frame_keep_their_times(tmp_path: Path) -> None:
    path = tmp_path / "sheet.abc"
    with drapery.CacheWriter(path, POINTS, FACES, frames=(1, 3)) as writer:
        for frame in (1, 2, 3):
            writer.write(moved(frame))
    with pytest.raises(drapery.InputError, match="at 24 fps, not at 12"):
        drapery.open_cache(path, fps=12)
    # A file of another program, which states no rate.
    path.write_bytes(path.read_bytes().replace(b"DCC_FPS", b"XCC_FPS"))
    # 0.7 frames for each of those that were written.
    mesh = drapery.open_cache(path, fps=16.8).mesh
    assert np.allclose(mesh.frames, [0.7, 1.4, 2.1]) and len(mesh) == 3 and "frames 0.7 to 2.1" in repr(mesh)
    assert np.array_equal(mesh[1.4], moved(2)) and np.array_equal(mesh.read(), [moved(frame) for frame in (1, 2, 3)])
    with pytest.raises(drapery.UsageError, match="frames 0.7 to 2.1"):
        mesh.positions(1)
    # Where whole frames are there, they are the frames, and samples between them are found by their times.
    doubled = drapery.open_cache(path, fps=12).mesh
    assert doubled.frames == [1] and np.array_equal(doubled[0.5], moved(1)) and np.array_equal(doubled[1.5], moved(3))


def test_a_cache_refuses_what_it_cannot_hold(tmp_path: Path) -> None:
    path = tmp_path / "cloth.abc"
    writer = drapery.CacheWriter(path, POINTS, FACES, (1, 2))
    writer.write(moved(1))
    for value in (np.nan, np.inf, 1e300):
        wrong = moved(2)
        wrong[3, 2] = value
        with pytest.raises(drapery.InputError, match="frame 2, vertex 3") as caught:
            writer.write(wrong)
        assert (caught.value.frame, caught.value.element, caught.value.object) == (2, 3, str(path))
    with pytest.raises(drapery.InputError, match="4 positions for 5 points"):
        writer.write(moved(2)[:4])
    with pytest.raises(drapery.UsageError, match=r"shape \(5, 2\)"):
        writer.write(moved(2)[:, :2])
    with pytest.raises(drapery.UsageError, match="without velocities"):
        writer.write(moved(2), moved(2))
    assert writer.write(moved(2)) == 2, "nothing of all this was written"
    with pytest.raises(drapery.UsageError, match="frames up to 2"):
        writer.write(moved(3))
    writer.close()
    writer.close()
    with pytest.raises(drapery.UsageError, match="closed"):
        writer.write(moved(3))
    assert np.array_equal(drapery.open_cache(path).mesh.read(), [moved(1), moved(2)])


def test_a_cache_is_not_begun_in_the_wrong_place_or_of_the_wrong_thing(tmp_path: Path) -> None:
    (tmp_path / "there.abc").write_text("precious")
    with pytest.raises(drapery.OutputError) as caught:
        drapery.CacheWriter(tmp_path / "there.abc", POINTS, FACES, (1, 2))
    assert caught.value.code == 73 and (tmp_path / "there.abc").read_text() == "precious"
    for extension in FORMATS:
        with pytest.raises(drapery.OutputError):
            with drapery.CacheWriter(tmp_path / "there.abc" / f"cloth.{extension}", POINTS, FACES, (1, 2)) as writer:
                writer.write(moved(1))
    with pytest.raises(drapery.InputError, match=r"\.abc"):
        drapery.CacheWriter(tmp_path / "cloth.fbx", POINTS, FACES, (1, 2))
    wrong: list[dict[str, Any]] = [
        {"frames": (2, 1)}, {"fps": 0}, {"fps": -24}, {"length": "yard"}, {"up": "X"}, {"uvs": (UVS[0], UVS[1][:3])},
        {"uvs": (UVS[0][:, :1], UVS[1])}, {"fps": float("nan")},
    ]
    for arguments in wrong:
        with pytest.raises(drapery.UsageError):
            drapery.CacheWriter(tmp_path / "cloth.abc", POINTS, FACES, **{"frames": (1, 2), **arguments})
    assert not (tmp_path / "cloth.abc").exists()
    with drapery.CacheWriter(tmp_path / "there.abc", POINTS, FACES, (1, 2), overwrite=True) as writer:
        writer.write(moved(1))
    assert drapery.open_cache(tmp_path / "there.abc").mesh.frames == [1], "fewer frames than announced are a cache, too"


def test_what_is_no_cache_is_said(tmp_path: Path) -> None:
    with pytest.raises(drapery.InputError) as caught:
        drapery.open_cache(tmp_path / "none.abc")
    assert caught.value.code == 66 and caught.value.object == str(tmp_path / "none.abc")
    for extension in [*FORMATS, "usda", "txt"]:
        path = tmp_path / f"damaged.{extension}"
        path.write_bytes(b"Ogawa, or so it says" * 20)
        with pytest.raises(drapery.InputError) as caught:
            drapery.open_cache(path)
        assert caught.value.code == 65 and path.name in str(caught.value)
    done = subprocess.run(
        [sys.executable, "-c", f"import drapery\ntry: drapery.open_cache({str(path.with_suffix('.usda'))!r})\nexcept drapery.InputError: pass"],
        capture_output=True, text=True,
    )
    assert (done.returncode, done.stderr) == (0, ""), "what a library says of it is not printed besides"


@pytest.mark.parametrize("extension", FORMATS)
def test_a_cache_whose_writer_was_killed_has_its_frames(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"cloth.{extension}"
    program = (
        "import drapery, numpy, os, signal, sys\n"
        "points = numpy.eye(3)\n"
        "writer = drapery.CacheWriter(sys.argv[1], points, [[0, 1, 2]], (1, 9))\n"
        "for frame in range(1, 5): writer.write(points * frame)\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", program, str(path)]).returncode == -signal.SIGKILL
    mesh = drapery.open_cache(path).mesh
    assert mesh.frames == [1, 2, 3, 4] and np.array_equal(mesh.positions(4), 4 * np.eye(3))


def test_a_full_disk_is_said_and_the_frames_before_stay(tmp_path: Path) -> None:
    path = tmp_path / "cloth.abc"
    program = (
        "import drapery, numpy, resource, sys\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))\n"
        "points = numpy.zeros((300, 3))\n"
        "writer = drapery.CacheWriter(sys.argv[1], points, [[0, 1, 2]], (1, 99))\n"
        "try:\n"
        "    for frame in range(1, 99): writer.write(points + frame)\n"
        "except drapery.OutputError as error: print(frame, error.code, error)\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], capture_output=True, text=True)
    frame, code, text = done.stdout.split(maxsplit=2)
    assert code == "74" and str(path) in text
    mesh = drapery.open_cache(path).mesh
    assert mesh.frames == list(range(1, int(frame))) and len(mesh.frames) > 1
    assert all(np.all(positions == number) for number, positions in mesh)
    assert os.path.getsize(path) <= 20000


@settings(max_examples=25, deadline=None)
@given(
    data=st.data(),
    extension=st.sampled_from(["abc", "h5"]),
    dtype=st.sampled_from(["f4", "f8", ">f4", "i2", "u1"]),
    points=st.integers(3, 12),
    frames=st.integers(1, 4),
)
def test_any_mesh_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, extension: str, dtype: str, points: int, frames: int,
) -> None:
    path = tmp_path_factory.mktemp("any") / f"cloth.{extension}"
    faces = data.draw(st.lists(st.lists(st.integers(0, points - 1), min_size=3, max_size=5, unique=True), min_size=1, max_size=6))
    generator = np.random.default_rng(points)
    shots = [(100 * generator.random((points, 3))).astype(dtype) for _ in range(frames)]
    with drapery.CacheWriter(path, shots[0], faces, (5, 4 + frames)) as writer:
        for positions in shots:
            writer.write(np.asfortranarray(positions))
    mesh = drapery.open_cache(path).mesh
    assert [list(face) for face in np.split(mesh.faces.corners, np.cumsum(mesh.faces.counts)[:-1])] == faces
    assert np.array_equal(mesh.read(), np.array(shots).astype(np.float32).astype(float))
