"""The address of a sink, and what every sink has. Addresses are read by :func:`.kinds.parse_sink`."""

from dataclasses import dataclass, field
from typing import Protocol

from fapengine._counters import Counts, metric
from fapengine.errors import UsageError


@dataclass(frozen=True, slots=True)
class SinkAddress:
    """Where frames go, and by which kind of sink."""

    kind: str
    host: str
    port: int
    session: str | None = None
    options: dict[str, str] = field(default_factory=dict)
    path: str = field(default="", repr=False)
    """Path after the port. It may hold a stream's key, so it is shown nowhere."""

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        place = f"{host}:{self.port}" if host else ""
        return f"{self.kind}://{place}" + (f"?session={self.session}" if self.session else "")

    def seconds(self, name: str, default: float, high: float) -> float:
        """Read an option in seconds, above 0.

        Raises
        ------
        UsageError
            If it is not a number, or out of range.
        """
        spelled = self.options.get(name, str(default))
        try:
            value = float(spelled)
        except ValueError as error:
            raise UsageError(f"sink {self.kind}: {name}: got {spelled!r:.40}, expected seconds") from error
        if not 0 < value <= high:
            raise UsageError(f"sink {self.kind}: {name}: got {value} s, expected 0..{high:g}")
        return value

    def whole(self, name: str, default: int, low: int, high: int) -> int:
        """Read an option that is a whole number.

        Raises
        ------
        UsageError
            If it is not, or out of range.
        """
        spelled = self.options.get(name, str(default))
        if not spelled.isdecimal() or not low <= int(spelled[:9]) <= high:
            raise UsageError(
                f"sink {self.kind}: {name}: got {spelled!r:.40}, expected a whole number {low}..{high}"
            )  # fmt: skip
        return int(spelled)


@dataclass(slots=True)
class SinkCounts(Counts):
    """Counts of a sink.

    Stateful.
    """

    sent: int = metric("sent", "Datagrams or planes that sinks sent.")
    """Planes: times streams."""
    dropped: int = metric("unsent", "Those that could not be sent.")
    """Those that the system, or a slow reader, did not take."""


class Sink(Protocol):
    """Sends frames until it is closed."""

    address: SinkAddress
    counts: SinkCounts

    async def close(self) -> None:
        """Send no more."""
        ...
