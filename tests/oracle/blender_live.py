"""Runs that are looked at in a session of Blender: the Live View, previews, colours; and settings that are keyframed.

Called like blender_artist.py, whose helpers it takes.
"""

import hashlib
import json
import os
import signal
import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from blender_artist import FOLDER, chosen, group, main, mark, mesh_of, panel, part, press, save, shot, undo_step, view  # noqa: E402
from blender_ticks import ticked_until  # noqa: E402

RUN = FOLDER / "drapery" / "out" / "Scene"


def work():
    return part("state").work()


def until(found, seconds=60.0):
    ticked_until(found, work(), seconds)


def live():
    return work().live.state(bpy.context.scene)


def shown(name, frame):
    """Places of the vertices in the world, as a frame shows them."""
    bpy.context.scene.frame_set(frame)
    thing = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get())
    return [list(thing.matrix_world @ vertex.co) for vertex in thing.data.vertices]


def added(name="cloth"):
    thing = bpy.data.objects[name]
    return [each.name for each in (*thing.modifiers, *thing.constraints, *thing.data.color_attributes)]


def sheet(name, size, cells, height):
    """A square that lies above the origin."""
    places = [(size * (i / cells - 0.5), size * (j / cells - 0.5), height) for j in range(cells + 1) for i in range(cells + 1)]
    row = cells + 1
    faces = [(j * row + i, j * row + i + 1, (j + 1) * row + i + 1, (j + 1) * row + i) for j in range(cells) for i in range(cells)]
    return mesh_of(name, places, faces)


def begun():
    """A run that is followed, and waits after some frames, so that it is not done before it is looked at."""
    scene = shot(1, 200)
    cloth = panel("cloth", columns=40, rows=40)
    cloth.rotation_euler = (0.4, 0.2, 0.1)
    cloth.location = (1.0, 2.0, 3.0)
    cloth.modifiers.new("Thickness", "SOLIDIFY").show_viewport = False
    mark("GARMENT", cloth)
    save()
    undo_step("before")
    scene.drapery.live = True
    answer = {"before": [live().note(5), added()]}
    work().start(scene, part("tasks").simulate_task(scene, view()))
    until(lambda: live().last is not None and live().last >= 3)
    os.kill(int(json.loads((RUN / "lock.json").read_text())["pid"]), signal.SIGSTOP)
    # What was written before it stopped.
    until(lambda: not work().busy)
    work().tick()
    return answer


