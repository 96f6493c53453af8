"""The deformation basis of the default head: how each FAP moves each vertex.

Theory of operation
-------------------
A FAP moves its feature point by one FAPU step in its direction; the skin around follows with a weight that is 1 at the
point and falls smoothly to 0. On the lips the weight is a product: *along* the contour a curve between neighbouring
feature points, never negative, so that lips that do not cross at the points cross nowhere; *across* it a step between
inner and outer contour, so that neither lip moves the other. Around the lips, on cheeks and chin, the skin follows the
feature points of the lower face like that of a real face (:mod:`.skin`); the value of those fields at another FAP's
point is subtracted, so that every point goes where its own FAP says. The jaw is a bone; its weight is 0 on the lips,
which are placed by their own FAPs (Table C.1: open_jaw does not move them), and elsewhere the fraction by which real
skin follows the jaw's rotation. Lids turn about the eye in piecewise-linear steps (the standard's FaceDefTables).
"""

from itertools import pairwise
from typing import Protocol

import numpy as np

from fapengine._arrays import Array, Indices
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import unit_vectors
from fapengine.mesh.default_head.eyes import Eye, lash_displacement, lid_displacement
from fapengine.mesh.default_head.folds import fold_shares
from fapengine.mesh.default_head.mouth import HALF_WAY
from fapengine.mesh.default_head.parts import CROWNS
from fapengine.mesh.default_head.points import HeadParts
from fapengine.mesh.default_head.skin import skin_fields
from fapengine.mesh.face_mesh import BasisCollector, Channel, DeformationBasis
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import AU_RAD, Fapu

