"""The scene file of Drapery as text, from plain descriptions; nothing here knows Blender.

Files are named relative to the folder of the scene, so that the folder can be moved to a farm.
"""

import json
import re
from dataclasses import dataclass, field
from fractions import Fraction

# Where the meshes and painted maps of a scene lie, from its folder.
MESHES = "meshes"
MAPS = "maps"
SCENE_FILE = "scene.toml"


@dataclass
class Map:
    """A quantity that is painted: the scene multiplies the garment's number by it."""

    quantity: str
    file: str


@dataclass
class Pin:
    """Vertices that are held: those where the numbers in `file` are above one half.

    `body` is the name of the body that they are bound to, or None if they stay where they start. `stiffness` in N/m makes
    springs of them, or None if they are held hard.
    """

    file: str
    body: str | None = None
    stiffness: float | None = None


@dataclass
class Body:
    """An animated mesh that cloth collides with; `thickness` in mm and `friction` are Drapery's own choice where None.

    `rest` is the pose in which the cloth settles, as a file and its frame, `body.abc@990`, or None. Bodies are `sized`
    that are so large or so small that the scene has to say that it is meant.
    """

    name: str
    file: str
    rest: str | None = None
    thickness: float | None = None
    friction: float | None = None
    sized: bool = False


@dataclass
class Garment:
    """A garment; `thickness` in mm, None for that of the material. `order` 1 is worn closest to the skin.

    Strains are shares of a length: at `extension` cloth that stiffens carries the load of its material, None for one that does not
    stiffen. `limited` says whether edges stop at a strain: at `limit`, None for that of the material. `ignores` is the kind, garment or
    body, and the name of the object that the garment passes through, or None.
    """

    name: str
    file: str
    material: str
    thickness: float | None = None
    order: int = 1
    pins: list = field(default_factory=list)
    maps: list = field(default_factory=list)
    extension: float | None = None
    limited: bool = False
    limit: float | None = None
    render_mesh: "RenderMesh | None" = None
    ignores: tuple | None = None


@dataclass
class RenderMesh:
    """The mesh that is rendered in the place of a garment; face sets with the names or patterns in `rigid` do not bend."""

    file: str
    rigid: list = field(default_factory=list)


@dataclass
class Seam:
    """Vertices that are sewn together, first with first, or each of the first side to the nearest of the second one.

    `sides` are names of garments. Times are in seconds since the first frame, None for the solver's own; `stiffness` in N/m.
    """

    sides: tuple
    nearest: bool
    stiffness: float
    start: float | None = None
    closed: float | None = None


# Drag of cloth in air, normal to it [kg/m³] and along it [N s/m³]: docs/howto/flag.md.
DRAG = 0.77, 0.02


@dataclass
class Shot:
    """Contents of a scene file beside bodies and garments.

    `rate` is in frames per second; `wind` is the velocity of the air [m/s], Y up, or None.
    """

    name: str
    first: int
    last: int
    rate: Fraction
    settle: int = 0
    blend: int = 0
    preset: str = "production"
    gravity: bool = True
    self_contact: bool = True
    wind: tuple | None = None


def plain_name(name):
    """A name as files and the scene take it: letters and digits of ASCII, `_`, `-` and `.`; never empty."""
    plain = re.sub(r"[^A-Za-z0-9_.-]", "_", name).lstrip(".")
    return plain[:200] or "_"


def names_taken_twice(names):
    """Groups of names that `plain_name` makes one of, also on disks that do not tell capitals from small letters."""
    groups = {}
    for name in names:
        groups.setdefault(plain_name(name).lower(), []).append(name)
    return [group for group in groups.values() if len(group) > 1]


def frame_rate(fps, base):
    """Blender's two numbers as a fraction: 24 and 1.001 are 24000/1001."""
    # The base is stored in single precision; all that cameras and broadcasters use has a small denominator.
    return (Fraction(fps).limit_denominator(1000) / Fraction(base).limit_denominator(1001)).limit_denominator(100_000)


