"""Speaker profiles: data of how one face speaks one language. A wrong or unknown key is a :class:`ProfileError`.

A profile is a folder, ``profile.toml``, ``modes.npz`` and, if targets depend on neighbours, ``context.npz``. It
contains the FAPU of the recorded face, so its motion fits any face.
"""

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fapengine._arrays import DAMAGE, Rebuilt, freeze, frozen, pack
from fapengine._strict_toml import check_fields, parse_toml, quoted, spell_path
from fapengine.errors import ProfileError, UsageError, as_data_error
from fapengine.expressions import STANDARD_EXPRESSIONS, Expression
from fapengine.models.viseme_space import VisemeSpace
from fapengine.mpeg4 import fap
from fapengine.mpeg4.fap import FEATURE_POINT_NAMES
from fapengine.mpeg4.fapu import Fapu
from fapengine.speech import ipa
from fapengine.speech.phone_track import SILENCE

SCHEMA = 1
TOML_NAME, ARRAYS_NAME, CONTEXT_NAME = "profile.toml", "modes.npz", "context.npz"
ORIGIN_NEEDED = ("source", "command")
FAPU_NAMES = ("irisd0", "es0", "ens0", "mns0", "mw0")
Contact = Literal["none", "lips", "teeth"]
"""Contact that a phone makes: none, lip on lip (p b m), lower lip on upper teeth (f v)."""
CONTACTS: tuple[Contact, ...] = get_args(Contact)
FeatureKind = Literal["bias", "phone", "length", "way", "letter", "cross", "pair", "triple"]
"""First word of a context feature's name; the rest is described in :mod:`fapengine.trajectory.context`."""
FEATURE_KINDS: tuple[FeatureKind, ...] = get_args(FeatureKind)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PhoneTarget(Rebuilt):
    """Points of one phone in the viseme space."""

    ipa: str
    """One IPA symbol, or several for a diphthong or an affricate."""
    fractions: tuple[float, ...]
    """Times of the keyframes as fractions of the phone, 0..1, rising."""
    targets: NDArray[np.float64]
    """(keyframes, K) mode weights."""
    contact: str
    """One of :data:`CONTACTS`."""
    origin: str
    """Origin of the target."""
    tongue_mm: tuple[float, ...] | None = None
    """Tip up, tip forward, middle up, from rest and beside what the jaw carries; None: the built-in table's."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ExpressionTarget(Rebuilt):
    """One of the six expressions at full strength."""

    target: NDArray[np.float64]
    """(K,) mode weights."""
    fap: NDArray[np.float64]
    """(68,) FAPU: motion beyond the modes (brows, lids, cheeks, nose)."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Examples(Rebuilt):
    """Recorded tokens that a context model compares others with."""

    letters: tuple[str, ...] = ()
    """(M,) strings of eight letters, :func:`fapengine.trajectory.context.letters_around` of each."""
    lengths: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3)))
    """(M, 3): of the one before, of itself, and of the next, as :func:`fapengine.trajectory.context.log_length`."""
    adds: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 1, 1)))
    """(M, keyframes, K): mode weights that each adds to a token that is like it in all."""

    def __post_init__(self) -> None:
        freeze(self, lengths=(len(self.letters), 3), adds=(len(self.letters), "keyframes", "K"))
        wrong = next((one for one in self.letters if len(one) != 8 or not set(one) <= {SILENCE, *ipa.SOUNDS}), None)
        if wrong is not None:
            raise UsageError(f"letters: got {wrong!r}, expected eight letters of IPA, or {SILENCE!r}")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ContextModel(Rebuilt):
    """Targets that depend on a phone's neighbours; :mod:`fapengine.trajectory.context` computes and learns them."""

    fractions: tuple[float, ...]
    """Times of the keyframes as fractions of a phone, 0..1, rising."""
    features: tuple[str, ...]
    """(F,) names."""
    coefficients: NDArray[np.float64]
    """(F, keyframes, K): mode weights that each feature adds."""
    examples: Examples = Examples()
    """Recorded tokens that add to the sums; none by default."""
    rows: Mapping[str, int] = field(init=False)
    """Row of each feature."""

    def __post_init__(self) -> None:
        freeze(self, coefficients=(len(self.features), len(self.fractions), "K"))
        adds = self.examples.adds if self.examples.letters else np.zeros((0, *self.coefficients.shape[1:]))
        adds = frozen(adds, "examples.adds", ("M", *self.coefficients.shape[1:]), np.float64)
        object.__setattr__(self, "examples", replace(self.examples, adds=adds))
        object.__setattr__(self, "rows", MappingProxyType({name: row for row, name in enumerate(self.features)}))
        if len(self.rows) < len(self.features):
            twice = next(name for row, name in enumerate(self.features) if self.rows[name] != row)
            raise UsageError(f"features: got {twice!r} twice, expected each once")


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """What a fit needs to be repeated."""

    version: str
    """Of fapengine."""
    seed: int
    held_out: tuple[str, ...]
    """Names of the takes that the errors are of."""
    inputs: dict[str, str]
    """SHA-256 of each file that was read, by its path within the session."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Profile(Rebuilt):
    """How one face speaks one language."""

    id: str
    language: str
    licence: str
    origin: Mapping[str, str]
    fapu: Fapu
    space: VisemeSpace
    phones: Mapping[str, PhoneTarget]
    """Targets by IPA."""
    expressions: Mapping[Expression, ExpressionTarget]
    context: ContextModel | None = None
    """Targets that depend on neighbours; without them every phone has one pose, :attr:`phones`."""
    record: Record | None = None
    """Of a profile that ``fapengine fit`` made."""

    def __post_init__(self) -> None:
        check_fields(self)


def format_profile(profile: Profile) -> dict[str, bytes]:
    """Write a profile's files; :func:`parse_profile` reads them back.

    Modes are kept as float32, coefficients of the context as float16, targets to a thousandth of a weight, FAPs of
    expressions to a tenth.

    Raises
    ------
    UsageError
        If ``origin`` lacks source or command.
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
        *_record_lines(profile.record),
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
            *([] if phone.tongue_mm is None else [f"tongue_mm = {list(phone.tongue_mm)}"]),
        ]
    for expression, face in profile.expressions.items():
        values = {row.name: round(float(face.fap[fap.column(row.number)]), 1) for row in fap.FAPS}
        faps = ", ".join(f"{name} = {value}" for name, value in values.items() if value)
        lines += [
            "",
            "[[expression]]",
            f"name = {quoted(expression.label)}",
            f"target = {_row(face.target)}",
            f"fap = {{ {faps} }}",
        ]
    files = {ARRAYS_NAME: arrays}
    if profile.context is not None:
        coefficients, examples = profile.context.coefficients.astype(np.float16), profile.context.examples
        files[CONTEXT_NAME] = pack(
            features=np.array(profile.context.features),
            coefficients=coefficients,
            example_letters=np.array(examples.letters),
            example_lengths=examples.lengths.astype(np.float16),
            example_adds=examples.adds.astype(np.float16),
        )
        lines += [
            "",
            "[context]",
            f"file = {quoted(CONTEXT_NAME)}",
            f"sha256 = {quoted(hashlib.sha256(files[CONTEXT_NAME]).hexdigest())}",
            f"fractions = {list(profile.context.fractions)}",
            f"count = {len(profile.context.features)}",
        ]
    return files | {TOML_NAME: ("\n".join(lines) + "\n").encode()}


