"""Blender with a window and the add-on: every button is pressed and the panel is photographed.

    blender --factory-startup --python blender_window.py -- FOLDER ZIP DRAPERY EXPORTER

For Blender 3.4, which installs the zip as an add-on of its scripts. A timer goes through the steps one by one, as fast as the work
gets done; the window is drawn in between. Writes FOLDER/answer.json and pictures; EXPORTER stands for a Blender with Alembic.
"""

import json
import math
import os
import sys
import traceback
from pathlib import Path

import bpy

FOLDER, ZIP, DRAPERY, EXPORTER = sys.argv[sys.argv.index("--") + 1 :]
FOLDER = Path(FOLDER)
FIRST = 1001
answer = {"presses": [], "drawn": {}}


def add_on():
    # With a saved file open, as artists install it.
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "window.blend"))
    bpy.ops.preferences.addon_install(filepath=ZIP)
    import drapery_cloth
    from drapery_cloth import panels

    # Else Blender takes it for an older version and reads all of it anew.
    drapery_cloth.__time__ = os.path.getmtime(drapery_cloth.__file__)
    # The tab of a sidebar cannot be chosen by a script in 3.4: the panels go to the one that is open, and are open themselves.
    panels.Panel.bl_category = "Tool"
    for panel in panels.CLASSES:
        panel.bl_options = set()
        panel.draw = counted(panel.__name__, panel.draw)
    bpy.ops.preferences.addon_enable(module="drapery_cloth")
    preferences = bpy.context.preferences.addons["drapery_cloth"].preferences
    preferences.executable, preferences.exporter = DRAPERY, EXPORTER
    bpy.context.preferences.view.show_splash = False
    # Drawn by the processor here.
    bpy.context.preferences.system.viewport_aa = "OFF"


def counted(name, drawn):
    def draw(self, context):
        drawn(self, context)
        answer["drawn"][name] = answer["drawn"].get(name, 0) + 1

    return draw


def window():
    return bpy.context.window_manager.windows[0]


def area():
    return next(area for area in window().screen.areas if area.type == "VIEW_3D")


def view():
    return state().work().view(bpy.context.scene)


def state():
    return sys.modules["drapery_cloth.state"]


def draw():
    bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)


def photograph(name):
    draw()
    draw()
    bpy.ops.screen.screenshot(filepath=str(FOLDER / f"{name}.png"))


def press(group, button, **options):
    """A button as the artist presses it: with the pointer in the 3D view. Says whether the panel would let it be pressed."""
    region = next(region for region in area().regions if region.type == "WINDOW")
    with bpy.context.temp_override(window=window(), area=area(), region=region):
        operator = getattr(getattr(bpy.ops, group), button)
        allowed = operator.poll()
        result = sorted(operator(**options)) if allowed else ["greyed out"]
    answer["presses"].append([f"{group}.{button}", allowed, result, [found.message for found in view().problems], view().lines])


def tube(name, radius, bottom, top, around, rows):
    turns = [2.0 * math.pi * i / around for i in range(around)]
    points = [(radius * math.cos(a), radius * math.sin(a), bottom + (top - bottom) * j / rows) for j in range(rows + 1) for a in turns]
    faces = [(j * around + i, j * around + (i + 1) % around, (j + 1) * around + (i + 1) % around, (j + 1) * around + i)
             for j in range(rows) for i in range(around)]  # fmt: skip
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    mesh.update()
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    group = thing.vertex_groups.new(name="waist")
    group.add([index for index, point in enumerate(points) if point[2] > top - 0.001], 1.0, "REPLACE")
    return thing


def choose(thing):
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing


