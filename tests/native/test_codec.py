"""The codec's loops in C write and read what those in Python do."""

import importlib
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from fapengine.codec import kernels
from fapengine.codec.encoder import encode
from fapengine.codec.fapfile import parse_fap
from fapengine.codec.fields import FIELD_COUNT
from fapengine.codec.planes import PlaneState
from fapengine.codec.writer import StreamWriter
from tests.conftest import NO_COMPILER
from tests.native import built
from tests.native.codec_streams import answers, damaged, random_stream
from tests.unit.codec.conftest import vectors  # noqa: F401, a fixture


@pytest.fixture(scope="module")
def compiled() -> Iterator[ModuleType]:
    if not built.has_compiler():
        pytest.skip(NO_COMPILER)
    path = list(sys.path)
    built.imported()
    yield importlib.import_module("fapengine_native.codec")
    sys.path[:] = path
    built.forget()


@pytest.fixture
def both(compiled: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Each in turn: a test is a loop over it."""

    def each() -> Iterator[ModuleType]:
        for loops in (kernels, compiled):
            monkeypatch.setattr(kernels, "loops", loops)
            yield loops

    return each()


@pytest.mark.parametrize("case", range(10))
def test_random_streams_are_the_same_bytes_and_say_the_same_when_damaged(both: Iterator[ModuleType], case: int) -> None:
    said = []
    for _ in both:
        rng = np.random.default_rng([37, case])
        stream = random_stream(rng, 4)
        said.append((stream, [list(answers(each, 40)) for each in (stream, damaged(stream, rng))]))
    assert said[0] == said[1]


def test_the_vectors_of_other_encoders_are_read_alike(both: Iterator[ModuleType], vectors: Mapping[str, bytes]) -> None:  # noqa: F811
    streams = {name: data for name, data in vectors.items() if name.endswith(".fba") and len(data) < 4000}
    assert len(streams) >= 10
    first, second = ({name: list(answers(data, 10**6)) for name, data in streams.items()} for _ in both)
    assert first == second


def test_long_streams_halve_their_counts_alike(both: Iterator[ModuleType]) -> None:
    """The counts of a field are halved when their sum would be 16384."""
    values = np.zeros((16_400, 68), np.int64)
    values[:, 2] = np.random.default_rng(3).normal(0, 40, len(values))
    track = parse_fap(b"2.1 a 25 1\n" + b"0 0 1" + b" 0" * 65 + b"\n0 0\n")
    track = type(track)(
        values=values, mask=np.repeat(track.mask, len(values), axis=0), frame_numbers=np.arange(len(values)),
        visemes=np.zeros((len(values), 4), int), expressions=np.zeros((len(values), 6), int), rate_hz=25.0,
    )  # fmt: skip
    first, second = (encode(track) for _ in both)
    assert first == second


def test_values_out_of_range_name_the_same_field(both: Iterator[ModuleType]) -> None:
    def ends() -> Iterator[int]:
        for loops in both:
            writer = StreamWriter(clamp=False)
            state = writer.state = PlaneState()
            state.fields[:, kernels.ON], state.fields[:, kernels.P_COUNT], state.fields[:, kernels.I_COUNT] = 1, 9, 9
            state.fields[:, kernels.P_MIN] = state.fields[:, kernels.I_MIN] = -4
            state._set_ranges(slice(None), np.array([[4], [-4], [4], [-4]]) * np.ones(73, np.int64))
            target = np.zeros(73, np.int64)
            target[40] = 5
            yield loops.encode_plane(
                True, target, np.zeros(3, np.int64), state.fields, state.previous, state.encoding, False,
                np.zeros(2000, np.uint8), 0,
            )  # fmt: skip

    assert list(ends()) == [-41, -41]


def test_four_bits_before_a_start_code_are_stuffing_and_five_are_a_plane(both: Iterator[ModuleType]) -> None:
    bits = np.concatenate([np.zeros(8, np.uint8), np.unpackbits(np.frombuffer(b"\x00\x00\x00\x01\xbb", np.uint8))])
    for loops in both:
        for before in range(3, 9):
            state, given = PlaneState(), bits.copy()
            given[16 - before + 2] = 1  # 0 0 1, as a P plane begins
            values, flags, extents = (np.zeros((1, width), np.int64) for width in (FIELD_COUNT, 3, 3))
            _, _, status, code = loops.decode_predicted(
                given, 16 - before, False, True, state.fields, state.previous, state.decoding, state.found,
                state.flags, np.zeros(0), values, flags, extents,
            )  # fmt: skip
            assert ((status, code) == (kernels.AT_CODE, 0xBB)) == (before < 5), (loops.__name__, before)


def test_arrays_that_do_not_fit_are_refused(compiled: ModuleType) -> None:
    state = PlaneState()
    bits, costs = np.zeros(80, np.uint8), np.zeros(0)
    arguments = [False, bits, 0, state.fields, state.previous, state.decoding, state.found, state.flags, costs]
    compiled.decode_settled(*arguments)
    for at, wrong in (
        (1, bits.astype(np.int64)), (1, np.zeros(160, np.uint8)[::2]), (2, 81), (2, -1), (3, state.fields[:, :7]),
        (3, np.ones((73, 8), np.int64)), (4, state.previous[1:]), (6, state.found[:2]), (8, np.zeros(72)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"got|no plane"):
            compiled.decode_settled(*arguments[:at], wrong, *arguments[at + 1 :])
    target = np.zeros(73, np.int64)
    with pytest.raises(ValueError, match=r"out: got 1 bits, expected \d+"):
        compiled.encode_plane(
            True, target, np.zeros(3, np.int64), state.fields, state.previous, state.encoding, True,
            np.zeros(1, np.uint8), 0,
        )  # fmt: skip


def test_without_the_package_the_loops_are_those_in_python() -> None:
    program = (
        "import sys; sys.modules['fapengine_native'] = None; from fapengine.codec import kernels;"
        "sys.exit(kernels.loops is not kernels)"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0


def test_two_processes_may_compile_the_library_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Compiler:
        calls = 0

        def compile_library(self, folder: Path, **_: object) -> None:
            self.calls += 1
            if self.calls == 1:
                built.built()
            (folder / "library").touch()

    compiler = Compiler()
    monkeypatch.setattr(built, "OUT", tmp_path)
    monkeypatch.setattr(built, "build_hook", lambda: compiler)
    folder = built.built()
    assert compiler.calls == 2
    assert list(tmp_path.iterdir()) == [folder]
    assert (folder / "fapengine_native" / "library").exists()


@pytest.mark.nightly
def test_damaged_streams_with_sanitizers(compiled: ModuleType) -> None:
    command = [sys.executable, "-m", "tests.native.fuzz_codec", "--cases", "12", "--python-every", "6"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stdout + done.stderr
