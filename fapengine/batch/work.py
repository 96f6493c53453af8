"""What is done for a row, in whatever process: the verbs' own functions, one after the other."""

import hashlib
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import fapengine
from fapengine.app.fit import run_fit
from fapengine.app.manner import manner_of, voice_of
from fapengine.app.outputs import write_output
from fapengine.app.performance import Performance, animate, perform, pronounced, speak
from fapengine.app.talk import refuse_unknown
from fapengine.batch.journal import Done, checksum
from fapengine.batch.rows import Options, Row
from fapengine.errors import FapEngineError
from fapengine.files.paths import read_bytes
from fapengine.files.profiles import load_profile
from fapengine.files.sound import load_sound
from fapengine.files.timings import load_timings
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.profiles import Profile
from fapengine.speech.phone_track import find_unknown
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.process import FreshVoices
from fapengine.voices.protocol import Speech


@dataclass(frozen=True, slots=True)
class Job:
    """What is made of rows, and where."""

    folder: Path
    kind: str


def do_rows(rows: tuple[Row, ...], keys: tuple[str, ...], job: Job) -> list[Done]:
    """Do rows one after the other; what goes wrong with one is its error, and the others go on."""
    return [_do(row, key, job) for row, key in zip(rows, keys, strict=True)]


def _do(row: Row, key: str, job: Job) -> Done:
    started_s = time.perf_counter()
    try:
        if row.session is not None:
            return _fit(row, row.session, key, job, started_s)
        performance = perform_row(row)
        path = row.output(job.folder, job.kind)
        save_row(performance, path, row.options)
        written = checksum(path)
        assert written is not None
    except FapEngineError as error:
        return Done(id=row.id, key=key, seconds=_since(started_s), error=" ".join(str(error).split()))
    except Exception as error:  # noqa: BLE001  a bug in one of 100,000 rows must not end the others
        told = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        return Done(id=row.id, key=key, seconds=_since(started_s), error=f"{told}; this is a bug of fapengine")
    phones = [phone for phone in performance.phones.phones if not phone.is_silence]
    return Done(
        id=row.id, key=key, outputs={path.relative_to(job.folder).as_posix(): written},
        duration_s=round(performance.duration_s, 4), frames=len(performance.track), phones=len(phones),
        unknown=sum(unknown.count for unknown in find_unknown(performance.phones)), seconds=_since(started_s),
    )  # fmt: skip


def _fit(row: Row, session: Path, key: str, job: Job, started_s: float) -> Done:
    """Learn a profile as ``fit`` does."""
    fitted, _ = run_fit(row.options.fitting(session, row.output(job.folder, job.kind)))
    outputs = {}
    for path in row.outputs(job.folder, job.kind):
        if (written := checksum(path)) is not None:
            outputs[path.relative_to(job.folder).as_posix()] = written
    frames = sum(len(take.moved_mm) for take in fitted.prepared.takes)
    return Done(
        id=row.id, key=key, outputs=outputs, duration_s=round(frames / fitted.prepared.rate_hz, 4), frames=frames,
        phones=len(fitted.phones), seconds=_since(started_s),
    )  # fmt: skip


def _since(started_s: float) -> float:
    return round(time.perf_counter() - started_s, 4)


def perform_row(row: Row) -> Performance:
    """Plan a row's motion as ``say`` does that of a text, ``animate`` that of timings or a recording."""
    options, manner = row.options, manner_of(row.options)
    profile = loaded_profile(options.profile)
    if row.timings is not None:
        read = load_timings(
            row.timings, file_format=options.format, tier=options.tier, alphabet=options.alphabet,
            columns=options.columns,
        )  # fmt: skip
        phones = pronounced(read, options.voice)
        sound = load_sound(row.audio, channel=options.channel) if row.audio else None
        performance = perform(phones, sound, replace(manner, profile=profile), text=row.timings.name)
    elif row.audio is not None:
        performance = animate(
            row.audio, transcript=row.text, language=options.language, channel=options.channel,
            expressions=manner.expressions, style=manner.style, profile=profile, seed=options.seed, rate_hz=options.fps,
        )  # fmt: skip
    else:
        assert row.text is not None
        performance = speak(
            row.text, voice=_Fresh(voice_of(options)), expressions=manner.expressions, style=manner.style,
            profile=profile, seed=options.seed, rate_hz=options.fps,
        )  # fmt: skip
    if options.strict:
        refuse_unknown(performance.phones, row.id)
    return performance


def save_row(performance: Performance, path: Path, options: Options) -> None:
    """Write the file of a row; the ending of its name is the kind."""
    saving = replace(options.saving(path.suffix[1:]), sound=performance.sound)
    if path.suffix == ".mp4":
        saving = replace(saving, head=loaded_head(options.head))
    write_output(performance.track, path, saving)


@lru_cache(maxsize=8)
def loaded_profile(name: str) -> Profile:
    """Load a profile once a process."""
    return load_profile(name)


@lru_cache(maxsize=4)
def loaded_head(name: str) -> FaceMesh:
    """Load a head once a process."""
    from fapengine.files.heads.load import load_head

    return load_head(name)


@dataclass(frozen=True, slots=True)
class _Fresh:
    """A voice that has not spoken yet, whatever the rows before said."""

    choice: VoiceChoice

    def speak(self, text: str) -> Speech:
        return _voices().speak(text, self.choice)


@lru_cache(maxsize=1)
def _voices() -> FreshVoices:
    return FreshVoices()


def key_of(row: Row, kind: str, digests: "Digests") -> str:
    """Digest of all that a row's files are a function of: itself, the bytes of its inputs, and this program."""
    digest = hashlib.sha256(f"{fapengine.__version__} {kind} {row.id} {row.text!r}".encode())
    digest.update(repr(row.options).encode())
    for path in row.inputs:
        digest.update(b"\0" + digests.of(path))
    return digest.hexdigest()[:32]


class Digests:
    """Digests of files and folders, each read once. Stateful."""

    def __init__(self) -> None:
        self._known: dict[Path, bytes] = {}

    def of(self, path: Path) -> bytes:
        """Return the digest of a file, or of a folder's files; nothing for a name that is neither."""
        if path not in self._known:
            digest = hashlib.sha256()
            files = sorted(path.rglob("*")) if path.is_dir() else [path] if path.is_file() else []
            for file in files:
                if file.is_file():
                    digest.update(read_bytes(file))
            self._known[path] = digest.digest() if files else b""
        return self._known[path]
