"""Work in progress: the export, check and plan as processes that are waited for, and simulations that are watched.

Nothing waits: a timer calls `Work.tick`, which looks whether a process has ended and resumes the generator that
started it. Simulations belong to nobody: they are started in sessions of their own, and known by their folder alone.
"""

import json
import os
import shutil
import sys
import tempfile
import time
import traceback
from pathlib import Path

import bpy

from . import answers, settings, state
from .answers import Problem
from .collect import Collected, run_folder, scene_folder
from .process import NoSolver, Process, Simulation, find_solver
from .scene_text import SCENE_FILE, plain_name

# Seconds between two looks, between two questions about a run, and between two looks of a script that waits.
LOOK, ASK, WAIT = 0.2, 1.0, 0.02


class Failed(Exception):
    """A task ends here; `problems` say why."""

    def __init__(self, *problems):
        super().__init__(problems[0].message if problems else "")
        self.problems = list(problems)


class View:
    """Contents of the panel for a scene."""

    def __init__(self):
        self.doing = ""
        self.share = None
        self.problems = []
        self.lines = []
        # Of the run: what its log warns of.
        self.warnings = []
        self.status = None
        self.refused = False
        self.stopping = False
        # Whether the last task did not come to its end.
        self.failed = False


class Work:
    """All that runs; one task at a time, and any number of simulations that are watched."""

    def __init__(self):
        self.views = {}
        self.task = None
        self.task_scene = None
        self.process = None
        self.watched = {}
        # The folder of each scene's run when it was looked at last; a scene or a file gets another one with another name.
        self.folders = {}
        self.questions = {}
        # When a run is asked about next.
        self.next_question = {}
        # Whether runs of the open file have not been looked for yet.
        self.unseen = False
        # One object: Blender knows a timer by it, and each `self.on_timer` is another.
        self.timer = self.on_timer

    # What the panel and the operators call.

    def view(self, scene):
        return self.views.setdefault(scene.name, View())

    @property
    def busy(self):
        return self.task is not None

    def start(self, scene, task):
        """Begins a task of a scene: the generator of one of the functions below."""
        view = self.view(scene)
        view.problems, view.lines, view.refused, view.share, view.failed = [], [], False, None, False
        self.task, self.task_scene = task, scene.name
        self.go_on(None)
        self.wake()

    def stop_task(self):
        """Ends the export or the check that runs; files that were written stay."""
        if self.process:
            self.process.end()
        if self.task:
            self.task.close()
            self.finish(["Stopped"], failed=True)

    def look_at_folder(self, scene):
        """Asks about the run in the scene's folder, if there is one: it may have run since before Blender was opened."""
        folder = self.folders[scene.name] = run_folder(scene)
        if folder and (folder / "manifest.json").exists():
            self.watched.setdefault(scene.name, None)
            self.next_question.pop(scene.name, None)
            self.wake()

    def follow(self, scene):
        """Looks at another folder than before if the scene has another one now."""
        if self.folders.get(scene.name, ()) == run_folder(scene):
            return
        view = self.view(scene)
        view.lines = []
        # Those of scenes that have another name now, too.
        for name in [name for name in self.folders if name == scene.name or name not in bpy.data.scenes]:
            self.leave(name, view)
        view.status, view.warnings, view.doing, view.stopping = None, [], "", False
        self.look_at_folder(scene)

    def leave(self, name, view):
        """Asks no more about the run of a scene, and says in a view where it continues."""
        folder, simulation = self.folders.pop(name), self.watched.pop(name, None)
        status = self.views[name].status if name in self.views else None
        if name in self.questions:
            self.questions.pop(name).end()
        if simulation is not None and simulation.code is None or status and status.running:
            view.lines = [f"The simulation in {folder} continues. Its scene or folder has another name now: give back the earlier one to stop "
                          "it, or name its folder under From to load it"]

    def look_later(self):
        """Looks for runs of the open file at the next tick."""
        self.unseen = True
        self.wake()

    def look_at_all(self):
        self.unseen = False
        for scene in bpy.data.scenes:
            self.look_at_folder(scene)

    def look_now(self, scene):
        """Asks about the scene's run and waits for the answer: in a Blender without a window no timer does."""
        if self.unseen:
            self.look_at_all()
        self.follow(scene)
        self.next_question.pop(scene.name, None)
        if scene.name in self.watched:
            self.watch(scene.name)
        while scene.name in self.questions:
            time.sleep(WAIT)
            self.watch(scene.name)

    def wait(self, done):
        """Works until `done()`, in the place of the timer: for scripts. Interrupted, the task ends; simulations run on."""
        try:
            while not done():
                self.tick()
                time.sleep(WAIT)
        except BaseException:
            self.stop_task()
            raise

    def is_over(self, scene):
        """Whether there is nothing left to wait for: the simulation has ended, or nothing is heard of its machine."""
        status = self.view(scene).status
        return scene.name not in self.watched or bool(status and status.state == "silent")

    def forget(self):
        """Another file was opened: tasks of the old one end, simulations run on unwatched."""
        self.stop_task()
        for process in self.questions.values():
            process.end()
        self.views, self.watched, self.folders, self.questions, self.next_question, self.unseen = {}, {}, {}, {}, {}, False

    def remove(self):
        """The add-on is unregistered: processes of its own end, simulations run on."""
        self.forget()
        if bpy.app.timers.is_registered(self.timer):
            bpy.app.timers.unregister(self.timer)

    # The timer.

    def wake(self):
        if not bpy.app.timers.is_registered(self.timer):
            bpy.app.timers.register(self.timer, first_interval=LOOK, persistent=True)

    def on_timer(self):
        alive = self.tick()
        for window in getattr(bpy.context.window_manager, "windows", ()):
            for area in window.screen.areas:
                if area.type == "VIEW_3D":
                    area.tag_redraw()
        return LOOK if alive else None

    def tick(self):
        """Looks at all processes; whether there is anything left to look at."""
        if self.unseen:
            self.look_at_all()
        if self.process and self.process.finished:
            done, self.process = self.process, None
            self.go_on(done)
        elif self.process:
            self.follow_export()
        for name in list(self.watched):
            if name in self.watched:
                self.watch(name)
        return self.busy or bool(self.watched)

    def go_on(self, done):
        """Goes on with the task until it waits for another process."""
        view = self.views.setdefault(self.task_scene, View())
        try:
            self.process = self.task.send(done)
        except StopIteration as end:
            self.finish(end.value or [])
        except Failed as failed:
            self.finish([], failed=True)
            view.problems = failed.problems
        except OSError as error:
            self.finish([], failed=True)
            where = error.filename or "a file"
            view.problems = [Problem(f"{where}: {error.strerror}", "make room on the disk, or choose a folder that can be written")]
        except Exception as error:
            # A task that nobody ends would grey out every button until Blender is started anew.
            traceback.print_exc()
            self.finish([], failed=True)
            view.problems = [Problem(f"A fault of the add-on: {error!r}", "please report it, with what the console of Blender says")]

    def finish(self, lines, failed=False):
        view = self.views.setdefault(self.task_scene, View())
        view.doing, view.share, view.lines, view.failed = "", None, lines, failed
        self.task = self.process = None

    def follow_export(self):
        """Updates the share of the export that is done, from the number of frames that it has printed."""
        view = self.views.setdefault(self.task_scene, View())
        frames = getattr(self.process, "frames", None)
        if not frames:
            return
        count = self.process.output.count("\nframe ")
        view.share = min(1.0, count / frames)

    def watch(self, name):
        """Asks about a run once a second, until it runs no more."""
        scene, folder = bpy.data.scenes.get(name), self.folders[name]
        if scene is None:
            self.leave(name, self.view(bpy.context.scene))
            return
        if run_folder(scene) != folder:
            self.follow(scene)
            return
        view, simulation = self.view(scene), self.watched[name]
        question = self.questions.get(name)
        if question and question.finished:
            self.answer(name, view, simulation, self.questions.pop(name))
        elif not question and time.monotonic() >= self.next_question.get(name, 0.0):
            self.ask(name, scene, view, folder, simulation)

    def ask(self, name, scene, view, folder, simulation):
        ended = simulation is not None and simulation.code is not None
        if simulation is not None and not ended and not (folder / "manifest.json").exists():
            view.doing = "Reading inputs"
            return
        if ended and simulation.code not in (0, answers.STOPPED):
            view.problems = answers.problems_of(simulation.errors, text_of(scene_folder(scene) / SCENE_FILE))
            view.refused = simulation.code == answers.HOLDS_ANOTHER_RUN
        if not (folder / "manifest.json").exists():
            view.doing, view.status = "", None
            self.watched.pop(name)
            if simulation is not None and not view.problems:
                view.problems = [Problem(f"The solver ended with code {simulation.code} before its first frame",
                                         "the file simulate.log in the scene folder holds what it said")]
            return
        try:
            solver = solver_of(bpy.context)
        except NoSolver as error:
            self.watched.pop(name)
            view.doing, view.problems = "", [Problem(str(error))]
            return
        # The process whose end is known now is not asked about again.
        self.watched[name] = None if ended else simulation
        self.questions[name] = Process(solver.line("status", folder, "--json"), environment=solver.environment)

    def answer(self, name, view, simulation, question):
        self.next_question[name] = time.monotonic() + ASK
        view.doing = ""
        if question.code == 0:
            view.status = answers.status_of(question.output)
            view.warnings = answers.warnings_of_log(last_log(run_folder(bpy.data.scenes[name])))
            view.stopping = view.stopping and view.status.running
            going_on = view.status.running or simulation is not None
            if view.status.state == "failed" and not view.problems:
                view.problems = answers.problems_of(f"Error: {view.status.error}")
        else:
            view.status = None
            going_on = simulation is not None
            view.problems = answers.problems_of(question.errors)
        question.end()
        if not going_on:
            self.watched.pop(name, None)


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


