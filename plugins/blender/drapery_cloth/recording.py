"""Point caches (PC2) that repeat the positions of a growing Alembic cache, for the Live View; nothing here knows Blender.

Blender's modifier *Mesh Cache* opens its file at every frame, so that frames that are appended are seen without reloading anything, and
builds of Blender without Alembic have it too.
"""

import os
import struct

from .ogawa import Archive, NotReadable

# Signature, version, number of points, first frame, frames between samples, number of samples.
HEADER = struct.Struct("<12siiffi")
SIGNATURE, VERSION = b"POINTCACHE2\0", 1
# Bytes that are copied at once, so that a window does not wait for a long cache.
BUDGET = 64 << 20


class Recording:
    """The frames of one mesh, from an Alembic cache into a PC2 file.

    `frames` of them are there, from the frame `first` on; positions are those of the cache, Y up, in metres. A PC2 file has its samples at
    equal distances, and those between frames are where the shutter opens and closes: they are ignored.
    """

    def __init__(self, source, path, target):
        self.source, self.path, self.target = source, path, target
        self.first, self.frames, self.points = 0, 0, 0
        # What the source was when all of it was copied, and the last frame that was copied.
        self.seen = self.newest = None

    @property
    def last(self):
        return self.first + self.frames - 1

    def update(self, rate, attempt):
        """Copies what has been written since; the first frame that is new, or None.

        `rate` is in frames per second; `attempt` counts the starts of the run: one that resumes may replace frames. Raises
        `NotReadable` and `OSError`.
        """
        found = os.stat(self.source)
        stamp = found.st_mtime_ns, found.st_size, found.st_ino, attempt
        if stamp == self.seen and self.target.exists():
            return None
        with Archive(self.source) as archive:
            mesh = archive.mesh(self.path)
            cycle, (start, *_) = mesh.sampling
            if mesh.samples > 1 and abs(cycle * rate - 1.0) > 1e-3:
                raise NotReadable(f"{self.source} has no sample at each of its frames")
            begin = self.frames if self.goes_on(mesh, stamp) else 0
            self.frames, self.first = begin, round(start * rate)
            if begin < mesh.frames:
                self.copy(mesh, begin)
            self.seen = stamp if self.frames == mesh.frames else (*stamp[:2], None, attempt)
        return self.first + begin if self.frames > begin else None

    def goes_on(self, mesh, stamp):
        """Whether the frames that were copied are still those of the source."""
        same = self.seen is not None and self.seen[3] == stamp[3] and self.target.exists() and 0 < self.frames <= mesh.frames
        return same and mesh.frame(self.frames - 1) == self.newest

    def copy(self, mesh, begin):
        self.target.parent.mkdir(parents=True, exist_ok=True)
        left = BUDGET
        with open(self.target, "r+b" if begin else "wb") as file:
            for index in range(begin, mesh.frames):
                self.newest = mesh.frame(index)
                self.points = len(self.newest) // 12
                file.seek(HEADER.size + index * len(self.newest))
                file.write(self.newest)
                self.frames = index + 1
                left -= len(self.newest)
                if left < 0:
                    break
            # Last: a reader never finds more frames than there are.
            file.flush()
            file.seek(0)
            file.write(HEADER.pack(SIGNATURE, VERSION, self.points, float(self.first), 1.0, self.frames))
