"""Words of an utterance in a child process; a process that was killed is started again."""

import asyncio

import numpy as np
import pytest

from fapengine.recognition.protocol import RATE_HZ
from fapengine.recognition.words import WordRecognizer
from tests.unit.recognition.speech import spoken_by_espeak

pytest.importorskip("pocketsphinx")


def test_words_are_recognized_also_after_the_process_was_killed() -> None:
    async def heard() -> tuple[str, str]:
        recognizer = WordRecognizer()
        nothing = await recognizer.words(np.zeros(RATE_HZ // 2, np.int16))
        assert recognizer._child is not None
        recognizer._child.kill()
        recognizer._child.process.wait()
        found = await recognizer.words(spoken_by_espeak("en-us", "What is the weather?").samples)
        recognizer.close()
        return nothing, found

    assert asyncio.run(heard()) == ("", "what is the weather")
