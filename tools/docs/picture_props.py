"""Things that the pictures of the how-to pages add to a scene, so that nothing hangs in the air, and the colours of painted maps."""

import math

import bpy
import numpy as np

import studio

FIRST = 1001  # of the shots of the mannequin


def bar(begin, end, radius, look="steel"):
    """A round bar between two places, in Blender's axes."""
    begin, end = np.asarray(begin, float), np.asarray(end, float)
    way = end - begin
    bpy.ops.mesh.primitive_cylinder_add(vertices=64, radius=radius, depth=np.linalg.norm(way), location=0.5 * (begin + end))
    thing = bpy.context.object
    thing.rotation_euler = (math.atan2(math.hypot(way[0], way[1]), way[2]), 0.0, math.atan2(way[0], -way[1]))
    return finished(thing, look)


def ball(place, radius, look):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=48, radius=radius, location=place)
    return finished(bpy.context.object, look)


def finished(thing, look):
    bevel = thing.modifiers.new("bevel", "BEVEL")
    bevel.width, bevel.segments, bevel.limit_method = 0.004, 3, "ANGLE"
    studio.dress([thing], studio.material(look, 0.001), 0)
    thing.data.set_sharp_from_angle(angle=math.radians(40.0))
    return thing


def ball_on_a_stand(_, floor):
    """The ball of fabric.toml."""
    return [ball((0.0, 0.0, 0.6), 0.15, "plaster"), bar((0.0, 0.0, floor), (0.0, 0.0, 0.5), 0.014),
            bar((0.0, 0.0, floor), (0.0, 0.0, floor + 0.014), 0.11)]  # fmt: skip


def flag_pole(_, floor):
    return [bar((-0.612, 0.0, floor), (-0.612, 0.0, 0.52), 0.014), ball((-0.612, 0.0, 0.53), 0.026, "horn"),
            bar((-0.612, 0.0, floor), (-0.612, 0.0, floor + 0.03), 0.16)]  # fmt: skip


def curtain_rods(garments, _):
    """A rod over the curtains, and a ring at each corner that is held."""
    made = [bar((-0.80, 0.0, 0.925), (0.80, 0.0, 0.925), 0.011), ball((-0.81, 0.0, 0.925), 0.024, "horn"),
            ball((0.81, 0.0, 0.925), 0.024, "horn")]
    for (curtain,) in garments.values():
        points = studio.points_of(curtain)
        top = points[points[:, 2] > 0.5 * (points[:, 2].min() + points[:, 2].max())]
        for corner in (top[np.argmin(top[:, 0] - top[:, 2])], top[np.argmax(top[:, 0] + top[:, 2])]):
            bpy.ops.mesh.primitive_torus_add(location=(corner[0], 0.0, 0.918), rotation=(0.0, 0.5 * math.pi, 0.0), major_radius=0.023,
                                             minor_radius=0.0035, major_segments=48)
            made.append(finished(bpy.context.object, "horn"))
    return made


def swing_bar(_, floor):
    """Two stands with a bar, on which the sheet of motion_blur.toml swings."""
    made = [bar((-0.36, 0.3, 1.0), (0.36, 0.3, 1.0), 0.010)]
    for side in (-0.36, 0.36):
        made += [bar((side, 0.3, floor), (side, 0.3, 1.012), 0.012), bar((side, 0.3, floor), (side, 0.3, floor + 0.016), 0.09)]
    return made


def column(_, floor):
    return [bar((0.0, 0.0, floor), (0.0, 0.0, 1.10), 0.135, "plaster")]


def post(_, floor):
    return [bar((0.0, 0.0, floor), (0.0, 0.0, 1.0), 0.129, "plaster")]


def coat_hanger(garments, _):
    """A wooden neck that fills the collar, which moves it, and the cord on which the neck hangs."""
    points = studio.all_points([thing for garment in garments.values() for thing in garment])
    top = points[points[:, 2] > points[:, 2].max() - 0.004]
    neck, radius = top.mean(axis=0), np.linalg.norm((top - top.mean(axis=0))[:, :2], axis=1).min()
    return [bar(neck - (0.0, 0.0, 0.06), neck + (0.0, 0.0, 0.012), radius - 0.006, "wood"), ball(neck + (0.0, 0.0, 0.03), 0.022, "wood"),
            bar(neck, neck + (0.0, 0.0, 0.9), 0.003)]  # fmt: skip


def belt(garments, _):
    """A leather belt around the waistband of the skirt, as an artist renders it: from the upper rows of its faces, a little wider."""
    (skirt,) = garments["skirt"]
    scene = bpy.context.scene
    now = scene.frame_current
    scene.frame_set(FIRST)
    upper = studio.points_of(skirt)[:, 2] > 0.985
    scene.frame_set(now)
    faces = [face for face in studio.faces_of(skirt.data) if upper[list(face)].all()]
    mesh = bpy.data.meshes.new("belt")
    mesh.from_pydata(list(studio.points_of(skirt)), [], faces)
    thing = bpy.data.objects.new("belt", mesh)
    scene.collection.objects.link(thing)
    middle = np.mean([mesh.vertices[index].co for face in faces for index in face], axis=0)
    outwards = sum(np.dot(np.array(face.center) - middle, face.normal) for face in mesh.polygons) > 0.0
    studio.dress([thing], studio.material("leather_plain", 0.001), 1)
    away = thing.modifiers.new("away", "DISPLACE")
    away.mid_level, away.strength = 0.0, 0.012 if outwards else -0.012
    thick = thing.modifiers.new("thick", "SOLIDIFY")
    thick.thickness, thick.offset = 0.008, 0.0
    return [thing]


ADDED = {"ball_on_a_stand": ball_on_a_stand, "flag_pole": flag_pole, "curtain_rods": curtain_rods, "swing_bar": swing_bar, "column": column,
         "coat_hanger": coat_hanger, "belt": belt, "post": post}  # fmt: skip


def paint(garment, maps):
    """Gives a garment the colours of its maps: orange where bending is painted, violet where weight is painted too; cream elsewhere."""
    for thing in garment:
        count = len(thing.data.vertices)
        stiff, heavy = (np.loadtxt(maps / file) > 1.0 if maps else np.zeros(count, bool) for file in ("starch.txt", "hem.txt"))
        colours = np.full((count, 4), (0.80, 0.78, 0.72, 1.0), np.float32)
        colours[stiff] = (0.85, 0.25, 0.03, 1.0)
        colours[heavy] = (0.25, 0.05, 0.50, 1.0)
        made = studio.material("cotton", 0.001)
        shown = made.node_tree.nodes.new("ShaderNodeVertexColor")
        shown.layer_name = "maps"
        made.node_tree.links.new(shown.outputs[0], made.node_tree.nodes["Principled BSDF"].inputs["Base Color"])
        layer = thing.data.color_attributes.new("maps", "FLOAT_COLOR", "POINT")
        layer.data.foreach_set("color", colours.ravel())
        studio.dress([thing], made)
