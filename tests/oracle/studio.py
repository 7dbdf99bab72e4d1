"""The look of the rendered pictures: a photographer's studio with soft light, cloth with a weave, and a tailor's dummy.

`render_contact_sheet.py` and `tools/docs/pictures.py` use it. The weave is drawn coarser than it is, a few pixels for a thread, so that
fabrics can be told apart at the distance from which a whole figure is seen.
"""

import math

import bpy
import numpy as np
from PIL import Image, ImageDraw, ImageFont

SAMPLES = 10  # with the denoiser after them
QUALITY = 88  # of the JPEG files
THREAD = 0.0037  # width of a thread over the height that is seen: two to three pixels
# Weave, colour (linear RGB), roughness, sheen.
LOOKS = {
    "wool_teal": ("twill", (0.020, 0.110, 0.150), 0.85, 0.35),
    "wool_wine": ("twill", (0.190, 0.012, 0.026), 0.85, 0.40),
    "wool_grey": ("twill", (0.075, 0.085, 0.110), 0.85, 0.35),
    "jersey_coral": ("knit", (0.620, 0.130, 0.075), 0.90, 0.25),
    "jersey_cream": ("knit", (0.700, 0.560, 0.400), 0.90, 0.25),
    "denim": ("denim", (0.030, 0.075, 0.190), 0.95, 0.05),
    "silk": ("satin", (0.600, 0.200, 0.210), 0.42, 0.80),
    "lining": ("satin", (0.560, 0.030, 0.035), 0.38, 0.40),
    "leather": ("grain", (0.150, 0.045, 0.016), 0.48, 0.00),
    "leather_plain": ("smooth", (0.120, 0.034, 0.012), 0.38, 0.00),
    "cotton": ("plain", (0.660, 0.640, 0.580), 0.85, 0.15),
    "cotton_blue": ("plain", (0.100, 0.230, 0.440), 0.85, 0.15),
    "cotton_olive": ("plain", (0.200, 0.210, 0.080), 0.85, 0.15),
    "horn": ("smooth", (0.055, 0.022, 0.010), 0.22, 0.00),
    "dummy": ("smooth", (0.440, 0.385, 0.320), 0.75, 0.10),
    "wood": ("smooth", (0.115, 0.048, 0.020), 0.38, 0.00),
    "steel": ("smooth", (0.300, 0.310, 0.330), 0.35, 0.00),
    "plaster": ("smooth", (0.520, 0.510, 0.490), 0.70, 0.00),
}
GARMENTS = ["wool_teal", "jersey_coral", "cotton_olive", "wool_wine", "denim"]
# Of the mannequin at its first frame, with its arms half raised [m]: height, neck, tip of a hand, shoulder, and length of a hand.
TALL, NECK, FINGERS, SHOULDER, HAND = 1.70, 1.475, np.array([0.605, 0.81]), np.array([0.20, 1.40]), 0.185


