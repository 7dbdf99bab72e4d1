"""The scenes of the how-to pages do what the pages say, by geometry and by laws that need no solver.

`tests/tour/main.rs` runs the commands of the pages and looks for the lines that they show. Pages with the mannequin are in
`test_howto_bodies.py`; `ELSEWHERE` says where the others are tested.
"""

import json
import shutil
import signal
import tomllib

import igl
import numpy as np
import pytest

from farm import BAD_SCENE, STOPPED, Shot, assert_same, manifest, reaches, results, stop
from howto import (
    GRAVITY, HOWTO, ROUNDING, SAMPLES, SHORT_STEPS, Run, accelerations, altered, fenced, folds, holds, masses, number, page, said, strains,
    volume,
)  # fmt: skip
from judges import ROOT, official, z_up

HERE = ROOT / "tests" / "oracle"

# Pages whose claims other tests hold.
ELSEWHERE = {
    "blender": ["tests/oracle/test_blender_addon.py", "tests/oracle/test_blender_artist.py", "tests/oracle/test_blender_installs.py",
                "tests/oracle/test_blender_texts.py", "tests/oracle/test_blender_window.py"],
    "from_python": ["plugins/python/tests/test_analysis.py"],
    "view": ["tests/oracle/test_view.py", "cli/tests/command/view.rs"],
    # The tour runs the page's two runs of the flag and compares them; then longer runs, on more processes, over a
    # slow cable, stopped and lost.
    "two_machines": ["tests/tour/main.rs", "tests/oracle/test_mpi_runs.py", "tests/oracle/test_lost_rank.py",
                     "tests/oracle/test_two_machines.py"],
    "wedge": ["tests/oracle/test_wedge.py"],
}

# Scenes that pages quote: the page, the scene and the number of the block.
QUOTED = [
    ("cape", f"{HOWTO}/cape.toml", 0), ("trousers", f"{HOWTO}/trousers.toml", 0), ("flag", f"{SAMPLES}/flag.toml", 0),
    ("painted_maps", f"{HOWTO}/painted_maps.toml", 0), ("over_time", f"{HOWTO}/over_time.toml", 0), ("closures", f"{HOWTO}/closures.toml", 0), ("seams_cushion", f"{SAMPLES}/sewn_tube.toml", 0),
    ("seams_cushion", f"{SAMPLES}/pillow.toml", 1), ("seams_cushion", f"{SAMPLES}/cushion.toml", 2),
]  # fmt: skip


# ---- all pages


def test_every_page_is_tested_here_or_elsewhere():
    pages = {path.stem for path in (ROOT / "docs" / "howto").glob("*.md")} - {"README"}
    tests = (HERE / "test_howto.py").read_text() + (HERE / "test_howto_bodies.py").read_text()
    here = {name for name in pages if f"\n# ---- {name}\n" in tests.replace(", ", "\n")}
    assert here | set(ELSEWHERE) == pages and not here & set(ELSEWHERE)
    assert all((ROOT / file).is_file() for files in ELSEWHERE.values() for file in files)


@pytest.mark.parametrize(("name", "scene", "block"), QUOTED)
def test_what_a_page_quotes_stands_in_its_scene(name, scene, block):
    quoted = tomllib.loads(fenced(name, "toml", block).replace("[[garment.pin]]", "[[pin]]").replace("[garment.", "["))
    whole = tomllib.loads((ROOT / scene).read_text())
    garments = quoted.pop("garment", [])
    assert quoted or garments
    for key, value in quoted.items():
        assert any(key in table and holds(table[key], value) for table in [whole, *whole["garment"]]), f"{scene} has no such {key}: {value}"
    assert holds(whole["garment"], garments), f"{scene} has no such garment: {garments}"


# ---- fabric

FABRICS = ("silk_light", "denim_11oz", "leather_garment")


@pytest.fixture(scope="module")
def draped(run_howto):
    """The square over the ball, in the fabrics of the picture; with one integrator, so that nothing else differs."""
    return {fabric: run_howto(f"{HOWTO}/fabric.toml", resolution=24, fabric=fabric, **SHORT_STEPS) for fabric in FABRICS}


def test_silk_has_the_most_folds_and_leather_the_fewest(draped, report_figure):
    """Compares the share of edges that are folded by more than 40 degrees, over the last quarter second."""
    shares = []
    for run in draped.values():
        x, triangles = run.positions("square"), run.caches["square"]["triangles"]
        shares.append(np.mean([(folds(points, triangles)[0] > 40).mean() for points in x[-6:]]))
    report_figure(f"edges folded by more than 40 degrees: {', '.join(f'{f} {100 * s:.1f} %' for f, s in zip(draped, shares))}")
    assert shares[0] > 1.15 * shares[1] > 1.15 * 1.1 * shares[2]


