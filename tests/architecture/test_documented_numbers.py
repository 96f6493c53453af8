"""Numbers that the documents promise are those of the code: sentences of ``docs/`` on one side, constants on the other.

That the constants do what their names say is tested where they are used; ``design/mutations.py`` breaks some of them.
"""

from pathlib import Path

import pytest

from fapengine.audio import clock as sound_clock
from fapengine.audio import device, mixer, output
from fapengine.engine import session
from fapengine.host import host
from fapengine.laboratory import context_fit
from fapengine.server import server
from fapengine.server.web import connection
from fapengine.trajectory import closures, expression, hermite, stream, targets
from fapengine.wire import livelink, vmc
from fapengine.wire.speech_osc import clock as peer_clock
from fapengine.wire.speech_osc import (
    handshake,
    one_shot,
    peers,
    receive_window,
    schema,
    send_window,
)

DOCS = Path(__file__).parents[2] / "docs"
TEXT = " ".join(" ".join(path.read_text(encoding="utf-8").split()) for path in sorted(DOCS.rglob("*.md")))
LIMITS = session.Limits()
ORDINALS = {3: "three"}
PROMISES = (
    # docs/osc.md
    ("lasts until the next one, {} s at most", one_shot.QUIET_S),
    ("Everything is shown {} ms late", 1e3 * one_shot.DELAY_S),
    ("which is guessed from the last {} labels of a sender", peers.GUESSED_FROM),
    ("a tag more than {} s ahead", peer_clock.MAX_SKEW_S),
    ("{} in a row more than {} s late", ORDINALS[peer_clock.LATE_IN_A_ROW], peer_clock.LATE_S),
    ("the server's voice says it, {} bytes at most", schema.TEXT_BYTES),
    ("Sent {} ms after they came", 1e3 * receive_window.ACK_S),
    ("Session names have 1 to {} bytes, labels up to {}", schema.SESSION_BYTES, schema.LABEL_BYTES),
    ("utterances end within {} minutes", LIMITS.queued_s / 60),
    ("A message fits a datagram of {} bytes", schema.MAX_DATAGRAM),
    ("a packet above {} KiB is dropped", peers.WireLimits().packet / 1024),
    ("It pings {} times at once, then every {} s", handshake.FIRST_PINGS, handshake.PING_S),
    (
        "and {} ms ({} to {} ms", 1e3 * send_window.MARGIN_S, 1e3 * send_window.MIN_REPEAT_S,
        1e3 * send_window.MAX_REPEAT_S,
    ),
    ("does not acknowledge, at {}, {} and {} ms", *(1e3 * after_s for after_s in send_window.END_REPEATS_S)),
    ("the quickest of its last {} pings counts", peer_clock.WINDOW),
    ("at most {} % faster or slower, and jumps only from {} ms on", 100 * session.SLEW, 1e3 * session.JUMP_S),
    ("lips close for a p b m that ended up to {} s ago", stream.LATEST_CLOSURE_S),
    ("event `underrun`; after {} s the utterance is `finished`", LIMITS.silence_s),
    ("bundles split under {} bytes", vmc.MAX_DATAGRAM),
    ("| `vmc://HOST[:{}]` |", vmc.MARIONETTE_PORT),
    ("port {} gets blendshapes only", vmc.PERFORMER_PORT),
    ("| `livelink://HOST[:{}]` |", livelink.PORT),
    # docs/live.md and docs/page.md
    ("SIGTERM or Ctrl-C | returns to neutral in {} s", server.DRAIN_FADE_S),
    ("continues by the clock after {} s", host.SOUND_WAIT_S),
    ("then waits up to {} s for its `audio`", host.SOUND_WAIT_S),
    ("a page {} messages behind is closed", connection.MAX_TEXTS),
    # docs/sound-and-window.md
    ("The smallest distance of the last {} s", sound_clock.OFFSET_WINDOW_S),
    (
        "{} reports in a row that are {} ms off, or one that is {} ms",
        ORDINALS[sound_clock.STEPS], 1e3 * sound_clock.STEP_S, 1e3 * sound_clock.JUMP_S,
    ),
    (
        "at most {} % faster or slower to correct itself, and jumps if it is more than {} ms off",
        100 * sound_clock.MAX_SLEW, 1e3 * sound_clock.LEAP_S,
    ),
    ("The engine receives each sound's position {} times a second", 1 / output.TELL_EVERY_S),
    ("plays {} s of silence before its reports are used", device.SETTLE_S),
    ("If it has fetched nothing for {} s", device.DEAD_S),
    ("fades out its sound within {} ms", 1e3 * mixer.FADE_S),
    # docs/trajectories.md
    ("two per phone ({} and {} %)", *(100 * fraction for fraction in context_fit.FRACTIONS)),
    ("if they would be less than {} ms apart", 1e3 * targets.APART_S),
    ("0.3 mm for {} ms, or the whole phone", 1e3 * closures.MIN_HOLD_S),
    ("any expressions up to strength {}", expression.MAX_WEIGHT),
    ("| overshoot | ≤ {} % of the range", 100 * hermite.OVERSHOOT),
    ("left {} s before the first phone, reached {} s after the last phone", targets.LEAD_S, targets.REST_MARGIN_S),
)  # fmt: skip


@pytest.mark.parametrize("promise", PROMISES, ids=lambda promise: promise[0])
def test_what_the_documents_promise_is_what_the_code_has(promise: tuple[str | float, ...]) -> None:
    sentence, *values = promise
    shown = [value if isinstance(value, str) else f"{value:.6g}" for value in values]
    assert str(sentence).format(*shown) in TEXT
