"""Processes: the solver's command, and Blender once more in the background; nothing here waits, nothing here knows Blender."""

import importlib.util
import os
import subprocess
import sys
import tempfile
from pathlib import Path


class NoSolver(Exception):
    """There is no solver to run; the text says what to do."""


class Command:
    """Command line that starts the solver: its words and the environment."""

    def __init__(self, words, environment):
        self.words = words
        self.environment = environment

    def line(self, *arguments):
        return [*self.words, *map(str, arguments)]


def find_solver(executable):
    """The solver: `executable` if one is named, else the wheel that came with the extension. Raises `NoSolver`."""
    environment = dict(os.environ)
    if executable:
        path = Path(executable)
        if not path.is_file() or not os.access(path, os.X_OK):
            raise NoSolver(f"{executable} is not a program. Choose the drapery executable in the add-on's preferences")
        return Command([str(path)], environment)
    try:
        found = importlib.util.find_spec("drapery")
    except (ImportError, ValueError):
        found = None
    if found is None or not found.submodule_search_locations:
        raise NoSolver("The solver is missing: this zip held no wheel for this machine. Install the zip of your platform, "
                       "or choose a drapery executable in the add-on's preferences")
    # Blender's interpreter does not look where extensions keep their wheels.
    folder = str(Path(next(iter(found.submodule_search_locations))).parent)
    environment["PYTHONPATH"] = os.pathsep.join(filter(None, [folder, environment.get("PYTHONPATH")]))
    return Command([sys.executable, "-m", "drapery"], environment)


class Process:
    """A process whose end is asked for now and then. `output` and `errors` are complete once `finished` is true."""

    def __init__(self, line, folder=None, environment=None):
        # Files, not pipes: a pipe that nobody empties stops the process.
        self._output, self._errors = tempfile.TemporaryFile(), tempfile.TemporaryFile()
        self._popen = subprocess.Popen(line, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=self._output,
                                       stderr=self._errors)

    @property
    def finished(self):
        return self._popen.poll() is not None

    @property
    def code(self):
        return self._popen.returncode

    def text(self, file):
        file.seek(0)
        return file.read().decode("utf-8", "replace")

    @property
    def output(self):
        return self.text(self._output)

    @property
    def errors(self):
        return self.text(self._errors)

    def end(self):
        """Ends it and does not wait long; for processes that leave nothing half done."""
        if not self.finished:
            self._popen.terminate()
            try:
                self._popen.wait(5)
            except subprocess.TimeoutExpired:
                self._popen.kill()
                self._popen.wait()
        self._output.close()
        self._errors.close()


class Simulation:
    """A run of the solver that outlives Blender: a session of its own, and what it says goes to a file."""

    def __init__(self, line, folder, environment, log):
        with open(log, "wb") as file:
            self._popen = subprocess.Popen(line, cwd=folder, env=environment, stdin=subprocess.DEVNULL,
                                           stdout=subprocess.DEVNULL, stderr=file, start_new_session=True)
        self._log = Path(log)

    @property
    def code(self):
        """Its exit code, or None while it runs."""
        return self._popen.poll()

    def end(self):
        """Ends a run that nobody needs the frames of."""
        if self.code is None:
            self._popen.terminate()
            self._popen.wait()

    @property
    def errors(self):
        try:
            return self._log.read_text("utf-8", "replace")
        except OSError as error:
            return f"Error: {self._log} cannot be read: {error.strerror}"
