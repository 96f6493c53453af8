"""Profiles, heads, and avatars or scans that could become heads."""

import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._resources import profile_ids
from fapengine.app.inspection.report import FileKind, Report, Source, Table
from fapengine.errors import UsageError
from fapengine.files.gltf.document import Gltf, parse_gltf, stated_licences
from fapengine.files.heads.load import DEFAULT_HEAD, load_head, load_head_info
from fapengine.files.heads.meshes import RIG_ENDINGS, files_beside, load_neutral, load_rig
from fapengine.files.paths import locating
from fapengine.files.pictures import Picture, contact_sheet
from fapengine.files.profiles import load_profile
from fapengine.files.recordings import MESHES
from fapengine.mesh.default_head.style import parse_person
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh, can_follow_bones
from fapengine.models.viseme_space import name_components
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.mpeg4.track import FapTrack, to_codable
from fapengine.profiles import Profile
from fapengine.render.camera import Camera
from fapengine.retarget.blend import ARKIT_NAMES
from fapengine.retarget.rig_weights import OCULUS, OCULUS_PLAIN, bare, choose_blendshapes, plain
from fapengine.retarget.visemes import VRM0_NAMES, VRM1_NAMES
from fapengine.trajectory.closures import CONTACTS, settle
from fapengine.trajectory.faps import displacements_to_faps

PICTURE_PX = 384
LOWER_FACE = Camera(target_mm=(0.0, -44.0, 95.0), distance_mm=700.0, field_deg=8.5)
MAX_NAMES_SHOWN = 60
SHAPE_SETS: dict[str, Sequence[str]] = {
    "ARKit": ARKIT_NAMES, "Oculus": OCULUS, "VRM": VRM1_NAMES,
    "MPEG-4 visemes": tuple(f"viseme{row.number}" for row in VISEMES),
}  # fmt: skip
"""Shapes of each set that an avatar may have."""
RESTS = {"sil", "neutral", "viseme0"}
"""Shapes of these sets that move nothing."""
MAX_SET_NAMES = 14
CLIP_ENDING = ".vrma"
"""Ending of a motion for avatars, which has no mesh."""
AVATAR_ENDINGS = (*RIG_ENDINGS, CLIP_ENDING, *MESHES)


def _profile(source: Source) -> Report:
    profile = load_profile(str(source.path))
    facts = describe_profile(profile)
    sizes = ", ".join(f"{key.upper()} {length:.1f}" for key, length in facts["fapu_mm"].items())
    modes = [
        [
            str(mode["number"]), mode["moves"], f"{mode['likeness']:.2f}", " ".join(mode["most"]),
            f"{mode['phones_from']:+.1f} .. {mode['phones_to']:+.1f}",
        ]
        for mode in facts["modes"]
    ]  # fmt: skip
    phones = [
        [
            name, " ".join(f"{100 * fraction:.0f}%" for fraction in phone["keyframes"]), f"{phone['opening_mm']:+.1f}",
            f"{phone['width_mm']:+.1f}", phone["touches"], phone["origin"],
        ]
        for name, phone in facts["phones"].items()
    ]  # fmt: skip
    text: list[str | Table] = [
        f"{facts['id']}, {facts['language']}. Licence: {facts['licence']}",
        *(f"  {key}: {value}" for key, value in facts["origin"].items()),
        f"  face, mm: {sizes}",
        f"  markers: {' '.join(facts['markers'])}",
        Table(columns=("mode", "moves", "likeness", "most", "phones reach"), rows=modes),
        Table(columns=("phone", "keys", "opening mm", "width mm", "touches", "origin"), rows=phones),
        f"expressions: {', '.join(facts['expressions']) or 'none'}",
    ]
    return Report(
        facts=facts, text=text, plot=lambda: _faces(profile), sliders=lambda: _sliders(profile),
        pose=lambda text: _pose(profile, text),
    )  # fmt: skip


