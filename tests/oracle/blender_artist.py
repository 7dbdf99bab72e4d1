"""Work of artists in a session of Blender beside the straight path: seams, and all features of scenes of real work.

    python blender_artist.py -- ACT FOLDER ZIP DRAPERY EXPORTER            (Blender as a Python module)
    blender --background --factory-startup --python blender_artist.py -- ACT …

Installs the zip, does an act (a function below) in FOLDER, and writes the act's answer to FOLDER/ACT.json. EXPORTER stands for a
Blender with Alembic, or is "none". Units are metres, and the cloth of all acts is small, so that each takes seconds.
"""

import json
import math
import sys
import traceback
from pathlib import Path

import bpy

# The module of Blender brings it.
import bmesh  # isort: skip

ACT, FOLDER, ZIP, DRAPERY, EXPORTER = sys.argv[sys.argv.index("--") + 1 :]
FOLDER = Path(FOLDER)
EXTENSIONS = bpy.app.version >= (4, 2, 0)
MODULE = "bl_ext.user_default.drapery_cloth" if EXTENSIONS else "drapery_cloth"
ROWS, COLUMNS, CELL = 8, 6, 0.025


def install():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if EXTENSIONS:
        bpy.ops.extensions.package_install_files(filepath=ZIP, repo="user_default", enable_on_install=True)
    else:
        bpy.ops.preferences.addon_install(filepath=ZIP)
        bpy.ops.preferences.addon_enable(module=MODULE)
    set_preferences()


def set_preferences():
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.executable, preferences.exporter = DRAPERY, "" if EXPORTER == "none" else EXPORTER


def part(name):
    return sys.modules[f"{MODULE}.{name}"]


def view():
    return part("state").work().view(bpy.context.scene)


def press(button, **options):
    (result,) = getattr(bpy.ops.scene, f"drapery_{button}")(wait=True, **options)
    return [result, *(f"{found.object}|{found.frame}|{found.element}|{found.index}|{found.message}|{found.help}" for found in view().problems)]


def save(name="shot.blend"):
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / name))


def undo_step(message):
    bpy.ops.ed.undo_push(message=message)


def chosen(*things):
    """Selects objects; the first one is the active one."""
    bpy.context.view_layer.update()
    for other in bpy.context.view_layer.objects:
        other.select_set(other in things)
    bpy.context.view_layer.objects.active = things[0]


def mark(role, *things):
    chosen(*things)
    bpy.ops.object.drapery_mark(role=role)


