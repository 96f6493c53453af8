"""Make what each viseme and each expression does in FAPs: the table ``fapengine/retarget/visemes.npz``.

    python -m design.fit_visemes [--write]

A viseme's row is the mean of our own planner's clear speech: each of its phones between two as long (consonants between
a, i and u, vowels between p, t and k), when its keyframe is reached, contacts included, and then a quarter larger, as
avatars' shapes are. The profile's speaker opens hardly wider for a than for e; avatars do. So vowels lean towards
published recipes for ARKit avatars (TalkingHead, MIT): a fifth of their shape, a third of their opening (a ratio). An
expression's row is the shipped profile's full expression.

Printed: how well speech comes back from the shipped table, from this fit and from others; and how far the fit is from
the shipped table. ``--write`` replaces the table, and so what every Oculus and VRM avatar does.

The shipped table is older than two of its inputs, and is kept because a new one would change every such animation. It
is the fit to the profile and planner of 23 November 2026, before the context model of ``grid_s1_en`` was fitted again
(vowels said alone open further) and before long rounded vowels got their opening (``ou`` opens 1 mm further now). Git
reproduces its values exactly: ``git checkout 48452b5~1`` and run this script there. Today's fit differs in 344 of the
952 values of visemes, by up to 52 FAPU (1.1 mm); all expressions are the same.
"""

import argparse
from pathlib import Path

import numpy as np

from design.data_files import save_table
from fapengine._arrays import read_table
from fapengine._resources import profile_files
from fapengine.expressions import STANDARD_EXPRESSIONS, Expression
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import VISEMES
from fapengine.profiles import Profile, parse_profile
from fapengine.retarget.arkit import arkit_map
from fapengine.retarget.blend import ARKIT_NAMES, BlendMap, weights_mm
from fapengine.retarget.visemes import PLAIN, RELUCTANCE_MM
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.faps import displacements_to_faps
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style

