"""The default head: a mesh generated from proportions; the same every time.

Head space: +x the subject's left, +y up, +z out of the face, mm.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from fapengine._arrays import Array, Indices
from fapengine.errors import UsageError
from fapengine.geometry.smooth import smoothstep
from fapengine.geometry.surface import ambient_light, average_over_mesh, mesh_links, unit_vectors, vertex_normals
from fapengine.mesh.colours import EYE_COLOURS
from fapengine.mesh.default_head import faces, parts
from fapengine.mesh.default_head.basis import (
    JAW_FAP,
    JAW_PIVOT,
    SMILE_TEETH_FAPU,
    THROAT_FAPU,
    build_basis,
    teeth_by_light,
    throat,
)
from fapengine.mesh.default_head.clothes import build_clothes, neck_weight
from fapengine.mesh.default_head.eyes import build_lids
from fapengine.mesh.default_head.folds import KEY_FROM, fold_map, resting_folds
from fapengine.mesh.default_head.mesh_builder import Block, MeshBuilder, skin_uv
from fapengine.mesh.default_head.mouth import MIDDLE, build_mouth
from fapengine.mesh.default_head.painting import paint
from fapengine.mesh.default_head.parts import build_brow, build_ear, build_glasses
from fapengine.mesh.default_head.points import HeadParts, locate
from fapengine.mesh.default_head.skin import even_out
from fapengine.mesh.default_head.strands import build_strands
from fapengine.mesh.default_head.style import LEVELS, Detail, HeadStyle, palette_of
from fapengine.mesh.default_head.stylised import EDGE_Y_MM, EDGE_Z_MM, stylise
from fapengine.mesh.default_head.surface import nostril, position, radius
from fapengine.mesh.face_mesh import Bone, DeformationBasis, FaceMesh, Folds, Material
from fapengine.mpeg4.fap import FapUnit
from fapengine.mpeg4.fapu import Fapu

LIT_INSIDE = {Material.TEETH: 0.26, Material.GUM: 0.5, Material.TONGUE: 0.6, Material.MOUTH: 0.72}
"""Least light, relative, on parts inside the mouth."""
THRUST_TONGUE = 45
TONGUE_LIGHT_PER_MM = 0.06
"""Change of the relative light on the tip of the tongue per millimetre forward."""
TEETH_LIGHT_PER_MM = {16: -0.045, 12: 0.08, 13: 0.08}
"""Change of the relative light on teeth per millimetre of a FAP: lower lip pushed, corners raised."""
SMILE_TEETH_LIGHT = 0.4
"""Light that upper teeth gain in a smile, beyond that."""
DARK_THROAT = 0.22
"""Light that the throat of a wide open mouth loses."""
SHADED_TEETH = 0.005
"""Least light on upper teeth, which are in the shadow of the lip."""
LID_FOLDS_AT = 1.4
UPPER_LIDS = (19, 20)
OPEN_LID, SHUT_LID = 0.68, 0.78
"""Least light on an open and on a closed lid."""
DOME_LIT = 0.5
"""Part of its shade that a closed lid loses: beside the skin around it, it was a dark panel."""
HAIR_NEAR_MM, HAIR_SHADE, JAW_SHADE = 20.0, 0.75, 0.7
"""Distance within which hair shades skin; fraction of the light that hair and jaw remove."""
SOCKET_TURNED, UNDER_EYE_TURNED = 0.5, 0.7
"""Share of the way that normals between an upper lid and its brow turn to the front, and below an eye, to the cheek."""
MOUTH_CORNERS = 0.5
"""Least light on the ends of the lips."""
EAR_JOINS_MM = 6.0
"""Height above the skin over which an ear takes on its light."""
SCALP_DEG, SCALP_MM = (30.0, 60.0, 110.0, 140.0), (26.0, 50.0, 50.0, 62.0)
"""Height above the hairline up to which the scalp is drawn, by angle from the front: tips of hair leave it free."""
ROOTS, ROOTS_MM = 0.85, 20.0
"""Share of the hair's colour in the skin under hair beside and behind the ears, where the painting ends, and the height
over which it comes.
"""
HEAD_PIVOT = np.array([0.0, -45.0, -5.0])
MOUTH_LINE_Y = -34.6
"""Height of a row of the grid; its vertices at the border of the mouth's block are level with the corners of the mouth.
"""
ROWS: tuple[tuple[float, int], ...] = (  # upper end of a stretch, mm, and its rows
    (-116.0, 1), (-92.0, 3), (-62.0, 10), (MOUTH_LINE_Y, 9), (-16.5, 7), (-12.0, 2), (6.0, 9), (17.5, 4),
    (33.0, 5), (51.0, 6), (62.0, 3), (90.0, 5), (115.0, 3), (142.0, 3),
)  # fmt: skip
COLUMNS: tuple[tuple[float, int], ...] = (  # outer end of a stretch, degrees, and its columns
    (6.6, 6), (13.2, 6), (25.5, 7), (35.0, 5), (48.0, 6), (80.0, 6), (140.0, 6), (180.0, 3),
)  # fmt: skip


def _spaced(start: float, stretches: tuple[tuple[float, int], ...], detail: float) -> Array:
    """Return the ends of all stretches with each stretch's number of steps between them, changing length gradually."""
    ends = np.array([start, *(end for end, _ in stretches)])
    counts = np.cumsum([0, *(max(1, round(count * detail)) for _, count in stretches)])
    return PchipInterpolator(counts, ends)(np.arange(counts[-1] + 1))


