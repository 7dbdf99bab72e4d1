"""The Live View: garments show the frames of a run, the scene's own or its preview, as soon as they are written.

A modifier *Mesh Cache* shows each garment where its simulation is; the point caches are in the folder `live` of the scene folder and are
deleted with the view. What is shown follows from the scene and the run alone, at every tick: undo, a run that is cancelled, deleted or
moved, and another file are nothing special.
"""

import json

import bpy

from . import load_cache
from .answers import Problem
from .collect import CACHE, CONSTRAINTS, FINAL, KINDS, LIVE, PREVIEW, run_folder, scene_folder
from .load_cache import CannotLoad, cache_folder, compare_points, evaluate_anew, hold_in_the_world, insert_modifier
from .ogawa import DAMAGED, NotReadable
from .recording import Recording
from .scene_text import plain_name


def kind_shown(scene):
    """Kind of the run that the garments of a scene show, or None."""
    if scene.drapery.preview:
        return PREVIEW
    return FINAL if scene.drapery.live else None


def live_folder(scene, kind):
    folder = scene_folder(scene, kind)
    return folder and folder / "live"


def is_live(thing):
    return thing.modifiers.get(LIVE) is not None


class Shown:
    """State of the Live View of a scene: `first` and `last` are the frames that can be shown, None where there are none; `end` is
    the last frame of the shot."""

    def __init__(self):
        self.folder = self.stamp = self.manifest = None
        self.first = self.last = self.end = None
        # The frame that the playhead was moved to last.
        self.jumped = None
        self.problems = []
        # By the name of the object.
        self.recordings = {}

    def note(self, frame):
        """Returns a sentence about the frame that is shown at `frame`, and whether that is another one."""
        if self.last is None:
            return "No frame is simulated yet: the rest pose is shown", True
        if frame > self.last:
            why = "is not simulated yet" if frame <= self.end else "is behind the shot"
            return f"Frame {frame} {why}: frame {self.last} is shown", True
        if frame < self.first:
            return f"Frame {frame} is before the shot: frame {self.first} is shown", True
        return f"Frame {frame} of {self.first} to {self.last}", False


