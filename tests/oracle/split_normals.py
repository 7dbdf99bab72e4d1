"""Normals of a cache as outside programs have them, one for each face corner, as arrays in an .npz file.

    python split_normals.py cache.abc|cache.usd answer.npz [frame ...]
    python split_normals.py make cube.abc

`frame` asks Blender, which imports the file. `make` writes a cube whose normals are of face corners by Alembic's official library.
"""

import math
import sys

import numpy as np

# Corners of the faces of a cube of side 0.2 around the origin, counter-clockwise, and their directions.
POINTS = np.array([(x, y, z) for z in (-0.1, 0.1) for y in (-0.1, 0.1) for x in (-0.1, 0.1)])
FACES = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
DIRECTIONS = [(0, 0, -1), (0, 0, 1), (0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0)]


def make(path):
    import imath
    from alembic3d import Abc, AbcGeom

    def filled(array, values):
        for place, value in enumerate(values):
            array[place] = value
        return array

    # Clockwise, as the format wants them.
    corners = [corner for face in FACES for corner in reversed(face)]
    normals = [imath.V3f(*direction) for direction in DIRECTIONS for _ in range(4)]
    archive = Abc.OArchive(path)
    mesh = AbcGeom.OPolyMesh(archive.getTop(), "cube")
    sample = AbcGeom.OPolyMeshSchemaSample(
        filled(imath.V3fArray(8), [imath.V3f(*map(float, point)) for point in POINTS]),
        filled(imath.IntArray(24), corners),
        filled(imath.IntArray(6), [4] * 6),
        AbcGeom.OV2fGeomParamSample(),
        AbcGeom.ON3fGeomParamSample(filled(imath.V3fArray(24), normals), AbcGeom.GeometryScope.kFacevaryingScope),
    )
    mesh.getSchema().set(sample)


def alembic(path):
    from alembic3d import Abc, AbcGeom

    found = Abc.IArchive(path).getTop()
    while not AbcGeom.IPolyMesh.matches(found.getHeader()):
        found = found.getChild(0)
    mesh = AbcGeom.IPolyMesh(found, Abc.WrapExistingFlag.kWrapExisting).getSchema()
    normals = mesh.getNormalsParam()
    at = [Abc.ISampleSelector(mesh.getTimeSampling().getSampleTime(i)) for i in range(mesh.getNumSamples())]
    seen = np.array([[tuple(v) for v in normals.getExpandedValue(time).getVals()] for time in at])
    counts = list(mesh.getValue(at[0]).getFaceCounts())
    of_corners = normals.getScope() == AbcGeom.GeometryScope.kFacevaryingScope
    # Counter-clockwise.
    order = np.concatenate([np.arange(start + count - 1, start - 1, -1) for start, count in zip(np.cumsum([0, *counts[:-1]]), counts)])
    return {"of_corners": of_corners, "normals": seen[:, order] if of_corners else seen}


def pixar(path):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(path)
    (mesh,) = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    times = np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 1)
    normals = np.array([mesh.GetNormalsAttr().Get(time) for time in times])
    return {"of_corners": mesh.GetNormalsInterpolation() == "faceVarying", "normals": normals}


def blender(path, frames):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    if path.endswith(".abc"):
        bpy.ops.wm.alembic_import(filepath=path)
    else:
        bpy.ops.wm.usd_import(filepath=path, set_frame_range=True)
    (thing,) = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    normals, positions, corners = [], [], []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        for found, data, name, width, kind in (
            (normals, mesh.corner_normals, "vector", 3, np.float32),
            (positions, mesh.vertices, "co", 3, np.float32),
            (corners, mesh.loops, "vertex_index", 1, np.int32),
        ):
            values = np.empty(len(data) * width, kind)
            data.foreach_get(name, values)
            found.append(values.reshape(-1, width))
    return {"normals": normals, "positions": positions, "corners": np.array(corners)[:, :, 0]}


def main():
    path, answer_path, *frames = sys.argv[1:]
    if path == "make":
        make(answer_path)
        return
    if frames:
        answer = blender(path, [math.floor(float(frame)) for frame in frames])
    else:
        answer = alembic(path) if path.endswith(".abc") else pixar(path)
    np.savez(answer_path, **answer)


if __name__ == "__main__":
    main()
