"""The package's demo page with static files only: words, phones, an agent's track, a voice that reports its words."""

import json
from collections.abc import Iterator

import pytest

from tests.browser.bundlers import opened
from tests.browser.conftest import Page
from tests.browser.live_sound import make_site
from tests.unit.recognition.speech import BABY, spoken_by_espeak

VOICE = """
speechSynthesis.getVoices = () => [{ lang: "de-DE", localService: true }, { lang: "en-GB", localService: true }];
speechSynthesis.speak = (utterance) => (window.utterance = utterance);
window.SpeechSynthesisUtterance = class { constructor(text) { this.text = text; } };
"""
PUT = """(async (id) => {
    const files = new DataTransfer();
    files.items.add(new File([await (await fetch("../../baby.wav")).blob()], "baby.wav", { type: "audio/wav" }));
    const input = document.getElementById(id);
    input.files = files.files;
    input.dispatchEvent(new Event("change"));
})"""


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("demo")
    make_site(folder, {"baby": spoken_by_espeak("en-us", BABY)})
    with opened(folder) as url:
        yield url


@pytest.fixture
def demo(page: Page, site: str) -> Page:
    page.go(f"{site}package/demo/index.html")
    page.until("document.getElementById('face')?.picture?.count > 0")
    page.run("""window.told = [];
        document.getElementById("face").addEventListener("phone", ({ detail }) => told.push(detail.label));
        window.status_ = () => document.getElementById("status").textContent""")
    return page


def say(demo: Page, text: str) -> None:
    demo.run(f"document.getElementById('words').value = {json.dumps(text)}")
    demo.run("document.querySelector('#text button').click()")


def test_words_are_said_in_silence_where_there_is_no_voice(demo: Page) -> None:
    demo.run("speechSynthesis.getVoices = () => [{ lang: 'en-US', localService: false }], null")  # of another computer
    say(demo, "Mama 东京 mama.")
    demo.until("told.length >= 8")
    assert demo.run("told.join(' ')") == "m ɑ m ə m ɑ m ə"
    say(demo, "东京")
    demo.until("status_().startsWith('This is not read: 东京')")
    demo.run("document.querySelector('#phones button').click()")
    demo.until("told.length === 8 + 10")


def test_a_voice_that_reports_its_words_leads_the_face(demo: Page) -> None:
    demo.run(VOICE)
    say(demo, "Mama, my mama.")
    demo.until("window.utterance")
    assert demo.run("[utterance.text, utterance.lang]") == ["Mama, my mama.", "en-GB"]
    demo.run("window.at = () => document.getElementById('face').source.clock()")
    assert demo.run("at()") == 0
    demo.sleep(0.2)
    assert demo.run("at()") == 0  # it has not begun
    demo.run("utterance.onstart(), utterance.onboundary({ charIndex: 0, name: 'word' })")
    demo.until("told.length === 5")
    demo.sleep(0.3)
    my_s = demo.run("at()")
    assert 0.3 < my_s < 1.0
    assert demo.run("[told.length, at()]") == [5, my_s]  # it waits at the second word
    demo.run("utterance.onboundary({ charIndex: 6, name: 'word' })")
    demo.until("told.length === 7")
    assert demo.run("at()") > my_s
    demo.run("utterance.onend()")
    demo.until("told.length === 10")
    demo.run("delete window.utterance, told.length = 0")
    say(demo, "Mama.")
    demo.until("window.utterance")
    demo.run("utterance.onerror()")  # it fails before it begins
    demo.until("told.length === 4")


@pytest.mark.parametrize("way", ["track", pytest.param("file", marks=pytest.mark.nightly)])
def test_a_recording_is_followed_also_as_an_agents_track(demo: Page, way: str) -> None:
    demo.run(f"{PUT}({json.dumps(way)})")
    demo.until("told.length > 5")
    demo.run("document.getElementById('stop').click()")
    assert not demo.run("document.getElementById('status').classList.contains('wrong')")
