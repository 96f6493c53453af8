"""Processing of rows, in any process, with the functions of the commands."""

import hashlib
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import fapengine
from fapengine.app.hearing import Recognition
from fapengine.app.manner import manner_of, voice_of
from fapengine.app.outputs import find_kind, write_output
from fapengine.app.performance import Performance, animated, perform_speech, spoken
from fapengine.app.report import Report
from fapengine.batch.journal import Done, checksum
from fapengine.batch.rows import Options, Row, loaded_profile
from fapengine.errors import FapEngineError
from fapengine.files.heads.load import load_head
from fapengine.files.paths import read_bytes
from fapengine.speech.phone_track import find_unknown
from fapengine.speech.plausible import refuse
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.process import FreshVoices
from fapengine.voices.protocol import Speech

_loaded_head = lru_cache(maxsize=4)(load_head)


@dataclass(frozen=True, slots=True)
class Job:
    """Output folder and kind of a run."""

    folder: Path
    kind: str


def do_rows(rows: tuple[Row, ...], keys: tuple[str, ...], job: Job) -> list[Done]:
    """Process rows one after the other; an error of one row is recorded, and the others continue."""
    return [_do(row, key, job) for row, key in zip(rows, keys, strict=True)]


def _do(row: Row, key: str, job: Job) -> Done:
    started_s = time.perf_counter()
    figures: dict[str, Any] = {}
    try:
        figures = _fit(row, row.session, job) if row.session is not None else _save(row, job)
        written = {path: checksum(path) for path in row.outputs(job.folder, job.kind)}
        figures["outputs"] = {path.relative_to(job.folder).as_posix(): sums for path, sums in written.items() if sums}
    except FapEngineError as error:
        figures = {"error": " ".join(str(error).split())}
    except Exception as error:  # noqa: BLE001  a bug in one of 100,000 rows must not end the others
        what = " ".join(f"{type(error).__name__}: {error}".split())[:300]
        figures = {"error": f"{what}; this is a bug in fapengine"}
    return Done(id=row.id, key=key, seconds=round(time.perf_counter() - started_s, 4), **figures)


def _save(row: Row, job: Job) -> dict[str, Any]:
    performance = perform_row(row)
    report = save_row(performance, row.output(job.folder, job.kind), row.options)
    return {
        "duration_s": round(performance.duration_s, 4), "frames": len(performance.track),
        "phones": sum(not phone.is_silence for phone in performance.phones.phones),
        "unknown": sum(unknown.count for unknown in find_unknown(performance.phones)),
        "remarks": (*performance.doubts, *report.remarks),
    }  # fmt: skip


def _fit(row: Row, session: Path, job: Job) -> dict[str, Any]:
    """Learn a profile as ``fit`` does."""
    from fapengine.app.fit import run_fit  # much of scipy, for profiles alone

    options = row.options
    fitted, _ = run_fit(
        session, row.output(job.folder, job.kind), options.fitting(), units=options.units, up=options.up,
        seed=options.seed, voice=options.chosen_voice or options.language, report=options.report, faps=options.faps,
    )  # fmt: skip
    frames = sum(len(take.moved_mm) for take in fitted.prepared.takes)
    duration_s = round(frames / fitted.prepared.rate_hz, 4)
    return {"duration_s": duration_s, "frames": frames, "phones": len(fitted.phones)}


def perform_row(row: Row) -> Performance:
    """Plan the motion of a row, as ``say`` does for a text and ``animate`` for timings or a recording."""
    options = row.options
    manner = replace(manner_of(options), profile=loaded_profile(options.profile))
    source = row.timings or row.audio
    if source is not None:
        return animated(
            source, row.audio if row.timings else None, manner,
            Recognition(
                transcript=row.text, language=options.language, channel=options.channel,
                trust_transcript=options.trust_transcript and row.text is not None,
            ),
            voice=options.chosen_voice if row.timings else None, how=options.how, strict=options.strict,
        )  # fmt: skip
    assert row.text is not None
    performance = perform_speech(spoken(row.text, _Fresh(voice_of(options))), manner)
    if options.strict:
        refuse(performance.doubts, row.id)
    return performance


def save_row(performance: Performance, path: Path, options: Options) -> Report:
    """Write the file of a row, and return its report; the ending of its name is the kind."""
    saving = replace(options.saving(path.suffix[1:]), sound=performance.sound, phones=performance.phones)
    if find_kind(path).is_drawn:
        saving = replace(saving, head=_loaded_head(options.head))
    write_output(performance.track, path, saving)
    return saving.report


@dataclass(frozen=True, slots=True)
class _Fresh:
    """A voice in its initial state, independent of earlier rows."""

    choice: VoiceChoice

    def speak(self, text: str) -> Speech:
        return _voices().speak(text, self.choice)


@lru_cache(maxsize=1)
def _voices() -> FreshVoices:
    return FreshVoices()


def key_of(row: Row, kind: str, digests: "Digests") -> str:
    """Digest of everything that a row's files depend on: the row, its inputs, and the version of fapengine."""
    digest = hashlib.sha256(f"{fapengine.__version__} {kind} {row.id} {row.text!r}".encode())
    digest.update(repr(row.options).encode())
    for path in row.inputs:
        digest.update(b"\0" + digests.of(path))
    return digest.hexdigest()[:32]


class Digests:
    """Digests of files and folders; each is read once. Stateful."""

    def __init__(self) -> None:
        self._known: dict[Path, bytes] = {}

    def of(self, path: Path) -> bytes:
        """Return the digest of a file, or of all files of a folder; empty if there is none."""
        if path not in self._known:
            digest = hashlib.sha256()
            files = sorted(path.rglob("*")) if path.is_dir() else [path] if path.is_file() else []
            for file in files:
                if file.is_file():
                    digest.update(read_bytes(file))
            self._known[path] = digest.digest() if files else b""
        return self._known[path]
