"""No cloth vertex goes deeper into the body than its thickness, except where the body crosses itself."""

import json
import re
import tomllib

import igl
import numpy as np
import pytest

from body_depth import RELEASE_REACH, crossing_triangles, depths, distance_to_triangles, simulated_surface
from judges import hdf5, official, triangles


def body_thickness(out):
    """Thickness of the one body of a run [m]."""
    resolved = tomllib.loads((out / "resolved.toml").read_text())
    (body,) = resolved["body"]
    number, unit = re.fullmatch(r"([0-9.e+-]+)\s*(m|mm|cm|)", str(body["thickness"])).groups()
    return float(number) * {"m": 1.0, "": 1.0, "cm": 0.01, "mm": 0.001}[unit]


def assert_cloth_stays_outside(out, body_path, report_figure):
    body = official(body_path)
    faces = simulated_surface(body)
    thickness = body_thickness(out)
    caches = {path.stem: hdf5(path) for path in sorted(out.glob("*.h5"))}
    assert caches
    worst, worst_at, released, crossing_frames = -np.inf, "", 0, 0
    for index, time in enumerate(next(iter(caches.values()))["times"]):
        sample = int(np.argmin(abs(body["times"] - time)))
        assert abs(body["times"][sample] - time) < 1e-6, f"the body has no sample at {time} s"
        vertices = body["world_positions"][sample]
        crossing = sorted({face for pair in crossing_triangles(vertices, faces) for face in pair})
        crossing_frames += bool(crossing)
        for garment, cache in caches.items():
            points = cache["world_positions"][index]
            depth = depths(points, vertices, faces)
            excused = distance_to_triangles(points, vertices, faces[crossing]) < RELEASE_REACH
            released += np.count_nonzero(excused & (depth > thickness))
            depth[excused] = -np.inf
            if depth.max() > worst:
                worst = depth.max()
                worst_at = f"{garment}, frame {cache['frame_numbers'][index]}, vertex {depth.argmax()}"
    report_figure(
        f"deepest vertex {1000 * worst:.3f} mm ({worst_at}), thickness {1000 * thickness:.3f} mm; in all frames "
        f"{released} vertices deeper within {1000 * RELEASE_REACH:.0f} mm of a self-crossing of the body, "
        f"which there is in {crossing_frames} of {index + 1} frames"
    )
    # Positions are stored in f32.
    assert worst <= thickness + 1e-6, worst_at


def test_the_judge_finds_the_known_crossings_of_a_body(shared_data):
    body = official(shared_data / "woman_walk_dance" / "body.abc")
    known = json.loads((shared_data / "woman_walk_dance" / "body_stats.json").read_text())
    faces = triangles(body["face_counts"], body["face_indices"])
    for frame in (0, 48, 60):
        found = crossing_triangles(body["positions"][frame].astype(float), faces)
        expected = known["self_intersecting_face_pairs"][frame]
        # Quads may be cut along the other diagonal than in the reference count.
        assert abs(len(found) - expected) <= 0.1 * expected, f"frame {frame}: {len(found)} pairs, {expected} known"


def test_the_judge_measures_the_depth_in_a_box():
    vertices, faces = igl.bounding_box(np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]]))
    points = np.array([[0.5, 0.9, 0.5], [0.5, 1.2, 0.5], [0.02, 0.5, 0.5]])
    volume = np.einsum("ij,ij->i", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]])).sum()
    outward = faces if volume > 0 else faces[:, ::-1]
    np.testing.assert_allclose(depths(points, vertices, outward), [0.1, -0.2, 0.02], atol=1e-12)


@pytest.mark.full
def test_the_mannequins_fine_garments_stay_outside_it(run_scene, make_mannequin, report_figure):
    assets = make_mannequin("full")
    out = run_scene("sample_assets/scenes/dressed_mannequin.toml", "1001-1097", assets=assets)
    assert_cloth_stays_outside(out, assets / "body.abc", report_figure)


@pytest.mark.full
def test_the_real_characters_fine_garments_stay_outside_it(run_scene, shared_data, report_figure):
    out = run_scene("tests/scenes/dressed_woman.toml", "0-96", quality="")
    assert_cloth_stays_outside(out, shared_data / "woman_walk_dance" / "body.abc", report_figure)
