"""Writes the meshes of a scene folder: run by Blender in the background on a copy of the file, so that no window waits.

    blender --background COPY.blend --python export_meshes.py -- JOB.json
    python export_meshes.py -- JOB.json COPY.blend          (Blender as a Python module)

The job names objects, files, frames and how much of each garment's modifier stack is simulated; problems, and the number of
points of every garment, go to the file that the job calls `answer`. Prints `frame F` for every frame of the bodies.
The copy is thrown away, so modifiers are removed here that the artist keeps.
"""

import json
import os
import re
import sys
from pathlib import Path

import bpy

# Blender stores when an archive was written, and from which file. Without these the same scene gives the same bytes, and a
# run is not refused as changed. Their lengths stay, as all of the archive is found by where it stands.
CIRCUMSTANCES = re.compile(rb"(?<=_ai_DateWritten=)[^;]{24}(?=;)|(?<=_ai_Description=)[^;]*(?=;)")


def problem(message, help, thing=None, frame=None, vertex=None):
    return {"message": message, "help": help, "object": thing, "frame": frame, "element": None if vertex is None else "vertex",
            "index": vertex}


def objects_by_name():
    # Linked objects may have the names of others; with their library they do not.
    return {thing.name_full: thing for thing in bpy.data.objects}


def put(path, content):
    """Replaces a file as a whole, and leaves it alone where it holds the same."""
    path = Path(path)
    if path.exists() and path.read_bytes() == content:
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(path.name + ".part")
    beside.write_bytes(content)
    os.replace(beside, path)


def write_alembic(thing, path, frames, scale, evaluation):
    """One object, in the world, in metres, as evaluated in `frames`."""
    scene = bpy.context.scene
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    thing.hide_set(False)
    thing.hide_viewport = thing.hide_select = thing.hide_render = False
    thing.select_set(True)
    if not thing.select_get():
        raise RuntimeError("it is in no collection of this view layer, or in one that is excluded")
    scene.frame_set(frames[0])
    written = Path(path).with_name(Path(path).name + ".new")
    written.parent.mkdir(parents=True, exist_ok=True)
    try:
        bpy.ops.wm.alembic_export(
            filepath=str(written), start=frames[0], end=frames[1], selected=True, flatten=True, uvs=True, face_sets=True,
            normals=False, vcolors=False, apply_subdiv=True, export_hair=False, export_particles=False, global_scale=scale,
            evaluation_mode=evaluation, as_background_job=False)
        if not written.exists():
            raise RuntimeError("Blender wrote no file; is the disk full?")
        put(path, CIRCUMSTANCES.sub(lambda found: b" " * len(found[0]), written.read_bytes()))
    finally:
        written.unlink(missing_ok=True)


def evaluated(thing):
    return thing.evaluated_get(bpy.context.evaluated_depsgraph_get())


def shape_of(mesh):
    return len(mesh.vertices), len(mesh.polygons), len(mesh.loops)


def weights_of(thing, source, name):
    """The numbers of a vertex group or an attribute, one a vertex; raises `KeyError` where there is none."""
    shown = evaluated(thing)
    mesh = shown.data
    if source == "GROUP":
        group = thing.vertex_groups.get(name)
        if group is None:
            raise KeyError(name)
        numbers = [0.0] * len(mesh.vertices)
        for vertex in mesh.vertices:
            for entry in vertex.groups:
                if entry.group == group.index:
                    numbers[vertex.index] = entry.weight
        return numbers
    attribute = mesh.attributes.get(name)
    if attribute is None or attribute.domain not in ("POINT", "CORNER"):
        raise KeyError(name)
    if attribute.data_type in ("FLOAT_COLOR", "BYTE_COLOR"):
        numbers = [entry.color[0] for entry in attribute.data]
    elif attribute.data_type in ("FLOAT", "INT", "INT8", "BOOLEAN"):
        numbers = [float(entry.value) for entry in attribute.data]
    else:
        raise KeyError(name)
    if attribute.domain == "POINT":
        return numbers
    # Corners of a vertex are painted alike; where they are not, their mean counts.
    sums, counts = [0.0] * len(mesh.vertices), [0] * len(mesh.vertices)
    for loop in mesh.loops:
        sums[loop.vertex_index] += numbers[loop.index]
        counts[loop.vertex_index] += 1
    return [total / count if count else 0.0 for total, count in zip(sums, counts)]


