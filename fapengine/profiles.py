"""Profiles: the data that make one face speak one language. Strict: a wrong or unknown key is a :class:`ProfileError`.

A profile is a folder, ``profile.toml`` and ``modes.npz``. It carries the FAPU of the recorded face, so its motion suits
any other.
"""

import hashlib
import io
import tomllib
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine.errors import ProfileError, UsageError
from fapengine.models.viseme_space import VisemeSpace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES
from fapengine.mpeg4.visemes import Expression
from fapengine.speech import ipa

SCHEMA = 1
TOML_NAME = "profile.toml"
CONTACTS = ("none", "lips", "teeth")
"""What a phone must touch: nothing, lip on lip (p b m), lower lip on upper teeth (f v)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PhoneTarget:
    """Where one phone lies in the viseme space."""

    ipa: str
    """One IPA letter, or several for a diphthong or an affricate."""
    fractions: tuple[float, ...]
    """Where in the phone its keyframes stand, 0..1, rising."""
    targets: NDArray[np.float64]
    """(keyframes, K) mode weights."""
    contact: str
    """One of :data:`CONTACTS`."""
    origin: str
    """How it was found."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExpressionTarget:
    """One of the six expressions at full strength."""

    target: NDArray[np.float64]
    """(K,) mode weights."""
    fap: NDArray[np.float64]
    """(68,) FAPU: what the face does beyond the modes (brows, lids, cheeks, nose)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Profile:
    """All that one face needs to speak one language."""

    id: str
    language: str
    licence: str
    origin: Mapping[str, str]
    fapu: Fapu
    space: VisemeSpace
    phones: Mapping[str, PhoneTarget]
    """By IPA."""
    expressions: Mapping[Expression, ExpressionTarget]


class _Table:
    """Stateful: one TOML table, read key by key; what is left over is an error."""

    def __init__(self, values: object, where: str) -> None:
        if not isinstance(values, dict):
            raise ProfileError(f"got {type(values).__name__}, expected a table", where=where)
        self._values = dict(values)
        self._where = where

    def where(self, key: str) -> str:
        return f"{self._where}{key}"

    def take(self, key: str, kind: type) -> Any:
        if key not in self._values:
            raise ProfileError(f"key {key!r} is missing", where=self.where(key))
        value = self._values.pop(key)
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ProfileError(f"got {value!r:.60}, expected a {kind.__name__}", where=self.where(key))
        return value

    def numbers(self, key: str, shape: tuple[str | int, ...]) -> NDArray[np.float64]:
        try:
            return frozen(self.take(key, list), key, shape, np.float64)
        except UsageError as error:
            raise ProfileError(str(error), where=self.where(key)) from error

    def rest(self) -> dict[str, Any]:
        values, self._values = self._values, {}
        return values

    def finish(self) -> None:
        if self._values:
            key = next(iter(self._values))
            raise ProfileError(f"key {key!r} is unknown", where=self.where(key))


def parse_profile(files: Mapping[str, bytes]) -> Profile:
    """Read a profile.

    Parameters
    ----------
    files : mapping of str to bytes
        ``profile.toml`` and the array file that it names.

    Raises
    ------
    ProfileError
        For anything missing, unknown, of the wrong shape or with the wrong hash; ``where`` is file and key.
    """
    if TOML_NAME not in files:
        raise ProfileError(f"got files {sorted(files)}, expected {TOML_NAME} among them", where=TOML_NAME)
    try:
        document = tomllib.loads(files[TOML_NAME].decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ProfileError(f"is not TOML: {error}", where=TOML_NAME) from error
    table = _Table(document, f"{TOML_NAME}, ")
    if (schema := table.take("schema", int)) != SCHEMA:
        raise ProfileError(f"schema: got {schema}, expected {SCHEMA}", where=table.where("schema"))
    origin = _origin(_Table(table.take("origin", dict), table.where("origin.")))
    space = _space(_Table(table.take("modes", dict), table.where("modes.")), files)
    profile = Profile(
        id=table.take("id", str),
        language=table.take("language", str),
        licence=table.take("licence", str),
        origin=MappingProxyType(origin),
        fapu=_fapu(_Table(table.take("fapu_mm", dict), table.where("fapu_mm."))),
        space=space,
        phones=MappingProxyType(_phones(table.take("phone", list), table.where("phone"), space.mode_count)),
        expressions=MappingProxyType(
            _expressions(table.take("expression", list), table.where("expression"), space.mode_count)
        ),
    )
    table.finish()
    return profile


def _origin(table: _Table) -> dict[str, str]:
    origin = table.rest()
    for key, value in origin.items():
        if not isinstance(value, str):
            raise ProfileError(f"got {value!r}, expected text", where=table.where(key))
    for key in ("source", "command"):
        if key not in origin:
            raise ProfileError(f"key {key!r} is missing: no numbers without a birthplace", where=table.where(key))
    return origin


def _fapu(table: _Table) -> Fapu:
    lengths = {f"{name}_mm": table.take(name, float) for name in ("irisd0", "es0", "ens0", "mns0", "mw0")}
    table.finish()
    try:
        return Fapu(**lengths)
    except UsageError as error:
        raise ProfileError(str(error), where=table.where("")) from error


def _space(table: _Table, files: Mapping[str, bytes]) -> VisemeSpace:
    name, digest, count = table.take("file", str), table.take("sha256", str), table.take("count", int)
    points = tuple(table.take("points", list))
    marker_count = table.take("markers", int)
    table.finish()
    if name not in files:
        raise ProfileError(f"file {name!r} is missing; got {sorted(files)}", where=table.where("file"))
    if (found := hashlib.sha256(files[name]).hexdigest()) != digest:
        raise ProfileError(f"sha256 of {name}: got {found}, expected {digest}", where=table.where("sha256"))
    unknown = [point for point in points if point not in FEATURE_POINT_NAMES]
    if unknown:
        raise ProfileError(f"got {unknown}, expected feature points", where=table.where("points"))
    try:
        with np.load(io.BytesIO(files[name]), allow_pickle=False) as arrays:
            modes = frozen(arrays["modes_mm"], "modes_mm", (count, len(points), 3), np.float64)
        return VisemeSpace(points=points, marker_count=marker_count, modes_mm=modes)
    except (KeyError, ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise ProfileError(f"{name}: {error}", where=table.where("file")) from error


def _phones(rows: list[Any], where: str, count: int) -> dict[str, PhoneTarget]:
    phones: dict[str, PhoneTarget] = {}
    for index, row in enumerate(rows):
        table = _Table(row, f"{where}[{index}].")
        name = table.take("ipa", str)
        letters = ipa.letters(name)
        if "".join(letters) != name or not letters or name in phones:
            raise ProfileError(f"got {name!r}, expected bare IPA, once", where=table.where("ipa"))
        fractions = table.numbers("fractions", ("keyframes",))
        if not len(fractions) or (np.diff(fractions) <= 0).any() or fractions.min() < 0 or fractions.max() > 1:
            raise ProfileError(f"got {fractions.tolist()}, expected rising 0..1", where=table.where("fractions"))
        contact = table.take("contact", str)
        if contact not in CONTACTS:
            raise ProfileError(f"got {contact!r}, expected one of {CONTACTS}", where=table.where("contact"))
        phones[name] = PhoneTarget(
            ipa=name,
            fractions=tuple(fractions.tolist()),
            targets=table.numbers("targets", (len(fractions), count)),
            contact=contact,
            origin=table.take("origin", str),
        )
        table.finish()
    if not phones:
        raise ProfileError("got no phone, expected some", where=where)
    return phones


def _expressions(rows: list[Any], where: str, count: int) -> dict[Expression, ExpressionTarget]:
    expressions: dict[Expression, ExpressionTarget] = {}
    for index, row in enumerate(rows):
        table = _Table(row, f"{where}[{index}].")
        name = table.take("name", str)
        if name.upper() not in Expression.__members__ or name == "neutral":
            raise ProfileError(f"got {name!r}, expected one of the six expressions", where=table.where("name"))
        target = table.numbers("target", (count,))
        beyond = np.zeros(fap.FAP_COUNT)
        faps = _Table(table.take("fap", dict), table.where("fap."))
        for fap_name in list(faps._values):
            try:
                beyond[fap.column(fap.by_name(fap_name).number)] = faps.take(fap_name, float)
            except UsageError as error:
                raise ProfileError(str(error), where=faps.where(fap_name)) from error
        expressions[Expression[name.upper()]] = ExpressionTarget(
            target=target, fap=frozen(beyond, "fap", (fap.FAP_COUNT,), np.float64)
        )
        table.finish()
    return expressions
