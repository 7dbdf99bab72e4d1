"""Caches on the artist's own objects: a Mesh Sequence Cache modifier, and constraints that put the object into the world.

Caches hold places in the world, in metres, while a modifier works in the object's own space. So the object is held at the
origin of the shot with the scale of the scene's unit, whatever its parents do, by three Limit constraints. (A Transform
Cache constraint would be one, but it goes below the object's parent.) Materials, UVs, groups and the modifiers themselves
stay as they are: the modifier reads vertices and nothing else.
"""

import json
from pathlib import Path

import bpy

from .collect import CACHE, CONSTRAINTS, LIVE, division, marked, run_folder
from .scene_text import plain_name


class CannotLoad(Exception):
    """The caches cannot be loaded; the text says why and what to do."""


def cache_folder(scene):
    """Folder in which the caches are looked for; None where the scene has none."""
    if scene.drapery.cache_folder:
        return Path(bpy.path.abspath(scene.drapery.cache_folder)).resolve()
    return run_folder(scene)


def manifest_of(folder):
    """Reads the manifest of a run. Raises `CannotLoad`, also where no frame is done."""
    if folder is None:
        raise CannotLoad("Save the file first, or choose a scene folder")
    try:
        manifest = json.loads((folder / "manifest.json").read_text("utf-8"))
        manifest["garments"], manifest["origin"], manifest["last_complete_frame"]
    except FileNotFoundError as error:
        raise CannotLoad(f"{folder} holds no caches: simulate first, or choose the folder that the farm has written") from error
    except (OSError, ValueError, KeyError) as error:
        raise CannotLoad(f"{folder / 'manifest.json'} cannot be read: {error}") from error
    if manifest["last_complete_frame"] is None:
        raise CannotLoad(f"No frame is done yet in {folder}")
    return manifest


def load(context):
    """Puts the caches of the scene's run on its garments; sentences about what needs a look. Raises `CannotLoad`."""
    if not bpy.app.build_options.alembic:
        raise CannotLoad("This Blender was built without Alembic, as Debian's is, and cannot read caches; install Blender from blender.org")
    scene = context.scene
    folder = cache_folder(scene)
    manifest = manifest_of(folder)
    loads, remarks = matched(scene, folder, manifest)
    # All or none: before anything is changed.
    for thing, entry, _ in loads:
        compare_points(context, thing, entry)
    # The caches take the place of the Live View, which would hide them.
    scene.drapery.live = False
    if scene.drapery.preview:
        remarks.append("The preview hides the caches: dismiss it")
    for thing, entry, file in loads:
        remarks += put_on(context, thing, entry, folder / file, manifest)
    return remarks


def matched(scene, folder, manifest):
    """Triples (object, entry of the manifest, file) of the garments and render meshes that a run has caches of, and sentences about
    those that it has none of. Raises `CannotLoad` where it has none of any."""
    entries = {entry["name"]: entry for entry in manifest["garments"] if "render_mesh_of" not in entry}
    rendered = {entry["render_mesh_of"]: entry for entry in manifest["garments"] if "render_mesh_of" in entry}
    remarks, loads = [], []
    for thing in marked(scene, "GARMENT"):
        name, mesh = plain_name(thing.name), thing.drapery.render_mesh
        if name not in entries:
            remarks.append(f'"{thing.name}" is not in this run')
            continue
        loads.append((thing, entries[name], cache_file_name(entries[name], folder)))
        if mesh is not None and name in rendered:
            loads.append((mesh, rendered[name], cache_file_name(rendered[name], folder)))
        elif mesh is not None:
            remarks.append(f'"{mesh.name}", the render mesh of "{thing.name}", is not in this run')
    if not loads:
        raise CannotLoad(f"No garment of this scene is in the run of {folder}; it holds {', '.join(entries) or 'none'}")
    return loads, remarks


def cache_file_name(entry, folder):
    file = next((file for file in entry["files"] if file.endswith(".abc")), None)
    if file is None or not (folder / file).is_file():
        raise CannotLoad(f'The Alembic cache of "{entry["name"]}" is not in {folder}; copy it there, or simulate with format "abc"')
    return file


def compare_points(context, thing, entry):
    """The mesh has to be the one that was simulated. Raises `CannotLoad`."""
    # With the modifiers that are simulated, and no others.
    hidden = [(modifier, modifier.show_viewport) for modifier in list(thing.modifiers)[division(thing) :]]
    for modifier, _ in hidden:
        modifier.show_viewport = False
    try:
        count = len(thing.evaluated_get(context.evaluated_depsgraph_get()).data.vertices)
    finally:
        for modifier, shown in hidden:
            modifier.show_viewport = shown
    if count != entry["points"]:
        raise CannotLoad(f'"{thing.name}" has {count} vertices, its cache {entry["points"]}: the mesh or its modifiers were changed '
                         "since. Simulate again, or undo the change")