class Nodes:
    """Nodes of a material, made one by one and linked to what they take."""

    def __init__(self, tree):
        self.tree = tree

    def put(self, kind, _socket=0, _settings=(), **inputs):
        """A node of a kind, with inputs by number (`i0`) or name; returns one of its outputs."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for key, value in dict(_settings).items():
            setattr(node, key, value)
        for key, value in inputs.items():
            socket = node.inputs[int(key[1:]) if key[1:].isdigit() else key.replace("_", " ")]
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, socket)
            else:
                socket.default_value = value
        return node.outputs[_socket]

    def math(self, operation, first, second=0.0):
        return self.put("Math", _settings={"operation": operation}, i0=first, i1=second)

    def wave(self, turns):
        """A sine of this phase, in turns, from 0 to 1."""
        return self.half(self.math("SINE", self.math("MULTIPLY", turns, math.tau)))

    def half(self, value):
        """A number between -1 and 1 as one between 0 and 1."""
        return self.math("ADD", self.math("MULTIPLY", value, 0.5), 0.5)


def pattern(nodes, weave, u, v, place):
    """Height of the threads, 0 to 1, at coordinates along and across the cloth in threads."""
    if weave == "plain":
        across, along = (nodes.math("SINE", nodes.math("MULTIPLY", way, math.pi)) for way in (u, v))
        return nodes.half(nodes.math("MULTIPLY", across, along))
    if weave in ("twill", "denim"):
        return nodes.wave(nodes.math("MULTIPLY", nodes.math("ADD", u, v), 0.5))
    if weave == "knit":
        slant = nodes.math("MULTIPLY", nodes.math("PINGPONG", u, 1.0), 0.6)
        return nodes.math("MULTIPLY", nodes.wave(nodes.math("ADD", v, slant)), nodes.math("PINGPONG", u, 1.0))
    if weave == "grain":
        cells = nodes.put("TexVoronoi", _settings={"feature": "DISTANCE_TO_EDGE"}, Vector=place, Scale=0.55, Randomness=1.0)
        return nodes.math("MINIMUM", nodes.math("MULTIPLY", cells, 4.0), 1.0)
    return nodes.put("TexNoise", Vector=nodes.put("CombineXYZ", X=nodes.math("MULTIPLY", u, 0.05), Y=v), Scale=1.0, Detail=2.0)


# Depth of the relief in threads, and how much darker its valleys are.
RELIEF = {"plain": (0.25, 0.35), "twill": (0.20, 0.35), "denim": (0.30, 0.60), "knit": (0.30, 0.40),
          "grain": (0.15, 0.30), "satin": (0.02, 0.05)}


def material(look, thread, extent=None):
    """Material of a look. `thread` is the width of a thread [m], `extent` the lengths [m] of a unit of the UVs along u and v."""
    weave, colour, roughness, sheen = LOOKS[look]
    made = bpy.data.materials.new(look)
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1.0)
    shader.inputs["Roughness"].default_value = roughness
    shader.inputs["Sheen Weight"].default_value = sheen
    shader.inputs["Sheen Roughness"].default_value = 0.4
    if weave in ("knit", "twill", "denim", "plain"):
        shader.inputs["Specular IOR Level"].default_value = 0.2
    if weave == "satin":
        shader.inputs["Anisotropic"].default_value = 0.5
    if weave == "smooth" or extent is None:
        return made
    nodes = Nodes(made.node_tree)
    threads = (extent[0] / thread, extent[1] / thread, 1.0)
    place = nodes.put("VectorMath", _settings={"operation": "MULTIPLY"}, i0=nodes.put("UVMap"), i1=threads)
    along = nodes.tree.nodes.new("ShaderNodeSeparateXYZ")
    nodes.tree.links.new(place, along.inputs[0])
    height = pattern(nodes, weave, along.outputs[0], along.outputs[1], place)
    depth, darker = RELIEF[weave]
    # Patches where the dye took a little less, else large folds look like plastic.
    cloudy = nodes.put("TexNoise", Vector=place, Scale=0.08, Detail=3.0)
    share = nodes.math("ADD", nodes.math("MULTIPLY", height, darker), nodes.math("MULTIPLY", cloudy, 0.3))
    share = nodes.math("ADD", share, 1.0 - 0.5 * darker - 0.15)
    tinted = nodes.put("VectorMath", _settings={"operation": "SCALE"}, i0=colour, Scale=share)
    nodes.tree.links.new(tinted, shader.inputs["Base Color"])
    nodes.tree.links.new(nodes.put("Bump", Strength=1.0, Distance=depth * thread, Height=height), shader.inputs["Normal"])
    return made


def import_meshes(path):
    """Mesh objects of an Alembic file."""
    before = set(bpy.data.objects)
    bpy.ops.wm.alembic_import(filepath=str(path), as_background_job=False, set_frame_range=False)
    return [thing for thing in bpy.data.objects if thing not in before and thing.type == "MESH"]


def points_of(thing):
    """World positions [m] of a mesh at the current frame, shape (points, 3)."""
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    points = np.empty(3 * len(evaluated.data.vertices), np.float32)
    evaluated.data.vertices.foreach_get("co", points)
    matrix = np.array(evaluated.matrix_world)
    return points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


def all_points(things):
    return np.concatenate([points_of(thing) for thing in things])


def unit_of_uvs(mesh):
    """Lengths [m] of a unit of the UVs along u and v, as most triangles of a mesh have them; nothing if it has none."""
    if not mesh.uv_layers:
        return None
    mesh.calc_loop_triangles()
    corners = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", corners)
    points, vertices, uvs = (np.empty(count, kind) for count, kind in (
        (3 * len(mesh.vertices), np.float32), (len(mesh.loops), np.int32), (2 * len(mesh.loops), np.float32)))
    mesh.vertices.foreach_get("co", points)
    mesh.loops.foreach_get("vertex_index", vertices)
    mesh.uv_layers[0].uv.foreach_get("vector", uvs)
    place = points.reshape(-1, 3)[vertices[corners]].reshape(-1, 3, 3)
    flat = uvs.reshape(-1, 2)[corners].reshape(-1, 3, 2)
    edges, spans = place[:, 1:] - place[:, :1], flat[:, 1:] - flat[:, :1]
    whole = np.abs(np.linalg.det(spans)) > 1e-12
    if not whole.any():
        return None
    slopes = np.linalg.solve(spans[whole], edges[whole])
    return np.median(np.linalg.norm(slopes, axis=2), axis=0)


def dress(things, made, subdivide=1):
    """Gives meshes a material, and rounds their faces as renderers do."""
    for thing in things:
        thing.data.materials.clear()
        thing.data.materials.append(made)
        thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))
        if subdivide:
            rounded = thing.modifiers.new("rounded", "SUBSURF")
            rounded.levels = rounded.render_levels = subdivide


def wear(things, look, thread, subdivide=1):
    """Gives a garment its fabric, with threads of this width [m]; looks by name of a material that the file has dress its parts."""
    for thing in things:
        of_faces, names = np.empty(len(thing.data.polygons), np.int32), [made.name for made in thing.data.materials]
        thing.data.polygons.foreach_get("material_index", of_faces)
        unit = unit_of_uvs(thing.data)
        looks = [look] if isinstance(look, str) else [look[name.split(".")[0]] for name in names]
        dress([thing], material(looks[0], thread, unit), subdivide)
        for other in looks[1:]:
            thing.data.materials.append(material(other, thread, unit))
        if len(looks) > 1:
            thing.data.polygons.foreach_set("material_index", of_faces)


class Dummy:
    """A body shown as a tailor's dummy: without head and hands, with caps of wood. The mesh that cloth has met stays as it is.

    Heads and hands are told by where they are at the first frame of the file, with the mannequin's arms half raised. A body of another
    size is shown whole.
    """

    def __init__(self, path, first):
        (self.source, *others) = import_meshes(path)
        self.whole = [self.source, *others]
        bpy.context.scene.frame_set(first)
        points = points_of(self.source)
        self.made, self.looks = None, [material("dummy", 0.001), material("wood", 0.001)]
        if others or abs(points[:, 2].max() - TALL) > 0.02:
            dress(self.whole, self.looks[0])
            return
        faces = faces_of(self.source.data)
        arm = (FINGERS - SHOULDER) / np.linalg.norm(FINGERS - SHOULDER)
        along = (np.stack([np.abs(points[:, 0]), points[:, 2]], axis=1) - SHOULDER) @ arm
        hands = (along > np.linalg.norm(FINGERS - SHOULDER) - HAND) & (np.abs(points[:, 0]) > 0.35)
        gone = hands | (points[:, 2] > NECK)
        self.faces = [face for face in faces if not gone[list(face)].any()]
        self.rims = rims(self.faces)
        self.source.hide_render = True
        self.whole = []

    def pose(self):
        """The dummy as the body is at the current frame; returns what is to be seen of it."""
        if self.whole:
            return self.whole
        if self.made:
            bpy.data.objects.remove(self.made)
        points, faces = list(points_of(self.source)), list(self.faces)
        for rim in self.rims:
            add_cap(points, faces, rim)
        mesh = bpy.data.meshes.new("dummy")
        mesh.from_pydata(points, [], faces)
        self.made = bpy.data.objects.new("dummy", mesh)
        bpy.context.scene.collection.objects.link(self.made)
        dress([self.made], self.looks[0])
        mesh.materials.append(self.looks[1])
        for face in mesh.polygons[len(self.faces):]:
            face.material_index = 1
        return [self.made]


def faces_of(mesh):
    """Vertices of each face."""
    starts, corners = np.empty(len(mesh.polygons), np.int32), np.empty(len(mesh.loops), np.int32)
    mesh.polygons.foreach_get("loop_start", starts)
    mesh.loops.foreach_get("vertex_index", corners)
    return [tuple(face) for face in np.split(corners, starts[1:])]


def rims(faces):
    """Closed chains of the edges that have one face alone, each in the direction of that face."""
    following = {}
    edges = {(a, b) for face in faces for a, b in zip(face, face[1:] + face[:1])}
    for a, b in edges:
        if (b, a) not in edges:
            following[b] = a
    found = []
    while following:
        begin, after = following.popitem()
        chain = [begin]
        while after != begin:
            chain.append(after)
            after = following.pop(after)
        found.append(chain)
    return found


def add_cap(points, faces, rim):
    """Closes a hole by a dome that is as high as a third of its width."""
    ring = np.array([points[index] for index in rim])
    middle = ring.mean(axis=0)
    turned = np.roll(ring, -1, axis=0)
    normal = np.cross(ring - middle, turned - middle).sum(axis=0)
    normal /= np.linalg.norm(normal)
    flat = ring - np.outer((ring - middle) @ normal, normal)
    width = np.linalg.norm(flat - middle, axis=1).mean()
    below = list(rim)
    for step in range(0, 6):
        turn = 0.5 * math.pi * step / 6
        level = middle + (flat - middle) * math.cos(turn) * 1.04 + normal * (0.35 * width * math.sin(turn) + 0.08 * width)
        above = list(range(len(points), len(points) + len(rim)))
        points.extend(level)
        faces.extend((below[i], below[(i + 1) % len(rim)], above[(i + 1) % len(rim)], above[i]) for i in range(len(rim)))
        below = above
    faces.append(tuple(below))


def look_at(thing, place, target):
    thing.location = place
    direction = np.asarray(target) - np.asarray(place)
    flat = math.hypot(direction[0], direction[1])
    thing.rotation_euler = (math.atan2(flat, -direction[2]), 0.0, math.atan2(-direction[0], direction[1]))


class Studio:
    """Floor, backdrop, lamps and camera. They stand around the target of the camera and turn with it, so that all panels are lit alike."""

    LAMPS = [("key", (-1.3, -1.5, 2.2), 1.0, 92.0), ("fill", (2.2, -1.3, 0.9), 1.8, 12.0), ("rim", (1.3, 1.5, 2.1), 0.9, 46.0),
             ("top", (0.0, 0.2, 2.8), 1.6, 40.0)]

    def __init__(self, width, height):
        scene = self.scene = bpy.context.scene
        world = scene.world = bpy.data.worlds.new("studio")
        world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.80, 0.86, 0.95, 1.0)
        world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.28
        self.lamps = []
        for name, _, _, _ in self.LAMPS:
            self.lamps.append(bpy.data.objects.new(name, bpy.data.lights.new(name, "AREA")))
            scene.collection.objects.link(self.lamps[-1])
        self.backdrop = self.make_backdrop()
        camera = bpy.data.cameras.new("camera")
        camera.lens, camera.sensor_fit, camera.sensor_height = 70.0, "VERTICAL", 36.0
        scene.camera = bpy.data.objects.new("camera", camera)
        scene.collection.objects.link(scene.camera)
        scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
        scene.cycles.samples, scene.cycles.use_denoising, scene.cycles.seed = SAMPLES, True, 1
        scene.cycles.max_bounces, scene.cycles.caustics_reflective, scene.cycles.caustics_refractive = 2, False, False
        scene.cycles.use_adaptive_sampling, scene.cycles.adaptive_threshold, scene.cycles.adaptive_min_samples = True, 0.1, 4
        scene.cycles.denoising_prefilter = "FAST"
        scene.render.resolution_x, scene.render.resolution_y = width, height
        scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGB"
        scene.render.dither_intensity = 1.0
        scene.view_settings.view_transform = "AgX"
        scene.view_settings.look = "AgX - Medium High Contrast"

    def make_backdrop(self):
        """A sheet of paper that is floor in front and wall behind, for something one metre high."""
        side = [(0.0, -8.0, 0.0), (0.0, 1.6, 0.0)]
        side += [(0.0, 1.6 + 1.6 * math.sin(t), 1.6 - 1.6 * math.cos(t)) for t in np.linspace(0.0, 0.5 * math.pi, 25)[1:]]
        side += [(0.0, 3.2, 9.0)]
        points = [(x, y, z) for _, y, z in side for x in (-12.0, 12.0)]
        faces = [(2 * i, 2 * i + 1, 2 * i + 3, 2 * i + 2) for i in range(len(side) - 1)]
        mesh = bpy.data.meshes.new("backdrop")
        mesh.from_pydata(points, [], faces)
        paper = bpy.data.materials.new("paper")
        shader = paper.node_tree.nodes["Principled BSDF"].inputs
        shader["Base Color"].default_value, shader["Roughness"].default_value = (0.60, 0.60, 0.61, 1.0), 0.9
        shader["Specular IOR Level"].default_value = 0.1
        mesh.materials.append(paper)
        mesh.polygons.foreach_set("use_smooth", [True] * len(mesh.polygons))
        thing = bpy.data.objects.new("backdrop", mesh)
        self.scene.collection.objects.link(thing)
        return thing

    def aim(self, target, seen, turn, tilt, floor):
        """Looks at a target [m] from a direction, where `seen` metres of height are in the picture."""
        turn, tilt = math.radians(turn), math.radians(tilt)
        away = np.array([math.sin(turn) * math.cos(tilt), -math.cos(turn) * math.cos(tilt), math.sin(tilt)])
        camera = self.scene.camera
        distance = seen * camera.data.lens / camera.data.sensor_height
        look_at(camera, np.asarray(target) + distance * away, target)
        camera.data.clip_end = 100.0 * seen
        base = np.array([target[0], target[1], floor])
        self.backdrop.location, self.backdrop.scale = base, (seen,) * 3
        self.backdrop.rotation_euler = (0.0, 0.0, turn)
        turned = np.array([[math.cos(turn), -math.sin(turn), 0.0], [math.sin(turn), math.cos(turn), 0.0], [0.0, 0.0, 1.0]])
        for lamp, (_, place, size, power) in zip(self.lamps, self.LAMPS):
            look_at(lamp, base + turned @ np.array(place) * seen, target)
            lamp.data.size, lamp.data.energy = size * seen, power * seen**2

    def photograph(self, file):
        self.scene.render.filepath = str(file)
        bpy.ops.render.render(write_still=True)


def seen_height(extents, width, height):
    """Height [m] that shows all of these points, and the height of its middle."""
    heights = np.concatenate(extents)[:, 2]
    low, high = heights.min(), heights.max()
    across = max(np.ptp(points[:, :2], axis=0).max() for points in extents)
    return 1.12 * max(high - low, across * height / width), 0.5 * (low + high)


def compose(pictures, labels, path, columns=3):
    """Panels side by side, each with its label, as one file."""
    panels = [Image.open(picture).convert("RGB") for picture in pictures]
    width, height, gap = panels[0].width, panels[0].height, 6
    columns = min(columns, len(panels))
    rows = -(-len(panels) // columns)
    sheet = Image.new("RGB", (columns * (width + gap) - gap, rows * (height + gap) - gap), (255, 255, 255))
    font = ImageFont.load_default(size=22)
    for index, (panel, label) in enumerate(zip(panels, labels)):
        ink = ImageDraw.Draw(panel)
        behind = np.asarray(panel.crop([round(side) for side in ink.textbbox((14, height - 14), str(label), font, "ld")]))
        ink.text((14, height - 14), str(label), font=font, fill=(62, 66, 74) if behind.mean() > 128 else (240, 240, 240), anchor="ld")
        sheet.paste(panel, (index % columns * (width + gap), index // columns * (height + gap)))
    save(sheet, path)


def save(picture, path):
    """Writes a picture; as JPEG with all its colours in every pixel."""
    path = str(path)
    how = {"quality": QUALITY, "subsampling": 0} if path.endswith((".jpg", ".jpeg")) else {}
    picture.save(path, optimize=True, **how)
