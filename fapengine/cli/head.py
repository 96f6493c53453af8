"""``fapengine head``: import, export and check heads."""

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from fapengine.cli._command import command
from fapengine.cli.options import AsJson, Strict, WithoutMark, WriteOptions

if TYPE_CHECKING:
    from fapengine.files.heads.folder import HeadInfo
    from fapengine.mesh.rig.import_head import ImportedHead

head = typer.Typer(name="head", add_completion=False, help="Import, export and check heads.", no_args_is_help=True)


@head.command("import")
@command
def import_head(
    mesh: Path = typer.Argument(
        ...,
        help="A face with blendshapes: .glb, .gltf, .vrm or an ICT-FaceKit folder. With --points, any neutral face:"
        " these, .obj, .ply or .stl, in any units and axes. Or a profile with a dense face.",
    ),
    points: Path | None = typer.Option(
        None,
        help="Feature points: a table with columns point, vertex, or point, x, y, z; or an Xface or Visage .fdp file.",
    ),
    mapping: Path | None = typer.Option(
        None, "--shape-map", help="TOML file that maps blendshape names to ARKit names, visemes or FAPs."
    ),
    adapt: bool = typer.Option(
        False,
        "--adapt",
        help="Fit the built-in head, with eyes, teeth and FAPs, to the mesh. For scans with a closed mouth.",
    ),
    complete: bool = typer.Option(
        False, "--complete", help="Make the ARKit shapes that the mesh lacks, from those of the built-in head."
    ),
    output: Path = typer.Option(..., "--output", "-o", help="Head folder to write: heads/NAME."),
    licence: str | None = typer.Option(
        None,
        help="Licence of the mesh, stored with the head and its exports. Default: what the file or the profile states,"
        " or 'not stated'.",
    ),
    strict: Strict = False,
    without: WithoutMark = [],  # noqa: B006
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Make a head from a mesh, for --head of say, animate, render and serve.

        fapengine head import avatar.glb -o heads/mine
        fapengine head check heads/mine    # shows the effect of each FAP
        fapengine head import profiles/s03 -o heads/s03
        fapengine head import scan.ply --points face.csv --adapt -o heads/mine

    Blendshapes (morph targets) with ARKit, Oculus or VRM names are recognized; map other names with --shape-map.
    Feature points are found from what the blendshapes move. --points corrects some of them, and is required without
    blendshapes: at least 8.1 to 8.4 (lips), 2.1 (chin) and three more. Lips and lids must be open cuts in the mesh.

    The last line says how far lips open on ɑ and whether lips and lids close; NAME.png beside the head shows it.
    --complete makes the ARKit shapes that are missing or empty from those of the built-in head.

    --adapt gives the built-in head the shape and colours of a scan: it is fitted to the feature points and to contours
    through them, then to the surface. The distances before and after are printed. The scan's mouth may be closed. A
    profile with a dense face counts as a scan.

    A dense face keeps its modes: recorded takes drive it (fapengine render TAKE --head heads/s03), and so do FAPs.
    """
    from dataclasses import asdict, replace

    from fapengine.app.head_check import draw_sheet, self_test
    from fapengine.cli._printing import print_remarks, print_result, spell_nearness
    from fapengine.errors import ResourceError, UsageError
    from fapengine.files.heads.dense import is_profile, load_dense_head
    from fapengine.files.heads.folder import OWNED, save_head
    from fapengine.files.heads.import_file import adapt_head_file, import_head_file
    from fapengine.files.outputs import files_in
    from fapengine.files.pictures import save_png
    from fapengine.speech.plausible import refuse

    sheet = output.parent / f"{output.resolve().name}.png"  # also beside "."
    writing.check([*files_in(output, OWNED), sheet], [mesh, points, mapping])
    rig = nearness = None
    if complete and (adapt or is_profile(mesh)):
        raise UsageError("--complete: cannot be used with --adapt or a profile")
    if adapt:
        imported, info, nearness = adapt_head_file(mesh, points, mapping)
    elif is_profile(mesh):
        if mapping is not None:
            raise UsageError("--shape-map: cannot be used with a profile")
        imported, rig, info = load_dense_head(mesh, points)
    else:
        imported, info = import_head_file(mesh, points, mapping, complete=complete)
    tested = self_test(imported.mesh)
    remarks = tested.remarks
    if strict:
        refuse(remarks, str(mesh))
    info = replace(info, licence=licence or info.licence or "not stated")
    save_head(output, imported.mesh, info, rig)
    drawn = None
    try:
        save_png(sheet, draw_sheet(imported.mesh))
        drawn = f"{sheet}: rest, phones, blink, joy and gaze"
    except ResourceError as error:  # a head needs no OpenGL until it is shown
        remarks = (*remarks, f"contact sheet: not drawn; {error}")
    shapes = f", {len(info.used)} shapes" if info.used else ""
    lines = [
        f"{output}: {len(imported.mesh.vertices_mm)} vertices,"
        f" {len(imported.mesh.feature_points)} feature points{shapes}, {len(imported.moved)} of 66 FAPs move it;"
        f" one unit of the file is {imported.scale:.4g} mm of the standard face"
    ]
    if rig is not None:
        lines.append(f"{len(rig.names)} modes, moved by {len(rig.driver.labels)} markers of a recording, or by FAPs")
    if nearness is not None:
        lines.append(spell_nearness(nearness))
    lines.append(f"licence: {info.licence}")
    lines += _missing_shapes(info)
    if imported.unused:
        lines.append(f"unused shapes: {', '.join(imported.unused)}")
    if imported.missing:
        lines.append(f"FAPs without motion: {_spell(imported.missing)}")
    for note in () if as_json else imported.notes:
        typer.echo(f"note: {note}", err=True)
    print_remarks(remarks)
    lines += [*filter(None, [drawn]), tested.summary]
    facts = _describe(imported, info, output) | {"remarks": list(remarks)}
    facts |= {"self_test": tested.facts, "contact_sheet": str(sheet) if drawn else None}
    facts |= {"nearness": asdict(nearness)} if nearness else {}
    print_result(facts, *lines, as_json=as_json)


def _describe(imported: "ImportedHead", info: "HeadInfo", output: Path) -> dict[str, object]:
    from dataclasses import asdict

    mesh = imported.mesh
    return {
        "head": str(output),
        "vertices": len(mesh.vertices_mm),
        "feature_points": dict(mesh.feature_points),
        "mm_per_unit": imported.scale,
        "fapu_mm": asdict(mesh.fapu),
        "texture": list(mesh.texture.shape[1::-1]) if mesh.texture is not None else None,
        "shapes": {"used": list(info.used), "unused": list(imported.unused), "lacking": list(info.lacking)},
        "faps": {"moving": list(imported.moved), "still": list(imported.missing)},
        "notes": list(imported.notes),
    }


def _missing_shapes(info: "HeadInfo") -> list[str]:
    return [f"missing ARKit shapes: {', '.join(info.lacking)}"] if info.used and info.lacking else []


def _spell(numbers: tuple[int, ...]) -> str:
    from fapengine.mpeg4 import fap

    return ", ".join(f"{number} {fap.spec(number).name}" for number in numbers)


@head.command()
@command
def export(
    name: str = typer.Argument("default", help="Head: default, woman, man, child, older, random:7, or a head folder."),
    output: Path = typer.Option(..., "--output", "-o", help="File to write (.glb, .vrm; .usda, .usdc)."),
    rig: str | None = typer.Option(
        None, help="Joints of a .glb: head (default), or mixamo: a body of joints, for TalkingHead. A .vrm has them."
    ),
    without: WithoutMark = [],  # noqa: B006
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Export a head as an avatar, with 52 ARKit shapes, 15 Oculus visemes, joints and textures.

        fapengine head export woman -o woman.glb
        fapengine head export woman --rig mixamo -o woman.glb
        fapengine head export woman -o woman.vrm
        fapengine head export woman -o woman.usdc

    The built-in heads are licensed under Apache-2.0, which the file states. An imported head keeps the licence given at
    import.
    """
    from fapengine.app.scene_files import export_head
    from fapengine.cli._printing import print_result
    from fapengine.files.heads.load import load_head_info

    writing.check([output], [name])
    info = load_head_info(name)
    export_head(name, output, rig)
    size = output.stat().st_size
    facts = {"output": str(output), "bytes": size, "licence": info.licence}
    print_result(facts, f"{output}: {size / 1e6:.1f} MB; licence: {info.licence}", as_json=as_json)


@head.command()
@command
def check(
    name: str = typer.Argument("default", help="Head folder, or default."),
    output: Path = typer.Option(Path("out/head.png"), "--output", "-o", help="Image to write (.png)."),
    without: WithoutMark = [],  # noqa: B006
    as_json: AsJson = False,
    writing: WriteOptions = WriteOptions(),
) -> None:
    """Render every FAP, phone and expression of a head, and list FAPs without effect and missing shapes.

    fapengine head check heads/mine -o out/mine.png
    """
    from fapengine.app.head_check import draw_check, self_test
    from fapengine.cli._printing import print_remarks, print_result
    from fapengine.files.heads.load import load_head, load_head_info
    from fapengine.mesh.deform import still_faps

    writing.check([output], [name])
    mesh, info = load_head(name), load_head_info(name)
    count, still = draw_check(mesh, output, title=name), still_faps(mesh)
    facts = {
        "head": name, "source": info.source, "licence": info.licence, "picture": str(output), "pictures": count,
        "still_faps": list(still), "shapes": list(info.used), "lacking_shapes": list(info.lacking),
        "remarks": list(self_test(mesh).remarks),
    }  # fmt: skip
    print_remarks(self_test(mesh).remarks)
    unmoved = [f"FAPs without motion: {_spell(still)}"] if still else []
    print_result(facts, f"{output}: {count} images", *unmoved, *_missing_shapes(info), as_json=as_json)
