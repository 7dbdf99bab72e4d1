"""Blender with the add-on, as an artist would use it: builds a scene, presses the buttons, and writes what it sees.

    python blender_addon.py ACT FOLDER ZIP DRAPERY

Installs the zip as an extension, does an act (a function below) in FOLDER, and writes the act's answer to
FOLDER/ACT.npz. `bpy` can be loaded once in a process, hence a process of its own. BLENDER_USER_RESOURCES names a folder of
the test, so that no add-on is left behind anywhere.
"""

import json
import math
import os
import signal
import sys
from pathlib import Path

import bpy
import numpy as np

from blender_ticks import ticked_until

MODULE = "bl_ext.user_default.drapery_cloth"
FIRST, LAST = 1001, 1006
SCALE = 0.01


def part(name):
    return sys.modules[f"{MODULE}.{name}"]


def work():
    return part("state").work()


def view():
    return work().view(bpy.context.scene)


def install(folder, archive, drapery):
    """As artists do: with a file of theirs open, which an add-on is not shown while it is registered."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "open.blend"))
    bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    if drapery:
        preferences().executable = str(drapery)


def preferences():
    return bpy.context.preferences.addons[MODULE].preferences


def values(collection, name, width, kind=np.float32):
    found = np.empty(len(collection) * width, kind)
    collection.foreach_get(name, found)
    return found.reshape(-1, width) if width > 1 else found


def link(thing):
    bpy.context.scene.collection.objects.link(thing)
    return thing


def tube(name, radius, bottom, top, around, rows, parent=None, capped=False):
    """A tube around z in cm; capped ones have n-gons at their ends."""
    turns = [2.0 * math.pi * i / around for i in range(around)]
    points = [(radius * math.cos(a), radius * math.sin(a), bottom + (top - bottom) * j / rows) for j in range(rows + 1) for a in turns]
    faces = [(j * around + i, j * around + (i + 1) % around, (j + 1) * around + (i + 1) % around, (j + 1) * around + i)
             for j in range(rows) for i in range(around)]  # fmt: skip
    if capped:
        faces += [tuple(reversed(range(around))), tuple(range(rows * around, (rows + 1) * around))]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], faces)
    uvs = mesh.uv_layers.new(name="cut")
    for index, loop in enumerate(mesh.loops):
        uvs.data[index].uv = (loop.vertex_index % around / around, loop.vertex_index // around / rows)
    thing = link(bpy.data.objects.new(name, mesh))
    thing.parent = parent
    return thing


def character():
    """A body of a torso on two bones that bends sideways, in cm, below a root that is turned, scaled and moves."""
    scene = bpy.context.scene
    scene.unit_settings.scale_length = SCALE
    scene.render.fps, scene.render.fps_base = 25, 1.0
    scene.frame_start, scene.frame_end = FIRST, LAST
    root = link(bpy.data.objects.new("root", None))
    root.rotation_euler, root.scale = (0.0, 0.0, 0.6), (0.5, 0.5, 0.5)
    for frame, x in ((FIRST, 0.0), (LAST, 4.0)):
        root.location = (30.0 + x, -12.0, 3.0)
        root.keyframe_insert("location", frame=frame)
    armature = link(bpy.data.objects.new("rig", bpy.data.armatures.new("rig")))
    armature.parent = root
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    lower, upper = (armature.data.edit_bones.new(name) for name in ("lower", "upper"))
    lower.head, lower.tail, upper.head, upper.tail = (0, 0, 0), (0, 0, 100), (0, 0, 100), (0, 0, 200)
    upper.parent = lower
    bpy.ops.object.mode_set(mode="OBJECT")
    bone = armature.pose.bones["upper"]
    bone.rotation_mode = "XYZ"
    for frame, angle in ((FIRST, 0.0), (LAST, 0.15)):
        bone.rotation_euler = (angle, 0.0, 0.0)
        bone.keyframe_insert("rotation_euler", frame=frame)
    body = tube("bödy", 24.0, 0.0, 200.0, 12, 10, root, capped=True)
    for name, low, high in (("lower", 0.0, 100.0), ("upper", 100.0, 200.0)):
        group = body.vertex_groups.new(name=name)
        group.add([vertex.index for vertex in body.data.vertices if low <= vertex.co.z <= high], 1.0, "REPLACE")
    body.modifiers.new("Armature", "ARMATURE").object = armature
    subdivision = body.modifiers.new("Subdivision", "SUBSURF")
    subdivision.levels, subdivision.render_levels = 0, 1
    return root, body


def garment(root, name="Skirt.001", radius=30.0, bottom=60.0, top=120.0):
    thing = tube(name, radius, bottom, top, 16, 8, root)
    waist = thing.vertex_groups.new(name="waist ☺")
    waist.add([vertex.index for vertex in thing.data.vertices if vertex.co.z > top - 1.0], 1.0, "REPLACE")
    heavy = thing.data.attributes.new("heavy", "FLOAT", "POINT")
    for vertex in thing.data.vertices:
        heavy.data[vertex.index].value = 2.0 if vertex.co.z < bottom + 1.0 else 1.0
    thing.data.materials.append(bpy.data.materials.new("red"))
    thing.data.materials.append(bpy.data.materials.new("blue"))
    for polygon in thing.data.polygons:
        polygon.material_index = polygon.index % 2
    return thing


def mark(thing, role):
    for other in bpy.context.view_layer.objects:
        other.select_set(other == thing)
    bpy.context.view_layer.objects.active = thing
    bpy.ops.object.drapery_mark(role=role)


def dressed(folder):
    """The whole scene, marked and saved."""
    root, body = character()
    skirt = garment(root)
    thickness = skirt.modifiers.new("Thickness", "SOLIDIFY")
    thickness.thickness = 0.2
    mark(body, "BODY")
    mark(skirt, "GARMENT")
    skirt.drapery.fabric = "wool_suiting"
    bpy.ops.object.drapery_pin_add()
    pin = skirt.drapery.pins[0]
    pin.group, pin.hold = "waist ☺", "BODY"
    bpy.ops.object.drapery_map_add()
    skirt.drapery.maps[0].quantity, skirt.drapery.maps[0].source, skirt.drapery.maps[0].name = "density", "ATTRIBUTE", "heavy"
    bpy.context.scene.drapery.folder = "//drapery/"
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "shot.blend"))
    return root, body, skirt


def press(button, **options):
    """A button of the panel, and what it begins, to its end; whether it says that it came to a good one is in `view().result`."""
    (result,) = getattr(bpy.ops.scene, f"drapery_{button}")(wait=True, **options)
    assert not work().busy and not work().watched
    view().result = result
    return view()


def said(found=None):
    return [f"{each.object}|{each.frame}|{each.element}|{each.index}|{each.message}|{each.help}" for each in (found or view()).problems]


def outline(thing):
    """Text of everything that Load must not change in an object, in the scene's frame and in the lists of the file."""
    bpy.context.scene.frame_set(FIRST)
    mesh = thing.data
    return repr((
        [(modifier.name, modifier.type, modifier.show_viewport) for modifier in thing.modifiers],
        [constraint.name for constraint in thing.constraints], [material.name for material in mesh.materials],
        values(mesh.polygons, "material_index", 1, np.int32).tobytes(), values(mesh.uv_layers[0].data, "uv", 2).tobytes(),
        values(mesh.vertices, "co", 3).tobytes(), np.array(thing.matrix_world).tobytes(), thing.parent and thing.parent.name,
        sorted(bpy.data.cache_files.keys()), sorted(bpy.data.objects.keys()), bpy.context.scene.frame_current,
    ))  # fmt: skip


