"""FAPs to the blendshapes of a rig, by name: ARKit's shapes, Oculus' visemes, VRM's presets, or those of a mapping.

A rig with enough of ARKit's shapes uses these. Any other uses visemes or vowels for the mouth, and its ARKit shapes for
eyes and brows, or VRM's moods. A shape with two names in a file moves once in each mesh.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.mpeg4 import fap
from fapengine.retarget import visemes
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES, BlendMap
from fapengine.retarget.blendshape_names import OCULUS, OCULUS_SPELLINGS, UNUSED, Role, by_role, is_arkit, plain

Weights = dict[str, Array]
"""(T,) float64, 0..1, by the name of a shape."""
Meanings = Mapping[str, str | Mapping[int, float]]
"""Meaning of a shape with another name: a name of the tables, ``unused``, or FAPU at full weight by FAP number."""

UPPER_FACE = ("eye", "brow")
"""Prefixes of ARKit's names that do not concern the mouth."""
MOODS = ("happy", "angry", "sad", "relaxed", "surprised")
LOOKS = ("lookUp", "lookDown", "lookLeft", "lookRight")
MIN_OCULUS = 8
"""Number of Oculus' visemes from which a rig uses them."""


def rig_weights(
    meshes: Sequence[Iterable[str]],
    faps: ArrayLike,
    meanings: Meanings | None = None,
    *,
    looks: bool = True,
    rate_hz: float = 60.0,
) -> list[Weights]:
    """Find the weights of a rig's shapes.

    Parameters
    ----------
    meshes : sequence of names
        Names of the shapes of each mesh.
    faps : (T, 68) FAPU
        Of one face over time.
    meanings : mapping, optional
        Meaning of shapes with names that are not in the tables.
    looks : bool
        Whether to move VRM's looks; not where eyes turn as bones.
    rate_hz : float
        Frame rate.

    Returns
    -------
    list of dict
        For each mesh the weights of its known shapes, including those that stay 0.
    """
    values = frozen(faps, "faps", ("T", fap.FAP_COUNT), np.float64)
    own = {name: row for name, row in (meanings or {}).items() if not isinstance(row, str)}
    words = {name: word for name, word in (meanings or {}).items() if isinstance(word, str)}
    named = [[name for name in names if name not in own and words.get(name) != UNUSED] for names in meshes]
    roles = [by_role(names, words) for names in named]
    by_target = _targets(values, roles, looks, rate_hz)
    weights: list[Weights] = []
    for names, found, mesh in zip(named, roles, meshes, strict=True):
        chosen = {name: own_weight(values, own[name]) for name in mesh if name in own}
        for role, spelled in found.items():
            chosen |= {name: by_target[role, target] for target, name in spelled.items() if (role, target) in by_target}
        for name in names:  # presets other than visemes and blinks
            if name not in chosen and (None, plain(words.get(name, name))) in by_target:
                chosen[name] = by_target[None, plain(words.get(name, name))]
        weights.append(chosen)
    return weights


def own_weight(faps: Array, row: Mapping[int, float]) -> Array:
    """(T,): weight of a shape that is defined by FAPs, FAPU at full weight; ``faps`` are (T, 68)."""
    shape = np.zeros((1, fap.FAP_COUNT))
    for number, value in row.items():
        shape[0, fap.column(number)] = value
    if set(row) <= {43, 44, 46, 47}:  # tongue motion, which BlendMap does not weight
        square = float((shape**2).sum())
        return np.asarray(np.clip(faps @ shape[0] / square, 0.0, 1.0))
    return BlendMap(("own",), shape).approximate_weights(faps)[:, 0]


Targets = dict[tuple[Role | None, str], Array]


def _targets(faps: Array, roles: Sequence[Mapping[Role, Mapping[str, str]]], looks: bool, rate_hz: float) -> Targets:
    """Weights by role and meaning of names; None is the role of VRM's other presets, whose names are normalised."""
    present = {role: {target for found in roles for target in found[role]} for role in Role}
    arkit = dict(zip(ARKIT_NAMES, approximate_arkit(faps).T, strict=True))
    speaks = (is_arkit(present) and "jawOpen" in present[Role.ARKIT]) or not present[Role.VISEME]

    targets: Targets = {(role, name): arkit[name] for role in (Role.ARKIT, Role.SUBSTITUTE) for name in arkit}
    targets |= {
        (Role.HALF, name): arkit[name.removesuffix("Left").removesuffix("Right")] for name in present[Role.HALF]
    }
    targets |= {
        (Role.PAIR, left): (arkit[left] + arkit[left.removesuffix("Left") + "Right"]) / 2
        for left in present[Role.PAIR] - present[Role.ARKIT]
    }
    targets = {key: weight for key, weight in targets.items() if speaks or key[1].startswith(UPPER_FACE)}
    if "eyeBlinkLeft" not in present[Role.ARKIT]:
        targets[Role.BLINK, "blink"] = (arkit["eyeBlinkLeft"] + arkit["eyeBlinkRight"]) / 2
    return targets if speaks else targets | _mouth(faps, present, looks, rate_hz)


def _mouth(faps: Array, present: Mapping[Role, set[str]], looks: bool, rate_hz: float) -> Targets:
    """Weights of visemes, or of VRM's presets if there are only vowels."""
    if len(present[Role.VISEME] & set(OCULUS)) >= MIN_OCULUS:
        found = zip(visemes.OCULUS_NAMES, visemes.approximate_visemes(faps, rate_hz).T, strict=True)
        return {(Role.VISEME, OCULUS_SPELLINGS[name.lower()]): weight for name, weight in found}
    presets = dict(zip(visemes.VRM1_NAMES, visemes.approximate_presets(faps, rate_hz).T, strict=True))
    targets: Targets = {(Role.VISEME, name): presets[name] for name in visemes.VRM1_NAMES[: visemes.SHOWN]}
    shown = (*MOODS, *LOOKS) if looks else MOODS
    for older, name in zip(visemes.VRM0_NAMES, visemes.VRM1_NAMES, strict=True):
        if name in shown:
            targets[None, plain(older)] = targets[None, plain(name)] = presets[name]
    return targets
