"""The tab Drapery in the sidebar of the 3D view."""

import bpy

from . import answers, load_cache, state
from .collect import PREVIEW, marked, scene_folder
from .operators import runs
from .pictures import OTHER
from .settings import COLOURS

# Problems that are listed; a broken character may have thousands.
SHOWN = 12
# Pixels of a sidebar that frames and an icon take, and those of a letter, before they are scaled for the screen.
FRAME, LETTER = 64, 6


class Panel:
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Drapery"


def wrapped(layout, text, icon="NONE"):
    """A text over several lines: labels alone are cut off."""
    column = layout.column(align=True)
    column.scale_y = 0.8
    width = max(16, int((bpy.context.region.width / bpy.context.preferences.system.ui_scale - FRAME) / LETTER))
    line = ""
    for word in text.split():
        if line and len(line) + len(word) >= width:
            column.label(text=line, icon=icon)
            line, icon = "", "BLANK1" if icon != "NONE" else "NONE"
        line = f"{line} {word}".strip()
    column.label(text=line, icon=icon)


class OwnRows:
    """Settings that replace those of the fabric where they are checked."""

    def own(self, layout, own, key):
        row = layout.row()
        row.prop(own, f"own_{key}")
        sub = row.row()
        sub.active = getattr(own, f"own_{key}")
        sub.prop(own, key)


class VIEW3D_PT_drapery_object(OwnRows, Panel, bpy.types.Panel):
    bl_idname, bl_label = "VIEW3D_PT_drapery_object", "Object"

    def draw(self, context):
        layout, thing = self.layout, context.object
        row = layout.row(align=True)
        current = thing.drapery.role if thing and thing.type == "MESH" else None
        for role, label, icon in (("GARMENT", "Garment", "MATCLOTH"), ("BODY", "Body", "ARMATURE_DATA"), ("NONE", "None", "X")):
            row.operator("object.drapery_mark", text=label, icon=icon, depress=role == current).role = role
        if current is None:
            layout.label(text="Select a mesh", icon="INFO")
        elif current == "GARMENT":
            self.garment(layout, thing)
        elif current == "BODY":
            self.own(layout, thing.drapery, "thickness")
            self.own(layout, thing.drapery, "friction")
            for index, belt in enumerate(thing.drapery.belts):
                box = layout.box()
                row = box.row()
                row.prop(belt, "place", text="Belt")
                remove_button(row, "belts", index)
                for key in ("width", "depth", "gap"):
                    box.prop(belt, key)
            layout.operator("object.drapery_belt_add", icon="ADD")

    def garment(self, layout, thing):
        own = thing.drapery
        layout.template_icon_view(own, "fabric", show_labels=True, scale=4.0, scale_popup=3.5)
        layout.prop(own, "fabric")
        if own.fabric == OTHER:
            layout.prop(own, "other_fabric")
        self.own(layout, own, "thickness")
        self.own(layout, own, "rest_scale")
        self.own(layout, own, "strain")
        layout.prop(own, "stiffens")
        layout.prop(own, "strain_limit")
        layout.prop(own, "order")
        if len(thing.modifiers) > 0:
            layout.prop(own, "simulated")
        layout.label(text="Render Mesh")
        layout.prop(own, "render_mesh", text="")
        if own.render_mesh:
            layout.prop(own, "rigid")


def remove_button(row, rows, index):
    """Adds a button to a row that removes an item of a list of the active object."""
    button = row.operator("object.drapery_remove", text="", icon="X")
    button.rows, button.index = rows, index


def group_box(layout, item, rows, index):
    """The box of a pin or a band, with its vertex group."""
    box = layout.box()
    row = box.row()
    row.prop_search(item, "group", item.id_data, "vertex_groups", text="")
    remove_button(row, rows, index)
    return box


