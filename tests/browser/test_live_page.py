"""``<fap-face>`` with static files only: it says phones and follows sound, without a server, under a strict policy."""

import json
from collections.abc import Iterator

import numpy as np
import pytest

from fapengine.files.profiles import load_profile
from fapengine.speech.phone_track import Phone, PhoneTrack
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from tests.browser.bundlers import opened
from tests.browser.conftest import Page
from tests.browser.live_sound import judged, make_site
from tests.unit.recognition.speech import BABY, Spoken, spoken_by_espeak

PATIENT_S = 2.0
"""Delay of the face after the sound, so that a recognizer on a busy machine is not late."""
MAMA = [Phone(label, at_s, at_s + 0.15) for label, at_s in zip("mɑmɑ", (0.2, 0.35, 0.5, 0.65), strict=True)]


@pytest.fixture(scope="module")
def sentence() -> Spoken:
    return spoken_by_espeak("en-us", BABY)


@pytest.fixture(scope="module")
def site(sentence: Spoken, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("static")
    make_site(folder, {"baby": sentence})
    with opened(folder) as url:
        yield url


@pytest.fixture
def static(page: Page, site: str) -> Page:
    page.go(site)
    page.until("window.isReady")
    return page


def test_phones_are_said_as_they_are_planned(static: Page) -> None:
    assert not {"planner.bin", "recognizer.bin", "live.js"} & set(static.run("fetched()"))
    given = json.dumps([{"label": one.label, "start": one.start_s, "end": one.end_s} for one in MAMA])
    static.run(f"window.at = 0, face.say({given}, {{ clock: () => at }})")
    static.until("face.source.clock")
    style = Style.speech_only()
    planned = plan(PhoneTrack.from_phones(MAMA), load_profile("grid_s1_en"), rng=np.random.default_rng(0), style=style)
    shown = []
    for number in range(0, len(planned.track.values), 3):
        static.run(f"window.at = {number} / 30")
        static.until(f"face.source.position === {number} / 30")
        shown.append(static.run("[...face.faps]"))
    assert np.array_equal(shown, planned.track.values[::3])
    static.run("window.at = 2")
    static.until("told.some(([type]) => type === 'finished')")
    told = [[kind, detail and detail["label"]] for kind, detail in static.run("told")]
    assert told == [["started", None], *(["phone", one.label] for one in MAMA), ["finished", None]]
    assert "recognizer.bin" not in static.run("fetched()")
    assert "expected a label" in static.run(
        "face.say([{ label: 'm', start: 1, end: 1 }]).catch(({ message }) => message)"
    )


def test_it_follows_sound_in_step_with_the_sound_that_it_returns(static: Page, sentence: Spoken) -> None:
    found = static.run(f"hear('baby.wav', 44100, {PATIENT_S})")
    said = [detail["label"] for kind, detail in static.run("told") if kind == "phone"]
    assert sum(label in ("p", "b", "m") for label in said) >= 6
    assert judged(found, sentence)[0] > 0.6
    assert {"planner.bin", "recognizer.bin", "worker.js", "tap-worklet.js"} <= set(static.run("fetched()"))
    assert static.run("told.filter(([type]) => type === 'error')") == []


def test_it_follows_a_stream_and_stops_where_the_element_is_taken_away(static: Page) -> None:
    static.run(
        "navigator.mediaDevices.getUserMedia({ audio: true }).then((stream) => face.hear(window.stream = stream))"
    )
    static.until("told.filter(([type]) => type === 'phone').length > 5")
    static.run("window.source = face.source, face.cancel()")
    static.until("told.some(([type]) => type === 'cancelled')")
    static.until("told.at(-1)[0] === 'phone'")  # and goes on
    static.run("face.remove()")
    assert static.run("[source.run, source.clock, source.isSpeaking]") == [None, None, False]
    static.run("stream.getTracks().forEach((track) => track.stop())")