def _block(rows: Array, columns: Array, heights: tuple[float, float, float], angles_deg: tuple[float, float]) -> Block:
    """Find the block whose bottom, corner and top, and left and right, are nearest to these."""
    bottom, corner, top = (int(np.abs(rows - height).argmin()) for height in heights)
    left, right = (int(np.abs(columns - angle).argmin()) for angle in np.deg2rad(angles_deg))
    return Block(bottom=bottom, top=top, corner=corner, left=left, right=right)


def build_head(style: HeadStyle | None = None, *, level: str = "normal") -> FaceMesh:
    """Build the head.

    Parameters
    ----------
    style : HeadStyle, optional
        Proportions and colours; by default an average adult.
    level : str
        One of :data:`.style.LEVELS`. All are the same surface at different resolutions, with the same channels.

    Returns
    -------
    FaceMesh
        Every FDP feature point, and the deformation basis. The last four heads are cached.

    Raises
    ------
    UsageError
        If the level is unknown.
    """
    if level not in LEVELS:
        raise UsageError(f"level: got {level!r}, expected one of {', '.join(LEVELS)}")
    return _built(style or HeadStyle(), level)


@lru_cache(maxsize=4)
def _built(style: HeadStyle, level: str) -> FaceMesh:
    builder, head = build_parts(style, LEVELS[level])
    return _finish(builder, head, style, LEVELS[level])


Reshape = Callable[[Array, Indices, HeadParts, dict[str, int]], tuple[Array, HeadParts]]
"""Takes vertices, (V, 3) mm, triangles, (F, 3), parts, and feature points; returns vertices, and parts with matching
eyes.
"""


def build_reshaped(style: HeadStyle, reshape: Reshape) -> FaceMesh:
    """Build the head of a style in another shape, given by ``reshape``, which is called once.

    FAPs, units and shading are those of the new shape; colours and hair come from the style.
    """
    builder, head = build_parts(style, LEVELS["normal"])
    return _finish(builder, head, style, LEVELS["normal"], reshape)


def build_parts(style: HeadStyle, level: Detail) -> tuple[MeshBuilder, HeadParts]:
    """Build the template: all vertices before the measured face displaces them."""
    builder, detail, finer = MeshBuilder(), level.skin, level.hair
    grid, crown, (mouth_block, left, right) = _build_skin(builder, style, detail)
    head = HeadParts(
        grid=grid,
        mouth=build_mouth(builder, mouth_block.border(grid), mouth_block, style, detail),
        eyes=(
            build_lids(builder, left.border(grid), left, style, 1.0, level),
            build_lids(builder, right.border(grid), right, style, -1.0, level),
        ),
        brows=(build_brow(builder, style, 1.0, finer), build_brow(builder, style, -1.0, finer)),
        ears=(build_ear(builder, style, 1.0, detail), build_ear(builder, style, -1.0, detail)),
        upper_teeth=parts.build_teeth(builder, detail, upper=True),
        lower_teeth=parts.build_teeth(builder, detail, upper=False),
        tongue=parts.build_tongue(builder, detail),
        hair=build_strands(builder, style, palette_of(style), finer) if style.hair else np.zeros(0, dtype=np.int64),
        crown=crown,
        pivot=int(builder.add(HEAD_PIVOT, albedo=palette_of(style).base)),
    )
    build_clothes(builder, style, detail)
    if style.glasses:
        build_glasses(builder, style, detail)
    return builder, head