def shown(thing, frame):
    """World positions of the mesh that is simulated at a frame in Blender units, its velocities, UVs and materials of faces."""
    scene = bpy.context.scene
    scene.frame_set(math.floor(frame), subframe=frame % 1.0)
    mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    matrix = np.array(thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world, float)
    positions = values(mesh.vertices, "co", 3).astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    velocities = values(mesh.attributes["velocity"].data, "vector", 3) if "velocity" in mesh.attributes else np.zeros(0)
    return positions, velocities, values(mesh.uv_layers[0].data, "uv", 2), values(mesh.polygons, "material_index", 1, np.int32)


def whole_path(folder):
    """Mark, check, plan, simulate, load, undo; what Blender shows at frames and half frames."""
    _, body, skirt = dressed(folder)
    # World positions of the body, to be compared with the file that is exported, as the render sees it.
    body.modifiers["Subdivision"].levels = 1
    bpy.ops.wm.save_mainfile()
    before = outline(skirt)
    own_uvs, own_materials = values(skirt.data.uv_layers[0].data, "uv", 2), values(skirt.data.polygons, "material_index", 1, np.int32)
    bodies = [shown(body, frame)[0] for frame in range(FIRST, LAST + 1)]
    bpy.context.scene.frame_set(FIRST)
    answer = {"checked": press("check").lines + said(), "planned": press("plan").lines, "bodies": bodies}
    answer["dirty_after_check"] = outline(skirt) != before
    press("simulate")
    answer["status"], answer["problems"], answer["simulated"] = view().status.state, said(), view().result
    skirt.modifiers["Thickness"].show_viewport = False
    frames = [FIRST + 0.5 * index for index in range(2 * (LAST - FIRST) + 1)]
    before = outline(skirt)
    bpy.ops.ed.undo_push(message="before Load")
    answer["loaded"] = sorted(bpy.ops.scene.drapery_load())
    bpy.ops.ed.undo_push(message="Load")
    answer["loaded_modifiers"] = [modifier.name for modifier in skirt.modifiers]
    found = [shown(skirt, frame) for frame in frames]
    answer |= {"frames": frames, "positions": [each[0] for each in found], "velocities": [each[1] for each in found],
               "uvs": [each[2] for each in found], "materials": [each[3] for each in found], "own_uvs": own_uvs,
               "own_materials": own_materials}  # fmt: skip
    # A second Load finds its own modifier and file again.
    bpy.ops.scene.drapery_load()
    answer["loaded_twice"] = [modifier.name for modifier in skirt.modifiers] + [str(len(bpy.data.cache_files))]
    bpy.context.scene.frame_set(FIRST)
    # Simulating again with the caches on finds nothing that has changed.
    press("simulate")
    answer["again"] = [view().status.state, *said(), str(view().refused)]
    bpy.ops.scene.drapery_unload()
    answer["unloaded_same"] = outline(skirt) == before
    bpy.ops.scene.drapery_load()
    bpy.ops.ed.undo_push(message="Load again")
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    answer["undone_same"] = outline(bpy.data.objects["Skirt.001"]) == before
    layouts = bpy.types.UILayout.bl_rna.functions
    answer["progress"] = layouts["progress"].parameters.keys()
    answer["icons"] = layouts["label"].parameters["icon"].enum_items.keys()
    answer["fabrics"] = [entry[0] for entry in part("state").pictures().fabric_entries()]
    return answer


