"""FAPs of somebody who moves a face frame by frame, as a camera sees them, over what the engine says."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fapengine.mpeg4 import fap

PERFORMED_S, LET_GO_S = 0.3, 0.3
"""Time after the last frame in which it still moves the face, and in which the face is then let go."""


@dataclass(frozen=True, slots=True)
class _Frame:
    columns: list[int]
    values: NDArray[np.int32]
    at_s: float


class Performers:
    """The last frame of each session that somebody moves.

    Stateful.
    """

    def __init__(self) -> None:
        self._frames: dict[str, _Frame] = {}

    def __bool__(self) -> bool:
        return bool(self._frames)

    def perform(self, session: str, values: Mapping[int, int], now_s: float) -> None:
        """Take a frame: FAP number to FAPU.

        Raises
        ------
        UsageError
            If there is no such FAP.
        """
        columns = [fap.column(number) for number in values]
        self._frames[session] = _Frame(columns, np.array([*values.values()], np.int32), now_s)

    def move(self, sessions: tuple[str, ...], faps: NDArray[np.int32], now_s: float) -> NDArray[np.int32]:
        """Put the frames in, as far as they still last, and forget those that are over or whose session is closed.

        Parameters
        ----------
        sessions : tuple of str
            The open ones.
        faps : (S, 68) int32
            FAPU; row r is session ``sessions[r]``.
        now_s : float
            Time of the clock that :meth:`perform` was told.

        Returns
        -------
        (S, 68) int32
            A copy.
        """
        moved = faps.copy()
        rows = {session: row for row, session in enumerate(sessions)}
        for session, frame in tuple(self._frames.items()):
            share = float(np.clip(1 - (now_s - frame.at_s - PERFORMED_S) / LET_GO_S, 0.0, 1.0))
            if session not in rows or not share:
                del self._frames[session]
                continue
            own = moved[rows[session], frame.columns]
            moved[rows[session], frame.columns] = np.rint(own + share * (frame.values - own))
        return moved
