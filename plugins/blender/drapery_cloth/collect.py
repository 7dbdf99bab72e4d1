"""From what is marked in a Blender scene to the scene file and the job of the export; nothing is evaluated or written here."""

from pathlib import Path

import bpy

from .answers import Problem
from .fabrics import FABRICS
from .keyframes import NotSampled, over_time
from .pictures import OTHER
from .scene_text import (
    MAPS,
    MESHES,
    Body,
    Contact,
    Garment,
    Map,
    Part,
    Pin,
    RenderMesh,
    Belt,
    Elastic,
    Seam,
    Shot,
    frame_rate,
    names_taken_twice,
    plain_name,
    scene_text,
)
from .settings import ATTRIBUTES, DEFORMING

# What Load adds to an object, by name: it is taken off the copy that is exported, and off the object by Unload.
CACHE = "Drapery Cache"
CONSTRAINTS = ("Drapery Cache Rotation", "Drapery Cache Scale", "Drapery Cache Location")
# The modifier of the Live View, and what an object may have of Drapery's in the place where the simulation belongs.
LIVE = "Drapery Live"
SIMULATED = (CACHE, LIVE)
# A scene has up to two runs: the simulation, and a preview in a folder of its own inside the scene folder.
FINAL, PREVIEW = "", "preview"
KINDS = (FINAL, PREVIEW)
# Sizes in metres of which the solver asks nothing, and of clothes. Where clothes have them, the unit of length is right, and a cup or a
# ship is as large as it is meant.
OF_BODIES, OF_GARMENTS = (0.21, 19.0), (0.03, 19.0)



def marked(scene, role):
    """Objects of the scene with a role, in a fixed order."""
    things = [thing for thing in scene.objects if thing.type == "MESH" and thing.drapery.role == role]
    return sorted(things, key=lambda thing: thing.name_full)


def division(thing):
    """Number of modifiers of a garment, from the top, that shape the simulated mesh. The cache comes after them."""
    for index, modifier in enumerate(thing.modifiers):
        if modifier.name in SIMULATED:
            return index
        deforms = modifier.type in DEFORMING or not (modifier.show_viewport or modifier.show_render)
        if thing.drapery.simulated == "BASE" and not deforms:
            return index
    return len(thing.modifiers)


def scene_folder(scene, kind=FINAL):
    """The folder of the scene, or of its preview; None where it is relative to a file that was never saved."""
    # Files that lie side by side, and scenes of one file, do not get into each other's way.
    path = scene.drapery.folder or f"//drapery/{plain_name(Path(bpy.data.filepath).stem)}/{shot_name(scene)}"
    if path.startswith("//") and not bpy.data.filepath:
        return None
    return Path(bpy.path.abspath(path)).resolve() / kind


def frames(scene):
    own = scene.drapery
    return (own.first, own.last) if own.own_range else (scene.frame_start, scene.frame_end)


def shot_name(scene):
    return plain_name(scene.name)


def run_folder(scene, kind=FINAL):
    """Folder of the run when the command is called in the scene folder, here and on a farm; None as `scene_folder`."""
    folder = scene_folder(scene, kind)
    return folder and folder / "out" / shot_name(scene)


def within(number, span):
    return span[0] <= number <= span[1]


def largest_strain(own):
    """Largest strain of a garment, as a share of its length; None for a material that only the studio's files hold."""
    if own.own_strain:
        return own.strain / 100
    return next((fabric.strain / 100 for fabric in FABRICS if fabric.name == own.fabric), None)


def hundredth(value):
    """Per cent as a share, of a number or of a curve."""
    return [(frame, each / 100) for frame, each in value] if isinstance(value, list) else value / 100


def part_of_other(rule):
    """The vertex group of the other garment that a rule of contact is for; bodies have no parts."""
    is_garment = rule.other is not None and rule.other.drapery.role == "GARMENT"
    return rule.other_group if is_garment else ""


