"""What a file calls its shapes, whoever named them: ``mouthSmile_L``, ``MouthSmileLeft``, ``vrc.v_aa``, ``Blink_L``.

Names are compared by their letters and digits alone, in small letters; a last ``L`` or ``R`` behind a separator is
spelled out, and prefixes of known exporters are taken off.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

PREFIXES = (
    "blendShape1.",
    "blendShape.",
    "blendshapes.",
    "CTRL_expressions_",
    "face_",
    "head_",
    "shape_",
    "ARKit_",
    "bs_",
    "m_",
)
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
"""Other spellings of one shape: those of Ready Player Me, VRM, VRoid, VRChat, face tracking and MikuMikuDance."""
KIN = {"cheekraiserleft": "cheekSquintLeft", "cheekraiserright": "cheekSquintRight"}
"""Shapes of ICT-FaceKit beside ARKit's, and what they stand for where that is lacking."""
HALVES = ("left", "right")
"""Ends of names that halve one of ARKit's shapes, such as ICT-FaceKit's ``browInnerUp_L``; others join two of them,
such as ``mouthSmile``."""
OCULUS = ("sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "I", "O", "U")
OCULUS_BEGINNINGS = ("viseme", "vrcv", "v")
VOWELS = {"a": "aa", "i": "ih", "u": "ou", "e": "ee", "o": "oh"}
"""VRM 0.x's names of the mouth's expressions, and VRM 1.0's."""
GAZE = re.compile(r"eyelook.*|look(up|down|left|right)|pupildilate.*")
"""Shapes that turn eyeballs or widen pupils: eyes turn about their balls here."""
ENOUGH = 20
"""With so many of ARKit's shapes a file needs no visemes."""
TONGUE_FAP, TONGUE_FAPU = 45, 1024.0
"""What ARKit's tongueOut means: one mouth's width forwards."""
UNUSED = "unused"
"""What a mapping says of a shape that shall stand still."""


def plain(name: str) -> str:
    """Spell a name as names are compared, and the usual one of its spellings.

    Examples
    --------
    >>> plain("browDown_L"), plain("Blink_L"), plain("MouthOpen"), plain("blendShape1.JawOpen")
    ('browdownleft', 'eyeblinkleft', 'jawopen', 'jawopen')
    """
    bare = _bare(name)
    return ALIASES.get(bare, bare)


def _bare(name: str) -> str:
    for prefix in PREFIXES:
        name = name[len(prefix) :] if name.lower().startswith(prefix.lower()) else name
    side = re.fullmatch(r"(.*[a-z])[ ._-]([LlRr])", name) or re.fullmatch(r"(.*[a-z])([LR])", name)
    if side:
        name = side[1] + SIDES[side[2].lower()]
    return "".join(letter for letter in name.lower() if letter.isalnum())


def viseme(name: str) -> str | None:
    """Tell which of Oculus' 15 visemes a name means, or which of VRM's five vowels; None for neither.

    Examples
    --------
    >>> viseme("vrc.v_aa"), viseme("viseme_PP"), viseme("A"), viseme("jawOpen")
    ('aa', 'PP', 'aa', None)
    """
    bare = plain(name)
    spelled = {one.lower(): one for one in OCULUS} | {"ih": "I", "oh": "O", "ou": "U"}
    for beginning in OCULUS_BEGINNINGS:
        if bare.startswith(beginning) and bare[len(beginning) :] in spelled:
            return spelled[bare[len(beginning) :]]
    if bare in VOWELS:
        return VOWELS[bare]
    return bare if bare in VOWELS.values() else None


@dataclass(frozen=True, slots=True)
class Choice:
    """Which of a file's shapes do what."""

    left: tuple[str, ...]
    """Close the left lids."""
    right: tuple[str, ...]
    both: tuple[str, ...]
    """Close all four."""
    jaw: tuple[str, ...]
    """Opens the mouth; the first is the best."""
    blended: tuple[str, ...]
    """Are blended so that feature points go where FAPs say."""
    given: Mapping[str, Mapping[int, float]]
    """Mean FAPs by themselves: FAPU at full weight."""
    missing: tuple[str, ...]
    """Wanted names that no shape has."""


def choose(
    names: Iterable[str], wanted: Sequence[str], mapping: Mapping[str, str | Mapping[int, float]] | None = None
) -> Choice:
    """Choose shapes by their names.

    Parameters
    ----------
    names : iterable of str
        Of the file.
    wanted : sequence of str
        ARKit's 52.
    mapping : mapping of str to str, or to FAPs, optional
        What else a shape of the file means: one of ``wanted``, a viseme of Oculus or VRM, ``unused``, or FAP numbers
        and their FAPU at full weight.
    """
    listed = list(names)
    said = dict(mapping or {})
    faps = {name: values for name, values in said.items() if not isinstance(values, str)}
    words = {name: value for name, value in said.items() if isinstance(value, str)}
    spelled = {plain(one): one for one in wanted}
    known: dict[str, str] = {}
    mouths: dict[str, str] = {}
    halves: dict[str, str] = {}
    kin: dict[str, str] = {}
    wholes: dict[str, str] = {}
    blink = []
    for name in sorted(listed, key=lambda one: (one not in words, _bare(one) not in spelled)):  # the surest go first
        if name in faps or words.get(name) == UNUSED:
            continue
        bare = plain(words.get(name, name))
        if bare in spelled:
            known.setdefault(spelled[bare], name)
        elif bare in KIN:
            kin[KIN[bare]] = name
        elif bare.endswith(HALVES) and bare.removesuffix("left").removesuffix("right") in spelled:
            halves.setdefault(bare, name)
        elif bare + HALVES[0] in spelled and bare != "eyeblink":
            wholes.setdefault(bare, name)
        elif bare == "blink":
            blink.append(name)
        elif mouth := viseme(words.get(name, name)):
            mouths.setdefault(mouth, name)
    halved = {bare.removesuffix("left").removesuffix("right") for bare in halves}
    tongue = known.pop("tongueOut", None)
    if tongue is not None:
        faps[tongue] = {TONGUE_FAP: TONGUE_FAPU}
    blended = [name for one, name in known.items() if not GAZE.fullmatch(plain(one))]
    blended += [*kin.values(), *halves.values()]
    blended += [name for bare, name in wholes.items() if spelled[bare + HALVES[0]] not in known]
    if len(blended) < ENOUGH:
        blended += [name for mouth, name in mouths.items() if mouth != "sil"]
        blended += [] if "eyeBlinkLeft" in known else blink[:1]
    jaws = [known.get("jawOpen"), mouths.get("aa"), mouths.get("O"), mouths.get("oh")]
    found = {*known, *kin, *(spelled[bare] for bare in halved), *(["tongueOut"] if tongue else [])}
    return Choice(
        left=tuple(filter(None, [known.get("eyeBlinkLeft")])),
        right=tuple(filter(None, [known.get("eyeBlinkRight")])),
        both=tuple(blink[:1]),
        jaw=tuple(filter(None, jaws)),
        blended=tuple(dict.fromkeys(blended)),
        given=faps,
        missing=tuple(one for one in wanted if one not in found),
    )
