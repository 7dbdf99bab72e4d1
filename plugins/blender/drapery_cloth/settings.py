"""Settings of the artist: of the scene, of objects that are marked, and the preferences of the add-on."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    FloatVectorProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)

from . import state
from .fabrics import FABRICS
from .pictures import OTHER

# Modifiers that leave every vertex what it was. All others may add or take away some.
DEFORMING = {
    "ARMATURE", "CAST", "CLOTH", "CORRECTIVE_SMOOTH", "CURVE", "DISPLACE", "HOOK", "LAPLACIANDEFORM", "LAPLACIANSMOOTH", "LATTICE",
    "MESH_CACHE", "MESH_DEFORM", "NORMAL_EDIT", "SHRINKWRAP", "SIMPLE_DEFORM", "SMOOTH", "SOFT_BODY", "SURFACE", "SURFACE_DEFORM",
    "UV_PROJECT", "UV_WARP", "VERTEX_WEIGHT_EDIT", "VERTEX_WEIGHT_MIX", "VERTEX_WEIGHT_PROXIMITY", "WARP", "WAVE",
    "WEIGHTED_NORMAL", "DATA_TRANSFER",
}  # fmt: skip

QUANTITIES = [
    ("density", "Weight", "Mass per area"),
    ("thickness", "Thickness", "Distance that layers keep"),
    ("friction", "Friction on Bodies", "How the cloth grips bodies"),
    ("self_friction", "Friction on Cloth", "How layers grip each other"),
    ("stretch", "Stretch", "Resistance to being stretched"),
    ("dihedral_bending", "Bending", "Resistance to being bent"),
    ("pins", "Spring Pins", "Stiffness of pins that are springs"),
    ("strain_limit", "Strain Limit", "Largest strain where it is limited"),
    ("wind", "Wind", "Share of the wind that is felt"),
]

COLOURS = [("NONE", "None", "No colours: meshes and windows as they were before"),
           ("STRAIN", "Strain", "How far the edges are stretched, from 0 to the largest strain of the fabric"),
           ("CONTACT", "Contact", "How close the cloth is to bodies and other garments, in thicknesses")]

# Settings that may be keyframed.
OVER_TIME = {
    "DraperyContact": ("friction", "thickness"),
    "DraperyElastic": ("stiffness", "relaxed"),
    "DraperyObject": ("thickness", "friction", "stretch", "bending", "overpressure", "rest_scale"),
    "DraperyPin": ("stiffness",),
    "DraperySeam": ("stiffness", "break_force"),
    "DraperyScene": ("gravity_acceleration", "wind_velocity", "self_friction", "air_drag_rate"),
}

# Attributes at the points of caches, by their words in the scene file.
ATTRIBUTES = [("normals", "Normals", "Smooth normals; render meshes always have them"),
              ("rest", "Rest", "Positions at rest, on which solid textures stay fixed"),
              ("strain", "Strain", "Greatest strain of the edges at a vertex: length over rest length, less one"),
              ("contact", "Contact", "1 where cloth touches a body or other cloth, 0 from twice the thickness on"),
              ("thickness", "Thickness", "Thickness of the fabric in metres")]

OVERRIDABLE = {"LIBRARY_OVERRIDABLE"}

SOURCES = [("GROUP", "Vertex Group", "Weights of a vertex group"),
           ("ATTRIBUTE", "Attribute", "A named attribute; of a colour, its red")]


def is_body(pin, thing):
    return thing.type == "MESH" and thing.drapery.role == "BODY"


def is_render_mesh(own, thing):
    return thing.type == "MESH" and thing.drapery.role == "NONE"


def is_garment(seam, thing):
    return thing.type == "MESH" and thing.drapery.role == "GARMENT"


def takes_part(own, thing):
    return thing.type == "MESH" and thing.drapery.role != "NONE"


def still(kind):
    """Lets no setting be keyframed but those that may change over time: keyframes of others would have no effect."""
    for name, deferred in kind.__annotations__.items():
        if name not in OVER_TIME.get(kind.__name__, ()) and deferred.function not in (CollectionProperty, PointerProperty):
            deferred.keywords.setdefault("options", set())
    return kind


def overridable(kind):
    """Keeps what is set on a library override of a linked object; Blender forgets all else when the file is opened again."""
    for deferred in kind.__annotations__.values():
        rows = {"USE_INSERTION"} if deferred.function is CollectionProperty else set()
        deferred.keywords["override"] = OVERRIDABLE | rows
    return still(kind)


def live_changed(self, context):
    live = state.work().live
    if self.live or self.preview:
        live.refresh(self.id_data)
        state.work().wake()
    else:
        live.take_off(self.id_data)


def fabric_entries(self, context):
    return state.pictures().fabric_entries()


@overridable
class DraperyPin(bpy.types.PropertyGroup):
    """Vertices of a garment that are held."""

    group: StringProperty(name="Vertex Group", description="Vertices with a weight above one half are held")
    hold: EnumProperty(
        name="Held", default="BODY",
        items=[("FIXED", "Fixed", "Where they start"), ("BODY", "On the Body", "Bound to the nearest place of a body"),
               ("SPRING", "Spring", "Drawn by springs: to a body if one is chosen, otherwise to where they start")])
    body: PointerProperty(name="Body", type=bpy.types.Object, poll=is_body,
                          description="Which body; left empty, the first one (of springs: none)")
    stiffness: FloatProperty(name="Stiffness (N/m)", default=200.0, min=1e-3, max=1e7, description="Of each vertex's spring; may be keyframed")
    released: BoolProperty(name="Release", description="The vertices are free from a frame on")
    release: IntProperty(name="At", default=100, description="Frame up to which the vertices are held")


@overridable
class DraperySeam(bpy.types.PropertyGroup):
    """Vertices of a garment that are sewn to others, of this garment or of another one."""

    group: StringProperty(name="Vertex Group", description="Vertices of this garment with a weight above one half are sewn")
    other: PointerProperty(name="To", type=bpy.types.Object, poll=is_garment,
                           description="The garment on the other side; this one itself, to sew two of its own groups together")
    other_group: StringProperty(name="Its Group", description="Vertices of the other side: those with a weight above one half")
    pairing: EnumProperty(
        name="Pairs", default="LINE",
        items=[("LINE", "Along the Edges", "Each group is a single line of edges, or a ring, and both have the same number of vertices. "
                "They are sewn one by one from end to end; of the two directions (and the starts of a ring) the one that brings the "
                "sides closest where they start"),
               ("NEAREST", "Nearest", "Each vertex of this group to the vertex of the other one that is nearest where they start. "
                "Several may meet in one, and vertices of the other side may stay free: begin with the group that has more"),
               ("SURFACE", "On the Surface", "Each vertex of this group to the nearest point of the faces of the other garment: a patch, a "
                "pocket, a brooch")])
    keep_gap: BoolProperty(name="Keep Gap", description="The vertices stay as far from the surface as they start, instead of being drawn to it")
    breaks: BoolProperty(name="Breaks", description="A pair opens for good when it is pulled too hard")
    break_force: FloatProperty(name="At (N)", default=5.0, min=1e-6, max=1e6, precision=3, description="Force on one pair at which it breaks; "
                               "may be keyframed")
    stiffness: FloatProperty(name="Stiffness (N/m)", default=400.0, min=1e-3, max=1e7,
                             description="Of each pair of vertices; a seam that is pulled opens by force over stiffness; may be keyframed")
    own_closing: BoolProperty(name="Closing Frames", description="Off: the gaps close evenly from the start of the simulation to the "
                              "first frame, or over one second if there is no pre-roll")
    start: IntProperty(name="From", default=1, description="Frame at which the gaps begin to close; before the first frame is the pre-roll")
    closed: IntProperty(name="Closed At", default=25, description="Frame from which the gaps are closed; the same as the one before closes "
                        "them at once")
    own_opening: BoolProperty(name="Opening Frames", description="The seam opens again: a button, a hook, a zip. Off: it stays closed")
    opens: IntProperty(name="From", default=50, description="Frame at which the seam begins to open, after it has closed")
    opened: IntProperty(name="Open At", default=50, description="Frame from which the seam is open; the same as the one before opens it "
                        "at once")
    zip: BoolProperty(name="Zip", description="Closes one pair after the other, from the lower end of its line to the upper one, and opens "
                      "from the upper end. Needs Pairs: Along the Edges")


@overridable
class DraperyElastic(bpy.types.PropertyGroup):
    """An elastic band along edges of a garment: a waist, a cuff, a hem."""

    group: StringProperty(name="Vertex Group", description="Edges with both ends above one half are elastic: choose a loop of edges")
    stiffness: FloatProperty(name="Stiffness (N)", default=20.0, min=0.0, max=1e6, description="Force per unit strain; a soft waistband has 10 "
                             "to 30 N; may be keyframed")
    relaxed: FloatProperty(name="Relaxed (%)", default=70.0, min=1.0, max=10000.0, precision=1, description="Relaxed length, in per cent of "
                           "that of the edges at rest: 70 gathers the cloth; may be keyframed")


@overridable
class DraperyBelt(bpy.types.PropertyGroup):
    """A belt around a body, which follows it and is a body of its own."""

    place: PointerProperty(name="Around", type=bpy.types.Object, description="An empty in the middle of the waist, or of what else the belt "
                           "runs around, in the first frame; the belt runs around its Z axis and has its name")
    width: FloatProperty(name="Width (mm)", default=40.0, min=0.1, max=10000.0, description="Along the axis")
    depth: FloatProperty(name="Strap (mm)", default=4.0, min=0.1, max=10000.0, description="Thickness of the strap")
    gap: FloatProperty(name="Gap (mm)", default=6.0, min=0.0, max=10000.0, description="Room for cloth between belt and body")


@overridable
class DraperyContact(bpy.types.PropertyGroup):
    """A rule of contact between a garment and another object, or its own layers."""

    other: PointerProperty(name="With", type=bpy.types.Object, poll=takes_part,
                           description="A garment or a body; the garment itself, for its own layers")
    group: StringProperty(name="Part", description="Vertex group of this garment that the rule is for, such as a pocket; empty, all of it")
    other_group: StringProperty(name="Part of the Other", description="Vertex group of the other garment; empty, all of it, or the rest of this one")
    ignore: BoolProperty(name="Ignore", description="The two pass through each other, such as a coat and the lining that it is sewn to")
    own_friction: BoolProperty(name="Friction", description="Instead of that of the body, or of Self Collision between cloth and cloth")
    friction: FloatProperty(name="", default=0.3, min=0.0, max=100.0, description="Coulomb friction between the two; may be keyframed")
    own_thickness: BoolProperty(name="Thickness", description="Instead of that of the body, or of the thicker garment")
    thickness: FloatProperty(name="mm", default=1.0, min=0.01, max=100.0, precision=2,
                             description="Distance that the two keep; may be keyframed")


@overridable
class DraperyMap(bpy.types.PropertyGroup):
    """A quantity that is painted."""

    quantity: EnumProperty(name="Quantity", items=QUANTITIES, description="What the map multiplies")
    source: EnumProperty(name="From", items=SOURCES)
    name: StringProperty(name="Map", description="Vertex group or attribute; 1 is the garment's own number, 0.5 half of it")


@overridable
class DraperyObject(bpy.types.PropertyGroup):
    """Role of an object in Drapery, and its settings."""

    role: EnumProperty(
        name="Role", default="NONE",
        items=[("NONE", "None", "Not part of the simulation"), ("GARMENT", "Garment", "Cloth"),
               ("BODY", "Body", "What cloth collides with: characters, props, floors")])
    fabric: EnumProperty(name="Fabric", items=fabric_entries, default=[fabric.name for fabric in FABRICS].index("cotton_shirting"))
    other_fabric: StringProperty(name="Material", description="Name of a material from the studio's material files")
    own_thickness: BoolProperty(name="Thickness", description="Instead of that of the fabric")
    thickness: FloatProperty(name="mm", default=0.5, min=0.01, max=100.0, precision=2,
                             description="Distance that layers of cloth keep, or that a body keeps from cloth; may be keyframed")
    own_strain: BoolProperty(name="Strain", description="Largest strain, instead of that of the fabric")
    strain: FloatProperty(name="%", default=8.0, min=0.1, max=1000.0, precision=1,
                          description="How far the cloth stretches, in per cent of its length")
    stiffens: BoolProperty(name="Stiffens", description="The cloth resists more the farther it is stretched, up to the largest strain "
                           "and beyond, as laboratories measure it. Off: as much at any stretch, so that a heavy garment may hang "
                           "longer than its fabric would")
    strain_limit: BoolProperty(name="Strain Limit", description="Edges stop at the largest strain")
    order: IntProperty(name="Wearing Order", default=1, min=1, max=99,
                       description="1 is worn closest to the skin. Garments that cross at the start are drawn apart in this order")
    own_stretch: BoolProperty(name="Stretch", description="Resistance to being stretched, instead of that of the fabric")
    stretch: FloatProperty(name="N/m", default=260.0, min=1.0, max=1e5, precision=1,
                           description="Force per width and strain; cloth has 50 to 2000 N/m; may be keyframed")
    own_bending: BoolProperty(name="Bending", description="Resistance to being bent, instead of that of the fabric")
    bending: FloatProperty(name="µN·m", default=14.0, min=0.01, max=1e6, precision=2,
                           description="Bending rigidity; silk has 1, denim 70, paper 400 µN·m; may be keyframed")
    own_damping: BoolProperty(name="Damping", description="Of stretching and bending, instead of that of the fabric")
    damping: FloatProperty(name="", default=1.0, min=0.0, max=1000.0, precision=2,
                           description="Damping ratio: 1 is critical for a single edge, 0 rings for ever")
    pressure: EnumProperty(
        name="Pressure", default="NONE",
        items=[("NONE", "None", "No pressure"), ("CLOSED", "Constant", "A closed garment with constant pressure, such as a cushion"),
               ("OPEN", "Open Edges", "Constant pressure on a garment with holes"),
               ("GAS", "Gas", "A closed garment with a fixed amount of gas: squeezing raises the pressure")])
    overpressure: FloatProperty(name="Overpressure (Pa)", default=100.0, min=-1e5, max=1e5,
                                description="Pressure inside minus pressure outside; a cushion has 100 Pa, a toy balloon 2000 Pa; may be "
                                "keyframed")
    contacts: CollectionProperty(type=DraperyContact)
    simulated: EnumProperty(
        name="Simulated Mesh", default="BASE",
        items=[("BASE", "Before Subdivision", "Deforming modifiers at the top of the stack, such as Armature, shape the cloth at "
                "rest; the first one that changes vertices (Subdivision, Solidify) and those below it follow the simulation"),
               ("ALL", "After All Modifiers", "What the modifiers leave is simulated, and the cache comes last")])
    render_mesh: PointerProperty(name="Render Mesh", type=bpy.types.Object, poll=is_render_mesh,
                                 description="The mesh that is rendered in the place of the garment: finer, with thickness, hems and "
                                 "buttons, modelled around it as it is at rest. It follows the cloth")
    rigid: StringProperty(name="Rigid", description="Materials of the render mesh whose pieces do not bend, with commas between "
                          "them: button*, buckle")
    own_rest_scale: BoolProperty(name="Shrink or Grow", description="Lengths at rest are others than those of the mesh")
    rest_scale: FloatProperty(name="%", default=100.0, min=1.0, max=10000.0, precision=1,
                              description="Lengths at rest, in per cent of those of the mesh; keyframe it to shrink or grow")
    elastics: CollectionProperty(type=DraperyElastic)
    belts: CollectionProperty(type=DraperyBelt)
    pins: CollectionProperty(type=DraperyPin)
    seams: CollectionProperty(type=DraperySeam)
    maps: CollectionProperty(type=DraperyMap)
    own_friction: BoolProperty(name="Friction", description="Instead of that of each fabric")
    friction: FloatProperty(name="", default=0.3, min=0.0, max=10.0,
                            description="Coulomb friction of the body against cloth; may be keyframed")

    @property
    def material(self):
        """The word for `material` in the scene file."""
        return self.other_fabric if self.fabric == OTHER else self.fabric


@still
class DraperyScene(bpy.types.PropertyGroup):
    """The shot."""

    folder: StringProperty(name="Folder", subtype="DIR_PATH", 
                           description="Where the scene file, the meshes and the caches go. It can be copied to a farm. Left "
                           "empty: drapery/FILE/SCENE beside the file")
    own_range: BoolProperty(name="Own Range", description="Instead of the scene's")
    first: IntProperty(name="Start", default=1, description="First frame that is written")
    last: IntProperty(name="End", default=250)
    own_rest: BoolProperty(name="Rest Frame", description="Garments fit the bodies at another frame than the first, for example "
                           "in the A-pose; bodies then move from there into the first pose")
    rest_frame: IntProperty(name="Frame", default=1, description="At which garments have their rest shape and fit the bodies")
    settle: IntProperty(name="Settle", default=0, min=0, max=1000, description="Pre-roll: frames in which the cloth comes to rest "
                        "while bodies hold still")
    blend: IntProperty(name="Blend", default=0, min=0, max=1000, description="Pre-roll: frames in which bodies then move from the "
                       "rest frame to the first")
    preset: EnumProperty(
        name="Quality", default="auto",
        items=[("auto", "Automatic", "For shots: 8 long steps per frame where they are expected to be faster than short ones"),
               ("preview", "Preview", "For blocking: 4 long steps per frame"),
               ("production", "Production", "For shots: 8 long steps per frame"),
               ("hero", "Hero", "For close-ups: 16 long steps per frame")])
    gravity: BoolProperty(name="Gravity", default=True, description="Off: cloth floats")
    gravity_acceleration: FloatVectorProperty(name="Gravity (m/s²)", size=3, subtype="XYZ", default=(0.0, 0.0, -9.81), min=-1e4, max=1e4,
                                              description="In metres a second squared, whatever the unit scale is; may be keyframed")
    self_contact: BoolProperty(name="Self Collision", default=True,
                               description="Layers and garments keep apart and never pass through each other")
    self_friction: FloatProperty(name="Friction", default=0.4, min=0.0, max=100.0,
                                 description="Coulomb friction between cloth and cloth; may be keyframed")
    wind: BoolProperty(name="Wind", description="Air that moves or slows cloth; bodies do not keep it off")
    wind_velocity: FloatVectorProperty(name="Velocity (m/s)", size=3, subtype="XYZ", default=(0.0, 0.0, 0.0), min=-1000.0, max=1000.0,
                                       description="Velocity of the air in metres a second, whatever the unit scale is; 0 is still air, "
                                       "which slows the cloth; may be keyframed")
    wind_normal: FloatProperty(name="Drag (kg/m³)", default=0.77, min=0.0, max=100.0,
                               description="Drag of the cloth across the wind; 0.77 for a plate in air, 1.2 at most")
    wind_tangential: FloatProperty(name="Along (N s/m³)", default=0.02, min=0.0, max=100.0,
                                   description="Drag of the cloth along the wind; about 0.01 for cloth in a breeze")
    air_drag: BoolProperty(name="Air Damping", description="Calms all motion of the cloth, as if in a denser medium")
    air_drag_rate: FloatProperty(name="Rate (1/s)", default=0.5, min=0.0, max=1000.0,
                                 description="Share of the velocity that is lost in a second; 0.5 calms, 5 is like water; may be keyframed")
    also_h5: BoolProperty(name="HDF5", description="Write caches as HDF5, too")
    also_usd: BoolProperty(name="USD", description="Write caches as USD, too, where the solver was built with it")
    attributes: EnumProperty(name="Attributes", items=ATTRIBUTES, options={"ENUM_FLAG"}, default=set(),
                             description="At the vertices of the caches, for shading and checks; Blender shows those of USD caches "
                             "that it imports")
    live: BoolProperty(name="Live View", update=live_changed, options=set(), description="Garments show the frames of the simulation as "
                       "soon as they are written, also those that a farm writes to the folder under From")
    live_newest: BoolProperty(name="Follow Newest Frame", update=live_changed, options=set(), description="The playhead goes to each frame that is new")
    # Set by Preview and cleared by Dismiss.
    preview: BoolProperty(options={"HIDDEN"})
    # Set by the operator Colours; and what windows and meshes were like before, as JSON.
    colours: EnumProperty(items=COLOURS, options={"HIDDEN"})
    before_colours: StringProperty(options={"HIDDEN"})
    threads: IntProperty(name="Threads", default=0, min=0, max=1024, description="Of the solver; 0 takes all cores. Changes no result")
    cache_folder: StringProperty(name="Load from", subtype="DIR_PATH",
                                 description="Folder of a run that a farm has made; empty for the scene folder's own")


class DraperyPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__

    executable: StringProperty(name="drapery Executable", subtype="FILE_PATH",
                               description="Instead of the solver that came with the add-on")
    exporter: StringProperty(name="Blender for Export", subtype="FILE_PATH",
                             description="Blender that writes the meshes in the background, for builds without Alembic such as "
                             "Debian's; empty for this one")

    def draw(self, context):
        self.layout.prop(self, "executable")
        self.layout.prop(self, "exporter")


CLASSES = (DraperyPin, DraperySeam, DraperyElastic, DraperyBelt, DraperyContact, DraperyMap, DraperyObject, DraperyScene, DraperyPreferences)
# What gets a property `drapery`, and of which kind.
PROPERTIES = ((bpy.types.Object, DraperyObject), (bpy.types.Scene, DraperyScene))


def preferences(context):
    """The add-on's preferences; defaults where the add-on was registered by hand."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences if addon else None
