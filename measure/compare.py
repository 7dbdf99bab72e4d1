"""Judges a change that must not change a byte of any result: runs short scenes with the program of an earlier commit and with
today's (`make build`), and compares SHA-256 of the caches and of every checkpoint.

    python -m measure.compare COMMIT [--integrator WORD] [CASE...]

`--integrator` runs all cases with this one; settings that it does not read get their defaults.
Today's program runs each case on 1 and 4 threads, on 2, 4 and 7 ranks, stopped at a frame and continued on other threads, and
resumes from a checkpoint that the earlier program has written. The earlier program is built once, below `target/measured`.
Checkpoints name the version of the solver: those of two versions are compared by their arrays. Ends with 1 if a byte differs.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from measure.runs import MPI, ROOT, TODAY, assets, build, measured_folder
from measure.scenes import SAMPLES, TESTS, without_tables


@dataclass
class Case:
    """A scene and the frames that are simulated; the run is stopped after `middle`."""

    scene: Path
    first: int
    middle: int
    last: int
    settings: dict = field(default_factory=dict)


CASES = {
    "hanging_sheet": Case(SAMPLES / "hanging_sheet.toml", 1001, 1003, 1006),
    "bias_cut": Case(SAMPLES / "bias_cut.toml", 0, 1, 2, {"resolution": 16}),
    "capstan": Case(SAMPLES / "capstan.toml", 0, 2, 4),
    "curtain_and_ball": Case(SAMPLES / "curtain_and_ball.toml", 0, 3, 6),
    "cushion": Case(SAMPLES / "cushion.toml", 0, 2, 4),
    "drape_sphere": Case(SAMPLES / "drape_sphere.toml", 1, 6, 12, {"resolution": 30}),
    "falling_wind": Case(SAMPLES / "falling_wind.toml", 0, 2, 5),
    "flag": Case(SAMPLES / "flag.toml", 0, 2, 5, {"resolution": 20}),
    "incline": Case(SAMPLES / "incline.toml", 0, 2, 4),
    "leaves": Case(SAMPLES / "leaves.toml", 0, 1, 3, {"rows": 2}),
    "mannequin": Case(SAMPLES / "dressed_mannequin.toml", 1001, 1002, 1004),
    "sewn_tube": Case(SAMPLES / "sewn_tube.toml", 0, 1, 3),
    "spinning_ball": Case(SAMPLES / "spinning_ball.toml", 0, 2, 5, {"resolution": 72}),
    "turntable": Case(SAMPLES / "turntable.toml", 0, 1, 3),
    "twister": Case(SAMPLES / "twister.toml", 0, 3, 6, {"resolution": 40}),
    "wardrobe": Case(SAMPLES / "wardrobe.toml", 0, 2, 4),
    "belt": Case(TESTS / "belt.toml", 0, 1, 3),
    "folded_stack": Case(TESTS / "folded_stack.toml", 0, 2, 5),
    "soft_cloth": Case(TESTS / "soft_cloth.toml", 0, 2, 5),
    "storm": Case(TESTS / "storm.toml", 0, 2, 4),
    "two_sheets": Case(TESTS / "two_sheets.toml", 0, 2, 5),
    "woman": Case(TESTS / "dressed_woman.toml", 0, 1, 2),
}


def scene_of(case):
    """The scene of a case, for both programs: earlier ones refuse the table `[check]`, which no result depends on. Both read it from
    one folder, since checkpoints name their inputs by path."""
    # As deep below a folder with the shared data as the scene itself.
    scene = measured_folder() / "scenes" / case.scene.relative_to(ROOT)
    scene.parent.mkdir(parents=True, exist_ok=True)
    scene.write_text(without_tables(case.scene.read_text(), ["check"]))
    shared = measured_folder() / "shared"
    if not shared.exists():
        shared.symlink_to(ROOT.parent / "shared")
    return scene


def run(program, case, out, last, threads=1, ranks=1, options=()):
    """Simulates a case up to a frame, in this folder."""
    command = [program, "run", scene_of(case), "--frames", f"{case.first}-{last}", "--out", out, "--threads", threads]
    command += ["--checkpoint-every", "1f", "--keep", 1000, "--progress", "none", *options]
    command += [f"--set={name}={value}" for name, value in case.settings.items()]
    if ranks > 1:
        command = ["mpirun", "-n", ranks, *command]
    done = subprocess.run(list(map(str, command)), env=os.environ | MPI, stdin=subprocess.DEVNULL, capture_output=True,
                          text=True)
    if done.returncode != 0:
        sys.exit(f"exit code {done.returncode} of {' '.join(map(str, command))}\n{done.stderr[-2000:]}")


def solver_of(out):
    """Version of the solver that made this run."""
    return json.loads((out / "fingerprint.json").read_text())["digests"]["solver"]


def array_digest(checkpoint):
    """SHA-256 of the names, types, shapes and bytes of the arrays of a checkpoint."""
    found = hashlib.sha256()

    def add(name, item):
        if isinstance(item, h5py.Dataset):
            found.update(f"{name} {item.dtype} {item.shape}\n".encode())
            found.update(item[()].tobytes())

    with h5py.File(checkpoint) as file:
        file.visititems(add)
    return found.hexdigest()


def digests(out, by_arrays):
    """SHA-256 of each cache and checkpoint, or of the arrays of each checkpoint."""
    found = sorted(path for path in out.rglob("*.*") if path.suffix in (".abc", ".h5"))
    of_file = lambda path: hashlib.sha256(path.read_bytes()).hexdigest()
    of_path = lambda path: array_digest(path) if by_arrays and path.parent.name == "checkpoints" else of_file(path)
    return {str(path.relative_to(out)): of_path(path) for path in found}


def repetitions(case, earlier, today, resumes):
    """The runs of today's program that have to give the same results as its first one: a name, a function that is called with a folder,
    and whether the run stops on its way. `resumes` are options of the runs that resume from a checkpoint of the earlier program."""
    yield "4 threads", lambda out: run(today, case, out, case.last, threads=4), False
    for ranks in (2, 4, 7):
        yield f"{ranks} ranks", lambda out: run(today, case, out, case.last, ranks=ranks), False

    def resumed(first_program, options):
        def both(out):
            run(first_program, case, out, case.middle)
            run(today, case, out, case.last, threads=3, options=options)
        return both

    yield "a stop and a resume", resumed(today, []), True
    yield "a stop of the earlier program and a resume", resumed(earlier, resumes), True


def compare(name, case, earlier, today):
    """Whether all results of a case are the same; says which are not."""
    with tempfile.TemporaryDirectory() as folder:
        before, alone = Path(folder) / "earlier", Path(folder) / "1 thread"
        run(earlier, case, before, case.last)
        run(today, case, alone, case.last)
        by_arrays = solver_of(before) != solver_of(alone)
        expected = digests(before, by_arrays)

        def judge(out, has_stopped=False):
            found = digests(out, by_arrays)
            # Checkpoints before a stop know how long the caches of the shorter range are.
            before_stop = range(case.first, case.middle if has_stopped else case.first)
            early = {f"checkpoints/frame_{frame:05}.h5" for frame in before_stop}
            files = (expected.keys() | found.keys()) - early
            differing = sorted(file for file in files if expected.get(file) != found.get(file))
            if differing:
                print(f"{name}, {out.name}: {len(differing)} of {len(expected)} files differ: {', '.join(differing[:4])}", flush=True)
            return not differing

        same = judge(alone)
        for what, make, has_stopped in repetitions(case, earlier, today, ["--resume-with-changes"] if by_arrays else []):
            out = Path(folder) / what
            make(out)
            same &= judge(out, has_stopped)
    print(f"{name}: {len(expected)} files {'the same' if same else 'NOT the same'}", flush=True)
    return same


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("commit", help="the earlier program")
    parser.add_argument("cases", nargs="*", metavar="case", help=f"all of them unless named: {', '.join(CASES)}")
    parser.add_argument("--integrator", help="integrator of all cases, in place of that of each scene")
    arguments = parser.parse_intermixed_args()
    if unknown := set(arguments.cases) - CASES.keys():
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
    earlier, today = build(arguments.commit), TODAY
    CASES["mannequin"].settings["assets"] = assets("mannequin", "--garments", "light")
    if arguments.integrator:
        for case in CASES.values():
            case.settings["solver.integrator"] = f'"{arguments.integrator}"'
        if arguments.integrator != "semi_implicit":
            CASES["incline"].settings["solver.cfl"] = 4
    results = [compare(name, CASES[name], earlier, today) for name in arguments.cases or CASES]
    print(f"{sum(results)} of {len(results)} cases have the same bytes")
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