def write(scene, view):
    """Writes the scene folder. Raises `Failed`."""
    view.doing = "Writing meshes"
    collected = Collected(scene)
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


def same_scene(name, folder):
    """The scene of a task that has waited: Undo may have made another object of it. Raises `Failed` where it has another name now."""
    scene = bpy.data.scenes.get(name)
    if scene is None or scene_folder(scene) != folder:
        raise Failed(Problem(f'The scene "{name}" or its file has another name now', "press the button again"))
    return scene


def write_task(scene, view):
    """Writes the scene folder and nothing else."""
    collected = yield from write(scene, view)
    return [f"Written: {collected.folder}"]


def check_task(scene, view):
    """Writes the scene folder and has every problem named."""
    solver = solver_or_failed()
    collected = yield from write(scene, view)
    view.doing, view.share = "Checking every frame", None
    answer = yield from ask_solver(solver, collected.folder, "check", SCENE_FILE, "--json")
    view.problems = collected.warnings + answers.warnings_of(answer)
    return ["No problems" if not view.problems else "It can be simulated; the warnings may be meant"]


def plan_task(scene, view):
    """Writes the scene folder and shows what would run."""
    solver = solver_or_failed()
    collected = yield from write(scene, view)
    view.doing, view.share = "Planning", None
    answer = yield from ask_solver(solver, collected.folder, "plan", SCENE_FILE, "--json")
    view.problems = collected.warnings + answers.warnings_of(answer)
    return answers.plan_lines(answer)


