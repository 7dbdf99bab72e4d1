"""Waiting for the add-on in a process of Blender, whose timer does not run there."""

import time

import bpy


def ticked_until(found, work, seconds):
    """Ticks until something is so; raises `TimeoutError`."""
    end = time.monotonic() + seconds
    while not found():
        work.tick()
        if time.monotonic() > end:
            raise TimeoutError(repr(vars(work.view(bpy.context.scene))))
        time.sleep(0.01)