@pytest.mark.parametrize("fabric", FABRICS)
def test_the_largest_strain_of_a_fabric_is_the_limit_of_its_edges(fabric, draped, report_figure):
    run = draped[fabric]
    x, triangles = run.positions("square"), run.caches["square"]["triangles"]
    limit = float(said("materials", fabric).split("largest strain ")[1].split(" %")[0]) / 100
    stretched = np.array([strains(points, x[0], triangles) for points in x])
    over = (stretched > limit + 1e-4).mean()
    # A collision moves single vertices after the limit has acted.
    but_few = np.quantile(stretched, 0.9999)
    report_figure(f"{fabric}: largest strain {100 * stretched.max():.2f} of {100 * limit:.1f} %, of all edges but one in 10,000 "
                  f"{100 * but_few:.2f} %, {100 * over:.3f} % of all edges above")  # fmt: skip
    assert run.garment("square")["strain_limit"]["limit"] == pytest.approx(limit)
    assert 0.2 * limit < but_few < 1.1 * limit and over < 1e-3


def test_the_page_names_every_fabric_and_each_is_taken_by_its_name(tmp_path):
    listed = [line.split(":")[0] for line in said("materials").splitlines() if line and not line.startswith(" ") and ":" in line]
    rows = [row.split("`")[1] for row in page("fabric").split("## Which fabric for what")[1].split("##")[0].splitlines() if "| `" in row]
    assert rows == listed, f"the page: {rows}; the program: {listed}"
    # In any other scene, by the garment's name.
    out = tmp_path / "flag"
    said("run", ROOT / SAMPLES / "flag.toml", "--frames", "0-1", "--set", "resolution=4", "--out", out,
         "--set", "garment.flag.material=silk_light")  # fmt: skip
    assert Run(out).garment("flag")["density"] == Run(out).scene["garment"][0]["density"] == 0.083


def test_keys_beside_the_fabric_override_it_alone(tmp_path):
    own = fenced("fabric", "toml").replace("\n\n", "\n")
    scene = tmp_path / "own.toml"
    panel = 'panel = { resolution = 4, side = 0.4, center = [0, 1, 0] }\n'
    for name, garment in (("own", own), ("preset", '[[garment]]\nname = "scarf"\nmaterial = "silk_light"\n')):
        scene.write_text(f'drapery = 1\n[shot]\nframes = "0-1"\n[gravity]\n{garment}{panel}')
        said("run", scene, "--out", tmp_path / name)
    own, preset = (Run(tmp_path / name).garment("scarf") for name in ("own", "preset"))
    assert (number(own["density"].replace(" g/m²", "")) * 1e-3, own["dihedral_bending"]["stiffness"]) == (0.12, 4e-6)
    differing = {key for key in own if own[key] != preset[key]}
    assert differing == {"density", "dihedral_bending"}, differing


# ---- faster


def test_presets_take_their_steps_and_fold_as_much(run_howto, report_figure):
    """Four, eight and sixteen long steps a frame, more where the cloth needs them.

    Folds fall one way or the other: of one mesh their mean differs by a third between starts.
    """
    steps, folded = [], []
    for preset in ("preview", "production", "hero"):
        runs = [run_howto(f"{HOWTO}/fabric.toml", resolution=n, **{"solver.preset": preset}) for n in (16, 17, 18, 20)]
        steps.append([record["steps"] for run in runs for record in run.records.values() if "steps" in record])
        angles = [folds(run.positions("square")[-1], run.caches["square"]["triangles"])[0].mean() for run in runs]
        folded.append(np.mean(angles))
    report_figure(f"steps {[sum(row) for row in steps]}, mean folds {np.round(folded, 1)} degrees")
    assert [min(row) for row in steps] == [4, 8, 16]
    assert sum(steps[0]) < sum(steps[1]) < sum(steps[2])
    assert max(folded) < 1.3 * min(folded)


def test_half_the_resolution_has_a_quarter_of_the_vertices(run_howto):
    coarse, fine = (run_howto(f"{SAMPLES}/flag.toml", "0-1", resolution=n).positions("flag").shape[1] for n in (16, 32))
    # But for the rim: (n + 1) (1.5 n + 1) vertices.
    assert coarse / fine == pytest.approx(0.25, abs=0.02)


def test_one_format_leaves_fewer_bytes_and_the_same_cache(run_howto, tmp_path):
    both = run_howto(f"{SAMPLES}/flag.toml", "0-1", resolution=16).out
    said("run", ROOT / SAMPLES / "flag.toml", "--frames", "0-1", "--set", "resolution=16", "--set", 'output.format=["abc"]',
         "--out", tmp_path / "one")  # fmt: skip
    assert {path.name for path in (tmp_path / "one").iterdir() if path.suffix in (".abc", ".h5")} == {"flag.abc"}
    assert (tmp_path / "one" / "flag.abc").read_bytes() == (both / "flag.abc").read_bytes() and (both / "flag.h5").is_file()


