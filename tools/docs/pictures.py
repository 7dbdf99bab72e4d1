#!/usr/bin/env python3
"""Simulates the scenes of the how-to pages and renders the picture of each with Blender, into docs/pictures/howto, and the demo's sheet,
docs/pictures/demo.jpg; puts all of them on one sheet, docs/pictures/howto.jpg.

Called by `make pictures`, which has built the commands. Arguments: names of pictures, or `sheet` for the sheet of those that are there;
all if there are none. Needs no display.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "oracle"), str(Path(__file__).parent)]

import bpy  # noqa: E402
from PIL import Image, ImageDraw, ImageFont  # noqa: E402

import picture_plots as plots  # noqa: E402
import picture_props as props  # noqa: E402
import studio  # noqa: E402
from howto import frames_of  # noqa: E402

PICTURES = ROOT / "docs" / "pictures" / "howto"
HOWTO, SAMPLES = ROOT / "sample_assets" / "howto", ROOT / "sample_assets" / "scenes"
BODY = "body.abc"


def shot(scene, frames, looks, *, body=None, settings=(), add=(), hide=(), turn=30.0, tilt=8.0, label=None, window=None, middle=None,
         floor=None, size=(480, 640), blur=False, maps=None, until=None, run=None):
    """Description of a picture: a scene, the frames to show, fabric by garment (and part), the body's file, the direction of the view.

    `window` is the height that is seen and the height of its middle [m], where shots are to compare or the view is close; `middle` is
    then the place (x, y of Blender) that is looked at, else the middle of what is seen. `label` is a text for all panels or one for each
    frame. `add` are things that the picture needs and the scene has not, by name in `picture_props.py`. `run` is the number of the shot
    of the same picture whose run it shows.
    """
    return {"scene": scene, "frames": frames, "looks": looks, "body": body, "settings": settings, "add": add, "hide": hide, "turn": turn,
            "tilt": tilt, "label": label, "window": window, "middle": middle, "floor": floor, "size": size, "blur": blur, "maps": maps,
            "until": until, "run": run}


MAPS = HOWTO / "painted_maps.toml"
DRESSED = {"skirt": "wool_teal", "tshirt": "jersey_coral"}
OVER_BALL = {"add": ["ball_on_a_stand"], "window": (0.80, 0.47), "middle": (0.0, 0.0), "floor": 0.06, "size": (480, 560), "turn": 25.0}
FLAG = {"turn": 10.0, "add": ["flag_pole"], "window": (1.9, -0.28), "middle": (0.0, 0.0), "floor": -1.1, "size": (480, 560), "tilt": 3.0}
CURTAINS = {"turn": 15.0, "add": ["curtain_rods"], "window": (1.68, 0.52), "middle": (0.0, 0.0), "floor": 0.0, "size": (480, 440)}
SWING = {"turn": 40.0, "add": ["swing_bar"], "window": (1.36, 0.86), "middle": (0.0, 0.05), "floor": 0.22, "size": (722, 640)}
COAT = {"hide": ("coat",), "add": ["coat_hanger"], "floor": 0.3, "turn": 72.0}
COAT_SCENE = SAMPLES / "coat.toml"
COAT_LOOKS = {"coat_render": {"shell": "wool_teal", "hems": "leather", "collar": "wool_grey", "collar_hems": "leather", "buttons": "horn"}}
# A picture has a row of panels, of one shot or of several.
SHOTS = {
    "cape": [shot(HOWTO / "cape.toml", [1007, 1013, 1019], {"cape": "wool_wine"}, body=BODY, turn=150.0)],
    "layers": [shot(SAMPLES / "dressed_mannequin.toml", [1001, 1013, 1025], DRESSED, body=BODY)],
    "trousers": [shot(HOWTO / "trousers.toml", [1001, 1013, 1025], {"trousers": "denim", "tshirt": "jersey_cream"}, body=BODY)],
    "flag": [shot(SAMPLES / "flag.toml", [0, 48, 96], {"flag": "lining"}, **FLAG)],
    "belt": [shot(HOWTO / "belt.toml", [1001, 1005, 1009], {"skirt": "wool_grey", "train": "silk"}, body=BODY, turn=125.0, tilt=14.0,
                  add=["belt"], window=(1.3, 0.84))],
    "fabric": [shot(HOWTO / "fabric.toml", [24], {"square": look}, settings=(f"fabric={fabric}",), label=fabric, **OVER_BALL)
               for fabric, look in (("silk_light", "silk"), ("denim_11oz", "denim"), ("leather_garment", "leather"))],
    "closures": [shot(HOWTO / "closures.toml", [0, 60, 96], {"left": "cotton_blue", "right": "wool_teal"}, turn=15.0, size=(480, 640))],
    "patch": [shot(HOWTO / "patch.toml", [24, 68, 76], {"banner": "cotton_blue", "patch": "wool_wine"}, turn=25.0, size=(480, 560))],
    "elastic": [shot(HOWTO / "elastic.toml", [0, 24, 60], {"skirt": "wool_wine"}, add=["post"], turn=20.0, tilt=14.0,
                     window=(0.95, 0.62), middle=(0.0, 0.0), floor=0.0, size=(480, 560))],
    "belt_body": [shot(HOWTO / "belt_body.toml", [1001, 1009, 1025], {"skirt": "wool_grey", "belt": "leather"}, body=BODY, turn=35.0,
                       tilt=12.0, window=(0.62, 0.98))],
    "over_time": [shot(HOWTO / "over_time.toml", [8, 28, 38], {"square": "cotton_blue"}, **{**OVER_BALL, "window": (1.15, 0.42)})],
    "painted_maps": [shot(MAPS, [0], {}, label="0: orange is stiff, violet is heavy, too", maps="starched", until=48, **CURTAINS),
                     shot(MAPS, [48], {}, label="48, with the maps", maps="starched", run=0, **CURTAINS),
                     shot(MAPS, [48], {"plain": "cotton_blue", "starched": "cotton_blue"}, label="48", run=0, **CURTAINS)],
    "seams": [shot(SAMPLES / "sewn_tube.toml", [-35, -12, 24], {"front": "cotton_blue", "back": "cotton"}, settings=("output.preroll=true",),
                   add=["column"], turn=62.0, window=(1.15, 0.42), floor=-0.1)],
    "cushion": [shot(SAMPLES / "pillow.toml", [0, 8, 48], {"front": "cotton_blue", "back": "cotton"}, window=(0.70, 0.20), tilt=14.0,
                     middle=(0.0, 0.0), floor=0.0, size=(480, 420))],
    "settle": [shot(HOWTO / "settle.toml", [1013, 1019, 1025], {"skirt": "wool_wine"}, body=BODY)],
    "render_mesh": [shot(COAT_SCENE, [1001], COAT_LOOKS, until=1025, window=(0.92, 1.16), middle=(0.0, 0.0), **COAT),
                    shot(COAT_SCENE, [1009], COAT_LOOKS, window=(0.34, 1.40), run=0, label="1009: collar and buttons", **COAT),
                    shot(COAT_SCENE, [1009], COAT_LOOKS, window=(0.34, 0.96), run=0, tilt=-14.0, label="1009: two layers, hem", **COAT)],
    "faster": [shot(HOWTO / "fabric.toml", [24], {"square": "silk"}, settings=(f"solver.preset={preset}",), label=preset, **OVER_BALL)
               for preset in ("preview", "production", "hero")],
    "motion_blur": [shot(HOWTO / "motion_blur.toml", [8], {"sheet": "lining"}, label="without", **SWING),
                    shot(HOWTO / "motion_blur.toml", [8], {"sheet": "lining"}, label="with", blur=True, run=0, **SWING)],
}


def simulate(name, number, options, wanted):
    """Runs the scene of a shot; returns the folder of the run."""
    out = Path(options.work) / f"{name}_{number if wanted['run'] is None else wanted['run']}"
    settings = [*wanted["settings"]]
    if "$assets" in wanted["scene"].read_text():
        settings.append(f"assets={options.assets}")
    if wanted["run"] is None:
        # Pictures may show frames of the pre-roll alone.
        last = max(frames_of(wanted["scene"])[0], *wanted["frames"], *([wanted["until"]] if wanted["until"] else []))
        plots.run(plots.command(options.drapery, wanted["scene"], out, last, settings))
    return out


def meshes_of(wanted, out, options):
    """The dummy, if the shot has a body, and the garments by name."""
    body = studio.Dummy(Path(options.assets) / wanted["body"], 1001) if wanted["body"] else None
    caches = [cache for cache in sorted(out.glob("*.abc")) if cache.stem not in wanted["hide"]]
    return body, {cache.stem: studio.import_meshes(cache) for cache in caches}


def render(wanted, out, options, folder, tag):
    """The panels of a shot."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = 24
    body, garments = meshes_of(wanted, out, options)
    worn = [thing for garment in garments.values() for thing in garment]
    width, height = wanted["size"]
    extents = []
    for frame in wanted["frames"]:
        scene.frame_set(frame)
        extents.append(studio.all_points([*(body.pose() if body else []), *worn]))
    seen, middle = wanted["window"] or studio.seen_height(extents, width, height)
    thread = studio.THREAD * seen * 640.0 / height
    for name, garment in garments.items():
        if wanted["maps"]:
            props.paint(garment, HOWTO if name == wanted["maps"] else None)
        else:
            studio.wear(garment, wanted["looks"][name], thread)
    view = studio.Studio(width, height)
    scene.render.use_motion_blur = wanted["blur"]
    floor = min(points[:, 2].min() for points in extents) if wanted["floor"] is None else wanted["floor"]
    panels = []
    for frame, points in zip(wanted["frames"], extents):
        scene.frame_set(frame)
        if body:
            body.pose()
        added = [thing for kind in wanted["add"] for thing in props.ADDED[kind](garments, floor)]
        centre = wanted["middle"] or 0.5 * (points.min(axis=0) + points.max(axis=0))
        view.aim((centre[0], centre[1], middle), seen, wanted["turn"], wanted["tilt"], floor)
        label = wanted["label"] or frame
        panels.append((f"{folder}/{tag}_{frame}.png", label[frame] if isinstance(label, dict) else label))
        view.photograph(panels[-1][0])
        for thing in added:
            bpy.data.objects.remove(thing)
    return panels