def mesh_of(name, points, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.update()
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def group(thing, name, vertices, weight=1.0):
    thing.vertex_groups.new(name=name).add(list(vertices), weight, "REPLACE")


def panel(name, corner=(0.0, 0.0, 1.0), columns=COLUMNS, rows=ROWS, backwards=False):
    """A standing sheet in the plane of x and z, with groups "left", "right" and "top"; `backwards` counts vertices from its other end."""
    places = [(corner[0] + CELL * i, corner[1], corner[2] + CELL * j) for j in range(rows + 1) for i in range(columns + 1)]
    number = {key: index for index, key in enumerate((i, j) for j in range(rows + 1) for i in range(columns + 1))}
    if backwards:
        places.reverse()
        number = {key: len(places) - 1 - index for key, index in number.items()}
    around = ((0, 0), (1, 0), (1, 1), (0, 1))
    faces = [[number[i + a, j + b] for a, b in around] for j in range(rows) for i in range(columns)]
    thing = mesh_of(name, places, faces)
    group(thing, "left", (number[0, j] for j in range(rows + 1)))
    group(thing, "right", (number[columns, j] for j in range(rows + 1)))
    group(thing, "top", (number[i, rows] for i in range(columns + 1)))
    return thing


def shot(first=1, last=20, gravity=True):
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = first, last
    scene.render.fps, scene.render.fps_base = 24, 1.0
    scene.drapery.gravity, scene.drapery.preset, scene.drapery.folder = gravity, "preview", "//drapery/"
    scene.frame_set(first)
    return scene


def sew(thing, own, other, its, **settings):
    chosen(thing)
    bpy.ops.object.drapery_seam_add()
    seam = thing.drapery.seams[-1]
    seam.group, seam.other, seam.other_group = own, other, its
    for key, value in settings.items():
        setattr(seam, key, value)
    return seam


def open_tube(name, gap=0.4, radius=0.1, around=24, rows=4):
    """An almost closed tube around z; its rims, which a gap of an angle parts, are the groups "begin" and "end"."""
    turns = [gap / 2 + (2 * math.pi - gap) * i / around for i in range(around + 1)]
    places = [(2 + radius * math.cos(a), radius * math.sin(a), 1 + CELL * j) for j in range(rows + 1) for a in turns]
    row = around + 1
    faces = [(j * row + i, j * row + i + 1, (j + 1) * row + i + 1, (j + 1) * row + i) for j in range(rows) for i in range(around)]
    thing = mesh_of(name, places, faces)
    group(thing, "begin", (j * row for j in range(rows + 1)))
    group(thing, "end", (j * row + around for j in range(rows + 1)))
    return thing


def rows_of(thing):
    return [[seam.group, seam.other and seam.other.name, seam.other_group] for seam in thing.drapery.seams]


def sewn_panels():
    front = panel("front")
    back = panel("bäck", (COLUMNS * CELL + 0.05, 0.0, 1.0), backwards=True)
    mark("GARMENT", front, back)
    return front, back


def seams():
    """Two garments, and two rims of a third, are sewn and simulated."""
    answer = {}
    shot(gravity=False)
    front, back = sewn_panels()
    tube = open_tube("tube")
    mark("GARMENT", tube)
    save()
    undo_step("before")
    # With the other panel selected too, it is the other side; the active groups are taken.
    front.vertex_groups.active_index = front.vertex_groups["right"].index
    back.vertex_groups.active_index = back.vertex_groups["left"].index
    chosen(front, back)
    bpy.ops.object.drapery_seam_add()
    undo_step("seam")
    answer["added"] = rows_of(front)
    seam = front.drapery.seams[0]
    answer["frames"] = [seam.start, seam.closed]
    bpy.ops.ed.undo()
    answer["undone"] = rows_of(bpy.data.objects["front"])
    bpy.ops.ed.redo()
    answer["redone"] = rows_of(bpy.data.objects["front"])
    front, back, tube = (bpy.data.objects[name] for name in ("front", "bäck", "tube"))
    seam = front.drapery.seams[0]
    seam.own_closing, seam.start, seam.closed = True, 3, 13
    seam.own_opening, seam.opens, seam.opened = True, 97, 121
    # A tube to itself, at once, to the nearest.
    sew(tube, "begin", tube, "end", pairing="NEAREST", own_closing=True, start=1, closed=9, stiffness=250.0)
    sew(tube, "end", tube, "begin")
    bpy.ops.object.drapery_remove(rows="seams", index=1)
    answer["removed"] = rows_of(tube)
    # Pointers follow names.
    back.name = "back \"ü\""
    save()
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "shot.blend"))
    answer["opened"] = [rows_of(bpy.data.objects["front"]), rows_of(bpy.data.objects["tube"])]
    answer["simulated"] = press("simulate")
    front, back, tube = (bpy.data.objects[name] for name in ("front", "back \"ü\"", "tube"))
    # Copies are sewn to copies, where both were copied, and to what is left otherwise.
    chosen(front, back, tube)
    bpy.ops.object.duplicate()
    copies = {thing.name.split(".")[0]: thing for thing in bpy.context.selected_objects}
    answer["copies"] = [rows_of(copies["front"]), rows_of(copies["tube"])]
    chosen(front)
    bpy.ops.object.duplicate()
    answer["copy"] = rows_of(bpy.context.object)
    answer["copied_alone"] = rows_of(tube.copy())
    return answer


