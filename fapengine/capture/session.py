"""A capture session: one subject, one set of markers, one or more takes with what was said or shown in them."""

from dataclasses import dataclass

from fapengine.capture.marker_track import MarkerTrack
from fapengine.errors import DataError, UsageError


@dataclass(frozen=True, slots=True)
class Interval:
    """A phone or a held pose within a take."""

    label: str
    start_s: float
    end_s: float


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """One recording, and the phones that were spoken in it, where known."""

    name: str
    markers: MarkerTrack
    phones: tuple[Interval, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Takes of one subject with one marker set.

    Raises
    ------
    UsageError
        Without takes.
    DataError
        If takes differ in markers or rate; ``where`` is the take.
    """

    subject: str
    takes: tuple[Take, ...]

    def __post_init__(self) -> None:
        if not self.takes:
            raise UsageError(f"session {self.subject!r}: got no take, expected at least one")
        first = self.takes[0]
        for take in self.takes[1:]:
            extra = set(take.markers.labels) ^ set(first.markers.labels)
            if extra:
                raise DataError(
                    f"markers: got a set that differs from take {first.name!r} in {', '.join(sorted(extra)[:8])}",
                    where=f"take {take.name}",
                )
            if take.markers.rate_hz != first.markers.rate_hz:
                raise DataError(
                    f"rate: got {take.markers.rate_hz:g} Hz, expected {first.markers.rate_hz:g} Hz as in take"
                    f" {first.name!r}",
                    where=f"take {take.name}",
                )

    @property
    def labels(self) -> tuple[str, ...]:
        """Markers, in the order of the first take."""
        return self.takes[0].markers.labels

    @property
    def rate_hz(self) -> float:
        """Frames a second of every take."""
        return self.takes[0].markers.rate_hz
