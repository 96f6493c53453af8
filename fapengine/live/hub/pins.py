"""FAPs that somebody holds at a value, whatever the engine says."""

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap


class Pins:
    """Held FAPs of each session.

    Stateful.
    """

    def __init__(self) -> None:
        self._columns: dict[str, dict[int, int]] = {}

    def __bool__(self) -> bool:
        return bool(self._columns)

    def pin(self, session: str, number: int, value: int | None) -> None:
        """Hold FAP ``number`` at a value in FAPU; None lets it go.

        Raises
        ------
        UsageError
            If there is no such FAP.
        """
        column = fap.column(number)
        pins = self._columns.setdefault(session, {})
        if value is None:
            pins.pop(column, None)
        else:
            pins[column] = value
        if not pins:
            del self._columns[session]

    def of(self, session: str) -> dict[int, int]:
        """FAP number to the value at which it is held."""
        return {column + 1: value for column, value in self._columns.get(session, {}).items()}

    def hold(self, sessions: tuple[str, ...], faps: NDArray[np.int32]) -> NDArray[np.int32]:
        """Put held values into frames, and forget sessions that are closed.

        Parameters
        ----------
        sessions : tuple of str
            The open ones.
        faps : (S, 68) int32
            FAPU; row r is session ``sessions[r]``.

        Returns
        -------
        (S, 68) int32
            A copy.
        """
        held = faps.copy()
        rows = {session: row for row, session in enumerate(sessions)}
        self._columns = {session: pins for session, pins in self._columns.items() if session in rows}
        for session, pins in self._columns.items():
            held[rows[session], list(pins)] = list(pins.values())
        return held