class Live:
    """The Live Views of all scenes of the open file."""

    def __init__(self):
        self.shown = {}
        # Whether the last tick changed what the window shows.
        self.changed = False

    @property
    def wanted(self):
        """True if any scene has a Live View."""
        return bool(self.shown) or any(kind_shown(scene) is not None for scene in bpy.data.scenes)

    def forget(self):
        self.shown = {}

    def state(self, scene):
        """The state that the panel shows of a scene; None without a Live View."""
        return self.shown.get(scene.name) if kind_shown(scene) is not None else None

    def tick(self):
        self.changed = False
        # What is rendered must not change meanwhile.
        if bpy.app.is_job_running("RENDER"):
            return
        for name in [name for name in self.shown if name not in bpy.data.scenes]:
            self.shown.pop(name)
        for scene in bpy.data.scenes:
            if kind_shown(scene) is not None:
                self.refresh(scene)
            elif scene.name in self.shown:
                self.take_off(scene)

    def refresh(self, scene):
        """Shows what the run of a scene has by now."""
        shown, kind = self.shown.setdefault(scene.name, Shown()), kind_shown(scene)
        folder = cache_folder(scene) if kind == FINAL else run_folder(scene, PREVIEW)
        if folder != shown.folder:
            self.remove_from(scene)
            shown = self.shown[scene.name] = Shown()
            shown.folder = folder
        before = shown.last, [problem.message for problem in shown.problems]
        try:
            if not read_manifest(shown):
                self.wait_for_frames(scene, shown)
            else:
                self.show(scene, shown, live_folder(scene, kind))
        except (CannotLoad, NotReadable) as error:
            shown.problems = [Problem(str(error))]
        except DAMAGED as error:
            shown.problems = [Problem(f"A cache in {shown.folder} is damaged: {error!r}", "simulate again, or copy the run anew")]
        except OSError as error:
            shown.problems = [Problem(f"{error.filename or shown.folder}: {error.strerror}", "make room on the disk, or look whether "
                                      "the folder of the run is still there")]
        self.changed = self.changed or before != (shown.last, [problem.message for problem in shown.problems])

    def wait_for_frames(self, scene, shown):
        shown.problems = []
        if shown.last is not None or any(map(is_live, scene.objects)):
            self.remove_from(scene)
            shown.first = shown.last = None
            shown.recordings = {}

    def show(self, scene, shown, target):
        """Copies new frames and sees to the modifiers. Raises `CannotLoad`, `NotReadable` and `OSError`."""
        manifest = shown.manifest
        if target is None:
            raise CannotLoad("Save the file first, or choose a scene folder")
        loads, remarks = load_cache.matched(scene, shown.folder, manifest)
        frames, base = manifest["fps"].split("/")
        changed = None
        for thing, entry, file in loads:
            path = shown.folder / file
            recording = shown.recordings.get(thing.name)
            if recording is None or recording.source != path:
                name = plain_name(entry["name"])
                recording = shown.recordings[thing.name] = Recording(path, entry["object_path"], target / f"{name}.pc2")
            new = recording.update(int(frames) / int(base), len(manifest["attempts"]))
            changed = new if changed is None else min(changed, changed if new is None else new)
        last, recordings = shown.last, [shown.recordings[thing.name] for thing, _, _ in loads]
        shown.first, shown.last = recordings[0].first, min(recording.last for recording in recordings)
        shown.end, shown.problems = manifest["last_frame"], [Problem(remark, warning=True) for remark in remarks]
        # Objects of a scene that no window shows are seen to once it does.
        if scene == bpy.context.scene:
            for thing, entry, _ in loads:
                self.put_on(scene, thing, entry, shown)
            self.remove_from(scene, {thing.name for thing, _, _ in loads})
        if changed is not None:
            self.seen(scene, shown, loads, changed, last)
        self.jump(scene, shown)

    def put_on(self, scene, thing, entry, shown):
        recording = shown.recordings[thing.name]
        modifier = thing.modifiers.get(LIVE)
        path = load_cache.path_for_blender(recording.target)
        if modifier is not None and modifier.filepath == path and modifier.frame_start == recording.first:
            if thing.drapery.simulated == "BASE" and thing.mode == "OBJECT" and len(thing.data.vertices) != entry["points"]:
                shown.problems.append(Problem(f'"{thing.name}" has {len(thing.data.vertices)} vertices, its simulation {entry["points"]}',
                                              "undo the change, or simulate again", plain_name(thing.name)))
            return
        compare_points(bpy.context, thing, entry)
        hold_in_the_world(thing, scene, shown.manifest["origin"])
        if modifier is None:
            modifier = insert_modifier(bpy.context, thing, LIVE, "MESH_CACHE")
        modifier.cache_format, modifier.deform_mode, modifier.interpolation = "PC2", "OVERWRITE", "LINEAR"
        modifier.time_mode, modifier.play_mode, modifier.frame_start, modifier.frame_scale = "FRAME", "SCENE", recording.first, 1.0
        # Y up to Z up: the modifier turns by the inverse of the axes that it is given.
        modifier.forward_axis, modifier.up_axis = "POS_Z", "NEG_Y"
        modifier.filepath = path
        evaluate_anew(thing)
        self.changed = True

    def seen(self, scene, shown, loads, changed, last):
        """Frames from `changed` on are new; those up to `last` were shown before."""
        self.changed = True
        if scene.frame_current >= min(changed, shown.last if last is None else last):
            for thing, _, _ in loads:
                thing.update_tag(refresh={"DATA"})

    def jump(self, scene, shown):
        """Moves the playhead to the newest frame, where that is wished: once for each, so that the artist may go elsewhere."""
        screen = getattr(bpy.context, "screen", None)
        playing = screen is not None and screen.is_animation_playing
        if not scene.drapery.live_newest or scene != bpy.context.scene or playing or shown.jumped == shown.last:
            return
        shown.jumped = shown.last
        if scene.frame_current != shown.last:
            scene.frame_set(shown.last)

    def take_off(self, scene):
        """Ends the Live View of a scene: garments are as they were before, and its files are gone."""
        self.shown.pop(scene.name, None)
        self.remove_from(scene)
        for kind in KINDS:
            folder = live_folder(scene, kind)
            if folder is None or not folder.is_dir():
                continue
            for path in folder.glob("*.pc2"):
                path.unlink(missing_ok=True)
            if not any(folder.iterdir()):
                folder.rmdir()
        self.changed = True

    def remove_from(self, scene, kept=()):
        """Takes the modifiers and constraints off all objects of a scene but those in `kept`."""
        for thing in scene.objects:
            modifier = thing.modifiers.get(LIVE)
            if modifier is None or thing.name in kept:
                continue
            thing.modifiers.remove(modifier)
            self.changed = True
            if thing.modifiers.get(CACHE) is None:
                for constraint in [found for found in thing.constraints if found.name in CONSTRAINTS]:
                    thing.constraints.remove(constraint)
            evaluate_anew(thing)


def read_manifest(shown):
    """Reads the manifest of the run anew where it has changed; whether any frame is done. Raises `CannotLoad` and `OSError`."""
    path = shown.folder and shown.folder / "manifest.json"
    if path is None or not path.is_file():
        shown.stamp = shown.manifest = None
        return False
    found = path.stat()
    if (found.st_mtime_ns, found.st_size) != shown.stamp:
        try:
            shown.manifest = json.loads(path.read_text("utf-8"))
            shown.manifest["garments"], shown.manifest["origin"], shown.manifest["attempts"], shown.manifest["fps"]
        except (ValueError, KeyError) as error:
            raise CannotLoad(f"{path} cannot be read: {error}") from error
        shown.stamp = found.st_mtime_ns, found.st_size
    return shown.manifest["last_complete_frame"] is not None
