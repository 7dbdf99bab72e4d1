"""Renders frames of a dressed character with Blender and joins them into one picture.

    python tests/oracle/render_contact_sheet.py --body body.abc --garment skirt.abc --garment tshirt.abc \\
        --frames 1001,1020,1039 --out sheet.png

The files are loaded as an artist would load them, through Blender's own Alembic importer, so the picture shows what
any user of the caches gets. Frames are Blender's: the sample at time t seconds is frame t * fps. Renders on the
processor alone and needs no display. The camera looks from the front (the body faces +z of the file, as is usual in
Alembic), turned by a third of a right angle, and follows the body.
"""

import argparse
import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np
from PIL import Image, ImageDraw, ImageFont

WIDTH, HEIGHT = 480, 640
SAMPLES = 16  # with the denoiser after them; 6 frames take about half a minute on two cores
COLUMNS = 3
BODY_COLOUR = (0.36, 0.33, 0.31)
# Skirt, shirt and what else there may be; linear RGB.
GARMENT_COLOURS = [(0.03, 0.17, 0.25), (0.58, 0.12, 0.07), (0.55, 0.33, 0.05), (0.10, 0.20, 0.06), (0.22, 0.08, 0.24)]
SKY_TOP, SKY_BOTTOM = (206, 214, 222), (244, 243, 240)


def parse_arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--body", required=True, help="Alembic file of the body")
    parser.add_argument("--garment", action="append", default=[], help="Alembic file of a garment; may be repeated")
    parser.add_argument("--frames", required=True, help="frames to render, separated by commas")
    parser.add_argument("--fps", type=float, default=24.0, help="frames per second (24)")
    parser.add_argument("--out", required=True, help="the PNG to write")
    arguments = parser.parse_args()
    arguments.frames = [int(frame) for frame in arguments.frames.split(",")]
    for path in [arguments.body, *arguments.garment]:
        if not Path(path).is_file():
            parser.error(f"{path} does not exist")
    return arguments


def import_meshes(path):
    """Mesh objects of an Alembic file."""
    before = set(bpy.data.objects)
    bpy.ops.wm.alembic_import(filepath=str(Path(path).resolve()), as_background_job=False, set_frame_range=False)
    return [thing for thing in bpy.data.objects if thing not in before and thing.type == "MESH"]


def material(name, colour, roughness, sheen):
    made = bpy.data.materials.new(name)
    shader = made.node_tree.nodes["Principled BSDF"].inputs
    shader["Base Color"].default_value = (*colour, 1.0)
    shader["Roughness"].default_value = roughness
    shader["Sheen Weight"].default_value = sheen
    return made


def dress(meshes, made):
    for thing in meshes:
        thing.data.materials.clear()
        thing.data.materials.append(made)
        thing.data.polygons.foreach_set("use_smooth", [True] * len(thing.data.polygons))


def world_points(meshes):
    """World positions [m] of the meshes at the current frame, shape (points, 3)."""
    graph = bpy.context.evaluated_depsgraph_get()
    found = []
    for thing in meshes:
        evaluated = thing.evaluated_get(graph)
        points = np.empty(3 * len(evaluated.data.vertices), np.float32)
        evaluated.data.vertices.foreach_get("co", points)
        matrix = np.array(evaluated.matrix_world)
        found.append(points.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(found)


def look_at(thing, place, target):
    thing.location = place
    direction = np.asarray(target) - np.asarray(place)
    flat = math.hypot(direction[0], direction[1])
    thing.rotation_euler = (math.atan2(flat, -direction[2]), 0.0, math.atan2(-direction[0], direction[1]))


def add_sun(name, energy, angle, place, shadow):
    light = bpy.data.lights.new(name, "SUN")
    light.energy, light.angle, light.use_shadow = energy, angle, shadow
    thing = bpy.data.objects.new(name, light)
    bpy.context.scene.collection.objects.link(thing)
    look_at(thing, place, (0.0, 0.0, 0.0))


def set_up_scene(scene, floor):
    world = bpy.data.worlds.new("sky")
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.72, 0.80, 0.92, 1.0)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.42
    scene.world = world
    add_sun("key", 3.0, math.radians(6.0), (-2.5, -3.0, 5.0), True)
    add_sun("rim", 0.7, math.radians(20.0), (3.0, 3.5, 3.0), False)

    bpy.ops.mesh.primitive_plane_add(size=60.0, location=(0.0, 0.0, floor))
    bpy.context.object.is_shadow_catcher = True

    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = SAMPLES
    scene.cycles.use_denoising = True
    scene.cycles.max_bounces = 3
    scene.cycles.seed = 1
    scene.render.film_transparent = True
    scene.render.use_persistent_data = True
    scene.render.resolution_x, scene.render.resolution_y = WIDTH, HEIGHT
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.color_mode = "RGBA"
    scene.view_settings.view_transform = "Standard"

    camera = bpy.data.cameras.new("camera")
    camera.lens, camera.sensor_fit, camera.sensor_height = 70.0, "VERTICAL", 36.0
    scene.camera = bpy.data.objects.new("camera", camera)
    scene.collection.objects.link(scene.camera)