UPPER_LID_KNOTS = (0.0, 280.0, 560.0, 820.0, 1080.0)
LOWER_LID_KNOTS = (0.0, 256.0, 512.0)
WIDE_KNOTS = (0.0, -600.0)
EASE, ROUND_TO_CORNER = 0.35, 0.3
"""Weight along the contour: fraction from middle to half way that is a cosine, the rest being a parabola; fraction from
there to the corner that is of fourth order, the rest being a line. So contours of recorded speech have no kink half
way.
"""
WIDE_FAPU, WIDE_MM = (-140.0, -380.0), 2.4
"""FAPU of a lower lip, lowered half way to a corner, over which it becomes rounder near the corner, and a measure of
how much: open vowels have round corners, a smile has pointed ones.
"""
WIDE_CORNER_MM = 1.2
"""How far that corner comes in meanwhile, so that the opening is rounder."""
ARCH_FAPU, ARCH_MM = (300.0, 440.0), 1.2
"""FAPU of the jaw over which the upper lip is arched between its middle and its corners, and how far: by the FAPs of
open vowels it runs straight from one to the other, like a tent.
"""
OUTER_WITH_INNER = 0.6
"""Fraction by which the outer contour beside a corner is lifted by the FAP of the inner corner instead of its own, so
that neither corner, lifted alone, is a hook; at the outer corner it is 0.
"""
SMILE_TEETH_FAPU, SMILE_FALL_MM = (100.0, 330.0), (2.4, 7.0, 8.0)
"""FAPU of both corners over which the upper teeth, the lower ones and the tongue come down, and how far: a smile shows
the upper teeth alone, with a dark gap between their edges and the lip, but films of speech show all.
"""
SMILE_CURVE = 0.0044
"""Rise of the upper teeth in a smile, 1/mm of their distance from the middle squared: they follow the lower lip."""
HIDDEN_TEETH_FAPU, HIDDEN_TEETH_MM = (390.0, 500.0), 1.6
"""FAPU of the jaw over which the upper teeth move up behind their lip, and how far: of their tips, which a wide open
mouth showed below it, one saw white dashes.
"""
THROAT_FAPU = (340.0, 560.0)
"""FAPU of the jaw over which the throat becomes dark: from the widest vowels on."""
BACK_BY_STRETCH = dict.fromkeys((6, 7, 53, 54), 0.5)
"""Millimetres that a corner of the lips moves back per millimetre outwards: lips slide around the teeth."""
ROLL_OUT = 0.28
"""Pushed lips roll out: their outer edge and the skin around it move this fraction less than the inner edge. If all
moved alike, u would look like a beak.
"""
PURSE_FAPU, PURSE_MM, PURSE_FORWARD_MM, PURSE_BACK_MM = (200.0, 550.0), 3.0, 4.8, 3.0
"""FAPU of a lower lip pushed forward over which lips purse, as in u: how far their corners come in; how far lips come
forward, the corners 1.5 times as far; and how far their middle stays back. So the outline is round and no beak, and
closed lips stay closed.
"""
PURSE_OUT = ((2.0, 1.6), (1.8, 3.0))
"""How much thicker the upper and the lower lip become between middle and corners, mm; and a power that says where: the
higher, the nearer to the corners.
"""
PURSED_BOW_MM = 2.3
"""How far the peaks of the upper lip's bow come down: pursed, they were the corners of a beak."""
PURSED_CHEEK_MM = np.array([46.0, 36.0])
"""How far beyond and above pursed corners the skin follows them: skin that stayed was a crease beside them."""
PURSED_LEVEL_MM = 3.0
"""How far the skin beside their corners comes forward; that above it moves back by half of that."""
PURSED_TEETH_MM = np.array([0.0, 4.5, -3.0])
"""How far the upper teeth move out of the opening of pursed lips, so that it is dark; the lower ones move down."""
PURSED_TONGUE_MM = np.array([0.0, -20.0, -4.0])
"""The same for the tongue, which FAP 46 of u lifts into it."""
JAW_FAP = 3
JAW_PIVOT = np.array([0.0, 2.0, 18.0])
"""Midpoint of the axis through the jaw joints, mm."""
LIFT_CHEEK, PUFF_CHEEKS = 41, (39, 40)
SMILE_FAPU, SMILE_CHEEK_MM = (140.0, 450.0), 3.5
"""FAPU of a lip corner over which a smile lifts its cheek, and how far."""
PUFF_MM, PUFF_FORWARD, PUFF_CORNER_MM = 40.0, 0.35, 36.0
"""A puffed cheek: its radius; its way forwards per millimetre outwards; and the distance from the corner of the lips
within which it is held, long, or the cheek would have a crease there.
"""
SWELLING_MM = 0.003
"""Swelling of a lower lid per FAPU of its rise."""
BROW_ABOVE_MM, BROW_TO_LID_MM, BROW_TO_NOSE_MM, SQUEEZE_ABOVE_MM = 36.0, 14.5, 14.0, 14.0
"""How far above a brow, which moves as one piece, the skin follows; how far below its middle; how much farther between
the brows, down the nose; and how far above it skin moves inwards.
"""
UPPER_LIP_FAPS, LOWER_LIP_FAPS = (17, 51, 55, 56), (16, 52, 57, 58)
PUSH_LOWER_LIP, RAISE_CORNERS = 16, (12, 13)
OWNERS = (18, 39, 40, 41, 42, 61, 62, 63)
"""FAPs with points on the skin that :mod:`.skin` moves."""
CORRECTION_MM = 16.0
"""Reach of the correction that keeps a feature point to its own FAP."""
PUSH_SIDE = 0.0, 0.8
"""Distances from the middle, relative to the corners of the lips, between which the motion of skin pushed forward with
a lip falls to 0. The corners stay, and skin that moved next to them made a fold like a moustache.
"""
BLADE_MM = 7.0
"""Length of the tongue that moves fully with its tip."""
OUT_FAPU, NARROW_TONGUE = 250.0, 0.016
"""FAPU from which a tongue that comes out, farther than in speech, becomes narrower, and fraction per millimetre."""
SLIT_MM = 6.0
"""Height of the transition from upper to lower lip in the skin beside the mouth line."""