def quoted(text):
    """A TOML string."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def number(value):
    """A number as TOML takes it, without the noise of single precision."""
    return f"{value:.6g}"


def scene_text(shot, bodies, garments, seams=()):
    """The scene file. Garments come in wearing order, the closest to the skin first; each seam with the vertices of its sides."""
    lines = [
        "# Written by the Drapery add-on for Blender. On a farm:",
        f"#   cd to this folder; drapery run {SCENE_FILE}",
        "drapery = 1",
        "",
        "[shot]",
        f"name = {quoted(shot.name)}",
        f'fps = "{shot.rate}"',
        f'frames = "{shot.first}-{shot.last}"',
        "",
    ]
    if shot.settle or shot.blend:
        lines += ["[shot.preroll]", f"settle = {shot.settle}", f"blend = {shot.blend}", ""]
    lines += ["[units]", 'length = "m"', 'up = "Y"', "", "[solver]", f"preset = {quoted(shot.preset)}", ""]
    lines += ["[output]", 'format = ["abc"]', ""]
    silenced = []
    if shot.gravity:
        lines += ["[gravity]", ""]
    else:
        silenced.append("no_gravity")
    if shot.wind is not None:
        normal, along = DRAG
        lines += ["[wind]", f"velocity = [{', '.join(map(number, shot.wind))}]", f'density = "{normal} kg/m³"']
        lines += [f'tangential = "{along} N s/m³"', ""]
    if shot.self_contact:
        lines += ["[self_repulsion]", "", "[self_collision]", ""]
    else:
        silenced.append("no_self_collision")
    if silenced:
        # Whoever clears a check box means it.
        lines += ["[check]", f"silence = [{', '.join(map(quoted, silenced))}]", ""]
    for body in bodies:
        lines += body_lines(body)
    for garment in sorted(garments, key=lambda garment: garment.order):
        lines += garment_lines(garment)
    for seam, vertices in seams:
        lines += seam_lines(seam, vertices)
    for pair in ignored_pairs(garments, shot.self_contact):
        lines += ["[[contact]]", f"between = [{', '.join(quoted('.'.join(side)) for side in pair)}]", "ignore = true", ""]
    return "\n".join(lines)


def ignored_pairs(garments, self_contact):
    """Pairs of objects that pass through each other, by kind and name, each once; garments do it anyway without self collision."""
    pairs = []
    for garment in garments:
        pair = (("garment", garment.name), garment.ignores)
        is_asked = garment.ignores is not None and (self_contact or garment.ignores[0] == "body")
        if is_asked and pair not in pairs and pair[::-1] not in pairs:
            pairs.append(pair)
    return pairs


def body_lines(body):
    lines = ["[[body]]", f"name = {quoted(body.name)}", f"file = {quoted(body.file)}"]
    if body.rest:
        lines.append(f"rest = {quoted(body.rest)}")
    if body.sized:
        lines.append('units = { length = "m", up = "Y" }')
    if body.thickness is not None:
        lines.append(f'thickness = "{number(body.thickness)} mm"')
    if body.friction is not None:
        lines.append(f"friction = {number(body.friction)}")
    return [*lines, ""]


def garment_lines(garment):
    lines = ["[[garment]]", f"name = {quoted(garment.name)}", f"rest = {quoted(garment.file)}"]
    lines.append(f"material = {quoted(garment.material)}")
    if garment.thickness is not None:
        lines.append(f'thickness = "{number(garment.thickness)} mm"')
    if garment.maps:
        pairs = [f"{painted.quantity} = {quoted('file:' + painted.file)}" for painted in garment.maps]
        lines.append(f"maps = {{ {', '.join(pairs)} }}")
    lines.append("")
    if garment.extension is not None:
        lines += ["[garment.stretch]", f"extension = {number(garment.extension)}", ""]
    if garment.limited:
        lines += ["[garment.strain_limit]", *([] if garment.limit is None else [f"limit = {number(garment.limit)}"]), ""]
    if garment.render_mesh:
        lines += ["[garment.render_mesh]", f"file = {quoted(garment.render_mesh.file)}"]
        if garment.render_mesh.rigid:
            lines.append(f"rigid = [{', '.join(map(quoted, garment.render_mesh.rigid))}]")
        lines.append("")
    for pin in garment.pins:
        lines += ["[[garment.pin]]", f"map = {quoted('file:' + pin.file)}"]
        lines.append(f"to = {quoted('body:' + pin.body if pin.body else 'start')}")
        if pin.stiffness is not None:
            lines += ['mode = "spring"', f'stiffness = "{number(pin.stiffness)} N/m"']
        lines.append("")
    return lines


def seam_lines(seam, vertices):
    lines = ["[[seam]]"]
    for key, name, numbers in zip(("from", "to"), seam.sides, vertices):
        lines.append(f"{key} = {{ garment = {quoted(name)}, vertices = {json.dumps(numbers)} }}")
    if seam.nearest:
        lines.append('pairing = "nearest"')
    lines.append(f'strength = "{number(seam.stiffness)} N/m"')
    if seam.start is not None:
        lines += [f'start = "{seam.start:.9g} s"', f'closed = "{seam.closed:.9g} s"']
    return [*lines, ""]


def object_at_line(text, line):
    """The name of the body or garment (of a seam the first one) whose table a line of a scene file (from 1) stands in, or None."""
    found = None
    for row in text.splitlines()[:line]:
        if re.match(r"\[(?!\[garment\.|garment\.)", row):
            found = None
        match = re.match(r'name = "(.*)"$|from = \{ garment = "(.*?)"', row)
        found = match[1] or match[2] if match else found
    if found is None:
        # The line may be the head of its table, before the name.
        rest = text.splitlines()[line - 1 : line + 1]
        head = len(rest) > 1 and rest[0] in ("[[body]]", "[[garment]]", "[[seam]]")
        match = re.match(r'name = "(.*)"$|from = \{ garment = "(.*?)"', rest[1]) if head else None
        found = (match[1] or match[2]) if match else None
    return found
