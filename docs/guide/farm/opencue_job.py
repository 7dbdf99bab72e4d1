"""Submits a shot to OpenCue with PyOutline: `python opencue.py SHOW SHOT SCENE 1001-1100 OUT`."""

import getpass
import sys

import outline
import outline.cuerun
import outline.modules.shell

show, shot, scene, frames, out = sys.argv[1:6]
first, last = (int(frame) for frame in frames.split("-"))

# One frame of the layer is the whole range: a simulation cannot be split. The command has no #FRAME# in it for the same
# reason. CUE_THREADS tells the program how many threads it has.
command = ["drapery", "run", scene, "--frames", frames, "--out", out, "--progress", "alf"]
layer = outline.modules.shell.Shell("cloth", command=command, range=frames, chunk=last - first + 1, threads=16)

job = outline.Outline(f"cloth_{shot}", shot=shot, show=show, user=getpass.getuser())
job.add_layer(layer)
# Every end with another code than 0 uses up a retry, also 75, unless cuebot has a rule for it (see docs/guide/farm.md).
outline.cuerun.launch(job, use_pycuerun=False, maxretries=10)
