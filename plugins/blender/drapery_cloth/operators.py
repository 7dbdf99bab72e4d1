"""The buttons."""

import bmesh
import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, StringProperty
from mathutils import Vector

from . import answers, load_cache, state, tasks
from .answers import Problem
from .collect import FINAL, PREVIEW, division, frames, run_folder, scene_folder
from .scene_text import plain_name
from .settings import COLOURS, is_garment, takes_part


class OBJECT_OT_drapery_mark(bpy.types.Operator):
    """Mark the selected meshes for the simulation"""

    bl_idname, bl_label, bl_options = "object.drapery_mark", "Mark for Drapery", {"REGISTER", "UNDO"}

    role: EnumProperty(name="Role", items=[("NONE", "None", "Take no part in the simulation"),
                                           ("GARMENT", "Garment", "Simulate as cloth"), ("BODY", "Body", "Let cloth collide with it")])

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and any(thing.type == "MESH" for thing in context.selected_objects)

    def execute(self, context):
        things = [thing for thing in context.selected_objects if thing.type == "MESH"]
        linked = [thing.name for thing in things if thing.library is not None]
        if linked:
            self.report({"ERROR"}, f"{', '.join(linked)}: linked objects cannot be marked; make a library override (Object > Library "
                        "Override > Make)")
            return {"CANCELLED"}
        for thing in things:
            thing.drapery.role = self.role
        self.report({"INFO"}, f"{len(things)} objects marked")
        return {"FINISHED"}


class ActiveGarment:
    """Poll of what needs an active garment."""

    @classmethod
    def poll(cls, context):
        thing = context.object
        return thing is not None and thing.type == "MESH" and thing.drapery.role == "GARMENT"


class AddsForGroup(ActiveGarment):
    """Base of the operators that add a pin or a band for the active vertex group."""

    def execute(self, context):
        thing = context.object
        added = getattr(thing.drapery, self.added_to).add()
        if thing.vertex_groups.active:
            added.group = thing.vertex_groups.active.name
        return {"FINISHED"}


class OBJECT_OT_drapery_pin_add(AddsForGroup, bpy.types.Operator):
    """Hold vertices of a group"""

    bl_idname, bl_label, bl_options = "object.drapery_pin_add", "Add Pin", {"REGISTER", "UNDO"}
    added_to = "pins"


class OBJECT_OT_drapery_elastic_add(AddsForGroup, bpy.types.Operator):
    """Sew an elastic band along the edges of a vertex group"""

    bl_idname, bl_label, bl_options = "object.drapery_elastic_add", "Add Band", {"REGISTER", "UNDO"}
    added_to = "elastics"