TABLE = Path(__file__).resolve().parent.parent / "fapengine" / "retarget" / "visemes.npz"
PROFILE = "grid_s1_en"
PHONES = {
    "PP": "p b m", "FF": "f v", "TH": "θ ð", "DD": "t d", "kk": "k ɡ", "CH": "tʃ dʒ ʃ ʒ", "SS": "s z", "nn": "n l",
    "RR": "ɹ", "aa": "ɑ ʌ æ", "E": "ɛ", "ih": "ɪ i", "oh": "ɔ oʊ", "ou": "u w",
}  # fmt: skip
"""English phones of each viseme, as three published tables agree; diphthongs by where they begin."""
AROUND = {"vowel": ("p", "t", "k"), "consonant": ("ɑ", "i", "u")}
VOWELS = ("aa", "E", "ih", "oh", "ou")
PHONE_S, AT = 0.15, 0.45
MOUTH = (3, *range(4, 15), 16, 17, 18, 44, 45, 46, *range(51, 61))
MIN_FAPU = 2.0
GAIN = 1.25
LEAN_SHAPE, LEAN_OPENING = 0.2, 0.33
RATE_HZ = 100.0
RECIPES = {
    "PP": {"mouthRollLower": 0.8, "mouthRollUpper": 0.8, "mouthUpperUp": 0.3},
    "FF": {
        "mouthPucker": 1.0,
        "mouthShrugUpper": 1.0,
        "mouthLowerDown": 0.2,
        "mouthDimple": 1.0,
        "mouthRollLower": 1.0,
    },
    "TH": {"mouthRollUpper": 0.6, "jawOpen": 0.2, "tongueOut": 0.4},
    "DD": {"mouthPress": 0.8, "mouthFunnel": 0.5, "jawOpen": 0.2},
    "kk": {"mouthLowerDown": 0.4, "mouthDimple": 0.3, "mouthFunnel": 0.3, "mouthPucker": 0.3, "jawOpen": 0.15},
    "CH": {"mouthPucker": 0.5, "jawOpen": 0.2},
    "SS": {"mouthPress": 0.8, "mouthLowerDown": 0.5, "jawOpen": 0.1},
    "nn": {"mouthLowerDown": 0.4, "mouthDimple": 0.3, "mouthFunnel": 0.3, "mouthPucker": 0.3, "jawOpen": 0.15},
    "RR": {"mouthPucker": 0.5, "jawOpen": 0.2},
    "aa": {"jawOpen": 0.6},
    "E": {"mouthPress": 0.8, "mouthDimple": 1.0, "jawOpen": 0.3},
    "ih": {"mouthPress": 0.6, "mouthDimple": 0.6, "jawOpen": 0.2},
    "oh": {"mouthPucker": 1.0, "jawForward": 0.6, "jawOpen": 0.2},
    "ou": {"mouthFunnel": 1.0},
}
SENTENCES = (  # held against the map, not used to make it
    "b ɹ aɪ t s ʌ n ʃ aɪ n ʃ ɪ m ɚ z ɑ n ð ə oʊ ʃ ə n",
    "p i t ɚ p ʊ t ð ə b ɪ ɡ p ʌ m p k ɪ n ə b ʌ v ð ə b ɑ ɹ n",
    "f aɪ v θ aʊ z ə n d f ɪ ʃ s w æ m θ ɹ u ð ə ɹ ɪ v ɚ v ɛ ɹ i f æ s t",
    "ʃ i tʃ oʊ z t u l ɑ ɹ dʒ dʒ u s i ɔ ɹ ɪ n dʒ ɪ z",
    "h u w ʊ d n oʊ h aʊ m ʌ tʃ w ʊ d ə w ʊ d tʃ ʌ k m u v z",
    "s eɪ ð ə ɹ ɛ d l ɛ t ɚ z ə ɡ ɛ n p l i z æ n d θ ɪ ŋ k ə v s ʌ m θ ɪ ŋ k ɑ m",
)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--write", action="store_true", help="replace the shipped table")
    asked = parser.parse_args()
    profile = parse_profile(profile_files(PROFILE))
    names = [viseme.label for viseme in VISEMES[1:]]
    spoken_rows = np.array([viseme_row(profile, name) for name in names])
    rows = GAIN * leaning(spoken_rows, recipe_rows(names), names)
    feelings = {one.name.lower(): expression_row(profile, one) for one in STANDARD_EXPRESSIONS}
    fitted = {"viseme": rounded(rows), "expression": rounded(np.array([*feelings.values()]))}
    shipped = read_table("fapengine.retarget", TABLE.name)
    choices = {
        "shipped": shipped["viseme"], "fitted": rows, "speaker's": spoken_rows,
        "speaker's * 1.25": GAIN * spoken_rows, "recipes": recipe_rows(names),
    }  # fmt: skip
    report(profile, names, choices)
    scale = weights_mm()
    for key, table in fitted.items():
        off = np.abs(table - shipped[key])
        print(
            f"{key}: fit and shipped table differ in {np.count_nonzero(off)} of {off.size} values, by up to"
            f" {off.max():.1f} FAPU ({(off * scale).max():.2f} mm)"
        )
    if asked.write:
        save_table(
            TABLE,
            {
                "viseme_names": np.array(names), "viseme": fitted["viseme"],
                "expression_names": np.array([*feelings]), "expression": fitted["expression"],
            },
        )  # fmt: skip


def leaning(rows: np.ndarray, recipes: np.ndarray, names: list[str]) -> np.ndarray:
    """Vowels on their way from the speaker's to the recipes'."""
    leant = rows.copy()
    for name in VOWELS:
        one = names.index(name)
        ours_mm, theirs_mm = opening_mm(rows[one]), opening_mm(recipes[one])
        wanted_mm = ours_mm ** (1 - LEAN_OPENING) * theirs_mm**LEAN_OPENING
        leant[one] = (1 - LEAN_SHAPE) * rows[one] * wanted_mm / ours_mm
        leant[one] += LEAN_SHAPE * recipes[one] * wanted_mm / theirs_mm
    return leant


def opening_mm(faps: np.ndarray) -> np.ndarray:
    """Between the lips' inner edges."""
    return -(faps[..., [50, 51]] * weights_mm()[[50, 51]]).sum(axis=-1)


def spoken(profile: Profile, labels: list[str], phone_s: float) -> tuple[np.ndarray, list[Phone]]:
    """FAPs at RATE_HZ of phones of one length, silence around."""
    phones = [Phone(label, 0.3 + phone_s * n, 0.3 + phone_s * (n + 1)) for n, label in enumerate(labels)]
    phones.append(Phone("_", phones[-1].end_s, phones[-1].end_s + 0.4))
    track = plan(
        PhoneTrack.from_phones(phones), profile, rng=np.random.default_rng(0), rate_hz=RATE_HZ,
        style=Style.speech_only(method="context"),
    ).track  # fmt: skip
    return track.values.astype(float), phones[:-1]