def build_basis(
    points: Array,
    template: Array,
    places: Array,
    head: HeadParts,
    feature_points: dict[str, int],
    fapu: Fapu,
    age: float,
) -> tuple[Array, DeformationBasis, Array]:
    """Return the jaw weight of vertices not rigidly on a bone, (V,), the basis, and its entries' shades, (N,).

    ``template``, (V, 3) mm, are the vertices before the measured face displaced them; ``places``, (V, 2), are those of
    :mod:`.faces`. ``age`` is the style's.
    """
    collector = BasisCollector(len(points))
    of_skin = [
        head.grid,
        head.mouth.indices[head.mouth.level >= 1],
        *(eye.lids.indices for eye in head.eyes),
        *head.brows,
    ]
    skin = np.unique(np.concatenate([part.ravel() for part in of_skin]))

    def linear(number: int, vertices: Indices, weight: Array, forward: Array | float = 0.0) -> None:
        """One FAP, its weight scaled to be 1 at the feature point; ``forward`` mm per mm of its way, (N,)."""
        row = fap.spec(number)
        own = weight[np.flatnonzero(vertices == feature_points[row.point])[0]]
        step = fapu.unit(row.unit) * (np.array(fap.HEAD_AXES[row.positive]) - [0, 0, BACK_BY_STRETCH.get(number, 0.0)])
        moves = (weight / own)[:, None] * step
        moves[:, 2] += weight / own * forward * np.abs(step).max()
        collector.add(Channel(number, -np.inf, np.inf), vertices, moves)

    def around(numbers: tuple[int, ...], vertices: Indices, size_mm: tuple[float, float, float]) -> None:
        for number in numbers:
            centre = points[feature_points[fap.spec(number).point]]
            distance = np.linalg.norm((points[vertices] - centre) / size_mm, axis=1)
            linear(number, vertices, np.clip(1 - distance**2, 0, None) ** 2)

    _lips(head, linear, collector)
    around((18,), skin, (24, 17, 30))
    fields = _skin_fields(points, places, skin, head, feature_points)
    for number, moves in fields.items():
        if number != JAW_FAP:
            collector.add(Channel(number, -np.inf, np.inf), skin, moves * fapu.unit(fap.spec(number).unit))
    _purse_cheeks(points, skin, head, feature_points, collector)
    for side, corner in enumerate(RAISE_CORNERS):
        whole = SMILE_FAPU[1] - SMILE_FAPU[0]
        collector.add(Channel(corner, *SMILE_FAPU), skin, fields[LIFT_CHEEK + side] * SMILE_CHEEK_MM / whole)
    around((61, 62), skin, (13, 14, 20))
    around((63, 64), skin, (26, 30, 40))
    for side, ear in enumerate(head.ears):
        around((65 + side, 67 + side), ear.ravel(), (60, 60, 60))
    _brows(points, head, skin, feature_points, linear)
    for side, eye in enumerate(head.eyes):
        _lids(points, eye, side, feature_points, fapu, collector)
        below = eye.lids.indices[eye.lids.level > 1][:, ~eye.lids.upper]
        collector.add_shade(Channel(LIFT_CHEEK + side, -np.inf, np.inf), below.ravel())  # for .skin
    _tongue(points, head, feature_points, fapu, linear, collector)
    for number, teeth in teeth_by_light(points, head):  # it changes their light
        collector.add_shade(Channel(number, -np.inf, np.inf), teeth)
    for number in RAISE_CORNERS:
        start, stop = SMILE_TEETH_FAPU
        for part, way in zip((head.upper_teeth, head.lower_teeth[CROWNS], head.tongue), SMILE_FALL_MM, strict=True):
            row = part.ravel()
            curve = SMILE_CURVE * points[row, 0] ** 2 * (part is head.upper_teeth)
            fall = (curve - way)[:, None] * [0.0, 0.5 / (stop - start), 0.0]
            collector.add(Channel(number, start, stop), row, fall)
    row = head.upper_teeth.ravel()
    up = np.array([0.0, HIDDEN_TEETH_MM / np.ptp(HIDDEN_TEETH_FAPU), 0.0])
    collector.add(Channel(JAW_FAP, *HIDDEN_TEETH_FAPU), row, np.broadcast_to(up, (len(row), 3)))
    collector.add_shade(Channel(JAW_FAP, *THROAT_FAPU), throat(head))
    chin = points[feature_points[fap.spec(JAW_FAP).point]]
    jaw_weight = _jaw_weight(points, head, skin, fields[JAW_FAP], chin)
    # The jaw is a bone; where its weight varies over the skin, the skin also tilts.
    collector.add_shade(Channel(JAW_FAP, -np.inf, np.inf), np.flatnonzero((jaw_weight > 0) & (jaw_weight < 1)))
    for number, chosen, share in fold_shares(template[skin], fapu, age):
        collector.add_shade(Channel(number, -np.inf, np.inf), skin[chosen], share)
    return jaw_weight, *collector.gathered()


