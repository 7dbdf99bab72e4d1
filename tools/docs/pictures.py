#!/usr/bin/env python3
"""Simulates the scenes of the how-to pages and renders the picture of each with Blender, into docs/pictures/howto; puts all of them
on one sheet, docs/pictures/howto.png.

Called by `make pictures`, which has built the commands. Arguments: names of pictures, or `sheet` for the sheet of those that are there;
all if there are none. Needs no display.
"""

import argparse
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "oracle")]

import bpy  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image, ImageDraw, ImageFont  # noqa: E402

import blender_session  # noqa: E402
import farm  # noqa: E402
import render_contact_sheet as sheet  # noqa: E402
from measure.runs import MPI  # noqa: E402

PICTURES = ROOT / "docs" / "pictures" / "howto"
HOWTO, SAMPLES = ROOT / "sample_assets" / "howto", ROOT / "sample_assets" / "scenes"
BODY = "body.abc"


def shot(scene, frames, *, body=None, settings=(), shapes=(), hide=(), turn=30.0, label=None, window=None, blur=False,
         processes=1, stop_at=None):
    """Description of a picture: a scene, the frames to show, the body's file or shapes to draw, and the direction of the view.

    `label` is a text for all panels or one for each frame. `window` is the height that is seen and the height of its middle [m],
    where shots are to compare. A run that is stopped once it has done the frame `stop_at` is resumed by the same command.
    """
    return {"scene": scene, "frames": frames, "body": body, "settings": settings, "shapes": shapes, "hide": hide,
            "turn": turn, "label": label, "window": window, "blur": blur, "processes": processes, "stop_at": stop_at}


BALL = ("sphere", 0.15, (0.0, 0.6, 0.0))  # of fabric.toml
COLUMN = ("capsule", 0.135, 0.6, (0.0, 0.5, 0.0))
# A picture has a row of panels, of one shot or of several.
SHOTS = {
    "cape": [shot(HOWTO / "cape.toml", [1001, 1013, 1025], body=BODY, turn=150.0)],
    "layers": [shot(SAMPLES / "dressed_mannequin.toml", [1001, 1013, 1025], body=BODY)],
    "trousers": [shot(HOWTO / "trousers.toml", [1001, 1013, 1025], body=BODY)],
    "flag": [shot(SAMPLES / "flag.toml", [0, 48, 96], turn=10.0)],
    "belt": [shot(HOWTO / "belt.toml", [1001, 1005, 1013], body=BODY, turn=120.0)],
    "fabric": [shot(HOWTO / "fabric.toml", [24], settings=(f"fabric={fabric}",), shapes=[BALL],
                    label=fabric, window=(0.85, 0.5))
               for fabric in ("silk_light", "denim_11oz", "leather_garment")],
    "painted_maps": [shot(HOWTO / "painted_maps.toml", [0, 24, 48], turn=20.0)],
    "seams": [shot(SAMPLES / "sewn_tube.toml", [-35, -12, 24], shapes=[COLUMN], settings=("output.preroll=true",))],
    "cushion": [shot(SAMPLES / "cushion.toml", [0, 8, 48])],
    "settle": [shot(HOWTO / "settle.toml", [1013, 1019, 1025], body=BODY)],
    "render_mesh": [shot(SAMPLES / "coat.toml", [1001, 1013, 1025], hide=("coat",))],
    "faster": [shot(HOWTO / "fabric.toml", [24], settings=(f"solver.preset={preset}",), shapes=[BALL],
                    label=preset, window=(0.85, 0.5))
               for preset in ("preview", "production", "hero")],
    "two_machines": [shot(SAMPLES / "flag.toml", [96], turn=10.0, label=f"processes: {processes}", processes=processes)
                     for processes in (1, 2)],
    "farm": [shot(SAMPLES / "flag.toml", [48, 96], turn=10.0, stop_at=48,
                  label={48: "48: SIGTERM, exit code 75", 96: "96: resumed, exit code 0"}),
             shot(SAMPLES / "flag.toml", [96], turn=10.0, label="96: never stopped")],
    "motion_blur": [shot(HOWTO / "motion_blur.toml", [8], turn=40.0, label="without"),
                    shot(HOWTO / "motion_blur.toml", [8], turn=40.0, label="with", blur=True)],
}


