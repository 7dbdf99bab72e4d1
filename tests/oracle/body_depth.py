"""Depth of cloth inside a body, and the places where the body crosses itself, by libigl and ipctk."""

import igl
import ipctk
import numpy as np

# Where parts of the body overlap there is no outside to put the cloth: it is released there, and held again when
# they part. The frames are 42 ms apart, so some cloth near such a place has been inside it since the last frame.
RELEASE_REACH = 0.030


def crossing_triangles(vertices, faces):
    """Pairs of triangles (indices) that cross: an edge of one goes through the other; at most a vertex is shared."""
    edges = igl.edges(faces)
    order = {tuple(edge): index for index, edge in enumerate(edges.tolist())}
    broad = ipctk.HashGrid()
    broad.build(np.asfortranarray(vertices), np.asfortranarray(edges, np.int32), np.asfortranarray(faces, np.int32))
    faces_of_edge = [[] for _ in edges]
    for face, (a, b, c) in enumerate(faces.tolist()):
        for pair in ((a, b), (b, c), (c, a)):
            faces_of_edge[order[tuple(sorted(pair))]].append(face)
    found = set()
    for candidate in broad.detect_edge_face_candidates():
        edge, face = edges[candidate.edge_id], faces[candidate.face_id]
        if not ipctk.is_edge_intersecting_triangle(*vertices[edge], *vertices[face]):
            continue
        for other in faces_of_edge[candidate.edge_id]:
            if len(set(faces[other]) & set(face)) < 2:
                found.add((min(other, candidate.face_id), max(other, candidate.face_id)))
    return sorted(found)


def depths(points, vertices, faces):
    """Depth of each point below the surface [the file's unit]; negative outside.

    Inside is where the winding number is above one half, which stays meaningful where the body crosses itself.
    """
    inside = igl.fast_winding_number(vertices, faces, np.ascontiguousarray(points, float)) > 0.5
    return np.where(inside, 1.0, -1.0) * distance_to_triangles(points, vertices, faces)


def distance_to_triangles(points, vertices, faces):
    """Distance of each point to the nearest of the triangles; infinite if there are none."""
    if len(faces) == 0:
        return np.full(len(points), np.inf)
    return np.sqrt(igl.point_mesh_squared_distance(np.ascontiguousarray(points, float), vertices, faces)[0])


def simulated_surface(body):
    """Triangles of a body of triangles and quads as Drapery says it cuts them: quads along the shorter diagonal of the
    first sample, the first one on ties. Quads of a character are not flat, so the file alone does not fix its surface."""
    first, start, found = body["world_positions"][0], 0, []
    for count in body["face_counts"]:
        corners = body["face_indices"][start : start + count][::-1]  # Alembic turns clockwise
        start += count
        if count == 4:
            a, b, c, d = corners
            along_ac = np.sum((first[a] - first[c]) ** 2) <= np.sum((first[b] - first[d]) ** 2)
            found += [(a, b, c), (a, c, d)] if along_ac else [(b, c, d), (b, d, a)]
        else:
            assert count == 3
            found.append(tuple(corners))
    return np.array(found, dtype=np.int64)