class Linear(Protocol):
    """The function of that name in :func:`build_basis`."""

    def __call__(self, number: int, vertices: Indices, weight: Array, forward: Array | float = 0.0, /) -> None:
        """Add one FAP."""


def _along(t: Array, at: float) -> Array:
    """Weight of a knot along the lip: 1 at ``at``, 0 at the other knots, never below 0; the weights sum to 1.

    The lip is round in its middle, and falls ever more steeply from there to its corner.
    """
    across, end = np.abs(t), np.sign(at) * t >= 0
    inside = np.clip(across / HALF_WAY, 0, 1)
    to_side = (1 - EASE) * inside**2 + EASE * (0.5 - 0.5 * np.cos(np.pi * inside))
    share = np.clip((across - HALF_WAY) / (1 - HALF_WAY), 0, 1)
    to_corner = share + ROUND_TO_CORNER * (share**4 - share)
    if at == 0:
        return 1 - to_side
    return np.where(end, to_corner if abs(at) == 1 else to_side - to_corner, 0.0)


def _lips(head: HeadParts, linear: Linear, collector: BasisCollector) -> None:
    mouth = head.mouth
    level = np.broadcast_to(mouth.level[:, None], mouth.indices.shape)
    t = np.broadcast_to(mouth.t, level.shape)
    upper = np.broadcast_to(mouth.upper, level.shape)
    corner = np.abs(t) == 1
    vertices, unique = np.unique(mouth.indices, return_index=True)
    inwards = 1 - smoothstep(-level / 0.75)
    across = smoothstep(level)
    inner = np.where(level < 0, inwards, 1 - across)
    ends = 1 - smoothstep(level - 1)
    outer = across * ends
    both = np.where(level < 0, inwards, ends)

    def add(number: int, weight: Array) -> None:
        linear(number, vertices, weight.ravel()[unique])

    on_upper, on_lower = upper & ~corner, ~upper
    knots = [(at, lip) for lip in (on_upper, on_lower) for at in (HALF_WAY, -HALF_WAY)]
    for ring, numbers in ((inner, (4, 5, 8, 9, 10, 11)), (outer, (51, 52, 55, 56, 57, 58))):
        for number, (at, lip) in zip(numbers, [(0.0, on_upper), (0.0, on_lower), *knots], strict=True):
            add(number, ring * _along(t, at) * lip)
    # Cheeks follow the corners, or their inside would cover the teeth of a wide mouth.
    cheeks = np.where(level < 0, 1 - smoothstep((-level - 0.35) / 0.65), inner)
    to_corner = np.clip((np.abs(t) - HALF_WAY) / (1 - HALF_WAY), 0, 1)
    round_off = smoothstep((level - 1) / 0.25)
    with_inner = OUTER_WITH_INNER * outer * (1 - to_corner**3)
    shared = dict.fromkeys((12, 13), with_inner) | dict.fromkeys((59, 60), -with_inner)
    for ring, corners in ((cheeks, (6, 7, 12, 13)), (outer, (53, 54, 59, 60))):
        for number, end in zip(corners, (1, -1, 1, -1), strict=True):
            # Stretching draws the whole lip along, most at its corner; lifting lifts the corner alone, and the skin
            # above and below it, which would have a crease.
            rounder = np.where(end * t > 0, smoothstep(to_corner) - _along(t, end), 0.0)
            shape = np.clip(end * t, 0, 1) ** 1.2 if number in (6, 7, 53, 54) else _along(t, end) + round_off * rounder
            add(number, (ring + shared.get(number, 0.0)) * shape)
    forward = (1 - t**2) * (1 - ROLL_OUT * smoothstep(level))
    add(17, both * forward * on_upper)
    add(16, both * forward * on_lower)
    rounder = (to_corner - to_corner**4) * both * on_lower * WIDE_MM / (WIDE_FAPU[1] - WIDE_FAPU[0])
    for number, end in ((10, 1), (11, -1)):
        come_in = -end * WIDE_CORNER_MM * smoothstep(to_corner) * both / (WIDE_FAPU[0] - WIDE_FAPU[1])
        moves = np.stack([come_in, rounder, 0.0 * t], axis=-1) * (end * t > 0)[..., None]
        collector.add(Channel(number, *WIDE_FAPU), vertices, moves.reshape(-1, 3)[unique])
    bent = np.abs(t) ** 1.6
    arch = (ARCH_MM / (ARCH_FAPU[1] - ARCH_FAPU[0]) * 4 * bent * (1 - bent) * both * on_upper)[..., None]
    collector.add(Channel(JAW_FAP, *ARCH_FAPU), vertices, (arch * [0.0, 1.0, 0.0]).reshape(-1, 3)[unique])
    pursed = _pursed(t) * both[..., None]
    above, below = (mm * 4 * np.abs(t) ** power * (1 - np.abs(t) ** power) for mm, power in PURSE_OUT)
    pursed[..., 1] = np.where(upper, above, -below) * outer
    beside = np.clip(np.abs(t) / HALF_WAY, 0, 1)
    pursed[..., 1] -= PURSED_BOW_MM * 16 * (beside * (1 - beside)) ** 2 * outer * upper
    whole = PURSE_FAPU[1] - PURSE_FAPU[0]
    collector.add(Channel(PUSH_LOWER_LIP, *PURSE_FAPU), vertices, pursed.reshape(-1, 3)[unique] / whole)
    for part, way in (
        (head.upper_teeth[CROWNS].ravel(), PURSED_TEETH_MM),
        (head.lower_teeth[CROWNS].ravel(), PURSED_TEETH_MM * [1, -1, 1]),
        (head.tongue, PURSED_TONGUE_MM),
    ):
        collector.add(Channel(PUSH_LOWER_LIP, *PURSE_FAPU), part, np.broadcast_to(way / whole, (len(part), 3)))