def _build_skin(builder: MeshBuilder, style: HeadStyle, detail: float) -> tuple[Indices, int, list[Block]]:
    """Add the skin; returns its grid, the vertex that closes it at the top, and the blocks of mouth and eyes."""
    half = np.deg2rad(_spaced(0.0, COLUMNS, detail))
    rows, columns = _spaced(-128.0, ROWS, detail), np.concatenate([-half[:0:-1], half])
    palette = palette_of(style)
    y, angle = np.meshgrid(rows, columns, indexing="ij")
    points = position(angle, y, style)
    inside = nostril(radius(angle, y, style) * np.sin(angle), y, style.nose_width) * (np.cos(angle) > 0.5)
    # Nostrils are dark, and reddish rather than grey.
    albedo = palette.skin(points) * (1 - inside[..., None] * np.array([0.66, 0.80, 0.82]))
    if style.hair:
        roots = (
            ROOTS
            * smoothstep((faces.above_hairline(angle, y) + 1.0) / ROOTS_MM)
            * smoothstep((np.abs(angle) - 1.75) / 0.4)
        )
        albedo += roots[..., None] * (0.8 * palette.hair - albedo)
    grid = builder.add(
        points,
        albedo=albedo,
        head_weight=neck_weight(y, points[..., 2]),
        uv=skin_uv(angle, y),
        place=np.stack([angle, y], -1),
    )
    blocks = [
        _block(rows, columns, (-62.0, MOUTH_LINE_Y, -16.5), (-25.5, 25.5)),
        _block(rows, columns, (17.5, 33.0, 51.0), (6.6, 35.0)),
        _block(rows, columns, (17.5, 33.0, 51.0), (-35.0, -6.6)),
    ]
    keep = np.ones((len(rows) - 1, len(columns) - 1), dtype=bool)
    for block in blocks:
        keep[block.bottom : block.top, block.left : block.right] = False
    if style.hair:  # cells completely covered by hair need not be drawn
        covered = y > faces.hairline(angle) + np.interp(np.rad2deg(np.abs(angle)), SCALP_DEG, SCALP_MM)
        keep &= ~(covered[:-1, :-1] & covered[1:, :-1] & covered[:-1, 1:] & covered[1:, 1:])
    builder.quads(grid, keep=keep)  # closed by two columns at one position, where the texture ends
    crown = int(builder.add(points[-1].mean(axis=0) * [0, 1, 1] + [0, 3.0, 0], albedo=palette.base))
    if not style.hair:
        builder.fan(grid[-1, :-1], crown)
    return grid, crown, blocks


def _soften(points: Array, links: "csr_array[np.float64]", head: HeadParts, detail: float) -> Array:
    """Smooth the skin where the rings around mouth and eyes meet the grid."""
    rounds = max(1, round(4 * detail**2))
    weight, near = np.zeros(len(points)), np.zeros(len(points))
    weight[head.grid] = 1.0
    softened_from = [(head.mouth, np.full(len(head.mouth.t), 1.15))]
    softened_from += [(eye.lids, np.where(eye.lids.upper, 1.5, 1.1)) for eye in head.eyes]  # no ridge under the eye
    for rings, edge in softened_from:
        weight[rings.indices] = smoothstep((rings.level[:, None] - edge) / 0.25)
        near[rings.indices] = 1.0
    blend = weight * np.clip(3.0 * average_over_mesh(near, links, rounds), 0, 1)
    softened = average_over_mesh(points, links, rounds)
    # Quads are cut along one diagonal, which pulls to one side: keep what both halves of the face agree on.
    mirror = np.array([-1.0, 1.0, 1.0])
    skin = np.flatnonzero(weight)
    twin = skin[cKDTree(points[skin]).query(points[skin] * mirror)[1]]
    softened[skin] = (softened[skin] + softened[twin] * mirror) / 2
    blend[skin] = (blend[skin] + blend[twin]) / 2
    return points + blend[:, None] * (softened - points)


