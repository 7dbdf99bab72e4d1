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


def overridable(kind):
    """Keeps what is set on a library override of a linked object; Blender forgets all else when the file is opened again."""
    for deferred in kind.__annotations__.values():
        rows = {"USE_INSERTION"} if deferred.function is CollectionProperty else set()
        deferred.keywords["override"] = OVERRIDABLE | rows
    return kind


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
    stiffness: FloatProperty(name="Stiffness (N/m)", default=200.0, min=1e-3, max=1e7, description="Of each vertex's spring")


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
                "Several may meet in one, and vertices of the other side may stay free: begin with the group that has more")])
    stiffness: FloatProperty(name="Stiffness (N/m)", default=400.0, min=1e-3, max=1e7,
                             description="Of each pair of vertices; a seam that is pulled opens by force over stiffness")
    own_closing: BoolProperty(name="Closing Frames", description="Off: the gaps close evenly from the start of the simulation to the "
                              "first frame, or over one second if there is no pre-roll")
    start: IntProperty(name="From", default=1, description="Frame at which the gaps begin to close; before the first frame is the pre-roll")
    closed: IntProperty(name="Closed At", default=25, description="Frame from which the gaps are closed; the same as the one before closes "
                        "them at once")


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
                             description="Distance that layers of cloth keep, or that a body keeps from cloth")
    own_strain: BoolProperty(name="Strain", description="Largest strain, instead of that of the fabric")
    strain: FloatProperty(name="%", default=8.0, min=0.1, max=1000.0, precision=1,
                          description="How far the cloth stretches, in per cent of its length")
    stiffens: BoolProperty(name="Stiffens", description="The cloth resists more the farther it is stretched, up to the largest strain "
                           "and beyond, as laboratories measure it. Off: as much at any stretch, so that a heavy garment may hang "
                           "longer than its fabric would")
    strain_limit: BoolProperty(name="Strain Limit", description="Edges stop at the largest strain")
    order: IntProperty(name="Wearing Order", default=1, min=1, max=99,
                       description="1 is worn closest to the skin. Garments are written in this order")
    ignores: PointerProperty(name="Ignores", type=bpy.types.Object, poll=takes_part,
                             description="A garment or a body that this garment passes through, such as a coat that its lining is sewn to")
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
    pins: CollectionProperty(type=DraperyPin)
    seams: CollectionProperty(type=DraperySeam)
    maps: CollectionProperty(type=DraperyMap)
    own_friction: BoolProperty(name="Friction", description="Instead of that of each fabric")
    friction: FloatProperty(name="", default=0.3, min=0.0, max=10.0, description="Coulomb friction of the body against cloth")

    @property
    def material(self):
        """The word for `material` in the scene file."""
        return self.other_fabric if self.fabric == OTHER else self.fabric


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
        name="Quality", default="production",
        items=[("preview", "Preview", "For blocking: 4 long steps per frame"),
               ("production", "Production", "For shots: 8 long steps per frame"),
               ("hero", "Hero", "For close-ups: 16 long steps per frame")])
    gravity: BoolProperty(name="Gravity", default=True, description="9.81 m/s² downwards, whatever the unit scale is")
    self_contact: BoolProperty(name="Self Collision", default=True,
                               description="Layers and garments keep apart and never pass through each other")
    wind: BoolProperty(name="Wind", description="Air that moves or slows cloth; bodies do not keep it off")
    # Written as one number: keyframes would have no effect.
    wind_velocity: FloatVectorProperty(name="Velocity (m/s)", size=3, subtype="XYZ", default=(0.0, 0.0, 0.0), min=-1000.0, max=1000.0,
                                       options=set(), description="Velocity of the air in metres a second, whatever the unit scale is; "
                                       "0 is still air, which slows the cloth")
    live: BoolProperty(name="Live View", update=live_changed, options=set(), description="Garments show the frames of the simulation as "
                       "soon as they are written, also those that a farm writes to the folder under From")
    live_newest: BoolProperty(name="Follow Newest Frame", options=set(), description="The playhead goes to each frame that is new")
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


CLASSES = (DraperyPin, DraperySeam, DraperyMap, DraperyObject, DraperyScene, DraperyPreferences)
# What gets a property `drapery`, and of which kind.
PROPERTIES = ((bpy.types.Object, DraperyObject), (bpy.types.Scene, DraperyScene))


def preferences(context):
    """The add-on's preferences; defaults where the add-on was registered by hand."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences if addon else None
