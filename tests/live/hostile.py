"""What a hostile or broken peer may send: datagrams and streams that no server should stumble over."""

import random
import struct
from collections.abc import Iterator

from fapengine.wire import osc
from fapengine.wire.framing import encode_length, encode_slip

ADDRESSES = (
    "/phoneme", "/viseme", "/tts/start", "/tts/stop", "/expr", "/gaze", "/blink", "/head", "/param", "/fap/1/hello",
    "/fap/1/ping", "/fap/1/utt/begin", "/fap/1/phones", "/fap/1/utt/end", "/fap/1/utt/cancel", "/fap/1/utt/pause",
    "/fap/1/utt/seek", "/fap/1/audio", "/fap/1/expr", "/fap/1/gaze", "/fap/1/param", "/fap/1/bye", "/fap/9/x", "/",
)  # fmt: skip
INTS = (0, 1, -1, 2**31 - 1, -(2**31), 255, 10_000)
FLOATS = (0.0, 1.0, -1.0, 1e30, -1e30, float("nan"), float("inf"), 1e-30)
STRINGS = ("", "a", "hostile", "m" * 400, "\x7f", "é" * 20, "joy", "ipa", "now", "at", "audio", "jaw", "nan")


def message(rng: random.Random) -> bytes:
    """A message of a known address, with arguments that may be anything."""
    tags, values = "", []
    for _ in range(rng.randrange(12)):
        tag = rng.choice("ifshdbTFN")
        tags += tag
        if tag in "ih":
            values.append(rng.choice(INTS))
        elif tag in "fd":
            values.append(rng.choice(FLOATS if tag == "d" else FLOATS[:3] + FLOATS[5:]))
        elif tag == "s":
            values.append(rng.choice(STRINGS))
        elif tag == "b":
            values.append(rng.randbytes(rng.randrange(1, 40)))
        else:
            values.append({"T": True, "F": False, "N": None}[tag])
    return osc.message(rng.choice(ADDRESSES), tags, *values)


def bundle(inner: bytes, time_tag: int) -> bytes:
    """One element at a time."""
    return osc.BUNDLE + struct.pack(">Q", time_tag) + struct.pack(">i", len(inner)) + inner


def datagrams(rng: random.Random) -> Iterator[bytes]:
    """Without end: random, cut, flipped, too deep, too large, from another time."""
    while True:
        good = message(rng)
        yield good
        yield rng.randbytes(rng.randrange(1, 200))
        yield good[: rng.randrange(len(good))]
        at = rng.randrange(len(good))
        yield good[:at] + bytes([good[at] ^ 1 << rng.randrange(8)]) + good[at + 1 :]
        yield bundle(good, rng.choice((0, 1, 2**64 - 1, rng.getrandbits(64))))
        deep = good
        for _ in range(rng.choice((3, 30, 300))):
            deep = bundle(deep, 1)
        yield deep
        yield osc.BUNDLE_HEAD + struct.pack(">i", rng.choice((-4, 0, 2**31 - 4, 3))) + good
        many = [message(rng) for _ in range(100)]
        yield osc.BUNDLE_HEAD + b"".join(struct.pack(">i", len(each)) + each for each in many)
        yield b"/" + b"x" * 60_000


def streams(rng: random.Random) -> list[bytes]:
    """What connections may say before they hang up, or never do."""
    good = message(rng)
    return [
        b"\xff\xff\xff\xff" + good,  # 4 GiB
        b"\x7f\xff\xff\xff",
        b"\x00\x01\x00\x04" + bytes(10),  # a little too long
        b"\x00\x00\x00\x00",
        b"\x00\x01\x00\x00" + b"never whole",
        encode_length(good) * 50 + b"\xff\xff\xff\xff",
        b"\xc0" + good,  # unterminated
        b"\xc0" + bytes(200_000),  # far too long
        b"\xc0\xdb\x00\xdb" * 1000,
        encode_slip(good) * 50 + b"\xc0\xdb",
        b"\xc0" * 10_000,
        b"GET / HTTP/1.1\r\n\r\n",
        b"\x16\x03\x01\x02\x00" + rng.randbytes(100),  # TLS
        b"/" + rng.randbytes(1000),
        rng.randbytes(5000),
        b"",
    ]
