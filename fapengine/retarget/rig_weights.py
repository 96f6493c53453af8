"""FAPs to the blendshapes of a rig, by name: ARKit's shapes, Oculus' visemes, VRM's presets, or those of a mapping.

A rig with enough of ARKit's shapes uses these. Any other uses visemes or vowels for the mouth, and its ARKit shapes for
eyes and brows, or VRM's moods. A shape with two names in a file moves once in each mesh.

Names in any convention (``mouthSmile_L``, ``MouthSmileLeft``, ``vrc.v_aa``, ``Blink_L``) are compared in lower case by
their letters and digits only; a final ``L`` or ``R`` becomes ``Left`` or ``Right``, and prefixes of known exporters are
removed.
"""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from fapengine._arrays import Array, frozen
from fapengine.mpeg4 import fap
from fapengine.retarget import visemes
from fapengine.retarget.arkit import approximate_arkit
from fapengine.retarget.blend import ARKIT_NAMES, BlendMap

PREFIXES = (
    "blendshape1.", "blendshape.", "blendshapes.", "ctrl_expressions_", "face_", "head_", "shape_", "arkit_", "bs_",
    "m_",
)  # fmt: skip
"""Prefixes that exporters add, in lower case."""
SIDES = {"l": "Left", "r": "Right"}
ALIASES = {
    "eyesclosed": "blink", "vrcblink": "blink", "vrcblinkleft": "eyeblinkleft", "vrcblinkright": "eyeblinkright",
    "eyeclosedleft": "eyeblinkleft", "eyeclosedright": "eyeblinkright", "まばたき": "blink", "あ": "a", "い": "i",
    "う": "u", "え": "e", "お": "o",
    "eyeclose": "blink", "eyesblink": "blink", "eyeblink": "blink", "blinkleft": "eyeblinkleft",
    "blinkright": "eyeblinkright", "mouthopen": "jawopen", "fclmtha": "a", "fclmthi": "i", "fclmthu": "u",
    "fclmthe": "e", "fclmtho": "o", "fcleyeclose": "blink", "fcleyecloseleft": "eyeblinkleft",
    "fcleyecloseright": "eyeblinkright",
}  # fmt: skip
"""Other names of a blendshape: Ready Player Me, VRM, VRoid, VRChat, face tracking and MikuMikuDance."""
GAZE = re.compile(r"eyelook.*|look(up|down|left|right)|pupildilate.*")
"""Blendshapes that turn eyeballs or dilate pupils, which are not blended: FAPs rotate the eyeballs."""
MIN_WITHOUT_VISEMES = 20
"""Number of ARKit's blendshapes from which a file needs no visemes."""
TONGUE_FAP, TONGUE_FAPU = 45, 1024.0
"""Meaning of ARKit's tongueOut: one mouth width forwards."""
UNUSED = "unused"
"""Meaning, in a mapping, of a blendshape that should not move."""


def plain(name: str) -> str:
    """Normalise a name for comparison; aliases become the usual name.

    Examples
    --------
    >>> plain("browDown_L"), plain("Blink_L"), plain("MouthOpen"), plain("blendShape1.JawOpen")
    ('browdownleft', 'eyeblinkleft', 'jawopen', 'jawopen')
    """
    return ALIASES.get(bare(name), bare(name))


def bare(name: str) -> str:
    """Normalise a name without aliases."""
    for prefix in PREFIXES:
        name = name[len(prefix) :] if name.lower().startswith(prefix) else name
    side = re.fullmatch(r"(.*[a-z])[ ._-]([LlRr])", name) or re.fullmatch(r"(.*[a-z])([LR])", name)
    if side:
        name = side[1] + SIDES[side[2].lower()]
    return "".join(character for character in name.lower() if character.isalnum())


OCULUS = ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "I", "O", "U")
OCULUS_SPELLINGS = {name.lower(): name for name in OCULUS} | {"ih": "I", "oh": "O", "ou": "U"}
OCULUS_BEGINNINGS = ("viseme", "vrcv", "v")
VOWELS = {"a": "aa", "i": "ih", "u": "ou", "e": "ee", "o": "oh"}
"""VRM 1.0's names of the mouth's expressions, by VRM 0.x's."""


class Role(Enum):
    """Function of a blendshape, by its name."""

    ARKIT = "it is one of ARKit's"
    SUBSTITUTE = "it replaces one of ARKit's"
    HALF = "it is one side of one of ARKit's"
    PAIR = "it is both sides of one of ARKit's"
    BLINK = "it closes both eyes"
    VISEME = "it is a viseme of Oculus, or a vowel of VRM"