def describe_profile(profile: Profile) -> dict[str, Any]:
    """Make the values of a profile."""
    space = profile.space
    count = space.marker_count
    names = name_components(space.modes_mm[:, :count], space.points[:count])
    targets = np.concatenate([phone.targets for phone in profile.phones.values()])
    reach = (targets.min(axis=0).tolist(), targets.max(axis=0).tolist())
    return {
        "format": "profile",
        "id": profile.id,
        "language": profile.language,
        "licence": profile.licence,
        "origin": dict(profile.origin),
        "fapu_mm": {key: getattr(profile.fapu, f"{key}_mm") for key in ("irisd0", "es0", "ens0", "mns0", "mw0")},
        "markers": list(space.points[:count]),
        "points": list(space.points),
        "modes": [
            {
                "number": index + 1, "moves": mode.name, "likeness": round(mode.likeness, 2),
                "most": list(mode.busiest), "phones_from": round(low, 1), "phones_to": round(high, 1),
            }
            for index, (mode, low, high) in enumerate(zip(names, *reach, strict=True))
        ],
        "phones": {
            name: {
                "keyframes": list(phone.fractions), "touches": phone.contact, "origin": phone.origin,
                "opening_mm": _size(profile, phone.targets[0], "2.2", "2.3", 1),
                "width_mm": _size(profile, phone.targets[0], "8.3", "8.4", 0),
            }
            for name, phone in profile.phones.items()
        },
        "expressions": [expression.label for expression in profile.expressions],
    }  # fmt: skip


def _size(profile: Profile, target: NDArray[np.float64], first: str, second: str, axis: int) -> float:
    """Change of a distance between two points against rest, mm."""
    moved = dict(zip(profile.space.points, profile.space.to_points_mm(target), strict=True))
    return round(float(moved[first][axis] - moved[second][axis]), 2)


def _faces(profile: Profile) -> Picture:
    """Draw the mouth of each phone, with its contact, and of each expression."""
    weights = [np.zeros(profile.space.mode_count), *(phone.targets[0] for phone in profile.phones.values())]
    weights += [face.target for face in profile.expressions.values()]
    faps = faps_of_weights(profile, np.stack(weights))
    spoken, expressed = np.split(faps, [len(faps) - len(profile.expressions)])
    expressed += [face.fap for face in profile.expressions.values()]
    contacts = ["none", *(phone.contact for phone in profile.phones.values())]
    held = np.array([[float(contact == each) for contact in contacts] for each in CONTACTS])
    spoken = settle(spoken, held)
    openings = -spoken[:, [fap.column(4), fap.column(5)]].sum(axis=1) * profile.fapu.mns0_mm / 1024
    labels = [("rest", "")]
    for phone, mm in zip(profile.phones.values(), openings[1:], strict=True):
        labels.append((phone.ipa, {"lips": "lips touch", "teeth": "lip on teeth"}.get(phone.contact, f"{mm:+.1f} mm")))
    labels += [(expression.label, "") for expression in profile.expressions]
    title = f"{profile.id}: phones at their first keyframe, with the opening of the lips after contacts; expressions"
    return contact_sheet(draw_mouths(np.concatenate([spoken, expressed])), labels, title=title)


def faps_of_weights(profile: Profile, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 68) FAPU: FAPs of points of a profile's space, (N, K) mm."""
    space = profile.space
    return displacements_to_faps(space.to_points_mm(weights), space.points, profile.fapu)


def draw_mouths(faps: NDArray[np.float64]) -> list[Picture]:
    """Draw the lower half of the default face for FAPs, (N, 68) FAPU."""
    from fapengine.render.drawing import RenderOptions
    from fapengine.render.native import open_renderer

    drawing = RenderOptions(size=(PICTURE_PX, PICTURE_PX), camera=LOWER_FACE, rest=0.0)
    with open_renderer(load_head(DEFAULT_HEAD), drawing) as renderer:
        return list(renderer.frames(to_codable(faps)))


def _pose(profile: Profile, text: str) -> FapTrack:
    """One frame of the weights of a page of sliders."""
    count = profile.space.mode_count
    try:
        weights = np.array([float(word) for word in text.replace(",", " ").split()])
    except ValueError:
        weights = np.zeros(0)
    if len(weights) != count or not np.isfinite(weights).all():
        raise UsageError(f"--weights: must be {count} numbers, one for each component, got {text!r}")
    return FapTrack.from_values(to_codable(faps_of_weights(profile, weights[None])), rate_hz=25.0)


def _sliders(profile: Profile) -> bytes:
    from fapengine.files.report.sliders import sliders_page

    count = profile.space.marker_count
    names = name_components(profile.space.modes_mm[:, :count], profile.space.points[:count])
    face = load_head("default:level=coarse")
    rest_mm = {
        name: tuple(face.vertices_mm[face.feature_points[name]].tolist())
        for name in profile.space.points
        if name in face.feature_points
    }
    return sliders_page(profile, [each.name for each in names], rest_mm)