def simulate_task(scene, view, *options):
    """Writes the scene folder, checks it and starts the simulation."""
    name, folder = scene.name, scene_folder(scene)
    yield from check_task(scene, view)
    start_simulation(same_scene(name, folder), *options)
    return []


def start_simulation(scene, *options):
    """Starts or continues the run of a scene folder that is written, and watches it. Raises `Failed` or `OSError`."""
    work, folder, solver = state.work(), scene_folder(scene), solver_or_failed()
    threads = scene.drapery.threads
    line = solver.line("run", SCENE_FILE, "--progress", "none", *(["--threads", threads] if threads else []), *options)
    view = work.view(scene)
    view.status, view.doing, view.refused, view.stopping = None, "Starting", False, False
    view.warnings = []
    work.watched[scene.name] = Simulation(line, str(folder), solver.environment, folder / "simulate.log")
    work.folders[scene.name] = run_folder(scene)
    work.next_question.pop(scene.name, None)
    work.wake()


def continue_task(scene, view):
    """Resumes the run of the scene folder as it is."""
    start_simulation(scene)
    yield from ()
    return []


def cancel_task(scene, view):
    """Asks the run of a scene to end at a checkpoint, on whatever machine it runs."""
    name, folder = scene.name, scene_folder(scene)
    yield from ask_solver(solver_or_failed(), folder, "stop", run_folder(scene))
    view.stopping = True
    state.work().look_at_folder(same_scene(name, folder))
    return []