class VIEW3D_PT_drapery_pins(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id, bl_options = "VIEW3D_PT_drapery_pins", "Pins", "VIEW3D_PT_drapery_object", {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type == "MESH" and context.object.drapery.role == "GARMENT"

    def draw(self, context):
        for index, pin in enumerate(context.object.drapery.pins):
            box = group_box(self.layout, pin, "pins", index)
            box.prop(pin, "hold")
            if pin.hold != "FIXED":
                box.prop(pin, "body")
            if pin.hold == "SPRING":
                box.prop(pin, "stiffness")
            row = box.row()
            row.prop(pin, "released")
            sub = row.row()
            sub.active = pin.released
            sub.prop(pin, "release")
        self.layout.operator("object.drapery_pin_add", icon="ADD")


class VIEW3D_PT_drapery_elastics(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_elastics", "Elastic Bands", "VIEW3D_PT_drapery_object"
    bl_options = {"DEFAULT_CLOSED"}

    poll = VIEW3D_PT_drapery_pins.poll

    def draw(self, context):
        for index, band in enumerate(context.object.drapery.elastics):
            box = group_box(self.layout, band, "elastics", index)
            box.prop(band, "stiffness")
            box.prop(band, "relaxed")
        self.layout.operator("object.drapery_elastic_add", icon="ADD")


class VIEW3D_PT_drapery_contact(OwnRows, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_contact", "Contact", "VIEW3D_PT_drapery_object"
    bl_options = {"DEFAULT_CLOSED"}

    poll = VIEW3D_PT_drapery_pins.poll

    def draw(self, context):
        for index, rule in enumerate(context.object.drapery.contacts):
            box = self.layout.box()
            row = box.row()
            row.prop(rule, "other", text="")
            remove_button(row, "contacts", index)
            box.prop_search(rule, "group", context.object, "vertex_groups")
            if rule.other is not None and rule.other.drapery.role == "GARMENT":
                box.prop_search(rule, "other_group", rule.other, "vertex_groups")
            box.prop(rule, "ignore")
            if not rule.ignore:
                self.own(box, rule, "friction")
                self.own(box, rule, "thickness")
        self.layout.operator("object.drapery_contact_add", icon="ADD")


class VIEW3D_PT_drapery_properties(OwnRows, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_properties", "Stiffness and Pressure", "VIEW3D_PT_drapery_object"
    bl_options = {"DEFAULT_CLOSED"}

    poll = VIEW3D_PT_drapery_pins.poll

    def draw(self, context):
        own = context.object.drapery
        for key in ("stretch", "bending", "damping"):
            self.own(self.layout, own, key)
        self.layout.prop(own, "pressure")
        if own.pressure != "NONE":
            self.layout.prop(own, "overpressure")


class VIEW3D_PT_drapery_seams(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_seams", "Seams", "VIEW3D_PT_drapery_object"
    bl_options = {"DEFAULT_CLOSED"}

    poll = VIEW3D_PT_drapery_pins.poll

    def draw(self, context):
        thing = context.object
        for index, seam in enumerate(thing.drapery.seams):
            box = self.layout.box()
            row = box.row()
            row.prop_search(seam, "group", thing, "vertex_groups", text="")
            remove_button(row, "seams", index)
            box.prop(seam, "other")
            if seam.other and seam.pairing != "SURFACE":
                box.prop_search(seam, "other_group", seam.other, "vertex_groups")
            box.prop(seam, "pairing")
            if seam.pairing == "SURFACE":
                box.prop(seam, "keep_gap")
            box.prop(seam, "stiffness")
            row = box.row()
            row.prop(seam, "breaks")
            sub = row.row()
            sub.active = seam.breaks
            sub.prop(seam, "break_force")
            box.prop(seam, "own_closing")
            if seam.own_closing:
                row = box.row(align=True)
                row.prop(seam, "start")
                row.prop(seam, "closed")
            box.prop(seam, "own_opening")
            if seam.own_opening:
                row = box.row(align=True)
                row.prop(seam, "opens")
                row.prop(seam, "opened")
            box.prop(seam, "zip")
        for other in marked(context.scene, role="GARMENT"):
            for seam in other.drapery.seams:
                if seam.other == thing != other:
                    wrapped(self.layout, f'{seam.other_group}: sewn to "{seam.group}" of "{other.name}"', "INFO")
        self.layout.operator("object.drapery_seam_add", icon="ADD")


class VIEW3D_PT_drapery_maps(Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_maps", "Painted Maps", "VIEW3D_PT_drapery_object"
    bl_options = {"DEFAULT_CLOSED"}

    poll = VIEW3D_PT_drapery_pins.poll

    def draw(self, context):
        thing = context.object
        for index, painted in enumerate(thing.drapery.maps):
            box = self.layout.box()
            row = box.row()
            row.prop(painted, "quantity", text="")
            remove_button(row, "maps", index)
            box.prop(painted, "source", expand=False)
            if painted.source == "GROUP":
                box.prop_search(painted, "name", thing, "vertex_groups")
            else:
                box.prop_search(painted, "name", thing.data, "attributes")
        self.layout.operator("object.drapery_map_add", icon="ADD")


class VIEW3D_PT_drapery_shot(Panel, bpy.types.Panel):
    bl_idname, bl_label = "VIEW3D_PT_drapery_shot", "Shot"

    def draw(self, context):
        layout, own = self.layout, context.scene.drapery
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(own, "folder")
        folder = scene_folder(context.scene)
        if not own.folder and folder:
            layout.label(text=bpy.path.relpath(str(folder)), icon="BLANK1")
        layout.prop(own, "own_range")
        if own.own_range:
            column = layout.column(align=True)
            column.prop(own, "first")
            column.prop(own, "last")
        layout.prop(own, "own_rest")
        if own.own_rest:
            layout.prop(own, "rest_frame")
        column = layout.column(align=True, heading="Pre-Roll")
        column.prop(own, "settle")
        if own.own_rest:
            column.prop(own, "blend")
        layout.prop(own, "preset")
        layout.prop(own, "gravity")
        if own.gravity:
            layout.prop(own, "gravity_acceleration", text="m/s²")
        layout.prop(own, "self_contact")
        if own.self_contact:
            layout.prop(own, "self_friction")
        layout.prop(own, "wind")
        if own.wind:
            for key, label in (("wind_velocity", "m/s"), ("wind_normal", "Drag"), ("wind_tangential", "Along")):
                layout.prop(own, key, text=label)
        layout.prop(own, "air_drag")
        if own.air_drag:
            layout.prop(own, "air_drag_rate")
        row = layout.row(heading="Also As", align=True)
        row.prop(own, "also_h5", toggle=True)
        row.prop(own, "also_usd", toggle=True)
        layout.column(heading="Attributes").prop(own, "attributes")
        layout.prop(own, "threads")


class Report:
    """Progress and problems, for panels about a run."""

    def progress(self, layout, view):
        if view.doing:
            self.bar(layout, view.share, view.doing)
        elif view.status:
            if view.status.running:
                text = "stopping at a checkpoint" if view.stopping else answers.headline(view.status)
                self.bar(layout, view.status.share, text)
            else:
                wrapped(layout, answers.headline(view.status), "CHECKMARK" if view.status.state == "done" else "ERROR")
            for lost in view.status.degradations:
                wrapped(layout, lost, "ERROR")

    def bar(self, layout, share, text):
        if share is None:
            layout.label(text=text, icon="TIME")
        elif hasattr(layout, "progress"):
            layout.progress(factor=share, text=f"{share:.0%}, {text}")
        else:
            # Before Blender 4.0.
            layout.label(text="█" * round(16 * share) + "░" * round(16 * (1.0 - share)))
            layout.label(text=f"{share:.0%}, {text}", icon="TIME")

    def problems(self, layout, problems):
        for found in problems[:SHOWN]:
            box = layout.box()
            wrapped(box, found.message, "INFO" if found.warning else "ERROR")
            if found.help:
                wrapped(box, found.help, "BLANK1")
            if found.object is not None or found.frame is not None:
                button = box.operator("scene.drapery_show", text="Show", icon="RESTRICT_SELECT_OFF")
                button.thing, button.has_frame = found.object or "", found.frame is not None
                button.frame = found.frame or 0
                button.element, button.index = found.element or "", -1 if found.index is None else found.index
        if len(problems) > SHOWN:
            layout.label(text=f"and {len(problems) - SHOWN} more")


class VIEW3D_PT_drapery_simulation(Report, Panel, bpy.types.Panel):
    bl_idname, bl_label = "VIEW3D_PT_drapery_simulation", "Simulation"

    def draw(self, context):
        state.work().follow(context.scene)
        layout, view = self.layout, state.work().view(context.scene)
        row = layout.row(align=True)
        row.operator("scene.drapery_check", icon="CHECKMARK")
        row.operator("scene.drapery_plan", icon="VIEWZOOM")
        row = layout.row(align=True)
        row.scale_y = 1.4
        if state.work().busy or runs(context):
            row.operator("scene.drapery_cancel", icon="CANCEL")
        else:
            row.operator("scene.drapery_simulate", icon="PLAY").how = "GO_ON"
            row.operator("scene.drapery_continue", icon="FF")
        self.progress(layout, view)
        if view.refused:
            column = layout.column(align=True)
            column.operator("scene.drapery_simulate", text="Start Anew", icon="TRASH").how = "ANEW"
            column.operator("scene.drapery_simulate", text="Continue with Changes", icon="FF").how = "CHANGED"
        for line in view.lines:
            wrapped(layout, line, "INFO")
        self.problems(layout, view.problems)
        row = layout.row(align=True)
        row.operator("scene.drapery_load", icon="IMPORT")
        row.operator("scene.drapery_unload", icon="LOOP_BACK")
        layout.prop(context.scene.drapery, "cache_folder", text="From")
        layout.operator("scene.drapery_write", icon="FILE_FOLDER")
        if not bpy.app.build_options.alembic:
            wrapped(layout, "Built without Alembic: this Blender loads no caches, and another has to write the meshes", "ERROR")


class VIEW3D_PT_drapery_warnings(Report, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_warnings", "Warnings of the Simulation", "VIEW3D_PT_drapery_simulation"
    # Below its sisters: there may be many.
    bl_order = 1

    @classmethod
    def poll(cls, context):
        view = state.work().view(context.scene)
        return bool(view.status and view.warnings)

    def draw(self, context):
        self.problems(self.layout, state.work().view(context.scene).warnings)


class VIEW3D_PT_drapery_preview(Report, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_preview", "Preview", "VIEW3D_PT_drapery_simulation"

    def draw(self, context):
        layout, view = self.layout, state.work().view(context.scene, PREVIEW)
        row = layout.row(align=True)
        row.operator("scene.drapery_preview", icon="PLAY")
        row.operator("scene.drapery_dismiss", icon="X")
        self.progress(layout, view)
        for line in view.lines:
            wrapped(layout, line, "INFO")
        self.problems(layout, view.problems)


class VIEW3D_PT_drapery_live(Report, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_live", "Live View", "VIEW3D_PT_drapery_simulation"

    def draw_header(self, context):
        self.layout.prop(context.scene.drapery, "live", text="")

    def draw(self, context):
        layout, scene = self.layout, context.scene
        layout.prop(scene.drapery, "live_newest")
        shown = state.work().live.state(scene)
        if shown is None:
            return
        text, other = shown.note(scene.frame_current)
        wrapped(layout, ("Preview: " if scene.drapery.preview else "") + text, "ERROR" if other else "HIDE_OFF")
        self.problems(layout, shown.problems)


class VIEW3D_PT_drapery_colours(Report, Panel, bpy.types.Panel):
    bl_idname, bl_label, bl_parent_id = "VIEW3D_PT_drapery_colours", "Colours", "VIEW3D_PT_drapery_simulation"

    def draw(self, context):
        layout, scene, live = self.layout, context.scene, state.work()
        row = layout.row(align=True)
        for show, label, _ in COLOURS:
            row.operator("scene.drapery_colours", text=label, depress=scene.drapery.colours == show).show = show
        legend = live.colours.legends.get(scene.name)
        if legend:
            column = layout.column(align=True)
            # Of strain from below, so that what is large is above; of contact, what is close.
            for icon, text in reversed(list(zip(state.pictures().legend_icons(), legend))):
                column.label(text=text, icon_value=icon)
        self.problems(layout, live.colours.problems.get(scene.name, []))


CLASSES = (VIEW3D_PT_drapery_object, VIEW3D_PT_drapery_properties, VIEW3D_PT_drapery_contact, VIEW3D_PT_drapery_pins,
           VIEW3D_PT_drapery_elastics, VIEW3D_PT_drapery_seams, VIEW3D_PT_drapery_maps, VIEW3D_PT_drapery_shot, VIEW3D_PT_drapery_simulation,
           VIEW3D_PT_drapery_warnings, VIEW3D_PT_drapery_preview, VIEW3D_PT_drapery_live, VIEW3D_PT_drapery_colours)
