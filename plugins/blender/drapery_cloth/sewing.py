"""Pairs of the vertices that a seam sews together. Nothing here knows Blender.

Vertex groups have no order. Along the edges of the mesh they have one: a group that is a single line of edges, or a ring, is
walked from one end to the other. The direction of the second side and the beginning of a ring are those that bring the pairs
closest.
"""


class NoLine(Exception):
    """A group is no single line of edges; the text says why, `vertex` is where, or None."""

    def __init__(self, why, vertex=None):
        super().__init__(why)
        self.vertex = vertex


def line_of(vertices, border, edges):
    """The vertices of a group in their order along edges, and whether they are a ring. Raises `NoLine`.

    Edges of the border go first: in a corner that is one triangle, other edges join the neighbours of the corner too.
    """
    try:
        return walked(vertices, border)
    except NoLine:
        return walked(vertices, edges)


def walked(vertices, edges):
    beside = {vertex: [] for vertex in sorted(vertices)}
    for a, b in edges:
        if a in beside and b in beside:
            beside[a].append(b)
            beside[b].append(a)
    crowded = next((vertex for vertex, others in beside.items() if len(others) > 2), None)
    if crowded is not None:
        raise NoLine(f"vertex {crowded} has {len(beside[crowded])} neighbours in it", crowded)
    left, lines = set(beside), []
    # Ends before vertices between two others: what is left then is rings.
    for first in sorted(beside, key=lambda vertex: (len(beside[vertex]) > 1, vertex)):
        if first in left:
            lines.append(one_line(first, beside, left))
    if len(lines) > 1:
        raise NoLine(f"it is in {len(lines)} pieces", lines[1][0])
    (line,) = lines
    return line, len(line) > 2 and line[0] in beside[line[-1]]


def one_line(first, beside, left):
    """Walks from a vertex to those that are not walked yet, and takes them out of `left`."""
    line = []
    while first is not None:
        line.append(first)
        left.discard(first)
        first = next((other for other in sorted(beside[first]) if other in left), None)
    return line


def closest_order(first, places, second, other_places, rings):
    """The second line, turned and, as a ring, begun so that it lies closest to the first one, vertex by vertex."""

    def alike(line):
        # Sums of squared distances differ by these products alone, wherever the sides are.
        return sum(x * u + y * v + z * w for (x, y, z), (u, v, w) in zip(ahead, (other_places[vertex] for vertex in line)))

    ahead = [places[vertex] for vertex in first]
    starts = range(len(second)) if rings else (0,)
    ways = [way[start:] + way[:start] for way in (second, second[::-1]) for start in starts]
    return max(ways, key=alike)
