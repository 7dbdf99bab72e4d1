"""The command compiles for systems of which no package is made."""

import subprocess
from pathlib import Path

import pytest

from judges import ROOT

pytestmark = pytest.mark.full


@pytest.mark.parametrize("target", ["x86_64-pc-windows-gnu", "x86_64-apple-darwin", "aarch64-apple-darwin"])
def test_the_command_compiles_with_usd(target):
    rust = subprocess.run(["rustc", "--print", "sysroot"], capture_output=True, text=True, check=True).stdout.strip()
    if not (Path(rust) / "lib" / "rustlib" / target).is_dir():
        pytest.skip(f"no standard library of {target}: rustup target add {target}")
    command = ["cargo", "check", "--quiet", "--release", "--locked", "--package", "drapery", "--features", "usd", "--ignore-rust-version",
               "--target", target]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-6000:]