def test_the_plan_shows_the_cost_of_effects_and_a_thickness_that_is_lowered():
    flag = [ROOT / SAMPLES / "flag.toml", "--set", "resolution=12"]
    told = json.loads(said("plan", *flag, "--measure=3", "--json"))
    shares = {effect["effect"]: effect["share"] for effect in told["effects"]}
    assert {"gravity", "stretch", "wind"} <= shares.keys() and 0 < sum(shares.values()) < 1.001, shares
    assert shares["gravity"] < shares["wind"], "a force for each vertex costs less than one for each triangle of air"
    words = "thickness_lowered"
    assert words not in said("plan", *flag) and words in said("plan", *flag, "--set", "garment.flag.thickness=5 cm")


# ---- flag


@pytest.fixture(scope="module")
def flags(run_howto, tmp_path_factory):
    """The flag in its wind, in a stronger one, in still air and without air."""
    speeds = {"wind": 6.0, "strong": 10.0, "still": 0.0}
    found = {name: run_howto(f"{SAMPLES}/flag.toml", resolution=12, speed=speed) for name, speed in speeds.items()}
    out = tmp_path_factory.mktemp("flag") / "none"
    said("run", ROOT / SAMPLES / "flag.toml", "--set", "resolution=12", "--without", "wind", "--threads", 2, "--out", out)
    return found | {"none": Run(out)}


def ends(run):
    """Vertices of the pole's edge and of the free edge."""
    start = run.positions("flag")[0]
    return run.pinned("flag", start), np.flatnonzero(start[:, 0] > start[:, 0].max() - 1e-4)


def test_the_pole_holds_and_the_free_edge_flies_downwind_the_higher_the_stronger_it_blows(flags, report_figure):
    lift = {}
    for name, run in flags.items():
        x, (pole, free) = run.positions("flag"), ends(run)
        np.testing.assert_allclose(x[:, pole], np.broadcast_to(x[0, pole], x[:, pole].shape), atol=ROUNDING)
        np.testing.assert_array_equal(pole, np.flatnonzero(x[0, :, 0] < x[0, :, 0].min() + 1e-4))
        lift[name] = x[-24:, free].mean(axis=(0, 1)) - x[0, pole].mean(axis=0)
    report_figure("; ".join(f"{name}: free edge at {np.round(at, 2)}" for name, at in lift.items()))
    length = np.ptp(flags["wind"].positions("flag")[0][:, 0])
    # Along +x, and to +z as the fifth of the wind does; in still air it hangs.
    for name in ("wind", "strong"):
        along, _, across = lift[name]
        assert along > 0.8 * length and across > 0.05 * length
    assert lift["strong"][1] > lift["wind"][1] + 0.02 > lift["still"][1] + 0.3
    assert lift["still"][0] < 0.3 * length


def test_air_that_stands_still_slows_the_cloth(flags, report_figure):
    velocities = {name: flags[name].caches["flag"]["velocities"][-24:].astype(float) for name in ("still", "none")}
    speed = {name: np.sqrt(np.square(v).sum(axis=2).mean()) for name, v in velocities.items()}
    report_figure(f"in the fourth second {speed['still']:.2f} m/s in still air, {speed['none']:.2f} m/s without air")
    assert speed["still"] < 0.6 * speed["none"]


def test_drag_along_the_cloth_smooths_fast_flutter(run_howto, report_figure):
    """Mean acceleration of vertices over the six seconds of full wind: that of two differs by a fifth from run to run."""
    felt = {}
    for drag in (0, 0.1, 0.2):
        run = run_howto(f"{SAMPLES}/flag.toml", "0-192", resolution=12, **{"shot.frames": "0-192", "wind.tangential": drag})
        felt[drag] = np.linalg.norm(np.diff(run.positions("flag")[48:], 2, axis=0) * 24**2, axis=2).mean()
    report_figure(f"accelerations by tangential drag: {', '.join(f'{drag}: {a:.1f} m/s²' for drag, a in felt.items())}")
    assert felt[0.2] < 0.7 * felt[0] and felt[0.2] < felt[0.1] < felt[0]


# ---- houdini_maya


def test_a_converted_cache_is_in_centimetres_with_z_up(run_howto, tmp_path):
    """Positions and velocities a hundred times as large, turned about x; the frames keep their times."""
    source = run_howto(f"{SAMPLES}/flag.toml", "0-4", resolution=8).out / "flag.abc"
    said("convert", source, tmp_path / "cm.abc", "--length", "cm", "--up", "Z")
    said("verify", tmp_path / "cm.abc")
    before, after = official(source), official(tmp_path / "cm.abc")
    for name in ("world_positions", "velocities"):
        np.testing.assert_allclose(after[name], 100 * z_up(before[name].astype(float)), rtol=1e-6, atol=1e-4)
    np.testing.assert_array_equal(after["face_indices"], before["face_indices"])
    # Frame f at f/fps seconds.
    np.testing.assert_allclose(after["times"], np.arange(5) / 24, rtol=0, atol=1e-9)
    # Back from a cache whose unit is stated.
    said("convert", tmp_path / "cm.abc", tmp_path / "m.abc", "--length", "m", "--up", "Y")
    np.testing.assert_allclose(official(tmp_path / "m.abc")["world_positions"], before["world_positions"], atol=ROUNDING)


