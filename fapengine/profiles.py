"""Profiles: the data that make one face speak one language. Strict: a wrong or unknown key is a :class:`ProfileError`.

A profile is a folder, ``profile.toml``, ``modes.npz`` and, if it knows about context, ``context.npz``. It carries the
FAPU of the recorded face, so its motion suits any other.
"""

import hashlib
import io
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from fapengine._arrays import frozen
from fapengine._toml import TomlTable, parse_toml, quoted
from fapengine.errors import ProfileError, UsageError
from fapengine.models.viseme_space import VisemeSpace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fapu import Fapu
from fapengine.mpeg4.feature_points import FEATURE_POINT_NAMES
from fapengine.mpeg4.visemes import Expression
from fapengine.speech import ipa

SCHEMA = 1
TOML_NAME, ARRAYS_NAME, CONTEXT_NAME = "profile.toml", "modes.npz", "context.npz"
ORIGIN_NEEDED = ("source", "command")
FAPU_NAMES = ("irisd0", "es0", "ens0", "mns0", "mw0")
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
class ContextModel:
    """Targets that depend on a phone's neighbours; :mod:`fapengine.trajectory.context` computes and learns them."""

    fractions: tuple[float, ...]
    """Where in a phone its keyframes stand, 0..1, rising."""
    features: tuple[str, ...]
    """(F,) names."""
    coefficients: NDArray[np.float64]
    """(F, keyframes, K): mode weights that each feature adds."""
    rows: Mapping[str, int] = field(init=False)
    """Row of each feature."""

    def __post_init__(self) -> None:
        shape = (len(self.features), len(self.fractions), "K")
        object.__setattr__(self, "coefficients", frozen(self.coefficients, "coefficients", shape, np.float64))
        object.__setattr__(self, "rows", MappingProxyType({name: row for row, name in enumerate(self.features)}))


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
    context: ContextModel | None = None
    """Without one every phone has one look, :attr:`phones`."""


def format_profile(profile: Profile) -> dict[str, bytes]:
    """Write a profile's files; :func:`parse_profile` reads them back.

    Modes are kept as float32, coefficients of the context as float16, targets to a thousandth of a weight, FAPs of
    expressions to a tenth.

    Raises
    ------
    UsageError
        If ``origin`` lacks source or command: no numbers without a birthplace.
    """
    missing = [key for key in ORIGIN_NEEDED if key not in profile.origin]
    if missing:
        raise UsageError(f"origin: got {sorted(profile.origin)}, expected {missing[0]!r} among them")
    buffer = io.BytesIO()
    np.savez(buffer, modes_mm=profile.space.modes_mm.astype(np.float32))
    arrays = buffer.getvalue()
    lines = [
        f"schema = {SCHEMA}",
        *(f"{key} = {quoted(getattr(profile, key))}" for key in ("id", "language", "licence")),
        "",
        "[origin]",
        *(f"{key} = {quoted(text)}" for key, text in profile.origin.items()),
        "",
        "[fapu_mm]",
        *(f"{name} = {getattr(profile.fapu, f'{name}_mm'):.3f}" for name in FAPU_NAMES),
        "",
        "[modes]",
        f"file = {quoted(ARRAYS_NAME)}",
        f"sha256 = {quoted(hashlib.sha256(arrays).hexdigest())}",
        f"count = {profile.space.mode_count}",
        f"markers = {profile.space.marker_count}",
        f"points = [{', '.join(map(quoted, profile.space.points))}]",
    ]
    for name, phone in profile.phones.items():
        lines += [
            "",
            "[[phone]]",
            f"ipa = {quoted(name)}",
            f"fractions = {list(phone.fractions)}",
            f"targets = [{', '.join(map(_row, phone.targets))}]",
            f"contact = {quoted(phone.contact)}",
            f"origin = {quoted(phone.origin)}",
        ]
    for expression, face in profile.expressions.items():
        values = {row.name: round(float(face.fap[fap.column(row.number)]), 1) for row in fap.FAPS}
        faps = ", ".join(f"{name} = {value}" for name, value in values.items() if value)
        lines += [
            "",
            "[[expression]]",
            f"name = {quoted(expression.name.lower())}",
            f"target = {_row(face.target)}",
            f"fap = {{ {faps} }}",
        ]
    files = {ARRAYS_NAME: arrays}
    if profile.context is not None:
        buffer = io.BytesIO()
        names = np.array(profile.context.features)
        np.savez_compressed(buffer, features=names, coefficients=profile.context.coefficients.astype(np.float16))
        files[CONTEXT_NAME] = buffer.getvalue()
        lines += [
            "",
            "[context]",
            f"file = {quoted(CONTEXT_NAME)}",
            f"sha256 = {quoted(hashlib.sha256(files[CONTEXT_NAME]).hexdigest())}",
            f"fractions = {list(profile.context.fractions)}",
            f"count = {len(profile.context.features)}",
        ]
    return files | {TOML_NAME: ("\n".join(lines) + "\n").encode()}


def _row(values: NDArray[np.float64]) -> str:
    return f"[{', '.join(f'{value:.3f}' for value in values)}]"


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
    table = parse_toml(files[TOML_NAME], TOML_NAME, ProfileError)
    if (schema := table.take("schema", int)) != SCHEMA:
        raise ProfileError(f"schema: got {schema}, expected {SCHEMA}", where=table.where("schema"))
    origin = _origin(table.table("origin"))
    space = _space(table.table("modes"), files)
    profile = Profile(
        id=table.take("id", str),
        language=table.take("language", str),
        licence=table.take("licence", str),
        origin=MappingProxyType(origin),
        fapu=_fapu(table.table("fapu_mm")),
        space=space,
        phones=MappingProxyType(_phones(table.tables("phone"), table.where("phone"), space.mode_count)),
        expressions=MappingProxyType(_expressions(table.tables("expression"), space.mode_count)),
    )
    context = _context(table.table("context"), files, space.mode_count) if table.has("context") else None
    table.finish()
    return replace(profile, context=context)


