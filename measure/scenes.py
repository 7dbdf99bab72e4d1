"""Scenes that are measured: samples and tests in words that earlier builds know, and scenes made for measuring."""

import math
import re

from measure.runs import ROOT, assets, measured_folder

SAMPLES, TESTS, HOWTO = ROOT / "sample_assets" / "scenes", ROOT / "tests" / "scenes", ROOT / "sample_assets" / "howto"
# The reference data of the dressed woman, which not every checkout has.
WOMAN_DATA = ROOT.parent / "shared" / "data" / "woman_walk_dance"

HEAD = """drapery = 1
[shot]
fps = "24"
frames = "0-240"
[self_repulsion]
[self_collision]
"""
# A square metre of cloth of 1000 N/m and 10 µN m.
SHEET = """[[garment]]
name = "sheet"
panel = {{ resolution = {cells}, side = 1.0, aspect = 1.0, center = [0, {height}, 0] }}
density = "200 g/m²"
[garment.stretch]
stiffness = "1000 N/m"
[garment.dihedral_bending]
stiffness = "10 µN·m"
"""
# The cloth starts a centimetre above the ball.
BALL = """[gravity]
[[body]]
name = "ground"
shape = { half_space = {} }
[[body]]
name = "ball"
shape = { sphere = { radius = 0.25 } }
position = [0, 0.25, 0]
friction = 0.3
"""


def without_tables(text, tables):
    """A scene without some of its top tables."""
    kept, inside = [], False
    for line in text.splitlines(keepends=True):
        if line.startswith("["):
            inside = line.split("#")[0].strip().strip("[]") in tables
        if not inside:
            kept.append(line)
    return "".join(kept)


def sample(name, folder=SAMPLES, **parameters):
    """A scene without its checks, which earlier builds do not know, with values of its parameters."""
    return with_parameters((folder / f"{name}.toml").read_text(), **parameters)


def with_parameters(text, **parameters):
    text = without_tables(text, ["check"])
    for name, value in parameters.items():
        written = f'"{value}"' if not isinstance(value, (int, float)) else value
        text, count = re.subn(rf"^{name} = .*$", f"{name} = {written}", text, flags=re.MULTILINE)
        assert count == 1, name
    return text


def hung(cells):
    return HEAD + "[gravity]\n" + SHEET.format(cells=cells, height=1.5) + '[[garment.pin]]\ncorners = ["i0j0", "inj0"]\n'


def draped(cells):
    return HEAD + BALL + SHEET.format(cells=cells, height=0.52)


def twisted(cells, turns=3.0, seconds=2.0):
    """Two opposite edges turn against each other without gravity, in all by `turns`, while they come 40 cm closer."""
    text = HEAD + SHEET.format(cells=cells, height=1.0)
    times = [seconds * k / 96 for k in range(97)]
    for side in (-1, 1):
        for row in range(cells + 1):
            radius = row / cells - 0.5
            angle = [side * math.pi * turns * t / seconds for t in times]
            path = [[round(t, 6), [round(-side * 0.2 * t / seconds, 6), round(radius * math.sin(a), 6), round(radius * (math.cos(a) - 1), 6)]]
                    for t, a in zip(times, angle)]
            text += f"[[garment.pin]]\nnodes = [[{(side + 1) // 2}, {row / cells:.6f}]]\npath = {path}\n"
    return text


def fifty_sheets():
    """H28 of the hard cases in its full size: sheets of 60 cm that drop on a floor, each turned a little."""
    text = HEAD + '[gravity]\n[[body]]\nname = "floor"\nshape = { half_space = {} }\nfriction = 0.5\nthickness = 0.001\n'
    for layer in range(50):
        turn = f"rotation = {{ axis = [0, 1, 0], degrees = {math.degrees(0.05 * layer):.6f} }}"
        text += f'[[garment]]\nname = "layer{layer}"\ndensity = 0.2\n'
        text += f"panel = {{ resolution = 20, side = 0.6, aspect = 1.0, center = [0, {0.05 + 0.004 * layer:.3f}, 0], {turn} }}\n"
        text += "[garment.stretch]\nstiffness = 20\n[garment.bending]\nstiffness = 1\n"
    return text