def simulate(name, number, options, wanted):
    """Runs the scene of a shot; returns the Alembic caches of what is rendered."""
    out = Path(options.work) / f"{name}_{number}"
    command = [options.drapery, "run", str(wanted["scene"]), "--out", str(out), "--resume", "auto"]
    settings = [*wanted["settings"]]
    if "$assets" in wanted["scene"].read_text():
        settings.append(f"assets={options.assets}")
    for setting in settings:
        command += ["--set", setting]
    # The first frame of the scene; pictures may show frames of the pre-roll before it.
    first = int(next(line for line in wanted["scene"].read_text().splitlines() if line.startswith("frames")).split('"')[1].split("-")[0])
    command += ["--frames", f"{first}-{max(first, *wanted['frames'])}"]
    if wanted["processes"] > 1:
        command = ["mpirun", "-n", str(wanted["processes"]), *command]
    if wanted["stop_at"] is not None and not out.is_dir():
        stop_at_frame(wanted["stop_at"], command, out)
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | MPI)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: {done.stderr}")
    return [cache for cache in sorted(out.glob("*.abc")) if cache.stem not in wanted["hide"]]


def stop_at_frame(frame, command, out):
    """Begins the run of a command, and stops it as a scheduler does."""
    run = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    farm.reaches(out, run, frame)
    code, _ = farm.stop(run, signal.SIGTERM)
    if code != farm.STOPPED:
        sys.exit(f"{' '.join(command)}: stopped with exit code {code}, not {farm.STOPPED}")


def add_shape(kind, *numbers):
    """A body that is a shape of the scene, in Blender's axes."""
    if kind == "sphere":
        radius, (x, y, z) = numbers
        bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=radius, location=(x, -z, y))
    else:
        radius, half_length, (x, y, z) = numbers
        bpy.ops.mesh.primitive_cylinder_add(vertices=96, radius=radius, depth=2 * half_length, location=(x, -z, y))
    return bpy.context.object


def render(wanted, caches, options, folder, tag):
    """The panels of a shot."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 24
    solid = sheet.material("body", sheet.BODY_COLOUR, 0.6, 0.0)
    meshes = []
    if wanted["body"]:
        meshes += sheet.import_meshes(Path(options.assets) / wanted["body"])
    meshes += [add_shape(*shape) for shape in wanted["shapes"]]
    sheet.dress(meshes, solid)
    for index, cache in enumerate(caches):
        garment = sheet.import_meshes(cache)
        colour = sheet.GARMENT_COLOURS[index % len(sheet.GARMENT_COLOURS)]
        sheet.dress(garment, sheet.material(cache.stem, colour, 0.85, 0.15))
        meshes += garment
    extents = []
    for frame in wanted["frames"]:
        scene.frame_set(frame)
        extents.append(sheet.world_points(meshes))
    sheet.set_up_scene(scene, min(points[:, 2].min() for points in extents))
    scene.render.use_motion_blur = wanted["blur"]
    distance, height = sheet.frame_the_camera(scene, extents)
    if wanted["window"]:
        seen, height = wanted["window"]
        distance = seen * scene.camera.data.lens / scene.camera.data.sensor_height
    panels = []
    for frame, points in zip(wanted["frames"], extents):
        scene.frame_set(frame)
        centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
        turn, tilt = math.radians(wanted["turn"]), math.radians(8.0)
        away = np.array([math.sin(turn) * math.cos(tilt), -math.cos(turn) * math.cos(tilt), math.sin(tilt)])
        target = np.array([centre[0], centre[1], height])
        sheet.look_at(scene.camera, target + distance * away, target)
        label = wanted["label"] or frame
        panels.append((f"{folder}/{tag}_{frame}.png", label[frame] if isinstance(label, dict) else label))
        scene.render.filepath = panels[-1][0]
        bpy.ops.render.render(write_still=True)
    return panels


def plot_of_the_python_page(target):
    """The plot that the program of docs/howto/from_python.md saves, run with the wheel as its reader has it."""
    subprocess.run([ROOT / "packaging" / "install-wheel.sh"], check=True)
    python = ROOT / os.environ.get("CARGO_TARGET_DIR", "target") / "python" / "venv" / "bin" / "python"
    page = (ROOT / "docs" / "howto" / "from_python.md").read_text()
    (plot,) = re.findall(r'savefig\("(.*?)"', page)
    with tempfile.TemporaryDirectory() as work:
        program = Path(work) / "page.py"
        program.write_text("\n".join(re.findall(r"```python\n(.*?)```", page, re.DOTALL)))
        subprocess.run([python, program], check=True, cwd=work, env=os.environ | {"MPLBACKEND": "agg"}, stdout=subprocess.DEVNULL)
        shutil.copy(Path(work) / plot, target)


def panel_in_blender(target, drapery):
    """The panel of the add-on in Blender's window, once a run is done: its upper half beside its lower one."""
    with tempfile.TemporaryDirectory() as work:
        blender_session.session(Path(work), drapery)
        with Image.open(Path(work) / "done.png") as picture:
            upper, lower = (picture.convert("RGB").crop((520, top, 714, bottom)) for top, bottom in ((338, 820), (820, 1360)))
    both = Image.new("RGB", (2 * upper.width + 8, lower.height), (48, 48, 48))
    both.paste(upper, (0, 0))
    both.paste(lower, (upper.width + 8, 0))
    both.save(target)


