"""What ``fapengine inspect`` says about a profile: space, phones, expressions, and a face that shows each."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine.files.pictures import contact_sheet, save_png
from fapengine.files.profiles import load_profile
from fapengine.models.naming import name_components
from fapengine.mpeg4.codable import to_codable
from fapengine.profiles import Profile
from fapengine.trajectory.faps import displacements_to_faps

PICTURE_PX = 384


def inspect_profile(name: str, *, as_json: bool, plot: Path | None, sliders: Path | None = None) -> None:
    """Print the report of a profile; draw it, and write a page with a slider for each component.

    Raises
    ------
    ProfileError
        If its content is wrong.
    """
    profile = load_profile(name)
    report = describe(profile)
    if plot is not None:
        _draw(profile, plot)
    if sliders is not None:
        _write_sliders(profile, sliders)
    if as_json:
        import json

        import typer

        typer.echo(json.dumps(report, ensure_ascii=False))
    else:
        _print(report)


def _write_sliders(profile: Profile, path: Path) -> None:
    from fapengine.files.heads.load import load_head
    from fapengine.files.paths import write_bytes
    from fapengine.files.report.sliders import sliders_page

    count = profile.space.marker_count
    names = name_components(profile.space.modes_mm[:, :count], profile.space.points[:count])
    face = load_head("default:level=coarse")
    rest_mm = {
        name: tuple(face.vertices_mm[face.feature_points[name]].tolist())
        for name in profile.space.points
        if name in face.feature_points
    }
    write_bytes(path, sliders_page(profile, [each.name for each in names], rest_mm))


def describe(profile: Profile) -> dict[str, Any]:
    """Make the report as plain values."""
    space = profile.space
    count = space.marker_count
    names = name_components(space.modes_mm[:, :count], space.points[:count])
    reach = _reach(profile)
    return {
        "format": "profile",
        "id": profile.id,
        "language": profile.language,
        "licence": profile.licence,
        "origin": dict(profile.origin),
        "fapu_mm": {key: getattr(profile.fapu, f"{key}_mm") for key in ("irisd0", "es0", "ens0", "mns0", "mw0")},
        "markers": list(space.points[: space.marker_count]),
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
        "expressions": [expression.name.lower() for expression in profile.expressions],
    }  # fmt: skip


def _reach(profile: Profile) -> tuple[list[float], list[float]]:
    """Least and largest weight of each mode over the phones."""
    targets = np.concatenate([phone.targets for phone in profile.phones.values()])
    return targets.min(axis=0).tolist(), targets.max(axis=0).tolist()


def _size(profile: Profile, target: NDArray[np.float64], first: str, second: str, axis: int) -> float:
    """Change of a distance between two points against rest, mm."""
    moved = dict(zip(profile.space.points, profile.space.to_points_mm(target), strict=True))
    return round(float(moved[first][axis] - moved[second][axis]), 2)


def _print(report: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console()
    console.print(f"[bold]{report['id']}[/], {report['language']}. Licence: {report['licence']}", highlight=False)
    for key, text in report["origin"].items():
        console.print(f"  {key}: {text}", highlight=False, markup=False)
    sizes = ", ".join(f"{key.upper()} {length:.1f}" for key, length in report["fapu_mm"].items())
    console.print(f"  face, mm: {sizes}", highlight=False)
    console.print(f"  markers: {' '.join(report['markers'])}", highlight=False)
    table = Table("mode", "moves", "likeness", "most", "phones reach", box=None, pad_edge=False)
    for mode in report["modes"]:
        span = f"{mode['phones_from']:+.1f} .. {mode['phones_to']:+.1f}"
        table.add_row(str(mode["number"]), mode["moves"], f"{mode['likeness']:.2f}", " ".join(mode["most"]), span)
    console.print(table)
    table = Table("phone", "keys", "opening mm", "width mm", "touches", "origin", box=None, pad_edge=False)
    for name, phone in report["phones"].items():
        keys = " ".join(f"{100 * fraction:.0f}%" for fraction in phone["keyframes"])
        table.add_row(
            name, keys, f"{phone['opening_mm']:+.1f}", f"{phone['width_mm']:+.1f}", phone["touches"], phone["origin"]
        )
    console.print(table)
    console.print(f"expressions: {', '.join(report['expressions']) or 'none'}", highlight=False)


def _draw(profile: Profile, path: Path) -> None:
    """Draw a face for each phone and expression."""
    from fapengine.files.heads.load import DEFAULT_HEAD, load_head
    from fapengine.render.drawing import Drawing
    from fapengine.render.renderer import FaceRenderer

    openings = {name: _size(profile, phone.targets[0], "2.2", "2.3", 1) for name, phone in profile.phones.items()}
    labels = [("rest", ""), *((name, f"{opening:+.1f} mm") for name, opening in openings.items())]
    labels += [(expression.name.lower(), "") for expression in profile.expressions]
    weights = [np.zeros(profile.space.mode_count), *(phone.targets[0] for phone in profile.phones.values())]
    weights += [face.target for face in profile.expressions.values()]
    faps = displacements_to_faps(profile.space.to_points_mm(np.stack(weights)), profile.space.points, profile.fapu)
    for row, face in zip(
        range(len(faps) - len(profile.expressions), len(faps)), profile.expressions.values(), strict=True
    ):
        faps[row] += face.fap
    with FaceRenderer(load_head(DEFAULT_HEAD), Drawing(size=(PICTURE_PX, PICTURE_PX))) as renderer:
        pictures = list(renderer.frames(to_codable(faps)))
    save_png(
        path,
        contact_sheet(
            pictures,
            labels,
            title=f"{profile.id}: phones at their first keyframe, with the opening of the lips; expressions",
        ),
    )
