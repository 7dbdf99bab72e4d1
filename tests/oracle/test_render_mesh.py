"""Outside programs read the caches of a render mesh, and libigl counts where its layers cross."""

import json
import shutil
import subprocess

import h5py
import numpy as np
import pytest
from alembic3d import Abc, AbcGeom

from conftest import program
from crossings import crossing_pairs
from judges import ROOT, hdf5, official
from test_mpi_runs import ENVIRONMENT, is_built_with_mpi

SCENE = "sample_assets/scenes/coat.toml"
FRAMES = "1001-1013"

# Edges of the cloth that are folded further than this leave no room for the shell inside the fold, and those around it [degrees, m].
# From frame 1012 on there are such; until then none is folded further than 95 degrees.
TIGHT, AROUND = 110.0, 0.03

# Half of the shell's thickness, from the generator [m].
SHELL = 0.001


@pytest.fixture(scope="module")
def coat(tmp_path_factory):
    """Folder of the run: the coat swings for almost half a second."""
    folder = tmp_path_factory.mktemp("coat")
    made = subprocess.run([program("DRAPERY_ASSETS", "drapery-assets"), "coat", "--out", str(folder)], capture_output=True)
    assert made.returncode == 0, made.stderr
    scene = folder / "coat.toml"
    formats = ["abc", "h5"] + (["usd"] if has_usd() else [])
    text = (ROOT / SCENE).read_text() + f"\n[output]\nformat = {formats}\n".replace("'", '"')
    scene.write_text(text)
    command = [program("DRAPERY", "drapery"), "run", str(scene), "--frames", FRAMES, "--out", str(folder / "out"),
               "--set", f"assets={folder}", "--threads", "2"]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    assert "render mesh (" not in done.stderr, f"nothing is suspicious: {done.stderr}"
    return folder / "out"


def has_usd():
    version = subprocess.run([program("DRAPERY", "drapery"), "--version"], capture_output=True, text=True).stdout
    return "usd" in version


def normals_of(points, cache):
    """Normals at points, by the areas of the polygons around them."""
    owner = np.repeat(np.arange(len(cache["face_counts"])), cache["face_counts"] - 2)
    fans = points[polygons(cache)]
    areas = np.zeros((len(cache["face_counts"]), 3))
    np.add.at(areas, owner, np.cross(fans[:, 1] - fans[:, 0], fans[:, 2] - fans[:, 0]))
    sums = np.zeros_like(points)
    np.add.at(sums, cache["face_indices"], np.repeat(areas, cache["face_counts"], axis=0))
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


def polygons(cache):
    """Fans of the faces, counter-clockwise as they are in HDF5."""
    counts, corners = cache["face_counts"], cache["face_indices"]
    starts = np.concatenate([[0], np.cumsum(counts)])[:-1]
    return np.array([(corners[s], corners[s + i], corners[s + i + 1])
                     for s, count in zip(starts, counts) for i in range(1, count - 1)])


def parts_of(archive_path):
    """Names of the face sets with the points of their faces."""
    answer = official(archive_path)
    starts = np.concatenate([[0], np.cumsum(answer["face_counts"])])
    return {
        str(name): np.unique(np.concatenate([answer["face_indices"][starts[f] : starts[f + 1]] for f in answer[f"face_set_{i}"]]))
        for i, name in enumerate(answer["face_set_names"])
    }


def command(folder, out, *options, threads=2, last=FRAMES.split("-")[1]):
    return [program("DRAPERY", "drapery"), "run", str(folder / "coat.toml"), "--frames", f"1001-{last}", "--out", str(out),
            "--set", f"assets={folder}", "--threads", str(threads), "--progress", "none", *options]


def caches_of(out):
    found = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("coat_render*"))
             if path.is_file() and "stale" not in path.parts}
    clips = out / "coat_render.clips"
    return found | {str(path.relative_to(out)): path.read_bytes() for path in sorted(clips.rglob("*.usd*"))}


