"""Drapery, an offline cloth solver for film-quality shots: scenes, simulations frame by frame, whole shots, caches, studies.

Lengths are in metres with Y up, times in seconds, masses in kilograms; arrays of points have the shape (points, 3). What is stepped
or run here equals the result of ``drapery run`` bit for bit. Messages go to the logger ``drapery``. ``python -m drapery`` is the command.

>>> import drapery
>>> simulation = drapery.Scene.load("hanging_sheet.toml").simulate()
>>> simulation.advance().steps
>>> simulation.positions("sheet")
"""

import logging as _logging

from ._analysis import Material, Study, StudyRow, Verification, materials, read_study, study, verify
from ._arrays import Faces
from ._caches import Cache, CacheMesh, CacheWriter, Units, Uvs, open_cache
from ._errors import (
    DraperyError,
    InputError,
    InternalError,
    NoMemoryError,
    OutputError,
    SceneError,
    SolverError,
    UsageError,
)
from ._files import (
    ArrayDifference,
    ChannelInfo,
    Conversion,
    Difference,
    FileDifference,
    FileInfo,
    FrameDistance,
    MeshInfo,
    WorstVertex,
    compare,
    convert,
    diff,
    info,
    report,
    view,
)
from ._native import State, __version__, set_threads
from ._scene import Frame, Plan, Progress, Report, Scene, SceneWarning, Shot, Simulation

__all__ = [
    "ArrayDifference",
    "Cache",
    "CacheMesh",
    "CacheWriter",
    "ChannelInfo",
    "Conversion",
    "Difference",
    "DraperyError",
    "Faces",
    "FileDifference",
    "FileInfo",
    "Frame",
    "FrameDistance",
    "InputError",
    "InternalError",
    "Material",
    "MeshInfo",
    "NoMemoryError",
    "OutputError",
    "Plan",
    "Progress",
    "Report",
    "Scene",
    "SceneError",
    "SceneWarning",
    "Shot",
    "Simulation",
    "SolverError",
    "State",
    "Study",
    "StudyRow",
    "Units",
    "UsageError",
    "Uvs",
    "Verification",
    "WorstVertex",
    "__version__",
    "compare",
    "convert",
    "diff",
    "info",
    "materials",
    "open_cache",
    "read_study",
    "report",
    "set_threads",
    "study",
    "verify",
    "view",
]

# What to do with messages is for the program to say.
_logging.getLogger("drapery").addHandler(_logging.NullHandler())
