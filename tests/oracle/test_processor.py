"""A shot has the same bytes on a processor for which the system's mathematical library takes other functions.

glibc chooses its versions of sin, exp, pow and others by the processor. A variable of the environment makes it choose as on an older one,
without fused multiply-add; Python's own functions show that it does.
"""

import hashlib
import os
import subprocess
import sys

import pytest

from farm import DRAPERY

OLDER = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}

# Shapes and rotations by angles, a body that spins, a fabric with a curve in tension, grain at an angle and collisions.
SCENE = """
drapery = 1
[shot]
name = "processor"
frames = "0-6"
[gravity]
[self_repulsion]
[self_collision]
[wind]
velocity = [3, 0, 1]
density = 1.2
normal = 1.0
[[body]]
name = "drum"
shape = { cylinder = { radius = 0.1, half_length = 0.2 } }
position = [0, 0.3, 0]
rotation = { axis = [1, 0, 0.3], degrees = 80 }
spin = { angular_velocity = [0, 2, 1] }
[[garment]]
name = "tube"
tube = { resolution = 24, radius = 0.13, length = 0.3, center = [0, 0.32, 0], rotation = { axis = [1, 0, 0.3], degrees = 80 } }
material = "cotton_jersey"
[[garment]]
name = "disc"
disc = { resolution = 10, radius = 0.15, center = [0, 0.5, 0.05] }
density = "150 g/m²"
[garment.membrane]
warp = "80 N/m"
weft = "60 N/m"
shear = "30 N/m"
grain_angle = 0.4
[garment.dihedral_bending]
stiffness = "2 µN·m"
"""

SINES = "import math; print([math.sin(0.001 * k) for k in range(3000)], [math.exp(0.001 * k) for k in range(3000)])"


def outcome(command, environment, **options):
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("integrator", ["semi_implicit", "tr_bdf2"])
def test_a_run_has_the_same_bytes_where_the_mathematical_library_takes_other_functions(tmp_path, integrator):
    if outcome([sys.executable, "-c", SINES], {}) == outcome([sys.executable, "-c", SINES], OLDER):
        pytest.skip("the mathematical library of this system has one version of its functions")
    (tmp_path / "scene.toml").write_text(SCENE)
    digests = []
    for number, environment in enumerate([{}, OLDER]):
        out = tmp_path / f"out{number}"
        outcome([DRAPERY, "run", "scene.toml", "--out", out, "--set", f"solver.integrator={integrator}"], environment, cwd=tmp_path)
        digests.append([hashlib.sha256((out / f"{name}.h5").read_bytes()).hexdigest() for name in ["tube", "disc"]])
    assert digests[0] == digests[1]