def _on_face(template: Array, builder: MeshBuilder, head: HeadParts, style: HeadStyle) -> Array:
    """(V, 3) mm: the template displaced to the measured face.

    Teeth and tongue, which fit behind the lips of the mean face, follow the lips of the person.
    """
    points = template.copy()
    place = builder.column("place")
    on_skin = np.isfinite(place[:, 0])
    points[on_skin] += faces.displacement(place[on_skin], style.weights)
    points[head.crown] += (points - template)[head.grid[-1]].mean(axis=0) * [0, 1, 1]
    mouth = faces.displacement(MIDDLE, style.weights) - faces.displacement(MIDDLE)
    for part in (head.upper_teeth, head.lower_teeth, head.tongue):
        points[part] += mouth
    return points


def _light_lids(
    points: Array,
    triangles: Indices,
    links: "csr_array[np.float64]",
    head: HeadParts,
    basis: DeformationBasis,
    occlusion: Array,
    shades: Array,
    rest: Array,
) -> None:
    """Make the light on the lids follow their closing: set ``occlusion``, ``shades`` and ``rest`` of their vertices.

    An open lid is folded away in the dark; a closed one is on the ball in the light.
    """
    length = np.array([max(each.stop - each.start, 0.0) if each.fap in UPPER_LIDS else 0.0 for each in basis.channels])
    closing = length > 0
    owner = basis.entry_vertices
    folded = np.concatenate([eye.lids.indices[eye.lids.level < LID_FOLDS_AT].ravel() for eye in head.eyes])
    of_lid = closing[basis.entry_channels] & np.isin(owner, folded)
    lids = np.zeros(len(points), dtype=bool)
    lids[owner[of_lid]] = True
    occlusion[folded] = np.maximum(occlusion[folded], np.where(lids[folded], OPEN_LID, SHUT_LID))
    # The skin above is in the shade of the fold until the lid draws it out. Lines on it keep their entries.
    plain = np.isin(owner, owner[closing[basis.entry_channels]]) & (np.bincount(owner, np.abs(shades))[owner] == 0)
    share = np.ones(len(points))
    for eye in head.eyes:
        level = eye.lids.level[(eye.lids.level >= LID_FOLDS_AT) & (eye.lids.level < 2.0)]
        above = eye.lids.indices[np.isin(eye.lids.level, level)][:, eye.lids.upper]
        share[above] = smoothstep((2.0 - level) / (2.0 - LID_FOLDS_AT))[:, None]
        lids[owner[plain & np.isin(owner, above)]] = True
    of_lid = closing[basis.entry_channels] & lids[owner]
    whole = sum(length[[channel.fap == UPPER_LIDS[0] for channel in basis.channels]])
    # Their light when shut, averaged over two rounds, so two rings around them are needed.
    near = np.flatnonzero(average_over_mesh(lids.astype(float), links, 2))
    shut, lit = points + basis.displacement(length), np.zeros(len(points))
    lit[near] = ambient_light(shut, vertex_normals(shut, triangles), near)
    lit = average_over_mesh(lit, links, 2)
    lit += DOME_LIT * (1 - lit)
    change = share * (np.maximum(lit, SHUT_LID) - occlusion) / whole
    shades[lids[owner]] = 0.0
    shades[of_lid] = change[owner[of_lid]]
    rest[lids] = -1.0


