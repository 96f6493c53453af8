"""Words of an utterance in a child process; a process that was killed is started again."""

import asyncio

import pytest

from fapengine.recognition.words import WordRecognizer
from tests.unit.recognition.speech import spoken

pytest.importorskip("pocketsphinx")


def test_words_are_recognized_also_after_the_process_was_killed() -> None:
    question = spoken("slt", "What is the weather?").samples

    async def heard() -> tuple[str, str]:
        recognizer = WordRecognizer()
        before = await recognizer.words(question)
        assert recognizer._child is not None
        recognizer._child.kill()
        recognizer._child.process.wait()
        found = await recognizer.words(question)
        recognizer.close()
        return before, found

    assert asyncio.run(heard()) == ("what is the weather",) * 2
