"""What ``fapengine-face/live`` has from Python's modules: ``constants.js`` and two files of tables; and its worker.

``words-en`` has a table of English besides. ``python -m design.face_package`` calls :func:`write`; none of these
numbers is typed by hand.

A file of tables has ``FAPLIVE1``, the length of a JSON text (uint32, little-endian), the text, and its arrays. The text
lists each array with kind, shape and offset after the text; both are padded with spaces or zeros to a multiple of 8.
"""

import json
import re
import shutil
import struct
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine import speaking
from fapengine.expressions import EXPRESSION_NAMES
from fapengine.files.profiles import load_profile
from fapengine.host import hearing
from fapengine.host import words as host_words
from fapengine.mpeg4 import fap, fapu
from fapengine.mpeg4.track import _codable_range
from fapengine.profiles import Profile
from fapengine.recognition import loudness, protocol, small_net, small_recognizer
from fapengine.speaking import DEFAULT_PROFILE
from fapengine.speech import ipa, phone_track, prosody
from fapengine.speech.alphabets import phone_sets
from fapengine.speech.alphabets.phone_set import PhoneSet
from fapengine.speech.articulation import ARTICULATIONS
from fapengine.speech.formats import entries, services
from fapengine.trajectory import (
    closures,
    context,
    expression,
    gestures,
    hermite,
    phonetics,
    ramps,
    stream,
    style,
    targets,
    variation,
)
from fapengine.trajectory.expression import expression_faps
from fapengine.trajectory.faps import speech_faps
from fapengine.trajectory.style import jaw_share
from fapengine.voices import pronounce, spoken_form

MAGIC = b"FAPLIVE1"
MODULES: dict[str, ModuleType] = {
    module.__name__.rpartition(".")[2]: module
    for module in (
        closures, context, expression, fap, fapu, gestures, hearing, hermite, ipa, loudness, phone_track,
        phonetics, prosody, protocol, ramps, small_net, small_recognizer, speaking, stream, style, targets, entries,
        phone_sets, pronounce, services, variation,
    )
} | {"host_words": host_words}  # fmt: skip
"""Modules with constants that the JavaScript imports, by the name that it uses."""
WORDS = Path(__file__).with_name("words-en.bin")
"""Network, dictionary and stresses of ``words-en``: ``bench.words_train``, then ``bench.words_stress``."""
FROM = re.compile(r"import {([^}]*)} from \"./([^\"]+)\";")
EXPORTED = re.compile(r"^export (?:class|const|function) (\w+)", re.MULTILINE)
IMPORTED = re.compile(r"import {([^}]*)} from \"./constants.js\";")


def write(package: Path) -> None:
    """Write the numbers into a folder of the package."""
    assets = package / "assets"
    assets.mkdir(exist_ok=True)
    head = "// Made by python -m design.face_package (design/live_tables.py).\n"
    constants_file = package / "live" / "constants.js"
    values_of = constants(package / "live")
    lines = [f"export const {name} = {json.dumps(values)};\n" for name, values in values_of.items()]
    constants_file.write_text(head + "".join(lines), encoding="utf-8")
    worker = joined(package / "live", "worker-source.js")
    (package / "live" / "worker.js").write_text(head + worker, encoding="utf-8")
    (package / "live" / "worker-source.js").unlink()
    profile = load_profile(DEFAULT_PROFILE)
    (assets / "planner.bin").write_bytes(packed(*planner_tables(profile)))
    (assets / "planner.bin.license").write_text(
        f"{profile.licence}\n{profile.origin['attribution']}\n", encoding="utf-8"
    )
    (assets / "recognizer.bin").write_bytes(packed(*recognizer_tables()))
    shutil.copy(small_net.WEIGHTS.with_name(f"{small_net.WEIGHTS.name}.license"), assets / "recognizer.bin.license")
    (package / "words-en" / "table.js").write_text(
        f"{head}export const SPOKEN = {json.dumps(spoken_table(), ensure_ascii=False)};\n", encoding="utf-8"
    )
    for name in (WORDS.name, f"{WORDS.name}.license"):
        shutil.copy(WORDS.with_name(name), assets)


def joined(source: Path, name: str) -> str:
    """Join a script and the modules that it imports, each a function, to one that imports nothing."""
    modules: dict[str, str] = {}

    def add(file: str) -> None:
        text = (source / file).read_text(encoding="utf-8")
        for _, other in FROM.findall(text):
            if other not in modules:
                add(other)
        exported = EXPORTED.findall(text)
        text = FROM.sub(lambda found: f'const {{{found[1].replace(" as ", ": ")}}} = modules["{found[2]}"];', text)
        text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
        modules[file] = f'modules["{file}"] = (() => {{\n{text}return {{ {", ".join(exported)} }};\n}})();\n'

    add(name)
    return f'"use strict";\nconst modules = {{}};\n{"".join(modules.values())}'


def constants(source: Path) -> dict[str, dict[str, Any]]:
    """Constants that the JavaScript of a folder imports, by module; a leading underscore is left out."""
    values: dict[str, dict[str, Any]] = {}
    for path in sorted(source.glob("*.js")):
        text = path.read_text(encoding="utf-8")
        for imported in IMPORTED.findall(text):
            for module, _, alias in (name.partition(" as ") for name in re.split(r",\s*", imported.strip())):
                local = alias or module
                taken = re.findall(rf"const {{([^}}]*)}} = {local};", text)
                names = {name.split(":")[0].strip() for list_ in taken for name in list_.split(",")} - {""}
                names |= set(re.findall(rf"\b{local}\.([A-Z][A-Z0-9_]*)\b", text))
                values.setdefault(module, {}).update((name, _constant(module, name)) for name in sorted(names))
    return values