def _light_mouth(
    points: Array, head: HeadParts, basis: DeformationBasis, mm_per_fapu: float, shades: Array, rest: Array
) -> None:
    """Make the light in the mouth follow lips and tongue: set ``shades`` and ``rest`` of their vertices.

    The tongue is dark when drawn back and lit when it comes out; the throat of a wide open mouth is dark; lower teeth
    are dark behind a lip that is pushed forward, and upper teeth, otherwise in the shadow of their lip, are lit when a
    smile lifts it.
    """
    fap = np.array([channel.fap for channel in basis.channels])[basis.entry_channels]
    owner = basis.entry_vertices
    of_tongue = (fap == THRUST_TONGUE) & np.isin(owner, head.tongue)
    shades[of_tongue] = TONGUE_LIGHT_PER_MM * basis.entry_mm[of_tongue, 2]
    rest[owner[of_tongue]] = -1.0
    whole = np.array([channel.start == -np.inf for channel in basis.channels])
    wide = np.array([channel.fap == JAW_FAP and channel.start == THROAT_FAPU[0] for channel in basis.channels])
    back = throat(head)
    of_throat = wide[basis.entry_channels] & np.isin(owner, back)
    shades[of_throat] = -DARK_THROAT / (THROAT_FAPU[1] - THROAT_FAPU[0])
    rest[back] = -1.0
    for number, teeth in teeth_by_light(points, head):
        chosen = (fap == number) & whole[basis.entry_channels] & np.isin(owner, teeth)
        shades[chosen] = TEETH_LIGHT_PER_MM[number] * mm_per_fapu
        rest[teeth] = -1.0
        smile = np.array([(channel.fap, channel.start) == (number, SMILE_TEETH_FAPU[0]) for channel in basis.channels])
        chosen = smile[basis.entry_channels] & np.isin(owner, teeth)
        shades[chosen] = SMILE_TEETH_LIGHT / (SMILE_TEETH_FAPU[1] - SMILE_TEETH_FAPU[0])


def _join_ears(points: Array, normals: Array, occlusion: Array, head: HeadParts) -> None:
    """Turn ``normals`` of ears and change their ``occlusion`` to those of the skin where they grow out of it."""
    skin = head.grid.ravel()
    at = cKDTree(points[skin])
    for ear in head.ears:
        mine = ear.ravel()
        under = skin[at.query(points[mine])[1]]
        above = ((points[mine] - points[under]) * normals[under]).sum(axis=1)
        share = 1 - smoothstep((above - 0.5) / EAR_JOINS_MM)
        normals[mine] = unit_vectors(normals[mine] + 0.9 * share[:, None] * (normals[under] - normals[mine]), 1e-6)
        occlusion[mine] += share * (occlusion[under] - occlusion[mine])


def _soften_sockets(normals: Array, head: HeadParts) -> None:
    """Turn ``normals`` between an upper lid and its brow to the front, and those below an eye to the cheek's.

    Deep sockets and a fold under the eye look tired.
    """
    for eye in head.eyes:
        level, upper = eye.lids.level, eye.lids.upper
        above = SOCKET_TURNED * smoothstep((level - 1.32) / 0.08) * smoothstep((2.05 - level) / 0.4)
        below = UNDER_EYE_TURNED * smoothstep((level - 1.1) / 0.2)
        for part, share, front in ((upper, above, np.array([0.0, 0.25, 0.5])), (~upper, below, np.zeros(3))):
            rings = eye.lids.indices[:, part]
            turned = normals[rings] + share[:, None, None] * (normals[rings[0]] + front - normals[rings])
            normals[rings] = unit_vectors(turned, 1e-6)


def _light_corners(occlusion: Array, head: HeadParts) -> None:
    """Lift the ``occlusion`` of the ends of the lips: pursed, they were dark dots."""
    mouth = head.mouth
    lip = np.abs(mouth.level - 0.5) < 0.7
    at_end = smoothstep((np.abs(mouth.t) - 0.7) / 0.25)
    corners = mouth.indices[lip]
    occlusion[corners] += at_end * np.maximum(MOUTH_CORNERS - occlusion[corners], 0.0)


def _cast_shadows(
    points: Array, links: "csr_array[np.float64]", occlusion: Array, head: HeadParts, has_hair: bool
) -> None:
    """Darken ``occlusion`` of skin below hair and of the neck below the jaw, which shade it from the key lamp."""
    skin = head.grid.ravel()
    at = points[skin]
    shade = np.zeros(len(skin))
    if has_hair:
        # Hair that a ray to the lamp passes near by.
        hair = cKDTree(points[head.hair])
        distance = hair.query(at + 6.0 * KEY_FROM, distance_upper_bound=HAIR_NEAR_MM)[0]
        near = np.zeros(len(points))
        near[skin] = smoothstep(1 - np.minimum(distance, HAIR_NEAR_MM) / HAIR_NEAR_MM)
        shade = HAIR_SHADE * average_over_mesh(near, links, 6)[skin]
    chin = points[head.mouth.indices[0], 1].min()
    jaw = chin + 66.0 + np.interp(at[:, 2], EDGE_Z_MM, EDGE_Y_MM)
    below = smoothstep((jaw - at[:, 1]) / 14.0) * smoothstep((at[:, 2] + 20.0) / 40.0)
    below *= 0.35 + 0.65 * smoothstep((at[:, 1] - chin + 58.0) / 40.0)
    shade = np.maximum(shade, JAW_SHADE * below)
    occlusion[skin] *= 1 - shade


