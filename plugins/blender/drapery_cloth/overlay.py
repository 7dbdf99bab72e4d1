"""A line in the 3D view that says which frame of a run is shown, so that no frame is taken for another."""

import blf
import bpy

from . import state

# Pixels from the lower left corner of the view, and height of the letters, before they are scaled for the screen.
PLACE, SIZE = (20, 20), 13


def draw():
    context = bpy.context
    if not context.space_data.overlay.show_overlays:
        return
    shown = state.work().live.state(context.scene)
    if shown is None:
        return
    text, other = shown.note(context.scene.frame_current)
    scale = context.preferences.system.ui_scale
    left = sum(region.width for region in context.area.regions if region.type == "TOOLS" and region.alignment == "LEFT")
    blf.size(0, SIZE * scale)
    blf.color(0, *((1.0, 0.6, 0.1, 1.0) if other else (1.0, 1.0, 1.0, 0.9)))
    blf.position(0, left + PLACE[0] * scale, PLACE[1] * scale, 0)
    blf.draw(0, ("Drapery preview: " if context.scene.drapery.preview else "Drapery: ") + text)


def register(undo):
    """Draws it from now on; `undo` gets what ends that."""
    handle = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")
    undo.callback(bpy.types.SpaceView3D.draw_handler_remove, handle, "WINDOW")