def problems(folder):
    """Causes the problems before a simulation, one after the other; returns the texts of the panel."""
    answer = {}
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    preferences().executable = os.environ["DRAPERY"]
    answer["unsaved"] = said(press("check"))
    preferences().executable = ""
    root, body, skirt = dressed(folder)
    answer["no_solver"] = said(press("check"))
    results = [f"{button} {press(button).result}" for button in ("check", "plan", "simulate")]
    preferences().executable = str(folder / "shot.blend")
    answer["no_program"] = said(press("check"))
    preferences().executable = os.environ["DRAPERY"]
    # Only in the file that is exported: the first problems prevent that, and are all named at once.
    twin = garment(root, "SKIRT.001", 40.0)
    mark(twin, "GARMENT")
    wire = link(bpy.data.objects.new("wire", bpy.data.meshes.new("wire")))
    wire.data.from_pydata([(0, 0, 0), (1, 0, 0)], [(0, 1)], [])
    mark(wire, "BODY")
    skirt.drapery.simulated, skirt.drapery.maps[0].name = "ALL", ""
    skirt.modifiers.new("Fine", "SUBSURF").render_levels = 3
    answer["together"] = said(press("check"))
    for thing in (twin, wire):
        mark(thing, "NONE")
    skirt.drapery.simulated, skirt.drapery.maps[0].name = "BASE", "weight of nothing"
    waist = skirt.vertex_groups["waist ☺"]
    waist.add(range(len(skirt.data.vertices)), 0.5, "REPLACE")
    topology = body.modifiers.new("Shrinking", "DECIMATE")
    for frame, ratio in ((FIRST, 1.0), (FIRST + 2, 1.0), (FIRST + 3, 0.5)):
        topology.ratio = ratio
        topology.keyframe_insert("ratio", frame=frame)
    answer["exported"] = said(press("check"))
    body.modifiers.remove(topology)
    skirt.drapery.maps[0].name = "heavy"
    waist.add([vertex.index for vertex in skirt.data.vertices if vertex.co.z > 119.0], 1.0, "REPLACE")
    # Into the body: what only the solver sees.
    skirt.data.vertices[7].co.x = 0.0
    skirt.data.vertices[7].co.y = 0.0
    scene.frame_set(LAST)
    answer["inside"] = said(press("check"))
    results.append(f"inside {view().result}")
    found = next(problem for problem in view().problems if problem.element == "vertex" and problem.index == 7)
    bpy.ops.scene.drapery_show(thing=found.object, frame=found.frame or FIRST, has_frame=True, element=found.element, index=found.index)
    bpy.ops.object.mode_set(mode="OBJECT")
    matrix = np.array(skirt.evaluated_get(bpy.context.evaluated_depsgraph_get()).matrix_world)
    answer["shown"] = [bpy.context.object.name, str(scene.frame_current), str([v.index for v in skirt.data.vertices if v.select])]
    answer["cursor"] = np.array(scene.cursor.location)
    answer["vertex"] = matrix[:3, :3] @ np.array(skirt.data.vertices[7].co) + matrix[:3, 3]
    (folder / "file").write_text("")
    scene.drapery.folder = str(folder / "file" / "below")
    answer["no_folder"] = said(press("check"))
    scene.drapery.folder = "/sys/drapery"
    answer["read_only"] = said(press("check"))
    scene.drapery.folder = ""
    answer["own_folder"] = str(part("collect").scene_folder(scene).relative_to(folder))
    other = bpy.data.scenes.new("Scene 2")
    other.collection.objects.link(skirt)
    answer["own_folder_too"] = str(part("collect").scene_folder(other).relative_to(folder))
    other.drapery.folder = scene.drapery.folder = "//drapery/"
    answer["one_folder"] = said(press("check"))
    bpy.data.scenes.remove(other)
    bpy.ops.scene.drapery_load()
    answer["nothing_to_load"] = said()
    answer["too_old"] = sys.modules[MODULE].too_old((2, 93, 0))
    answer["new_enough"] = sys.modules[MODULE].too_old(bpy.app.version)
    # Names of the solver's messages are those of files; a frame from the middle of the shot brings no window to it.
    answer["results"] = results
    answer["left_behind"] = sorted(path.name for path in (folder / "drapery").iterdir())
    return answer


