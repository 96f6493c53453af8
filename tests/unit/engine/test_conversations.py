"""Recorded conversations without a voice move the face as they moved it; ``tests/snapshots`` has the others."""

import pytest

from tests.snapshots import sessions

NAMES = [name for name in sessions.conversations() if name not in sessions.VOICED]
REPLAYED = sessions.read_digests()


@pytest.mark.parametrize("name", NAMES)
def test_a_face_moves_as_it_moved(name: str) -> None:
    assert sessions.replay(name) == REPLAYED[name]