def joins():
    """A tube in an elastic band under a belt around a column, shrinking; a patch on it that is sewn to its surface."""
    shot(1, 12, gravity=False)
    column, tube = ball("column", (1.0, 0.0, 1.0), 0.07), panel_tube("tube", 0.95)
    patch = panel("patch", (0.95, -0.106, 0.97), columns=4, rows=3)
    mark("BODY", column)
    mark("GARMENT", tube, patch)
    whole = len(tube.data.vertices)
    rows = sorted({round(vertex.co.z, 6) for vertex in tube.data.vertices})
    group(tube, "waist", (index for index in range(whole) if round(tube.data.vertices[index].co.z, 6) == rows[-1]))
    chosen(tube)
    bpy.ops.object.drapery_elastic_add()
    band = tube.drapery.elastics[0]
    band.group, band.stiffness = "waist", 12.0
    for frame, relaxed in ((1, 100.0), (9, 80.0)):
        band.relaxed = relaxed
        band.keyframe_insert("relaxed", frame=frame)
    tube.drapery.own_rest_scale, tube.drapery.rest_scale = True, 95.0
    sew(patch, "top", tube, "", pairing="SURFACE", keep_gap=True, breaks=True, break_force=3.0, stiffness=150.0)
    chosen(column)
    bpy.ops.object.drapery_belt_add()
    belt = column.drapery.belts[0]
    belt.place.name, belt.width, belt.gap = "girdle", 20.0, 60.0
    save()
    answer = {"simulated": press("simulate"), "scene": (FOLDER / "drapery" / "scene.toml").read_text()}
    band.group = ""
    answer["no_group"] = press("check")
    band.group, belt.place = "waist", None
    answer["no_place"] = press("check")
    chosen(column)
    bpy.ops.object.drapery_remove(rows="belts", index=0)
    patch.drapery.seams[0].other = patch
    answer["own_surface"] = press("check")
    return answer


def bad_seams():
    """Sets up faulty seams, one after the other; returns the problems that `check` finds in each."""
    answer = {}
    shot()
    front, back = sewn_panels()
    other = panel("other", (0, 1, 1), rows=ROWS - 2)
    save()
    seam = sew(front, "right", back, "left")
    seam.other = None
    answer["no_garment"] = press("check")
    seam.other = other
    answer["not_marked"] = press("check")
    seam.other = front
    seam.other_group = "right"
    answer["itself"] = press("check")
    seam.other_group = ""
    answer["no_group"] = press("check")
    seam.group = ""
    answer["no_own_group"] = press("check")
    seam.group, seam.other, seam.other_group, seam.own_closing, seam.start, seam.closed = "right", back, "left", True, 9, 8
    answer["times"] = press("check")
    seam.own_closing, seam.own_opening, seam.opens, seam.opened = False, True, 9, 8
    answer["opening"] = press("check")
    seam.own_opening, seam.zip, seam.pairing = False, True, "NEAREST"
    answer["zip"] = press("check")
    seam.zip, seam.pairing = False, "LINE"
    sew(back, "left", front, "right")
    answer["twice"] = press("check")
    bpy.ops.object.drapery_remove(rows="seams", index=0)
    seam = front.drapery.seams[0]
    seam.other_group = "cuff"
    answer["missing"] = press("check")
    group(back, "cuff", [0], 0.5)
    answer["light"] = press("check")
    mark("GARMENT", other)
    seam.other, seam.other_group = other, "left"
    answer["counts"] = press("check")
    # Nearest takes any numbers.
    seam.pairing = "NEAREST"
    answer["counts_nearest"] = press("check")[0]
    group(other, "pieces", [0, 1, 5])
    group(other, "crossing", [0, 1, 2, COLUMNS + 2])
    seam.pairing, seam.other_group = "LINE", "pieces"
    answer["pieces"] = press("check")
    seam.other_group = "crossing"
    answer["crossing"] = press("check")
    # Left and bottom meet in a corner, which Nearest would sew to itself.
    group(other, "bottom", range(COLUMNS + 1))
    front.drapery.seams.clear()
    seam = sew(other, "bottom", other, "left", pairing="NEAREST")
    answer["shared"] = press("check")
    group(other, "square", [0, 1, COLUMNS + 1, COLUMNS + 2])
    group(other, "four", [5 * (COLUMNS + 1) + i for i in range(4)])
    seam.pairing, seam.group, seam.other_group = "LINE", "square", "four"
    answer["ring"] = press("check")
    group(other, "also four", [5 * (COLUMNS + 1) + i for i in range(4)])
    seam.group, seam.other_group = "four", "also four"
    answer["same"] = press("check")
    # Deleted by the artist it stays with the seam; by a script it is gone.
    sew(front, "right", back, "left")
    other.drapery.seams.clear()
    mark("NONE", other)
    chosen(back)
    bpy.ops.object.delete()
    answer["deleted"] = press("check")
    bpy.data.objects.remove(back)
    answer["removed"] = press("check")
    return answer


