"""The motion of a face in a glTF file or a VRM animation, as FAPs: weights of morph targets, expressions, the head.

The first animation that moves a morph target or an expression is read, from time 0, which is that of the sound. Names
decide which set of shapes they are (:mod:`fapengine.retarget.blend_tracks`): where a file has several, the one that
moves. Rotations are those of a face that looks along +z, in VRM 0.x along -z: of the head and, where no shape turns
the eyes, of their bones or a VRM animation's gaze.
"""

from collections.abc import Mapping

import numpy as np

from fapengine._arrays import Array
from fapengine.errors import DataError
from fapengine.files.gltf.clip import CUSTOM, EXTENSION, PRESETS
from fapengine.files.gltf.document import Gltf, Item, parse_gltf
from fapengine.files.gltf.scene import (
    find_bones,
    local_transform,
    named_targets,
    nearest_rotation,
    rotation_of,
    world_transforms,
)
from fapengine.geometry.rigid import rotations_from_quaternions, yaw_pitch_roll
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.retarget.blend_tracks import find_set, shape_set
from fapengine.retarget.rig_weights import plain

RATES_HZ = 24.0, 240.0
"""Lowest and highest rate of the frames that are read from curves."""
MAX_S = 7200.0
PARTS = {"LINEAR": 1, "STEP": 1, "CUBICSPLINE": 3}
"""Values of each key by its interpolation."""
Keys = tuple[Array, Array, str]
"""Times (K,) s, values (K, parts, N) and interpolation of a curve."""
EYES = fap.columns(23, 24, 25, 26)
"""Columns of the yaw of both eyes, then of their pitch."""
NO_FACE = "animation: contains none that moves morph targets or expressions"