# Pictures that are no renders of a shot: who makes them.
OTHERS = {
    "blender": lambda target, options: panel_in_blender(target, options.drapery),
    "from_python": lambda target, _: plot_of_the_python_page(target),
}
NAMES = [*SHOTS, *OTHERS]


def put_on_one_sheet():
    """All pictures, half as large, each under its name."""
    columns, width, height, head, gap = 3, 480, 211, 26, 8
    rows = -(-len(NAMES) // columns)
    whole = Image.new("RGB", (columns * (width + gap) + gap, rows * (height + head + gap) + gap), (40, 42, 46))
    font = ImageFont.load_default(size=18)
    for index, name in enumerate(NAMES):
        left, top = gap + index % columns * (width + gap), gap + index // columns * (height + head + gap)
        ImageDraw.Draw(whole).text((left + 2, top), name.replace("_", " "), font=font, fill=(230, 230, 230))
        with Image.open(PICTURES / f"{name}.png") as picture:
            small = picture.convert("RGB")
            small.thumbnail((width, height), Image.Resampling.LANCZOS)
        whole.paste(small, (left, top + head))
    target = PICTURES.with_suffix(".png")
    whole.quantize(256, Image.Quantize.MAXCOVERAGE).save(target, optimize=True)
    print(f"written: {target.relative_to(ROOT)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(NAMES)}, sheet")
    build = ROOT / "target" / "release"
    parser.add_argument("--drapery", default=os.environ.get("DRAPERY", str(build / "drapery")))
    parser.add_argument("--assets-program", default=os.environ.get("DRAPERY_ASSETS", str(build / "drapery-assets")))
    parser.add_argument("--work", default=str(ROOT / "target" / "pictures"), help="folder of the runs, which go on where they were")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in [*NAMES, "sheet"]]
    if unknown:
        parser.error(f"there is no picture {unknown[0]}")
    names = options.names or NAMES
    render_shots(options, [name for name in names if name in SHOTS])
    for name in names:
        if name in OTHERS:
            OTHERS[name](PICTURES / f"{name}.png", options)
            with_few_colours(PICTURES / f"{name}.png")
    put_on_one_sheet()


def with_few_colours(picture):
    """Makes the file of a picture small."""
    with Image.open(picture) as image:
        small = image.convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE)
    small.save(picture, optimize=True)
    print(f"written: {picture.relative_to(ROOT)}", flush=True)


def render_shots(options, names):
    """Simulates and renders the shots with these names."""
    if not names:
        return
    options.work = os.path.abspath(options.work)
    options.assets = f"{options.work}/assets"
    if not Path(options.assets, "coat.abc").is_file():
        for made in (["mannequin", "--frames", "1001-1049"], ["coat"]):
            command = [options.assets_program, *made, "--out", options.assets]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    sheet.WIDTH, sheet.HEIGHT = 320, 420
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            panels = []
            for number, wanted in enumerate(SHOTS[name]):
                caches = simulate(name, number, options, wanted)
                panels += render(wanted, caches, options, folder, number)
            picture = PICTURES / f"{name}.png"
            sheet.compose([file for file, _ in panels], [frame for _, frame in panels], picture)
            with_few_colours(picture)


if __name__ == "__main__":
    main()