class OBJECT_OT_drapery_belt_add(bpy.types.Operator):
    """Put a belt around the body: at an empty that is selected, otherwise at a new one in its middle"""

    bl_idname, bl_label, bl_options = "object.drapery_belt_add", "Add Belt", {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type == "MESH" and context.object.drapery.role == "BODY"

    def execute(self, context):
        thing = context.object
        empties = [other for other in context.selected_objects if other.type == "EMPTY"]
        place = empties[0] if len(empties) == 1 else None
        if place is None:
            place = bpy.data.objects.new("belt", None)
            corners = [thing.matrix_world @ Vector(corner) for corner in thing.bound_box]
            place.location = sum(corners, Vector()) / len(corners)
            context.scene.collection.objects.link(place)
        thing.drapery.belts.add().place = place
        return {"FINISHED"}


class OBJECT_OT_drapery_seam_add(ActiveGarment, bpy.types.Operator):
    """Sew vertices of a group to others: of a second garment that is selected, otherwise of this one"""

    bl_idname, bl_label, bl_options = "object.drapery_seam_add", "Add Seam", {"REGISTER", "UNDO"}

    def execute(self, context):
        thing, scene = context.object, context.scene
        others = [other for other in context.selected_objects if other != thing and is_garment(None, other)]
        seam = thing.drapery.seams.add()
        seam.other = others[0] if len(others) == 1 else thing
        if thing.vertex_groups.active:
            seam.group = thing.vertex_groups.active.name
        if seam.other != thing and seam.other.vertex_groups.active:
            seam.other_group = seam.other.vertex_groups.active.name
        # Where the solver would close it, once the artist asks for frames.
        seam.start = frames(scene)[0]
        seam.closed = seam.start + round(scene.render.fps / scene.render.fps_base)
        return {"FINISHED"}


class OBJECT_OT_drapery_map_add(ActiveGarment, bpy.types.Operator):
    """Let a painted map change a quantity over the garment"""

    bl_idname, bl_label, bl_options = "object.drapery_map_add", "Add Map", {"REGISTER", "UNDO"}

    def execute(self, context):
        context.object.drapery.maps.add()
        return {"FINISHED"}


class OBJECT_OT_drapery_contact_add(ActiveGarment, bpy.types.Operator):
    """Make a rule of contact: with a second object that is selected, otherwise for the layers of this garment"""

    bl_idname, bl_label, bl_options = "object.drapery_contact_add", "Add Rule", {"REGISTER", "UNDO"}

    def execute(self, context):
        thing = context.object
        others = [other for other in context.selected_objects if other != thing and takes_part(None, other)]
        thing.drapery.contacts.add().other = others[0] if len(others) == 1 else thing
        return {"FINISHED"}


class OBJECT_OT_drapery_remove(bpy.types.Operator):
    """Remove this row"""

    bl_idname, bl_label, bl_options = "object.drapery_remove", "Remove", {"REGISTER", "UNDO"}

    rows: EnumProperty(items=[("pins", "Pins", ""), ("seams", "Seams", ""), ("maps", "Maps", ""), ("contacts", "Contact", ""),
                               ("elastics", "Elastic Bands", ""), ("belts", "Belts", "")])
    index: IntProperty(min=0)

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type == "MESH" and context.object.drapery.role != "NONE"

    def execute(self, context):
        rows = getattr(context.object.drapery, self.rows)
        if self.index >= len(rows):
            return {"CANCELLED"}
        try:
            rows.remove(self.index)
        except TypeError:
            self.report({"ERROR"}, "This row comes from the linked file; remove it there")
            return {"CANCELLED"}
        return {"FINISHED"}


def runs(context, kind=FINAL):
    if bpy.app.background:
        state.work().look_now(context.scene, kind)
    status = state.work().view(context.scene, kind).status
    return (context.scene.name, kind) in state.work().watched or bool(status and status.running)


class Task:
    """Start and end of work in the background, unless a script waits for it. `kind` is the run that it is about."""

    kind = FINAL
    wait: BoolProperty(name="Wait", options={"HIDDEN", "SKIP_SAVE"},
                       description="Return when all is done, for scripts: a simulation, too, is at its end then. Without a window "
                       "all but a simulation is waited for in any case")

    def begin(self, context, task, *options):
        """Starts a task; CANCELLED, with a report, if it is known to have failed."""
        live, scene = state.work(), context.scene
        view = live.view(scene, self.kind)
        live.start(scene, task(scene, view, *options), self.kind)
        # Without a window nobody would go on with it.
        if self.wait or bpy.app.background:
            live.wait(lambda: not live.busy)
        if self.wait and not view.failed:
            live.wait(lambda: live.is_over(scene, self.kind))
            view.failed = self.ended_badly(view)
        if not view.failed:
            return {"FINISHED"}
        self.report({"WARNING"}, reason(view))
        return {"CANCELLED"}

    def ended_badly(self, view):
        """Whether what was waited for is not as it was asked for."""
        return False


def reason(view):
    """Why a task failed, in a line; the panel has all of it."""
    errors = [found for found in view.problems if not found.warning]
    if not errors:
        return "; ".join(view.lines) or (answers.headline(view.status) if view.status else "It did not come to its end")
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return ". ".join(filter(None, [errors[0].message, errors[0].help])) + more


class Free(Task):
    """Poll of what a simulation that runs must not be disturbed by."""

    @classmethod
    def poll(cls, context):
        if runs(context):
            cls.poll_message_set("The simulation runs; Cancel stops it at a checkpoint")
            return False
        return not state.work().busy


class Simulates(Free):
    """Base of the operators that end with a simulation."""

    def ended_badly(self, view):
        # A run that the solver refuses to go on with is done, too.
        return view.status is None or view.status.state != "done" or any(not found.warning for found in view.problems)


class SCENE_OT_drapery_write(Free, bpy.types.Operator):
    """Write the scene folder, for a farm or by hand: drapery run scene.toml"""

    bl_idname, bl_label = "scene.drapery_write", "Write Scene Folder"

    def execute(self, context):
        return self.begin(context, tasks.write_task)


class SCENE_OT_drapery_check(Free, bpy.types.Operator):
    """Name every problem of the scene and of every frame of its inputs; simulate nothing"""

    bl_idname, bl_label = "scene.drapery_check", "Check"

    def execute(self, context):
        return self.begin(context, tasks.check_task)


class SCENE_OT_drapery_plan(Free, bpy.types.Operator):
    """Show what would run: vertices, steps, memory"""

    bl_idname, bl_label = "scene.drapery_plan", "Plan"

    def execute(self, context):
        return self.begin(context, tasks.plan_task)


HOW = [("GO_ON", "Resume", "After the frames that are there already"),
       ("ANEW", "Start Anew", "Replace the run in the folder: its caches and checkpoints are deleted"),
       ("CHANGED", "Continue with Changes", "Keep the frames so far, and resume from the last checkpoint with the changed scene")]
OPTIONS = {"GO_ON": (), "ANEW": ("--overwrite",), "CHANGED": ("--resume-with-changes",)}


class SCENE_OT_drapery_simulate(Simulates, bpy.types.Operator):
    """Write, check and simulate, in a process of its own, which keeps running when Blender is closed"""

    bl_idname, bl_label = "scene.drapery_simulate", "Simulate"

    how: EnumProperty(items=HOW, options={"SKIP_SAVE"})

    def execute(self, context):
        return self.begin(context, tasks.simulate_task, *OPTIONS[self.how])


class SCENE_OT_drapery_continue(Simulates, bpy.types.Operator):
    """Continue the simulation from its last checkpoint, with the scene folder as it is"""

    bl_idname, bl_label = "scene.drapery_continue", "Continue"

    @classmethod
    def poll(cls, context):
        folder = run_folder(context.scene)
        return super().poll(context) and bool(folder) and (folder / "manifest.json").exists()

    def execute(self, context):
        return self.begin(context, tasks.continue_task)


class SCENE_OT_drapery_cancel(Task, bpy.types.Operator):
    """Stop: a simulation at a checkpoint, from which Continue resumes; anything else at once"""

    bl_idname, bl_label = "scene.drapery_cancel", "Cancel"

    @classmethod
    def poll(cls, context):
        return state.work().busy or runs(context)

    def execute(self, context):
        if state.work().busy:
            state.work().stop_task()
            return {"FINISHED"}
        return self.begin(context, tasks.cancel_task)

    def ended_badly(self, view):
        return view.status is not None and view.status.running


class SCENE_OT_drapery_preview(Simulates, bpy.types.Operator):
    """Simulate the shot with the settings of Quality: Preview in a folder of its own, and show each frame. The simulation stays as it is"""

    bl_idname, bl_label, kind = "scene.drapery_preview", "Preview", PREVIEW

    @classmethod
    def poll(cls, context):
        if runs(context, PREVIEW):
            cls.poll_message_set("The preview runs; Dismiss ends it")
            return False
        return not state.work().busy

    def execute(self, context):
        return self.begin(context, tasks.preview_task)


class SCENE_OT_drapery_dismiss(Task, bpy.types.Operator):
    """End the preview, take it off the garments and delete its folder"""

    bl_idname, bl_label, kind = "scene.drapery_dismiss", "Dismiss", PREVIEW

    @classmethod
    def poll(cls, context):
        folder = scene_folder(context.scene, PREVIEW)
        return not state.work().busy and bool(folder) and (context.scene.drapery.preview or folder.exists())

    def execute(self, context):
        return self.begin(context, tasks.dismiss_task)


class SCENE_OT_drapery_colours(bpy.types.Operator):
    """Colour the garments at the current frame"""

    bl_idname, bl_label, bl_options = "scene.drapery_colours", "Colours", {"REGISTER", "UNDO"}

    show: EnumProperty(name="Colours", items=COLOURS)

    @classmethod
    def description(cls, context, properties):
        return next(entry[2] for entry in COLOURS if entry[0] == properties.show)

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT"

    def execute(self, context):
        scene, live = context.scene, state.work()
        scene.drapery.colours = self.show
        if self.show == "NONE":
            live.colours.take_off(scene)
            return {"FINISHED"}
        # What is there by now.
        live.tick()
        done = live.colours.refresh(scene, live.live)
        live.wake()
        if done:
            return {"FINISHED"}
        self.report({"WARNING"}, next(found for found in live.colours.problems[scene.name] if not found.warning).message)
        return {"CANCELLED"}


class SCENE_OT_drapery_load(bpy.types.Operator):
    """Put the caches on the garments. Materials, UVs and modifiers stay; Undo takes the caches off again"""

    bl_idname, bl_label, bl_options = "scene.drapery_load", "Load", {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and load_cache.cache_folder(context.scene) is not None

    def execute(self, context):
        view = state.work().view(context.scene)
        try:
            remarks = load_cache.load(context)
        except load_cache.CannotLoad as error:
            # In the panel too: a report is gone after a few seconds.
            view.problems = [Problem(str(error))]
            self.report({"WARNING"}, str(error))
            return {"CANCELLED"}
        view.problems = [Problem(remark, warning=True) for remark in remarks]
        view.lines = ["Caches loaded"]
        return {"FINISHED"}


class SCENE_OT_drapery_unload(bpy.types.Operator):
    """Take the caches off the garments: they are as they were before Load"""

    bl_idname, bl_label, bl_options = "scene.drapery_unload", "Unload", {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        return context.mode == "OBJECT" and any(load_cache.is_loaded(thing) for thing in context.scene.objects)

    def execute(self, context):
        count = load_cache.unload(context.scene)
        state.work().view(context.scene).lines = [f"{count} caches taken off"]
        return {"FINISHED"}


class SCENE_OT_drapery_show(bpy.types.Operator):
    """Go to the object, frame and vertex"""

    bl_idname, bl_label, bl_options = "scene.drapery_show", "Show Problem", {"REGISTER", "UNDO"}

    thing: StringProperty()
    frame: IntProperty()
    has_frame: BoolProperty()
    element: StringProperty()
    index: IntProperty(default=-1)

    def execute(self, context):
        if self.has_frame:
            context.scene.frame_set(self.frame)
        things = [thing for thing in context.scene.objects if thing.type == "MESH" and thing.drapery.role != "NONE"]
        thing = next((thing for thing in things if plain_name(thing.name) == self.thing), None)
        if thing is None:
            if not self.thing:
                return {"FINISHED"}
            self.report({"WARNING"}, f'"{self.thing}" is not in this scene, or is not marked any more')
            return {"CANCELLED"}
        if context.mode != "OBJECT":
            bpy.ops.object.mode_set(mode="OBJECT")
        for other in context.view_layer.objects:
            other.select_set(False)
        thing.hide_set(False)
        thing.select_set(True)
        context.view_layer.objects.active = thing
        if self.index >= 0:
            self.point_at(context, thing)
        return {"FINISHED"}

    def point_at(self, context, thing):
        """The 3D cursor goes to the element; it is selected too where the artist's mesh has it under the same number."""
        shown = thing.evaluated_get(context.evaluated_depsgraph_get())
        rows = "polygons" if self.element == "face" else "vertices"
        evaluated, own = getattr(shown.data, rows), getattr(thing.data, rows)
        if self.index >= len(evaluated):
            self.report({"WARNING"}, f"{thing.name} has no {self.element} {self.index} now")
            return
        # Where the modifiers all follow the cloth, the mesh itself is what was meant; they may move its vertices.
        plain = thing.drapery.role == "GARMENT" and division(thing) == 0 and self.index < len(own)
        found = (own if plain else evaluated)[self.index]
        context.scene.cursor.location = shown.matrix_world @ (found.center if self.element == "face" else found.co)
        # What the solver counted: vertices of the mesh itself, unless a modifier before it made others.
        same = len(evaluated) == len(own) or (thing.drapery.role == "GARMENT" and thing.drapery.simulated == "BASE")
        if same and self.index < len(own):
            self.select(context, thing)
        for window in context.window_manager.windows:
            for area in window.screen.areas:
                if area.type == "VIEW_3D" and window == context.window:
                    area.spaces.active.region_3d.view_location = context.scene.cursor.location

    def select(self, context, thing):
        """The element alone, in Edit Mode, where it is seen."""
        bpy.ops.object.mode_set(mode="EDIT")
        context.tool_settings.mesh_select_mode = (self.element != "face", False, self.element == "face")
        edited = bmesh.from_edit_mesh(thing.data)
        for each in (*edited.verts, *edited.edges, *edited.faces):
            each.select = False
        elements = edited.faces if self.element == "face" else edited.verts
        elements.ensure_lookup_table()
        elements[self.index].select_set(True)
        bmesh.update_edit_mesh(thing.data, loop_triangles=False, destructive=False)


CLASSES = (
    OBJECT_OT_drapery_mark, OBJECT_OT_drapery_pin_add, OBJECT_OT_drapery_elastic_add, OBJECT_OT_drapery_belt_add,
    OBJECT_OT_drapery_seam_add, OBJECT_OT_drapery_map_add,
    OBJECT_OT_drapery_contact_add, OBJECT_OT_drapery_remove, SCENE_OT_drapery_write, SCENE_OT_drapery_check, SCENE_OT_drapery_plan,
    SCENE_OT_drapery_simulate, SCENE_OT_drapery_continue, SCENE_OT_drapery_cancel, SCENE_OT_drapery_preview, SCENE_OT_drapery_dismiss, SCENE_OT_drapery_colours,
    SCENE_OT_drapery_load, SCENE_OT_drapery_unload, SCENE_OT_drapery_show,
)  # fmt: skip
