"""Effects that a scene does not ask for cost nothing: builds without the optional effects, and callgrind as the judge.

`DRAPERY_MICRO_SCENE` names an example of the ordinary build; `make test` sets it. Comparisons with builds without the optional
effects are part of `make test-full`; `DRAPERY_BARE` names the folder of `tests/build-bare.sh`.
"""

import os
import re
import subprocess
from pathlib import Path

import pytest
from conftest import program
from judges import ROOT

BARE = Path(os.environ.get("DRAPERY_BARE", ROOT / "target" / "bare"))

# Sheets on a ball, with effects that every build has.
SCENE = """drapery = 1
[shot]
name = "plain"
frames = "1-12"
[gravity]
[self_repulsion]
[self_collision]
[[body]]
name = "ball"
shape = { sphere = { radius = 0.2 } }
position = [0.5, -0.22, 0.5]
friction = 0.3
[[garment]]
name = "sheet"
panel = { resolution = 12 }
density = "0.15 kg/m²"
[garment.stretch]
stiffness = "100 N/m"
[[garment.pin]]
corners = ["i0j0"]
"""

# Not together with a membrane.
STRETCH = '[garment.stretch]\nstiffness = "100 N/m"\n'

# What asks for each effect, as the reference page shows it.
PAGE = (ROOT / "docs" / "reference" / "effects.md").read_text()
ASKING = dict(re.findall(r"^## (\w+)$.*?^```toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL))

# What goes with an effect when it is left out, because it was only there for it or it has no meaning without.
TOGETHER = {"plastic_wrinkles": "plastic_wrinkles,dihedral_bending"}

# Instructions may differ by so much, because compilers lay out other programs otherwise.
LIMIT = 0.001


def bare(name):
    path = BARE / name
    if not path.is_file():
        pytest.exit(f"{path} does not exist; build it with `make bare`", returncode=2)
    return str(path)


def optional_effects():
    """Effects that only builds with the feature `effects` have."""
    found = re.findall(r'^    (\w+) if "effects",$', (ROOT / "core" / "src" / "effects" / "mod.rs").read_text(), re.MULTILINE)
    assert "bending" in found and "gravity" not in found, found
    return found


def features(drapery):
    long = subprocess.run([drapery, "--version"], capture_output=True, text=True, check=True)
    return re.search(r"^features:(.*)$", long.stdout, re.MULTILINE).group(1).split()


def run(drapery, folder, name, text, *flags):
    scene = folder / f"{name}.toml"
    scene.write_text(text)
    command = [drapery, "run", str(scene), "--out", str(folder / name), "--threads", "2", "-q", *flags]
    return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL), folder / name / "sheet.abc"


def cache(*arguments):
    done, path = run(*arguments)
    assert done.returncode == 0, done.stderr
    return path.read_bytes()


def test_absent_and_excluded_effects_give_the_same_bytes(tmp_path):
    drapery = program("DRAPERY", "drapery")
    for effect in optional_effects():
        assert effect in ASKING, f"the reference page has no example of {effect}"
        base = SCENE.replace(STRETCH, "") if effect == "membrane" else SCENE
        absent = cache(drapery, tmp_path, f"{effect}_absent", base)
        text = base + ASKING[effect]
        assert cache(drapery, tmp_path, f"{effect}_on", text) != absent, f"{effect} does nothing"
        assert cache(drapery, tmp_path, f"{effect}_out", text, "--without", TOGETHER.get(effect, effect)) == absent, effect


@pytest.mark.full
def test_effects_that_are_compiled_out_give_the_bytes_of_absent_ones_or_are_refused_by_name(tmp_path):
    drapery, without = program("DRAPERY", "drapery"), bare("drapery")
    assert cache(without, tmp_path, "compiled_out", SCENE) == cache(drapery, tmp_path, "plain", SCENE)
    for effect in optional_effects():
        refused, _ = run(without, tmp_path, f"{effect}_lacking", SCENE + ASKING[effect])
        assert refused.returncode not in (0, 70), refused.stderr
        assert "--features effects" in refused.stderr and f"built without the effect `{effect}`" in refused.stderr, refused.stderr


@pytest.mark.full
def test_the_bare_build_has_no_effect_that_can_be_left_out():
    assert "effects" in features(program("DRAPERY", "drapery"))
    assert "effects" not in features(bare("drapery"))


def callgrind(micro_scene, folder):
    record = folder / f"{Path(micro_scene).name}.out"
    command = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={record}", micro_scene]
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    instructions = int(re.search(r"Collected : (\d+)", done.stderr).group(1))
    return instructions, done.stdout, record.read_text()


def allocations(record):
    """Calls of the allocator in a record of callgrind, where names stand once and are numbers afterwards."""
    names = dict(re.findall(r"fn=\((\d+)\) (\S+)", record))
    calls = re.findall(r"^cfn=\((\d+)\).*\ncalls=(\d+)", record, re.MULTILINE)
    allocators = ("malloc", "calloc", "realloc", "posix_memalign", "aligned_alloc")
    return sum(int(count) for number, count in calls if names[number].split("'")[0] in allocators)


def test_no_function_of_an_absent_effect_is_called(tmp_path):
    micro_scene = program("DRAPERY_MICRO_SCENE", "examples/micro_scene")
    _, said, functions = callgrind(micro_scene, tmp_path)
    assert "100 steps" in said
    # The probe sees functions of an effect that runs.
    assert "drapery_core::effects::gravity" in functions
    for effect in optional_effects():
        assert f"drapery_core::effects::{effect}" not in functions, effect


@pytest.mark.full
def test_a_build_with_all_effects_runs_the_instructions_of_one_without(tmp_path, report_figure):
    everything, said, functions = callgrind(bare("micro_scene_all"), tmp_path)
    nothing, said_by_bare, bare_functions = callgrind(bare("micro_scene_none"), tmp_path)
    apart = abs(everything - nothing) / nothing
    report_figure(f"{everything} instructions with all effects in the build, {nothing} without: {100 * apart:.4f} % apart")
    assert "100 steps" in said and said == said_by_bare
    assert apart < LIMIT
    # The same build takes one more or fewer from run to run, as its threads happen to wake; one a step would be a hundred.
    assert abs(allocations(functions) - allocations(bare_functions)) <= 2 < allocations(functions)
