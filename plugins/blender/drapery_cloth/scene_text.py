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
    springs of them, or None if they are held hard. They are free after the time `until`, in seconds since the first frame.
    """

    file: str
    body: str | None = None
    stiffness: object = None
    until: float | None = None


@dataclass
class Body:
    """An animated mesh that cloth collides with; `thickness` in mm and `friction` are Drapery's own choice where None, and may be curves.

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
class Belt:
    """A belt that is a body of its own, around the body `around`; lengths in mm, `at` a point in m and `axis` a direction, Y up."""

    name: str
    around: str
    at: tuple
    axis: tuple
    width: float
    depth: float
    gap: float


@dataclass
class Elastic:
    """An elastic band along the edges between vertices where the numbers in `file` are above one half; numbers may be curves."""

    file: str
    stiffness: object
    rest_scale: object


@dataclass
class Garment:
    """A garment; `thickness` in mm, None for that of the material. `order` 1 is worn closest to the skin; it is
    the layer where garments differ in it.

    Strains are shares of a length: at `extension` cloth that stiffens carries the load of its material, None for one that does not
    stiffen. `limited` says whether edges stop at a strain: at `limit`, None for that of the material. `stretch` in N/m, `bending` in
    µN·m and `damping`, a ratio, are those of the material where None; `pressure` is None or a pair, its kind and the pascals.
    `rest_scale` is a share of the lengths at rest, or None. Numbers may be curves.
    """

    name: str
    file: str
    material: str
    thickness: object = None
    order: int = 1
    pins: list = field(default_factory=list)
    maps: list = field(default_factory=list)
    extension: float | None = None
    limited: bool = False
    limit: float | None = None
    render_mesh: "RenderMesh | None" = None
    stretch: object = None
    bending: object = None
    damping: float | None = None
    pressure: tuple | None = None
    rest_scale: object = None
    elastics: list = field(default_factory=list)
    parts: list = field(default_factory=list)


@dataclass
class Part:
    """A part of a garment, for rules of contact: vertices where the numbers in `file` are above one half."""

    name: str
    file: str


@dataclass
class Contact:
    """A rule of contact between two objects, each a kind, garment or body, a name, and for a part of a garment the part's name;
    `thickness` in mm. Numbers may be curves.
    """

    between: tuple
    ignore: bool = False
    friction: object = None
    thickness: object = None


@dataclass
class RenderMesh:
    """The mesh that is rendered in the place of a garment; face sets with the names or patterns in `rigid` do not bend."""

    file: str
    rigid: list = field(default_factory=list)


@dataclass
class Seam:
    """Vertices that are sewn together: `pairing` None for the first with the first, "nearest", or "surface".

    `sides` are names of garments. Times are in seconds since the first frame, None for the solver's own; `stiffness` in N/m and
    `break_force` in N, None for a seam that holds, may be curves. With `keep_gap` the vertices stay as far apart as they start.
    """

    sides: tuple
    pairing: str | None
    stiffness: object
    start: float | None = None
    closed: float | None = None
    opens: float | None = None
    opened: float | None = None
    zip: bool = False
    keep_gap: bool = False
    break_force: object = None


@dataclass
class Shot:
    """Contents of a scene file beside bodies and garments.

    `rate` is in frames per second; `gravity` is an acceleration [m/s²] and `wind` the velocity of the air [m/s], Y up, or None; `drag` of
    cloth in it is normal to it [kg/m³] and along it [N s/m³]. `air_drag` is a rate [1/s] or None. Numbers may be curves, as lists of
    pairs of a frame and a value.
    """

    name: str
    first: int
    last: int
    rate: Fraction
    settle: int = 0
    blend: int = 0
    preset: str = "auto"
    gravity: object = (0.0, -9.81, 0.0)
    self_contact: bool = True
    wind: object = None
    drag: tuple = (0.77, 0.02)
    air_drag: object = None
    self_friction: object = 0.4
    formats: tuple = ("abc",)
    attributes: tuple = ()


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
    # Adding zero makes -0 a 0.
    return f"{value + 0.0:.6g}"


