"""How long a release build takes: from nothing, and after a change in one file of each crate of a checkout.

All is built in a folder of its own, which is removed again; the checkout is not touched but for the time of the file that counts as
changed. A crate is compiled as a whole, so that one file stands for all of its rooms. Seconds by the clock are only of use on a
machine that does nothing else.
"""

import atexit
import os
import shutil
import tempfile
from functools import cache
from pathlib import Path

from measure.page import Table
from measure.runs import OPTIONS, Failed, timed

# Files in which little happens, so that what is measured is what cargo builds again because of them; the first that is there.
LEAVES = {
    "core": ["core/src/contact/repulsion/mod.rs", "core/src/contact/repulsion.rs"],
    "writer": ["io/src/formats/hdf5.rs", "io/src/formats/hdf5/mod.rs"],
    "shot": ["shot/src/run/frame_loop.rs", "io/src/shot/run.rs"],
    "chart": ["analysis/src/page/plot.rs", "io/src/page/plot.rs"],
    "cli": ["cli/src/say.rs"],
}


def build():
    """Builds the command; seconds by the clock and of all cores."""
    words = ["env", f"CARGO_TARGET_DIR={target()}", "cargo", "build", "--release", "--quiet", "--package", "drapery"]
    done, cpu, wall = timed(words, cwd=OPTIONS.checkout)
    if done.returncode != 0:
        raise Failed(done.stderr)
    return [f"{wall:.1f} s", f"{cpu:.1f} s"]


@cache
def target():
    folder = tempfile.mkdtemp()
    atexit.register(shutil.rmtree, folder)
    return folder


@cache
def from_nothing():
    return build()


def after(files):
    def measure():
        from_nothing()
        found = [Path(OPTIONS.checkout) / file for file in files if (Path(OPTIONS.checkout) / file).is_file()]
        if not found:
            raise Failed(f"none of {', '.join(files)} is in {OPTIONS.checkout}")
        os.utime(found[0])
        return build()

    return measure


TABLES = [Table("", "builds", ["clock", "cores"], {
    "nothing": ("from nothing", from_nothing),
    **{name: (f"after a change in {files[0]}", after(files)) for name, files in LEAVES.items()},
})]
