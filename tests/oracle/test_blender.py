"""Blender shows at every frame what Drapery wrote."""

import numpy as np
import pytest

from judges import blender, hdf5, official, z_up

FPS = 24


@pytest.fixture(scope="module")
def garments(dressed):
    """Triples (Blender's answer, official reader's answer, HDF5 cache) of the garments of the dressed mannequin."""
    found = []
    for path in sorted(dressed.glob("*.abc")):
        cache = hdf5(path.with_suffix(".h5"))
        found.append((blender(path, FPS, cache["frame_numbers"]), official(path), cache))
    assert found
    return found


def test_every_frame_has_the_positions_and_velocities_of_the_cache(garments):
    for shown, _, cache in garments:
        # Blender turns the axes, which is exact; a parent's matrix, if any, costs a rounding of f32 at 1 m.
        np.testing.assert_allclose(shown["positions"], z_up(cache["positions"]), atol=5e-7)
        np.testing.assert_array_equal(shown["velocities"], z_up(cache["velocities"]))


def test_frame_range_is_that_of_the_run(garments):
    for shown, _, cache in garments:
        assert list(shown["frame_range"]) == [cache["frame_numbers"][0], cache["frame_numbers"][-1]]


def test_every_corner_has_its_uv(garments):
    for shown, archive, _ in garments:
        np.testing.assert_array_equal(shown["face_starts"], np.cumsum(archive["face_counts"]) - archive["face_counts"])
        face = np.repeat(np.arange(len(archive["face_counts"])), archive["face_counts"])
        in_file = np.lexsort((archive["face_indices"], face))
        in_blender = np.lexsort((shown["corner_vertices"], face))
        np.testing.assert_array_equal(shown["corner_vertices"][in_blender], archive["face_indices"][in_file])
        np.testing.assert_allclose(shown["uvs"][in_blender], archive["uvs"][in_file], atol=1e-7)


def test_face_sets_become_material_slots(garments):
    for shown, archive, _ in garments:
        names = list(archive["face_set_names"])
        assert sorted(shown["materials"]) == names
        for index, name in enumerate(names):
            slot = list(shown["materials"]).index(name)
            faces = np.flatnonzero(shown["material_of_face"] == slot)
            np.testing.assert_array_equal(faces, np.sort(archive[f"face_set_{index}"]))
