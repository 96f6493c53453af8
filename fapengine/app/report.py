"""What a job did: files, figures, and how long each stage took."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from fapengine.speech.reading import Reading, UnknownPhone


@dataclass(slots=True)
class Report:
    """Files, figures and times of a job, filled in while it runs. Stateful."""

    stages: dict[str, float] = field(default_factory=dict)
    """Seconds by stage."""
    files: list[tuple[Path, str]] = field(default_factory=list)
    """Paths that were written, each with what it is."""
    frames: int = 0
    rate_hz: float = 0.0
    """Frames a second of the track."""
    duration_s: float = 0.0
    """Length of the sound, or of the phones where there is none."""
    phones: int = 0
    """Count of phones that are no silence."""
    level: str = "phone"
    """Units that the timings were given for: phones, words, characters."""
    unknown: tuple[UnknownPhone, ...] = ()
    """Phones that no set explains."""
    reading: Reading | None = None
    """Alphabet that the labels of a file were read in; None where they were IPA from the start, or are words."""

    notes: tuple[str, ...] = ()
    """Remarks of the ear: words that a voice pronounced, places where text and sound differ."""
    shows: Callable[[str], AbstractContextManager[object]] = nullcontext
    """Opened with the name of each stage for as long as it lasts: tells a user what he waits for."""
    moved: str = ""
    """Motion of an avatar in words."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside."""
        started_s = time.perf_counter()
        with self.shows(name):
            yield
        self.stages[name] = self.stages.get(name, 0.0) + time.perf_counter() - started_s

    @property
    def total_s(self) -> float:
        """Sum of all stages."""
        return sum(self.stages.values())

    def as_dict(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return {
            "files": {kind: str(path) for path, kind in self.files},
            "seconds": self.stages,
            "total_s": self.total_s,
            "duration_s": self.duration_s,
            "frames": self.frames,
            "rate_hz": self.rate_hz,
            "times_real_time": self.duration_s / self.total_s if self.total_s else 0.0,
            "phones": self.phones,
            "level": self.level,
            "heard": list(self.notes),
            "moved": self.moved,
            "unknown_phones": [
                {"label": each.label, "count": each.count, "first_s": each.first_s, "stand_in": each.stand_in}
                for each in self.unknown
            ],
            "alphabet": self.reading.alphabet if self.reading else "",
            "alphabet_guessed": bool(self.reading and self.reading.guessed),
            "alphabet_could_be": list(self.reading.others) if self.reading else [],
        }