# ---- motion_blur, of which `test_sub_frames.py` holds what does not belong to this scene


# The scene writes no HDF5, which the tests read.
SHEET = {"resolution": 12, "output.format": '["abc", "h5"]'}


@pytest.fixture(scope="module")
def blur(run_howto):
    return run_howto(f"{HOWTO}/motion_blur.toml", **SHEET)


def test_samples_lie_over_the_shutter_and_velocities_are_their_differences(blur, report_figure):
    """Second differences vanish as the square of the time between samples."""
    archive, frames = official(blur.out / "sheet.abc"), np.array(blur.numbers("sheet"))
    output = blur.scene["output"]
    opened, closed = output["shutter"]
    places = np.linspace(opened, closed, output["samples"])
    all_places = np.unique(np.round((frames[:, None] + places).ravel(), 9))
    within = all_places[(all_places >= frames[0]) & (all_places <= frames[-1])]
    np.testing.assert_allclose(archive["times"], within / 24, rtol=0, atol=1e-9)
    x, v = archive["positions"].astype(float), archive["velocities"].astype(float)
    at = np.flatnonzero(np.isin(np.round(archive["times"] * 24, 6), frames[1:-1]))
    off = []
    for reach in (1, 2):
        seconds = archive["times"][at + reach] - archive["times"][at - reach]
        seen = (x[at + reach] - x[at - reach]) / seconds[:, None, None]
        off.append(np.linalg.norm(seen - v[at]) / np.linalg.norm(v[at]))
    report_figure(f"velocities differ from differences of samples by {100 * off[0]:.3f} % and, twice as far apart, by {100 * off[1]:.3f} %")
    assert np.linalg.norm(v, axis=2).max() > 1.0, "it swings fast"
    assert off[0] < 0.01 and off[0] < 0.5 * off[1]


def test_blur_along_straight_lines_misses_what_samples_follow(blur, report_figure):
    """The page's reason for samples: over the shutter a velocity leads a vertex off its curved path, by half its acceleration."""
    archive = official(blur.out / "sheet.abc")
    x, v, times = archive["positions"].astype(float), archive["velocities"].astype(float), archive["times"]
    at = np.flatnonzero(np.isin(np.round(times * 24, 6), blur.numbers("sheet")[1:-1]))
    reach = blur.scene["output"]["shutter"][1] / 24
    straight = np.linalg.norm(x[at + 2] - x[at] - v[at] * reach, axis=2).max(axis=1)
    curved = np.linalg.norm(v[at + 2] - v[at - 2], axis=2).max(axis=1) * reach / 4
    missed, expected = 1e3 * straight.max(), 1e3 * curved.max()
    report_figure(f"a straight line misses the end of the shutter by up to {missed:.2f} mm; by the curvature {expected:.2f} mm")
    assert straight.max() > 2e-4 and 0.3 < straight.max() / curved.max() < 3


def test_velocities_are_in_units_of_the_cache_a_second_and_can_be_left_out(run_howto, blur):
    scene, few = f"{HOWTO}/motion_blur.toml", "0-3"
    metres, cm = (run_howto(scene, few, **SHEET, **{"units.length": unit}) for unit in ("m", "cm"))
    for name in ("positions", "velocities"):
        np.testing.assert_allclose(cm.caches["sheet"][name], 100 * metres.caches["sheet"][name].astype(float), rtol=1e-5, atol=1e-4)
    without = run_howto(scene, few, **SHEET, **{"output.velocities": "false"})
    assert official(without.out / "sheet.abc")["velocities"].size == 0
    # The cache grows with the samples: 13 of four frames instead of four.
    whole = run_howto(scene, few, **SHEET, **{"output.samples": 1})
    sizes = [(run.out / "sheet.abc").stat().st_size for run in (metres, whole)]
    assert sizes[0] > 2 * sizes[1]


# ---- on_the_farm, whose exit codes, schedulers and progress `test_farm.py` and `test_restart.py` hold


def test_a_flag_that_is_stopped_ends_with_75_and_resumes_to_the_same_bytes(tmp_path, report_figure):
    """As in the picture: stopped by SIGTERM at about frame 48, and resumed by the same command."""
    shot = Shot(ROOT / SAMPLES / "flag.toml", "0-96", resolution=16)
    shot.run(tmp_path / "whole")
    run = shot.start(tmp_path / "stopped")
    assert reaches(tmp_path / "stopped", run, 48)
    code, seconds = stop(run, signal.SIGTERM)
    stopped_at = manifest(tmp_path / "stopped")["last_complete_frame"]
    report_figure(f"exit code {code} at frame {stopped_at}, {seconds:.2f} s after the signal")
    assert code == STOPPED == 75 and 48 <= stopped_at < 96
    shot.run(tmp_path / "stopped")
    assert_same(tmp_path / "stopped", results(tmp_path / "whole"))


