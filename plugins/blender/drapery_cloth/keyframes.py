"""Keyframed settings of the add-on as numbers over time: keys where they suffice, otherwise a number for each frame."""

import math


class NotSampled(Exception):
    """A setting is animated in a way that is not sampled; the text says which."""


def curves_of(thing):
    """The curves of an object's or a scene's own action. Blender 5 has them in layers, for each slot of the action."""
    animation = thing.animation_data
    action = animation and animation.action
    if action is None:
        return []
    if hasattr(action, "fcurves"):
        return list(action.fcurves)
    strips = [strip for layer in action.layers for strip in layer.strips]
    return [curve for strip in strips for bag in strip.channelbags if bag.slot == animation.action_slot for curve in bag.fcurves]


def strip_paths(animation):
    """Paths that are animated by strips of the NLA."""
    for track in animation.nla_tracks:
        for strip in track.strips:
            action = strip.action
            if action is None or track.mute or strip.mute:
                continue
            bags = [action] if hasattr(action, "fcurves") else [bag for layer in action.layers for each in layer.strips
                                                                for bag in each.channelbags]
            yield from (curve.data_path for bag in bags for curve in bag.fcurves)


def is_straight(curve):
    """Whether a curve is straight between keys on whole frames, and constant before and after."""
    keys = curve.keyframe_points
    return not len(curve.modifiers) and curve.extrapolation == "CONSTANT" and all(
        key.interpolation == "LINEAR" and key.co[0] == math.floor(key.co[0]) for key in keys)


def over_time(group, name, first, last):
    """The value of a setting, or its keys [(frame, value), …] where it changes between two frames; lists of three as tuples.

    `group` is the group of properties that has it. Raises `NotSampled` for drivers and for strips of the NLA.
    """
    thing, value = group.id_data, getattr(group, name)
    is_list = hasattr(value, "__len__")
    plain = tuple(value) if is_list else value
    animation = thing.animation_data
    if animation is None:
        return plain
    path = group.path_from_id(name)
    if any(curve.data_path == path and not curve.mute for curve in animation.drivers):
        raise NotSampled("a driver")
    if animation.use_nla and path in set(strip_paths(animation)):
        raise NotSampled("a strip of the NLA")
    found = [curve for curve in curves_of(thing) if curve.data_path == path]
    curves = [curve for curve in found if not curve.mute and curve.is_valid and len(curve.keyframe_points)]
    if not curves:
        return plain
    frames = range(first, last + 1)
    if all(map(is_straight, curves)):
        keyed = {int(key.co[0]) for curve in curves for key in curve.keyframe_points}
        frames = sorted({first, last} | {frame for frame in keyed if first <= frame <= last})
    limits = group.bl_rna.properties[name]
    keys = []
    for frame in frames:
        values = list(plain) if is_list else [plain]
        for curve in curves:
            values[curve.array_index if is_list else 0] = min(max(curve.evaluate(frame), limits.hard_min), limits.hard_max)
        keys.append((frame, tuple(values) if is_list else values[0]))
    if all(value == keys[0][1] for _, value in keys):
        return keys[0][1]
    return keys
