"""Reads meshes of Alembic archives (Ogawa), also while the solver appends frames to them; nothing here knows Blender.

The Live View needs it: Blender's own reader keeps an archive open as it was, and some builds of Blender have none. An archive is a tree
of groups and data. Its header points to the root, and a writer moves that pointer last, so that a reader finds a whole archive at
any time. Of the format, what meshes need is read: positions, faces, time samplings and the transforms above a mesh.
"""

import struct
from dataclasses import dataclass

# The bit of a child's offset that tells data from groups.
DATA = 1 << 63
# Bytes of the digest before the values of an array, and after the headers of objects.
DIGEST, HASHES = 16, 32
COMPOUND, SCALAR, ARRAY = 0, 1, 2
# More is no mesh of a shot; a broken file may claim any number.
LARGEST = 1 << 34


class NotReadable(Exception):
    """The file is no such archive, or holds no such mesh; the text says which."""


# Errors of a reader that follows offsets of a damaged file.
DAMAGED = (struct.error, LookupError, ValueError)


@dataclass
class Property:
    """Header of a property, and the group with its samples or, of a compound, its properties."""

    name: str
    kind: int
    group: int
    samples: int = 0
    first_changed: int = 0
    last_changed: int = 0
    sampling: int = 0

    def stored(self, index):
        """Place among the stored samples of the sample `index`: equal ones at the ends are stored once."""
        index = max(0, min(index, self.samples - 1))
        if self.first_changed == self.last_changed == 0 or index < self.first_changed:
            return 0
        return min(index, self.last_changed) - self.first_changed + 1


class Archive:
    """An open archive; a context manager. Raises `NotReadable`, and `OSError` where the file cannot be read."""

    def __init__(self, path):
        self.path, self.file = path, open(path, "rb")
        try:
            head = self.read(0, 16)
            if head[:5] != b"Ogawa":
                raise NotReadable(f"{path} is no Alembic archive of the kind Ogawa")
            self.root = self.children(struct.unpack("<Q", head[8:])[0])
            if len(self.root) < 6:
                raise NotReadable(f"{path} is not complete")
            self.metadata = self.indexed_metadata()
        except BaseException:
            self.file.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.file.close()

    def read(self, offset, size):
        if size > LARGEST:
            raise NotReadable(f"{self.path} is damaged")
        self.file.seek(offset)
        found = self.file.read(size)
        if len(found) != size:
            raise NotReadable(f"{self.path} is cut off")
        return found

    def children(self, offset):
        """Offsets of the children of a group, with the bit `DATA`."""
        offset &= ~DATA
        if offset == 0:
            return ()
        (count,) = struct.unpack("<Q", self.read(offset, 8))
        return struct.unpack(f"<{count}Q", self.read(offset + 8, 8 * count))

    def data(self, offset, skip=0):
        """Bytes of a child, from `skip` on."""
        offset &= ~DATA
        if offset == 0:
            return b""
        (size,) = struct.unpack("<Q", self.read(offset, 8))
        return self.read(offset + 8 + skip, max(0, size - skip))

    def indexed_metadata(self):
        """Texts that headers name by number; the first is empty."""
        found, buffer, place = [b""], self.data(self.root[5]), 0
        while place < len(buffer):
            size = buffer[place]
            found.append(buffer[place + 1 : place + 1 + size])
            place += 1 + size
        return found

    def samplings(self):
        """Time samplings: of each the seconds of a cycle and the times in it."""
        found, buffer, place = [], self.data(self.root[4]), 0
        while place < len(buffer):
            _, cycle, count = struct.unpack_from("<IdI", buffer, place)
            found.append((cycle, struct.unpack_from(f"<{count}d", buffer, place + 16)))
            place += 16 + 8 * count
        return found

    def objects(self, group):
        """Name, metadata and group of each object below one."""
        children = self.children(group)
        if len(children) < 2:
            return
        headers, place = self.data(children[-1])[:-HASHES], 0
        for child in children[1:-1]:
            (size,) = struct.unpack_from("<I", headers, place)
            name, place = headers[place + 4 : place + 4 + size].decode("utf-8", "replace"), place + 4 + size
            index, place = headers[place], place + 1
            if index == 0xFF:
                (size,) = struct.unpack_from("<I", headers, place)
                metadata, place = headers[place + 4 : place + 4 + size], place + 4 + size
            else:
                metadata = self.metadata[index]
            yield name, metadata, child

    def properties(self, group):
        """The properties of a compound, by name."""
        children = self.children(group)
        if not children:
            return {}
        headers, place, found = self.data(children[-1]), 0, {}
        for child in children[:-1]:
            prop, place = property_at(headers, place, child)
            found[prop.name] = prop
        return found

    def sample(self, prop, index):
        """Bytes of the values of a sample."""
        children, stored = self.children(prop.group), prop.stored(index)
        if prop.kind == SCALAR:
            return self.data(children[stored], DIGEST)
        return self.data(children[2 * stored], DIGEST)

    def mesh(self, path=None):
        """The mesh at a path such as "/skirt/skirtShape"; without one, the first of the archive. Raises `NotReadable`."""
        try:
            found = next((mesh for mesh in self.meshes(self.root[2], "", []) if path in (None, mesh.path)), None)
        except DAMAGED as error:
            raise NotReadable(f"{self.path} is damaged: {error}") from error
        if found is None:
            raise NotReadable(f"{self.path} holds no mesh" + (f" {path}" if path else ""))
        return found

    def meshes(self, group, path, transforms):
        for name, metadata, child in self.objects(group):
            properties = self.properties(self.children(child)[0]) if self.children(child) else {}
            above = transforms
            if ".xform" in properties:
                values = self.properties(properties[".xform"].group).get(".vals")
                above = [values, *transforms] if values else transforms
            if b"AbcGeom_PolyMesh" in metadata and ".geom" in properties:
                yield Mesh(self, f"{path}/{name}", self.properties(properties[".geom"].group), above)
            yield from self.meshes(child, f"{path}/{name}", above)


