"""Renders frames of a dressed character with Blender and joins them into one picture.

    python tests/oracle/render_contact_sheet.py --body body.abc --garment skirt.abc --garment tshirt.abc \\
        --frames 1001,1020,1039 --out sheet.jpg

The files are loaded as an artist would load them, through Blender's own Alembic importer, so the picture shows what
any user of the caches gets. Frames are Blender's: the sample at time t seconds is frame t * fps. Renders on the
processor alone and needs no display. The camera looks from the front (the body faces +z of the file, as is usual in
Alembic), turned by a third of a right angle, and follows the body. The demo's mannequin is shown without head and hands
(`studio.py`); any other body is shown whole.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import bpy

import studio

WIDTH, HEIGHT = 480, 640


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--body", required=True, help="Alembic file of the body")
    parser.add_argument("--garment", action="append", default=[], help="Alembic file of a garment; may be repeated")
    parser.add_argument("--frames", required=True, help="frames to render, separated by commas")
    parser.add_argument("--fps", type=float, default=24.0, help="frames per second (24)")
    parser.add_argument("--out", required=True, help="the picture to write, JPEG or PNG")
    arguments = parser.parse_args()
    arguments.frames = [int(frame) for frame in arguments.frames.split(",")]
    for path in [arguments.body, *arguments.garment]:
        if not Path(path).is_file():
            parser.error(f"{path} does not exist")
    return arguments


def main():
    arguments = parse_arguments()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(arguments.fps)
    scene.render.fps_base = round(arguments.fps) / arguments.fps
    body = studio.Dummy(arguments.body, arguments.frames[0])
    garments = [studio.import_meshes(path) for path in arguments.garment]
    worn = [thing for garment in garments for thing in garment]
    extents = []
    for frame in arguments.frames:
        scene.frame_set(frame)
        extents.append(studio.all_points([*body.pose(), *worn]))
    seen, height = studio.seen_height(extents, WIDTH, HEIGHT)
    for index, garment in enumerate(garments):
        studio.wear(garment, studio.GARMENTS[index % len(studio.GARMENTS)], studio.THREAD * seen)
    view = studio.Studio(WIDTH, HEIGHT)
    floor = min(points[:, 2].min() for points in extents)

    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for frame, points in zip(arguments.frames, extents):
            scene.frame_set(frame)
            body.pose()
            centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
            view.aim((centre[0], centre[1], height), seen, 30.0, 6.0, floor)
            pictures.append(f"{folder}/{frame}.png")
            view.photograph(pictures[-1])
        studio.compose(pictures, arguments.frames, arguments.out)
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    sys.exit(main())
