"""An agent's face, whose painter or recognizer is killed at a random moment: no audio is lost, images come back."""

import asyncio
import os
import random
import signal
import time
from types import TracebackType
from typing import Self

import numpy as np

from fapengine._child import WORK
from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.agents.pictures import Picture

PARTS = ("painter", "recognizer")
OPTIONS = AgentOptions(size=(64, 64), edges="none")
RATE_HZ, SPOKEN_S = 24_000, 3.0
FRAMES = 9_000
"""Frames within which a part is back: six minutes, because a machine may have ten times the work that it can do."""


class Agent:
    """A face that speaks during each moment. Stateful."""

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._sound = np.random.default_rng(rng.randrange(1000))
        self._runner = asyncio.Runner()
        self._face = AgentFace.open(OPTIONS)
        self.back_s: list[float] = []
        """Times from each end of a painter to the next image."""

    def __enter__(self) -> Self:
        self._runner.run(self._face.ready())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._face.close()
        self._runner.close()
        if self.back_s:
            print(f"agent: images back after {np.median(self.back_s):.2f} s (median), {max(self.back_s):.2f} s (most)")

    def once(self, part: str) -> str:
        """Kill a part at a random moment of an utterance; "" or what is wrong then."""
        return self._runner.run(self._killed(part))

    async def _killed(self, part: str) -> str:
        face, counts = self._face, self._face.pictures.counts
        given = self._sound.integers(-9_000, 9_000, round(SPOKEN_S * RATE_HZ)).astype(np.int16)
        face.sound(given, RATE_HZ)
        face.end()
        heard, said, finished, restarts = [], 1, 0, counts.restarts
        kill_at, killed_s, picture = self._rng.randrange(round(SPOKEN_S / face.dt_s)), 0.0, None
        before = face.recognizer
        drawn = worked = 0
        for number in range(FRAMES):
            if number == kill_at:
                os.kill(_process_of(face, part), signal.SIGKILL)
                killed_s = time.monotonic()
            frame, ends, shown = await self._frame()
            heard += [sound.samples for sound in frame]
            finished += ends
            is_new = part != "painter" or counts.restarts > restarts
            if killed_s and shown is not None and picture is None and is_new:
                picture = shown
                self.back_s += [time.monotonic() - killed_s] * (part == "painter")
            is_back = face.host.hears and (part == "painter" or face.recognizer is not before)
            if is_back and picture is not None:
                worked = counts.drawn - drawn
            else:
                drawn = counts.drawn
            if finished == said == 1 and is_back:
                face.sound(given, RATE_HZ)
                face.end()
                said = 2
            if finished == 2 and worked > WORK:  # so that the next end is not one of three in a row
                break
        wrong = [] if np.array_equal(np.concatenate(heard), np.tile(given, said)) else ["audio is lost"]
        wrong += [] if finished == said == 2 else [f"the ends of {said} utterances were reported {finished} times"]
        wrong += [] if picture is not None else ["there are no more images"]
        wrong += [] if face.host.hears else ["there is no recognizer"]
        return "; ".join(wrong)

    async def _frame(self) -> tuple[tuple, int, Picture | None]:  # type: ignore[type-arg]
        """Show the next frame as the plug-ins do: its audio, the number of utterances that ended, a finished image."""
        face = self._face
        await asyncio.sleep(face.wait_s(time.monotonic()))
        frame, events = face.frame(time.monotonic())
        face.show(frame)
        picture = await face.drawn(face.image_wait_s(time.monotonic()))
        return frame.sounds, sum(event.kind == "finished" for event in events), picture


def _process_of(face: AgentFace, part: str) -> int:
    owner = face.painter if part == "painter" else face.recognizer
    assert owner is not None, f"there is no {part}"
    child = owner._child if part == "painter" else owner.child  # type: ignore[union-attr]
    return child.process.pid