def _pursed(t: Array) -> Array:
    """(..., 3) mm: way of pursed lips, in and forwards."""
    return np.stack(
        [
            -PURSE_MM * t,
            np.zeros_like(t),
            PURSE_FORWARD_MM * t**2 * (2.4 - 0.9 * t**2) - PURSE_BACK_MM * (1 - t**2),
        ],
        axis=-1,
    )


def _purse_cheeks(
    points: Array, skin: Indices, head: HeadParts, feature_points: dict[str, int], collector: BasisCollector
) -> None:
    """Draw the skin around pursed lips along with them."""
    corner, at = points[feature_points["8.3"]], points[skin]
    share = _beyond_lips(head, len(points))[skin]
    across = at[:, 0] / corner[0]
    beyond = np.clip((np.abs(across) - 1) * corner[0], 0, None) / PURSED_CHEEK_MM[0]
    away = np.hypot(beyond, (at[:, 1] - corner[1]) / PURSED_CHEEK_MM[1])
    falling = np.clip(1 - away**2, 0, None) ** 2 * share * (at[:, 2] > 20)
    near = falling > 0
    moves = _pursed(np.clip(across, -1, 1)) * falling[:, None]
    # Skin pushed forward with the upper lip would overhang that beside the corners.
    above, outside = at[:, 1] - corner[1], (np.abs(at[:, 0]) - corner[0] - 3.0) / 8.0
    level_out = np.exp(-(((above - 1.5) / 4.0) ** 2)) - 0.5 * np.exp(-(((above - 7.0) / 4.5) ** 2))
    moves[:, 2] += PURSED_LEVEL_MM * level_out * np.exp(-(outside**2)) * np.minimum(4 * share, 1)
    moves = moves[near]
    collector.add(Channel(PUSH_LOWER_LIP, *PURSE_FAPU), skin[near], moves / (PURSE_FAPU[1] - PURSE_FAPU[0]))