def quantity(value, unit="", factor=1.0):
    """A number with its unit, a list of three, or a curve of either, as TOML; a factor brings it to the unit."""
    if isinstance(value, list):
        return f"[{', '.join(f'[{frame}, {quantity(each, unit, factor)}]' for frame, each in value)}]"
    if isinstance(value, tuple):
        return f"[{', '.join(number(factor * each) for each in value)}]"
    text = number(factor * value)
    return f'"{text} {unit}"' if unit else text


def scene_text(shot, bodies, garments, seams=(), contacts=(), belts=()):
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
    key = "integrator" if shot.preset == "auto" else "preset"
    lines += ["[units]", 'length = "m"', 'up = "Y"', "", "[solver]", f"{key} = {quoted(shot.preset)}", ""]
    lines += ["[output]", f"format = [{', '.join(map(quoted, shot.formats))}]"]
    if shot.attributes:
        lines.append(f"attributes = [{', '.join(map(quoted, shot.attributes))}]")
    lines += ["", *effect_lines(shot)]
    for body in bodies:
        lines += body_lines(body)
    for belt in belts:
        lines += belt_lines(belt)
    has_layers = len({garment.order for garment in garments}) > 1
    # Without self collision garments pass through each other anyway.
    contacts = [contact for contact in contacts if shot.self_contact or contact.between[1][0] == "body"]
    in_contact = {side[1:] for contact in contacts for side in contact.between}
    for garment in sorted(garments, key=lambda garment: garment.order):
        parts = [part for part in garment.parts if (garment.name, part.name) in in_contact]
        lines += garment_lines(garment, has_layers, parts)
    for seam, vertices in seams:
        lines += seam_lines(seam, vertices)
    for contact in contacts:
        lines += contact_lines(contact)
    return "\n".join(lines)


def effect_lines(shot):
    """The effects of the whole scene; boxes that are cleared on purpose give no warnings."""
    lines, silenced = [], []
    if shot.gravity is not None:
        lines += ["[gravity]", f"acceleration = {quantity(shot.gravity)}", ""]
    else:
        silenced.append("no_gravity")
    if shot.wind is not None:
        normal, along = shot.drag
        lines += ["[wind]", f"velocity = {quantity(shot.wind)}", f"density = {quantity(normal, 'kg/m³')}"]
        lines += [f"tangential = {quantity(along, 'N s/m³')}", ""]
    if shot.air_drag is not None:
        lines += ["[ether_drag]", f"rate = {quantity(shot.air_drag)}", ""]
    if shot.self_contact:
        lines += ["[self_repulsion]", f"friction = {quantity(shot.self_friction)}", "", "[self_collision]", ""]
    else:
        silenced.append("no_self_collision")
    if silenced:
        lines += ["[check]", f"silence = [{', '.join(map(quoted, silenced))}]", ""]
    return lines


def contact_lines(contact):
    lines = ["[[contact]]", f"between = [{', '.join(quoted('.'.join(side)) for side in contact.between)}]"]
    if contact.ignore:
        return [*lines, "ignore = true", ""]
    if contact.friction is not None:
        lines.append(f"friction = {quantity(contact.friction)}")
    if contact.thickness is not None:
        lines.append(f"thickness = {quantity(contact.thickness, 'mm')}")
    return [*lines, ""]


def body_lines(body):
    lines = ["[[body]]", f"name = {quoted(body.name)}", f"file = {quoted(body.file)}"]
    if body.rest:
        lines.append(f"rest = {quoted(body.rest)}")
    if body.sized:
        lines.append('units = { length = "m", up = "Y" }')
    if body.thickness is not None:
        lines.append(f"thickness = {quantity(body.thickness, 'mm')}")
    if body.friction is not None:
        lines.append(f"friction = {quantity(body.friction)}")
    return [*lines, ""]


