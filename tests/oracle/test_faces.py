"""No coarse face shows a body through it, whichever diagonal a renderer cuts quads along, as libigl judges it."""

import json
import subprocess

import igl
import igl.predicates
import numpy as np
import pytest

from body_depth import RELEASE_REACH, depths, distance_to_triangles
from conftest import program
from crossings import crossing_pairs
from judges import both_cuts, hdf5, official

BALL = 0.25

SCENE = """drapery = 1
[shot]
frames = "1-30"
[units]
length = "m"
up = "Y"
[gravity]
[ether_drag]
rate = 4.0
[self_repulsion]
[self_collision]
[[body]]
name = "ball"
file = "ball.obj"
friction = 0.6
{thickness}
[[garment]]
name = "sheet"
rest = "sheet.obj"
material = "cotton_jersey"
[output]
format = ["abc", "h5"]
{faces}
"""


def grid(count):
    """Corners of the quads of a square of `count` by `count` cells, by numbers of its points in rows."""
    rows, columns = np.mgrid[0:count, 0:count]
    first = (rows * (count + 1) + columns).ravel()
    return np.stack([first, first + 1, first + count + 2, first + count + 1], axis=1)


def write_obj(path, points, quads):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += ["f " + " ".join(str(corner + 1) for corner in quad) for quad in quads.tolist()]
    path.write_text("\n".join(lines) + "\n")


