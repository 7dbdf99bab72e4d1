"""The presets of `drapery materials`, in the words of an artist, and a picture of each; nothing here knows Blender.

A test compares names and numbers with those that the command lists.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Fabric:
    """A preset: its name in scene files, what it is called, thickness in mm, mass in g/m², largest strain in per cent, colour, and
    how it is made."""

    name: str
    label: str
    use: str
    thickness: float
    mass: int
    strain: float
    colour: tuple
    weave: str


FABRICS = (
    Fabric("silk_light", "Light Silk", "blouses and scarves; falls in many fine folds", 0.18, 83, 6.5, (0.86, 0.80, 0.88), "satin"),
    Fabric("polyester_lining", "Lining", "smooth lining of coats and skirts", 0.25, 113, 6.5, (0.55, 0.60, 0.72), "satin"),
    Fabric("cotton_shirting", "Shirt Cotton", "woven cotton for shirts and sheets", 0.318, 150, 6.1, (0.88, 0.90, 0.93), "plain"),
    Fabric("cotton_jersey", "T-Shirt Jersey", "T-shirt knit; gives to the sides", 0.6, 187, 13.4, (0.72, 0.75, 0.78), "knit"),
    Fabric("wool_suiting", "Suit Wool", "woven wool for suits and trousers", 0.568, 235, 8.5, (0.30, 0.32, 0.38), "twill"),
    Fabric("ponte_knit", "Ponte", "firm double knit for jackets and dresses", 0.9, 284, 13.4, (0.66, 0.52, 0.40), "knit"),
    Fabric("denim_11oz", "Denim, 11 oz", "jeans; stiff to bend", 0.66, 324, 5.2, (0.20, 0.30, 0.52), "twill"),
    Fabric("canvas", "Canvas", "bags, tents and workwear", 0.53, 294, 6.1, (0.72, 0.66, 0.52), "plain"),
    Fabric("leather_garment", "Leather", "jackets; heavy and slow", 0.8, 560, 10.0, (0.32, 0.20, 0.14), "grain"),
    Fabric("paper", "Paper", "office paper; creases, hardly stretches", 0.13, 100, 0.5, (0.95, 0.94, 0.90), "smooth"),
)

PICTURE_SIZE = 64


def shade(weave, x, y):
    """Brightness of a fabric at a pixel, around 1: how its threads catch the light."""
    if weave == "plain":
        over = (x // 8 + y // 8) % 2
        along = (x if over else y) % 8
        return 0.72 + 0.34 * math.sin(math.pi * (along + 0.5) / 8)
    if weave == "twill":
        return 0.7 + 0.4 * (0.5 + 0.5 * math.sin((x + y) * math.pi / 5)) - 0.12 * (y % 4 == 0)
    if weave == "satin":
        return 0.82 + 0.16 * math.sin(x / 9 + 1.5 * math.sin(y / 17)) + 0.06 * (y % 3 == 0)
    if weave == "knit":
        row, column = y % 10, x % 12
        side = abs(column - 5.5) / 6
        return 1.02 - 0.5 * abs(row / 10 - side) - 0.12 * (column in (0, 11))
    if weave == "grain":
        # A fixed pattern of pebbles: the same picture every time.
        pebble = math.sin(x * 0.9 + 2.1 * math.sin(y * 0.53)) * math.sin(y * 0.8 + 1.7 * math.sin(x * 0.47))
        return 0.9 + 0.3 * pebble
    return 1.0 - 0.04 * ((x * 7 + y * 13) % 5 == 0)


def picture(fabric):
    """Pixels of a fabric's picture as RGBA between 0 and 1, row after row from the bottom: a swatch with a curled corner."""
    pixels = []
    size = PICTURE_SIZE
    for y in range(size):
        for x in range(size):
            fold = size - 1 - x + size - 1 - y
            inside = 1 <= x < size - 1 and 1 <= y < size - 1
            if fold < 14 or not inside:
                pixels += (0.0, 0.0, 0.0, 0.0)
                continue
            light = 1.25 if fold < 20 else shade(fabric.weave, x, y) * (1.08 - 0.16 * (size - y) / size)
            pixels += (*(min(1.0, part * light) for part in fabric.colour), 1.0)
    return pixels