def _finish(
    builder: MeshBuilder, head: HeadParts, style: HeadStyle, level: Detail, reshape: Reshape | None = None
) -> FaceMesh:
    triangles = builder.triangles()
    template = builder.column("points_mm")
    links = mesh_links(triangles, len(template))
    points = _soften(_on_face(template, builder, head, style), links, head, level.skin)
    feature_points = locate(template, head)
    if reshape is not None:
        points, head = reshape(points, triangles, head, feature_points)
    elif style.charm or style.childlike:
        points, head = stylise(points, head, style)
    normals = vertex_normals(points, triangles)
    given = builder.column("normal")
    has_own = np.isfinite(given[:, 0])
    normals[has_own] = given[has_own]
    seam = head.grid[:, [0, -1]]
    normals[seam] = unit_vectors(normals[seam].sum(axis=1, keepdims=True), 1e-9)
    occlusion = average_over_mesh(ambient_light(points, normals), links, 2)
    _join_ears(points, normals, occlusion, head)
    _soften_sockets(normals, head)
    _light_corners(occlusion, head)
    _cast_shadows(points, links, occlusion, head, bool(style.hair))
    # The inside of the mouth is seen when the lips part, in the light: the neutral shadow would be wrong.
    for material, light in LIT_INSIDE.items():
        occlusion = np.where(builder.column("material") == material, np.maximum(occlusion, light), occlusion)
    occlusion[head.upper_teeth[parts.CROWNS]] = SHADED_TEETH
    centres = {"3.5": head.eyes[0].centre, "3.6": head.eyes[1].centre}
    fapu = Fapu.measure({name: points[index] for name, index in feature_points.items()} | centres)
    places = builder.column("place")
    jaw_weight, basis, shades = build_basis(points, template, places, head, feature_points, fapu, style.age)
    basis = even_out(basis, points, links, head, feature_points, level.skin)
    on_jaw = jaw_weight > 0
    shades *= 0.45 + 0.55 * style.age  # a young skin folds less
    rest = np.where(builder.column("material") == Material.SKIN, resting_folds(template, style.age), 0.0)
    _light_lids(points, triangles, links, head, basis, occlusion, shades, rest)
    _light_mouth(points, head, basis, fapu.unit(FapUnit.MNS), shades, rest)

    # Grid vertices inside the openings and under the hair are not in any triangle and are left out.
    used = np.zeros(len(points), dtype=bool)
    used[triangles] = True
    used[list(feature_points.values())] = True
    number = np.cumsum(used) - 1
    kept = used[basis.entry_vertices]
    return FaceMesh(
        vertices_mm=points[used].astype(np.float32),
        normals=normals[used].astype(np.float32),
        uv=builder.column("uv")[used],
        albedo=np.clip(builder.column("albedo"), 0, 1)[used].astype(np.float32),
        material=builder.column("material")[used],
        occlusion=np.clip(occlusion, 0, 1)[used].astype(np.float32),
        bone=np.where(on_jaw, Bone.JAW, builder.column("bone"))[used],
        bone_weight=np.where(on_jaw, jaw_weight, builder.column("bone_weight"))[used],
        head_weight=builder.column("head_weight")[used],
        triangles=number[triangles].astype(np.int32),
        feature_points={name: int(number[index]) for name, index in feature_points.items()},
        jaw_pivot_mm=JAW_PIVOT,
        head_pivot_mm=HEAD_PIVOT,
        eye_pivots_mm=np.stack([eye.centre for eye in head.eyes]),
        fapu=fapu,
        iris_albedo=np.array(EYE_COLOURS[style.eye_colour], np.float32),
        texture=paint(style),
        folds=Folds(fold_map(), rest[used].astype(np.float32), shades[kept].astype(np.float32)),
        basis=replace(
            basis,
            offsets=np.concatenate([[0], np.cumsum(np.diff(basis.offsets)[used])]),
            entry_channels=basis.entry_channels[kept],
            entry_mm=basis.entry_mm[kept],
        ),
    )
