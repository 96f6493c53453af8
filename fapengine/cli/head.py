"""``fapengine head``: bring your own head, and look at what each FAP does to it."""

from pathlib import Path

import typer

head = typer.Typer(help="Bring your own head: any mesh, moved by FAPs.", no_args_is_help=True)


@head.command("import")
def import_head(
    mesh: Path = typer.Argument(..., help="Neutral face: .obj, .ply, .glb, .gltf or .stl; any unit and axes."),
    points: Path = typer.Option(
        ..., "--points", help="Table of feature points: columns point, vertex, or point, x, y, z."
    ),
    output: Path = typer.Option(..., "--output", "-o", help="Head to write, a folder: heads/NAME."),
    licence: str = typer.Option("not stated", "--licence", help="Whose work it is; kept with the head."),
) -> None:
    """Make a head of a mesh and its feature points; say, animate and render take it with --head.

    Lips and lids must be slit, as in every face that can speak. At least 8.1 to 8.4 (lips), 2.1 (chin) and three more
    points are needed; every further point lets more FAPs move. Leave out translucent layers, such as tear films.

    Example: fapengine head import face.obj --points face.csv -o heads/mine && fapengine head check heads/mine
    """
    from fapengine.errors import DataError
    from fapengine.files.heads import load_face_file, load_feature_points, save_head
    from fapengine.mesh.adopted import adopt
    from fapengine.mesh.head import build_head

    vertices, triangles, albedo = load_face_file(mesh)
    marked = load_feature_points(points, vertices)
    try:
        adopted = adopt(vertices, triangles, marked, build_head(), albedo)
    except DataError as error:
        raise type(error)(error.message, where=f"{mesh} with {points}") from error
    save_head(output, adopted.mesh, source=mesh.name, licence=licence)
    for note in adopted.notes:
        typer.echo(f"note: {note}", err=True)
    typer.echo(
        f"{output}: {len(adopted.mesh.vertices_mm)} vertices, {len(marked)} feature points, {len(adopted.moved)} of 66"
        f" FAPs move it; one unit of the file is {adopted.scale:.4g} mm of the standard face"
    )
    if adopted.missing:
        typer.echo(f"without motion, because their points are not known: {_spell(adopted.missing)}")


def _spell(numbers: tuple[int, ...]) -> str:
    from fapengine.mpeg4 import fap

    return ", ".join(f"{number} {fap.spec(number).name}" for number in numbers)


@head.command()
def check(
    name: str = typer.Argument("default", help="Folder of a head, or default."),
    output: Path = typer.Option(Path("out/head.png"), "--output", "-o", help="Picture to write (.png)."),
) -> None:
    """Draw every FAP, viseme and expression on a head, and say which FAPs do nothing.

    Example: fapengine head check heads/mine -o out/mine.png
    """
    import numpy as np

    from fapengine.errors import UsageError
    from fapengine.files.heads import load_head
    from fapengine.files.pictures import contact_sheet, save_png
    from fapengine.files.profiles import load_profile
    from fapengine.mesh.deform import deform
    from fapengine.mpeg4 import fap
    from fapengine.mpeg4.codable import to_codable
    from fapengine.render.camera import preset
    from fapengine.render.renderer import FaceRenderer
    from fapengine.trajectory.faps import displacements_to_faps

    if output.suffix != ".png":
        raise UsageError(f"--output: got {output}, expected a name that ends with .png")
    mesh = load_head(name)
    rows, labels = [np.zeros(fap.FAP_COUNT)], [("rest", "")]
    still = []
    for row in fap.FAPS:
        if row.number < 3:
            continue
        frame = np.zeros(fap.FAP_COUNT)
        frame[fap.column(row.number)] = 25_000 if row.unit is fap.FapUnit.AU else 350
        if np.abs(deform(mesh, frame) - mesh.vertices_mm).max() < 0.05:
            still.append(row.number)
        rows.append(frame)
        labels.append((str(row.number), row.name))
    profile = load_profile("grid_s1_en")
    for spoken, phone in profile.phones.items():
        moved = profile.space.to_points_mm(phone.targets[:1])
        rows.append(displacements_to_faps(moved, profile.space.points, profile.fapu)[0])
        labels.append((spoken, "phone"))
    for expression, face in profile.expressions.items():
        moved = profile.space.to_points_mm(face.target[None])
        rows.append(displacements_to_faps(moved, profile.space.points, profile.fapu)[0] + face.fap)
        labels.append((expression.name.lower(), "expression"))
    with FaceRenderer(mesh, size=(384, 384), camera=preset("front")) as renderer:
        pictures = list(renderer.frames(to_codable(np.stack(rows))))
    save_png(output, contact_sheet(pictures, labels, title=f"{name}: FAPs at 350 FAPU (angles at 0.25 rad), phones"))
    typer.echo(f"{output}: {len(pictures)} pictures")
    if still:
        typer.echo(f"FAPs without motion: {_spell(tuple(still))}")