def open_file(context, path):
    """The cache file of Blender for a path; one that is open already is read anew."""
    for file in bpy.data.cache_files:
        if Path(bpy.path.abspath(file.filepath)).resolve() == path.resolve():
            # It may be longer by now.
            with context.temp_override(edit_cachefile=file):
                bpy.ops.cachefile.reload()
            return file
    before = set(bpy.data.cache_files)
    bpy.ops.cachefile.open(filepath=str(path))
    (file,) = set(bpy.data.cache_files) - before
    # The operator counts a user that it does not have; with it the file would stay after Unload.
    file.user_clear()
    file.filepath = path_for_blender(path)
    return file


def path_for_blender(path):
    """A path as a file of Blender names it: relative to that file, where the preferences want it."""
    if bpy.data.filepath and bpy.context.preferences.filepaths.use_relative_paths:
        try:
            return bpy.path.relpath(str(path))
        except ValueError:
            pass  # another drive: it stays absolute
    return str(path)


def insert_modifier(context, thing, name, kind):
    """Adds a modifier where the simulation belongs: before what follows the cloth, and before a preview of it."""
    index = division(thing) + (name == LIVE and thing.modifiers.get(CACHE) is not None)
    modifier = thing.modifiers.new(name, kind)
    if hasattr(thing.modifiers, "move"):
        thing.modifiers.move(len(thing.modifiers) - 1, index)
    else:
        # Before Blender 4.0.
        with context.temp_override(object=thing, active_object=thing):
            bpy.ops.object.modifier_move_to_index(modifier=modifier.name, index=index)
    return thing.modifiers[name]


def put_on(context, thing, entry, path, manifest):
    """One cache on one object; sentences about what needs a look."""
    scale = 1.0 / context.scene.unit_settings.scale_length
    file = open_file(context, path)
    # A file that is opened by the operator has none of these.
    file.scale = scale
    file.up_axis, file.forward_axis = "POS_Y", "POS_Z"
    file.velocity_name, file.velocity_unit = ".velocities", "SECOND"
    remarks = []
    hold_in_the_world(thing, context.scene, manifest["origin"])
    modifier = thing.modifiers.get(CACHE)
    if modifier is None:
        modifier = insert_modifier(context, thing, CACHE, "MESH_SEQUENCE_CACHE")
        for child in thing.children:
            if child.parent_type == "OBJECT":
                remarks.append(f'"{child.name}" is parented to "{thing.name}" and goes to the origin with it: parent it to vertices')
    modifier.cache_file, modifier.object_path = file, entry["object_path"]
    modifier.read_data, modifier.use_vertex_interpolation, modifier.velocity_scale = {"VERT"}, True, 1.0
    evaluate_anew(thing)
    return remarks


def evaluate_anew(thing):
    """Lets constraints and modifiers that were added or removed count: Blender 3.4 does not see to limits by itself."""
    thing.update_tag(refresh={"OBJECT", "DATA"})


def hold_in_the_world(thing, scene, origin):
    """Constrains an object to stand at the origin of a shot, in metres, Y up."""
    scale, (x, y, z) = 1.0 / scene.unit_settings.scale_length, origin
    place = x * scale, -z * scale, y * scale
    kinds = ("LIMIT_ROTATION", "LIMIT_SCALE", "LIMIT_LOCATION")
    for kind, name, values in zip(kinds, CONSTRAINTS, ((0, 0, 0), (scale,) * 3, place)):
        limit = thing.constraints.get(name)
        if limit is None:
            limit = thing.constraints.new(kind)
            limit.name = name
        limit.owner_space = "WORLD"
        for axis, value in zip("xyz", values):
            if kind == "LIMIT_ROTATION":
                setattr(limit, f"use_limit_{axis}", True)
            else:
                setattr(limit, f"use_min_{axis}", True)
                setattr(limit, f"use_max_{axis}", True)
            setattr(limit, f"min_{axis}", value)
            setattr(limit, f"max_{axis}", value)


def is_loaded(thing):
    return thing.modifiers.get(CACHE) is not None


def unload(scene):
    """Takes caches off all garments of a scene; how many there were."""
    count, files = 0, set()
    for thing in scene.objects:
        # The Live View needs them as well.
        for constraint in [] if thing.modifiers.get(LIVE) else [found for found in thing.constraints if found.name in CONSTRAINTS]:
            thing.constraints.remove(constraint)
        modifier = thing.modifiers.get(CACHE)
        if modifier is not None:
            files.add(modifier.cache_file)
            thing.modifiers.remove(modifier)
            count += 1
    bpy.data.batch_remove([file for file in files - {None} if file.users == 0])
    return count