def darts():
    """Two edges of one panel that meet in a corner, and rings."""
    answer = {}
    shot(gravity=False)
    square = panel("square", rows=COLUMNS)
    row = COLUMNS + 1
    group(square, "bottom", range(row))
    low, high = panel_tube("low", 1.0), panel_tube("high", 1.2, turned=5)
    mark("GARMENT", square, low, high)
    save()
    sew(square, "left", square, "bottom", own_closing=True, start=1, closed=240, zip=True)
    sew(low, "upper", high, "lower", own_closing=True, start=1, closed=13)
    answer["simulated"] = press("simulate")
    answer["scene"] = (FOLDER / "drapery" / "scene.toml").read_text()
    return answer


def panel_tube(name, bottom, turned=0, around=20, rows=4):
    """A closed tube around z at (1, 0); vertices of each row begin `turned` places further."""
    turns = [2 * math.pi * (i + turned) / around for i in range(around)]
    places = [(1 + 0.1 * math.cos(a), 0.1 * math.sin(a), bottom + CELL * j) for j in range(rows + 1) for a in turns]
    faces = [(j * around + i, j * around + (i + 1) % around, (j + 1) * around + (i + 1) % around, (j + 1) * around + i)
             for j in range(rows) for i in range(around)]  # fmt: skip
    thing = mesh_of(name, places, faces)
    group(thing, "lower", range(around))
    group(thing, "upper", range(rows * around, (rows + 1) * around))
    return thing


def world(thing, frame):
    """Positions of the vertices of an object in the world at a frame, as evaluated."""
    bpy.context.scene.frame_set(frame)
    shown = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [list(shown.matrix_world @ vertex.co) for vertex in shown.data.vertices]


def ball(name, centre, radius=0.3):
    mesh = bpy.data.meshes.new(name)
    rounded = bmesh.new()
    bmesh.ops.create_uvsphere(rounded, u_segments=16, v_segments=8, radius=radius)
    rounded.to_mesh(mesh)
    rounded.free()
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    thing.location = centre
    return thing


def collection(name, thing):
    """A collection that has an object alone."""
    found = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(found)
    found.objects.link(thing)
    bpy.context.scene.collection.objects.unlink(thing)
    return found


def odd_garments():
    """Garments that are mirrored, below a scaled parent, stretched, of one mesh, with shape keys, by name."""
    mirrored = panel('a/b "c" $ 日本', (0, 0, 1))
    mirrored.scale = (-1, 1, 1)
    empty = bpy.data.objects.new("empty", None)
    bpy.context.scene.collection.objects.link(empty)
    empty.scale, empty.rotation_euler = (3, -1, 0.4), (0.5, 0.4, 0.3)
    child = panel("child", (0, 1, 1))
    child.parent, child.rotation_euler = empty, (math.pi / 2, 0, 0)
    plain = panel("plain", (0, 2, 1))
    twin = plain.copy()
    bpy.context.scene.collection.objects.link(twin)
    twin.name, twin.location, twin.scale = "twin", (2, 2, 0), (2, 0.5, 1.5)
    keyed = panel("keyed", (0, 4, 1))
    keyed.shape_key_add(name="Basis")
    wide = keyed.shape_key_add(name="wide")
    for entry in wide.data:
        entry.co.x *= 1.5
    wide.value = 0.5
    return [mirrored, child, plain, twin, keyed, panel("hidden", (0, 5, 1)), panel("edited", (0, 6, 1))]


