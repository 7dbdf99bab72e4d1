"""Colours of strain and contact, and pictures of them for a legend; nothing here knows Blender."""

# Colours (RGB, linear) of shares from 0 to 1 in equal steps, and beyond.
RAMP = ((0.05, 0.12, 0.75), (0.05, 0.62, 0.75), (0.10, 0.62, 0.12), (0.95, 0.75, 0.05), (0.85, 0.06, 0.04))
BEYOND = (0.75, 0.03, 0.75)
SWATCH_SIZE = 16


def swatch(colour):
    """Pixels of a square of one colour, as RGBA between 0 and 1 for a screen."""
    return [*(part ** (1.0 / 2.2) for part in colour), 1.0] * SWATCH_SIZE**2
