"""Faces that are started before they are needed; the faces are stand-ins."""

import asyncio
from collections.abc import Iterator

import pytest

from fapengine.agents import prewarm, warm
from fapengine.agents.face import AgentFace, AgentOptions
from fapengine.errors import ResourceError, UsageError


class StandInFace:
    """Ready when it says so."""

    made: list["StandInFace"] = []  # noqa: RUF012
    fails = False

    def __init__(self, options: AgentOptions) -> None:
        self.options, self.is_ready, self.is_closed = options, False, False
        self.made.append(self)

    async def ready(self) -> None:
        if self.fails:
            raise ResourceError("painter: no OpenGL")
        self.is_ready = True

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[StandInFace]]:
    StandInFace.made = []
    monkeypatch.setattr(AgentFace, "open", StandInFace)
    monkeypatch.setattr(warm, "Thread", AtOnce)
    yield StandInFace.made
    warm.close_warm()


class AtOnce:
    """Stand-in for a thread: it has ended when it has started."""

    def __init__(self, target: object, args: tuple[object, ...], daemon: bool) -> None:
        self.run = lambda: target(*args)  # type: ignore[operator]

    def start(self) -> None:
        self.run()


def test_an_agent_takes_a_warm_face_and_another_one_replaces_it(made: list[StandInFace]) -> None:
    prewarm(2, head="woman")
    assert [(face.options.head, face.is_ready) for face in made] == [("woman", True)] * 2
    taken = [warm.open_face(AgentOptions(head="woman")) for _ in range(3)]
    assert taken == [made[0], made[1], made[2]]
    assert len(made) == 5
    warm.close_warm()
    assert [face.is_closed for face in made] == [False, False, False, True, True]


def test_a_face_that_is_started_while_all_are_closed_is_closed_too(
    made: list[StandInFace], monkeypatch: pytest.MonkeyPatch
) -> None:
    prewarm()
    later: list[object] = []
    monkeypatch.setattr(AtOnce, "start", lambda self: later.append(self.run))
    warm.open_face(AgentOptions())
    warm.close_warm()
    for run in later:
        run()  # type: ignore[operator]
    assert [face.is_closed for face in made] == [False, True]


def test_other_options_and_other_processes_get_faces_of_their_own(
    made: list[StandInFace], monkeypatch: pytest.MonkeyPatch
) -> None:
    prewarm(1, head="woman")
    assert warm.open_face(AgentOptions(head="man")) is made[1]
    assert warm.open_face(AgentOptions(head="woman", size=[512, 512])) is made[2]  # type: ignore[arg-type]
    monkeypatch.setattr(warm.os, "getpid", lambda: 0)
    assert warm.open_face(AgentOptions(head="woman")) is made[3]


def test_it_may_be_called_beside_an_event_loop(made: list[StandInFace]) -> None:
    async def main() -> None:
        prewarm()

    asyncio.run(main())
    assert made[0].is_ready


def test_faces_that_cannot_be_rendered_are_closed(made: list[StandInFace], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(StandInFace, "fails", True)
    with pytest.raises(ResourceError, match="no OpenGL"):
        prewarm(2)
    assert all(face.is_closed for face in made)
    with pytest.raises(UsageError, match="n: got 0"):
        prewarm(0)