def long_shot(folder):
    """A shot that takes some seconds: finer cloth, more frames."""
    root, body, skirt = dressed(folder)
    bpy.data.objects.remove(skirt)
    skirt = tube("dress", 30.0, 40.0, 120.0, 60, 45, root)
    group = skirt.vertex_groups.new(name="top")
    group.add([vertex.index for vertex in skirt.data.vertices if vertex.co.z > 119.0], 1.0, "REPLACE")
    mark(skirt, "GARMENT")
    bpy.ops.object.drapery_pin_add()
    bpy.context.scene.frame_end = FIRST + 119
    bpy.ops.wm.save_mainfile()
    return skirt


def other_settings(folder):
    """Garments that fit at another frame than the first, all modifiers simulated, springs to the body, a painted colour, NTSC."""
    scene = bpy.context.scene
    _, body, skirt = dressed(folder)
    scene.render.fps, scene.render.fps_base = 24, 1.001
    skirt.modifiers.remove(skirt.modifiers["Thickness"])
    fine = skirt.modifiers.new("Fine", "SUBSURF")
    fine.levels = fine.render_levels = 1
    own, shot = skirt.drapery, scene.drapery
    own.simulated, own.pins[0].hold, own.pins[0].body, own.pins[0].stiffness = "ALL", "SPRING", body, 50.0
    colour = skirt.data.color_attributes.new("paint", "FLOAT_COLOR", "CORNER")
    for entry in colour.data:
        entry.color = (0.5, 0.0, 0.0, 1.0)
    bpy.ops.object.drapery_map_add()
    own.maps[1].quantity, own.maps[1].source, own.maps[1].name = "dihedral_bending", "ATTRIBUTE", "paint"
    # Garments fit at the last frame; the shot is one frame long.
    shot.own_range, shot.first, shot.last = True, FIRST, FIRST
    shot.own_rest, shot.rest_frame, shot.settle = True, LAST, 1
    answer = {"no_blend": said(press("check"))}
    shot.blend = 4
    answer["checked"] = said(press("check"))
    press("simulate")
    answer["status"], answer["problems"] = view().status.state, said()
    bpy.ops.scene.drapery_load()
    answer["loaded"] = [modifier.name for modifier in skirt.modifiers]
    answer["positions"] = shown(skirt, FIRST)[0]
    return answer