def upright(vector):
    """Blender's Z up as the solver's Y up; also of the keys of a curve."""
    if isinstance(vector, list):
        return [(frame, upright(each)) for frame, each in vector]
    x, y, z = vector
    return x, z, -y


class Collected:
    """A scene in three forms: `text`, the scene file; `job`, what the export is asked for; `problems` that prevent both.

    The job is None, and there is no text, where there are problems. `warnings` prevent nothing.
    """

    def __init__(self, scene, kind=FINAL):
        self.scene, self.kind = scene, kind
        self.folder = scene_folder(scene, kind)
        self.garments, self.bodies = marked(scene, "GARMENT"), marked(scene, "BODY")
        self.problems, self.warnings = [], []
        # Sentences about the settings that change over the shot.
        self.curves = []
        self.look()
        self.job = self.parts = None
        if not self.problems:
            self.describe()
        if self.problems:
            self.job = self.parts = None

    def say(self, message, help, thing=None, frame=None):
        self.problems.append(Problem(message, help, thing and plain_name(thing.name), frame))

    def look(self):
        """Reports the problems that show without evaluating anything."""
        own, [first, last] = self.scene.drapery, frames(self.scene)
        if self.folder is None:
            self.say("The scene folder is relative to a file that was not saved yet", "save the file, or choose a folder")
        if not self.garments:
            self.say("No object is marked as a garment", "select a mesh and choose Garment under Object")
        if last < first:
            self.say(f"The frame range ends before it starts: {first} to {last}", "choose an end after the start")
        stretch = self.scene.render
        if stretch.frame_map_old != stretch.frame_map_new:
            self.say(f"Time Stretching is {stretch.frame_map_old} to {stretch.frame_map_new}: the cache would be shown at other frames than "
                     "it was simulated for", "set both to 100 under Output > Frame Range")
        if own.blend and not own.own_rest:
            self.say("Blend frames lead from the rest frame to the first", "choose a rest frame, or set Blend to 0")
        if own.own_rest and own.rest_frame != first and not own.blend and self.bodies:
            self.say("Bodies would jump from the rest frame to the first", "set Blend to some frames, 10 for example")
        for other in bpy.data.scenes:
            if other != self.scene and self.folder and scene_folder(other, self.kind) == self.folder and marked(other, "GARMENT"):
                self.say(f'The scene "{other.name}" has the same folder, {self.folder}', "choose another for one of them")
        for things, what in ((self.garments, "garments"), (self.bodies, "bodies")):
            for group in names_taken_twice([thing.name for thing in things]):
                first_of = next(thing for thing in things if thing.name == group[0])
                self.say(f"{len(group)} {what} would have one name, {plain_name(group[0])}: " + ", ".join(f'"{name}"' for name in group),
                         "rename them: letters and digits tell names apart, capitals and other signs do not", first_of)
        for thing in self.garments + self.bodies:
            # What is edited is in the mesh only then.
            thing.update_from_editmode()
            if not thing.data.polygons and not thing.modifiers:
                self.say(f'"{thing.name}" has no faces', "only surfaces are simulated: fill the edges with faces, or unmark it", thing)
        for thing in self.garments:
            self.look_at(thing)
        self.look_at_seams()
        taken = {plain_name(thing.name).lower() for thing in self.garments + self.bodies}
        for thing in self.bodies:
            for belt in thing.drapery.belts:
                if belt.place is None:
                    self.say(f'"{thing.name}": a belt has no place', "choose an empty in the middle of the waist, or remove the belt", thing)
                elif plain_name(belt.place.name).lower() in taken:
                    self.say(f'"{thing.name}": a belt would have the name of another object, "{belt.place.name}"', "rename the empty", thing)
                else:
                    taken.add(plain_name(belt.place.name).lower())

    def look_at(self, thing):
        own = thing.drapery
        if own.fabric == OTHER and not own.other_fabric:
            self.say(f'"{thing.name}" has no fabric', "choose one, or write the name of the studio's material", thing)
        if own.stiffens and largest_strain(own) is None:
            self.say(f'"{thing.name}" stiffens up to a strain that is not known of its material', "set its Strain", thing)
        self.look_at_render_mesh(thing)
        self.look_at_contacts(thing)
        for pin in own.pins:
            if not pin.group:
                self.say(f'"{thing.name}": a pin has no vertex group', "choose one, or remove the pin", thing)
            if pin.released and pin.release < frames(self.scene)[0]:
                self.say(f'"{thing.name}": a pin is released at frame {pin.release}, before the first frame', "choose a later frame, or "
                         "remove the pin", thing)
            if pin.hold == "BODY" and not self.body_of(pin):
                self.say(f'"{thing.name}": a pin holds on to a body, and none is marked', "mark a body, or hold the vertices fixed",
                         thing)
            if pin.body and pin.body not in self.bodies:
                self.say(f'"{thing.name}": the body of a pin, "{pin.body.name}", is not marked in this scene', "choose another", thing)
        for band in own.elastics:
            if not band.group:
                self.say(f'"{thing.name}": an elastic band has no vertex group', "choose one, or remove the band", thing)
        quantities = [painted.quantity for painted in own.maps]
        for quantity in sorted(set(quantities)):
            if quantities.count(quantity) > 1:
                self.say(f'"{thing.name}": {quantity} is painted by {quantities.count(quantity)} maps', "keep one of them", thing)
        for painted in own.maps:
            if not painted.name:
                self.say(f'"{thing.name}": the map for {painted.quantity} is empty', "choose a group or an attribute", thing)
        if own.simulated == "ALL":
            self.look_at_levels(thing)
        mirrors = [modifier.name for modifier in list(thing.modifiers)[division(thing) :] if modifier.type == "MIRROR"]
        if mirrors:
            self.warnings.append(Problem(
                f'"{thing.name}": {mirrors[0]} comes after the simulated mesh, so that one half is cloth and the other its mirror image',
                "apply it, or choose Simulated Mesh: After All Modifiers", plain_name(thing.name), warning=True))

    def look_at_render_mesh(self, thing):
        mesh = thing.drapery.render_mesh
        if mesh is None:
            return
        others = [other for other in self.garments if other != thing and other.drapery.render_mesh == mesh]
        if mesh.name not in self.scene.objects or mesh.type != "MESH" or mesh.drapery.role != "NONE":
            self.say(f'"{thing.name}": its render mesh, "{mesh.name}", is a garment or a body, or is not in this scene',
                     "choose a mesh of this scene that takes no part in the simulation", thing)
        elif others:
            self.say(f'"{thing.name}" and "{others[0].name}" have the same render mesh, "{mesh.name}"', "make a copy for one of them", thing)

    def look_at_contacts(self, thing):
        for rule in thing.drapery.contacts:
            other = rule.other
            what = f'"{thing.name}": a rule of contact'
            sides = (thing, rule.group), (other, part_of_other(rule))
            again = sum(sides == ((thing, each.group), (each.other, part_of_other(each))) for each in thing.drapery.contacts) > 1
            if other is None:
                self.say(f"{what} is with no object", "choose a garment or a body, or remove the rule", thing)
            elif other not in [*self.garments, *self.bodies]:
                self.say(f'{what} is with "{other.name}", which is neither a garment nor a body of this scene',
                         "mark it as one, choose another, or remove the rule", thing)
            elif again or (other in self.garments and other != thing and thing.name > other.name
                           and any(((each.other, part_of_other(each)), (other, each.group)) == sides for each in other.drapery.contacts)):
                self.say(f'{what} with "{other.name}" is there twice', "remove one of them", thing)
            elif not (rule.ignore or rule.own_friction or rule.own_thickness):
                self.say(f'{what} with "{other.name}" says nothing', "choose Ignore, Friction or Thickness, or remove the rule", thing)

    def value(self, group, name):
        """A setting, or its keys where it changes over the shot; what is not sampled becomes a problem."""
        first, last = frames(self.scene)
        label = group.bl_rna.properties[f"own_{name}" if hasattr(group, f"own_{name}") else name].name
        thing = group.id_data if isinstance(group.id_data, bpy.types.Object) else None
        where = f'"{thing.name}": {label}' if thing else label
        if getattr(group, "other", None):
            where += f' of the contact with "{group.other.name}"'
        try:
            found = over_time(group, name, first, last)
        except NotSampled as error:
            self.say(f"{where} is animated by {error}, which is not sampled", "bake it to keyframes (Object > Animation > Bake Action, or "
                     "key the value itself), or remove it", thing)
            return getattr(group, name)
        if isinstance(found, list):
            self.curves.append(f"{where}: {len(found)} keys from frame {found[0][0]} to {found[-1][0]}")
        return found

    def look_at_seams(self):
        sewn = set()
        for thing in self.garments:
            for seam in thing.drapery.seams:
                sides = frozenset(((thing, seam.group), (seam.other, seam.other_group)))
                self.look_at_seam(thing, seam, sides in sewn)
                sewn.add(sides)

    def look_at_seam(self, thing, seam, again):
        own, other = seam.group, seam.other
        what = f'"{thing.name}": the seam of its group "{own}"'
        if not own:
            self.say(f'"{thing.name}": a seam has no vertex group', "choose one, or remove the seam", thing)
        elif other is None:
            self.say(f"{what} leads to no garment", "choose the one that it is sewn to, or remove the seam", thing)
        elif other not in self.garments:
            self.say(f'{what} leads to "{other.name}", which is not a garment of this scene', "mark it as one, choose another, or remove "
                     "the seam", thing)
        elif seam.pairing == "SURFACE" and other == thing:
            self.say(f"{what} leads to the surface of its own garment", "choose another garment, or other pairs", thing)
        elif not seam.other_group and seam.pairing != "SURFACE":
            self.say(f'{what} leads to no vertex group of "{other.name}"', "choose one, or remove the seam", thing)
        elif (thing, own) == (other, seam.other_group):
            self.say(f"{what} leads to the same group", "choose another group, or another garment", thing)
        elif again:
            self.say(f'{what} to "{seam.other_group}" of "{other.name}" is there twice', "remove one of them", thing)
        if seam.own_closing and seam.closed < seam.start:
            self.say(f"{what} is closed at frame {seam.closed}, before it starts to close at frame {seam.start}",
                     "choose a later frame, or the same one for a seam that closes at once", thing)
        if seam.own_opening and seam.opened < seam.opens:
            self.say(f"{what} is open at frame {seam.opened}, before it starts to open at frame {seam.opens}",
                     "choose a later frame, or the same one for a button that opens at once", thing)
        if seam.own_opening and seam.own_closing and seam.opens < seam.closed:
            self.say(f"{what} opens at frame {seam.opens}, before it is closed at frame {seam.closed}", "let it open later", thing)
        if seam.zip and seam.pairing != "LINE":
            self.say(f"{what} is a zip, and its pairs have no order", "choose Pairs: Along the Edges", thing)

    def look_at_levels(self, thing):
        for modifier in list(thing.modifiers)[: division(thing)]:
            if modifier.type in DEFORMING:
                continue
            levels = modifier.type in ("SUBSURF", "MULTIRES") and modifier.levels != modifier.render_levels
            if levels or modifier.show_viewport != modifier.show_render:
                self.say(f'"{thing.name}": {modifier.name} gives other vertices in the render than in the window',
                         "make both levels the same, or simulate before subdivision", thing)

    def body_of(self, pin):
        """The body that a pin is bound to: the chosen one, else the first; of springs the chosen one alone."""
        if pin.hold == "FIXED":
            return None
        if pin.body or pin.hold == "SPRING":
            return pin.body
        return self.bodies[0] if self.bodies else None

    def describe(self):
        own, [first, last] = self.scene.drapery, frames(self.scene)
        rest_frame = own.rest_frame if own.own_rest else first
        rate = frame_rate(self.scene.render.fps, self.scene.render.fps_base)
        shot = Shot(shot_name(self.scene), first, last, rate, own.settle, own.blend, self.kind or own.preset, None, own.self_contact)
        if own.gravity:
            shot.gravity = upright(self.value(own, "gravity_acceleration"))
        if own.wind:
            shot.wind, shot.drag = upright(self.value(own, "wind_velocity")), (own.wind_normal, own.wind_tangential)
        if own.air_drag:
            shot.air_drag = self.value(own, "air_drag_rate")
        if own.self_contact:
            shot.self_friction = self.value(own, "self_friction")
        shot.formats = ("abc", *(["h5"] if own.also_h5 else []), *(["usd"] if own.also_usd else []))
        shot.attributes = tuple(word for word, *_ in ATTRIBUTES if word in own.attributes)
        self.job = {
            "scene": self.scene.name, "folder": str(self.folder), "frames": [first, last], "rest_frame": rest_frame,
            "scale": self.scene.unit_settings.scale_length, "constraints": CONSTRAINTS, "bodies": [], "garments": [], "render_meshes": [],
            "seams": [],
        }  # fmt: skip
        bodies = [self.body(thing, rest_frame != first) for thing in self.bodies]
        garments = [self.garment(thing, first, rate) for thing in self.garments]
        contacts = [self.contact(thing, rule) for thing in self.garments for rule in thing.drapery.contacts]
        seams = [self.seam(thing, seam, first, rate) for thing in self.garments for seam in thing.drapery.seams]
        belts = [self.belt(thing, belt) for thing in self.bodies for belt in thing.drapery.belts if belt.place]
        self.parts = shot, bodies, garments, seams, contacts, belts

    def text(self, sewn, sizes):
        """The scene file. Of the export it needs the vertices of both sides of each seam, and the size of each mesh in metres."""
        shot, bodies, garments, seams, contacts, belts = self.parts
        usual = all(within(sizes[garment.file], OF_GARMENTS) for garment in garments)
        for body in bodies:
            body.sized = usual and not within(sizes[body.file], OF_BODIES)
        return scene_text(shot, bodies, garments, zip(seams, sewn), contacts, belts)

    def body(self, thing, rest):
        own, name = thing.drapery, plain_name(thing.name)
        file = f"{MESHES}/body_{name}.abc"
        rest_file = f"{MESHES}/rest_{name}.abc" if rest else None
        self.job["bodies"].append({"object": thing.name_full, "file": file, "rest_file": rest_file})
        pose = f"{rest_file}@{self.job['rest_frame']}" if rest else None
        return Body(name, file, pose, *(self.value(own, key) if getattr(own, f"own_{key}") else None for key in ("thickness", "friction")))

    def contact(self, thing, rule):
        own = "garment", plain_name(thing.name), *self.part_names(rule.group)
        other = rule.other.drapery.role.lower(), plain_name(rule.other.name), *self.part_names(part_of_other(rule))
        numbers = [self.value(rule, key) if getattr(rule, f"own_{key}") and not rule.ignore else None for key in ("friction", "thickness")]
        return Contact((own, other), rule.ignore, *numbers)

    @staticmethod
    def part_names(group):
        """The name of the part of a garment that a vertex group is, as a list; none without a group."""
        return [plain_name(group)] if group else []

    def groups_in_contact(self, thing):
        """Vertex groups of a garment that rules of contact name, each once, in the order of the rules."""
        rules = [(other, rule) for other in self.garments for rule in other.drapery.contacts]
        own = [rule.group for other, rule in rules if other == thing]
        return list(dict.fromkeys(filter(None, own + [part_of_other(rule) for _, rule in rules if rule.other == thing])))

    def garment(self, thing, first, rate):
        own, name = thing.drapery, plain_name(thing.name)
        weights = []

        def written(source, of, pins):
            # By number: names of groups may differ by signs that no file name has.
            file = f"{MAPS}/{name}_{len(weights) + 1}_{plain_name(of)}.txt"
            weights.append({"source": source, "name": of, "file": file, "pins": pins})
            return file

        garment = Garment(name, f"{MESHES}/garment_{name}.abc", own.material, None, own.order)
        garment.thickness = self.value(own, "thickness") if own.own_thickness else None
        if own.own_rest_scale:
            garment.rest_scale = hundredth(self.value(own, "rest_scale"))
        garment.extension = largest_strain(own) if own.stiffens else None
        garment.limited, garment.limit = own.strain_limit, own.strain / 100 if own.own_strain else None
        garment.stretch, garment.bending = (self.value(own, key) if getattr(own, f"own_{key}") else None for key in ("stretch", "bending"))
        garment.damping = own.damping if own.own_damping else None
        if own.pressure != "NONE":
            garment.pressure = own.pressure, self.value(own, "overpressure")
        if own.render_mesh:
            garment.render_mesh = self.render_mesh(own.render_mesh, name, own.rigid)
        for pin in own.pins:
            body = self.body_of(pin)
            garment.pins.append(Pin(written("GROUP", pin.group, True), body and plain_name(body.name),
                                    self.value(pin, "stiffness") if pin.hold == "SPRING" else None,
                                    float((pin.release - first) / rate) if pin.released else None))
        garment.parts = [Part(plain_name(group), written("GROUP", group, True)) for group in self.groups_in_contact(thing)]
        for band in own.elastics:
            numbers = self.value(band, "stiffness"), hundredth(self.value(band, "relaxed"))
            garment.elastics.append(Elastic(written("GROUP", band.group, True), *numbers))
        for painted in own.maps:
            garment.maps.append(Map(painted.quantity, written(painted.source, painted.name, False)))
        self.job["garments"].append({"object": thing.name_full, "file": garment.file, "division": division(thing), "weights": weights})
        return garment

    def seam(self, thing, seam, first, rate):
        sides = (thing, seam.group), (seam.other, seam.other_group)
        pairing = None if seam.pairing == "LINE" else seam.pairing.lower()
        self.job["seams"].append({"sides": [[side.name_full, group] for side, group in sides], "pairing": pairing, "zip": seam.zip})

        def seconds(written, *frames):
            return [float((frame - first) / rate) if written else None for frame in frames]

        times = seconds(seam.own_closing, seam.start, seam.closed) + seconds(seam.own_opening, seam.opens, seam.opened)
        force = self.value(seam, "break_force") if seam.breaks else None
        names = tuple(plain_name(side.name) for side, _ in sides)
        return Seam(names, pairing, self.value(seam, "stiffness"), *times, seam.zip, pairing == "surface" and seam.keep_gap, force)

    def belt(self, thing, belt):
        scale, matrix = self.scene.unit_settings.scale_length, belt.place.matrix_world
        at = upright(tuple(scale * along for along in matrix.translation))
        axis = upright(tuple(matrix.to_3x3().col[2].normalized()))
        return Belt(plain_name(belt.place.name), plain_name(thing.name), at, axis, belt.width, belt.depth, belt.gap)

    def render_mesh(self, mesh, name, rigid):
        # As of a garment: deforming modifiers at the top shape it at rest, all others follow.
        file = f"{MESHES}/render_{name}.abc"
        self.job["render_meshes"].append({"object": mesh.name_full, "file": file, "division": division(mesh), "weights": []})
        return RenderMesh(file, [word for word in map(str.strip, rigid.split(",")) if word])
