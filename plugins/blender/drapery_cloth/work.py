"""Work in progress: the export, check and plan as processes that are waited for, and simulations that are watched.

Nothing waits: a timer calls `Work.tick`, which looks whether a process has ended and resumes the generator that
started it. Simulations belong to nobody: they are started in sessions of their own, and known by their folder alone.
"""

import time
import traceback

import bpy

from . import answers, colours, live
from .answers import Failed, Problem
from .collect import FINAL, KINDS, run_folder, scene_folder
from .process import NoSolver, Process
from .scene_text import SCENE_FILE
from .tasks import last_log, solver_of, text_of

# Seconds between two looks, between two questions about a run, and between two looks of a script that waits.
LOOK, ASK, WAIT = 0.2, 1.0, 0.02


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
    """All that runs; one task at a time, and any number of simulations that are watched.

    A run has a key: the name of its scene, and its kind, `FINAL` or `PREVIEW`.
    """

    def __init__(self):
        self.views = {}
        self.task = None
        self.task_key = None
        self.process = None
        self.watched = {}
        # The folder of each scene's run when it was looked at last; a scene or a file gets another one with another name.
        self.folders = {}
        self.questions = {}
        # When a run is asked about next.
        self.next_question = {}
        # Whether runs of the open file have not been looked for yet.
        self.unseen = False
        self.live, self.colours = live.Live(), colours.Colours()
        # One object: Blender knows a timer by it, and each `self.on_timer` is another.
        self.timer = self.on_timer

    # What the panel and the operators call.

    def view(self, scene, kind=FINAL):
        return self.views.setdefault((scene.name, kind), View())

    @property
    def busy(self):
        return self.task is not None

    def start(self, scene, task, kind=FINAL):
        """Begins a task of a scene: a generator of `tasks`."""
        view = self.view(scene, kind)
        view.problems, view.lines, view.refused, view.share, view.failed = [], [], False, None, False
        self.task, self.task_key = task, (scene.name, kind)
        self.go_on(None)
        self.wake()

    def stop_task(self):
        """Ends the export or the check that runs; files that were written stay."""
        if self.process:
            self.process.end()
        if self.task:
            self.task.close()
            self.finish(["Stopped"], failed=True)

    def look_at_folder(self, scene, kind=FINAL):
        """Asks about the run in the scene's folder, if there is one: it may have run since before Blender was opened."""
        key, folder = (scene.name, kind), run_folder(scene, kind)
        self.folders[key] = folder
        if folder and (folder / "manifest.json").exists():
            self.watched.setdefault(key, None)
            self.next_question.pop(key, None)
            self.wake()

    def follow(self, scene):
        """Looks at other folders than before if the scene has others now."""
        for kind in KINDS:
            self.follow_run(scene, kind)

    def follow_run(self, scene, kind):
        if self.folders.get((scene.name, kind), ()) == run_folder(scene, kind):
            return
        view = self.view(scene, kind)
        view.lines = []
        # Those of scenes that have another name now, too.
        for key in [key for key in self.folders if key[1] == kind and (key[0] == scene.name or key[0] not in bpy.data.scenes)]:
            self.leave(key, view)
        view.status, view.warnings, view.doing, view.stopping = None, [], "", False
        self.look_at_folder(scene, kind)

    def leave(self, key, view):
        """Asks no more about a run, and says in a view where it continues."""
        folder, simulation = self.folders.pop(key), self.watched.pop(key, None)
        status = self.views[key].status if key in self.views else None
        if key in self.questions:
            self.questions.pop(key).end()
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
            for kind in KINDS:
                self.look_at_folder(scene, kind)

    def look_now(self, scene, kind=FINAL):
        """Asks about a run of the scene and waits for the answer: in a Blender without a window no timer does."""
        if self.unseen:
            self.look_at_all()
        self.follow(scene)
        key = scene.name, kind
        self.next_question.pop(key, None)
        if key in self.watched:
            self.watch(key)
        while key in self.questions:
            time.sleep(WAIT)
            self.watch(key)

    def wait(self, done):
        """Works until `done()`, in the place of the timer: for scripts. Interrupted, the task ends; simulations run on."""
        try:
            while not done():
                self.tick()
                time.sleep(WAIT)
        except BaseException:
            self.stop_task()
            raise

    def is_over(self, scene, kind=FINAL):
        """Whether there is nothing left to wait for: the simulation has ended, or nothing is heard of its machine."""
        status = self.view(scene, kind).status
        return (scene.name, kind) not in self.watched or bool(status and status.state == "silent")

    def forget(self):
        """Another file was opened: tasks of the old one end, simulations run on unwatched."""
        self.stop_task()
        for process in self.questions.values():
            process.end()
        self.views, self.watched, self.folders, self.questions, self.next_question, self.unseen = {}, {}, {}, {}, {}, False
        self.live.forget()
        self.colours.forget()

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
        # A view that nothing changes in is not drawn again and again.
        if alive or self.live.changed or self.colours.changed:
            for window in getattr(bpy.context.window_manager, "windows", ()):
                for area in window.screen.areas:
                    if area.type == "VIEW_3D":
                        area.tag_redraw()
        if alive or self.colours.wanted:
            return LOOK
        return ASK if self.live.wanted else None

    def tick(self):
        """Looks at all processes and caches; whether anything is in progress."""
        if self.unseen:
            self.look_at_all()
        if self.process and self.process.finished:
            done, self.process = self.process, None
            self.go_on(done)
        elif self.process:
            self.follow_export()
        for key in list(self.watched):
            if key in self.watched:
                self.watch(key)
        self.live.tick()
        self.colours.tick(self.live)
        return self.busy or bool(self.watched)

    def go_on(self, done):
        """Goes on with the task until it waits for another process."""
        view = self.views.setdefault(self.task_key, View())
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
        view = self.views.setdefault(self.task_key, View())
        view.doing, view.share, view.lines, view.failed = "", None, lines, failed
        self.task = self.process = None

    def follow_export(self):
        """Updates the share of the export that is done, from the number of frames that it has printed."""
        view = self.views.setdefault(self.task_key, View())
        frames = getattr(self.process, "frames", None)
        if not frames:
            return
        count = self.process.output.count("\nframe ")
        view.share = min(1.0, count / frames)

    def watch(self, key):
        """Asks about a run once a second, until it runs no more."""
        name, kind = key
        scene, folder = bpy.data.scenes.get(name), self.folders[key]
        if scene is None:
            self.leave(key, self.view(bpy.context.scene, kind))
            return
        if run_folder(scene, kind) != folder:
            self.follow_run(scene, kind)
            return
        view, simulation = self.view(scene, kind), self.watched[key]
        question = self.questions.get(key)
        if question and question.finished:
            self.answer(key, view, simulation, self.questions.pop(key))
        elif not question and time.monotonic() >= self.next_question.get(key, 0.0):
            self.ask(key, scene, view, simulation)

    def ask(self, key, scene, view, simulation):
        folder = self.folders[key]
        ended = simulation is not None and simulation.code is not None
        if simulation is not None and not ended and not (folder / "manifest.json").exists():
            view.doing = "Reading inputs"
            return
        if ended and simulation.code not in (0, answers.STOPPED):
            view.problems = answers.problems_of(simulation.errors, text_of(scene_folder(scene, key[1]) / SCENE_FILE))
            view.refused = simulation.code == answers.HOLDS_ANOTHER_RUN
        if not (folder / "manifest.json").exists():
            view.doing, view.status = "", None
            self.watched.pop(key)
            if simulation is not None and not view.problems:
                view.problems = [Problem(f"The solver ended with code {simulation.code} before its first frame",
                                         "the file simulate.log in the scene folder holds what it said")]
            return
        try:
            solver = solver_of(bpy.context)
        except NoSolver as error:
            self.watched.pop(key)
            view.doing, view.problems = "", [Problem(str(error))]
            return
        # The process whose end is known now is not asked about again.
        self.watched[key] = None if ended else simulation
        self.questions[key] = Process(solver.line("status", folder, "--json"), environment=solver.environment)

    def answer(self, key, view, simulation, question):
        self.next_question[key] = time.monotonic() + ASK
        view.doing = ""
        if question.code == 0:
            view.status = answers.status_of(question.output)
            view.warnings = answers.warnings_of_log(last_log(self.folders[key]))
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
            self.watched.pop(key, None)