def odd_scene():
    """A file with all that is unusual and allowed: one simulation of it, and the caches on the objects."""
    answer = {}
    scene, first, last = shot(), -3, 2
    scene.render.fps, scene.render.fps_base, scene.frame_step = 30, 1.001, 2
    scene.drapery.own_range, scene.drapery.first, scene.drapery.last = True, first, last
    scene.drapery.folder = ""
    things = odd_garments()
    mark("GARMENT", *things)
    hidden, edited = things[-2:]
    # Below the plain one, inside out by its scale, and hidden while it moves.
    body = ball("ball", (0.0, 2.0, 0.65))
    body.scale = (1, -1, 1)
    mark("BODY", body)
    body.keyframe_insert("location", frame=first)
    body.location.x += 0.05
    body.keyframe_insert("location", frame=last)
    for path in ("hide_render", "hide_viewport"):
        for frame, value in ((first, False), (0, True)):
            setattr(body, path, value)
            body.keyframe_insert(path, frame=frame)
    answer["starts"] = {part("scene_text").plain_name(thing.name): world(thing, first) for thing in things}
    hidden.hide_set(True)
    collection("hidden", hidden).hide_viewport = True
    chosen(edited)
    bpy.ops.object.mode_set(mode="EDIT")
    mesh = bmesh.from_edit_mesh(edited.data)
    mesh.verts.ensure_lookup_table()
    mesh.verts[3].co.y += 0.01
    bmesh.update_edit_mesh(edited.data)
    answer["starts"]["edited"][3][1] += 0.01
    place = FOLDER / 'pa th $x "q" #1 ü %20'
    place.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(place / "sh ot$.blend"))
    answer["simulated"], answer["mode"] = press("simulate"), bpy.context.mode
    bpy.ops.object.mode_set(mode="OBJECT")
    answer["run"] = str(part("collect").run_folder(scene))
    if bpy.app.build_options.alembic:
        answer["loaded"] = sorted(bpy.ops.scene.drapery_load())
        bpy.data.collections["hidden"].hide_viewport = False
        hidden.hide_set(False)
        answer["shown"] = {part("scene_text").plain_name(thing.name): [world(thing, frame) for frame in range(first, last + 1)]
                           for thing in things}
    return answer


def hidden_bodies():
    """Whatever hides a body, it is collided with, unless the view layer does not have it."""
    answer = {}
    shot()
    body = ball("body", (0, 1, 1))
    mark("BODY", body)
    mark("GARMENT", panel("cloth"))
    save()
    holder = collection("holder", body)
    layer = bpy.context.view_layer.layer_collection.children["holder"]
    for what, key in ((holder, "hide_viewport"), (holder, "hide_render"), (holder, "hide_select"), (layer, "hide_viewport"),
                      (body, "hide_render"), (body, "hide_viewport"), (layer, "exclude")):  # fmt: skip
        setattr(what, key, True)
        answer[f"{type(what).__name__}.{key}"] = press("check")
        setattr(what, key, False)
    return answer


def warned():
    """Sets up modifiers, times and sizes that cause a warning or an error; returns the problems found in each."""
    answer = {}
    scene = shot()
    cloth = panel("cloth")
    mark("GARMENT", cloth)
    save()
    cloth.modifiers.new("Mirror", "MIRROR")
    answer["mirror"] = press("check")
    cloth.drapery.simulated = "ALL"
    answer["mirror_too"] = press("check")
    cloth.modifiers.clear()
    scene.render.frame_map_new = 200
    answer["stretched"] = press("check")
    scene.render.frame_map_new = 100
    empty = bpy.data.objects.new("empty", None)
    scene.collection.objects.link(empty)
    # Turned, with a parent that is scaled along one axis from frame 3 on.
    cloth.parent = empty
    below = ball("below", (0, 0, -1))
    below.parent, below.rotation_euler = empty, (0.5, 0.4, 0.3)
    mark("BODY", below)
    for frame, size in ((2, 1.0), (3, 2.0)):
        empty.scale.x = size
        empty.keyframe_insert("scale", frame=frame)
    answer["sheared"] = press("check")
    for thing in (below, empty):
        bpy.data.objects.remove(thing)
    cup = ball("cup", (0, 1, 1), 0.07)
    mark("BODY", cup)
    answer["cup"] = press("check")
    # Centimetres at a unit scale of 1: clothes and all are giants.
    for thing in (cloth, cup):
        thing.scale = (800, 800, 800)
    answer["giant"] = press("check")
    return answer