def ball(count):
    """A cube of quads blown up to a ball: points and quads, counter-clockwise seen from outside."""
    side = np.tan(np.linspace(-np.pi / 4, np.pi / 4, count + 1))
    u, v = (axis.ravel() for axis in np.meshgrid(side, side))
    points, quads = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            face = np.empty((len(u), 3))
            face[:, axis], face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = sign, u, v
            corners = grid(count) if sign > 0 else grid(count)[:, ::-1]
            quads.append(corners + sum(map(len, points)))
            points.append(face)
    points, quads = np.concatenate(points), np.concatenate(quads)
    points = BALL * points / np.linalg.norm(points, axis=1, keepdims=True)
    _, first, number = np.unique(np.round(points, 9), axis=0, return_index=True, return_inverse=True)
    return points[first], number.ravel()[quads]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Runs a sheet of quads that falls onto the ball, with these lines at the body and the output, and keeps the folder."""
    runs = {}

    def run(thickness="", faces="", frames="1-30"):
        key = (thickness, faces, frames)
        if key not in runs:
            folder = tmp_path_factory.mktemp("faces")
            write_obj(folder / "ball.obj", *ball(12))
            count = 26
            rows, columns = (axis.ravel() for axis in np.mgrid[0 : count + 1, 0 : count + 1])
            flat = 0.9 * (np.stack([columns, rows], axis=1) / count - 0.5)
            # Turned, so that no diagonal lies along a line of the ball.
            x, z = (flat @ np.array([[0.9, 0.435889894], [-0.435889894, 0.9]])).T
            points = np.stack([x, np.full_like(x, BALL + 0.02), z], axis=1)
            write_obj(folder / "sheet.obj", points, grid(count)[:, ::-1])
            (folder / "scene.toml").write_text(SCENE.format(thickness=thickness, faces=faces))
            command = [program("DRAPERY", "drapery"), "run", str(folder / "scene.toml"), "--frames", frames]
            done = subprocess.run([*command, "--out", str(folder / "out")], capture_output=True, text=True, stdin=subprocess.DEVNULL)
            assert done.returncode == 0, done.stderr[-4000:]
            runs[key] = (folder, done.stderr)
        return runs[key]

    return run


def crossing_cloth(points, cuts, vertices, body_cuts):
    """Cloth triangles of either cut that meet a triangle of either cut of a body, as their corners."""
    found = set()
    for cut in cuts:
        for body in body_cuts:
            pairs = igl.predicates.find_intersections(
                np.ascontiguousarray(points), cut, np.ascontiguousarray(vertices), body
            )[1]
            found |= {tuple(cut[face]) for face in np.unique(pairs[:, 0])} if len(pairs) else set()
    return sorted(found)


def showing(folder):
    """Numbers of cloth triangles that meet the ball and of middles of diagonals inside it, and the largest depth [m].

    The numbers are sums over all frames.
    """
    cache, (vertices, quads) = hdf5(folder / "out" / "sheet.h5"), ball(12)
    body_cuts = both_cuts(np.full(len(quads), 4), quads.ravel())
    cuts = both_cuts(cache["face_counts"], cache["face_indices"])
    crossing, inside, deepest = 0, 0, 0.0
    for points in cache["positions"].astype(float):
        crossing += len(crossing_cloth(points, cuts, vertices, body_cuts))
        quad = points[cache["face_indices"].reshape(-1, cache["face_counts"][0])]
        middles = np.concatenate([(quad[:, k] + quad[:, (k + 2) % quad.shape[1]]) / 2 for k in (0, 1)])
        deep = np.min([depths(middles, vertices, body) for body in body_cuts], axis=0)
        inside += np.count_nonzero(deep > 0)
        deepest = max(deepest, deep.max())
    return crossing, inside, deepest


def verify(folder, *more):
    command = [program("DRAPERY", "drapery"), "verify", str(folder / "out" / "sheet.abc"), "--body", str(folder / "ball.obj")]
    return subprocess.run([*command, *more], capture_output=True, text=True, stdin=subprocess.DEVNULL)


def other_diagonal(folder):
    """Lines of the record that count `other_diagonal`, by their frames."""
    lines = [json.loads(line) for line in (folder / "out" / "run.jsonl").read_text().splitlines()]
    return {line["frame"]: line for line in lines if line.get("other_diagonal")}


# The thickness of the fabric, which bodies from files had where a scene said none.
THIN = 'thickness = "0.6 mm"'


def test_what_shows_along_the_other_diagonal_is_counted_and_named(run, report_figure):
    folder, said = run(THIN)
    crossing, inside, deepest = showing(folder)
    report_figure(f"{crossing} triangles meet the ball, {inside} middles inside, {1000 * deepest:.3f} mm deep at most")
    assert inside > 20
    found = verify(folder)
    assert "sheetShape: no intersections with the body in 30 frames" in found.stdout, found.stdout
    assert "the body intersect if faces are cut along the other diagonal" in found.stdout + found.stderr
    frames = other_diagonal(folder)
    assert frames and all(line["counts"]["crossings_other_diagonal"] > 0 for line in frames.values())
    # Folds of the sheet may meet along their other diagonals too, later.
    first = frames[min(frames)]["other_diagonal"][0]
    assert (first["garment"], first["with"]) == ("sheet", {"body": "ball"})
    assert "(face " in first["first"]
    assert f'frame {min(frames)}: garment "sheet" intersects body "ball"' in said
    assert "thin_body: body \"ball\"" in said


def test_the_default_thickness_keeps_coarse_faces_from_showing_along_both_diagonals(run, report_figure):
    folder, said = run()
    crossing, inside, deepest = showing(folder)
    report_figure(f"{crossing} triangles meet the ball, {inside} middles inside; closest {-1000 * deepest:.3f} mm")
    assert (crossing, inside) == (0, 0)
    pairs = [pair for line in other_diagonal(folder).values() for pair in line["other_diagonal"]]
    assert not [pair for pair in pairs if pair["with"] == {"body": "ball"}]
    assert "thin_body" not in said
    found = verify(folder)
    assert "cut along the other diagonal" in found.stdout and "and the body intersect" not in found.stdout + found.stderr


def test_triangles_are_written_where_the_scene_asks_for_them_and_a_run_resumes_with_them(run, report_figure):
    folder, _ = run(THIN)
    quads = hdf5(folder / "out" / "sheet.h5")
    drapery = program("DRAPERY", "drapery")

    def done(*command):
        ended = subprocess.run([drapery, *map(str, command)], capture_output=True, text=True, stdin=subprocess.DEVNULL)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout + ended.stderr

    out = folder / "resumed"
    done("run", folder / "scene.toml", "--frames", "1-4", "--out", out)
    said = done("run", folder / "scene.toml", "--frames", "1-8", "--out", out, "--set", 'output.faces="triangles"')
    assert "resuming after frame 4" in said, said
    cut, archive = hdf5(out / "sheet.h5"), official(out / "sheet.abc")
    np.testing.assert_array_equal(cut["positions"], quads["positions"][:8])
    for faces in (cut["face_indices"].reshape(-1, 3), archive["face_indices"].reshape(-1, 3)[:, ::-1]):
        np.testing.assert_array_equal(faces, quads["triangles"])
    np.testing.assert_array_equal(cut["triangles"], quads["triangles"])
    assert "garments as simulated triangles" in done(
        "plan", folder / "scene.toml", "--set", 'output.faces="triangles"'
    )
    # And of a cache that is there.
    done("convert", folder / "out" / "sheet.abc", folder / "converted.abc", "--triangles")
    converted = official(folder / "converted.abc")
    np.testing.assert_array_equal(converted["face_indices"].reshape(-1, 3)[:, ::-1], quads["triangles"])
    np.testing.assert_array_equal(converted["positions"], quads["positions"])


def meeting(points, cuts):
    """Pairs of triangles of any two cuts of a cloth that meet without a common point."""
    found = 0
    for one in cuts:
        for other in cuts:
            pairs = igl.predicates.find_intersections(points, one, points, other)[1]
            corners = np.concatenate([one[pairs[:, 0]], other[pairs[:, 1]]], axis=1) if len(pairs) else np.empty((0, 6))
            found += sum(len(set(row)) == 6 for row in corners.tolist())
    return found


def test_the_faces_of_the_demo_cross_neither_each_other_nor_the_body_along_either_diagonal(
    run_scene, mannequin, report_figure
):
    out = run_scene("sample_assets/scenes/dressed_mannequin.toml", "1001-1005", assets=mannequin)
    body = official(mannequin / "body.abc")
    body_cuts = both_cuts(body["face_counts"], body["face_indices"])
    caches = [hdf5(path) for path in sorted(out.glob("*.h5"))]
    starts = np.cumsum([0, *(cache["positions"].shape[1] for cache in caches)])
    cuts = [np.concatenate(parts) for parts in zip(*(
        [cut + start for cut in both_cuts(cache["face_counts"], cache["face_indices"])]
        for cache, start in zip(caches, starts)
    ))]
    cloth, elsewhere, pinched = 0, 0, 0
    for index, time in enumerate(caches[0]["times"]):
        points = np.concatenate([cache["positions"][index] for cache in caches]).astype(float)
        vertices = np.ascontiguousarray(body["world_positions"][np.argmin(abs(body["times"] - time))], float)
        cloth += meeting(points, cuts)
        crossing = np.array(crossing_cloth(points, cuts, vertices, body_cuts), np.int64).reshape(-1, 3)
        itself = np.unique(crossing_pairs(vertices, body_cuts[0])).astype(np.int64)
        reach = distance_to_triangles(points[crossing].reshape(-1, 3), vertices, body_cuts[0][itself])
        near = reach.reshape(-1, 3).min(axis=1, initial=np.inf) < RELEASE_REACH
        pinched, elsewhere = pinched + np.count_nonzero(near), elsewhere + np.count_nonzero(~near)
    report_figure(f"{cloth} pairs of cloth, {elsewhere} triangles through the body, {pinched} where it crosses itself")
    assert (cloth, elsewhere) == (0, 0)