def layers_on_a_ball():
    return without_tables((TESTS / "layers_on_a_ball.toml").read_text(), ["solver"])


def woman(quality):
    """The dressed woman in fine garments, or in light ones."""
    name = "" if quality == "fine" else "_lowres"
    return with_parameters((TESTS / "dressed_woman.toml").read_text(), data=WOMAN_DATA, quality=name)


def mannequin(garments="light"):
    return sample("dressed_mannequin", assets=assets("mannequin", "--garments", garments))


def cape_at_rest():
    """The cape of the how-to page on a body of one pose. It swings for some ten seconds, and has 1e-5 J of 1e-2 J after twelve."""
    text = (HOWTO / "cape.toml").read_text().replace('frames = "1001-1025"', 'frames = "1001-1289"')
    return with_parameters(text, assets=assets("mannequin", "--frames", "1001-1001"))


def poncho():
    """A square of wool with a hole for the neck, 5,208 triangles, around the neck of the walking mannequin."""
    cells, hole, size, height = 52, 10, 0.022, 1.49
    inside = range((cells - hole) // 2, (cells + hole) // 2)
    lines = [f"v {(i - cells / 2) * size:.4f} {height} {(k - cells / 2) * size:.4f}" for k in range(cells + 1) for i in range(cells + 1)]
    corner = lambda i, k: 1 + i + (cells + 1) * k
    used, faces = {}, []
    for k in range(cells):
        for i in range(cells):
            if i in inside and k in inside:
                continue
            a, b, c, d = corner(i, k), corner(i + 1, k), corner(i + 1, k + 1), corner(i, k + 1)
            faces += [(a, c, b), (a, d, c)] if (i + k) % 2 == 0 else [(a, d, b), (b, d, c)]
    for face in faces:
        for point in face:
            used.setdefault(point, len(used) + 1)
    points = [lines[point - 1] for point in used]
    mesh = measured_folder() / "poncho.obj"
    mesh.write_text("\n".join(points + ["f " + " ".join(str(used[point]) for point in face) for face in faces]) + "\n")
    text = sample("dressed_mannequin", assets=assets("mannequin", "--frames", "1001-1041"))
    assert 'frames = "1001-1097"' in text
    text = text.replace('frames = "1001-1097"', 'frames = "1001-1041"')
    return text.partition("[[garment]]")[0] + f'[[garment]]\nname = "poncho"\nrest = "{mesh}"\nmaterial = "wool_suiting"\n'


def on_the_ball(resolution, fps, contact=True):
    """The spinning ball with the cloth just above it and on its way down: contact begins in the first frame. Or with nothing to touch."""
    text = sample("spinning_ball", resolution=resolution).replace('fps = "60"', f'fps = "{fps}"')
    if not contact:
        return without_tables(text, ["self_repulsion", "self_collision", "body"])
    assert "center = [0, 0.56, 0]" in text
    text = text.replace("center = [0, 0.56, 0]", "center = [0, 0.5503, 0]")
    return text.replace('name = "cloth"', 'name = "cloth"\nvelocity = [0, -1, 0]')


def film():
    """Four layers of four metres by four, one sheet of two million triangles of 8 mm, that drop by a centimetre on a ball of two metres."""
    text = without_tables((TESTS / "folded_on_a_ball.toml").read_text(), ["solver"])
    cloth = 'density = "300 g/m²"\n[garment.stretch]\nstiffness = "50 N/m"\n[garment.dihedral_bending]\nstiffness = "10 µN·m"\n'
    changes = {'fps = "480"': 'fps = "24"', 'frames = "0-12"': 'frames = "0-24"', "radius = 0.2": "radius = 1.0", "side = 0.4": "side = 4.0",
               "center = [0, 0.704, 0]": "center = [0, 1.51, 0]", "gap = 0.002": "gap = 0.004", "velocity = [0, -3, 0]\n": "",
               'material = "silk_light"\n': cloth}
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return with_parameters(text, resolution=500)


def folded_stack():
    return (TESTS / "folded_stack.toml").read_text()
