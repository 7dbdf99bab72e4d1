"""Strain and contact of the garments at the current frame, as a colour attribute of their meshes.

What is measured is what the Live View or Load shows, at whole frames, against the mesh at rest that was simulated. Colours are for
looking: taken off, meshes and windows are as they were.
"""

import json

import bpy
from mathutils.bvhtree import BVHTree

from .answers import Problem
from .collect import CACHE, FINAL, LIVE, PREVIEW, largest_strain, marked, run_folder, scene_folder
from .load_cache import cache_folder
from .ogawa import DAMAGED, Archive, NotReadable
from .recording import HEADER
from .scene_text import MESHES, plain_name

ATTRIBUTE = "Drapery Colours"
# Distance up to which contact is coloured [thicknesses].
FAR = 2.0


class NoColours(Exception):
    """A garment cannot be coloured; the text says why, `help` what to do."""

    def __init__(self, why, help):
        super().__init__(why)
        self.help = help


class Colours:
    """Colours of the scenes of the open file: what they stand for, by the name of the scene."""

    def __init__(self):
        # Of each scene: what was measured when, the problems, and the ends of the legend.
        self.keys, self.problems, self.legends = {}, {}, {}
        self.changed = False

    def forget(self):
        self.keys, self.problems, self.legends = {}, {}, {}

    @property
    def wanted(self):
        return any(scene.drapery.colours != "NONE" for scene in bpy.data.scenes)

    def tick(self, live):
        """Measures again where the frame, or what is shown of it, is another one."""
        self.changed = False
        scene, screen = bpy.context.scene, getattr(bpy.context, "screen", None)
        if bpy.app.is_job_running("RENDER") or (screen is not None and screen.is_animation_playing):
            return
        if scene.drapery.colours != "NONE" and self.key(scene, live) != self.keys.get(scene.name):
            self.refresh(scene, live)

    def key(self, scene, live):
        shown = live.state(scene)
        stamps = {name: recording.seen for name, recording in shown.recordings.items()} if shown else None
        there = [ATTRIBUTE in thing.data.color_attributes for thing in marked(scene, "GARMENT")]
        return scene.drapery.colours, scene.frame_current, stamps, there, [thing.mode for thing in marked(scene, "GARMENT")]

    def refresh(self, scene, live):
        """Colours the garments of a scene; whether all could be."""
        found, problems = [], []
        for thing in marked(scene, "GARMENT"):
            try:
                found.append(self.garment(scene, thing))
                continue
            except NoColours as error:
                why, help = error, error.help
            except (OSError, NotReadable, *DAMAGED) as error:
                why, help = error, "look whether the run and the scene folder are complete"
            problems.append(Problem(f'"{thing.name}" has no colours: {why}', help, plain_name(thing.name)))
            # Colours of another frame or run would be taken for those of this one.
            forget_attribute(scene, thing)
        if not found and not problems:
            problems.append(Problem("No object is marked as a garment", "select a mesh and choose Garment under Object"))
        if found:
            show_attributes(scene)
        self.problems[scene.name] = problems + found
        self.keys[scene.name] = self.key(scene, live)
        self.changed = True
        return not problems

    def garment(self, scene, thing):
        """Colours a garment; the numbers, as a remark that leads to the vertex with the largest."""
        try:
            from . import measures
        except ImportError as error:
            raise NoColours("this Blender has no numpy", "on Debian: apt install python3-numpy; Blender from blender.org has it") from error
        mesh, run = thing.data, shown_folder(scene)
        if mesh.library or mesh.override_library:
            raise NoColours("its mesh is linked", "make the mesh local (Object > Relations > Make Local)")
        if thing.mode == "EDIT":
            raise NoColours("it is in Edit Mode", "leave Edit Mode")
        other = next((other for other in marked(scene, "GARMENT") if other.data == mesh and other.name < thing.name), None)
        if other is not None:
            raise NoColours(f'it shares its mesh with "{other.name}"', "make the mesh a single user")
        shape = Shape(scene, thing, run, measures)
        if len(mesh.vertices) != len(shape.places):
            raise NoColours(f"its mesh has {len(mesh.vertices)} vertices, its simulation {len(shape.places)}",
                            "choose Simulated Mesh: Before Subdivision")
        measure = self.strain if scene.drapery.colours == "STRAIN" else self.contact
        shares, message, vertex = measure(scene, thing, run, shape, measures)
        attribute = mesh.color_attributes.get(ATTRIBUTE)
        if attribute is None:
            remember(scene, mesh)
            attribute = mesh.color_attributes.new(ATTRIBUTE, "FLOAT_COLOR", "POINT")
        attribute.data.foreach_set("color", measures.colours_of(shares).ravel())
        mesh.update()
        return Problem(message, "", plain_name(thing.name), scene.frame_current, None if vertex is None else "vertex", vertex, True)

    def strain(self, scene, thing, run, shape, measures):
        limit = limit_of(thing, run)
        self.legends[scene.name] = ["{:.1f} %".format(25 * step * limit) for step in range(5)] + ["above the limit"]
        strains = measures.strains_of(shape.places, shape.rest, shape.edges)
        worst, above = int(strains.argmax()), int((strains > limit).sum())
        found = measures.largest_at_vertices(strains, shape.edges, len(shape.places))
        message = (f'"{thing.name}": strain up to {100 * strains[worst]:.1f} %, limit of the fabric {100 * limit:.1f} %, {above} of '
                   f"{len(strains)} edges above it")  # fmt: skip
        return found / limit, message, int(shape.edges[worst, 0])

    def contact(self, scene, thing, run, shape, measures):
        self.legends[scene.name] = ["2 thicknesses and more", "1.5", "1: touching", "0.5", "0"]
        resolved = resolved_scene(run)
        share = [FAR] * len(shape.places)
        nearest = None
        for kind, other in others(scene, thing):
            thickness = measures.thickness_between(resolved, plain_name(thing.name), (kind, plain_name(other.name)), scene.frame_current)
            if not thickness:
                continue
            tree = surface(scene, kind, other, run, measures)
            low, high = tree.bounds[0] - FAR * thickness, tree.bounds[1] + FAR * thickness
            near = ((shape.places >= low) & (shape.places <= high)).all(axis=1)
            for vertex in near.nonzero()[0].tolist():
                distance = tree.tree.find_nearest(shape.places[vertex], FAR * thickness)[3]
                if distance is not None and distance / thickness < share[vertex]:
                    share[vertex] = distance / thickness
                    if nearest is None or share[vertex] < nearest[0]:
                        nearest = share[vertex], distance, other.name, thickness, vertex
        if nearest is None:
            message = f'"{thing.name}": farther than {FAR:g} thicknesses from all bodies and other garments'
            return [0.0] * len(share), message, None
        _, distance, name, thickness, vertex = nearest
        count = sum(each < 1.0 for each in share)
        message = (f'"{thing.name}": {count} vertices closer than the thickness; nearest {1000 * distance:.2f} mm to "{name}" (thickness '
                   f"{1000 * thickness:.2f} mm)")  # fmt: skip
        return [1.0 - each / FAR for each in share], message, vertex

    def take_off(self, scene):
        """Removes the colours of a scene."""
        for each in (self.keys, self.problems, self.legends):
            each.pop(scene.name, None)
        forget_attributes(scene)
        self.changed = True


