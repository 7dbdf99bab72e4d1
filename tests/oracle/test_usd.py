"""Pixar's library and Blender see in USD caches what Drapery wrote, as the HDF5 caches of the same run hold it."""

import json
import os
import shutil
import signal
import subprocess
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from farm import DRAPERY, Shot, reaches
from judges import SHARED, ask, blender, hdf5, official
from test_mpi_runs import ENVIRONMENT, Ranks, is_built_with_mpi

FRAMES = "1001-1006"
RATE = 24000 / 1001

# A quad, a pentagon and a triangle, hung from two corners, as an artist's file: texture coordinates with a seam, materials.
SKIRT = """
v 0 1 0
v 0.1 1 0
v 0.1 1 0.1
v 0 1 0.1
v 0.2 1 0
v 0.2 1 0.1
v 0.3 1 0.05
v 0.15 1 0.15
vt 0 0
vt 1 0
vt 1 1
vt 0 1
usemtl front-panel
f 1/1 4/4 3/3 2/2
f 2/1 3/2 8/3 6/3 5/4
usemtl trim
f 5/1 6/2 7/3
"""

SCENE = """
drapery = 1

[parameters]
resolution = 6

[shot]
name = "two of them"
frames = "1001-1006"
fps = "24000/1001"

[units]
length = "cm"
up = "Z"

[output]
format = {formats}

[gravity]

[self_repulsion]

[self_collision]

[[garment]]
name = "skirt"
rest = "skirt.obj"
units = {{ length = "m", up = "Y" }}
material = "cotton_shirting"

[[garment.pin]]
vertices = [0, 3]

[[garment]]
name = "flag-2"
panel = {{ resolution = "$resolution", side = 0.3, aspect = 1.0, center = [0, 1.5, 0] }}
material = "cotton_shirting"
velocity = [0.5, 0, 0.2]
"""

FAR = """
drapery = 1

[shot]
frames = "1-3"

[output]
format = ["h5", "usd"]

[gravity]

[[garment]]
name = "flag"
panel = { resolution = 4, side = 0.3, aspect = 1.0, center = [100000.375, -30000, 20000] }
material = "cotton_shirting"
"""


def usd(stage, *prim):
    """Contents of a stage as Pixar's library reads them."""
    return ask("official_usd.py", stage, *prim)


def scene(folder, formats='["abc", "h5", "usd"]', **parameters):
    folder.mkdir(exist_ok=True)
    (folder / "skirt.obj").write_text(SKIRT)
    (folder / "scene.toml").write_text(SCENE.format(formats=formats))
    return Shot(folder / "scene.toml", FRAMES, **parameters)


