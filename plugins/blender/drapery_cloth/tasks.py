"""Work in the background for a scene: generators that yield each process they wait for. `work.Work` resumes them."""

import json
import os
import shutil
import sys
import tempfile
from pathlib import Path

import bpy

from . import answers, settings, state
from .answers import Failed, Problem
from .collect import FINAL, PREVIEW, Collected, run_folder, scene_folder
from .process import NoSolver, Process, Simulation, find_solver
from .scene_text import SCENE_FILE, plain_name


def text_of(path):
    try:
        return Path(path).read_text("utf-8", "replace")
    except OSError:
        return ""


def last_log(folder):
    """The log of the last attempt of a run; each says again what earlier ones warned of."""
    logs = [path for path in (folder / "logs").glob("*.jsonl") if path.stem.isdigit()]
    return text_of(max(logs, key=lambda path: int(path.stem))) if logs else ""


def solver_of(context):
    preferences = settings.preferences(context)
    return find_solver(bpy.path.abspath(preferences.executable) if preferences and preferences.executable else "")


def exporting_line(copy, job):
    """The command line that exports: this Blender once more, or the one of the preferences."""
    script = str(Path(__file__).with_name("export_meshes.py"))
    preferences = settings.preferences(bpy.context)
    blender = (preferences and bpy.path.abspath(preferences.exporter)) or bpy.app.binary_path
    if not (preferences and preferences.exporter) and not bpy.app.build_options.alembic:
        raise Failed(Problem("This Blender was built without Alembic, as Debian's is, and cannot write meshes",
                             "install Blender from blender.org, or choose one under Blender for Export in the preferences"))
    if not blender:
        # Blender as a Python module.
        return [sys.executable, script, "--", job, copy]
    if not os.access(blender, os.X_OK):
        raise Failed(Problem(f"{blender} is not a program", "choose another Blender for Export in the preferences"))
    # Drivers have to run as they do here: unless scripts of this file were blocked, what it evaluates to depends on them.
    trust = "--disable-autoexec" if bpy.app.autoexec_fail else "--enable-autoexec"
    return [blender, "--background", trust, copy, "--python-exit-code", "1", "--python", script, "--", job]


def write(scene, view, kind=FINAL):
    """Writes the scene folder, or that of its preview. Raises `Failed`."""
    view.doing = "Writing meshes"
    collected = Collected(scene, kind)
    if collected.problems:
        raise Failed(*collected.problems)
    folder = collected.folder
    folder.mkdir(parents=True, exist_ok=True)
    # A folder that cannot be written is found out before anything else.
    tempfile.TemporaryFile(dir=folder).close()
    # Not below the scene folder: the archives hold a path of that length, and would change with the place of the folder.
    between = Path(tempfile.mkdtemp(prefix="drapery_"))
    exporting = None
    try:
        job, answer, copy = between / "job.json", between / "answer.json", between / "copy.blend"
        job.write_text(json.dumps(collected.job | {"answer": str(answer)}), "utf-8")
        try:
            bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True, relative_remap=True, check_existing=False)
        except RuntimeError as error:
            raise Failed(Problem(f"The file could not be copied to {between}: {str(error).strip()}", "make room on the disk")) from error
        exporting = Process(exporting_line(str(copy), str(job)), str(between))
        [first, last] = collected.job["frames"]
        exporting.frames = (last - first + 1) * len(collected.bodies)
        done = yield exporting
        if done.code != 0 or not answer.exists():
            tail = [line for line in (done.output + done.errors).splitlines() if line.strip()][-1:]
            raise Failed(Problem(f"Blender in the background ended with code {done.code}: {' '.join(tail)}",
                                 "save the file, open it again and try once more"))
        answered = json.loads(answer.read_text("utf-8"))
        found = answered["problems"]
        if found:
            raise Failed(*(Problem(**(each | {"object": each["object"] and plain_name(each["object"])})) for each in found))
    finally:
        if exporting:
            exporting.end()
        shutil.rmtree(between, ignore_errors=True)
    beside = folder / (SCENE_FILE + ".part")
    beside.write_text(collected.text(answered["seams"], answered["sizes"]), "utf-8")
    os.replace(beside, folder / SCENE_FILE)
    return collected


def ask_solver(solver, folder, *arguments):
    """Runs a command in the scene folder to its end. Raises `Failed` with the problems that it names."""
    done = yield Process(solver.line(*arguments), str(folder), solver.environment)
    answer, errors, code = done.output, done.errors, done.code
    done.end()
    if code != 0:
        problems = answers.problems_of(errors, text_of(folder / SCENE_FILE))
        raise Failed(*(problems or [Problem(f"The solver ended with code {code} and said nothing")]))
    return answer


def solver_or_failed():
    try:
        return solver_of(bpy.context)
    except NoSolver as error:
        raise Failed(Problem(str(error))) from error


