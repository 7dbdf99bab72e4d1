"""Pixar's library as a judge: what it says about the one mesh of a USD stage, as arrays in an .npz file.

    python official_usd.py stage answer.npz

A process of its own: Blender's module brings another copy of the library. `times` are the time codes asked for, all of the
range and those halfway between; `validation` is what every validator that is registered complains about, `complaints` what
this script finds beside them.
"""

import sys

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdShade, UsdValidation


def validate(stage):
    """Complaints of all validators, each of them loaded, as one line a complaint."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert len(validators) >= 30, f"the library's validators are not there: {len(validators)}"
    errors = UsdValidation.ValidationContext(validators).Validate(stage)
    return [f"{error.GetName()}: {error.GetMessage()}" for error in errors if not error.HasNoError()]


def complaints_about(mesh, time):
    """Complaints about faults that no validator looks for: in faces, in numbers of values, and values that are not finite."""
    found = []
    counts = np.array(mesh.GetFaceVertexCountsAttr().Get(time))
    corners = np.array(mesh.GetFaceVertexIndicesAttr().Get(time))
    points = np.array(mesh.GetPointsAttr().Get(time))
    velocities = mesh.GetVelocitiesAttr().Get(time)
    fine, reason = UsdGeom.Mesh.ValidateTopology(mesh.GetFaceVertexIndicesAttr().Get(time),
                                                 mesh.GetFaceVertexCountsAttr().Get(time), len(points))
    if not fine:
        found.append(reason)
    if counts.min() < 3 or counts.sum() != len(corners) or corners.min() < 0 or corners.max() >= len(points):
        found.append("faces do not fit the points")
    for name, vectors in (("points", points), ("velocities", velocities)):
        if vectors is None:
            continue
        vectors = np.array(vectors)
        if vectors.shape != points.shape or not np.isfinite(vectors).all():
            found.append(f"{name} at {time}: {vectors.shape}, or not all of them are numbers")
    for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues():
        size = {"constant": 1, "uniform": len(counts), "vertex": len(points), "varying": len(points),
                "faceVarying": len(corners)}[primvar.GetInterpolation()] * primvar.GetElementSize()
        if len(primvar.ComputeFlattened(time)) != size:
            found.append(f"{primvar.GetName()}: {len(primvar.ComputeFlattened(time))} values instead of {size}")
    return found


def arrays(stage, mesh):
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    times = np.arange(start, end + 0.25, 0.5)
    points, velocities, extents, bounds, world, found = [], [], [], [], [], []
    for time in times:
        code = Usd.TimeCode(time)
        local = np.array(mesh.GetPointsAttr().Get(code))
        points.append(local)
        velocities.append(np.array(mesh.GetVelocitiesAttr().Get(code) or np.zeros((0, 3))))
        extents.append(np.array(mesh.GetExtentAttr().Get(code)))
        bounds.append(np.array(UsdGeom.PointBased.ComputeExtent(mesh.GetPointsAttr().Get(code))))
        matrix = np.array(mesh.ComputeLocalToWorldTransform(code))
        world.append(local.astype(float) @ matrix[:3, :3] + matrix[3, :3])
        found += complaints_about(mesh, code)
    st = UsdGeom.PrimvarsAPI(mesh).GetPrimvar("st")
    subsets = UsdGeom.Subset.GetAllGeomSubsets(mesh)
    answer = {
        "path": str(mesh.GetPath()),
        "default_prim": str(stage.GetDefaultPrim().GetPath()),
        "kinds": [Usd.ModelAPI(prim).GetKind() for prim in stage.Traverse()],
        "metres_per_unit": UsdGeom.GetStageMetersPerUnit(stage),
        "up_axis": str(UsdGeom.GetStageUpAxis(stage)),
        "rate": stage.GetTimeCodesPerSecond(),
        "frames_per_second": stage.GetFramesPerSecond(),
        "range": [start, end],
        "samples": mesh.GetPointsAttr().GetTimeSamples(),
        "times": times,
        "positions": points,
        "velocities": velocities,
        "extents": extents,
        "bounds": bounds,
        "world_positions": world,
        "face_counts": np.array(mesh.GetFaceVertexCountsAttr().Get()),
        "face_indices": np.array(mesh.GetFaceVertexIndicesAttr().Get()),
        "subdivision": str(mesh.GetSubdivisionSchemeAttr().Get()),
        "orientation": str(mesh.GetOrientationAttr().Get()),
        "subset_names": [subset.GetPrim().GetName() for subset in subsets],
        "subset_families": [str(subset.GetFamilyNameAttr().Get()) for subset in subsets],
        "subset_materials": [str(UsdShade.MaterialBindingAPI(subset).GetDirectBinding().GetMaterialPath()) for subset in subsets],
        "primvars": sorted(primvar.GetPrimvarName() for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues()),
        "validation": validate(stage),
        "complaints": found,
    }
    if st:
        answer |= {"uvs": np.array(st.Get()), "uv_indices": np.array(st.GetIndices()), "uv_interpolation": str(st.GetInterpolation())}
    for index, subset in enumerate(subsets):
        answer[f"subset_{index}"] = np.array(subset.GetIndicesAttr().Get())
    return answer


def main():
    path, answer_path, *prim = sys.argv[1:]
    stage = Usd.Stage.Open(path)
    meshes = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if prim:
        meshes = [mesh for mesh in meshes if str(mesh.GetPath()) in prim]
    if len(meshes) != 1:
        sys.exit(f"one mesh wanted, the stage has {[str(mesh.GetPath()) for mesh in meshes]}")
    answer = arrays(stage, meshes[0])
    np.savez(answer_path, **{name: np.array(value) for name, value in answer.items()})


if __name__ == "__main__":
    try:
        main()
    except Tf.ErrorException as error:
        sys.exit(str(error))