def effects(folder):
    """A garment that stiffens up to a limit, in wind, with a mesh that is rendered in its place, whose buttons stay rigid."""
    root, body, skirt = dressed(folder)
    rendered = tube("Skirt to render", 30.4, 60.0, 120.0, 32, 24, root)
    for name in ("wool", "button 1"):
        rendered.data.materials.append(bpy.data.materials.new(name))
    for index in (100, 101, 132, 133):
        rendered.data.polygons[index].material_index = 1
    rendered.modifiers.new("Thickness", "SOLIDIFY").thickness = 0.1
    own, shot = skirt.drapery, bpy.context.scene.drapery
    own.fabric, own.stiffens = "OTHER", True
    own.other_fabric, own.render_mesh, own.rigid = "wool_suiting", body, "button*"
    answer = {"unknown": said(press("check"))}
    own.fabric, own.strain_limit, own.render_mesh = "wool_suiting", True, rendered
    shot.wind, shot.wind_velocity = True, (1.0, 2.0, 3.0)
    answer["simulated"] = press("simulate").result
    answer["problems"] = [line for line in said() if "silence" not in line]
    answer["loaded"] = sorted(bpy.ops.scene.drapery_load())
    rendered.modifiers["Thickness"].show_viewport = False
    answer["positions"] = [shown(rendered, frame)[0] for frame in range(FIRST, LAST + 1)]
    answer["modifiers"] = [modifier.name for modifier in rendered.modifiers]
    bpy.ops.scene.drapery_unload()
    answer["unloaded"] = [modifier.name for modifier in rendered.modifiers] + [found.name for found in rendered.constraints]
    own.own_strain, own.strain = True, 12.0
    press("write")
    return answer


def until(found, seconds=60.0):
    ticked_until(found, work(), seconds)


def state_is(*states):
    return lambda: view().status is not None and view().status.state in states


def closed(folder):
    """Simulates and closes Blender when some frames are done. The solver waits, so that however fast it is it is not done
    before Blender is open again."""
    long_shot(folder)
    bpy.ops.scene.drapery_simulate()
    until(lambda: view().status is not None and view().status.running and view().status.done >= 2)
    os.kill(pid_of_run(folder / "drapery" / "out" / "Scene"), signal.SIGSTOP)
    return {"headline": part("answers").headline(view().status), "share": view().status.share}


def pid_of_run(folder):
    return int(json.loads((folder / "lock.json").read_text())["pid"])


def reopened(folder):
    """Opens the file while the simulation goes on: finds it, cancels it, continues it, kills it, continues it, loads."""
    bpy.ops.wm.open_mainfile(filepath=str(folder / "shot.blend"))
    run = folder / "drapery" / "out" / "Scene"
    until(lambda: view().status is not None)
    answer = {"found": view().status.state, "busy_buttons": [bpy.ops.scene.drapery_simulate.poll(), bpy.ops.scene.drapery_cancel.poll()]}
    answer["results"] = sorted(bpy.ops.scene.drapery_cancel())
    os.kill(pid_of_run(run), signal.SIGCONT)
    until(lambda: state_is("stopped")() and not work().busy)
    answer["cancelled"], answer["frames_then"] = part("answers").headline(view().status), view().status.done
    # What is there so far; loaded again when all is done, it has to be longer.
    bpy.ops.scene.drapery_load()
    shown(bpy.data.objects["dress"], FIRST)
    bpy.ops.scene.drapery_continue()
    until(lambda: view().status is not None and view().status.running and view().status.done > answer["frames_then"])
    os.kill(pid_of_run(run), signal.SIGKILL)
    until(lambda: state_is("killed")() and not work().watched)
    answer["killed"] = part("answers").headline(view().status)
    # A disk that is full, for this solver alone.
    whole, preferences().executable = preferences().executable, str(folder / "full_disk")
    bpy.ops.scene.drapery_continue()
    until(lambda: not work().watched)
    answer["full"], answer["full_state"] = said(), view().status.state
    preferences().executable = whole
    answer["results"].append(press("continue").result)
    answer["done"], answer["problems"] = part("answers").headline(view().status), said()
    # Another scene in the same folder is refused, and kept by a wish alone.
    bpy.data.objects["dress"].drapery.fabric = "denim_11oz"
    press("simulate")
    answer["refused"] = [str(view().refused), *said()]
    answer["results"].append(view().result)
    bpy.ops.scene.drapery_load()
    skirt = bpy.data.objects["dress"]
    bpy.ops.object.select_all(action="DESELECT")
    answer["positions"] = [shown(skirt, frame)[0] for frame in (FIRST, FIRST + 119)]
    skirt.data.vertices.add(1)
    bpy.ops.scene.drapery_load()
    answer["edited"] = said()
    return answer


def main():
    act, folder, archive, drapery = sys.argv[1], Path(sys.argv[2]), sys.argv[3], sys.argv[4]
    install(folder, archive, "" if drapery == "none" else drapery)
    np.savez(folder / f"{act}.npz", **{name: np.array(value) for name, value in globals()[act](folder).items()})


if __name__ == "__main__":
    main()