def _record_lines(record: Record | None) -> list[str]:
    if record is None:
        return []
    return [
        "",
        "[record]",
        f"version = {quoted(record.version)}",
        f"seed = {record.seed}",
        f"held_out = [{', '.join(map(quoted, record.held_out))}]",
        "",
        "[record.inputs]",
        *(f"{quoted(name)} = {quoted(digest)}" for name, digest in record.inputs.items()),
    ]


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
    document = parse_toml(files[TOML_NAME], _Document, TOML_NAME, ProfileError, schema=SCHEMA)
    for key in ORIGIN_NEEDED:
        if key not in document.origin:
            raise _wrong(f"key {key!r} is missing", "origin", key)
    space = _space(document.modes, files)
    with as_data_error(where=spell_path(TOML_NAME, "fapu_mm"), kind=ProfileError):
        fapu = Fapu(**{f"{name}_mm": getattr(document.fapu_mm, name) for name in FAPU_NAMES})
    return Profile(
        id=document.id,
        language=document.language,
        licence=document.licence,
        origin=MappingProxyType(document.origin),
        fapu=fapu,
        space=space,
        phones=MappingProxyType(_phones(document.phone, space.mode_count)),
        expressions=MappingProxyType(_expressions(document.expression, space.mode_count)),
        context=None if document.context is None else _context(document.context, files, space.mode_count),
        record=document.record,
    )


@dataclass(frozen=True, slots=True)
class _Lengths:
    irisd0: float
    es0: float
    ens0: float
    mns0: float
    mw0: float


@dataclass(frozen=True, slots=True)
class _Modes:
    file: str
    sha256: str
    count: int
    markers: int
    points: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Phone:
    ipa: str
    fractions: tuple[float, ...]
    targets: tuple[tuple[float, ...], ...]
    contact: Contact
    origin: str
    tongue_mm: tuple[float, float, float] | None = None


@dataclass(frozen=True, slots=True)
class _Expression:
    name: str
    target: tuple[float, ...]
    fap: dict[str, float]


@dataclass(frozen=True, slots=True)
class _Context:
    file: str
    sha256: str
    fractions: tuple[float, ...]
    count: int


@dataclass(frozen=True, slots=True)
class _Document:
    """``profile.toml``, key by key."""

    schema: int
    id: str
    language: str
    licence: str
    origin: dict[str, str]
    fapu_mm: _Lengths
    modes: _Modes
    phone: tuple[_Phone, ...]
    expression: tuple[_Expression, ...]
    context: _Context | None = None
    record: Record | None = None


def _wrong(message: object, *path: str | int) -> ProfileError:
    return ProfileError(str(message), where=spell_path(TOML_NAME, *path))