def test_a_time_limit_ends_with_75_too(tmp_path):
    shot = Shot(ROOT / SAMPLES / "flag.toml", "0-96", resolution=16)
    shot.run(tmp_path / "out", "--max-wall", "0.1s", code=STOPPED)
    assert manifest(tmp_path / "out").get("last_complete_frame", 0) < 96


# ---- over_time


def test_cloth_becomes_limp_and_slides_off_by_the_curves_of_its_numbers(run_howto, report_figure):
    """Height of the rim below the top, and the lowest vertex after the ball has become slippery."""
    run = run_howto(f"{HOWTO}/over_time.toml", resolution=20)
    x, triangles = run.positions("square"), run.caches["square"]["triangles"]
    frame = {number: place for place, number in enumerate(run.numbers("square"))}
    rim = np.unique(igl.boundary_facets(triangles.astype(np.int64))[0])
    below = {number: x[frame[number]][:, 1].max() - x[frame[number]][rim, 1].mean() for number in (8, 28)}
    lowest = x[frame[42]][:, 1].min()
    report_figure(f"rim below the top: {below[8]:.2f} m at frame 8, {below[28]:.2f} m at frame 28; lowest at frame 42: {lowest:.2f} m")
    assert below[28] > 1.5 * below[8]
    assert lowest < x[frame[28]][:, 1].min() - 0.1


# ---- painted_maps


def lower_third(run, garment, painted):
    """Mean angle by which a curtain is folded where starch is painted, in the last second [degrees]."""
    x, triangles = run.positions(garment), run.caches[garment]["triangles"]
    inside = painted[folds(x[0], triangles)[1]].all(axis=1)
    return np.mean([folds(points, triangles)[0][inside].mean() for points in x[-24:]])


def test_starch_flattens_the_lower_third_and_weight_lowers_the_hem(run_howto, run_scene, tmp_path, report_figure):
    """Beside the plain curtain, and beside the same one without the one map or the other: means of three starts that differ by 10 µm,
    because flat curtains fold to either side."""
    scene, files = f"{HOWTO}/painted_maps.toml", {"dihedral_bending": "starch.txt", "density": "hem.txt"}
    values = {key: np.loadtxt(ROOT / HOWTO / file) for key, file in files.items()}
    height = run_howto(scene).positions("starched")[0][:, 1]
    painted, hem = values["dihedral_bending"] > 1, height < height.min() + 0.01
    assert set(values["dihedral_bending"]) == {1, 30} and set(values["density"]) == {1, 4}
    np.testing.assert_array_equal(painted, height < height.min() + 0.2)
    np.testing.assert_array_equal(values["density"] > 1, hem)
    for file in files.values():
        shutil.copy(ROOT / HOWTO / file, tmp_path)
    folded, heights = {}, {}
    for seed in range(3):
        material = 'material = "cotton_shirting"'
        shaken = (material, f'{material}\njitter = {{ axis = "z", amplitude = 1e-5, seed = {seed} }}')
        for left_out in ["nothing", *files]:
            folder = tmp_path / f"{left_out}_{seed}"
            folder.mkdir()
            changes = [shaken, ('"file:', '"file:../')]
            if left_out in files:
                changes.insert(0, (rf'{left_out} = "file.*', ""))
            run = Run(run_scene(str(altered(scene, folder, *changes)), "0-48"))
            folded.setdefault(left_out, []).append(lower_third(run, "starched", painted))
            heights.setdefault(left_out, []).append(run.positions("starched")[-24:, hem, 1].mean())
            if left_out == "nothing":
                folded.setdefault("plain", []).append(lower_third(run, "plain", painted))
    plain, starched, both = (np.mean(folded[name]) for name in ["plain", "density", "nothing"])
    sunk = 1e3 * (np.mean(heights["density"]) - np.mean(heights["nothing"]))
    report_figure(f"folds of the lower third: plain {plain:.1f}, starched {starched:.1f}, both {both:.1f} degrees; the weighted hem hangs "
                  f"{sunk:.1f} mm lower")
    assert max(starched, both) < 0.6 * plain
    assert all(weighted < light for weighted, light in zip(heights["nothing"], heights["density"], strict=True))


MAPPED = """
drapery = 1
[shot]
frames = "0-6"
[gravity]
[[garment]]
name = "cloth"
material = "cotton_shirting"
panel = {{ resolution = 5, side = 0.4, aspect = 1.0, center = [0, 1, 0] }}
{settings}
[[garment.pin]]
{pin}
"""
CORNERS = 'corners = ["i0j0", "inj0"]'


@pytest.fixture(scope="module")
def mapped(run_scene, tmp_path_factory):
    """Positions of a small cloth with maps of one number everywhere."""
    folder = tmp_path_factory.mktemp("maps")
    for value in (0, 1, 4, 30, 4.2e-4):
        np.savetxt(folder / f"{value:g}.txt", np.full(36, value))
    np.savetxt(folder / "half.txt", np.repeat([0.4, 0.6], 18))

    def positions(name, settings, pin=CORNERS):
        (folder / f"{name}.toml").write_text(MAPPED.format(settings=settings, pin=pin))
        return Run(run_scene(str(folder / f"{name}.toml"), "0-6")).positions("cloth")

    return positions