def property_at(headers, place, group):
    """The property whose header stands at a place, and the place behind it."""
    (info,) = struct.unpack_from("<I", headers, place)
    place += 4
    kind, width = min(info & 0x3, ARRAY), 1 << (info >> 2 & 0x3)

    def number():
        nonlocal place
        place += width
        return int.from_bytes(headers[place - width : place], "little")

    prop = Property("", kind, group)
    if kind != COMPOUND:
        prop.samples = number()
        if info & 0x200:
            prop.first_changed, prop.last_changed = number(), number()
        elif not info & 0x800:
            prop.first_changed, prop.last_changed = 1, prop.samples - 1
        prop.sampling = number() if info & 0x100 else 0
    size = number()
    prop.name = headers[place : place + size].decode("utf-8", "replace")
    place += size
    if info >> 20 & 0xFF == 0xFF:
        place += number()
    return prop, place


class Mesh:
    """A mesh of an open archive."""

    def __init__(self, archive, path, properties, transforms):
        self.archive, self.path, self.properties, self.transforms = archive, path, properties, transforms

    @property
    def samples(self):
        """Number of samples of its positions."""
        return self.properties["P"].samples

    @property
    def sampling(self):
        """Seconds from frame to frame, times of the samples of the first frame: its own, then those before the next one."""
        return self.archive.samplings()[self.properties["P"].sampling]

    @property
    def frames(self):
        """Number of frames, whose first samples are there."""
        return -(-self.samples // len(self.sampling[1]))

    def positions(self, index):
        """Three floats of single precision for each vertex at a sample, below the transforms."""
        return self.archive.sample(self.properties["P"], index)

    def frame(self, index):
        """The same at a frame, counted from the first one."""
        return self.positions(index * len(self.sampling[1]))

    def faces(self):
        """Numbers of corners of the faces, and the vertices of the corners, as bytes of 32-bit integers."""
        return tuple(self.archive.sample(self.properties[name], 0) for name in (".faceCounts", ".faceIndices"))

    def matrices(self):
        """Sixteen numbers for each matrix above the mesh, the closest one first, in the first sample; places are rows before them."""
        found = [self.archive.sample(values, 0) for values in self.transforms]
        if any(len(values) != 128 for values in found):
            raise NotReadable(f"{self.archive.path} has a transform that is not one matrix")
        return [struct.unpack("<16d", values) for values in found]