OCULUS_PLAIN = {
    start + plain_name: name for start in OCULUS_BEGINNINGS for plain_name, name in OCULUS_SPELLINGS.items()
}
"""Oculus' visemes by names as returned by :func:`plain`."""
NAME_RULES: tuple[tuple[Role, dict[str, str]], ...] = (
    (Role.ARKIT, {plain(name): name for name in ARKIT_NAMES}),
    (Role.SUBSTITUTE, {"cheekraiserleft": "cheekSquintLeft", "cheekraiserright": "cheekSquintRight"}),  # ICT-FaceKit
    (Role.HALF, {plain(name + side): name + side for name in ARKIT_NAMES for side in SIDES.values()}),
    (Role.PAIR, {plain(name).removesuffix("left"): name for name in ARKIT_NAMES if name.endswith("Left")}),
    (Role.BLINK, {"blink": "blink"}),
    (Role.VISEME, OCULUS_PLAIN | VOWELS | {vowel: vowel for vowel in VOWELS.values()}),
)
"""Names as returned by :func:`plain`, and the meaning of each, by role; the first role with a name applies."""


def viseme(name: str) -> str | None:
    """Return the viseme of Oculus, or the vowel of VRM, that a name means; None for other names.

    Examples
    --------
    >>> viseme("vrc.v_aa"), viseme("viseme_PP"), viseme("A"), viseme("jawOpen")
    ('aa', 'PP', 'aa', None)
    """
    return dict(NAME_RULES)[Role.VISEME].get(plain(name))


@dataclass(frozen=True, slots=True)
class Choice:
    """Blendshapes of a file by function."""

    left: tuple[str, ...]
    """Blendshape that closes the left lids, if any."""
    right: tuple[str, ...]
    """Blendshape that closes the right lids, if any."""
    both: tuple[str, ...]
    """Blendshape that closes all four, if any."""
    jaw: tuple[str, ...]
    """Blendshapes that open the mouth; the first is the best."""
    blended: tuple[str, ...]
    """Blendshapes to blend so that feature points go where FAPs say."""
    own_faps: Mapping[str, Mapping[int, float]]
    """Blendshapes that are defined by FAPs: FAPU at full weight."""
    missing: tuple[str, ...]
    """ARKit's names without a blendshape."""


def choose_blendshapes(names: Iterable[str], mapping: Mapping[str, str | Mapping[int, float]] | None = None) -> Choice:
    """Choose blendshapes by name.

    Parameters
    ----------
    names : iterable of str
        Names in the file.
    mapping : mapping of str to str, or to FAPs, optional
        Meaning of other names: one of ARKit's names, a viseme of Oculus or VRM, ``unused``, or FAPU at full weight by
        FAP number.
    """
    own_faps = {name: meaning for name, meaning in (mapping or {}).items() if not isinstance(meaning, str)}
    words = {name: word for name, word in (mapping or {}).items() if isinstance(word, str)}
    found = by_role([name for name in names if name not in own_faps and words.get(name) != UNUSED], words)
    arkit, visemes = found[Role.ARKIT], found[Role.VISEME]
    without = [name for name in ARKIT_NAMES if name not in arkit | found[Role.SUBSTITUTE]]
    halved = {name.removesuffix("Left").removesuffix("Right") for name in found[Role.HALF]}
    tongue = arkit.pop("tongueOut", None)
    if tongue is not None:
        own_faps[tongue] = {TONGUE_FAP: TONGUE_FAPU}
    blended = [name for target, name in arkit.items() if not GAZE.fullmatch(plain(target))]
    blended += [*found[Role.SUBSTITUTE].values(), *found[Role.HALF].values()]
    blended += [name for left, name in found[Role.PAIR].items() if left not in arkit]
    both = tuple(found[Role.BLINK].values())
    few = len(blended) < MIN_WITHOUT_VISEMES
    if few or "jawOpen" not in arkit:
        blended += [name for target, name in visemes.items() if target != "sil"]
    if few:
        blended += [] if "eyeBlinkLeft" in arkit else both
    jaws = (arkit.get("jawOpen"), visemes.get("aa"), visemes.get("O"), visemes.get("oh"))
    return Choice(
        left=tuple(filter(None, [arkit.get("eyeBlinkLeft")])),
        right=tuple(filter(None, [arkit.get("eyeBlinkRight")])),
        both=both,
        jaw=tuple(filter(None, jaws)),
        blended=tuple(dict.fromkeys(blended)),
        own_faps=own_faps,
        missing=tuple(name for name in without if name not in halved),
    )


def is_arkit(found: Mapping[Role, Collection[str]]) -> bool:
    """Whether names by role, such as those of :func:`by_role`, include enough of ARKit's to need no visemes."""
    return sum(len(found[role]) for role in (Role.ARKIT, Role.SUBSTITUTE, Role.HALF, Role.PAIR)) >= MIN_WITHOUT_VISEMES


def by_role(names: Iterable[str], words: Mapping[str, str]) -> dict[Role, dict[str, str]]:
    """Names by role and meaning; mapped names take precedence, then ARKit's own."""
    arkit = dict(NAME_RULES)[Role.ARKIT]
    found: dict[Role, dict[str, str]] = {role: {} for role in Role}
    for name in sorted(names, key=lambda name: (name not in words, bare(name) not in arkit)):
        meant = plain(words.get(name, name))
        for role, targets in NAME_RULES:
            if meant in targets:
                found[role].setdefault(targets[meant], name)
                break
    return found


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
