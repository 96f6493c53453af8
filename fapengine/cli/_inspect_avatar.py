"""Report of ``fapengine inspect`` on an avatar, a scan or a motion for one: text and JSON."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fapengine.errors import UnsupportedError

if TYPE_CHECKING:
    from fapengine.files.gltf.document import Gltf
    from fapengine.mesh.rig.blendshape_mesh import BlendshapeMesh

MOTION_ENDING = ".vrma"
SCENE_ENDINGS = (".glb", ".gltf", ".vrm", MOTION_ENDING)
MAX_NAMES_SHOWN = 60


def inspect_avatar(path: Path, *, as_json: bool, plot: Path | None) -> None:
    """Print what a mesh or scene holds, and what a head of it could do."""
    import typer

    if plot is not None:
        raise UnsupportedError(f"{path}: --plot draws no mesh; fapengine head import, then head check, does")
    report = describe_avatar(path)
    if as_json:
        typer.echo(json.dumps(report))
        return
    typer.echo(f"{report['format']}: licence {report['licence'] or 'not stated'}")
    if "vertices" in report:
        size = report["texture"]
        texture = "no texture" if size is None else f"textures of {size[0]}x{size[1]} in all"
        typer.echo(f"{report['vertices']} vertices, {report['triangles']} triangles, {texture}")
        names = report["shapes"]
        if names:
            more = f", ... and {len(names) - MAX_NAMES_SHOWN} more" if len(names) > MAX_NAMES_SHOWN else ""
            typer.echo(f"{len(names)} shapes: {', '.join(names[:MAX_NAMES_SHOWN])}{more}")
            typer.echo(f"of ARKit's 52 it lacks: {', '.join(report['lacking']) or 'none'}")
        else:
            typer.echo("no shapes")
        typer.echo(f"bones: {', '.join(report['bones']) or 'none'}")
    for clip in report["clips"]:
        typer.echo(f"animation {clip['name']!r}: {clip['seconds']:.2f} s, {clip['channels']} channels")
    typer.echo(report["next"])


def describe_avatar(path: Path) -> dict[str, Any]:
    """Make the report of an avatar (.glb, .gltf, .vrm), a motion for one (.vrma) or a scan as plain values.

    Raises
    ------
    UsageError
        If the file cannot be read.
    DataError
        If it is damaged, or requires an extension that is not understood; ``where`` is file and place.
    ResourceError
        If a library that it needs is not installed.
    """
    from fapengine.files.heads.meshes import load_neutral, load_rig

    if path.suffix.lower() not in SCENE_ENDINGS:
        return _describe_mesh(load_neutral(path), path) | {"format": "mesh", "licence": "", "clips": []}
    gltf = _read(path)
    report: dict[str, Any] = {
        "format": f"glTF {gltf.root.item('asset').string('version', '')}", "licence": _licence(gltf),
        "clips": _clips(gltf), "next": f"move an avatar by it: any program that reads {MOTION_ENDING}",
    }  # fmt: skip
    if path.suffix.lower() != MOTION_ENDING:
        report |= _describe_mesh(load_rig(path), path)
    return report


def _describe_mesh(mesh: "BlendshapeMesh", path: Path) -> dict[str, Any]:
    from fapengine.retarget.blendshape_names import choose_blendshapes

    choice = choose_blendshapes(mesh.blendshapes)
    if choice.blended or choice.own_faps:
        how, points = "make a head of it", ""
    elif mesh.bones:
        how, points = "a head of it nods, turns and moves its jaw", ""
    else:
        how, points = "a head of it needs feature points", " --points FILE"
    size = None if mesh.texture is None else [mesh.texture.shape[1], mesh.texture.shape[0]]
    return {
        "vertices": len(mesh.vertices), "triangles": len(mesh.triangles), "texture": size,
        "shapes": list(mesh.blendshapes), "lacking": list(choice.missing), "bones": list(mesh.bones),
        "notes": list(mesh.notes), "next": f"{how}: fapengine head import {path}{points} -o heads/{path.stem}",
    }  # fmt: skip


def _read(path: Path) -> "Gltf":
    from fapengine.errors import DataError
    from fapengine.files.gltf.document import parse_gltf
    from fapengine.files.heads.meshes import files_beside
    from fapengine.files.paths import read_bytes

    try:
        return parse_gltf(read_bytes(path), files_beside(path), every_extension=False)
    except DataError as error:
        raise type(error)(error.message, where=f"{path}: {error.where}" if error.where else str(path)) from error


def _licence(gltf: "Gltf") -> str:
    """Find what VRM 1.0, VRM 0.x or the asset itself says: the first of them that does."""
    extensions, asset = gltf.root.item("extensions"), gltf.root.item("asset")
    told = (
        extensions.item("VRMC_vrm").item("meta").string("licenseUrl", ""),
        extensions.item("VRM").item("meta").string("licenseName", ""),
        asset.string("copyright", ""),
    )
    return next((text for text in told if text), "")


def _clips(gltf: "Gltf") -> list[dict[str, Any]]:
    clips = []
    for number, clip in enumerate(gltf.root.items("animations")):
        times = [
            gltf.accessors[sampler.index("input", len(gltf.accessors))].numbers("max", [0.0])[0]
            for sampler in clip.items("samplers")
        ]
        name = clip.string("name", f"animation {number}")
        clips.append({"name": name, "seconds": max(times, default=0.0), "channels": len(clip.items("channels"))})
    return clips