def same_scene(name, folder, kind=FINAL):
    """The scene of a task that has waited: Undo may have made another object of it. Raises `Failed` where it has another name now."""
    scene = bpy.data.scenes.get(name)
    if scene is None or scene_folder(scene, kind) != folder:
        raise Failed(Problem(f'The scene "{name}" or its file has another name now', "press the button again"))
    return scene


def write_task(scene, view):
    """Writes the scene folder and nothing else."""
    collected = yield from write(scene, view)
    return [f"Written: {collected.folder}"]


def asked(scene, view, doing, command):
    """Writes the scene folder and asks the solver about it; shows the warnings of both."""
    solver = solver_or_failed()
    collected = yield from write(scene, view)
    view.doing, view.share = doing, None
    answer = yield from ask_solver(solver, collected.folder, command, SCENE_FILE, "--json")
    view.problems = collected.warnings + answers.warnings_of(answer)
    return collected, answer


def check_task(scene, view):
    """Writes the scene folder and has every problem named."""
    collected, _ = yield from asked(scene, view, "Checking every frame", "check")
    return ["No problems" if not view.problems else "It can be simulated; the warnings may be meant", *over_time(collected)]


def plan_task(scene, view):
    """Writes the scene folder and shows what would run."""
    collected, answer = yield from asked(scene, view, "Planning", "plan")
    return [*answers.plan_lines(answer), *over_time(collected)]


def over_time(collected):
    """Lines of the panel about keyframed settings."""
    return [f"Over time: {line}" for line in collected.curves]


def simulate_task(scene, view, *options):
    """Writes the scene folder, checks it and starts the simulation."""
    name, folder = scene.name, scene_folder(scene)
    yield from check_task(scene, view)
    start_simulation(same_scene(name, folder), *options)
    return []


def start_simulation(scene, *options, kind=FINAL):
    """Starts or continues the run of a scene folder that is written, and watches it. Raises `Failed` or `OSError`."""
    work, folder, solver = state.work(), scene_folder(scene, kind), solver_or_failed()
    threads = scene.drapery.threads
    line = solver.line("run", SCENE_FILE, "--progress", "none", *(["--threads", threads] if threads else []), *options)
    view, key = work.view(scene, kind), (scene.name, kind)
    view.status, view.doing, view.refused, view.stopping = None, "Starting", False, False
    view.warnings = []
    work.watched[key] = Simulation(line, str(folder), solver.environment, folder / "simulate.log")
    work.folders[key] = run_folder(scene, kind)
    work.next_question.pop(key, None)
    work.wake()


def continue_task(scene, view):
    """Resumes the run of the scene folder as it is."""
    start_simulation(scene)
    yield from ()
    return []


def preview_task(scene, view):
    """Simulates the scene by the solver's settings for previews, in a folder of its own, and shows each frame. The run itself names
    what is wrong: no check comes before."""
    name, folder = scene.name, scene_folder(scene, PREVIEW)
    solver_or_failed()
    yield from write(scene, view, PREVIEW)
    scene = same_scene(name, folder, PREVIEW)
    start_simulation(scene, "--overwrite", kind=PREVIEW)
    scene.drapery.preview = True
    return []


def dismiss_task(scene, view):
    """Ends the preview of a scene, takes it off the garments and deletes its folder."""
    name, folder, run = scene.name, scene_folder(scene, PREVIEW), run_folder(scene, PREVIEW)
    work, key = state.work(), (name, PREVIEW)
    view.doing = "Dismissing"
    scene.drapery.preview = False
    simulation = work.watched.pop(key, None)
    if (run / "manifest.json").exists() and (simulation is None or simulation.code is None):
        solver = solver_or_failed()
        yield Process(solver.line("stop", run), str(folder), solver.environment)
        while simulation is None or simulation.code is None:
            done = yield Process(solver.line("status", run, "--json"), str(folder), solver.environment)
            # A machine that is not heard of is not waited for.
            if done.code != 0 or answers.status_of(done.output).state != "running":
                break
    elif simulation is not None:
        simulation.end()
    if name in bpy.data.scenes:
        # Where the Live View is on, it shows the simulation at the next tick.
        work.live.take_off(bpy.data.scenes[name])
    if folder.exists():
        shutil.rmtree(folder)
    view.status, view.warnings, view.stopping = None, [], False
    work.folders.pop(key, None)
    return ["Preview dismissed"]


def cancel_task(scene, view):
    """Asks the run of a scene to end at a checkpoint, on whatever machine it runs."""
    name, folder = scene.name, scene_folder(scene)
    yield from ask_solver(solver_or_failed(), folder, "stop", run_folder(scene))
    view.stopping = True
    state.work().look_at_folder(same_scene(name, folder))
    return []
