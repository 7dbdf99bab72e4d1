"""The official Alembic library as a judge: everything it says about the mesh of an archive, as arrays in an .npz file.

    python official_alembic.py cache.abc answer.npz [object path]

A process of its own, because a broken archive may bring the library down. Without a path, the archive has to hold
one mesh. `positions` are as stored, `world_positions` with the transforms of all parents at the sample's time.
"""

import sys

import numpy as np
from alembic3d import Abc, AbcGeom


def meshes(parent):
    for index in range(parent.getNumChildren()):
        child = parent.getChild(index)
        if AbcGeom.IPolyMesh.matches(child.getHeader()):
            yield AbcGeom.IPolyMesh(parent, child.getName())
        yield from meshes(child)


def choose(archive, path):
    found = [mesh for mesh in meshes(archive.getTop()) if path in (None, mesh.getFullName())]
    if len(found) != 1:
        names = [mesh.getFullName() for mesh in meshes(archive.getTop())]
        sys.exit(f"one mesh wanted ({path or 'any path'}), the archive has {names}")
    return found[0]


def samples(prop):
    """All samples of an array property; copies, because the library's arrays die with its objects."""
    return [np.array(sample) for sample in prop.samples]


def world_matrix(schema_object, time):
    """Row-vector matrix from an object's own space to the world."""
    matrix = np.eye(4)
    parent = schema_object.getParent()
    while parent.getParent().valid():
        if AbcGeom.IXform.matches(parent.getHeader()):
            value = AbcGeom.IXform(parent.getParent(), parent.getName()).getSchema().getValue(Abc.ISampleSelector(time))
            own = value.getMatrix()
            matrix = matrix @ np.array([[own[row][column] for column in range(4)] for row in range(4)])
            if not value.getInheritsXforms():
                break
        parent = parent.getParent()
    return matrix


def world(mesh, positions, times):
    matrices = [world_matrix(mesh, float(time)) for time in times]
    return np.stack([x.astype(float) @ m[:3, :3] + m[3, :3] for x, m in zip(positions, matrices)])


def box(value):
    return [[*value.min()], [*value.max()]]


def read(archive, mesh):
    schema = mesh.getSchema()
    positions = schema.getPositionsProperty()
    sampling = positions.getTimeSampling()
    answer = {
        "path": mesh.getFullName(),
        "positions": np.stack(samples(positions)),
        "times": np.array([sampling.getSampleTime(index) for index in range(len(positions.samples))]),
        "uniform": sampling.getTimeSamplingType().isUniform(),
        "homogeneous": schema.getTopologyVariance() == AbcGeom.MeshTopologyVariance.kHomogenousTopology,
        "constant": schema.getTopologyVariance() == AbcGeom.MeshTopologyVariance.kConstantTopology,
        "face_counts": samples(schema.getFaceCountsProperty())[0],
        "face_indices": samples(schema.getFaceIndicesProperty())[0],
        "self_bounds": np.array([box(sample) for sample in schema.getSelfBoundsProperty().samples]),
    }
    answer["world_positions"] = world(mesh, answer["positions"], answer["times"])
    # The binding crashes when asked anything else of a property that is not there.
    velocities = schema.getVelocitiesProperty()
    answer["velocities"] = np.stack(samples(velocities)) if velocities else np.empty((0, 0, 3), np.float32)

    about = archive.getTop().getMetaData()
    for name in ("Application", "DCC_FPS", "Description", "DateWritten"):
        answer[name] = about.get(f"_ai_{name}")
    answer["has_normals"] = schema.getNormalsParam().valid()

    top = archive.getTop().getProperties()
    names = [top.getPropertyHeader(index).getName() for index in range(top.getNumProperties())]
    if ".childBnds" in names:
        bounds = Abc.IBox3dProperty(top, ".childBnds")
        answer["archive_bounds"] = np.array([box(sample) for sample in bounds.samples])

    uvs = schema.getUVsParam()
    if uvs.valid():
        corner = uvs.getExpandedValue(Abc.ISampleSelector(0))
        answer["uvs"] = np.array(corner.getVals())
        answer["uv_scope"] = str(uvs.getScope())
    names = sorted(schema.getFaceSetNames())
    answer["face_set_names"] = np.array(names, dtype=str)
    for index, name in enumerate(names):
        answer[f"face_set_{index}"] = np.array(schema.getFaceSet(name).getSchema().getValue().getFaces())
    return answer


def main():
    archive = Abc.IArchive(sys.argv[1])
    mesh = choose(archive, sys.argv[3] if len(sys.argv) > 3 else None)
    np.savez(sys.argv[2], **read(archive, mesh))


if __name__ == "__main__":
    main()