def test_values_of_a_map_multiply_and_absolute_ones_replace(mapped):
    """Thirty times the bending of cotton, by a number, by a map of factors and by one in SI units; 1 changes nothing, 0 switches off."""
    paint = 'maps = {{ dihedral_bending = "file:{}.txt" }}'.format
    heavy, weighted = mapped("heavy", "density = 0.6"), mapped("weighted", 'maps = { density = "file:4.txt" }')
    np.testing.assert_allclose(weighted, heavy, rtol=0, atol=ROUNDING)
    plain, one = mapped("plain", ""), mapped("one", paint("1"))
    np.testing.assert_allclose(one, plain, rtol=0, atol=ROUNDING)
    thirty = mapped("thirty", "dihedral_bending = { stiffness = 4.2e-4 }")
    for name, settings in (("factor", paint("30")), ("absolute", paint("0.00042") + '\nabsolute_maps = ["dihedral_bending"]')):
        np.testing.assert_allclose(mapped(name, settings), thirty, rtol=0, atol=ROUNDING, err_msg=name)
    off, without = mapped("off", paint("0")), mapped("without", "dihedral_bending = { stiffness = 1e-12 }")
    np.testing.assert_allclose(off, without, rtol=0, atol=1e-5)
    assert min(abs(plain - other).max() for other in (thirty, off, heavy)) > 1e-4, "bending and weight are seen"


def test_a_map_pins_what_lies_above_one_half(mapped):
    x = mapped("pinned", "", 'map = "file:half.txt"')
    still = (x == x[0]).all(axis=(0, 2))
    np.testing.assert_array_equal(still, np.arange(36) >= 18)


# ---- render_mesh, whose normals, layers, bytes and words `test_render_mesh.py` holds


@pytest.fixture(scope="module")
def coat(run_howto):
    return run_howto(f"{SAMPLES}/coat.toml", "1001-1013")


def pieces(count, faces):
    """Points of each connected piece of faces."""
    parent = np.arange(count)
    for face in faces:
        roots = [root(parent, corner) for corner in face]
        parent[roots] = min(roots)
    found = {}
    for point in np.unique(np.concatenate(faces)):
        found.setdefault(root(parent, point), []).append(point)
    return [np.array(points) for points in found.values()]


def root(parent, point):
    while parent[point] != point:
        point = parent[point]
    return point


def test_the_cache_has_the_faces_uvs_and_sets_of_the_file(coat, howto_assets):
    given, cache = official(howto_assets / "coat_render.abc"), official(coat.out / "coat_render.abc")
    names = ["face_counts", "face_indices", "uvs", "face_set_names", *(f"face_set_{i}" for i in range(len(given["face_set_names"])))]
    for name in names:
        np.testing.assert_array_equal(cache[name], given[name], err_msg=name)
    assert not cache["constant"] and cache["positions"].shape[1] == given["positions"].shape[1]


def test_every_button_moves_as_one_piece_and_nothing_leaves_the_cloth(coat, howto_assets, report_figure):
    given = official(howto_assets / "coat_render.abc")
    buttons = given[f"face_set_{given['face_set_names'].tolist().index('buttons')}"]
    starts = np.cumsum([0, *given["face_counts"]])
    rigid = pieces(given["positions"].shape[1], [given["face_indices"][starts[face] : starts[face + 1]] for face in buttons])
    x, rest = coat.positions("coat_render"), given["positions"][0].astype(float)
    worst = 0.0
    for points in rigid:
        apart = np.linalg.norm(rest[points][:, None] - rest[points], axis=2)
        for frame in x[:, points]:
            worst = max(worst, abs(np.linalg.norm(frame[:, None] - frame, axis=2) - apart).max())
    # At rest no point is farther from the cloth than this, nor later.
    cloth = coat.caches["coat"]
    triangles, soft = cloth["triangles"].astype(np.int64), np.delete(np.arange(x.shape[1]), np.concatenate(rigid))
    surface = official(howto_assets / "coat.abc")["positions"][0].astype(float)
    at_rest = np.sqrt(igl.point_mesh_squared_distance(rest[soft], surface, triangles)[0])
    farther = [(np.sqrt(igl.point_mesh_squared_distance(x[i, soft], cloth["world_positions"][i], triangles)[0]) - at_rest).max()
               for i in range(len(x))]  # fmt: skip
    moved = np.linalg.norm(x[-1] - x[0], axis=1).max()
    report_figure(f"{len(rigid)} buttons keep their shape to {1e9 * worst:.0f} nm; points get at most {1e9 * max(farther):.0f} nm farther")
    assert len(rigid) > 1 and worst < 2 * ROUNDING
    assert max(farther) < 2 * ROUNDING and moved > 0.1