def frame_the_camera(scene, extents):
    """Distance of the camera and height of its target [m], the same for all frames so that sizes compare."""
    low = min(points[:, 2].min() for points in extents)
    high = max(points[:, 2].max() for points in extents)
    width = max(np.ptp(points[:, :2], axis=0).max() for points in extents)
    camera = scene.camera.data
    needed = max(high - low, width * HEIGHT / WIDTH) * 1.12
    return 0.5 * needed * camera.lens / (0.5 * camera.sensor_height), 0.5 * (low + high)


def compose(pictures, frames, path):
    columns = min(COLUMNS, len(pictures))
    rows = -(-len(pictures) // columns)
    gap = 8
    sheet = Image.new("RGB", (columns * (WIDTH + gap) + gap, rows * (HEIGHT + gap) + gap), (40, 42, 46))
    ramp = np.linspace(SKY_TOP, SKY_BOTTOM, HEIGHT).astype(np.uint8)
    backdrop = Image.fromarray(np.repeat(ramp[:, None, :], WIDTH, axis=1), "RGB").convert("RGBA")
    font = ImageFont.load_default(size=22)
    for index, (picture, frame) in enumerate(zip(pictures, frames)):
        panel = Image.alpha_composite(backdrop, Image.open(picture).convert("RGBA")).convert("RGB")
        ImageDraw.Draw(panel).text((14, HEIGHT - 38), str(frame), font=font, fill=(70, 74, 80))
        place = (gap + index % columns * (WIDTH + gap), gap + index // columns * (HEIGHT + gap))
        sheet.paste(panel, place)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    sheet.save(path)


def main():
    arguments = parse_arguments()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(arguments.fps)
    scene.render.fps_base = round(arguments.fps) / arguments.fps
    body = import_meshes(arguments.body)
    dress(body, material("body", BODY_COLOUR, 0.6, 0.0))
    meshes = list(body)
    for index, path in enumerate(arguments.garment):
        garment = import_meshes(path)
        colour = GARMENT_COLOURS[index % len(GARMENT_COLOURS)]
        dress(garment, material(Path(path).stem, colour, 0.85, 0.15))
        meshes += garment

    extents = []
    for frame in arguments.frames:
        scene.frame_set(frame)
        extents.append(world_points(meshes))
    set_up_scene(scene, min(points[:, 2].min() for points in extents))
    distance, height = frame_the_camera(scene, extents)

    with tempfile.TemporaryDirectory() as folder:
        pictures = []
        for frame, points in zip(arguments.frames, extents):
            scene.frame_set(frame)
            centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
            target = np.array([centre[0], centre[1], height])
            turn, tilt = math.radians(30.0), math.radians(6.0)
            away = np.array([math.sin(turn) * math.cos(tilt), -math.cos(turn) * math.cos(tilt), math.sin(tilt)])
            look_at(scene.camera, target + distance * away, target)
            pictures.append(f"{folder}/{frame}.png")
            scene.render.filepath = pictures[-1]
            bpy.ops.render.render(write_still=True)
        compose(pictures, arguments.frames, arguments.out)
    print(f"written: {arguments.out}")


if __name__ == "__main__":
    sys.exit(main())