def _head(source: Source) -> Report:
    name = str(source.path)
    head, info = load_head(name), load_head_info(name)
    moving = sorted({channel.fap for channel in head.basis.channels})
    size = None if head.texture is None else [head.texture.shape[1], head.texture.shape[0]]
    facts = {
        "format": "head", "source": info.source, "licence": info.licence, "vertices": len(head.vertices_mm),
        "triangles": len(head.triangles), "feature_points": len(head.feature_points), "texture": size,
        "faps_by_surface": moving, "used": list(info.used), "lacking": list(info.lacking),
    }  # fmt: skip
    texture = "no texture" if size is None else f"a texture of {size[0]}x{size[1]}"
    text = [
        f"head: from {info.source or 'an unnamed source'}, licence {info.licence or 'not stated'}",
        f"{facts['vertices']} vertices, {facts['triangles']} triangles, {texture}",
        f"{facts['feature_points']} feature points, {len(moving)} FAPs move its surface",
    ]
    if info.used:
        text.append(f"blendshapes used: {', '.join(info.used)}")
    if info.lacking:
        text.append(f"blendshapes of ARKit that it lacks: {', '.join(info.lacking)}")
    return Report(facts=facts, text=text, plot=lambda: _points(head))


def _points(head: FaceMesh) -> Picture:
    from fapengine.app.inspection.feature_points import draw_feature_points

    return draw_feature_points(head)


def _avatar(source: Source) -> Report:
    facts = describe_avatar(source)
    text = [f"{facts['format']}: licence {facts['licence'] or 'not stated'}"]
    if "vertices" in facts:
        size, names = facts["texture"], facts["shapes"]
        texture = "no texture" if size is None else f"textures of {size[0]}x{size[1]} in all"
        text.append(f"{facts['vertices']} vertices, {facts['triangles']} triangles, {texture}")
        more = f", ... and {len(names) - MAX_NAMES_SHOWN} more" if len(names) > MAX_NAMES_SHOWN else ""
        text.append(f"{len(names)} shapes: {', '.join(names[:MAX_NAMES_SHOWN])}{more}" if names else "no shapes")
        text += [_spell_set(name, one) for name, one in facts["shape_sets"].items() if names]
        text.append(f"bones: {', '.join(facts['bones']) or 'none'}")
    text += [
        f"animation {clip['name']!r}: {clip['seconds']:.2f} s, {clip['channels']} channels" for clip in facts["clips"]
    ]
    plot = "--plot draws no mesh; fapengine head import, then head check, does"
    return Report(facts=facts, text=[*text, facts["next"]], plot=plot)


def describe_avatar(source: Source) -> dict[str, Any]:
    """Make the values of an avatar (.glb, .gltf, .vrm), a motion for one (.vrma) or a scan.

    Raises DataError if it is damaged, or requires an extension that is not understood (``where`` is file and place);
    ResourceError if a library that it needs is not installed.
    """
    path = source.path
    if source.ending not in (*RIG_ENDINGS, CLIP_ENDING):
        return _mesh(load_neutral(path), path) | {"format": "mesh", "licence": "", "clips": []}
    with locating(path, ": "):
        gltf = parse_gltf(source.data, files_beside(path), every_extension=False)
    facts: dict[str, Any] = {
        "format": f"glTF {gltf.root.item('asset').string('version', '')}", "licence": stated_licences(gltf.root)[0],
        "clips": _clips(gltf), "next": f"move an avatar by it: any program that reads {CLIP_ENDING}",
    }  # fmt: skip
    return facts if source.ending == CLIP_ENDING else facts | _mesh(load_rig(path), path)


