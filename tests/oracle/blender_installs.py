"""The life of the add-on in one session of Blender, with a saved file open: installed, broken halfway, updated, removed.

    python blender_installs.py -- FOLDER GOOD NEWER BROKEN DRAPERY           (Blender as a Python module)
    blender --background --python blender_installs.py -- FOLDER …            (Blender without a window)

FOLDER/open.blend is made, with a garment and a run in its scene folder. The zips are one add-on in three versions; BROKEN fails in
the middle of its registration. Writes FOLDER/answer.json. Blender before 4.2 installs the zip as an add-on of its scripts.
"""

import json
import sys
import traceback
from pathlib import Path

import bpy

# Blender's own, which is found once Blender is there.
import addon_utils  # isort: skip

FOLDER, GOOD, NEWER, BROKEN, DRAPERY = sys.argv[sys.argv.index("--") + 1 :]
FOLDER = Path(FOLDER)
EXTENSIONS = bpy.app.version >= (4, 2, 0)
MODULE = "bl_ext.user_default.drapery_cloth" if EXTENSIONS else "drapery_cloth"
answer = {"version": list(bpy.app.version)}


def install(archive):
    """Installs the zip as dropping it on the window does; returns the result."""
    try:
        if EXTENSIONS:
            return sorted(bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True))
        bpy.ops.preferences.addon_install(filepath=archive)
        return sorted(bpy.ops.preferences.addon_enable(module="drapery_cloth"))
    except RuntimeError as error:
        return ["ERROR", str(error)]


def remove():
    if EXTENSIONS:
        repositories = [repository.module for repository in bpy.context.preferences.extensions.repos]
        bpy.ops.extensions.package_uninstall(repo_index=repositories.index("user_default"), pkg_id="drapery_cloth")
    else:
        addon_utils.disable("drapery_cloth", default_set=True)
        path = Path(sys.modules["drapery_cloth"].__file__).parent
        for file in sorted(path.rglob("*"), reverse=True):
            file.rmdir() if file.is_dir() else file.unlink()
        path.rmdir()


def left(timers=()):
    """Names of all parts of the add-on that Blender holds."""
    return [
        *(f"type {name}" for name in dir(bpy.types) if "drapery" in name.lower()),
        *(f"property {kind}" for kind in ("Object", "Scene") if hasattr(getattr(bpy.types, kind), "drapery")),
        *(f"operator {name}" for group in ("object", "scene") for name in dir(getattr(bpy.ops, group)) if "drapery" in name),
        *(f"handler {name} {each}" for name in dir(bpy.app.handlers) for each in handlers(name) if "drapery" in each.__module__),
        *(f"timer {each}" for each in timers if bpy.app.timers.is_registered(each)),
        *(f"keymap item {item.idname}" for configuration in bpy.context.window_manager.keyconfigs for keymap in configuration.keymaps
          for item in keymap.keymap_items if "drapery" in item.idname),
    ]  # fmt: skip


def handlers(name):
    found = getattr(bpy.app.handlers, name)
    return found if isinstance(found, list) else []


def lives():
    """Whether all of the add-on works: it is enabled, finds the run of the open file, and has what the artist set."""
    work = sys.modules[f"{MODULE}.state"].work()
    scene, module = bpy.context.scene, sys.modules[MODULE]
    bpy.context.preferences.addons[MODULE].preferences.executable = DRAPERY
    timers = [bpy.app.timers.is_registered(work.timer)]
    for _ in range(1000):
        if not work.tick():
            break
        sys.modules[f"{MODULE}.work"].time.sleep(0.02)
    status = work.view(scene).status
    return {
        "enabled": addon_utils.check(MODULE) == (True, True), "timer": timers, "run": status and status.state,
        "role": bpy.data.objects["cloth"].drapery.role if bpy.data.filepath else None,
        "handlers": bpy.app.handlers.load_post.count(module.after_load),
        # The newer version says another word here, in a module that an update has to read anew.
        "word": sys.modules[f"{MODULE}.fabrics"].FABRICS[0].label,
    }  # fmt: skip


def timer():
    return sys.modules[f"{MODULE}.state"].work().timer


def garment():
    """A saved file with a garment, and a run that was done in its scene folder."""
    mesh = bpy.data.meshes.new("cloth")
    mesh.from_pydata([(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], [], [(0, 1, 2, 3)])
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("cloth", mesh))
    bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "open.blend"))


def session():
    garment()
    answer["first"] = install(GOOD)
    bpy.data.objects["cloth"].drapery.role = "GARMENT"
    bpy.ops.wm.save_mainfile()
    answer["lives"] = lives()
    timers = [timer()]
    answer["again"] = install(GOOD)
    answer["lives_again"] = lives()
    timers.append(timer())
    bpy.ops.preferences.addon_disable(module=MODULE)
    answer["disabled"] = left(timers)
    bpy.ops.preferences.addon_enable(module=MODULE)
    answer["lives_enabled"] = lives()
    timers.append(timer())
    answer["newer"] = install(NEWER)
    answer["lives_newer"] = lives()
    timers.append(timer())
    bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "open.blend"))
    answer["lives_opened"] = lives()
    # Scripts that take all handlers away.
    bpy.app.handlers.load_post.clear()
    answer["broken"] = install(BROKEN)
    answer["left_broken"] = left(timers)
    answer["mended"] = install(GOOD)
    answer["lives_mended"] = lives()
    timers.append(timer())
    remove()
    answer["left_removed"] = left(timers)
    answer["modules"] = [name for name in sys.modules if "drapery" in name] if EXTENSIONS else []
    answer["after_removal"] = install(NEWER)
    answer["lives_after_removal"] = lives()
    remove()


def main():
    try:
        session()
    except Exception:
        answer["failed"] = traceback.format_exc()
    (FOLDER / "answer.json").write_text(json.dumps(answer))


main()