def test_bytes_are_the_same_on_other_threads_on_ranks_and_after_a_stop(coat):
    folder, ranks = coat.parent, shutil.which("mpirun") and is_built_with_mpi()
    runs = {str(threads): command(folder, folder / str(threads), threads=threads, last=1003) for threads in (1, 4)}
    if ranks:
        runs["ranks"] = ["mpirun", "-n", "2", *command(folder, folder / "ranks", threads=1, last=1003)]
    stopped = command(folder, folder / "stopped", last=1002)
    for line in (*runs.values(), stopped, command(folder, folder / "stopped", last=1003)):
        done = subprocess.run(line, env=ENVIRONMENT, capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert done.returncode == 0, done.stderr
    expected = caches_of(folder / "1")
    assert "coat_render.abc" in expected and "coat_render.h5" in expected
    for name in (*runs, "stopped"):
        found = caches_of(folder / name)
        assert found == expected, f"{name}: {[file for file in expected if found.get(file) != expected[file]]}"


def test_the_plan_tells_how_large_it_is(coat):
    line = [program("DRAPERY", "drapery"), "plan", str(coat.parent / "coat.toml"), "--set", f"assets={coat.parent}", "--json"]
    done = subprocess.run(line, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    (told,) = json.loads(done.stdout)["render_meshes"]
    cache = hdf5(coat / "coat_render.h5")
    points = len(cache["positions"][0])
    # Positions, velocities and normals, three numbers of four bytes each.
    assert told == {"name": "coat_render", "garment": "coat", "points": points, "triangles": len(cache["triangles"]),
                    "bytes_per_sample": points * 36}


def test_alembic_and_hdf5_hold_the_same_with_normals_of_length_one(coat):
    cache, answer = hdf5(coat / "coat_render.h5"), official(coat / "coat_render.abc")
    assert np.array_equal(answer["positions"], cache["positions"])
    assert np.array_equal(answer["velocities"], cache["velocities"])
    assert sorted(answer["face_set_names"]) == ["buttons", "collar", "collar_hems", "hems", "shell"]
    assert answer["constant"] or answer["homogeneous"]
    assert len(answer["uvs"]) == len(answer["face_indices"])
    with h5py.File(coat / "coat_render.h5") as file:
        normals = file["normals"][:][: len(cache["positions"])]
    assert normals.shape == cache["positions"].shape
    assert abs(np.linalg.norm(normals, axis=2) - 1).max() < 1e-6
    # By this file's own formula; the fans of the flat buttons have the areas of their polygons.
    for frame in (0, len(normals) - 1):
        expected = normals_of(cache["positions"][frame].astype(float), cache)
        assert abs(normals[frame] - expected).max() < 1e-6
    # As the official library has them: one for each point, in every sample.
    archive = Abc.IArchive(str(coat / "coat_render.abc"))
    schema = AbcGeom.IPolyMesh(archive.getTop().getChild(0), "coat_renderShape").getSchema()
    param = schema.getNormalsParam()
    assert param.valid() and param.getNumSamples() == len(normals)
    assert param.getScope() == AbcGeom.GeometryScope.kVertexScope
    for sample in (0, len(normals) - 1):
        values = np.array(param.getValueProperty().samples[sample])
        assert np.array_equal(values, normals[sample])
    # The garment's own cache has none.
    plain = AbcGeom.IPolyMesh(Abc.IArchive(str(coat / "coat.abc")).getTop().getChild(0), "coatShape")
    assert not plain.getSchema().getNormalsParam().valid()


def test_pixars_library_reads_the_same_and_finds_it_valid(coat):
    if not has_usd():
        pytest.skip("no USD in this build")
    from pxr import Usd, UsdGeom, UsdValidation

    stage = Usd.Stage.Open(str(coat / "coat.usda"))
    meshes = {prim.GetName(): UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)}
    assert set(meshes) == {"coatShape", "coat_renderShape"}
    mesh, cache = meshes["coat_renderShape"], hdf5(coat / "coat_render.h5")
    assert mesh.GetNormalsInterpolation() == "vertex"
    assert not meshes["coatShape"].GetNormalsAttr().HasValue()
    assert (mesh.ComputePurpose(), meshes["coatShape"].ComputePurpose()) == ("render", "proxy")
    with h5py.File(coat / "coat_render.h5") as file:
        normals = file["normals"][:]
    for index, frame in enumerate(cache["frame_numbers"]):
        time = Usd.TimeCode(int(frame))
        assert np.array_equal(mesh.GetPointsAttr().Get(time), cache["positions"][index])
        assert np.array_equal(mesh.GetVelocitiesAttr().Get(time), cache["velocities"][index])
        assert np.array_equal(mesh.GetNormalsAttr().Get(time), normals[index])
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    assert not [error.GetMessage() for error in errors if not error.HasNoError()]


def inner_edges(surface):
    """Edges of two triangles: their ends, and the triangles."""
    found = {}
    for index, corners in enumerate(surface):
        for a, b in zip(corners, np.roll(corners, -1)):
            found.setdefault((min(a, b), max(a, b)), []).append(index)
    inner = {edge: sides for edge, sides in found.items() if len(sides) == 2}
    return np.array(list(inner)), np.array(list(inner.values()))


def fold_angles(x, surface, sides):
    """Angles by which edges are folded, 0 where they are flat [degrees]."""
    a, b, c = (x[surface[:, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.degrees(np.arccos(np.clip((normals[sides[:, 0]] * normals[sides[:, 1]]).sum(axis=1), -1, 1)))


def test_it_keeps_its_distance_and_its_layers_cross_in_tight_folds_alone(coat, report_figure):
    import igl

    cloth, render = hdf5(coat / "coat.h5"), hdf5(coat / "coat_render.h5")
    parts = parts_of(coat / "coat_render.abc")
    faces, surface = polygons(render), cloth["triangles"].astype(np.int64)
    shell, buttons = parts["shell"], parts["buttons"]
    in_shell = np.isin(faces, np.union1d(shell, parts["hems"])).all(axis=1)
    in_collar = np.isin(faces, np.union1d(parts["collar"], parts["collar_hems"])).all(axis=1)
    sheet_crossings, layer_crossings, in_folds, farthest, nearest, bend = [], [], 0, 0.0, 1.0, 0.0
    ends, sides = inner_edges(surface)
    places, at_rest = cloth["positions"][0][ends].mean(axis=1), render["positions"][0].astype(float)
    first = np.linalg.norm(render["positions"][0][buttons] - render["positions"][0][buttons[0]], axis=1)
    for index in range(len(render["frame_numbers"])):
        points, x = render["positions"][index].astype(float), cloth["positions"][index].astype(float)
        sheet_crossings.append(len(crossing_pairs(x, surface)))
        tight = places[fold_angles(x, surface, sides) > TIGHT]
        layer_crossings.append([0, 0])
        for which, chosen in enumerate((in_shell, in_collar)):
            for pair in crossing_pairs(points, faces[chosen]):
                middles = at_rest[faces[chosen][list(pair)]].mean(axis=1)
                is_in_fold = all((np.linalg.norm(tight - middle, axis=1) < AROUND).any() for middle in middles)
                layer_crossings[-1][which] += not is_in_fold
                in_folds += is_in_fold
        distance = np.sqrt(igl.point_mesh_squared_distance(points[shell], x, surface)[0])
        farthest, nearest = max(farthest, distance.max()), min(nearest, distance.min())
        in_button = buttons[:32]
        now = np.linalg.norm(points[in_button] - points[in_button[0]], axis=1)
        bend = max(bend, abs(now - first[:32]).max())
    moved = np.abs(cloth["positions"][-1] - cloth["positions"][0]).max()
    report_figure(f"moved {moved:.2f} m; shell {nearest * 1e3:.2f} to {farthest * 1e3:.2f} mm from the cloth; "
                  f"crossings of cloth {sum(sheet_crossings)}, of shell and collar {np.sum(layer_crossings, axis=0)}, and {in_folds} in folds")
    assert moved > 0.1
    assert sum(sheet_crossings) == 0
    assert np.sum(layer_crossings) == 0
    # Never farther than at rest: 1 mm, and what a chord of 48 corners lies inside of the circle, at the hem.
    assert farthest < SHELL + 0.24 * (1 - np.cos(np.pi / 48)) + 1e-6
    # A button moves as one piece: rounding of single precision at 1.5 m.
    assert bend < 1e-6


def test_velocities_are_those_of_the_motion(coat):
    cache = hdf5(coat / "coat_render.h5")
    x, v = cache["positions"].astype(float), cache["velocities"].astype(float)
    step = cache["times"][1] - cache["times"][0]
    # Hermite's rule: positions a frame apart differ by the mean velocity, up to the change of the acceleration.
    difference = (x[1:] - x[:-1]) / step
    off = np.linalg.norm(difference - (v[1:] + v[:-1]) / 2, axis=2)
    plain = hdf5(coat / "coat.h5")
    of_cloth = np.linalg.norm(np.diff(plain["positions"].astype(float), axis=0) / step
                              - (plain["velocities"][1:].astype(float) + plain["velocities"][:-1]) / 2, axis=2)
    # As well as those of the cloth itself.
    assert np.median(off) < 1.5 * np.median(of_cloth) + 1e-3
    assert np.percentile(off, 99) < 1.5 * np.percentile(of_cloth, 99) + 1e-2


def test_what_a_render_mesh_crosses_is_told_and_breaks_no_rule(coat):
    caches = sorted(path for path in coat.iterdir() if path.suffix in (".abc", ".usd", ".usda"))
    assert len(caches) >= 2
    together = [path for path in caches if path.suffix == ".abc"]
    for files in [*([path] for path in caches), together, ["--record", coat, *together]]:
        done = subprocess.run([program("DRAPERY", "drapery"), "verify", *map(str, files)], capture_output=True, text=True)
        assert done.returncode == 0, f"{files}: {done.stderr}"
        if any("render" in str(path) for path in files):
            assert "(render mesh of coat, reported only): its layers intersect in " in done.stdout, done.stdout


def test_a_stage_is_converted_with_garment_and_render_mesh(coat, tmp_path):
    if not has_usd():
        pytest.skip("the program is built without USD")
    drapery = program("DRAPERY", "drapery")
    stage, layer = coat / "coat.usda", tmp_path / "all.usdc"
    done = subprocess.run([drapery, "convert", stage, layer], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = subprocess.run([drapery, "info", layer], capture_output=True, text=True).stdout
    assert "(not read: its purpose is proxy)" in told and told.count(": mesh") == 2, told
    same = subprocess.run([drapery, "diff", stage, layer], capture_output=True, text=True)
    assert same.returncode == 0 and ": equal" in same.stdout, same.stdout
