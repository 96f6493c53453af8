"""The page that calls: the face by WHEP, the microphone by WHIP, in a real browser with a microphone that is a file."""

import time

import numpy as np

from tests.browser.conftest import Page

FACE = "document.getElementById('face')"
LIMIT_S = 300.0
TROUBLE = "document.getElementById('trouble')"

VIEWER = """async () => {
    window.peer = new RTCPeerConnection();
    window.late = document.createElement("video");
    document.body.append(late);
    peer.ontrack = ({ track }) => {
        late.srcObject = new MediaStream([track]);
        late.play();
    };
    peer.addTransceiver("video", { direction: "recvonly" });
    await peer.setLocalDescription();
    const headers = { "Content-Type": "application/sdp" };
    const body = peer.localDescription.sdp;
    const answer = await fetch(`/whep${location.search}`, { method: "POST", headers, body });
    await peer.setRemoteDescription({ type: "answer", sdp: await answer.text() });
}"""
"""Another viewer of the page's session."""


def dial(page: Page, session: str) -> None:
    page.go(f"{page.server.url}call.html?session={session}")
    page.until("document.body.dataset.watching === 'false'")


def press(page: Page, name: str) -> None:
    """By keyboard: the focus is moved there, and Enter pressed."""
    page.run(f"document.getElementById('{name}').focus()")
    page.key("Enter")


def mouth(page: Page) -> np.ndarray:
    """The middle of the mouth in the picture that is shown."""
    page.run(
        f"window.still = new OffscreenCanvas(256, 256);window.still.getContext('2d').drawImage({FACE}, 0, 0, 256, 256)"
    )
    pixels = page.run("[...window.still.getContext('2d').getImageData(116, 158, 24, 42).data]")
    return np.array(pixels).reshape(42, 24, 4)[..., 1]


def test_a_face_is_called_and_says_what_the_microphone_hears(page: Page) -> None:
    dial(page, "paul")
    page.key("Tab")
    assert page.run("document.activeElement.id") == "call"
    page.key("Enter")
    page.until(f"{FACE}.videoWidth === 256")
    page.until("document.getElementById('state').textContent === 'You see the face.'")
    rest = int((mouth(page) < 110).sum())
    press(page, "microphone")
    page.until("document.body.dataset.speaking === 'true'")
    page.until("document.getElementById('sound').textContent === 'Sound off'")
    until_s = time.monotonic() + LIMIT_S
    while int((mouth(page) < 110).sum()) <= rest + 60:  # the microphone's sentence is said over and over
        assert time.monotonic() < until_s
        page.sleep(0.05)
    press(page, "microphone")
    page.until("document.body.dataset.speaking === 'false'")
    press(page, "call")
    page.until("document.body.dataset.watching === 'false'")
    assert page.run(f"{TROUBLE}.hidden")


def test_two_viewers_see_the_same_face_and_one_comes_late(page: Page) -> None:
    dial(page, "tina")
    press(page, "call")
    page.until("document.getElementById('state').textContent === 'You see the face.'")
    page.until(f"{FACE}.currentTime > 1.5")  # the first keyframe is over
    page.run(f"({VIEWER})()")
    seen = []
    for face in (FACE, "late"):
        page.until(f"{face}.videoWidth === 256 && {face}.currentTime > 0.5")
        page.run(
            "window.still = new OffscreenCanvas(64, 64).getContext('2d', { willReadFrequently: true });"
            f"window.still.drawImage({face}, 0, 0, 64, 64)"
        )
        pixels = page.run("[...window.still.getImageData(0, 0, 64, 64).data]")
        seen.append(np.array(pixels).reshape(64, 64, 4)[..., :3].astype(float))
    assert np.std(seen[0]) > 20
    assert np.abs(seen[0] - seen[1]).mean() < 6  # of 255: a still face, with other bits of the same stream
    page.run("peer.close()")
    page.until(f"(window.before ??= {FACE}.currentTime) < {FACE}.currentTime - 0.5")  # the other one still sees it
    press(page, "call")
    page.until("document.body.dataset.watching === 'false'")


def test_what_goes_wrong_is_told_in_words(page: Page) -> None:
    dial(page, "quinn")
    page.run("navigator.mediaDevices.getUserMedia = async () => { throw new DOMException('', 'NotAllowedError'); }")
    press(page, "microphone")
    page.until(f"{TROUBLE}.textContent === 'The microphone was not allowed.'")
    assert not page.run(f"{TROUBLE}.hidden")
    page.run("window.fetch = async () => new Response('calls: got one more than 4', { status: 503 })")
    press(page, "call")
    page.until(f"{TROUBLE}.textContent === 'calls: got one more than 4'")
    page.run("window.fetch = async () => new Response('', { status: 404 })")
    press(page, "call")
    page.until(f"{TROUBLE}.textContent.includes('fapengine serve --webrtc')")
    page.run("window.fetch = async () => { throw new TypeError(); }")
    press(page, "call")
    page.until(f"{TROUBLE}.textContent === 'The server does not answer.'")
    assert page.run("document.body.dataset.watching") == "false"


def test_a_call_comes_back_after_its_server(page: Page) -> None:
    dial(page, "rita")
    press(page, "call")
    page.until("document.getElementById('state').textContent === 'You see the face.'")
    page.server.kill()
    page.until("document.getElementById('state').textContent.includes('calling again')")
    assert page.run("document.body.dataset.watching") == "true"
    assert page.run(f"{FACE}.videoWidth") == 256  # the last picture stays
    page.server.start()
    page.until("document.getElementById('state').textContent === 'You see the face.'")
    page.server.kill()
    page.until("document.getElementById('state').textContent.includes('calling again')")
    press(page, "call")  # hangs up while it calls
    page.until("document.body.dataset.watching === 'false'")
    assert page.run("document.getElementById('state').textContent") == "Not connected."
    page.server.start()
    page.run("fetch('/').then(() => 0)")  # until then complaints of the time before may come
    excused = ("ERR_CONNECTION_REFUSED", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE")
    page.complaints[:] = [one for one in page.complaints if not any(reason in one for reason in excused)]