# Pictures that are no renders of a shot alone: the file's ending, and who makes them.
OTHERS = {
    "blender": plots.panel_in_blender,
    "from_python": plots.plot_of_the_python_page,
    "two_machines": plots.two_processes,
    "farm": plots.stopped_and_resumed,
    "view": plots.page_of_a_run,
    "wedge": plots.page_of_a_wedge,
}
NAMES = [*SHOTS, *OTHERS]


def file_of(name):
    return PICTURES / f"{name}.{'jpg' if name in SHOTS else 'png'}"


def put_on_one_sheet():
    """All pictures, a third as large, each under its name."""
    columns, width, height, head, gap = 3, 480, 216, 28, 8
    rows = -(-len(NAMES) // columns)
    whole = Image.new("RGB", (columns * (width + gap) + gap, rows * (height + head + gap) + gap), (255, 255, 255))
    font = ImageFont.load_default(size=18)
    for index, name in enumerate(NAMES):
        left, top = gap + index % columns * (width + gap), gap + index // columns * (height + head + gap)
        ImageDraw.Draw(whole).text((left + 2, top + 4), name.replace("_", " "), font=font, fill=(50, 52, 58))
        with Image.open(file_of(name)) as picture:
            small = picture.convert("RGB")
            small.thumbnail((width, height), Image.Resampling.LANCZOS)
        whole.paste(small, (left, top + head))
    target = PICTURES.with_suffix(".jpg")
    studio.save(whole, target)
    report(target)


def report(target):
    print(f"written: {target.relative_to(ROOT)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help=f"of {', '.join(NAMES)}, demo, sheet")
    build = ROOT / "target" / "release"
    parser.add_argument("--drapery", default=os.environ.get("DRAPERY", str(build / "drapery")))
    parser.add_argument("--assets-program", default=os.environ.get("DRAPERY_ASSETS", str(build / "drapery-assets")))
    parser.add_argument("--work", default=str(ROOT / "target" / "pictures"), help="folder of the runs, which go on where they were")
    options = parser.parse_args()
    unknown = [name for name in options.names if name not in [*NAMES, "demo", "sheet"]]
    if unknown:
        parser.error(f"there is no picture {unknown[0]}")
    options.work = Path(os.path.abspath(options.work))
    options.assets = options.work / "assets"
    PICTURES.mkdir(parents=True, exist_ok=True)
    for name in options.names or [*NAMES, "demo"]:
        if name in SHOTS:
            render_shots(options, name)
        elif name in OTHERS:
            make_assets(options)
            studio.save(OTHERS[name](options), file_of(name))
            report(file_of(name))
        elif name == "demo":
            render_the_demo(options)
    if all(file_of(name).is_file() for name in NAMES):
        put_on_one_sheet()


def render_the_demo(options):
    """The sheet of `make demo`."""
    programs = {"DRAPERY": os.path.abspath(options.drapery), "DRAPERY_ASSETS": os.path.abspath(options.assets_program)}
    subprocess.run([ROOT / "sample_assets" / "demo.sh", "light"], check=True, env=os.environ | programs, stdout=subprocess.DEVNULL)
    target = PICTURES.parent / "demo.jpg"
    shutil.copy(ROOT / "demo" / "out-light" / "contact_sheet.jpg", target)
    report(target)


def make_assets(options):
    """The mannequin, its garments and the coat, where they are not there yet."""
    if not Path(options.assets, "coat.abc").is_file():
        for made in (["mannequin"], ["coat"]):
            subprocess.run([options.assets_program, *made, "--out", options.assets], check=True, stdout=subprocess.DEVNULL)


def render_shots(options, name):
    """Simulates and renders the shots of a picture."""
    make_assets(options)
    with tempfile.TemporaryDirectory() as folder:
        panels, folders = [], []
        for number, wanted in enumerate(SHOTS[name]):
            folders.append(simulate(name, number, options, wanted))
            panels += render(wanted, folders[-1], options, folder, number)
        if name == "faster":
            texts = plots.cost_and_error(options, folders, [wanted["settings"] for wanted in SHOTS[name]])
            panels = [(file, f"{label}: {text}") for (file, label), text in zip(panels, texts)]
        studio.compose([file for file, _ in panels], [label for _, label in panels], file_of(name))
    report(file_of(name))


if __name__ == "__main__":
    main()
