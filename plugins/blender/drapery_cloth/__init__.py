"""Drapery in Blender: garments and bodies are marked in a panel, simulated by the solver in a process of its own, and loaded
back onto the same objects. Works in Blender 4.2 and later as an extension; docs/howto/blender.md says what works in older ones."""

# What Blender before 4.2 reads, and later ones leave alone.
bl_info = {
    "name": "Drapery",
    "author": "The Drapery project",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D View > Sidebar > Drapery",
    "description": "Cloth without intersections, simulated in a process of its own",
    "category": "Physics",
}

import bpy

OLDEST = (3, 4, 0)


class VIEW3D_PT_drapery_too_old(bpy.types.Panel):
    """All that is registered in a Blender that is too old for the rest."""

    bl_idname, bl_label = "VIEW3D_PT_drapery_too_old", "Drapery"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Drapery"

    def draw(self, context):
        self.layout.label(text=too_old(bpy.app.version), icon="ERROR")


def too_old(version):
    """What is said of a version that is too old; empty if it is not."""
    if tuple(version) >= OLDEST:
        return ""
    return f"Drapery needs Blender 4.2 or later; this is {'.'.join(map(str, version))}"


def parts():
    # Imported late: an old Blender has an older Python, which need not understand the rest.
    from . import operators, panels, settings

    return settings, operators, panels


def after_load(*_):
    from . import state

    state.work().forget()
    state.work().look_at_all()


# Blender takes handlers that are not marked away when a file is opened.
bpy.app.handlers.persistent(after_load)


def register():
    if too_old(bpy.app.version):
        bpy.utils.register_class(VIEW3D_PT_drapery_too_old)
        return
    from . import pictures, state, work

    state.start(work.Work(), pictures.Pictures())
    for part in parts():
        part.register()
    bpy.app.handlers.load_post.append(after_load)
    # While Blender starts there are no scenes yet; those of the file that it opens come by the handler.
    if hasattr(bpy.data, "scenes"):
        state.work().look_at_all()


def unregister():
    if too_old(bpy.app.version):
        bpy.utils.unregister_class(VIEW3D_PT_drapery_too_old)
        return
    from . import state

    bpy.app.handlers.load_post.remove(after_load)
    state.clear()
    for part in reversed(parts()):
        part.unregister()
