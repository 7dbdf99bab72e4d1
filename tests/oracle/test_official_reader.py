"""The official Alembic library reads from a cache what Drapery promises in it."""

import numpy as np
import pytest

from judges import hdf5, official

FPS = 24
CASES = {
    "hanging_sheet": ("sample_assets/scenes/hanging_sheet.toml", "1001-1012"),
    "drape_sphere": ("sample_assets/scenes/drape_sphere.toml", "1-24"),
}


@pytest.fixture(params=[*CASES, "dressed_mannequin"])
def caches(request, run_scene):
    """Pairs (official reader's answer, HDF5 cache) of every garment of a run."""
    if request.param in CASES:
        out = run_scene(*CASES[request.param], resolution=12)
    else:
        out = request.getfixturevalue("dressed")
    archives = sorted(out.glob("*.abc"))
    assert archives, f"no .abc in {out}"
    return [(official(path), hdf5(path.with_suffix(".h5"))) for path in archives]


def test_times_are_frame_over_fps_and_nothing_is_stored_before_the_first_frame(caches):
    for archive, cache in caches:
        assert archive["uniform"]
        assert len(archive["times"]) == len(cache["frame_numbers"])
        # Uniform sampling is a start and a period in f64: rounding only.
        np.testing.assert_allclose(archive["times"], cache["frame_numbers"] / FPS, rtol=1e-14)
        np.testing.assert_allclose(cache["times"], cache["frame_numbers"] / FPS, rtol=1e-14)


def test_the_archive_names_its_writer_and_its_rate_and_has_neither_a_date_nor_normals(caches):
    for archive, _ in caches:
        assert str(archive["Application"]).startswith("Drapery ")
        assert float(str(archive["DCC_FPS"])) == FPS
        assert str(archive["Description"]).startswith("garment ")
        # Equal runs have equal bytes; importers shade a mesh without normals smoothly.
        assert str(archive["DateWritten"]) == ""
        assert not archive["has_normals"]


def test_topology_is_homogeneous_and_positions_are_those_of_the_hdf5_cache(caches):
    for archive, cache in caches:
        assert archive["homogeneous"]
        np.testing.assert_array_equal(archive["positions"], cache["positions"])
        np.testing.assert_array_equal(archive["face_counts"], cache["face_counts"])
        # HDF5 turns counter-clockwise seen from outside, Alembic clockwise.
        corners = np.split(archive["face_indices"], np.cumsum(archive["face_counts"])[:-1])
        np.testing.assert_array_equal(np.concatenate([face[::-1] for face in corners]), cache["face_indices"])
        assert np.isfinite(archive["positions"]).all()


def test_every_sample_has_velocities_in_units_per_second(caches):
    for archive, cache in caches:
        np.testing.assert_array_equal(archive["velocities"], cache["velocities"])
        assert archive["velocities"].shape == archive["positions"].shape
        x, v = archive["positions"].astype(float), archive["velocities"].astype(float)
        differences = (x[2:] - x[:-2]) * (0.5 * FPS)
        # Cloth accelerates within a frame, so the two agree only roughly; per frame instead of per second, or the
        # velocities of another frame or vertex, would be far off.
        assert np.linalg.norm(differences - v[1:-1]) < 0.35 * np.linalg.norm(v[1:-1])


def test_bounds_are_those_of_each_sample(caches):
    for archive, _ in caches:
        x = archive["positions"].astype(float)
        expected = np.stack([x.min(axis=1), x.max(axis=1)], axis=1)
        np.testing.assert_array_equal(archive["self_bounds"], expected)
        # No garment of these scenes has a moving parent.
        np.testing.assert_allclose(archive["archive_bounds"], expected, atol=1e-6)


def test_path_uvs_and_face_sets_are_those_of_the_garment_file(dressed, mannequin):
    archives = sorted(dressed.glob("*.abc"))
    assert archives
    for path in archives:
        given = official(mannequin / path.name)
        written = official(path)
        assert written["path"] == given["path"]
        for name in ("face_counts", "face_indices", "uvs", "uv_scope", "face_set_names"):
            np.testing.assert_array_equal(written[name], given[name], err_msg=f"{path.name}: {name}")
        for index in range(len(given["face_set_names"])):
            np.testing.assert_array_equal(written[f"face_set_{index}"], given[f"face_set_{index}"])
        assert given["uvs"].shape == (len(given["face_indices"]), 2), "the garment file has no UVs to keep"
        assert len(given["face_set_names"]) > 0, "the garment file has no face sets to keep"