def _beyond_lips(head: HeadParts, count: int) -> Array:
    """(count,): 0 on the lips, rising to 1 from their edge outwards."""
    share = np.ones(count)
    share[head.mouth.indices] = smoothstep(head.mouth.level - 1)[:, None]
    share[head.mouth.indices[0]] = 1.0
    return share


def _skin_fields(
    points: Array, places: Array, skin: Indices, head: HeadParts, feature_points: dict[str, int]
) -> dict[int, Array]:
    """FAP to (N, 3): displacement of the skin per millimetre, corrected at the feature points of other FAPs."""
    at = points[skin]
    fields = skin_fields(places[skin])
    share = _beyond_lips(head, len(points))
    corners, line = abs(points[feature_points["8.3"]][0]), points[feature_points["2.2"]][1]
    between = 1 - smoothstep((np.abs(at[:, 0]) / corners - 0.7) / 0.5)
    above = smoothstep((at[:, 1] - line) / SLIT_MM + 0.5)
    around = {}
    for owner in OWNERS:
        away = np.linalg.norm(at - points[feature_points[fap.spec(owner).point]], axis=1)
        near = np.flatnonzero(away < CORRECTION_MM)
        around[owner] = int(away.argmin()), near, (1 - (away[near] / CORRECTION_MM) ** 2)[:, None] ** 2
    for puff in PUFF_CHEEKS:
        outwards = np.array(fap.HEAD_AXES[fap.spec(puff).positive], dtype=np.float64)
        corner = points[feature_points["8.3" if outwards[0] > 0 else "8.4"]]
        off = at - points[feature_points[fap.spec(puff).point]]
        bag = np.clip(1 - (np.linalg.norm(off, axis=1) / PUFF_MM) ** 2, 0, None) ** 2
        bag *= smoothstep(np.linalg.norm(at - corner, axis=1) / PUFF_CORNER_MM)
        fields[puff] = bag[:, None] * (outwards + PUFF_FORWARD * np.array([0.0, 0.0, 1.0]))
    pushed = 1 - smoothstep((np.abs(at[:, 0]) / corners - PUSH_SIDE[0]) / (PUSH_SIDE[1] - PUSH_SIDE[0]))
    for number, moves in fields.items():
        moves *= share[skin, None]
        if number in (16, 17):
            moves *= (1 - ROLL_OUT) * pushed[:, None]
        if number in UPPER_LIP_FAPS:
            moves *= 1 - (between * (1 - above))[:, None]
        elif number in LOWER_LIP_FAPS:
            moves *= 1 - (between * above)[:, None]
        # At an owner's point, along its direction, its own field becomes 1 and all others 0.
        for owner, (nearest, near, bump) in around.items():
            direction = np.array(fap.HEAD_AXES[fap.spec(owner).positive])
            gain = moves[nearest] @ direction
            if owner == number:
                moves /= gain
            elif number != JAW_FAP:
                moves[near] -= gain * bump * direction
    return fields