def shown_kind(scene):
    return PREVIEW if scene.drapery.preview else FINAL


def shown_folder(scene):
    """Folder of the run that is shown."""
    folder = run_folder(scene, PREVIEW) if scene.drapery.preview else cache_folder(scene)
    if folder is None or not (folder / "manifest.json").is_file():
        raise NoColours("no simulation is shown", "simulate, and turn the Live View on or press Load")
    return folder


class Shape:
    """A garment as it is shown at the current frame: places of its vertices now and at rest, in metres, Y up, faces and edges."""

    def __init__(self, scene, thing, run, measures):
        points, origin = shown_points(scene, thing, run)
        self.places = measures.transformed(points, []) + origin
        with Archive(rest_file(scene, thing, run)) as archive:
            mesh = archive.mesh()
            self.rest = measures.transformed(mesh.positions(0), mesh.matrices())
            faces = mesh.faces()
        if len(self.rest) != len(self.places):
            raise NoColours(f"its mesh at rest has {len(self.rest)} vertices, its simulation {len(self.places)}", "simulate again")
        self.edges, self.polygons = measures.edges_of(*faces), measures.polygons(*faces)


def shown_points(scene, thing, run):
    """Positions from the cache that an object shows at the current frame, as bytes, and the origin that they count from."""
    live, cache = thing.modifiers.get(LIVE), thing.modifiers.get(CACHE)
    origin = json.loads((run / "manifest.json").read_text("utf-8"))["origin"]
    if live is not None:
        with open(bpy.path.abspath(live.filepath), "rb") as file:
            _, _, points, _, _, frames = HEADER.unpack(file.read(HEADER.size))
            file.seek(HEADER.size + 12 * points * max(0, min(scene.frame_current - round(live.frame_start), frames - 1)))
            return file.read(12 * points), origin
    if cache is None or cache.cache_file is None:
        raise NoColours("it shows no simulation", "turn the Live View on, or press Load")
    with Archive(bpy.path.abspath(cache.cache_file.filepath)) as archive:
        mesh = archive.mesh(cache.object_path)
        cycle, (start, *_) = mesh.sampling
        time = scene.frame_current * scene.render.fps_base / scene.render.fps
        return mesh.frame(round((time - start) / cycle) if mesh.samples > 1 else 0), origin


