"""``fapengine head``: bring your own head, and look at what each FAP does to it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from fapengine.mesh.face_mesh import FaceMesh

head = typer.Typer(help="Bring your own head: any mesh, moved by FAPs.", no_args_is_help=True)

ASKED_FAPU, ASKED_AU = 350, 25_000
"""How far `head check` moves each FAP."""
SEEN_MM = 0.05


@head.command("import")
def import_head(
    mesh: Path = typer.Argument(
        ...,
        help="A face with shapes: .glb, .gltf, .vrm or ICT-FaceKit's folder; or any neutral face with --points: these,"
        " .obj, .ply or .stl. Any unit and axes.",
    ),
    points: Path | None = typer.Option(
        None, "--points", help="Table of feature points: columns point, vertex, or point, x, y, z."
    ),
    mapping: Path | None = typer.Option(
        None, "--map", help="What shapes of other names mean (.toml): ARKit's names, visemes, or FAPs."
    ),
    output: Path = typer.Option(..., "--output", "-o", help="Head to write, a folder: heads/NAME."),
    licence: str = typer.Option("not stated", "--licence", help="Whose work it is; kept with the head."),
    as_json: bool = typer.Option(False, "--json", help="Say what was found as JSON."),
) -> None:
    """Make a head of a mesh; say, animate, render and serve take it with --head.

    Shapes (morph targets) named as ARKit, Oculus or VRM name them are found by name; other names are told with --map.
    Feature points are found by what the shapes move; --points corrects some, and gives all where there are no shapes:
    at least 8.1 to 8.4 (lips), 2.1 (chin) and three more. Lips and lids must be slit, as in every face that can speak.

    Example: fapengine head import avatar.glb -o heads/mine && fapengine head check heads/mine
    """
    import json
    from dataclasses import replace

    from fapengine.files.heads import adopt_file, save_head

    adopted, info = adopt_file(mesh, points, mapping)
    save_head(output, adopted.mesh, replace(info, licence=licence))
    if as_json:
        typer.echo(json.dumps(_found(adopted, info, output), indent=2))
        return
    for note in adopted.notes:
        typer.echo(f"note: {note}", err=True)
    shapes = f", {len(info.used)} shapes" if info.used else ""
    typer.echo(
        f"{output}: {len(adopted.mesh.vertices_mm)} vertices, {len(adopted.mesh.feature_points)} feature points"
        f"{shapes},"
        f" {len(adopted.moved)} of 66 FAPs move it; one unit of the file is {adopted.scale:.4g} mm of the standard face"
    )
    if info.lacking and info.used:
        typer.echo(f"shapes of ARKit that it lacks: {', '.join(info.lacking)}")
    if adopted.unused:
        typer.echo(f"shapes that nothing asks for: {', '.join(adopted.unused)}")
    if adopted.missing:
        typer.echo(f"FAPs without motion: {_spell(adopted.missing)}")


def _found(adopted: Any, info: Any, output: Path) -> dict[str, object]:
    from dataclasses import asdict

    mesh = adopted.mesh
    return {
        "head": str(output),
        "vertices": len(mesh.vertices_mm),
        "feature_points": dict(mesh.feature_points),
        "mm_per_unit": adopted.scale,
        "fapu_mm": asdict(mesh.fapu),
        "texture": list(mesh.texture.shape[1::-1]) if mesh.texture is not None else None,
        "shapes": {"used": list(info.used), "unused": list(adopted.unused), "lacking": list(info.lacking)},
        "faps": {"moving": list(adopted.moved), "still": list(adopted.missing)},
        "notes": list(adopted.notes),
    }


def _spell(numbers: tuple[int, ...]) -> str:
    from fapengine.mpeg4 import fap

    return ", ".join(f"{number} {fap.spec(number).name}" for number in numbers)


@head.command()
def check(
    name: str = typer.Argument("default", help="Folder of a head, or default."),
    output: Path = typer.Option(Path("out/head.png"), "--output", "-o", help="Picture to write (.png)."),
    as_json: bool = typer.Option(False, "--json", help="Say what is missing as JSON."),
) -> None:
    """Draw every FAP, phone and expression on a head, and say which FAPs do nothing and which shapes are missing.

    Example: fapengine head check heads/mine -o out/mine.png
    """
    import json

    from fapengine.errors import UsageError
    from fapengine.files.heads import load_head, load_head_info
    from fapengine.files.pictures import contact_sheet, save_png
    from fapengine.mpeg4.codable import to_codable
    from fapengine.render.camera import preset
    from fapengine.render.renderer import FaceRenderer

    if output.suffix != ".png":
        raise UsageError(f"--output: got {output}, expected a name that ends with .png")
    mesh, info = load_head(name), load_head_info(name)
    rows, labels = _poses()
    still = _still(mesh)
    with FaceRenderer(mesh, size=(384, 384), camera=preset("front")) as renderer:
        pictures = list(renderer.frames(to_codable(rows)))
    title = f"{name}: FAPs at {ASKED_FAPU} FAPU (angles at {ASKED_AU / 1e5:g} rad), phones"
    save_png(output, contact_sheet(pictures, labels, title=title))
    if as_json:
        found = {
            "head": name, "source": info.source, "licence": info.licence, "picture": str(output),
            "pictures": len(pictures), "still_faps": list(still), "shapes": list(info.used),
            "lacking_shapes": list(info.lacking),
        }  # fmt: skip
        typer.echo(json.dumps(found, indent=2))
        return
    typer.echo(f"{output}: {len(pictures)} pictures")
    if still:
        typer.echo(f"FAPs without motion: {_spell(still)}")
    if info.used and info.lacking:
        typer.echo(f"shapes of ARKit that its file lacks: {', '.join(info.lacking)}")


def _still(mesh: "FaceMesh") -> tuple[int, ...]:
    """FAPs that move no vertex."""
    import numpy as np

    from fapengine.mesh.deform import deform
    from fapengine.mpeg4 import fap

    return tuple(
        number
        for number in range(3, fap.FAP_COUNT + 1)
        if np.abs(deform(mesh, _alone(number)) - mesh.vertices_mm).max() < SEEN_MM
    )


def _alone(number: int) -> Any:
    """(68,): one FAP, as far as the sheet moves it."""
    import numpy as np

    from fapengine.mpeg4 import fap

    frame = np.zeros(fap.FAP_COUNT)
    frame[fap.column(number)] = ASKED_AU if fap.spec(number).unit is fap.FapUnit.AU else ASKED_FAPU
    return frame


def _poses() -> tuple[Any, list[tuple[str, str]]]:
    """Rest, each FAP, each phone and each expression: frames (N, 68) and what stands below them."""
    import numpy as np

    from fapengine.files.profiles import load_profile
    from fapengine.mpeg4 import fap
    from fapengine.mpeg4.visemes import VISEMES
    from fapengine.trajectory.faps import displacements_to_faps

    rows, labels = [np.zeros(fap.FAP_COUNT)], [("rest", "")]
    for number in range(3, fap.FAP_COUNT + 1):
        rows.append(_alone(number))
        labels.append((str(number), fap.spec(number).name))
    profile = load_profile("grid_s1_en")
    spelling = str.maketrans("rɒʊe", "ɹɔuɛ")  # as the profile spells the table's phonemes, or comes nearest
    numbered = {
        phoneme.rstrip("ː").translate(spelling): f"viseme {row.number}" for row in VISEMES for phoneme in row.phonemes
    }
    for spoken, phone in profile.phones.items():
        moved = profile.space.to_points_mm(phone.targets[:1])
        rows.append(displacements_to_faps(moved, profile.space.points, profile.fapu)[0])
        labels.append((spoken, numbered.get(spoken, "phone")))
    for expression, face in profile.expressions.items():
        moved = profile.space.to_points_mm(face.target[None])
        rows.append(displacements_to_faps(moved, profile.space.points, profile.fapu)[0] + face.fap)
        labels.append((expression.name.lower(), "expression"))
    return np.stack(rows), labels
