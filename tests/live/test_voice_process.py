"""The voice as a process of its own: it speaks as one in this process does, and can be ended whatever it does."""

import asyncio

import numpy as np
import pytest

from fapengine.errors import NothingToSpeakError, ResourceError, UsageError
from fapengine.voices import process as voice_process
from fapengine.voices.choice import VoiceChoice
from fapengine.voices.espeak import EspeakVoice
from fapengine.voices.process import VoiceProcess
from fapengine.wire import osc
from tests.live.stage import Ear, Sender, config_of, on_a_loop, running, until

ENDLESS = "字" * 4000
"""Read out in English it takes espeak-ng 5 s and more, and gives half an hour of sound."""
CHOICE = VoiceChoice()


def test_it_speaks_as_a_voice_in_this_process_does_and_tells_what_is_wrong() -> None:
    async def main() -> None:
        voice = VoiceProcess()
        spoken = await voice.speak("Mama.", VoiceChoice("de", 140), 9.0)
        here = EspeakVoice("de", 140).speak("Mama.")
        # espeak-ng is not repeatable to the sample once it has spoken something else.
        assert len(spoken.samples) == pytest.approx(len(here.samples), abs=220)  # 10 ms; at 175 words it is 2,600 less
        assert np.abs(spoken.samples).max() == pytest.approx(np.abs(here.samples).max(), rel=0.1)
        same = [[(one.label, one.stress, one.word) for one in speech.phones.phones] for speech in (spoken, here)]
        assert same[0] == same[1]
        times = [[one.start_s for one in speech.phones.phones] for speech in (spoken, here)]
        assert times[0] == pytest.approx(times[1], abs=0.01)
        with pytest.raises(NothingToSpeakError, match="nothing to speak"):
            await voice.speak("...", CHOICE, 9.0)
        with pytest.raises(UsageError, match="qq"):
            await voice.speak("Mama.", VoiceChoice("qq"), 9.0)
        with pytest.raises(UsageError, match="whose sound is too long, expected at most 9 s more"):
            await voice.speak("字" * 300, CHOICE, 9.0)
        voice.close()
        await voice.wait_closed()

    on_a_loop(main)


def test_a_text_whose_voice_ends_is_spoken_once_more_and_the_next_one_has_a_new_voice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def main() -> None:
        voice = VoiceProcess()
        asked = asyncio.create_task(voice.speak(ENDLESS, CHOICE, 1e9))
        await until(lambda: voice._child is not None)
        first = voice._child
        first.kill()
        await until(lambda: voice._child not in (None, first))
        voice._child.kill()
        with pytest.raises(ResourceError, match="its process has ended"):
            await asked
        assert (await voice.speak("Mama.", CHOICE, 9.0)).duration_s > 0.3
        monkeypatch.setattr(voice_process, "PIECE_LIMIT_S", 0.2)
        with pytest.raises(ResourceError, match="no answer"):
            await voice.speak(ENDLESS, CHOICE, 1e9)
        assert voice._child is None
        voice.close()
        with pytest.raises(ResourceError, match="has ended"):
            await voice.speak("Mama.", CHOICE, 9.0)

    on_a_loop(main)


def test_an_asker_who_is_gone_does_not_end_the_voice() -> None:
    async def main() -> None:
        voice = VoiceProcess()
        gone = asyncio.create_task(voice.speak("字" * 100, CHOICE, 1e9))
        await until(lambda: voice._child is not None)
        first = voice._child
        gone.cancel()
        assert (await voice.speak("Mama.", CHOICE, 9.0)).duration_s > 0.3
        assert voice._child is first
        voice.close()
        await voice.wait_closed()

    on_a_loop(main)


def test_a_server_that_is_told_to_stop_does_not_wait_for_its_voice() -> None:
    async def main() -> None:
        ear = Ear.open()
        async with running(config_of(f"osc://127.0.0.1:{ear.port}")) as server:
            sender = Sender(server.osc_address)
            sender.tell("/fap/1/hello", "sissi", "anna", 1, "ipa", "", 1)
            sender.utter("anna", 0, "ma" + "a" * 20)
            await until(lambda: max(ear.jaw("anna"), default=0) > 50)
            working = asyncio.create_task(server.voice.speak(ENDLESS, CHOICE, 1e9))
            await until(lambda: server.voice._child is not None)
            process = server.voice._child
            shown = len(ear.jaw("anna"))
        with pytest.raises(ResourceError, match="has ended"):
            await working  # not spoken to its end
        assert process.process.returncode == -9
        jaw = ear.jaw("anna")
        assert jaw[-1] == 0
        assert len(jaw) - shown < 2 * 60 * 0.5  # it drained for 0.3 s of frames, not for the seconds of the voice
        sender.close()
        ear.close()

    on_a_loop(main)


def test_a_sender_is_told_why_its_text_was_not_spoken() -> None:
    async def main() -> None:
        async with running(config_of(queued_s=2.0)) as server:
            sender, told = Sender(server.osc_address), []
            sender.tell("/tts/text", "s", "字" * 1000)

            def answers() -> list[osc.Message]:
                told.extend(message for message in sender.answers() if message.address == "/fap/1/event")
                return told

            await until(lambda: bool(answers()))
            assert told[0].arguments[2] == "error"
            assert "whose sound is too long" in str(told[0].arguments[-1])
            sender.close()

    on_a_loop(main)