def parse_animation(data: bytes) -> FapTrack:
    """Read the motion of a face from a GLB, a VRM or a VRM animation.

    Raises
    ------
    DataError
        If it is not glTF, names another file with its numbers, or contains no animation of a face, or shapes of no
        known set.
    """
    gltf = parse_gltf(data, _refuse, every_extension=False)
    vrma = gltf.root.item("extensions").item(EXTENSION)
    for animation in gltf.root.items("animations"):
        curves = _curves(gltf, animation)
        shapes = _shape_curves(gltf, vrma, curves)
        if shapes:
            break
    else:
        raise DataError(NO_FACE)
    head, eyes = _head(gltf, vrma), _eyes(gltf, vrma)
    turning = [curves[node, "rotation"] for node in (head, *eyes) if node is not None and (node, "rotation") in curves]
    end_s = max(float(times_s[-1]) for times_s, _, _ in (*(keys for keys, _, _ in shapes), *turning))
    rate_hz = _rate_of(np.concatenate([keys[0] for keys, _, _ in shapes]).round(4))
    times_s = np.arange(int(end_s * rate_hz + 0.5) + 1) / rate_hz
    weights: dict[str, Array] = {}
    for keys, column, name in shapes:
        found = np.clip(sample(keys, times_s)[:, column], 0.0, 1.0)
        weights[name] = np.maximum(weights.get(name, 0.0), found)
    faps = _expressions_to_faps(vrma, weights) if "expressions" in vrma else _shapes_to_faps(weights)
    if head is not None and (head, "rotation") in curves:
        turns = _turns(gltf, head, sample(curves[head, "rotation"], times_s))
        faps[:, fap.columns(49, 48, 50)] += turns / AU_RAD
    if not faps[:, EYES].any():  # else shapes turn the eyes, too
        for node, columns in eyes.items():
            if (node, "rotation") in curves:
                turns = _turns(gltf, node, sample(curves[node, "rotation"], times_s))
                faps[:, columns] = np.repeat(turns[:, :2], len(columns) // 2, axis=1) / AU_RAD
    return FapTrack.from_values(to_codable(faps), rate_hz=rate_hz)


def _refuse(name: str) -> bytes:
    raise DataError(f"{name!r:.60}: is another file, expected a GLB that contains everything")


def _curves(gltf: Gltf, animation: Item) -> dict[tuple[int, str], Keys]:
    """Curves by the node and the property that they animate."""
    samplers = animation.items("samplers")
    curves = {}
    for channel in animation.items("channels"):
        target, sampler = channel.item("target"), samplers[channel.index("sampler", len(samplers))]
        if "node" not in target or target.string("path") not in ("weights", "translation", "rotation"):
            continue
        times_s = gltf.numbers(sampler, "input", (None, 1))[:, 0]
        kind = sampler.string("interpolation", "LINEAR")
        values = gltf.numbers(sampler, "output").reshape(-1)
        if kind not in PARTS or not len(times_s) or len(values) % (len(times_s) * PARTS[kind]) or not len(values):
            raise DataError(f"sampler: got {len(values)} numbers for {len(times_s)} keys, {kind}", where=sampler.where)
        if times_s[0] < 0 or (np.diff(times_s) <= 0).any() or times_s[-1] > MAX_S:
            raise DataError(f"sampler: times must rise, from 0 s to at most {MAX_S:g} s", where=sampler.where)
        node = gltf.index(target, "node", "nodes")
        curves[node, target.string("path")] = times_s, values.reshape(len(times_s), PARTS[kind], -1), kind
    return curves


def _shape_curves(gltf: Gltf, vrma: Item, curves: Mapping[tuple[int, str], Keys]) -> list[tuple[Keys, int, str]]:
    """Curves of shapes: keys, column of their values, and name."""
    found = []
    for kind in (PRESETS, CUSTOM):
        group = vrma.item("expressions").item("preset" if kind == PRESETS else "custom")
        for name in group:
            keys = curves.get((gltf.index(group.item(name), "node", "nodes"), "translation"))
            found += [(keys, 0, name)] if keys else []
    for (node, path), keys in curves.items():
        if path == "weights":
            mesh = gltf.row(gltf.rows["nodes"][node], "mesh", "meshes")
            names = [
                name for primitive in mesh.items("primitives")[:1] for name, _ in named_targets(gltf, mesh, primitive)
            ]
            if len(names) != keys[1].shape[2]:
                raise DataError(
                    f"weights: got {keys[1].shape[2]}, expected {len(names)}, one per target", where=mesh.where
                )
            found += [(keys, column, name) for column, name in enumerate(names)]
    return found


def sample(keys: Keys, times_s: Array) -> Array:
    """(T, N): values of a curve at times (T,) s; before the first and after the last key these hold (glTF 2.0, C)."""
    key_s, values, kind = keys
    times_s = np.clip(times_s, key_s[0], key_s[-1])
    before = np.clip(np.searchsorted(key_s, times_s, side="right") - 1, 0, max(len(key_s) - 2, 0))
    after = np.minimum(before + 1, len(key_s) - 1)
    step_s = key_s[after] - key_s[before]
    share = ((times_s - key_s[before]) / np.where(step_s > 0, step_s, 1.0))[:, None]
    middle = PARTS[kind] // 2
    start, stop = values[before, middle], values[after, middle]
    if kind == "STEP":
        return np.asarray(np.where(share < 1, start, stop))
    if kind == "LINEAR":
        return np.asarray(start + share * (stop - start))
    leaving, arriving = (step_s[:, None] * slopes for slopes in (values[before, 2], values[after, 0]))
    bend = share * (1 - share)
    straight = start + share**2 * (3 - 2 * share) * (stop - start)
    return np.asarray(straight + bend * ((1 - share) * leaving - share * arriving))


def _rate_of(key_s: Array) -> float:
    """Rate of the frames that the keys were set on, as the nearest two keys tell."""
    times_s = np.unique(key_s)
    if len(times_s) < 2:
        return RATES_HZ[0]
    length_s = times_s[-1] - times_s[0]
    return float(np.clip(round(round(length_s / np.diff(times_s).min()) / length_s, 2), *RATES_HZ))


def _shapes_to_faps(weights: Mapping[str, Array]) -> Array:
    """(T, 68) FAPU of morph targets by name."""
    names = [plain(name) for name in weights]
    moving = [name if weight.any() else "" for name, weight in zip(names, weights.values(), strict=True)]
    try:
        shapes, columns = find_set(moving, where="morph targets")
    except DataError:  # few of them move: what they are, the others tell
        shapes, columns = find_set(names, where="morph targets")
    every = list(weights.values())
    table = np.zeros((len(every[0]), len(shapes.names)))
    for name, column in columns.items():
        table[:, shapes.names.index(name)] = every[column]
    return shapes.to_faps(table)


def _expressions_to_faps(vrma: Item, weights: Mapping[str, Array]) -> Array:
    """(T, 68) FAPU of VRM's presets, and of custom expressions that have ARKit's names."""
    total: Array = np.zeros(())
    for kind in (PRESETS, CUSTOM):
        shapes = shape_set(kind)
        known = {plain(name): column for column, name in enumerate(shapes.names)}
        table = np.zeros((len(next(iter(weights.values()))), len(shapes.names)))
        for name in vrma.item("expressions").item("preset" if kind == PRESETS else "custom"):
            if plain(name) in known and name in weights:
                table[:, known[plain(name)]] = weights[name]
        total = total + shapes.to_faps(table)
    return total


def _head(gltf: Gltf, vrma: Item) -> int | None:
    bones = vrma.item("humanoid").item("humanBones")
    if "head" in bones:
        return gltf.index(bones.item("head"), "node", "nodes")
    return find_bones(gltf, world_transforms(gltf)[0]).get("head")


def _eyes(gltf: Gltf, vrma: Item) -> dict[int, list[int]]:
    """Columns of yaw, then of pitch, by the node that turns them: one for both eyes, or a bone for each."""
    if "lookAt" in vrma:
        return {gltf.index(vrma.item("lookAt"), "node", "nodes"): EYES}
    bones = find_bones(gltf, world_transforms(gltf)[0])
    return {bones[name]: EYES[n::2] for n, name in enumerate(("left eye", "right eye")) if name in bones}


def _turns(gltf: Gltf, node: int, quaternions: Array) -> Array:
    """(T, 3) rad: yaw, pitch and roll, with the signs of FAPs, of local rotations (T, 4) of a node."""
    world, children = world_transforms(gltf)
    parent = next((above for above, below in enumerate(children) if node in below), None)
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    if quaternions.shape[1] != 4 or (lengths == 0).any():
        raise DataError("rotation: got a quaternion of length 0, or not of four numbers", where=f"nodes[{node}]")
    outer = nearest_rotation(world[parent][:3, :3]) if parent in world else np.eye(3)
    row = gltf.rows["nodes"][node]
    if "matrix" in row:
        rest = nearest_rotation(local_transform(row)[:3, :3])
    else:  # without its scale, which may mirror
        rest = rotation_of(np.array(row.numbers("rotation", [0.0, 0.0, 0.0, 1.0])))
    local = rotations_from_quaternions(np.roll(quaternions / lengths, 1, axis=1))
    facing = np.diag([-1.0, 1.0, -1.0]) if "VRM" in gltf.root.item("extensions") else np.eye(3)
    return yaw_pitch_roll(facing @ outer @ local @ rest.T @ outer.T @ facing)