def contents(out):
    """Bytes of everything of the format."""
    found = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*"))
             if path.is_file() and path.suffix in (".usd", ".usda", ".usdc") and "stale" not in path.parts}
    assert found, f"nothing of USD in {out}"
    return found


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usd")
    scene(folder).run(folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def skirt(shot):
    return usd(shot / "skirt.usd"), hdf5(shot / "skirt.h5")


def test_every_validator_is_content_and_so_are_our_own_checks(shot, skirt):
    shown, _ = skirt
    assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
    for prim in ("/two_of_them/skirt/skirtShape", "/two_of_them/flag_2/flag_2Shape"):
        shown = usd(shot / "two of them.usda", prim)
        assert list(shown["validation"]) == [] and list(shown["complaints"]) == []


def test_values_at_and_between_frames_are_those_of_the_hdf5_cache(skirt):
    shown, cache = skirt
    frames = cache["frame_numbers"]
    np.testing.assert_array_equal(shown["samples"], frames)
    np.testing.assert_array_equal(shown["range"], frames[[0, -1]])
    np.testing.assert_array_equal(shown["times"], np.arange(frames[0], frames[-1] + 0.25, 0.5))
    for name in ("positions", "velocities"):
        np.testing.assert_array_equal(shown[name][::2], cache[name])
        # Halfway, to the rounding of single precision of lengths below 200 cm.
        halfway = (cache[name][:-1].astype(float) + cache[name][1:]) / 2
        np.testing.assert_allclose(shown[name][1::2], halfway, rtol=2e-7, atol=2e-5)
    np.testing.assert_array_equal(shown["world_positions"][::2], cache["world_positions"])
    np.testing.assert_array_equal(shown["extents"][::2], shown["bounds"][::2])
    inside = (shown["extents"][:, :1] <= shown["positions"] + 2e-5) & (shown["positions"] - 2e-5 <= shown["extents"][:, 1:])
    assert inside.all()


def test_velocities_are_the_differences_of_positions_to_first_order(skirt):
    shown, _ = skirt
    # Free fall of the points that are not held: v dt - dx = g dt²/2, here of 9.81 m/s² in cm, twice for what cloth adds.
    missing = shown["velocities"][2] / RATE - (shown["positions"][2] - shown["positions"][0])
    assert np.abs(missing).max() < 2 * 981 / RATE**2


def test_the_stage_says_what_its_numbers_mean(skirt):
    shown, _ = skirt
    assert (float(shown["metres_per_unit"]), str(shown["up_axis"])) == (0.01, "Z")
    assert float(shown["rate"]) == float(shown["frames_per_second"]) == RATE
    assert str(shown["default_prim"]) == "/skirt" and list(shown["kinds"])[0] == "component"


def test_the_mesh_is_the_artists(shot, skirt):
    shown, cache = skirt
    assert (str(shown["subdivision"]), str(shown["orientation"])) == ("none", "rightHanded")
    for name in ("face_counts", "face_indices"):
        np.testing.assert_array_equal(shown[name], cache[name])
    assert list(shown["face_counts"]) == [4, 5, 3]
    assert str(shown["uv_interpolation"]) == "faceVarying"
    of_file = [[0, 0], [0, 1], [1, 1], [1, 0], [0, 0], [1, 0], [1, 1], [1, 1], [0, 1], [0, 0], [1, 0], [1, 1]]
    np.testing.assert_array_equal(shown["uvs"][shown["uv_indices"]], of_file)
    assert list(shown["subset_names"]) == ["front_panel", "trim"]
    assert set(shown["subset_families"]) == {"materialBind"}
    np.testing.assert_array_equal(shown["subset_0"], [0, 1])
    np.testing.assert_array_equal(shown["subset_1"], [2])


def test_the_layer_of_the_shot_shows_all_garments_as_their_own_do(shot, skirt):
    shown, _ = skirt
    in_shot = usd(shot / "two of them.usda", "/two_of_them/skirt/skirtShape")
    assert str(in_shot["default_prim"]) == "/two_of_them" and list(in_shot["kinds"])[:2] == ["assembly", "component"]
    for name in ("positions", "velocities", "extents", "samples", "range", "rate", "metres_per_unit", "uvs"):
        np.testing.assert_array_equal(in_shot[name], shown[name])


def test_blender_shows_the_positions_of_the_cache(shot):
    cache = hdf5(shot / "skirt.h5")
    shown = blender(shot / "skirt.usd", 24, cache["frame_numbers"])
    # Blender takes the unit into the object's scale, a number of single precision.
    metres = cache["positions"].astype(float) * 0.01
    np.testing.assert_allclose(shown["positions"], metres, atol=1e-6)
    assert list(shown["frame_range"]) == [1001, 1006]
    np.testing.assert_array_equal(shown["velocities"], cache["velocities"])


def test_far_from_the_origin_a_transform_holds_the_distance(tmp_path):
    (tmp_path / "scene.toml").write_text(FAR)
    Shot(tmp_path / "scene.toml", "1-3").run(tmp_path / "out")
    shown, cache = usd(tmp_path / "out" / "flag.usd"), hdf5(tmp_path / "out" / "flag.h5")
    assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
    np.testing.assert_array_equal(shown["positions"][::2], cache["positions"])
    np.testing.assert_array_equal(shown["world_positions"][::2], cache["world_positions"])
    assert np.abs(shown["positions"]).max() < 1.0 < 1e4 < np.abs(cache["origin"]).min()


def test_bytes_are_the_same_on_any_threads_and_after_stops_and_kills(shot, tmp_path):
    whole = contents(shot)
    for threads in (1, 3):
        run = scene(tmp_path / str(threads))
        run.run(tmp_path / str(threads) / "out", threads=threads)
        assert contents(tmp_path / str(threads) / "out") == whole, f"{threads} threads"
    run, out = scene(tmp_path / "stopped"), tmp_path / "stopped" / "out"
    run.run(out, last=1002)
    at_stop = usd(out / "skirt.usd")
    np.testing.assert_array_equal(at_stop["samples"], [1001, 1002])
    # What a killed run may leave: half a file, and a frame that the layer does not name yet.
    (folder,) = (out / "skirt.clips").iterdir()
    (folder / "1003.usdc.part").write_bytes(b"PXR-USDC")
    shutil.copy(folder / "1002.usdc", folder / "1003.usdc")
    run.run(out)
    assert contents(out) == whole
    # Back to an earlier frame, and with the format left out for a while.
    run.run(out, "--overwrite", last=1004)
    run.run(out)
    assert contents(out) == whole


@pytest.mark.skipif(not shutil.which("mpirun") or not is_built_with_mpi(), reason="no mpirun, or built without MPI")
def test_bytes_are_the_same_on_two_ranks(shot, tmp_path):
    out = tmp_path / "out"
    command = Ranks(scene(tmp_path), 2).command(out)
    done = subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done
    assert contents(out) == contents(shot)


def test_a_run_that_is_killed_leaves_a_stage_that_opens_and_goes_on_to_the_same_bytes(tmp_path, report_figure):
    folder = tmp_path / "killed"
    # Fine enough to be killed in between.
    asked = '["abc", "h5", "usd"]\nusd_single = true'
    run, out = scene(folder, formats=asked, resolution=60), folder / "out"
    run.run(out, last=1001)
    assert (out / "two of them.usdc").exists()
    process = run.start(out)
    reaches(out, process, 1002)
    process.send_signal(signal.SIGKILL)
    process.wait()
    # It would tell of fewer frames than there are.
    assert not (out / "two of them.usdc").exists()
    shown = usd(out / "skirt.usd")
    assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
    assert list(shown["samples"])[:2] == [1001, 1002]
    report_figure(f"frames found after the kill: {len(shown['samples'])} of 6")
    run.run(out)
    other = tmp_path / "unbroken"
    scene(other, formats=asked, resolution=60).run(other / "out")
    assert contents(out) == contents(other / "out") and "two of them.usdc" in contents(out)


def test_info_verify_and_diff_know_the_format(shot):
    def drapery(*arguments):
        return subprocess.run([DRAPERY, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)

    info = drapery("info", shot / "skirt.usd")
    assert info.returncode == 0, info
    for text in ("time codes: 1001 to 1006", "samples: 6", "front_panel: 2 faces", "velocities: yes"):
        assert text in info.stdout, f"{text} is not in {info.stdout}"
    assert drapery("diff", shot / "skirt.usd", shot / "skirt.h5").returncode == 0
    verified = drapery("verify", shot / "skirt.usd", shot / "flag-2.usd")
    assert verified.returncode == 0 and "frame 1001 is time code 1001, 41.750042 s" in verified.stdout, verified
    (folder,) = (shot / "skirt.clips").iterdir()
    clip = folder / "1004.usdc"
    good = clip.read_bytes()
    try:
        # Cut off, empty, and with the last bit of one coordinate changed.
        place = good.index(hdf5(shot / "skirt.h5")["positions"][3].tobytes())
        for bad in (good[:100], b"", good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :]):
            clip.write_bytes(bad)
            said = drapery("verify", "--record", shot, shot / "skirt.usd")
            assert said.returncode in (65, 82) and "1004" in said.stdout + said.stderr, said
    finally:
        clip.write_bytes(good)


def test_a_converted_cache_is_the_cache_for_other_programs_too(shot, tmp_path):
    for source, result in (("skirt.abc", "other.usd"), ("skirt.usd", "other.abc")):
        run = subprocess.run([DRAPERY, "convert", shot / source, tmp_path / result], capture_output=True, text=True)
        assert run.returncode == 0, run
    expected, shown = usd(shot / "skirt.usd"), usd(tmp_path / "other.usd")
    for name in expected:
        if name != "default_prim":
            np.testing.assert_array_equal(shown[name], expected[name], err_msg=name)
    expected, shown = official(shot / "skirt.abc"), official(tmp_path / "other.abc")
    for name in ("positions", "velocities", "uvs", "face_counts", "face_indices", "face_set_0", "face_set_1"):
        np.testing.assert_array_equal(shown[name], expected[name], err_msg=name)
    assert list(shown["face_set_names"]) == ["front_panel", "trim"], "as USD spells names"


def drapery(*arguments):
    return subprocess.run([DRAPERY, *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def test_one_binary_layer_holds_the_shot_as_its_stage_does(shot, tmp_path):
    single = tmp_path / "all.usdc"
    run = drapery("convert", shot / "two of them.usda", single)
    assert run.returncode == 0, run
    for prim in ("/two_of_them/skirt/skirtShape", "/two_of_them/flag_2/flag_2Shape"):
        expected, shown = usd(shot / "two of them.usda", prim), usd(single, prim)
        assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
        # Face sets of a mesh come before the next garment here, and behind it where they are of a weaker layer.
        assert sorted(shown["kinds"]) == sorted(expected["kinds"])
        for name in set(expected) - {"validation", "complaints", "kinds"}:
            np.testing.assert_array_equal(shown[name], expected[name], err_msg=name)
    again = drapery("convert", shot / "two of them.usda", tmp_path / "again.usdc")
    assert again.returncode == 0 and single.read_bytes() == (tmp_path / "again.usdc").read_bytes()
    assert list(tmp_path.glob(".*")) == [], "nothing half-written is left"
    of_skirt = tmp_path / "skirt.usdc"
    assert drapery("convert", shot / "skirt.usd", of_skirt).returncode == 0
    cache = hdf5(shot / "skirt.h5")
    shown = blender(of_skirt, 24, cache["frame_numbers"])
    np.testing.assert_allclose(shown["positions"], cache["positions"].astype(float) * 0.01, atol=1e-6)
    assert drapery("diff", of_skirt, shot / "skirt.abc").returncode == 0


SHOWN = ("/two_of_them/skirt/skirtShape", "/two_of_them/flag_2/flag_2Shape")


def assert_single_is_the_stage(out):
    stage, single = out / "two of them.usda", out / "two of them.usdc"
    for prim in SHOWN:
        expected, shown = usd(stage, prim), usd(single, prim)
        assert list(shown["validation"]) == [] and list(shown["complaints"]) == []
        assert sorted(shown["kinds"]) == sorted(expected["kinds"])
        for name in set(expected) - {"validation", "complaints", "kinds"}:
            np.testing.assert_array_equal(shown[name], expected[name], err_msg=name)


def test_a_run_leaves_the_shot_as_one_binary_layer_too_where_the_scene_asks_for_it(tmp_path):
    asked = '["h5", "usd"]\nsamples = 3\nusd_single = true'
    run, out = scene(tmp_path / "whole", formats=asked), tmp_path / "whole" / "out"
    run.run(out)
    single = out / "two of them.usdc"
    assert_single_is_the_stage(out)
    assert len(usd(single, SHOWN[0])["samples"]) == 16, "samples between frames are in it"
    assert json.loads((out / "manifest.json").read_text())["layers"] == ["two of them.usda", "two of them.usdc"]
    stopped, other = scene(tmp_path / "stopped", formats=asked), tmp_path / "stopped" / "out"
    stopped.run(other, last=1003, threads=1)
    assert_single_is_the_stage(other)
    stopped.run(other)
    assert (other / single.name).read_bytes() == single.read_bytes()
    # Removed: a run that finds all frames makes it again; not asked for any more: it goes when frames follow.
    (other / single.name).unlink()
    stopped.run(other)
    assert (other / single.name).read_bytes() == single.read_bytes()
    stopped.run(other, "--overwrite", last=1003)
    scene(tmp_path / "stopped", formats='["h5", "usd"]\nsamples = 3').run(other)
    assert not (other / single.name).exists()
    assert list(other.glob(".*")) == [], "nothing half-written is left"


@pytest.mark.parametrize("formats, frames, expected", [
    ('["abc"]\nusd_single = true', "1-6", "there are no USD caches"),
    ('["usd"]\nusd_single = true', "1-10000000", "one layer holds at most 2000 MB"),
])
def test_a_single_layer_that_cannot_be_is_refused_before_the_run(tmp_path, formats, frames, expected):
    scene(tmp_path, formats=formats)
    said = drapery("check", tmp_path / "scene.toml", "--set", f"shot.frames={frames}")
    assert said.returncode == 78 and "usd_single" in said.stderr and expected in said.stderr, said


def test_the_stage_of_a_shot_is_verified_garment_by_garment(shot):
    verified = drapery("verify", shot / "two of them.usda")
    assert verified.returncode == 0, verified
    for text in ("skirtShape: 6 samples; frame 1001 is time code 1001", "flag_2Shape: 6 samples", "centimetres, Z up",
                 "no intersections between meshes; pairs checked: 1"):
        assert text in verified.stdout, f"{text} is not in {verified.stdout}"
    of_alembic = drapery("verify", shot / "skirt.abc")
    assert "frame 1001 is at 41.750042 s; Blender shows it at scene frame 1001 if its rate is 23.976 fps" in of_alembic.stdout
    assert drapery("diff", shot / "two of them.usda", shot / "two of them.usda").returncode == 0


@pytest.mark.parametrize("file", ["blender_y_up_cm.usda", "blender_z_up.usdc", "usdwg_animated_cube_translation.usda",
                                  "usdwg_RiggedFigure.usdz"])
def test_a_converted_stage_of_another_program_is_where_pixars_library_has_it(tmp_path, file):
    source = SHARED / "foreign_caches" / "usd" / file
    run = drapery("convert", source, tmp_path / "ours.usdc")
    assert run.returncode == 0, run
    skinned = SHARED / "foreign_caches" / "usd" / "riggedfigure_baked.usdc" if "Rigged" in file else source
    expected, shown = usd(skinned), usd(tmp_path / "ours.usdc")
    assert list(shown["complaints"]) == [] and list(shown["validation"]) == []
    frames = expected["times"] == np.round(expected["times"])
    kept = np.isin(shown["times"], expected["times"][frames])
    size = np.abs(expected["world_positions"]).max()
    np.testing.assert_allclose(shown["world_positions"][kept], expected["world_positions"][frames], atol=4e-6 * size)
    np.testing.assert_array_equal(shown["face_counts"], expected["face_counts"])
    for name in ("metres_per_unit", "up_axis", "rate"):
        np.testing.assert_array_equal(shown[name], expected[name], err_msg=name)


# A garment of a character whose materials are elsewhere in its stage: of the mesh, of a face set, stronger than those below.
CAPE = """#usda 1.0
(
    defaultPrim = "char"
    metersPerUnit = 1
    upAxis = "Y"
)
def Xform "char"
{
    def Mesh "cape" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {
        point3f[] points = [(0, 1, 0), (0.1, 1, 0), (0.1, 1, 0.1), (0, 1, 0.1), (0.2, 1, 0), (0.2, 1, 0.1)]
        int[] faceVertexCounts = [4, 4]
        int[] faceVertexIndices = [0, 3, 2, 1, 1, 2, 5, 4]
        uniform token subdivisionScheme = "none"
        float[] primvars:hold = [1, 0, 0, 1, 0, 0] ( interpolation = "vertex" )
        uniform bool doubleSided = true
        float[] creaseSharpnesses = [1]
        rel material:binding = </char/mtl/red> ( bindMaterialAs = "strongerThanDescendants" )
        def GeomSubset "hem" (
            prepend apiSchemas = ["MaterialBindingAPI"]
        )
        {
            uniform token elementType = "face"
            uniform token familyName = "materialBind"
            int[] indices = [1]
            rel material:binding = </looks/blue>
        }
    }
}
"""

BOUND = """
drapery = 1

[shot]
name = "garm"
frames = "1-3"

[output]
format = ["usd"]
usd_single = true

[gravity]

[self_repulsion]

[self_collision]

[[garment]]
name = "cape"
rest = "cape.usda"
material = "cotton_shirting"

[[garment.pin]]
map = "hold"
"""


def test_bound_materials_are_valid_and_alike_in_stage_and_single_file(tmp_path):
    (tmp_path / "cape.usda").write_text(CAPE)
    (tmp_path / "scene.toml").write_text(BOUND)
    out = tmp_path / "out"
    said = Shot(tmp_path / "scene.toml", "1-3").run(out)
    assert "creaseSharpnesses is not copied" in said, said
    drapery("convert", out / "cape.usd", tmp_path / "cape.usdc")
    inside = {out / "garm.usda": "/garm/cape", out / "garm.usdc": "/garm/cape", out / "cape.usd": "/char", tmp_path / "cape.usdc": "/char"}
    for file, root in inside.items():
        shown = usd(file, f"{root}/cape")
        assert list(shown["validation"]) == [] and list(shown["complaints"]) == [], file
        stage = Usd.Stage.Open(str(file))
        assert stage.GetPrimAtPath(f"{root}/cape").GetAttribute("doubleSided").Get() is True
        for prim, target, source in (("cape", "mtl/red", "/char/mtl/red"), ("cape/hem", "looks/blue", "/looks/blue")):
            binding = stage.GetPrimAtPath(f"{root}/{prim}").GetRelationship("material:binding")
            assert [str(path) for path in binding.GetTargets()] == [f"{root}/{target}"], file
            material = stage.GetPrimAtPath(f"{root}/{target}")
            assert material.GetTypeName() == "Material" and material.GetAttribute("drapery:sourcePath").Get() == source
            stronger = binding.GetMetadata("bindMaterialAs") == "strongerThanDescendants"
            assert stronger == (prim == "cape"), file
    # The pin holds where the primvar is painted.
    moved = np.abs(shown["world_positions"] - shown["world_positions"][0]).max(axis=(0, 2))
    assert list(moved[[0, 3]]) == [0, 0] and moved[[1, 2, 4, 5]].min() > 0


@pytest.mark.full
def test_a_program_without_usd_says_so_before_it_simulates(tmp_path):
    bare = Path(os.environ.get("DRAPERY_BARE", "")) / "drapery"
    if not bare.is_file():
        pytest.skip("no bare program; `make test-full` makes one")
    scene(tmp_path, formats='["usd"]')
    # It has no effects either: of these the scene asks for none.
    kept = [line for line in (tmp_path / "scene.toml").read_text().splitlines() if not line.startswith("material")]
    (tmp_path / "scene.toml").write_text("\n".join(kept) + "\n")
    said = subprocess.run([bare, "check", tmp_path / "scene.toml"], capture_output=True, text=True)
    assert said.returncode == 78 and 'without the format "usd"' in said.stderr and "make build" in said.stderr, said
