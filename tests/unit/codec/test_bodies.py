"""A face comes out of a face-and-body stream as it went in; its body is read to the end and left out.

The streams are put together here: the bits of the face are cut from a stream of the encoder, the bits of the body come
from the plain coder of bench/plain_codec.py, which shares no code with the codec's loops.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from bench.plain_codec import Model, PlainEncoder
from fapengine.codec.bits import unpack
from fapengine.codec.decoder import Decoder, decode
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.codec.planes import BODY_GROUPS, CODED_BAPS, SCALES
from fapengine.errors import ConformanceError, DataError, TruncatedError, UnsupportedError
from fapengine.mpeg4.track import FapTrack

pytestmark = pytest.mark.conformance

START, PLANE, END = (unpack(bytes([0, 0, 1, last])).tolist() for last in (0xBA, 0xBB, 0xB1))
LIMIT = 3
"""Range that is sent, in units of 60, for all BAPs."""


def face(frames: int = 24, every: int = 10) -> bytes:
    rng = np.random.default_rng(4)
    values = np.cumsum(rng.integers(-30, 31, (frames, 68)), axis=0)
    values[:, :2] = 0
    return encode(FapTrack.from_values(values, rate_hz=25.0), EncoderOptions(intra_every=every))


class Body:
    """A body that moves at random, coded plane by plane."""

    def __init__(self, quant: int = 1, kinds: tuple[int, ...] = (3,) * 24, lists: tuple[int, ...] = (1, 1, 1, 1)):
        self.rng = np.random.default_rng(5)
        self.quant, self.kinds, self.lists = quant, kinds, lists
        self.half = 60 * LIMIT // (SCALES[quant] or 1)

    def plane(self, intra: bool) -> list[int]:
        head: list[int] = []
        if intra:
            head = self._head()
            self.models = [Model(2 * self.half + 1) for _ in range(sum(self.mask))]
        coder = PlainEncoder()
        flat = Model(2 * self.half + 1)
        for model in self.models:
            symbol = int(self.rng.integers(2 * self.half + 1))
            coder.code(symbol, (flat if intra else model).sums)
            if not intra:
                model.update(symbol)
        coder.flush()
        return head + coder.bits

    def _head(self) -> list[int]:
        head = bits(self.quant, 5)
        self.mask: list[int] = []
        for kind, group in zip(self.kinds, BODY_GROUPS, strict=True):
            chosen = [int(kind == 3 or (kind == 1 and number % 2)) for number in group]
            head += [1, *bits(kind, 2), *(chosen if kind == 1 else [])]
            self.mask += chosen
        head += [0, 0, *self.lists]
        for sent in self.lists:
            marks = iter(self.mask)
            for group in BODY_GROUPS if sent else ():
                for nth in range(len(group)):
                    head += [1] * (nth % 4 == 0) + bits(LIMIT, 5) * next(marks)
        return head


def bits(number: int, count: int) -> list[int]:
    return [number >> (count - 1 - k) & 1 for k in range(count)]


def face_planes(stream: bytes) -> Iterator[tuple[bool, list[int]]]:
    every = unpack(stream).tolist()
    for part in decode(stream).planes:
        for first, behind, _ in part.extents.tolist():
            yield part.intra, every[first:behind]


def stuffed(stream: list[int], code: list[int]) -> list[int]:
    return [*stream, 0, *[1] * (7 - len(stream) % 8), *code]


def closed(stream: list[int]) -> bytes:
    return np.packbits(np.array(stuffed(stream, END), np.uint8)).tobytes()


def with_body(stream: bytes, body: Body, *, alone_every: int = 0, codes: bool = False) -> bytes:
    """Put a body behind every face, and after every so many planes one with a body alone."""
    out = list(START)
    for n, (intra, plane) in enumerate(face_planes(stream)):
        if codes and n:
            out = stuffed(out, PLANE)
        out += [plane[0], 1, 1, *plane[3:], *body.plane(intra)]
        if alone_every and n % alone_every == alone_every - 1:
            out += [0, 1, 0, 0, *body.plane(False)]
    return closed(out)


@pytest.mark.parametrize("codes", [False, True])
@pytest.mark.parametrize("quant", [0, 1, 5, 31])
def test_the_face_beside_a_body_is_the_face(quant: int, codes: bool) -> None:
    stream = face()
    got = decode(with_body(stream, Body(quant), codes=codes))
    assert np.array_equal(got.track.values, decode(stream).track.values)
    assert got.body_planes == 24
    assert not got.losses


def test_bodies_with_some_baps_and_none() -> None:
    stream = face(6, 3)
    for kinds in ((0,) * 24, (1,) * 24, (0, 1, 3) * 8):
        got = decode(with_body(stream, Body(kinds=kinds)))
        assert np.array_equal(got.track.values, decode(stream).track.values)


def test_a_plane_with_a_body_alone_is_a_skipped_frame() -> None:
    got = decode(with_body(face(6, 0), Body(), alone_every=2))
    assert got.track.frame_numbers.tolist() == [0, 1, 3, 4, 6, 7]
    assert got.body_planes == 9


def test_a_stream_may_begin_with_a_body_alone_and_end_without_one() -> None:
    stream = face(4, 0)
    body = Body()
    out = [*START, 1, 1, 0, 0, 0, 0, *body.plane(True), 0, 1, 0, 1, *bits(3, 4), *body.plane(False)]
    for _, plane in face_planes(stream):
        out += plane
    got = decode(closed(out))
    assert np.array_equal(got.track.values, decode(stream).track.values)
    assert Decoder().feed(closed(out))[0].number == 5  # two planes, and three frames skipped


def test_cut_anywhere_it_is_the_same() -> None:
    stream = with_body(face(8, 4), Body(kinds=(1,) * 4 + (3,) * 2 + (0,) * 18), alone_every=3)
    whole = Decoder().feed(stream)
    assert len(whole) == 8
    for size in (1, 7, 64):
        decoder = Decoder()
        pieces = [frame for at in range(0, len(stream), size) for frame in decoder.feed(stream[at : at + size])]
        assert [frame.values.tolist() for frame in pieces] == [frame.values.tolist() for frame in whole]


def test_a_cut_stream_is_truncated() -> None:
    stream = with_body(face(4, 0), Body())
    for end in (60, 200, len(stream) // 2):
        with pytest.raises(TruncatedError):
            decode(stream[:end])


def test_damage_costs_the_frames_up_to_the_next_i_plane() -> None:
    stream = bytearray(with_body(face(40, 8), Body(kinds=(1,) * 24)))
    middle = len(stream) // 2
    stream[middle : middle + 40] = np.random.default_rng(6).bytes(40)
    got = decode(bytes(stream), errors="resync")
    assert got.losses
    assert len(got.track) > 20


@pytest.mark.parametrize(
    ("bad", "kind", "message"),
    [
        (lambda: with_body(face(2, 0), Body(lists=(1, 1, 1, 0))), UnsupportedError, "BAP 1: range is missing"),
        (lambda: with_body(face(2, 0), Body(kinds=(2,) * 24)), ConformanceError, "mask type of body group 1: got 2"),
        (
            lambda: closed([*START, *next(face_planes(face()))[1], 0, 1, *[1, 0] * 40]),
            ConformanceError,
            "of which no I plane",
        ),
    ],
)
def test_what_cannot_be_read_is_named(bad: object, kind: type[DataError], message: str) -> None:
    with pytest.raises(kind, match=message):
        decode(bad())  # type: ignore[operator]


def test_every_bap_is_in_one_group() -> None:
    assert sorted(CODED_BAPS) == list(range(1, 297))
    assert len(SCALES) == 32
    assert list(SCALES) == sorted(SCALES)


def test_steps_of_the_scale_never_become_smaller() -> None:
    assert (len(SCALES), *SCALES[:3], SCALES[-1]) == (32, 0, 1, 2, 127)
    assert (np.diff(SCALES, 2) >= 0).all()


def test_a_bap_that_leaves_32_bits_is_an_error_that_names_it() -> None:
    decoder = Decoder()
    stream = with_body(face(6, 0), Body())
    decoder.feed(stream[: len(stream) // 2])
    decoder._body.previous[:] = 2**31 - 1  # as after some million planes that all add to it
    with pytest.raises(ConformanceError, match=r"BAP \d+: got a value that it cannot have .*FBA section 9"):
        decoder.feed(stream[len(stream) // 2 :]), decoder.feed(b"\0")
