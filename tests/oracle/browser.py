"""Pages of the book in Chromium without a window: a script runs beside them, and what it returns comes back."""

import functools
import http.server
import json
import shutil
import subprocess
import tempfile
import threading

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome")
# Seconds, for machines that are busy with other work.
PATIENCE = 600

HARNESS = """<!doctype html><meta charset="utf-8"><body><script type="module">
const answer = (body) => fetch("/answer", { method: "POST", body: JSON.stringify(body) });
const pause = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
try { await answer({ result: await (async (given) => { SCRIPT })(GIVEN) }); } catch (error) { await answer({ error: `${error.stack}` }); }
</script>"""


def evaluate(site, script, given, without=()):
    """Returns the result of `script`, the body of an asynchronous function of `given`, on a server of the folder `site`.

    Addresses that end with one of `without` are not found.
    """
    program = next(filter(None, map(shutil.which, NAMES)), None)
    if program is None:
        pytest.skip("no chromium; `make setup` installs it on Debian")
    page = HARNESS.replace("SCRIPT", script).replace("GIVEN", json.dumps(given)).encode()
    answers, answered = [], threading.Event()

    class Handler(http.server.SimpleHTTPRequestHandler):
        def do_GET(self):
            if self.path == "/harness.html":
                self.reply(200, page)
            elif self.path.endswith(tuple(without)):
                self.reply(404, b"")
            else:
                super().do_GET()

        def do_POST(self):
            answers.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.reply(204, b"")
            answered.set()

        def reply(self, status, body):
            self.send_response(status)
            self.send_header("Content-Type", "text/html")
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
            # As root it has no sandbox; it sees files of the project alone.
            options = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--remote-debugging-port=0",
                       f"--user-data-dir={profile}", "--window-size=1400,1000"]  # fmt: skip
            address = f"http://127.0.0.1:{server.server_port}/harness.html"
            browser = subprocess.Popen([program, *options, address], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            answered.wait(PATIENCE)
            browser.terminate()
            browser.wait()
        server.shutdown()
    assert answers, f"{program} gave no answer within {PATIENCE} s"
    assert "error" not in answers[0], answers[0]["error"]
    return answers[0]["result"]
