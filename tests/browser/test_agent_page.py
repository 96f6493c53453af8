"""The page that talks with an agent, in a real browser; no agent answers."""

from collections.abc import Iterator

import pytest

from tests.browser.bundlers import opened
from tests.browser.conftest import ROOT, Page

ASKED_FOR_LEAVE = """(() => {
    const real = navigator.mediaDevices.getUserMedia.bind(navigator.mediaDevices);
    navigator.mediaDevices.getUserMedia = async (wanted) => {
        await new Promise((allow) => (window.allow = allow));
        return (window.opened = await real(wanted));
    };
})()"""


@pytest.fixture(scope="module")
def site() -> Iterator[str]:
    with opened(ROOT / "web-page") as url:
        yield url


def test_who_hangs_up_before_the_microphone_is_allowed_is_not_heard(page: Page, site: str) -> None:
    page.go(f"{site}agent.html")
    page.until("document.getElementById('call').onclick")
    page.run(ASKED_FOR_LEAVE)
    page.run("document.getElementById('call').click()")
    page.until("window.allow")
    assert page.run("document.getElementById('call').textContent") == "Hang up"
    page.run("document.getElementById('call').click()")
    page.run("allow()")
    page.until("window.opened?.getTracks().every((track) => track.readyState === 'ended')", 20.0)
    assert page.run("document.getElementById('microphone').disabled")
    assert page.run("document.getElementById('trouble').hidden")