def viseme_row(profile: Profile, name: str) -> np.ndarray:
    around = AROUND["vowel" if name in VOWELS else "consonant"]
    found = []
    for phone in PHONES[name].split():
        for beside in around:
            faps, phones = spoken(profile, [beside, phone, beside], PHONE_S)
            found.append(faps[round((phones[1].start_s + AT * PHONE_S) * RATE_HZ)])
    return only_mouth(np.mean(found, axis=0))


def only_mouth(faps: np.ndarray) -> np.ndarray:
    kept = np.zeros_like(faps)
    columns = [fap.column(number) for number in MOUTH]
    kept[..., columns] = faps[..., columns]
    return symmetric(kept)


def symmetric(faps: np.ndarray) -> np.ndarray:
    """Both sides alike: shapes of avatars are, and the profile's one speaker is not."""
    evened = faps.copy()
    for row in fap.FAPS:
        left = row.name.replace("_l_", "_r_").replace("_lm", "_rm").replace("to_r", "to_r")
        twin = next((other for other in fap.FAPS if other.name == left and other.number != row.number), None)
        if twin is not None:
            mean = (faps[..., fap.column(row.number)] + faps[..., fap.column(twin.number)]) / 2
            evened[..., fap.column(row.number)] = evened[..., fap.column(twin.number)] = mean
    evened[..., fap.column(15)] = 0.0
    return evened


def expression_row(profile: Profile, expression: Expression) -> np.ndarray:
    face = profile.expressions[expression]
    space = profile.space
    points = displacements_to_faps(space.to_points_mm(face.target[None]), space.points, profile.fapu)[0]
    return symmetric(points + face.fap)


def rounded(rows: np.ndarray) -> np.ndarray:
    """(N, 68) as the table holds them: no visemes or expressions, one decimal, small values left out."""
    table = rows.copy()
    table[:, : fap.column(3)] = 0.0
    return np.where(np.abs(table) >= MIN_FAPU, np.round(table, 1), 0.0)


def recipe_rows(names: list[str]) -> np.ndarray:
    arkit, rows = arkit_map(), []
    for name in names:
        weights = np.zeros(len(ARKIT_NAMES))
        for shape, weight in RECIPES[name].items():
            for spelled in (shape, f"{shape}Left", f"{shape}Right"):
                if spelled in ARKIT_NAMES:
                    weights[ARKIT_NAMES.index(spelled)] = weight
        rows.append(only_mouth(arkit.to_faps(weights)))
    return np.array(rows)


def report(profile: Profile, names: list[str], choices: dict[str, np.ndarray]) -> None:
    frames, said = [], []
    viseme_of = {phone: name for name, phones in PHONES.items() for phone in phones.split()}
    for sentence in SENTENCES:
        faps, phones = spoken(profile, sentence.split(), 0.09)
        for phone in phones:
            if phone.label in viseme_of:
                said.append(viseme_of[phone.label])
                frames.append(faps[round((phone.start_s + AT * phone.duration_s) * RATE_HZ)])
    wanted = only_mouth(np.array(frames))
    spoken_as = np.array(said)
    scale = weights_mm()
    print(f"{len(said)} phones; lengths of what is wanted {np.linalg.norm(wanted * scale, axis=1).mean():.1f} mm")
    for reluctance_mm in (RELUCTANCE_MM, 0.0):
        for title, table in choices.items():
            cost = [0.0 if name in PLAIN else reluctance_mm for name in names]
            shapes = BlendMap(tuple(names), table, reluctance_mm=np.array(cost))
            weights = shapes.approximate_weights(wanted)
            weights /= np.maximum(weights.sum(axis=1), 1.0)[:, None]
            back = shapes.to_faps(weights)
            off_mm = np.abs(opening_mm(back) - opening_mm(wanted))
            best = np.array(names)[weights.argmax(axis=1)]
            own = {
                name: round(float(weights[spoken_as == name, names.index(name)].mean()), 2)
                for name in ("PP", "FF", "SS", *VOWELS)
            }
            print(
                f"{title:17} {reluctance_mm:.1f}: off {np.linalg.norm((back - wanted) * scale, axis=1).mean():.2f} mm,"
                f" opening {off_mm.mean():.2f} mm, at p b m {off_mm[spoken_as == 'PP'].mean():.2f} mm; strongest is"
                f" spoken {np.mean(best == spoken_as):.0%}; own weight {own}"
            )


if __name__ == "__main__":
    main()
