"""Pictures of the fabrics, drawn when they are first shown."""

import bpy
import bpy.utils.previews

from .fabrics import FABRICS, PICTURE_SIZE, picture
from .ramp import BEYOND, RAMP, SWATCH_SIZE, swatch

# A fabric of the studio, from a material file.
OTHER = "OTHER"


class Pictures:
    """Icons by fabric, and the entries of the list that holds them: Blender keeps no texts of its own, so these have to live."""

    def __init__(self):
        self.previews = bpy.utils.previews.new()
        self.entries, self.swatches = [], []

    def legend_icons(self):
        """Icons of the colours of the ramp, and of the one beyond it."""
        if not self.swatches:
            for index, colour in enumerate((*RAMP, BEYOND)):
                preview = self.previews.new(f"ramp {index}")
                preview.icon_size = preview.image_size = (SWATCH_SIZE, SWATCH_SIZE)
                preview.icon_pixels_float = preview.image_pixels_float = swatch(colour)
                self.swatches.append(preview.icon_id)
        return self.swatches

    def fabric_entries(self):
        if not self.entries:
            for index, fabric in enumerate(FABRICS):
                preview = self.previews.new(fabric.name)
                pixels = picture(fabric)
                preview.icon_size = preview.image_size = (PICTURE_SIZE, PICTURE_SIZE)
                preview.icon_pixels_float = preview.image_pixels_float = pixels
                help = f"{fabric.use}; {fabric.thickness:g} mm, {fabric.mass} g/m², stretches up to {fabric.strain:g} %"
                self.entries.append((fabric.name, fabric.label, help, preview.icon_id, index))
            self.entries.append((OTHER, "Other", "A material of the studio, by its name", "QUESTION", len(FABRICS)))
        return self.entries

    def remove(self):
        bpy.utils.previews.remove(self.previews)
        self.entries, self.swatches = [], []
