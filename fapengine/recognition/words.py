"""The words of an utterance, by PocketSphinx's language model of US English, in a child process.

PocketSphinx holds Python's lock while it works, about 0.4 s for each second of speech.
"""

import asyncio

import numpy as np
from numpy.typing import NDArray

from fapengine._child import NICENESS, Child, Parent, command
from fapengine.errors import ResourceError
from fapengine.recognition.sphinx import decode, new_word_decoder


class WordRecognizer:
    """Recognizes one utterance after the other. A process that has ended is started again. Stateful; close it."""

    def __init__(self) -> None:
        self._child: Child | None = None
        self._turn = asyncio.Lock()

    async def words(self, samples: NDArray[np.int16]) -> str:
        """Return the words of an utterance, separated by spaces; empty if there are none.

        Parameters
        ----------
        samples : (N,) int16
            Mono, 16 kHz.

        Raises
        ------
        ResourceError
            If the process cannot be started, or ends twice.
        """
        async with self._turn:
            for _ in range(2):
                self._child = self._child or Child("word recognizer", command(__name__, niceness=NICENESS))
                try:
                    head, _ = await asyncio.to_thread(self._child.ask, {}, samples.astype("<i2").tobytes())
                    return str(head["words"])
                except EOFError:
                    self.close()
            raise ResourceError("word recognizer: its process has ended")

    def close(self) -> None:
        """End the process."""
        child, self._child = self._child, None
        if child is not None:
            child.close()


def main(parent: Parent) -> None:
    """Recognize the parent's utterances."""
    decoder = new_word_decoder()
    for _, data in parent.messages():
        decode(decoder, np.frombuffer(data, "<i2"))
        best = decoder.hyp()
        parent.tell({"words": best.hypstr if best else ""})
