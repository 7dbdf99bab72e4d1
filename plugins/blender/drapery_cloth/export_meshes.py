"""Writes the meshes of a scene folder: run by Blender in the background on a copy of the file, so that no window waits.

    blender --background COPY.blend --python export_meshes.py -- JOB.json
    python export_meshes.py -- JOB.json COPY.blend          (Blender as a Python module)

The job names objects, files, frames and how much of each garment's modifier stack is simulated; problems go
to the file that the job calls `answer`. Prints `frame F` for every frame of the bodies.
The copy is thrown away, so modifiers are removed here that the artist keeps.
"""

import array
import hashlib
import json
import os
import sys
from pathlib import Path

import bpy

# A script of Blender's is not looked for beside itself.
sys.path.insert(0, str(Path(__file__).parent))
import sewing  # noqa: E402 isort: skip

# What the meshes held when they were written, by file. Blender's archives of equal meshes differ in their bytes, by more than
# the date, and a run whose inputs have other bytes is refused as changed: a file whose content is the same stays.
CONTENT = "meshes/content.json"

# A cosine between axes that is no rounding: over two metres it moves a vertex by 0.2 mm.
SHEAR = 1e-4


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


def show(thing):
    """Lets an object take part, whatever hides it in the artist's file; False if the view layer does not have it."""
    if thing not in list(bpy.context.view_layer.objects):
        return False
    everything = bpy.context.scene.collection
    # Collections that are hidden or cannot be selected, in the window or in renders, hide what is in no other one.
    if thing not in list(everything.objects):
        everything.objects.link(thing)
        bpy.context.view_layer.update()
    for path in ("hide_viewport", "hide_render"):
        thing.driver_remove(path)
        for curve in curves_of(thing):
            curve.mute = curve.mute or curve.data_path == path
        setattr(thing, path, False)
    thing.hide_select = False
    thing.hide_set(False)
    return True


def shear(matrix):
    """Largest cosine between two axes of a transform; 0 where all are at right angles."""
    axes = [column.normalized() for column in matrix.to_3x3().col]
    return max(abs(axes[i].dot(axes[j])) for i, j in ((0, 1), (1, 2), (2, 0)))


def curves_of(thing):
    """All curves that animate an object, of its action and of the strips of its tracks."""
    animation = thing.animation_data
    if animation is None:
        return []
    actions = [animation.action, *(strip.action for track in animation.nla_tracks for strip in track.strips)]
    found = []
    for action in filter(None, actions):
        # Blender 5 has them in layers alone.
        bags = [action] if hasattr(action, "fcurves") else [bag for layer in action.layers for strip in layer.strips
                                                            for bag in strip.channelbags]
        found += [curve for bag in bags for curve in bag.fcurves]
    return found


class Content:
    """A digest of what an object is in all frames that are exported, and how many vertices, faces and corners it has in each."""

    def __init__(self, thing, frames, scale):
        self.thing, self.frames = thing, frames
        self.sum = hashlib.sha256(repr((frames, scale)).encode())
        self.shapes = {}
        # Across, in metres, in the first of the frames.
        self.size = None
        self.scale = scale
        # The first frame in which its axes do not stand at right angles.
        self.sheared = None

    def look(self, scene, depsgraph):
        frame = scene.frame_current
        # Other frames come by when the export sets back what it found.
        if not self.frames[0] <= frame <= self.frames[1] or frame in self.shapes:
            return
        shown = self.thing.evaluated_get(depsgraph)
        mesh = shown.data
        self.shapes[frame] = shape_of(mesh)
        if self.sheared is None and shear(shown.matrix_world) > SHEAR:
            self.sheared = frame
        if self.size is None:
            places = list(zip(*(shown.matrix_world @ vertex.co for vertex in mesh.vertices)))
            self.size = self.scale * max((max(along) - min(along) for along in places), default=0.0)
        self.sum.update(repr(([list(row) for row in shown.matrix_world], [slot.name for slot in shown.material_slots])).encode())
        self.add(mesh.vertices, "co", "f", 3)
        self.add(mesh.loops, "vertex_index", "i", 1)
        self.add(mesh.polygons, "loop_total", "i", 1)
        self.add(mesh.polygons, "material_index", "i", 1)
        for layer in mesh.uv_layers:
            self.sum.update(layer.name.encode())
            self.add(layer.data, "uv", "f", 2)

    def add(self, collection, name, kind, width):
        numbers = array.array(kind, bytes(4 * width * len(collection)))
        collection.foreach_get(name, numbers)
        self.sum.update(numbers)

    @property
    def digest(self):
        return self.sum.hexdigest()