def test_points_far_from_the_cloth_give_a_warning_and_absent_sets_an_error(howto_assets, tmp_path):
    scene, settings, rule = f"{SAMPLES}/coat.toml", ["--set", f"assets={howto_assets}"], "render_mesh_distance"
    assert rule not in said("check", ROOT / scene, *settings)
    assert rule in said("check", altered(scene, tmp_path, ('max_distance = "12 mm"', 'max_distance = "1 mm"')), *settings)
    said("check", altered(scene, tmp_path, ('"buttons"', '"zip*"')), *settings, code=BAD_SCENE)


# ---- seams_cushion


@pytest.fixture(scope="module")
def sewn(run_howto):
    return run_howto(f"{SAMPLES}/sewn_tube.toml", "0-24", resolution=12, **{"output.preroll": "true"})


def pairs(run, seam):
    """Vertices of both sides of a seam, each with the nearest of the other at the start."""
    sides = []
    for end in ("from", "to"):
        x, box = run.positions(seam[end]["garment"])[0], seam[end]["where"]["box"]
        sides.append(np.flatnonzero(((x >= box["min"]) & (x <= box["max"])).all(axis=1)))
    first, second = (run.positions(seam[end]["garment"])[0][side] for end, side in zip(("from", "to"), sides))
    nearest = np.linalg.norm(first[:, None] - second, axis=2).argmin(axis=1)
    return sides[0], sides[1][nearest]