def _mesh(mesh: BlendshapeMesh, path: Path) -> dict[str, Any]:
    moving = [name for name, shape in mesh.blendshapes.items() if len(shape.vertices)]
    choice = choose_blendshapes(moving)
    if choice.blended or choice.own_faps:
        how, points = "make a head of it", ""
    elif can_follow_bones(mesh):
        how, points = f"bones alone move a head of it ({', '.join(mesh.bones)}), not its lips", ""
    else:
        how, points = "a head of it needs feature points", " --points FILE"
    size = None if mesh.texture is None else [mesh.texture.shape[1], mesh.texture.shape[0]]
    return {
        "vertices": len(mesh.vertices), "triangles": len(mesh.triangles), "texture": size,
        "shapes": list(mesh.blendshapes), "shape_sets": shape_sets(mesh.blendshapes, moving),
        "lacking": list(choice.missing), "bones": list(mesh.bones),
        "notes": list(mesh.notes), "next": f"{how}: fapengine head import {path}{points} -o heads/{path.stem}",
    }  # fmt: skip


def shape_sets(names: Collection[str], moving: Collection[str]) -> dict[str, dict[str, Any]]:
    """Say how complete the sets of shapes of a file are.

    Parameters
    ----------
    names, moving : collection of str
        Names in the file, and of those the shapes that move a vertex.

    Returns
    -------
    dict
        By set: ``state`` ("complete", "partial", "empty" or "missing"), ``count``, and names that are ``empty`` or
        ``missing``.
    """
    present, full = _by_set(names), _by_set(moving)
    sets = {}
    for title, wanted in SHAPE_SETS.items():
        moves = full[title] | RESTS if full[title] - RESTS else set()
        missing = [name for name in wanted if name not in present[title]]
        empty = [name for name in wanted if name in present[title] and name not in moves]
        some = "partial" if moves else "empty" if empty else "missing"
        state = some if missing or empty else "complete"
        sets[title] = {"state": state, "count": len(wanted), "empty": empty, "missing": missing}
    return sets


def _by_set(names: Collection[str]) -> dict[str, set[str]]:
    """Meanings of names by set; a blink of ARKit is not one of VRM, nor a vowel of VRM one of Oculus."""
    arkit = {bare(name): name for name in ARKIT_NAMES}
    meant = {plain(old): new for old, new in zip(VRM0_NAMES, VRM1_NAMES, strict=True)}
    meant |= {plain(name): name for name in VRM1_NAMES}
    numbers = (re.fullmatch(r"viseme(\d+)", bare(name)) for name in names)
    vrm = {meant[plain(name)] for name in names if plain(name) in meant and bare(name) not in arkit}
    return {
        "ARKit": {arkit[bare(name)] for name in names if bare(name) in arkit},
        "Oculus": {OCULUS_PLAIN[plain(name)] for name in names if plain(name) in OCULUS_PLAIN},
        "VRM": vrm if vrm != {"blink"} else set(),  # Ready Player Me's eyesClosed, which TalkingHead needs
        "MPEG-4 visemes": {f"viseme{int(number[1])}" for number in numbers if number},
    }


def _spell_set(title: str, one: dict[str, Any]) -> str:
    if one["state"] in ("complete", "missing"):
        return f"{title}: {one['state']} ({one['count']} shapes)"
    moving = one["count"] - len(one["empty"]) - len(one["missing"])
    lacks = ""
    for kind in ("empty", "missing"):
        more = f" and {len(one[kind]) - MAX_SET_NAMES} more" if len(one[kind]) > MAX_SET_NAMES else ""
        lacks += f"; {kind}: {', '.join(one[kind][:MAX_SET_NAMES])}{more}" if one[kind] else ""
    return f"{title}: {one['state']}, {moving} of {one['count']} shapes move{lacks}"


def _clips(gltf: Gltf) -> list[dict[str, Any]]:
    clips = []
    for number, clip in enumerate(gltf.root.items("animations")):
        times = [gltf.row(sampler, "input", "accessors").numbers("max", [0.0])[0] for sampler in clip.items("samplers")]
        name = clip.string("name", f"animation {number}")
        clips.append({"name": name, "seconds": max(times, default=0.0), "channels": len(clip.items("channels"))})
    return clips


PROFILE = FileKind(
    name="a profile",
    fits=lambda source: (source.path / "profile.toml").is_file() or str(source.path) in profile_ids(),
    describe=_profile,
)
HEAD = FileKind(
    name="a head",
    fits=lambda source: (
        (source.path / "head.toml").is_file()
        or (not source.path.exists() and parse_person(str(source.path)) is not None)
    ),
    describe=_head,
)
AVATAR = FileKind(
    name="an avatar, a scan",
    endings=AVATAR_ENDINGS,
    fits=lambda source: source.ending in AVATAR_ENDINGS,
    describe=_avatar,
)
