"""Judges of the attributes at the points of a cache: Alembic's official reader, Pixar's library and Blender, as arrays in an .npz file.

    python point_attributes.py cache.abc|cache.usd|points.pc2|points.mdd answer.npz [frame ...]

`frame` asks Blender: it imports a stage and shows the attributes of its points there. A point cache moves the points of the
mesh `cage.obj` beside it by the modifier *Mesh Cache*. A process of its own: every judge brings libraries of its own.
"""

import math
import sys
from pathlib import Path

import numpy as np

NUMBERS = ("strain", "contact")


def alembic(path):
    from alembic3d import Abc, AbcGeom

    archive = Abc.IArchive(path)
    found = archive.getTop()
    while not AbcGeom.IPolyMesh.matches(found.getHeader()):
        found = found.getChild(0)
    mesh = AbcGeom.IPolyMesh(found, Abc.WrapExistingFlag.kWrapExisting).getSchema()
    attributes = mesh.getArbGeomParams()
    answer = {"held": [attributes.getPropertyHeader(i).getName() for i in range(attributes.getNumProperties())]}
    at = [Abc.ISampleSelector(mesh.getTimeSampling().getSampleTime(i)) for i in range(mesh.getNumSamples())]
    for name in NUMBERS:
        numbers = AbcGeom.IFloatGeomParam(attributes, name)
        assert numbers.getScope() == AbcGeom.GeometryScope.kVertexScope and not numbers.isConstant()
        answer[name] = [np.array(list(numbers.getExpandedValue(time).getVals())) for time in at]
    thickness = AbcGeom.IFloatGeomParam(attributes, "thickness")
    rest = AbcGeom.IP3fGeomParam(attributes, "Pref")
    for still in (thickness, rest):
        assert still.isConstant() and still.getNumSamples() == 1
        assert still.getScope() == AbcGeom.GeometryScope.kVertexScope
    answer["thickness"] = np.array(list(thickness.getExpandedValue().getVals()))
    answer["rest"] = np.array([tuple(point) for point in rest.getExpandedValue().getVals()])
    normals = mesh.getNormalsParam()
    assert normals.getScope() == AbcGeom.GeometryScope.kVertexScope
    answer["normals"] = [np.array([tuple(v) for v in normals.getExpandedValue(time).getVals()]) for time in at]
    return answer


def pixar(path):
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(path)
    (mesh,) = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    times = np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 1)
    primvars = UsdGeom.PrimvarsAPI(mesh)
    answer = {"held": [primvar.GetPrimvarName() for primvar in primvars.GetPrimvarsWithAuthoredValues()]}
    for name in NUMBERS:
        primvar = primvars.GetPrimvar(name)
        assert primvar.GetInterpolation() == "vertex" and str(primvar.GetTypeName()) == "float[]"
        answer[name] = [np.array(primvar.Get(time)) for time in times]
    for name, kind in (("thickness", "float[]"), ("rest", "point3f[]")):
        primvar = primvars.GetPrimvar(name)
        assert primvar.GetInterpolation() == "vertex" and str(primvar.GetTypeName()) == kind
        assert not primvar.ValueMightBeTimeVarying()
        answer[name] = np.array(primvar.Get())
    assert mesh.GetNormalsInterpolation() == "vertex"
    answer["normals"] = [np.array(mesh.GetNormalsAttr().Get(time)) for time in times]
    return answer


def values(data, name, width):
    found = np.empty(len(data) * width, np.float32)
    data.foreach_get(name, found)
    return found.reshape(-1, width) if width > 1 else found


def blender(path, frames):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    bpy.ops.wm.usd_import(filepath=path, set_frame_range=True)
    (thing,) = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    answer = {name: [] for name in (*NUMBERS, "thickness", "rest")}
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        for name in answer:
            attribute = mesh.attributes[name]
            assert attribute.domain == "POINT"
            answer[name].append(values(attribute.data, "vector" if name == "rest" else "value", 3 if name == "rest" else 1))
    return answer


def point_cache(path, frames):
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    bpy.ops.wm.obj_import(filepath=str(Path(path).with_name("cage.obj")), forward_axis="Y", up_axis="Z")
    (thing,) = [thing for thing in bpy.data.objects if thing.type == "MESH"]
    modifier = thing.modifiers.new("cache", "MESH_CACHE")
    modifier.cache_format = path[-3:].upper()
    modifier.filepath = path
    modifier.forward_axis, modifier.up_axis = "POS_Y", "POS_Z"
    modifier.frame_start, modifier.play_mode, modifier.time_mode = frames[0], "SCENE", "FRAME"
    positions = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        mesh = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        positions.append(values(mesh.vertices, "co", 3))
    return {"positions": positions}


def main():
    path, answer_path, *frames = sys.argv[1:]
    frames = [math.floor(float(frame)) for frame in frames]
    if path.endswith((".pc2", ".mdd")):
        answer = point_cache(path, frames)
    elif frames:
        answer = blender(path, frames)
    else:
        answer = alembic(path) if path.endswith(".abc") else pixar(path)
    np.savez(answer_path, **answer)


if __name__ == "__main__":
    main()