def rest_file(scene, thing, run):
    folder = scene_folder(scene, shown_kind(scene))
    path = folder and folder / MESHES / f"garment_{plain_name(thing.name)}.abc"
    if path is None or not path.is_file():
        raise NoColours(f"its mesh at rest, {path}, is missing", "press Check, which writes the scene folder")
    return path


def limit_of(thing, run):
    """Largest strain of a garment: of its run, else of its fabric."""
    entries = json.loads((run / "manifest.json").read_text("utf-8"))["garments"]
    found = next((entry.get("strain_limit") for entry in entries if entry["name"] == plain_name(thing.name)), None)
    return found or largest_strain(thing.drapery) or 0.1


def resolved_scene(run):
    """The scene as it was run, with all numbers."""
    try:
        import tomllib
    except ImportError as error:
        raise NoColours("this Blender has a Python before 3.11", "use Blender 4.2 or later") from error
    return tomllib.loads((run / "resolved.toml").read_text("utf-8"))


def others(scene, thing):
    """Objects that a garment may touch, each with its kind."""
    garments = [("garment", other) for other in marked(scene, "GARMENT") if other != thing]
    return [*garments, *(("body", body) for body in marked(scene, "BODY"))]


class Surface:
    """Faces to find the nearest point of: `tree`, and the corners of the box around them."""

    def __init__(self, places, polygons):
        self.tree = BVHTree.FromPolygons(places.tolist(), polygons)
        self.bounds = places.min(axis=0), places.max(axis=0)


def surface(scene, kind, other, run, measures):
    if kind == "garment":
        shape = Shape(scene, other, run, measures)
        return Surface(shape.places, shape.polygons)
    shown = other.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = shown.data
    values = measures.np.empty(3 * len(mesh.vertices), measures.np.float32)
    mesh.vertices.foreach_get("co", values)
    # To metres, Y up.
    matrix = measures.np.array(shown.matrix_world) * scene.unit_settings.scale_length
    x, y, z = (values.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]).T
    return Surface(measures.np.stack([x, z, -y], axis=1), [tuple(polygon.vertices) for polygon in mesh.polygons])


# What the meshes and windows of a scene were like before: in a property of the scene, so that files that are saved keep it.


def before(scene):
    return json.loads(scene.drapery.before_colours or '{"meshes": {}, "windows": {}}')


def remember(scene, mesh):
    known = before(scene)
    active = mesh.color_attributes.active_color
    known["meshes"][mesh.name] = [active.name if active else "", mesh.color_attributes.render_color_index]
    scene.drapery.before_colours = json.dumps(known)


def show_attributes(scene):
    """Lets the windows of a scene show colours of attributes, and meshes those of strain and contact."""
    known = before(scene)
    for window in bpy.context.window_manager.windows:
        for index, area in enumerate(window.screen.areas):
            shading = area.spaces.active.shading if area.type == "VIEW_3D" and window.scene == scene else None
            if shading is not None and shading.color_type != "VERTEX":
                known["windows"][f"{window.screen.name}/{index}"] = shading.color_type
                shading.color_type = "VERTEX"
    scene.drapery.before_colours = json.dumps(known)
    for thing in marked(scene, "GARMENT"):
        attribute = thing.data.color_attributes.get(ATTRIBUTE)
        if attribute is not None:
            thing.data.color_attributes.active_color = attribute


def forget_attribute(scene, thing):
    attributes = thing.data.color_attributes if thing.type == "MESH" else ()
    if ATTRIBUTE not in attributes or thing.mode == "EDIT" or thing.data.library:
        return
    attributes.remove(attributes[ATTRIBUTE])
    active, rendered = before(scene)["meshes"].get(thing.data.name, ["", -1])
    if active in attributes:
        attributes.active_color = attributes[active]
    if 0 <= rendered < len(attributes):
        attributes.render_color_index = rendered


def forget_attributes(scene):
    known = before(scene)
    for thing in scene.objects:
        forget_attribute(scene, thing)
    for screen in bpy.data.screens:
        for index, area in enumerate(screen.areas):
            kept = known["windows"].get(f"{screen.name}/{index}")
            if kept and area.type == "VIEW_3D" and area.spaces.active.shading.color_type == "VERTEX":
                area.spaces.active.shading.color_type = kept
    scene.drapery.before_colours = ""
