"""Many stages on one engine: a frame of all costs little more than a frame of one."""

from collections.abc import Mapping

import numpy as np

from fapengine.agents.stage import LIMITS, Pronounce, Stage, StageFrame
from fapengine.ears.protocol import StreamEar
from fapengine.live.engine.engine import Engine
from fapengine.profiles import Profile
from fapengine.trajectory.style import Style


class Troupe:
    """Faces of many agents in one process. Stateful.

    Parameters
    ----------
    profile : Profile
        Whose way of speaking, of all.
    rng : numpy.random.Generator
        Chance of blinks, glances and head motion.
    style : Style, optional
    """

    def __init__(self, profile: Profile, *, rng: np.random.Generator, style: Style | None = None) -> None:
        self._engine = Engine(profile, rng=rng, limits=LIMITS, style=style)
        self._stages: dict[str, Stage] = {}
        self._now_s = 0.0

    @property
    def stages(self) -> Mapping[str, Stage]:
        """Stages by name."""
        return self._stages

    def open(self, name: str, *, ear: StreamEar | None = None, pronounce: Pronounce | None = None) -> Stage:
        """Add a stage. It is shown by :meth:`next` alone, not by its own.

        Raises
        ------
        UsageError
            If there is one of that name, or as many as there may be.
        """
        self._stages[name] = stage = Stage.on(self._engine, name, self._now_s, ear=ear, pronounce=pronounce)
        return stage

    def close(self, name: str) -> None:
        """Take a stage away.

        Raises
        ------
        UsageError
            If there is none of that name.
        """
        self._engine.close(name, self._now_s)
        del self._stages[name]

    def next(self, dt_s: float) -> dict[str, StageFrame]:
        """Show the next frame of every stage, each for ``dt_s``. Raises as :meth:`Stage.next`."""
        sounds = {name: stage.prepare(dt_s) for name, stage in self._stages.items()}
        shown = self._engine.frame(self._now_s)
        self._engine.events()
        self._now_s += dt_s
        return {
            name: StageFrame(faps, sounds[name]) for name, faps in zip(shown.sessions, shown.faps, strict=True)
        }  # fmt: skip
