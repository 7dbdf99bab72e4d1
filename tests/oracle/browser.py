"""Pages in Chromium without a window: a script runs beside them, and what it returns comes back."""

import functools
import http.server
import json
import shutil
import subprocess
import tempfile
import threading
import urllib.error
import urllib.request

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
# Seconds, for machines that are busy with other work.
PATIENCE = 600

HARNESS = """<!doctype html><meta charset="utf-8"><body><script type="module">
const answer = (body) => fetch("/answer", { method: "POST", body: JSON.stringify(body) });
const pause = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
try { await answer({ result: await (async (given) => { SCRIPT })(GIVEN) }); } catch (error) { await answer({ error: `${error.stack}` }); }
</script>"""


# WebGL without a graphics card.
WEBGL = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def browser():
    """The program, with the options that it has to have everywhere. As root it has no sandbox; it sees files of the project alone."""
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no chromium; `make setup` installs it on Debian")
    return [program, "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--window-size=1400,1000"]


def text_of(page):
    """Returns the text of a page on disk, as its scripts have changed it, after two seconds of its own time."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        command = [*browser(), *WEBGL, f"--user-data-dir={profile}", "--virtual-time-budget=2000", "--dump-dom", page.as_uri()]
        return subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=PATIENCE).stdout


def photograph(page, picture, size):
    """Writes a picture (PNG) of a page on disk after ten seconds of its own time; `size` is that of the window in pixels."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        options = [f"--user-data-dir={profile}", f"--screenshot={picture}", f"--window-size={size[0]},{size[1]}", "--hide-scrollbars"]
        subprocess.run([*browser(), *WEBGL, *options, "--virtual-time-budget=10000", page.as_uri()], check=True, capture_output=True)


def evaluate(site, script, given, without=(), calls=None):
    """Returns the result of `script`, the body of an asynchronous function of `given`, on a server of the folder `site`.

    Addresses that end with one of `without` are not found. A `site` that begins with http is a server whose answers are handed on.
    `calls` are functions by the address at which the script calls them.
    """
    start = browser()
    page = HARNESS.replace("SCRIPT", script).replace("GIVEN", json.dumps(given)).encode()
    answers, answered = [], threading.Event()

    class Handler(http.server.SimpleHTTPRequestHandler):
        def do_GET(self):
            if self.path == "/harness.html":
                self.reply(200, page)
            elif self.path in (calls or {}):
                calls[self.path]()
                self.reply(204, b"")
            elif str(site).startswith("http"):
                self.hand_on()
            elif self.path.endswith(tuple(without)):
                self.reply(404, b"")
            else:
                super().do_GET()

        def do_POST(self):
            answers.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.reply(204, b"")
            answered.set()

        def hand_on(self):
            try:
                with urllib.request.urlopen(f"{site}{self.path}") as answer:
                    self.reply(200, answer.read(), answer.headers["Content-Type"])
            except urllib.error.HTTPError as error:
                self.reply(error.code, error.read(), error.headers["Content-Type"])

        def reply(self, status, body, kind="text/html"):
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            pass

    class Server(http.server.ThreadingHTTPServer):
        def handle_error(self, *_):
            """A frame that is taken away before it has loaded all: no error."""

    with Server(("127.0.0.1", 0), functools.partial(Handler, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
            options = [*WEBGL, "--remote-debugging-port=0", f"--user-data-dir={profile}"]
            address = f"http://127.0.0.1:{server.server_port}/harness.html"
            process = subprocess.Popen([*start, *options, address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            answered.wait(PATIENCE)
            process.terminate()
            process.wait()
        server.shutdown()
    assert answers, f"{start[0]} gave no answer within {PATIENCE} s"
    assert "error" not in answers[0], answers[0]["error"]
    return answers[0]["result"]
