"""A page with a slider for each component of a profile's space: the interface for designers that paper 001 proposes.

The page is one file without external references. It draws lips, chin and cheeks from the front and from the side as the
components move them; a button for each phone and expression of the profile sets the sliders.
"""

import json
from collections.abc import Mapping
from html import escape

import numpy as np
from numpy.typing import NDArray

from fapengine.files.report.parts import asset, page
from fapengine.profiles import Profile

OUTER = ("8.4", "8.6", "8.1", "8.5", "8.3", "8.7", "8.2", "8.8")
INNER = ("2.5", "2.7", "2.2", "2.6", "2.4", "2.8", "2.3", "2.9")
"""Points of the lips' contours, in order; those that a profile does not have are left out."""
REACH = 1.3
"""Range of a slider relative to the farthest phone or expression."""


def sliders_page(profile: Profile, names: list[str], rest_mm: Mapping[str, tuple[float, float, float]]) -> bytes:
    """Make the page.

    Parameters
    ----------
    profile : Profile
    names : list of str
        Description of what each component moves.
    rest_mm : mapping of str to (float, float, float)
        Positions of the space's points on a neutral face.

    Returns
    -------
    bytes
        HTML.
    """
    space = profile.space
    looks = {"rest": np.zeros(space.mode_count)}
    looks |= {phone: target.targets[0] for phone, target in profile.phones.items()}
    looks |= {each.name.lower(): target.target for each, target in profile.expressions.items()}
    reach = REACH * np.abs(np.stack(list(looks.values()))).max(axis=0)
    points = [name for name in space.points if name in rest_mm]
    columns = [space.points.index(name) for name in points]
    modes = space.to_points_mm(np.eye(space.mode_count))[:, columns]
    rest = [[round(float(mm), 2) for mm in rest_mm[name]] for name in points]
    data = {
        "points": points,
        "rest": rest,
        "modes": modes.round(4).tolist(),
        "outer": [points.index(name) for name in OUTER if name in points],
        "inner": [points.index(name) for name in INNER if name in points],
        "looks": {name: [round(float(weight), 3) for weight in weights] for name, weights in looks.items()},
    }
    rows = "".join(
        f'<div class="row"><label for="mode{n}">{n + 1}: {escape(name)}</label><input id="mode{n}" type="range"'
        f' min="{-most:.2f}" max="{most:.2f}" step="0.01" value="0"><output for="mode{n}"></output></div>'
        for n, (name, most) in enumerate(zip(names, reach, strict=True))
    )
    buttons = "".join(f'<button data-look="{escape(name)}">{escape(name)}</button>' for name in looks)
    encoded = json.dumps(data, ensure_ascii=False).replace("<", "\\u003c")
    parts = [
        f"<style>\n{asset('sliders.css')}</style>",
        f"<h1>Components of {escape(profile.id)}</h1>",
        f'<div class="mouths">{_view("front", _box(rest, (0, 1)), len(points))}',
        f"{_view('side', _box(rest, (2, 1)), len(points))}</div>",
        f"<p>{buttons}</p>{rows}",
        '<p><label for="weights">Weights, mm</label><textarea id="weights" readonly rows="2"></textarea></p>',
        f'<p class="note"><code>fapengine inspect {escape(profile.id)} --weights "..." --pose face.fap</code></p>',
        f'<script type="application/json" id="data">{encoded}</script>',
        f"<script>\n{asset('sliders.js')}</script>",
    ]
    return page(f"Components of {profile.id}", parts)


def _box(rest: list[list[float]], axes: tuple[int, int]) -> tuple[float, float, float]:
    """Left, top and side length of the visible square, mm."""
    places: NDArray[np.float64] = np.array(rest)[:, axes]
    across, up = places[:, 0] - (rest[0][2] if axes[0] == 2 else 0.0), -places[:, 1]
    side = float(max(np.ptp(across), np.ptp(up))) + 30.0
    return float(across.mean() - side / 2), float(up.mean() - side / 2), side


def _view(name: str, box: tuple[float, float, float], points: int) -> str:
    dots = '<circle r="0.8" fill="#a9adb4"/>' * points
    left, top, side = box
    return (
        f'<svg id="{name}" role="img" aria-label="Lips, {name} view"'
        f' viewBox="{left:.1f} {top:.1f} {side:.1f} {side:.1f}"><path class="outer" fill="#d98c7f" stroke="#a3584b"'
        f' stroke-width="0.6"/><path class="inner" fill="#4a2523"/>{dots}</svg>'
    )