def _space(modes: _Modes, files: Mapping[str, bytes]) -> VisemeSpace:
    data = _file(modes, files, "modes")
    unknown = [point for point in modes.points if point not in FEATURE_POINT_NAMES]
    if unknown:
        raise _wrong(f"got {unknown}, expected feature points", "modes", "points")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            modes_mm = frozen(arrays["modes_mm"], "modes_mm", (modes.count, len(modes.points), 3), np.float64)
        return VisemeSpace(points=modes.points, marker_count=modes.markers, modes_mm=modes_mm)
    except (*DAMAGE, MemoryError) as error:
        raise _wrong(f"{modes.file}: {error}", "modes", "file") from error


def _context(context: _Context, files: Mapping[str, bytes], modes: int) -> ContextModel:
    data = _file(context, files, "context")
    fractions = _fractions(context.fractions, "context", "fractions")
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            features = tuple(map(str, np.atleast_1d(arrays["features"])))
            shape = (context.count, len(fractions), modes)
            coefficients = frozen(arrays["coefficients"], "coefficients", shape, np.float64)
            examples = Examples()
            if "example_letters" in arrays:  # profiles of earlier versions have none
                examples = Examples(
                    letters=tuple(map(str, np.atleast_1d(arrays["example_letters"]))),
                    lengths=arrays["example_lengths"],
                    adds=arrays["example_adds"],
                )
        model = ContextModel(fractions=fractions, features=features, coefficients=coefficients, examples=examples)
    except (*DAMAGE, MemoryError) as error:
        raise _wrong(f"{context.file}: {error}", "context", "file") from error
    strange = next((name for name in features if name.split(" ")[0] not in FEATURE_KINDS), None)
    if strange is not None:
        raise _wrong(
            f"{context.file}: got feature {strange!r}, expected one that begins with {', '.join(FEATURE_KINDS)};"
            " fit profiles of earlier versions again (fapengine fit)", "context", "file",
        )  # fmt: skip
    return model


def _file(table: _Modes | _Context, files: Mapping[str, bytes], key: str) -> bytes:
    """Return the content of the file that a table names."""
    if table.file not in files:
        raise _wrong(f"file {table.file!r} is missing; got {sorted(files)}", key, "file")
    data = files[table.file]
    if (digest := hashlib.sha256(data).hexdigest()) != table.sha256:
        raise _wrong(f"sha256 of {table.file}: got {digest}, expected {table.sha256}", key, "sha256")
    return data


def _fractions(fractions: tuple[float, ...], *path: str | int) -> tuple[float, ...]:
    is_rising = all(before < after for before, after in pairwise(fractions))
    if not fractions or not is_rising or not all(0 <= fraction <= 1 for fraction in fractions):
        raise _wrong(f"got {list(fractions)}, expected rising 0 to 1", *path)
    return fractions


def _numbers(values: ArrayLike, shape: tuple[int, ...], *path: str | int) -> NDArray[np.float64]:
    with as_data_error(where=spell_path(TOML_NAME, *path), kind=ProfileError):
        return frozen(values, str(path[-1]), shape, np.float64)


def _phones(rows: tuple[_Phone, ...], count: int) -> dict[str, PhoneTarget]:
    phones: dict[str, PhoneTarget] = {}
    for index, row in enumerate(rows):
        letters = ipa.letters(row.ipa)
        if "".join(letters) != row.ipa or not letters or row.ipa in phones:
            raise _wrong(f"got {row.ipa!r}, expected bare IPA, once", "phone", index, "ipa")
        fractions = _fractions(row.fractions, "phone", index, "fractions")
        phones[row.ipa] = PhoneTarget(
            ipa=row.ipa,
            fractions=fractions,
            targets=_numbers(row.targets, (len(fractions), count), "phone", index, "targets"),
            contact=row.contact,
            origin=row.origin,
            tongue_mm=None
            if row.tongue_mm is None
            else tuple(_numbers(row.tongue_mm, (3,), "phone", index, "tongue_mm").tolist()),
        )
    if not phones:
        raise _wrong("contains no phone", "phone")
    return phones


def _expressions(rows: tuple[_Expression, ...], count: int) -> dict[Expression, ExpressionTarget]:
    expressions: dict[Expression, ExpressionTarget] = {}
    for index, row in enumerate(rows):
        if row.name not in [one.label for one in STANDARD_EXPRESSIONS]:
            raise _wrong(f"unknown value {row.name!r}; use one of the six expressions", "expression", index, "name")
        beyond = np.zeros(fap.FAP_COUNT)
        for name, value in row.fap.items():
            with as_data_error(where=spell_path(TOML_NAME, "expression", index, "fap", name), kind=ProfileError):
                beyond[fap.column(fap.by_name(name).number)] = value
        expressions[Expression[row.name.upper()]] = ExpressionTarget(
            target=_numbers(row.target, (count,), "expression", index, "target"),
            fap=_numbers(beyond, (fap.FAP_COUNT,), "expression", index, "fap"),
        )
    return expressions