def write_alembic(thing, path, content, scale, evaluation, known):
    """One object, in the world, in metres, as evaluated in the frames of `content`, which is filled.

    The file stays where `known`, its digest when it was written, is that of today.
    """
    frames = content.frames
    scene = bpy.context.scene
    for other in bpy.context.view_layer.objects:
        other.select_set(False)
    thing.select_set(True)
    scene.frame_set(frames[0])
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    written = path.with_name(path.name + ".new")

    def look(scene, depsgraph=None):
        content.look(scene, depsgraph)
        print(f"frame {scene.frame_current}", flush=True)

    if frames[0] == frames[1]:
        # One frame is written as the scene stands, and no handler is called.
        content.look(scene, bpy.context.evaluated_depsgraph_get())
    bpy.app.handlers.frame_change_post.append(look)
    try:
        bpy.ops.wm.alembic_export(
            filepath=str(written), start=frames[0], end=frames[1], selected=True, flatten=True, uvs=True, face_sets=True,
            normals=False, vcolors=False, apply_subdiv=True, export_hair=False, export_particles=False, global_scale=scale,
            evaluation_mode=evaluation, as_background_job=False)
        if not written.exists():
            raise RuntimeError("Blender wrote no file; is the disk full?")
        if known != content.digest or not path.exists():
            os.replace(written, path)
    finally:
        bpy.app.handlers.frame_change_post.remove(look)
        written.unlink(missing_ok=True)


def leave_modes():
    """Ends Edit Mode and the like: there the mesh is not evaluated as it is otherwise."""
    for thing in bpy.context.view_layer.objects:
        if thing.mode != "OBJECT":
            bpy.context.view_layer.objects.active = thing
            bpy.ops.object.mode_set(mode="OBJECT")


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


def places_of(thing):
    """Positions of the vertices of an object in the world, as evaluated."""
    shown = evaluated(thing)
    return [tuple(shown.matrix_world @ vertex.co) for vertex in shown.data.vertices]