def _brows(points: Array, head: HeadParts, skin: Indices, feature_points: dict[str, int], linear: Linear) -> None:
    """Inner, middle and outer FAPs together bend a brow along one parabola; it moves whole, and the skin follows."""
    x, y, front = points[skin, 0], points[skin, 1], points[skin, 2] > 20
    for side, sign in enumerate((1.0, -1.0)):
        inner, middle, outer = (points[feature_points[f"4.{number + side}"]] for number in (1, 3, 5))
        along = sign * x
        knots = sign * np.array([inner[0], middle[0], outer[0]])
        at = np.clip(along, knots[0], knots[2])
        hairs = points[head.brows[side]]
        heights = np.linalg.lstsq(_parabola(sign * hairs[:, 0], knots), hairs[:, 1])[0]
        off = y - _parabola(at, knots) @ heights
        thick = np.percentile(np.abs(hairs[:, 1] - _parabola(sign * hairs[:, 0], knots) @ heights), 97)
        above = np.clip((off - thick) / BROW_ABOVE_MM, 0, 1)
        reach = BROW_TO_LID_MM - thick + BROW_TO_NOSE_MM * (1 - smoothstep((along / knots[0] - 0.3) / 1.3))
        below = np.clip((-off - thick) / reach, 0, 1)
        # A ramp with short ends is less steep than a smooth step: skin below a lowered brow must not fold over itself.
        vertical = (1 - smoothstep(above)) * (1 - 0.5 * (below + smoothstep(below))) * front
        midline = smoothstep((along / knots[0] + 1) / 2)
        temple = 1 - smoothstep((along - knots[2]) / 24.0)
        weights = _parabola(at, knots) * (midline * temple * vertical)[:, None]
        for number, weight in zip((31 + side, 33 + side, 35 + side), weights.T, strict=True):
            linear(number, skin, weight)
        inwards = 1 - 0.8 * smoothstep((along - knots[0]) / (knots[2] - knots[0]))
        inwards *= 1 - smoothstep((off - thick) / SQUEEZE_ABOVE_MM)  # or the forehead would have a ridge
        inwards *= midline * temple * vertical
        bend = np.polyfit(hairs[:, 0] ** 2, hairs[:, 2], 1)[0]  # skin slides along the forehead, not into it
        linear(37 + side, skin, inwards, -2 * bend * along)


def _parabola(x: Array, knots: Array) -> Array:
    """(N, 3): weights of three values at knots, (3,), on the parabola through them, at places (N,)."""
    first, second, third = knots
    return np.stack(
        [
            (x - second) * (x - third) / ((first - second) * (first - third)),
            (x - first) * (x - third) / ((second - first) * (second - third)),
            (x - first) * (x - second) / ((third - first) * (third - second)),
        ],
        axis=-1,
    )


def _lids(
    points: Array, eye: Eye, side: int, feature_points: dict[str, int], fapu: Fapu, collector: BasisCollector
) -> None:
    rings = eye.lids
    neutral = points[rings.indices]
    margin = rings.indices[np.flatnonzero(rings.level == 1.0)[0]]
    moving = np.concatenate([rings.indices[1:].ravel(), eye.lashes.ravel()])  # the border is the grid's and stays
    for number, knot_lists, mine, direction in (
        (19 + side, (UPPER_LID_KNOTS, WIDE_KNOTS), rings.upper, -1.0),
        (21 + side, (LOWER_LID_KNOTS, WIDE_KNOTS), ~rings.upper, 1.0),
    ):
        point = feature_points[fap.spec(number).point]
        own = int(np.flatnonzero(margin == point)[0])
        y, z = points[point, 1:] - eye.centre[1:]
        neutral_rad = np.arctan2(y, z)
        for knots in knot_lists:
            poses = []
            for value in knots:
                moved = y + direction * value * fapu.unit(fap.FapUnit.IRISD)
                angle = np.arcsin(np.clip(moved / np.hypot(y, z), -1, 1))
                closing = (angle - neutral_rad) / (eye.closed[own] - eye.angles[own])
                turn = np.where(mine, closing * (eye.closed - eye.angles), 0.0)
                shut = float(smoothstep(closing)) if direction < 0 else 0.0
                moves = lid_displacement(neutral, eye, turn, shut)
                if direction > 0:
                    moves += max(value, 0.0) * _swelling_below(neutral, eye)
                lids = moves[1:].reshape(-1, 3)
                lashes = lash_displacement(points[eye.lashes], eye, turn[eye.lash_roots]).reshape(-1, 3)
                poses.append(np.concatenate([lids, lashes]))
            for (start, before), (stop, after) in pairwise(zip(knots, poses, strict=True)):
                collector.add(Channel(number, start, stop), moving, (after - before) / abs(stop - start))