def steps():
    """The artist's day; yields wait for the work in progress."""
    for thing in list(bpy.data.objects):
        bpy.data.objects.remove(thing)
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = FIRST, FIRST + 23
    scene.frame_set(FIRST)
    body, skirt = tube("body", 0.2, 0.0, 1.2, 16, 8), tube("skirt", 0.25, 0.5, 1.0, 32, 20)
    space = area().spaces.active
    space.show_region_ui, space.show_region_toolbar, space.show_gizmo, space.overlay.show_overlays = True, False, False, False
    draw()
    yield
    photograph("empty")
    press("scene", "drapery_check")
    photograph("nothing_marked")
    choose(body)
    press("object", "drapery_mark", role="BODY")
    press("object", "drapery_belt_add")
    yield
    photograph("belt")
    press("object", "drapery_remove", rows="belts", index=0)
    choose(skirt)
    press("object", "drapery_mark", role="GARMENT")
    press("object", "drapery_pin_add")
    press("object", "drapery_pin_add")
    press("object", "drapery_remove", rows="pins", index=1)
    press("object", "drapery_map_add")
    press("object", "drapery_remove", rows="maps", index=0)
    press("object", "drapery_elastic_add")
    press("object", "drapery_remove", rows="elastics", index=0)
    press("object", "drapery_contact_add")
    skirt.drapery.contacts[0].other, skirt.drapery.contacts[0].own_friction = body, True
    skirt.drapery.contacts[0].friction = 0.35
    cuff = tube("cuff", 0.252, 1.02, 1.1, 32, 4)
    choose(cuff)
    press("object", "drapery_mark", role="GARMENT")
    press("object", "drapery_seam_add")
    cuff.drapery.seams[0].other, cuff.drapery.seams[0].other_group, cuff.drapery.seams[0].own_closing = skirt, "waist", True
    yield
    photograph("sewn")
    choose(skirt)
    press("object", "drapery_seam_add")
    # With the seam of the cuff, which leads here.
    yield
    photograph("sewn_to")
    press("object", "drapery_remove", rows="seams", index=0)
    bpy.data.objects.remove(cuff)
    skirt.drapery.pins[0].hold = "SPRING"
    skirt.drapery.fabric = "denim_11oz"
    skirt.drapery.stiffens = skirt.drapery.strain_limit = True
    skirt.drapery.render_mesh = tube("skirt_render", 0.252, 0.5, 1.0, 64, 40)
    scene.drapery.wind, scene.drapery.wind_velocity = True, (3.0, 0.0, 0.0)
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "window.blend"))
    answer["icons"] = [entry[3] for entry in state().pictures().fabric_entries()[:-1]]
    yield
    photograph("marked")
    press("scene", "drapery_check")
    photograph("exporting")
    yield "work"
    press("scene", "drapery_plan")
    yield "work"
    photograph("planned")
    press("scene", "drapery_write")
    yield "work"
    # Into the body: something to go to.
    skirt.data.vertices[5].co = (0.0, 0.0, 0.6)
    press("scene", "drapery_check")
    yield "work"
    photograph("problem")
    press("scene", "drapery_show", thing="skirt", frame=FIRST + 3, has_frame=True, element="vertex", index=5)
    bpy.ops.object.mode_set(mode="OBJECT")
    answer["shown"] = [bpy.context.view_layer.objects.active.name, scene.frame_current, [v.index for v in skirt.data.vertices if v.select]]
    skirt.data.vertices[5].co = (0.25 * math.cos(5 / 16 * math.pi), 0.25 * math.sin(5 / 16 * math.pi), 0.5)
    scene.frame_set(FIRST)
    press("scene", "drapery_simulate")
    yield "running"
    photograph("running")
    press("scene", "drapery_cancel")
    yield "ended"
    photograph("cancelled")
    answer["cancelled"] = view().status.state
    press("scene", "drapery_continue")
    yield "ended"
    photograph("done")
    answer["done"] = view().status.state
    scene.drapery.live = scene.drapery.live_newest = True
    # With the line in the 3D view.
    space.overlay.show_overlays = True
    yield
    photograph("live")
    answer["live"] = [list(state().work().live.state(scene).note(scene.frame_current)), [each.name for each in skirt.modifiers]]
    press("scene", "drapery_colours", show="STRAIN")
    answer["colours"] = [found.message for found in state().work().colours.problems[scene.name]]
    photograph("coloured")
    press("scene", "drapery_colours", show="NONE")
    scene.drapery.live = False
    press("scene", "drapery_preview")
    yield "preview"
    photograph("previewing")
    yield "ended"
    photograph("previewed")
    answer["previewed"] = [list(state().work().live.state(scene).note(scene.frame_current)), [each.name for each in skirt.modifiers]]
    press("scene", "drapery_dismiss")
    yield "ended"
    answer["dismissed"] = [each.name for each in skirt.modifiers]
    # A run with warnings of its own; the words are those of its log.
    log = FOLDER / "drapery" / "window" / "Scene" / "out" / "Scene" / "logs" / "099.jsonl"
    log.write_text(json.dumps({"level": "WARN", "fields": {"message": 'frame 1007, time 0.25 s: garment "skirt", vertex 5: the solve '
                                                           "diverged"}}))  # fmt: skip
    state().work().look_later()
    yield "ended"
    photograph("warned")
    answer["warnings"] = [found.message for found in view().warnings]
    # As a script calls it: nothing else happens until it is done.
    press("scene", "drapery_check", wait=True)
    answer["waited"] = [state().work().busy, view().lines]
    press("scene", "drapery_load")
    press("scene", "drapery_unload")
    photograph("end")


def ready(wish):
    work = state().work()
    if wish == "work":
        return not work.busy
    if wish == "running":
        return not work.busy and view().status is not None and view().status.done >= 1
    if wish == "preview":
        shown = work.live.state(bpy.context.scene)
        return not work.busy and shown is not None and shown.last is not None
    if wish == "ended":
        return not work.busy and not work.watched and not work.unseen
    return True


def finish():
    for thing in ("operators", "panels"):
        answer[thing] = [each.__name__ for each in sys.modules[f"drapery_cloth.{thing}"].CLASSES]
    answer["version"] = list(bpy.app.version)
    bpy.ops.preferences.addon_disable(module="drapery_cloth")
    answer["left"] = [name for name in dir(bpy.types) if "drapery" in name.lower()]
    (FOLDER / "answer.json").write_text(json.dumps(answer))
    bpy.ops.wm.quit_blender()


def main():
    add_on()
    going = steps()
    wish = None

    def look():
        nonlocal wish
        try:
            if not ready(wish):
                return 0.1
            wish = next(going, "end")
            if wish == "end":
                finish()
                return None
        except Exception:
            answer["failed"] = traceback.format_exc()
            finish()
            return None
        return 0.1

    bpy.app.timers.register(look, first_interval=1.0)


main()
