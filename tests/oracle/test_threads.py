"""The number of threads does not change a bit of the caches."""

import pytest

CASES = {
    "hanging_sheet": ("sample_assets/scenes/hanging_sheet.toml", "1001-1004", 60),
    "drape_sphere": ("sample_assets/scenes/drape_sphere.toml", "1-24", 40),
}


def contents(out):
    found = {path.name: path.read_bytes() for path in sorted(out.iterdir()) if path.suffix in (".abc", ".h5")}
    assert found, f"no caches in {out}"
    return found


def assert_same_files(first, second, threads):
    assert first.keys() == second.keys()
    for name in first:
        assert first[name] == second[name], f"{name} differs with {threads} threads"


@pytest.mark.parametrize("case", CASES)
def test_caches_are_the_same_bytes_with_1_2_3_and_7_threads(case, run_scene):
    scene, frames, resolution = CASES[case]
    alone = contents(run_scene(scene, frames, threads=1, resolution=resolution))
    for threads in (2, 3, 7):
        assert_same_files(alone, contents(run_scene(scene, frames, threads=threads, resolution=resolution)), threads)


def test_the_dressed_mannequin_is_the_same_bytes_with_1_2_3_and_7_threads(run_scene, mannequin):
    scene = "sample_assets/scenes/dressed_mannequin.toml"
    alone = contents(run_scene(scene, "1001-1006", threads=1, assets=mannequin))
    for threads in (2, 3, 7):
        assert_same_files(alone, contents(run_scene(scene, "1001-1006", threads=threads, assets=mannequin)), threads)
