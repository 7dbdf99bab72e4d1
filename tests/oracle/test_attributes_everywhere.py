"""Attributes of caches where a run is not the plain one: on several ranks, stopped and resumed, with samples between frames, and of a
render mesh, which has those of the cloth below it."""

import numpy as np
import pytest

from farm import Shot
from judges import ask, official
from test_attributes import ALL, CENTIMETRE, N, RADIUS, SCENE, SPACING, bytes_of, expected_normals, expected_strain, grid, held
from test_mpi_runs import Ranks
from test_mpi_runs import pytestmark as needs_mpi

SUB_FRAMES = 'samples = 3\nshutter = [-0.25, 0.25]'
MAPS = '[garment.maps]\nthickness = "file:wear.txt"\n'
RENDER_MESH = '[garment.render_mesh]\nfile = "fine.obj"\nunits = { length = "m", up = "Y" }\n'
# Points of the render mesh in a row, and its height above the cloth [m].
FINE, ABOVE = 11, 0.001
SIDE = (N - 1) * SPACING


def fine():
    """A grid over the cloth that shares no points with it."""
    side = np.linspace(-SIDE / 2 + 0.011, SIDE / 2 - 0.013, FINE)
    points = "".join(f"v {x:.6f} {RADIUS + 0.01 + ABOVE:.6f} {z:.6f}\n" for z in side for x in side)
    corners = [(row * FINE + column + 1, (row + 1) * FINE + column + 1) for row in range(FINE - 1) for column in range(FINE - 1)]
    return points + "".join(f"f {a} {b} {b + 1} {a + 1}\n" for a, b in corners)


def scene(folder):
    folder.mkdir(exist_ok=True)
    # Thicker at one side, so that thickness differs from point to point.
    (folder / "lower.obj").write_text(grid(RADIUS + 0.01))
    (folder / "upper.obj").write_text(grid(RADIUS + 0.0165))
    (folder / "fine.obj").write_text(fine())
    weights = "\n".join(f"{1 + 0.01 * (point % N):.3f}" for point in range(N * N))
    (folder / "wear.txt").write_text(weights + "\n")
    words = ", ".join(f'"{word}"' for word in ALL)
    text = SCENE.format(formats='["abc", "h5", "usd"]', attributes=f"attributes = [{words}]\n{SUB_FRAMES}", radius=RADIUS)
    head, upper = text.split('[[garment]]\nname = "upper"')
    (folder / "scene.toml").write_text(f'{head}{MAPS}{RENDER_MESH}[[garment]]\nname = "upper"{upper}')
    return Shot(folder / "scene.toml", "1001-1004")


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("attributes_everywhere")
    scene(folder).run(folder / "out")
    return folder / "out"


def test_a_run_that_is_stopped_within_a_frame_leaves_the_same_bytes(shot, tmp_path):
    again, out = scene(tmp_path), tmp_path / "out"
    again.run(out, "--checkpoint-every", "1f", last=1002, threads=1)
    again.run(out, "--checkpoint-every", "1f", last=1003)
    again.run(out)
    assert bytes_of(out) == bytes_of(shot)


@needs_mpi[0]
@needs_mpi[1]
@pytest.mark.parametrize("ranks", [3])
def test_several_ranks_write_the_bytes_of_one(shot, tmp_path, ranks):
    again = Ranks(scene(tmp_path), ranks)
    again.run(tmp_path / "out", "--checkpoint-every", "1f", last=1002)
    again.run(tmp_path / "out")
    assert bytes_of(tmp_path / "out") == bytes_of(shot)


def samples(path):
    """Values at the samples of an archive, and whether each is that of a whole frame."""
    seen, times = ask("point_attributes.py", path), official(path)["times"] * 24
    return seen, official(path)["positions"], np.isclose(times, np.round(times), atol=1e-4)


def test_samples_between_frames_have_values_of_their_own(shot):
    cache = held(shot / "lower.h5")
    seen, positions, whole = samples(shot / "lower.abc")
    assert whole.sum() == 4 and len(whole) == 10
    for name in ("normals", "strain", "contact"):
        assert np.array_equal(np.array(seen[name], np.float32)[whole], cache[name]), name
    for sample, points in enumerate(positions.astype(float) * CENTIMETRE):
        assert np.allclose(seen["strain"][sample], expected_strain(cache, points), rtol=0, atol=1e-5)
        assert np.allclose(seen["normals"][sample], expected_normals(cache, points), rtol=0, atol=1e-5)
    # In the first quarter of a frame both garments fall freely, and keep their distance.
    contact = np.array(seen["contact"])
    assert np.allclose(contact[1], contact[0], rtol=0, atol=1e-5) and contact.min() >= 0 and contact.max() <= 1
    assert all(np.abs(contact[k] - contact[k - 1]).max() > 0.1 for k in np.flatnonzero(~whole)[1:])


def below(points, corners, triangles):
    """The triangle below each point of a flat sheet, and shares of its corners there (the axis z is up)."""
    found = []
    for point in points[:, :2]:
        for triangle in triangles:
            a, b, c = corners[triangle, :2]
            shares = np.linalg.solve(np.array([b - a, c - a]).T, point - a)
            if (shares >= -1e-6).all() and shares.sum() <= 1 + 1e-6:
                found.append((triangle, np.array([1 - shares.sum(), *shares])))
                break
    assert len(found) == len(points)
    return np.array([triangle for triangle, _ in found]), np.array([shares for _, shares in found])


@pytest.mark.parametrize("ending", ["h5", "abc", "usd"])
def test_a_render_mesh_has_the_values_of_the_cloth_below_it(shot, ending):
    cloth, mesh = held(shot / "lower.h5"), held(shot / "lower_render.h5")
    seen = mesh if ending == "h5" else ask("point_attributes.py", shot / f"lower_render.{ending}")
    if ending != "h5":
        _, _, whole = samples(shot / "lower.abc")
        of_frames = whole if ending == "abc" else slice(None)
        seen = {name: np.array(seen[name], np.float32)[of_frames] if name in ("strain", "contact", "normals") else seen[name]
                for name in ALL}  # fmt: skip
    triangles, shares = below(mesh["rest"].astype(float), cloth["rest"].astype(float), cloth["triangles"])
    blended = lambda values: (values[triangles] * shares).sum(axis=1)
    for frame in range(4):
        for name in ("strain", "contact"):
            assert np.allclose(seen[name][frame], blended(cloth[name][frame].astype(float)), rtol=0, atol=1e-5), name
        assert np.allclose(seen["normals"][frame], expected_normals(mesh, mesh["metres"][frame]), rtol=0, atol=1e-5)
    assert np.allclose(seen["thickness"], blended(cloth["thickness"].astype(float)), rtol=1e-5)
    # 4 mm in centimetres, times the map.
    assert np.allclose(cloth["thickness"], 0.4 * (1 + 0.01 * (np.arange(N * N) % N)), rtol=1e-5, atol=0)
    assert cloth["contact"].max() > 0.5 and np.ptp(seen["strain"][3]) > 1e-4
    height = (RADIUS + 0.01 + ABOVE) / CENTIMETRE
    assert np.allclose(seen["rest"][:, 2], height, rtol=0, atol=1e-4) and np.allclose(mesh["rest"], seen["rest"])
