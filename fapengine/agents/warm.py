"""Faces that are started before they are needed, so that an agent's first image takes no longer than any other."""

import asyncio
import atexit
import logging
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from threading import Lock, Thread
from typing import Any

from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.errors import ResourceError, UsageError

_lock = Lock()
_warm: list[tuple[int, AgentOptions, AgentFace]] = []
"""Faces that nobody has taken, with their process, because a fork shares the pipes of its parent."""
_closed = 0
"""How often they were all closed: a face that was started before is not kept after."""
log = logging.getLogger("fapengine.agents")


def prewarm(n: int = 1, **options: Any) -> None:
    """Start the processes of faces, and wait until they are ready; agents of this process take them.

    A face that was taken is replaced by another one. The first face of a head on a machine takes longer: heads are kept
    in the cache (:mod:`fapengine.files.heads.built`). Raises UsageError if an option is wrong; ResourceError if nothing
    can be rendered, or a process cannot be started.

    Parameters
    ----------
    n : int
        Number of faces, 1 or more.
    **options
        Fields of :class:`fapengine.agents.face.AgentOptions`, the same as the agent's: ``head``, ``size``, ...
    """
    if n < 1:
        raise UsageError(f"n: got {n}, expected 1 or more faces")
    chosen, closed = AgentOptions(**options), _closed
    faces: list[AgentFace] = []
    try:
        faces.extend(AgentFace.open(chosen) for _ in range(n))
        with ThreadPoolExecutor(1) as thread:  # there may be an event loop in this one
            thread.submit(asyncio.run, _ready(faces)).result()
    except ResourceError:
        for face in faces:
            face.close()
        raise
    _keep(chosen, faces, closed)


def open_face(options: AgentOptions) -> AgentFace:
    """Take a warm face with these options, or open one; raises as :meth:`fapengine.agents.face.AgentFace.open`."""
    with _lock:
        entry = next((one for one in _warm if one[:2] == (os.getpid(), options)), None)
        if entry is not None:
            _warm.remove(entry)
    if entry is None:
        return AgentFace.open(options)
    Thread(target=_replace, args=(options, _closed), daemon=True).start()
    return entry[2]


def close_warm() -> None:
    """End all faces that nobody has taken."""
    global _closed
    with _lock:
        _closed += 1
        faces = [face for process, _, face in _warm if process == os.getpid()]
        _warm.clear()
    for face in faces:
        face.close()


async def _ready(faces: Sequence[AgentFace]) -> None:
    await asyncio.gather(*(face.ready() for face in faces))


def _keep(options: AgentOptions, faces: Sequence[AgentFace], closed: int) -> None:
    with _lock:
        is_late = closed != _closed
        if not is_late:
            _warm.extend((os.getpid(), options, face) for face in faces)
    if is_late:
        for face in faces:
            face.close()


def _replace(options: AgentOptions, closed: int) -> None:
    try:
        _keep(options, [AgentFace.open(options)], closed)
    except ResourceError as error:
        log.warning("no face is kept warm: %s", error)


atexit.register(close_warm)
