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

import contextlib
import sys

import bpy

OLDEST = (3, 4, 0)

# What `unregister` takes back, the last first.
_registered = contextlib.ExitStack()

# After an update Blender reads this file anew, and would go on with the modules of the version before.
for _stale in [name for name in sys.modules if name.startswith(__name__ + ".")]:
    del sys.modules[_stale]
    globals().pop(_stale[len(__name__) + 1 :], None)


class VIEW3D_PT_drapery_too_old(bpy.types.Panel):
    """All that is registered in a Blender that is too old for the rest."""

    bl_idname, bl_label = "VIEW3D_PT_drapery_too_old", "Drapery"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Drapery"

    def draw(self, context):
        self.layout.label(text=too_old(bpy.app.version), icon="ERROR")


def too_old(version):
    """Message for a version of Blender that is too old; empty if it is not."""
    if tuple(version) >= OLDEST:
        return ""
    return f"Drapery needs Blender 4.2 or later; this is {'.'.join(map(str, version))}"


def after_load(*_):
    from . import state

    state.work().forget()
    state.work().look_later()


def before_save(*_):
    # Blender 5 forgets what is set on an override if the linked object has nothing of the add-on. Reading it makes that.
    for thing in bpy.data.objects:
        if thing.override_library and thing.override_library.reference:
            thing.override_library.reference.drapery.role  # noqa: B018


def add_handler(handlers, handler, undo):
    # Blender takes handlers that are not marked away when a file is opened.
    handlers.append(bpy.app.handlers.persistent(handler))
    # Scripts that clear the list take it away before.
    undo.callback(lambda: handler in handlers and handlers.remove(handler))


def register_classes(classes, undo):
    for each in classes:
        bpy.utils.register_class(each)
        undo.callback(bpy.utils.unregister_class, each)


def register_parts(undo):
    """Registers one thing after the other; `undo` gets what takes each back. The open file must not be looked at: while an
    add-on is registered, Blender lends it no data."""
    if too_old(bpy.app.version):
        register_classes([VIEW3D_PT_drapery_too_old], undo)
        return
    if hasattr(bpy.types.Object, "drapery"):
        raise RuntimeError("Drapery is enabled already, from another place: disable that one under Preferences > Add-ons first")
    # Imported late: an old Blender has an older Python, which need not understand the rest.
    from . import operators, overlay, panels, pictures, settings, state, work

    drawn = pictures.Pictures()
    undo.callback(drawn.remove)
    going_on = work.Work()
    undo.callback(going_on.remove)
    state.start(going_on, drawn)
    undo.callback(state.clear)
    register_classes(settings.CLASSES, undo)
    for kind, group in settings.PROPERTIES:
        kind.drapery = bpy.props.PointerProperty(type=group, override=settings.OVERRIDABLE)
        undo.callback(delattr, kind, "drapery")
    register_classes(operators.CLASSES, undo)
    register_classes(panels.CLASSES, undo)
    overlay.register(undo)
    add_handler(bpy.app.handlers.load_post, after_load, undo)
    add_handler(bpy.app.handlers.save_pre, before_save, undo)
    going_on.look_later()


def register():
    global _registered
    # All or nothing: what fails halfway takes itself back, and can be tried again.
    with contextlib.ExitStack() as undo:
        register_parts(undo)
        _registered = undo.pop_all()


def unregister():
    _registered.close()
