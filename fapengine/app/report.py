"""Report of a job: its files, figures, and the time of each stage."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path

from fapengine.speech.phone_track import Reading, UnknownPhone


@dataclass(slots=True)
class Report:
    """Files, figures and times of a job, filled while it runs. Stateful."""

    stages: dict[str, float] = field(default_factory=dict)
    """Seconds by stage."""
    files: list[tuple[Path, str]] = field(default_factory=list)
    """Written paths, each with its kind."""
    frames: int = 0
    rate_hz: float = 0.0
    """Frame rate of the track."""
    duration_s: float = 0.0
    """Duration of the sound, or of the phones if there is none."""
    phones: int = 0
    """Number of phones that are not silence."""
    level: str = "phone"
    """Unit of the timings: phone, word or character."""
    unknown: tuple[UnknownPhone, ...] = ()
    """Labels that no phone set contains."""
    reading: Reading = field(default_factory=Reading)
    """How the labels of a file were understood."""
    remarks: tuple[str, ...] = ()
    """Remarks of the performance."""
    shows: Callable[[str], AbstractContextManager[object]] = nullcontext
    """Context manager opened with the name of each stage, to show progress."""
    moved: str = ""
    """Description of an avatar's motion."""

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the time of a block, without that of the stages inside it."""
        started_s, before_s = time.perf_counter(), self.total_s
        with self.shows(name):
            yield
        own_s = time.perf_counter() - started_s - (self.total_s - before_s)
        self.stages[name] = self.stages.get(name, 0.0) + own_s

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
            "heard": list(self.reading.notes),
            "moved": self.moved,
            "unknown_phones": [
                {"label": each.label, "count": each.count, "first_s": each.first_s, "stand_in": each.stand_in}
                for each in self.unknown
            ],
            "alphabet": self.reading.alphabet,
            "alphabet_guessed": self.reading.guessed,
            "alphabet_could_be": list(self.reading.others),
            "remarks": list(self.remarks),
        }
