"""`drapery view` in a real browser: frames arrive while a run goes on, and the page draws what the official Alembic library reads."""

import signal
import subprocess

import numpy as np
import pytest

from browser import evaluate, text_of
from farm import DRAPERY, Shot, reaches
from judges import official

# A square of 0.4 m that pins hold stretched by 5 %, 3 mm above a ground with a thickness of 2 mm.
STRAIN, HEIGHT, THICKNESS = 0.05, 0.003, 0.002
CELLS, LAST = 16, 30

SCENE = f"""drapery = 1
[shot]
name = "stretched"
frames = "1-{LAST}"
[units]
length = "m"
up = "Y"
[self_repulsion]
[[body]]
name = "ground"
shape = {{ half_space = {{}} }}
friction = 0.3
thickness = {THICKNESS}
[[garment]]
name = "square"
rest = "rest.obj"
start = "start.obj"
density = 0.2
thickness = "1.5 mm"
[garment.stretch]
stiffness = 50
[[garment.pin]]
where = {{ box = {{ min = [-1, -1, -1], max = [1, 1, 1] }} }}
[output]
format = ["abc"]
"""

# Viridis at a half, as matplotlib 3.10 prints it: red, green and blue from 0 to 1.
VIRIDIS_AT_A_HALF = [0.127568, 0.566949, 0.550556]

LOOK = """
const until = async (holds) => { while (!holds()) await pause(20); };
const frame = document.createElement("iframe");
frame.style = "width: 1000px; height: 700px";
frame.src = "/";
document.body.append(frame);
const text = (id) => frame.contentDocument.getElementById(id).textContent;
const is_hidden = (id) => frame.contentDocument.getElementById(id).hidden;
await until(() => frame.contentWindow.viewer?.shown());
const { viewer } = frame.contentWindow;
const seen = { early: { frames: viewer.run().frames.length, status: text("status") } };
await fetch("/continue");
await until(() => viewer.run().state === "done" && viewer.shown() === given.last);
await until(() => text("status").includes("done"));
seen.late = { frames: viewer.run().frames.length, status: text("status") };
for (const mode of ["strain", "thickness", "contact"]) {
    viewer.setMode(mode);
    await until(() => viewer.about(0, 0).value !== null && text("legend").startsWith(given.titles[mode]));
    seen[mode] = { vertices: given.vertices.map((v) => viewer.about(0, v)), legend: frame.contentDocument.getElementById("legend").innerText };
    seen[mode].pixels = given.vertices.map((v) => viewer.pixel(...viewer.placeOf(0, v)));
}
await viewer.show(1);
seen.first = given.vertices.map((v) => viewer.about(0, v));
seen.corner = viewer.pixel(2, 2);
await fetch("/take_away");
await until(() => !is_hidden("alarm"));
seen.alarm = text("alarm");
await fetch("/bring_back");
await until(() => is_hidden("alarm"));
return seen;
"""

TITLES = {"strain": "Strain", "thickness": "Thickness", "contact": "Distance"}


def grid(stretch):
    """The square as the text of an OBJ file, along x and z, around the middle."""
    side = np.linspace(-0.2, 0.2, CELLS + 1)
    points = [f"v {x * stretch:.9f} {HEIGHT} {z:.9f}\n" for z in side for x in side]
    row = CELLS + 1
    corners = [row * j + i + 1 for j in range(CELLS) for i in range(CELLS)]
    return "".join(points + [f"f {a} {a + row} {a + row + 1} {a + 1}\n" for a in corners])


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """The page of a run that is held at its second frame until the page has seen it, and the folder of the run."""
    folder = tmp_path_factory.mktemp("view")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "rest.obj").write_text(grid(1))
    (folder / "start.obj").write_text(grid(1 + STRAIN))
    out = folder / "out"
    run = Shot(folder / "scene.toml", f"1-{LAST}").start(out)
    try:
        assert reaches(out, run, 2)
        run.send_signal(signal.SIGSTOP)
        page = subprocess.Popen([DRAPERY, "view", out, "--no-browser"], stdout=subprocess.PIPE, text=True)
        try:
            address = page.stdout.readline().split("/ ")[0]
            calls = {"/continue": lambda: run.send_signal(signal.SIGCONT), "/take_away": lambda: out.rename(folder / "away"),
                     "/bring_back": lambda: (folder / "away").rename(out)}  # fmt: skip
            # None at the border, where pixels mix with the ground.
            given = {"last": LAST, "vertices": [36, 40, 144, 250], "titles": TITLES}
            yield evaluate(address, LOOK, given, calls=calls), given["vertices"], out
        finally:
            page.kill()
            page.wait()
    finally:
        run.send_signal(signal.SIGCONT)
        run.kill()
        run.wait()


def linear(colour):
    """Light of a colour of sRGB, from 0 to 1."""
    c = np.asarray(colour, float)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def test_frames_arrive_while_the_run_goes_on(seen):
    early, late = seen[0]["early"], seen[0]["late"]
    assert early["frames"] < LAST and "running" in early["status"], early
    assert late["frames"] == LAST and f"frame {LAST} ({LAST} of {LAST}), done" in late["status"], late


def test_vertices_stand_where_the_official_library_reads_them(seen):
    page, vertices, out = seen
    positions = official(out / "square.abc")["world_positions"]
    for sample, shown in ((-1, page["strain"]["vertices"]), (0, page["first"])):
        assert np.array_equal([about["position"] for about in shown], positions[sample][vertices].astype(np.float32).astype(float))


def test_colours_are_those_of_a_known_strain(seen):
    strain = seen[0]["strain"]
    assert np.allclose([about["value"] for about in strain["vertices"]], STRAIN, atol=1e-5)
    # Without a material the scale ends at 10 %.
    expected = linear(VIRIDIS_AT_A_HALF)
    for about, pixel in zip(strain["vertices"], strain["pixels"], strict=True):
        assert np.allclose(about["colour"], expected, atol=0.01), about
        light = linear(np.array(pixel) / 255)
        assert np.allclose(light / light.sum(), expected / expected.sum(), atol=0.02), f"a pixel of {pixel}"
        assert not np.allclose(pixel, seen[0]["corner"], atol=20)
    assert "10 %" in strain["legend"] and "square: no limit known" in strain["legend"]


def test_thickness_and_contact_are_those_of_the_scene(seen):
    page = seen[0]
    assert np.allclose([about["value"] for about in page["thickness"]["vertices"]], 0.0015)
    assert "1.5 mm" in page["thickness"]["legend"]
    assert np.allclose([about["value"] for about in page["contact"]["vertices"]], HEIGHT / THICKNESS, rtol=1e-5)


def test_a_run_that_is_deleted_is_named_on_the_page(seen):
    assert "no manifest.json" in seen[0]["alarm"] and str(seen[2]) in seen[0]["alarm"]


def test_a_written_page_shows_the_run_without_it(seen, tmp_path):
    page = tmp_path / "page.html"
    done = subprocess.run([DRAPERY, "view", seen[2], "--page", page], capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
    text = text_of(page)
    assert f"frame 1 (1 of {LAST}), done" in text and 'id="alarm" role="alert" hidden' in text, text[-3000:]