def belt_lines(belt):
    at, axis = (", ".join(map(number, vector)) for vector in (belt.at, belt.axis))
    lengths = ", ".join(f'{key} = "{number(getattr(belt, key))} mm"' for key in ("width", "depth", "gap"))
    return ["[[body]]", f"name = {quoted(belt.name)}",
            f"belt = {{ around = {quoted(belt.around)}, at = [{at}], axis = [{axis}], {lengths} }}", ""]


def garment_lines(garment, has_layer=False, parts=()):
    lines = ["[[garment]]", f"name = {quoted(garment.name)}", f"rest = {quoted(garment.file)}"]
    lines.append(f"material = {quoted(garment.material)}")
    if has_layer:
        lines.append(f"layer = {garment.order}")
    if garment.thickness is not None:
        lines.append(f"thickness = {quantity(garment.thickness, 'mm')}")
    if garment.rest_scale is not None:
        lines.append(f"rest_scale = {quantity(garment.rest_scale)}")
    if garment.maps:
        pairs = [f"{painted.quantity} = {quoted('file:' + painted.file)}" for painted in garment.maps]
        lines.append(f"maps = {{ {', '.join(pairs)} }}")
    lines.append("")
    damping = [] if garment.damping is None else [f"damping_ratio = {number(garment.damping)}"]
    stretch = [] if garment.extension is None else [f"extension = {number(garment.extension)}"]
    if garment.stretch is not None:
        stretch.append(f"stiffness = {quantity(garment.stretch, 'N/m')}")
    bending = [] if garment.bending is None else [f"stiffness = {quantity(garment.bending, 'µN·m')}"]
    for table, own in (("stretch", stretch + damping), ("dihedral_bending", bending + damping)):
        if own:
            lines += [f"[garment.{table}]", *own, ""]
    if garment.pressure is not None:
        kind, pascals = garment.pressure
        lines += ["[garment.pressure]", f"overpressure = {quantity(pascals, 'Pa')}"]
        lines += {"CLOSED": [], "OPEN": ["open = true"], "GAS": ["gas = true"]}[kind] + [""]
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
            lines += ['mode = "spring"', f"stiffness = {quantity(pin.stiffness, 'N/m')}"]
        if pin.until is not None:
            lines.append(f'until = "{pin.until:.9g} s"')
        lines.append("")
    for part in parts:
        lines += ["[[garment.part]]", f"name = {quoted(part.name)}", f"map = {quoted('file:' + part.file)}", ""]
    for band in garment.elastics:
        lines += ["[[garment.elastic]]", f"map = {quoted('file:' + band.file)}", f"stiffness = {quantity(band.stiffness, 'N')}"]
        lines += [f"rest_scale = {quantity(band.rest_scale)}", ""]
    return lines


def seam_lines(seam, vertices):
    lines = ["[[seam]]"]
    for key, name, numbers in zip(("from", "to"), seam.sides, vertices):
        named = "" if numbers is None else f", vertices = {json.dumps(numbers)}"
        lines.append(f"{key} = {{ garment = {quoted(name)}{named} }}")
    if seam.pairing:
        lines.append(f"pairing = {quoted(seam.pairing)}")
    lines.append(f"strength = {quantity(seam.stiffness, 'N/m')}")
    if seam.keep_gap:
        lines.append("keep_gap = true")
    if seam.break_force is not None:
        lines.append(f"break_force = {quantity(seam.break_force, 'N')}")
    if seam.start is not None:
        lines += [f'start = "{seam.start:.9g} s"', f'closed = "{seam.closed:.9g} s"']
    if seam.opens is not None:
        lines += [f'opens = "{seam.opens:.9g} s"', f'opened = "{seam.opened:.9g} s"']
    if seam.zip:
        lines.append("zip = true")
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
