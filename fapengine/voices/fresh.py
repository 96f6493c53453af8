"""A voice that says each text as if it were its first: the same text is the same sound, whatever was said before.

espeak-ng keeps what it cannot be made to forget: the second text of a process comes out a little otherwise than the
first (54,842 and 54,852 samples for one sentence), whatever is initialised or seeded in between. So each text is spoken
by a process that has not spoken yet. Where there is ``fork`` it is a copy of one that has only loaded the library.
"""

import os
import pickle
import subprocess
import sys

from fapengine.errors import FapEngineError, ResourceError
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.protocol import Speech
from fapengine.voices.worker import LENGTH, packed

START = "import sys; sys.path[:] = {path!r}; from fapengine.voices.worker import main; main(afresh=True)"


class FreshVoices:
    """Voices of a process that copies itself for each text. Stateful."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def speak(self, text: str, choice: VoiceChoice) -> Speech:
        """Speak a text.

        Raises
        ------
        UsageError, ResourceError
            As :meth:`fapengine.voices.espeak.EspeakVoice.speak` does.
        """
        try:
            answer = self._ask(text, choice)
        except (OSError, EOFError) as error:
            self.close()
            raise ResourceError("voice: its process has ended; ask again") from error
        if not hasattr(os, "fork"):
            self.close()  # it has spoken
        if isinstance(answer, FapEngineError):
            raise answer
        assert isinstance(answer, Speech)
        return answer

    def _ask(self, text: str, choice: VoiceChoice) -> object:
        if self._process is None or self._process.poll() is not None:
            command = [sys.executable, "-c", START.format(path=sys.path)]
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(packed((text, choice, float("inf"))))
        stdin.flush()
        head = stdout.read(LENGTH.size)
        data = stdout.read(LENGTH.unpack(head)[0]) if len(head) == LENGTH.size else b""
        if not data:
            raise EOFError
        return pickle.loads(data)

    def close(self) -> None:
        """End the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.communicate()

    def __enter__(self) -> "FreshVoices":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