class Export:
    """One job: what it finds on the way is in `problems` and `points`."""

    def __init__(self, job):
        self.job = job
        self.folder = Path(job["folder"])
        self.problems = []
        self.points = {}
        self.things = objects_by_name()

    def find(self, name):
        thing = self.things.get(name)
        if thing is None:
            self.problems.append(problem(f'"{name}" is not in the file', "mark the object again", name))
        return thing

    def write(self, thing, name, file, frames, evaluation):
        try:
            write_alembic(thing, self.folder / file, frames, self.job["scale"], evaluation)
        except (RuntimeError, OSError) as error:
            said = error.strerror if isinstance(error, OSError) and error.strerror else str(error).strip()
            self.problems.append(problem(f'"{name}" could not be written to {file}: {said}',
                                         "make room on the disk, or choose another folder", name))

    def has_faces(self, thing, name):
        if len(evaluated(thing).data.polygons):
            return True
        self.problems.append(problem(f'"{name}" has no faces', "only surfaces are simulated and collided with: fill the edges "
                                     "with faces, or unmark the object", name))
        return False

    def garment(self, garment):
        thing = self.find(garment["object"])
        if thing is None:
            return
        name = thing.name
        # Everything from there on follows the cloth, and is for the artist's file.
        for modifier in list(thing.modifiers)[garment["division"] :]:
            thing.modifiers.remove(modifier)
        for constraint in [found for found in thing.constraints if found.name in self.job["constraints"]]:
            thing.constraints.remove(constraint)
        bpy.context.scene.frame_set(self.job["rest_frame"])
        if not self.has_faces(thing, name):
            return
        self.points[name] = len(evaluated(thing).data.vertices)
        # As the window shows it: that is what the cache is put on.
        frame = self.job["rest_frame"]
        self.write(thing, name, garment["file"], [frame, frame], "VIEWPORT")
        bpy.context.scene.frame_set(frame)
        for painted in garment["weights"]:
            self.weights(thing, name, painted)

    def weights(self, thing, name, painted):
        what = "vertex group" if painted["source"] == "GROUP" else "attribute"
        try:
            numbers = weights_of(thing, painted["source"], painted["name"])
        except KeyError:
            self.problems.append(problem(
                f'"{name}" has no {what} "{painted["name"]}" with numbers of vertices where it is simulated',
                "choose one that is there, and that the modifiers before the cloth keep", name))
            return
        bad = next((index for index, value in enumerate(numbers) if value != value or abs(value) == float("inf")), None)
        if bad is not None:
            self.problems.append(problem(f'"{name}": {what} "{painted["name"]}" is no number at vertex {bad}', "paint it again",
                                         name, None, bad))
            return
        if painted["pins"] and not any(value > 0.5 for value in numbers):
            self.problems.append(problem(f'"{name}": no vertex of {what} "{painted["name"]}" is above one half, so that it pins '
                                         "nothing", "paint the vertices that are held with more than 0.5", name))
            return
        try:
            put(self.folder / painted["file"], "".join(f"{value:.9g}\n" for value in numbers).encode())
        except OSError as error:
            self.problems.append(problem(f'{painted["file"]} could not be written: {error.strerror}',
                                         "make room on the disk, or choose another folder", name))

    def body(self, body):
        thing = self.find(body["object"])
        if thing is None:
            return
        name, scene, [first, last] = thing.name, bpy.context.scene, self.job["frames"]
        scene.frame_set(first)
        if not self.has_faces(thing, name):
            return
        shapes = {}

        def look(_, depsgraph=None):
            frame = scene.frame_current
            if depsgraph is not None and first <= frame <= last:
                shapes[frame] = shape_of(thing.evaluated_get(depsgraph).data)
            print(f"frame {frame}", flush=True)

        bpy.app.handlers.frame_change_post.append(look)
        try:
            self.write(thing, name, body["file"], [first, last], "RENDER")
        finally:
            bpy.app.handlers.frame_change_post.remove(look)
        self.constant_topology(thing, name, shapes)
        if body["rest_file"]:
            frame = self.job["rest_frame"]
            self.write(thing, name, body["rest_file"], [frame, frame], "RENDER")

    def constant_topology(self, thing, name, shapes):
        frames = sorted(shapes)
        changed = next((frame for frame in frames if shapes[frame] != shapes[frames[0]]), None)
        if changed is None:
            return
        before, after = shapes[frames[0]], shapes[changed]
        modifiers = ", ".join(modifier.name for modifier in thing.modifiers if modifier.show_render) or "none"
        self.problems.append(problem(
            f'"{name}" changes its topology at frame {changed}: {after[0]} vertices and {after[1]} faces, at frame {frames[0]} '
            f"{before[0]} and {before[1]}", f"find the modifier whose settings are animated (its modifiers: {modifiers}), and "
            "keep the number of vertices and faces the same over the shot", name, changed))

    def run(self):
        if bpy.context.scene.name != self.job["scene"]:
            bpy.context.window.scene = bpy.data.scenes[self.job["scene"]]
        # Bodies first: frames of garments are looked at where their modifiers are still needed by nothing.
        for body in self.job["bodies"]:
            self.body(body)
        for garment in self.job["garments"]:
            self.garment(garment)


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :]
    job = json.loads(Path(arguments[0]).read_text("utf-8"))
    if len(arguments) > 1:
        bpy.ops.wm.open_mainfile(filepath=arguments[1])
    export = Export(job)
    export.run()
    Path(job["answer"]).write_text(json.dumps({"problems": export.problems, "points": export.points}), "utf-8")


main()