def _origin(table: TomlTable) -> dict[str, str]:
    origin = {key: table.take(key, str) for key in table}
    for key in ORIGIN_NEEDED:
        if key not in origin:
            raise ProfileError(f"key {key!r} is missing: no numbers without a birthplace", where=table.where(key))
    return origin


def _fapu(table: TomlTable) -> Fapu:
    lengths = {f"{name}_mm": table.take(name, float) for name in FAPU_NAMES}
    table.finish()
    try:
        return Fapu(**lengths)
    except UsageError as error:
        raise ProfileError(str(error), where=table.where("")) from error


def _space(table: TomlTable, files: Mapping[str, bytes]) -> VisemeSpace:
    name, digest, count = table.take("file", str), table.take("sha256", str), table.take("count", int)
    points = tuple(table.take("points", list))
    marker_count = table.take("markers", int)
    table.finish()
    _check_file(table, files, name, digest)
    unknown = [point for point in points if point not in FEATURE_POINT_NAMES]
    if unknown:
        raise ProfileError(f"got {unknown}, expected feature points", where=table.where("points"))
    try:
        with np.load(io.BytesIO(files[name]), allow_pickle=False) as arrays:
            modes = frozen(arrays["modes_mm"], "modes_mm", (count, len(points), 3), np.float64)
        return VisemeSpace(points=points, marker_count=marker_count, modes_mm=modes)
    except (KeyError, ValueError, OSError, EOFError, zlib.error, zipfile.BadZipFile) as error:
        raise ProfileError(f"{name}: {error}", where=table.where("file")) from error


def _check_file(table: TomlTable, files: Mapping[str, bytes], name: str, digest: str) -> None:
    if name not in files:
        raise ProfileError(f"file {name!r} is missing; got {sorted(files)}", where=table.where("file"))
    if (found := hashlib.sha256(files[name]).hexdigest()) != digest:
        raise ProfileError(f"sha256 of {name}: got {found}, expected {digest}", where=table.where("sha256"))


def _context(table: TomlTable, files: Mapping[str, bytes], modes: int) -> ContextModel:
    name, count = table.take("file", str), table.take("count", int)
    _check_file(table, files, name, table.take("sha256", str))
    fractions = _fractions(table)
    table.finish()
    try:
        with np.load(io.BytesIO(files[name]), allow_pickle=False) as arrays:
            features = tuple(str(one) for one in arrays["features"])
            shape = (count, len(fractions), modes)
            coefficients = frozen(arrays["coefficients"].astype(np.float64), "coefficients", shape, np.float64)
        return ContextModel(fractions=fractions, features=features, coefficients=coefficients)
    except (KeyError, ValueError, OSError, EOFError, zlib.error, zipfile.BadZipFile) as error:
        raise ProfileError(f"{name}: {error}", where=table.where("file")) from error


def _fractions(table: TomlTable) -> tuple[float, ...]:
    fractions = table.numbers("fractions", ("keyframes",))
    if not len(fractions) or (np.diff(fractions) <= 0).any() or fractions.min() < 0 or fractions.max() > 1:
        raise ProfileError(f"got {fractions.tolist()}, expected rising 0..1", where=table.where("fractions"))
    return tuple(fractions.tolist())


def _phones(rows: list[TomlTable], where: str, count: int) -> dict[str, PhoneTarget]:
    phones: dict[str, PhoneTarget] = {}
    for table in rows:
        name = table.take("ipa", str)
        letters = ipa.letters(name)
        if "".join(letters) != name or not letters or name in phones:
            raise ProfileError(f"got {name!r}, expected bare IPA, once", where=table.where("ipa"))
        fractions = _fractions(table)
        contact = table.take("contact", str)
        if contact not in CONTACTS:
            raise ProfileError(f"got {contact!r}, expected one of {CONTACTS}", where=table.where("contact"))
        phones[name] = PhoneTarget(
            ipa=name,
            fractions=fractions,
            targets=table.numbers("targets", (len(fractions), count)),
            contact=contact,
            origin=table.take("origin", str),
        )
        table.finish()
    if not phones:
        raise ProfileError("got no phone, expected some", where=where)
    return phones


def _expressions(rows: list[TomlTable], count: int) -> dict[Expression, ExpressionTarget]:
    expressions: dict[Expression, ExpressionTarget] = {}
    for table in rows:
        name = table.take("name", str)
        if name.upper() not in Expression.__members__ or name == "neutral":
            raise ProfileError(f"got {name!r}, expected one of the six expressions", where=table.where("name"))
        target = table.numbers("target", (count,))
        beyond = np.zeros(fap.FAP_COUNT)
        faps = table.table("fap")
        for fap_name in faps:
            try:
                beyond[fap.column(fap.by_name(fap_name).number)] = faps.take(fap_name, float)
            except UsageError as error:
                raise ProfileError(str(error), where=faps.where(fap_name)) from error
        expressions[Expression[name.upper()]] = ExpressionTarget(
            target=target, fap=frozen(beyond, "fap", (fap.FAP_COUNT,), np.float64)
        )
        table.finish()
    return expressions