def _swelling_below(neutral: Array, eye: Eye) -> Array:
    """(levels, N, 3) mm per FAPU: skin of a lower lid, which is pushed together as it rises, away from the ball."""
    level, across = eye.lids.level[:, None], 1 - eye.lids.t**2
    roll = np.clip(np.exp(-(((level - 1.40) / 0.22) ** 2)) - 0.05, 0, None) * (level > 1)
    height = SWELLING_MM * roll * ~eye.lids.upper * across
    return height[..., None] * unit_vectors(neutral - eye.centre)


def teeth_by_light(points: Array, head: HeadParts) -> list[tuple[int, Indices]]:
    """FAPs that change the light on teeth, each with the vertices, (N,)."""
    upper, lower = (teeth[CROWNS].ravel() for teeth in (head.upper_teeth, head.lower_teeth))
    left = points[upper, 0] > 0
    return [(PUSH_LOWER_LIP, lower), *zip(RAISE_CORNERS, (upper[left], upper[~left]), strict=True)]


def throat(head: HeadParts) -> Indices:
    """(N,): the back of the mouth, and the vertex that closes it, which comes after its last ring."""
    back = head.mouth.indices[head.mouth.level <= -0.7].ravel()
    return np.append(back, back.max() + 1)


def _tongue(
    points: Array,
    head: HeadParts,
    feature_points: dict[str, int],
    fapu: Fapu,
    linear: Linear,
    collector: BasisCollector,
) -> None:
    vertices = head.tongue
    tip = points[feature_points["6.1"]]
    behind = tip[2] - points[vertices, 2]
    share = np.clip(1 - behind / 44.0, 0, 1)
    blade = np.clip(1 - (behind - BLADE_MM) / (44.0 - BLADE_MM), 0, 1)
    for number in (43, 44, 45):
        linear(number, vertices, blade**1.6)
    narrower = -NARROW_TONGUE * fapu.unit(fap.FapUnit.MW) * points[vertices] * [1, 0, 0] * blade[:, None]
    collector.add(Channel(45, OUT_FAPU, np.inf), vertices, narrower)
    middle = points[feature_points["6.2"]]
    linear(46, vertices, np.clip(1 - ((points[vertices, 2] - middle[2]) / 30.0) ** 2, 0, 1) ** 2)
    edge = np.abs(points[vertices, 0]) * share
    lift = np.stack([-np.sign(points[vertices, 0]) * 0.3 * edge, edge, 0 * edge], axis=-1) * AU_RAD
    collector.add(Channel(47, 0.0, np.inf), vertices, lift)


def _jaw_weight(points: Array, head: HeadParts, skin: Indices, field: Array, chin: Array) -> Array:
    """(V,) fraction by which a skin vertex turns with the jaw; teeth and tongue follow it fully and are not included.

    ``field`` is the displacement of real skin per millimetre of open_jaw; its part in the direction of the jaw's
    rotation is used.
    """
    weight = np.zeros(len(points))
    lever = points[skin] - JAW_PIVOT
    turn = np.stack([0 * lever[:, 0], -lever[:, 2], lever[:, 1]], axis=-1) / (chin - JAW_PIVOT)[2]
    share = (field * turn).sum(axis=1) / np.maximum((turn**2).sum(axis=1), 0.05)
    weight[skin] = np.clip(share / share[np.linalg.norm(points[skin] - chin, axis=1).argmin()], 0, 1)
    mouth = head.mouth
    level = mouth.level[:, None]
    inside = np.where(mouth.upper & (np.abs(mouth.t) < 1), 0.0, smoothstep(-level / 0.75) * (1 - np.abs(mouth.t) ** 3))
    weight[mouth.indices] = np.maximum(weight[mouth.indices] * (level > 1), inside * (level < 0))
    return weight