def test_seams_close_evenly_in_the_preroll_and_stay_closed(sewn, report_figure):
    """To the thickness of the cloth, and what the tube around the column, which is narrower, pulls it open."""
    (column,) = sewn.scene["body"]
    front, settled = sewn.positions("front"), sewn.scene["shot"]["preroll"]["settle"]
    thickness = number(sewn.garment("front")["thickness"])
    around = 2 * np.pi * (number(column["shape"]["capsule"]["radius"]) + number(column["thickness"]))
    width, height = np.ptp(front[0][:, 0]), np.ptp(front[0][:, 1])
    for seam in sewn.scene["seam"]:
        first, second = pairs(sewn, seam)
        gaps = np.linalg.norm(front[:, first] - sewn.positions("back")[:, second], axis=2)
        # Half way in half the time; near the end the panels lie on the column.
        part = np.arange(settled // 2 + 1)[:, None] / settled
        np.testing.assert_allclose(gaps[: settled // 2 + 1], gaps[0] * (1 - part) + thickness * part, rtol=0, atol=1e-3)
        strain = (around - 2 * thickness) / (2 * width) - 1
        pull = sewn.garment("front")["stretch"]["stiffness"] * strain * height / (len(first) - 1)
        opened = pull / number(seam["strength"])
        closed = gaps[settled:]
        report_figure(f"gap {gaps[0].mean():.2f} m at the start, then {1e3 * closed.min():.2f} to {1e3 * closed.max():.2f} mm; "
                      f"thickness {1e3 * thickness:.2f} mm and {1e3 * opened:.2f} mm by the pull")  # fmt: skip
        assert thickness - 1e-4 < closed.min() and closed.max() < min(thickness + 2.5 * opened, 0.005)


def test_panels_are_held_until_they_are_sewn_and_the_tube_hangs_on_the_column(sewn, report_figure):
    settled, drop = sewn.scene["shot"]["preroll"]["settle"], 0.5 * GRAVITY
    for name in ("front", "back"):
        x = sewn.positions(name)
        held = sewn.pinned(name, x[0])
        assert abs(x[: settled + 1, held, 1] - x[0, held, 1]).max() < ROUNDING, "along one axis"
        assert np.linalg.norm((x[settled, held] - x[0, held])[:, [0, 2]], axis=1).max() > 0.05, "seams draw them along the others"
        assert abs(x[-1, held, 1] - x[0, held, 1]).max() > ROUNDING, "released at the first frame"
        sunk = (x[settled] - x[-1])[:, 1].mean()
        report_figure(f"{name} sinks by {1e3 * sunk:.2f} mm in a second; free it would fall by {drop:.1f} m")
        assert abs(sunk) < 0.01 * drop


def test_panels_that_nothing_holds_fall_by_metres(run_scene, tmp_path, report_figure):
    free = altered(f"{SAMPLES}/sewn_tube.toml", tmp_path, (r"\[\[garment\.pin\]\].*\nwhere.*\naxes.*\nuntil.*\n", ""))
    x = Run(run_scene(str(free), "0-0", resolution=6, **{"output.preroll": "true"})).positions("front")
    fallen = (x[0] - x[-1])[:, 1].mean()
    report_figure(f"{fallen:.1f} m in {len(x) - 1} frames; freely {0.5 * GRAVITY * ((len(x) - 1) / 24) ** 2:.1f} m")
    assert 2.0 < fallen < 1.01 * 0.5 * GRAVITY * ((len(x) - 1) / 24) ** 2


CUSHION = f"{SAMPLES}/cushion.toml"
PRESSURE = "garment.cushion.pressure"


@pytest.fixture(scope="module")
def cushion(run_howto):
    return run_howto(CUSHION)


def volumes(run):
    x = run.positions("cushion")
    return np.array([volume(points, run.caches["cushion"]["triangles"]) for points in x])


def squash(run):
    """Mean height in the second half of the shot over the height when blown up."""
    heights = np.ptp(run.positions("cushion")[..., 1], axis=1)
    return heights[len(heights) // 2 :].mean() / heights.max()


def test_the_cushion_swells_by_less_than_its_gas_allows_falls_and_rests(cushion, report_figure):
    """Boyle's law: at the pressure outside the gas would fill (ambient + overpressure) / ambient times its volume."""
    x, times, pressure = cushion.positions("cushion"), cushion.caches["cushion"]["times"], cushion.garment("cushion")["pressure"]
    ambient, over = number(pressure["ambient"]), number(pressure["overpressure"])
    swollen = volumes(cushion) / volumes(cushion)[0]
    speed = np.linalg.norm(cushion.caches["cushion"]["velocities"], axis=2).mean(axis=1)
    weights = masses(x[0], cushion.caches["cushion"]["triangles"])
    above = np.flatnonzero(x[..., 1].min(axis=1) > 0.02)
    air = accelerations(x[: above[np.flatnonzero(np.diff(above, append=-1) != 1)[0]] + 1], times, weights)
    report_figure(f"swells to {swollen[1:].max():.4f} of {1 + over / ambient:.4f}; falls with {-air[:, 1].mean():.3f} m/s²; "
                  f"{speed.max():.2f} m/s at most, {speed[-6:].mean():.3f} m/s in the end")  # fmt: skip
    assert pressure["gas"] and 1.0005 < swollen[1:].min() and swollen.max() < 1 + over / ambient
    # The gas pushes on all sides alike.
    assert len(air) > 2
    np.testing.assert_allclose(air, np.tile([0, -GRAVITY, 0], (len(air), 1)), atol=0.05)
    assert x[..., 1].min() >= -ROUNDING and x[-1][:, 1].min() < 0.01
    assert speed[-6:].mean() < 0.1 * speed.max()


def test_a_smaller_overpressure_yields_more_and_a_smaller_ambient_is_faster_and_fuller(run_howto, cushion, report_figure):
    pressure = cushion.garment("cushion")["pressure"]
    ambient, over = number(pressure["ambient"]), number(pressure["overpressure"])
    firm = run_howto(CUSHION, **{f"{PRESSURE}.overpressure": 4 * over})
    # Gas limits the length of short steps alone.
    gases = [run_howto(CUSHION, **SHORT_STEPS, **{f"{PRESSURE}.ambient": outside}) for outside in (ambient / 5, ambient)]
    steps = [sum(record.get("steps", 0) for record in run.records.values()) for run in gases]
    full = [volumes(run)[6] / volumes(run)[0] for run in gases]
    report_figure(f"squashed to {squash(cushion):.2f}, at four times the pressure to {squash(firm):.2f}; a fifth of the ambient pressure "
                  f"takes {steps[0]} instead of {steps[1]} steps, and swells to {full[0]:.3f} instead of {full[1]:.3f}")  # fmt: skip
    assert squash(cushion) < squash(firm) - 0.01
    assert steps[0] < steps[1] and full[0] > full[1]


def test_a_balloon_is_taut_a_bag_is_sucked_empty_and_a_sleeve_may_be_open(
    run_howto, cushion, run_scene, howto_assets, tmp_path, report_figure
):
    balloon = run_howto(CUSHION, "0-4", **{f"{PRESSURE}.overpressure": "2 kPa"})
    bag = altered(CUSHION, tmp_path, (r"overpressure = .*\n(.*\n)*", 'overpressure = "-200 Pa"\n\n[self_repulsion]\n\n[self_collision]\n'))
    empty = Run(run_scene(str(bag), "0-12"))
    hem = "\n[[garment.pin]]\nwhere = { box = { min = [-1, 0, -1], max = [1, 0.905, 1] } }\n"
    blown = '[garment.pressure]\noverpressure = "20 Pa"\nopen = true\n'
    sleeve = altered(f"{SAMPLES}/coat.toml", tmp_path, (r"path = .*\n", hem), (r"\[garment.render_mesh\]\n(.*\n)*", blown))
    tube = Run(run_scene(str(sleeve), "1001-1005", assets=howto_assets)).positions("coat")
    full, flat = (volumes(run)[-1] / volumes(run)[0] for run in (balloon, empty))
    radii = np.hypot(tube[..., 0], tube[..., 2]).mean(axis=1)
    # Tension in a tube is pressure times radius; cotton takes 261 N/m.
    expected, found = 20 * radii[0] / 261, radii[-1] / radii[0] - 1
    report_figure(f"balloon {full:.2f} and bag {flat:.2f} of their volumes; the sleeve is wider by {100 * found:.2f} %, by its stiffness "
                  f"{100 * expected:.2f} %")  # fmt: skip
    assert full > 1.05 * volumes(cushion)[4] / volumes(cushion)[0] and flat < 0.25
    assert 0.5 * expected < found < 1.5 * expected