def follows():
    """Follows a run from before its first frame to its end, through all that may happen to the file and the folder."""
    answer = begun()
    scene, last = bpy.context.scene, live().last
    frames = [1, last // 2, last, last + 5, -3]
    answer |= {"frames": frames, "positions": [shown("cloth", frame) for frame in frames], "added": added()}
    answer["notes"] = [live().note(frame) for frame in frames]
    # The step before is from before the Live View.
    bpy.data.objects["cloth"].drapery.order = 2
    undo_step("order")
    bpy.ops.ed.undo()
    scene = bpy.context.scene
    answer["undone"] = [scene.drapery.live, bpy.data.objects["cloth"].drapery.order]
    work().tick()
    answer["undone"].append(added())
    scene.drapery.live = True
    answer["after_undo"] = added()
    other = bpy.data.scenes.new("Other")
    bpy.context.window.scene = other
    work().tick()
    bpy.context.window.scene = bpy.data.scenes["Scene"]
    save()
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "shot.blend"))
    until(lambda: live() is not None and live().last is not None and view().status is not None)
    answer["opened"] = [added(), view().status.state, shown("cloth", last) == answer["positions"][2]]
    os.kill(int(json.loads((RUN / "lock.json").read_text())["pid"]), signal.SIGCONT)
    scene = bpy.context.scene
    scene.drapery.live_newest = True
    until(lambda: live().last > last + 3)
    answer["newest"] = scene.frame_current > last
    answer["cancelled"] = [sorted(bpy.ops.scene.drapery_cancel(wait=True)), view().status.state]
    work().tick()
    answer |= {"last": live().last, "last_positions": shown("cloth", live().last)}
    moved = RUN.with_name("moved")
    os.rename(RUN, moved)
    work().tick()
    answer["moved"] = [live().note(3), added(), shown("cloth", 3)]
    os.rename(moved, RUN)
    work().tick()
    answer["moved_back"] = shown("cloth", live().last) == answer["last_positions"]
    # A cache that is no archive.
    whole = (RUN / "cloth.abc").read_bytes()
    (RUN / "cloth.abc").write_bytes(whole[: len(whole) // 2])
    work().tick()
    answer["cut"] = [problem.message for problem in live().problems]
    (RUN / "cloth.abc").write_bytes(whole)
    work().tick()
    answer["whole"] = [problem.message for problem in live().problems]
    if bpy.app.build_options.alembic:
        answer["loaded"] = [sorted(bpy.ops.scene.drapery_load()), scene.drapery.live, added()]
        bpy.ops.scene.drapery_unload()
    scene.drapery.live = True
    scene.drapery.live = False
    answer["off"] = [added(), [path.name for path in (FOLDER / "drapery").rglob("*.pc2")]]
    return answer


def digests(folder):
    return {str(path.relative_to(FOLDER)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in sorted(folder.rglob("*")) if path.is_file() and "preview" not in path.parts}


def looks():
    """A preview beside a run that is done, and colours."""
    scene = shot(1, 12)
    strip = panel("strip", corner=(2.0, 0.0, 1.0), columns=8, rows=16)
    low, high = sheet("low", 0.3, 12, 0.02), sheet("high", 0.24, 10, 0.023)
    mark("BODY", mesh_of("floor", [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)]))
    mark("GARMENT", strip, low, high)
    for own in (strip.drapery, low.drapery, high.drapery):
        own.fabric = "canvas"
    chosen(strip)
    bpy.ops.object.drapery_pin_add()
    strip.drapery.pins[0].group, strip.drapery.pins[0].hold = "top", "FIXED"
    # Soft enough that its weight draws it beyond the limit.
    strip.drapery.own_stretch, strip.drapery.stretch = True, 15.0
    scene.drapery.preset = "production"
    save()
    answer = {"none": [sorted(bpy.ops.scene.drapery_colours(show="STRAIN")), [each.message for each in work().colours.problems["Scene"]]]}
    bpy.ops.scene.drapery_colours(show="NONE")
    answer["simulated"] = press("simulate")
    before = digests(FOLDER / "drapery")
    answer["previewed"] = sorted(bpy.ops.scene.drapery_preview(wait=True))
    work().tick()
    resolved = FOLDER / "drapery" / "preview" / "out" / "Scene" / "resolved.toml"
    answer["preview"] = [added("strip"), live().note(12), resolved.read_text()]
    answer["preview_positions"] = shown("strip", 12)
    answer["untouched"] = digests(FOLDER / "drapery") == before
    answer["dismissed"] = [sorted(bpy.ops.scene.drapery_dismiss(wait=True)), added("strip"), (FOLDER / "drapery" / "preview").exists()]
    answer["left"] = digests(FOLDER / "drapery") == before
    scene.drapery.live = True
    scene.frame_set(12)
    strip.data.color_attributes.new("own", "FLOAT_COLOR", "POINT")
    for show in ("STRAIN", "CONTACT"):
        result = sorted(bpy.ops.scene.drapery_colours(show=show))
        found = work().colours
        answer[show] = [result, found.legends.get("Scene"), [[each.object, each.index, each.message] for each in found.problems["Scene"]]]
        if "FINISHED" in result:
            answer[show] += [[list(entry.color) for entry in thing.data.color_attributes["Drapery Colours"].data] for thing in (strip, low, high)]
    scene.frame_set(2)
    work().tick()
    answer["other_frame"] = [each.message for each in work().colours.problems["Scene"]]
    active = strip.data.color_attributes.active_color.name
    bpy.ops.scene.drapery_colours(show="NONE")
    answer["removed"] = [active, added("strip"), strip.data.color_attributes.active_color.name, scene.drapery.before_colours]
    return answer


def key(group, name, *keys, interpolation="LINEAR"):
    """Keyframes of a setting, as an artist makes them; the last keys of `keys` stay the value."""
    for frame, value in keys:
        setattr(group, name, value)
        group.keyframe_insert(name, frame=frame)
    path = group.path_from_id(name)
    for curve in part("keyframes").curves_of(group.id_data):
        for point in curve.keyframe_points if curve.data_path == path else ():
            point.interpolation = interpolation


def curves():
    """Settings that are keyframed, in all ways."""
    scene = shot(1, 10)
    cloth, lining, floor = panel("cloth"), panel("lining", corner=(0.0, 0.1, 1.0)), sheet("floor", 2.0, 2, 0.0)
    mark("BODY", floor)
    mark("GARMENT", cloth, lining)
    own, whole = cloth.drapery, scene.drapery
    # Before, at and behind the ends of the shot.
    key(whole, "gravity_acceleration", (-3, (0.0, 0.0, -9.0)), (6, (0.0, 0.0, 0.0)), (20, (0.0, 1.4, 0.0)))
    whole.wind = own.own_bending = floor.drapery.own_friction = True
    whole.wind_velocity = (1.0, 2.0, 3.0)
    key(own, "bending", (1, 20.0), (10, 2.0), interpolation="BEZIER")
    key(floor.drapery, "friction", (3, 0.5), (7, 0.5))
    chosen(cloth, lining)
    bpy.ops.object.drapery_contact_add()
    rule = own.contacts[0]
    rule.own_thickness = True
    key(rule, "thickness", (2, 2.0), (5, 1.0), interpolation="CONSTANT")
    own.pressure, own.overpressure = "OPEN", 2.0
    own.own_damping, own.damping, whole.air_drag = True, 0.5, True
    key(whole, "air_drag_rate", (1, 0.0), (3, 2.0))
    for curve in part("keyframes").curves_of(scene):
        curve.mute = curve.data_path == "drapery.air_drag_rate"
    group(cloth, "one", [0])
    bpy.ops.object.drapery_pin_add()
    pin = own.pins[0]
    pin.group, pin.hold, pin.released, pin.release = "one", "FIXED", True, 5
    group(cloth, "pocket ü", range(12))
    of_part = own.contacts.add()
    of_part.other, of_part.group, of_part.ignore = cloth, "pocket ü", True
    whole.also_h5, whole.attributes = True, {"strain", "normals"}
    save()
    answer = {"planned": press("plan"), "lines": view().lines, "scene": (FOLDER / "drapery" / "scene.toml").read_text()}
    # Nothing else can be keyed.
    answer["keyable"] = []
    for each, name in ((own, "order"), (own, "damping"), (whole, "settle"), (pin, "release")):
        try:
            answer["keyable"].append(each.keyframe_insert(name))
        except TypeError:
            answer["keyable"].append("no")
    rule.own_thickness = False
    answer["nothing"] = press("check")
    rule.own_thickness, rule.other = True, None
    answer["no_object"] = press("check")
    rule.other, pin.release = lining, -1
    answer["early"] = press("check")
    pin.release = 5
    own.driver_add("bending").driver.expression = "3.0"
    answer["driver"] = press("check")
    own.driver_remove("bending")
    key(own, "overpressure", (1, 1.0), (5, 2.0))
    animation = cloth.animation_data
    animation.nla_tracks.new().strips.new("strip", 1, animation.action)
    animation.action = None
    answer["strip"] = press("check")
    return answer


if __name__ == "__main__":
    main(globals())