def _constant(module: str, name: str) -> Any:
    found = vars(MODULES[module])
    value = found[name] if name in found else found[f"_{name}"]
    if isinstance(value, dict) and any(isinstance(key, tuple) for key in value):
        return list(value.items())
    if isinstance(value, PhoneSet):
        return value.table
    return sorted(value) if isinstance(value, frozenset) else value


def spoken_table() -> dict[str, Any]:
    """English's table of :mod:`fapengine.voices.spoken_form`, with its patterns as JavaScript spells them."""
    table = dict(spoken_form._table("en"))
    kinds = [{"kind": kind} for kind in ("date", "phone", "before", "after", "fraction")]
    listed = [{"say": rule["say"]} | ({"form": rule["form"]} if "form" in rule else {}) for rule in table.pop("rules")]
    del table["mixed"]  # rules, too
    kinds += [*listed, {"kind": "unit"}, {"kind": "word"}]
    rules = zip(spoken_form._rules("en"), kinds, strict=True)
    return table | {"patterns": [{"find": javascript(rule.pattern.pattern)} | kind for rule, kind in rules]}


def javascript(pattern: str) -> str:
    r"""A regular expression of Python as JavaScript spells it.

    Examples
    --------
    >>> print(javascript(r"(?P<n>(?>\d+))x\Z"))
    (?=(?<n>(?:\d+)))\k<n>x$
    """
    pattern = pattern.replace(r"\Z", "$").replace(r"\ ", " ")
    pattern = re.sub(
        r"\(\?P<n>\(\?>((?:[^()]|\([^()]*(?:\([^()]*\)[^()]*)*\))*)\)\)", r"(?=(?<n>(?:\1)))\\k<n>", pattern
    )
    return re.sub(r"\(\?P=(\w+)\)", r"\\k<\1>", pattern).replace("(?P<", "(?<")


def planner_tables(profile: Profile) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Gather what the planner needs of a profile: names and small tables, and arrays."""
    model = profile.context
    assert model is not None, f"profile {profile.id}: got no context model, expected one"
    known = tuple(profile.phones)
    letters = {}
    for letter in ipa.SOUNDS:
        ((name, _),), _ = context.spelled(letter, known)
        letters[letter] = {
            "contact": profile.phones[name].contact,
            "opens": targets.must_open(letter),
            "glides": letter in targets.GLIDES,
            "ways": context.ways(letter),
        }
    about = {
        "fractions": model.fractions,
        "features": model.features,
        "exampleLetters": model.examples.letters,
        "letters": letters,
        "rows": {letter: row for row, letter in enumerate(ARTICULATIONS)},
        "whole": {name: targets.contact_of(context.spelled(name, known)[0], profile) for name in known},
        "silent": context.ways(phone_track.SILENCE),
        "sibilants": sorted(targets.SIBILANTS),
        "expressionNames": EXPRESSION_NAMES,
    }
    coefficients = model.coefficients.reshape(len(model.features), -1)
    halves = coefficients.astype(np.float16)
    low, high = _codable_range()
    return about, {
        "exampleLengths": model.examples.lengths.astype(np.float16),
        "exampleAdds": model.examples.adds.reshape(len(model.examples.letters), -1).astype(np.float16),
        "coefficients": halves if np.array_equal(halves, coefficients) else coefficients,
        "modes": speech_faps(profile, np.eye(profile.space.mode_count)),
        "jaws": jaw_share(profile),
        "layer": phonetics.layer_faps(profile),
        "values": phonetics.values_of(profile),
        "insists": phonetics._INSISTS,
        "timesMore": phonetics._TIMES_MORE,
        "puckered": phonetics._PUCKERED,
        "expressions": expression_faps(profile).T,
        "low": low,
        "high": high,
    }


def recognizer_tables() -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Gather the small recognizer's weights, (outputs, inputs) int8 with a scale for each row, and its other tables."""
    weights = small_net.shipped()
    layers = {"front": weights.front, "head": weights.head}
    layers |= {f"mix{number}": layer for number, layer in enumerate(weights.mix)}
    layers |= {f"out{number}": layer for number, layer in enumerate(weights.out)}
    search = small_recognizer.Search(weights)
    arrays: dict[str, NDArray[Any]] = {
        "firstMean": weights.first_mean,
        "bonus": search._bonus,
        "order": search._order,
        "filters": small_net._FILTERS,
        "window": small_net._WINDOW / 2**15,
    }
    for name, (matrix, bias) in layers.items():
        rows = matrix.T.astype(np.float64)
        scale = np.abs(rows).max(axis=1) / 127
        arrays[f"{name}.matrix"] = np.rint(rows / np.maximum(scale, 1e-30)[:, None]).astype(np.int8)
        arrays[f"{name}.scale"], arrays[f"{name}.bias"] = scale.astype(np.float32), bias
    return {"labels": weights.labels, "offsets": small_net.OFFSETS}, arrays


def packed(about: dict[str, Any], arrays: dict[str, NDArray[Any]]) -> bytes:
    """Write a file of tables."""
    places: dict[str, object] = {}
    data = b""
    for name, array in arrays.items():
        places[name] = {"kind": str(array.dtype), "shape": array.shape, "offset": len(data)}
        raw = np.ascontiguousarray(array).tobytes()
        data += raw + bytes(-len(raw) % 8)
    text = json.dumps(about | {"arrays": places}, ensure_ascii=False, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-(len(MAGIC) + 4 + len(text)) % 8)
    return MAGIC + struct.pack("<I", len(text)) + text + data