class Export:
    """One job; what is wrong with it is in `problems` at its end."""

    def __init__(self, job):
        self.job = job
        self.folder = Path(job["folder"])
        self.problems = []
        # Of each seam, the vertices of both sides; of each file how large its mesh is.
        self.seams, self.sizes = [], {}
        self.things = objects_by_name()
        try:
            self.digests = json.loads((self.folder / CONTENT).read_text("utf-8"))
        except (OSError, ValueError):
            self.digests = {}

    def find(self, name):
        thing = self.things.get(name)
        if thing is None:
            self.problems.append(problem(f'"{name}" is not in the file', "mark the object again", name))
        return thing

    def write(self, thing, name, file, frames, evaluation):
        """Writes an object and returns what it held."""
        content = Content(thing, frames, self.job["scale"])
        known = self.digests.pop(file, None)
        try:
            write_alembic(thing, self.folder / file, content, self.job["scale"], evaluation, known)
            self.digests[file], self.sizes[file] = content.digest, content.size
            if content.sheared is not None:
                self.problems.append(problem(
                    f'"{name}" is sheared at frame {content.sheared}, by a parent whose scale differs along its axes; Blender writes '
                    "no shear", "apply the scale of its parents (Object > Apply > Scale), or its own transforms", name, content.sheared))
        except (RuntimeError, OSError) as error:
            said = error.strerror if isinstance(error, OSError) and error.strerror else str(error).strip()
            self.problems.append(problem(f'"{name}" could not be written to {file}: {said}',
                                         "make room on the disk, or choose another folder", name))
        return content

    def takes_part(self, thing, name):
        """Shows an object, and says whether it can be simulated or collided with."""
        if not show(thing):
            self.problems.append(problem(f'"{name}" is in no collection of this view layer, or in one that is excluded',
                                         "include its collection (the check box in the Outliner), or unmark the object", name))
            return False
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
        if not self.takes_part(thing, name):
            return
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
            self.problems.append(problem(f'"{name}": no vertex of {what} "{painted["name"]}" is above one half, so that it holds '
                                         "nothing", "paint the vertices with more than 0.5", name))
            return
        try:
            put(self.folder / painted["file"], "".join(f"{value:.9g}\n" for value in numbers).encode())
        except OSError as error:
            self.problems.append(problem(f'{painted["file"]} could not be written: {error.strerror}',
                                         "make room on the disk, or choose another folder", name))

    def seam(self, seam):
        sides = [(self.things.get(name), group) for name, group in seam["sides"]]
        # What is missing has been named as a garment.
        if any(thing is None for thing, _ in sides):
            return
        if seam["pairing"] == "surface":
            chosen = self.sewn(*sides[0])
            self.seams.append(chosen and [chosen, None])
            return
        chosen = [self.sewn(thing, group) for thing, group in sides]
        if None in chosen:
            return
        if seam["pairing"] == "nearest":
            self.seams.append(self.nearest(sides, chosen))
            return
        pairs = self.along_edges(sides, chosen)
        if pairs and seam["zip"]:
            places, vertices = places_of(sides[0][0]), pairs[0]
            if vertices and places[vertices[-1]][2] < places[vertices[0]][2]:
                # A zip closes from its lower end.
                pairs = [side[::-1] for side in pairs]
        self.seams.append(pairs)

    def sewn(self, thing, group):
        """The vertices of one side; None, with a problem, where there are none."""
        try:
            found = [index for index, weight in enumerate(weights_of(thing, "GROUP", group)) if weight > 0.5]
        except KeyError:
            self.problems.append(problem(f'"{thing.name}" has no vertex group "{group}", which a seam sews', "choose one that is there, "
                                         "or remove the seam", thing.name))
            return None
        if not found:
            self.problems.append(problem(f'"{thing.name}": no vertex of vertex group "{group}" is above one half, so that a seam sews '
                                         "nothing", "paint the vertices that are sewn with more than 0.5", thing.name))
            return None
        return found

    def nearest(self, sides, chosen):
        """As they are: the solver finds the nearest ones."""
        (thing, group), (other, other_group) = sides
        shared = sorted(set(chosen[0]) & set(chosen[1])) if thing == other else []
        if shared:
            self.problems.append(problem(f'"{thing.name}": vertex {shared[0]} is in both groups of a seam, "{group}" and "{other_group}", '
                                         "and would be sewn to itself", "take it out of one of them", thing.name, None, shared[0]))
        return chosen

    def along_edges(self, sides, chosen):
        """The vertices of both sides in the order in which they are sewn."""
        lines = [self.line(thing, group, vertices) for (thing, group), vertices in zip(sides, chosen)]
        if None in lines:
            return None
        ((thing, group), (other, other_group)), ((first, ring), (second, other_ring)) = sides, lines
        what = f'the seam of "{group}" of "{thing.name}" to "{other_group}" of "{other.name}"'
        help = "choose Pairs: Nearest, which sews several vertices to one"
        if len(first) != len(second):
            self.problems.append(problem(f"{what} has {len(first)} vertices on one side, {len(second)} on the other",
                                         f"give both the same number, or {help}", thing.name))
            return None
        if ring != other_ring:
            self.problems.append(problem(f"{what} has a ring on one side, and a line with two ends on the other",
                                         f"take a vertex of the ring out of its group, or {help}", thing.name))
            return None
        second = sewing.closest_order(first, places_of(thing), second, places_of(other), ring)
        # At the tip of a dart both sides end in one vertex.
        pairs = [(a, b) for a, b in zip(first, second) if (thing, a) != (other, b)]
        if not pairs:
            self.problems.append(problem(f"{what} has the same vertices on both sides", "choose another group", thing.name))
        return [[a for a, _ in pairs], [b for _, b in pairs]]

    def line(self, thing, group, vertices):
        mesh = evaluated(thing).data
        faces = {}
        for polygon in mesh.polygons:
            for key in polygon.edge_keys:
                faces[key] = faces.get(key, 0) + 1
        edges = [tuple(edge.key) for edge in mesh.edges]
        try:
            return sewing.line_of(vertices, [key for key in edges if faces.get(key, 0) < 2], edges)
        except sewing.NoLine as error:
            self.problems.append(problem(
                f'"{thing.name}": vertex group "{group}", which a seam sews along the edges, is no single line of edges: {error}',
                "keep one line of vertices in it, with a seam of its own for each piece, or choose Pairs: Nearest", thing.name, None,
                error.vertex))
            return None

    def body(self, body):
        thing = self.find(body["object"])
        if thing is None:
            return
        name, [first, last] = thing.name, self.job["frames"]
        bpy.context.scene.frame_set(first)
        if not self.takes_part(thing, name):
            return
        # Two frames at least: one alone is written as the window shows it, and bodies are as they are rendered.
        content = self.write(thing, name, body["file"], [first, max(last, first + 1)], "RENDER")
        self.constant_topology(thing, name, content.shapes)
        if body["rest_file"]:
            frame = self.job["rest_frame"]
            self.write(thing, name, body["rest_file"], [frame, frame + 1], "RENDER")

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
        leave_modes()
        # Bodies first: frames of garments are looked at where their modifiers are still needed by nothing.
        for body in self.job["bodies"]:
            self.body(body)
        for garment in self.job["garments"] + self.job["render_meshes"]:
            self.garment(garment)
        for seam in self.job["seams"]:
            self.seam(seam)
        put(self.folder / CONTENT, json.dumps(self.digests, indent=1, sort_keys=True).encode())


def main():
    arguments = sys.argv[sys.argv.index("--") + 1 :]
    job = json.loads(Path(arguments[0]).read_text("utf-8"))
    if len(arguments) > 1:
        bpy.ops.wm.open_mainfile(filepath=arguments[1])
    export = Export(job)
    export.run()
    Path(job["answer"]).write_text(json.dumps({"problems": export.problems, "seams": export.seams, "sizes": export.sizes}), "utf-8")


main()