def overrides():
    """A library's character is overridden and marked; saved and opened again and again."""
    answer = {}
    shot()
    cloth = panel("cloth")
    mark("GARMENT", cloth)
    bpy.ops.object.drapery_pin_add()
    cloth.drapery.pins[0].group, cloth.drapery.pins[0].hold = "top", "FIXED"
    ball("body", (0, 1, 1))
    save("library.blend")
    bpy.ops.wm.read_homefile(use_empty=True)
    set_preferences()
    shot(1, 3)
    save()
    with bpy.data.libraries.load(str(FOLDER / "library.blend"), link=True, relative=True) as (_, linked):
        linked.objects = ["cloth", "body"]
    for name in ("cloth", "body"):
        bpy.context.scene.collection.objects.link(bpy.data.objects[name])
        bpy.data.objects[name].override_create(remap_local_usages=True)
    cloth, body = local("cloth"), local("body")
    mark("BODY", body)
    chosen(cloth)
    bpy.ops.object.drapery_pin_add()
    pin = cloth.drapery.pins[1]
    pin.group, pin.hold, pin.body, pin.stiffness = "left", "SPRING", body, 50.0
    sew(cloth, "left", cloth, "right", pairing="NEAREST", stiffness=123.0)
    bpy.ops.object.drapery_map_add()
    cloth.drapery.maps[0].name = "top"
    cloth.drapery.fabric = "canvas"
    try:
        answer["linked_row"] = sorted(bpy.ops.object.drapery_remove(rows="pins", index=0))
    except RuntimeError as error:
        answer["linked_row"] = str(error)
    answer["kept"] = []
    for _ in range(3):
        bpy.ops.wm.save_mainfile()
        bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "shot.blend"))
        own = local("cloth").drapery
        answer["kept"].append([local("body").drapery.role, own.role, own.fabric, [[pin.group, pin.body and pin.body.name] for pin in own.pins],
                               rows_of(local("cloth")), own.seams[0].stiffness, own.maps[0].name])  # fmt: skip
    own.maps.clear()
    answer["simulated"] = press("simulate")
    return answer


def local(name):
    return next(thing for thing in bpy.data.objects if thing.name == name and thing.library is None)


def names():
    """The file or the scene gets another name while it is simulated; Undo while it is written and simulated."""
    answer = {}
    shot(1, 400)
    mark("GARMENT", panel("cloth", columns=40, rows=40))
    bpy.context.scene.drapery.folder = ""
    save()
    undo_step("before")
    bpy.data.objects["cloth"].drapery.fabric = "canvas"
    undo_step("fabric")
    # Without a window the operator would wait for all but the simulation.
    live, tasks, scene = part("state").work(), part("tasks"), bpy.context.scene
    live.start(scene, tasks.simulate_task(scene, view()))
    bpy.ops.ed.undo()
    answer["undone"] = bpy.data.objects["cloth"].drapery.fabric
    running = lambda: view().status is not None and view().status.running  # noqa: E731
    live.wait(lambda: running() or not (live.busy or live.watched))
    answer["runs"] = running()
    save("other.blend")
    answer["saved_as"] = followed(live)
    save()
    answer["saved_back"] = followed(live)
    bpy.context.scene.name = "Renamed"
    answer["renamed"] = followed(live)
    bpy.context.scene.name = "Scene"
    answer["named_back"] = followed(live)
    answer["cancelled"] = [sorted(bpy.ops.scene.drapery_cancel(wait=True)), view().status.state]
    return answer


def followed(live):
    """Updates the panel; returns whether Cancel can be pressed, the state and the lines."""
    live.follow(bpy.context.scene)
    live.tick()
    return [bpy.ops.scene.drapery_cancel.poll(), view().status and view().status.state, view().lines]


def main(acts):
    try:
        install()
        answer = acts[ACT]()
    except Exception:
        answer = {"failed": traceback.format_exc()}
    answer["version"] = list(bpy.app.version)
    (FOLDER / f"{ACT}.json").write_text(json.dumps(answer))


if __name__ == "__main__":
    main(globals())
