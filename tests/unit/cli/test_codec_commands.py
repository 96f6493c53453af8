"""The commands encode, decode and inspect: files in, files out, numbers as JSON."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from fapengine.cli.main import app
from fapengine.codec.elementary import visual_headers
from fapengine.codec.encoder import EncoderOptions, encode
from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.motion import load_fap, load_motion, save_fap
from fapengine.files.pictures import load_picture
from fapengine.files.sound import save_wav
from fapengine.mpeg4 import fap
from fapengine.mpeg4.track import FapTrack
from tests.command import ran, run

CORPUS = Path(__file__).resolve().parents[2] / "fuzz" / "corpus"


@pytest.fixture
def fap_file(tmp_path: Path) -> Path:
    path = tmp_path / "in.fap"
    values = [[0, 0, *[n * (k % 3) for k in range(66)]] for n in range(50)]
    save_fap(path, FapTrack.from_values(values, rate_hz=25.0))
    return path


def test_there_and_back(fap_file: Path, tmp_path: Path) -> None:
    stream, back = tmp_path / "a.fba", tmp_path / "back.fap"
    result = json.loads(run("encode", fap_file, "-o", stream, "--quant", 0, "--json"))
    assert result["frames"] == 50
    assert result["bytes"] == stream.stat().st_size
    assert result["kbit_s"] == pytest.approx(8 * stream.stat().st_size / 2 / 1000, abs=0.001)
    run("decode", stream, "-o", back)
    assert load_fap(back).equals(load_fap(fap_file))


def test_visemes_of_a_doubtful_motion_are_doubtful(tmp_path: Path) -> None:
    apart = np.zeros((60, 68), np.int32)
    apart[:, [fap.column(4), fap.column(5)]] = -100
    save_fap(tmp_path / "in.fap", FapTrack.from_values(apart, rate_hz=25.0))
    arguments = ["encode", str(tmp_path / "in.fap"), "--visemes", "-o", str(tmp_path / "a.fba")]
    assert "the lips never meet" in CliRunner().invoke(app, arguments).stderr
    with pytest.raises(DataError, match="the lips never meet"):
        run(*arguments, "--strict")


def test_a_voice_and_its_faps_in_one_mp4_file(fap_file: Path, tmp_path: Path) -> None:
    voice, film, back = tmp_path / "talk.wav", tmp_path / "talk.mp4", tmp_path / "back.fap"
    save_wav(voice, np.zeros(32000, np.int16), 16000)
    result = json.loads(run("encode", fap_file, "--audio", voice, "-o", film, "--json"))
    report = json.loads(run("inspect", film, "--json"))
    assert (report["format"], report["p_planes"] + report["i_planes"], report["level"]) == ("FBA", 50, 1)
    assert report["bytes"] == result["bytes"] + len(visual_headers(0x61))
    run("decode", film, "-o", back)
    run("encode", fap_file, "-o", tmp_path / "a.fba")
    run("decode", tmp_path / "a.fba", "-o", tmp_path / "b.fap")
    assert load_fap(back).equals(load_fap(tmp_path / "b.fap"))
    for words in (("--audio", voice, "-o", tmp_path / "a.fba"), ("--epf", voice, "-o", film)):
        with pytest.raises(UsageError, match=words[0]):
            run("encode", fap_file, *words)


@pytest.mark.parametrize(
    "choices",
    [
        ("--kbps", 3),
        ("--fit-ranges",),
        ("--max-error-mm", 0.5),
        ("--intra-every", 10),
        ("--moving-only", "--start-codes"),
    ],
)
def test_each_choice_shortens_or_marks(fap_file: Path, tmp_path: Path, choices: tuple[object, ...]) -> None:
    run("encode", fap_file, "-o", tmp_path / "plain.fba")
    assert "kbit/s" in run("encode", fap_file, "-o", tmp_path / "b.fba", *choices)
    assert (tmp_path / "b.fba").read_bytes() != (tmp_path / "plain.fba").read_bytes()


def test_a_parameter_file_rules_alone(fap_file: Path, tmp_path: Path) -> None:
    epf = tmp_path / "a.epf"
    epf.write_text("FBM 1 FFR 0 ISI 1 FMT 0 3 3 3 3 3 3 3 3 3 FBM 1 FFR 7 ISI 0")
    run("encode", fap_file, "--epf", epf, "-o", tmp_path / "a.fba")
    report = json.loads(run("inspect", tmp_path / "a.fba", "--json"))
    assert (report["i_planes"], report["p_planes"]) == (1, 1)
    with pytest.raises(UsageError, match="--epf"):
        run("encode", fap_file, "--epf", epf, "--quant", 2, "-o", tmp_path / "a.fba")
    epf.write_text("FBM 1 FFR")
    with pytest.raises(DataError, match=r"a\.epf"):
        run("encode", fap_file, "--epf", epf, "-o", tmp_path / "a.fba")


def test_inspect_counts_every_bit(fap_file: Path, tmp_path: Path) -> None:
    stream = tmp_path / "a.fba"
    run("encode", fap_file, "-o", stream, "--intra-every", 20)
    report = json.loads(run("inspect", stream, "--json"))
    assert [plane["frame"] for plane in report["planes"] if plane["kind"] == "I"] == [0, 20, 40]
    total = 32 + sum(plane["bits"] for plane in report["planes"])
    assert 0 <= 8 * (report["bytes"] - 4) - total <= 8
    assert set(map(int, report["fap_bits"])) == set(range(3, 69))
    assert sum(report["fap_bits"].values()) < total
    text = run("inspect", stream)
    assert "3 I and 47 P planes" in text
    assert "and 10 more planes" in text
    assert "open_jaw" in text
    assert "more planes" not in run("inspect", stream, "--all")


def test_inspect_reads_visemes_too() -> None:
    assert "viseme" in run("inspect", CORPUS / "worked-example.fba")


def test_damage_is_told(fap_file: Path, tmp_path: Path) -> None:
    stream = tmp_path / "a.fba"
    run("encode", fap_file, "-o", stream, "--intra-every", 10, "--start-codes")
    data = bytearray(stream.read_bytes())
    data[500:520] = b"\x55" * 20
    stream.write_bytes(data)
    with pytest.raises(DataError, match=r"a\.fba"):
        run("decode", stream, "-o", tmp_path / "b.fap")
    result = json.loads(run("decode", stream, "-o", tmp_path / "b.fap", "--resync", "--json"))
    assert result["losses"]
    assert 25 < result["frames"] < 50
    run("decode", stream, "-o", tmp_path / "b.fap", "--resync")
    assert "lost" in run("inspect", stream)


def test_odd_rates_are_whole_in_the_text_unless_asked(tmp_path: Path) -> None:
    back = tmp_path / "b.fap"
    run("decode", CORPUS / "fields.fba", "-o", back)
    assert load_fap(back).rate_hz == 30
    run("decode", CORPUS / "fields.fba", "-o", back, "--exact-rate")
    assert load_fap(back).rate_hz == pytest.approx(30000 / 1001)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"hello")
    with pytest.raises(UnsupportedError):
        run("inspect", tmp_path / "x")


def test_fill_writes_what_a_face_shows(tmp_path: Path) -> None:
    """Left lids and lips alone are sent, with a mask that asks for interpolation: the right side follows."""
    track = FapTrack.from_values([[0, 0, *[60] * 66]] * 3, rate_hz=25.0)
    mask = track.mask.copy()
    mask[:, [fap.column(number) for number in (7, 20, 51, 53, 54)]] = False
    options = EncoderOptions(quant=1, unsent="interpolate")
    stream = encode(replace(track, mask=mask, values=track.values * mask), options)
    (tmp_path / "some.fba").write_bytes(stream)
    run("decode", tmp_path / "some.fba", "-o", tmp_path / "sent.fap")
    run("decode", tmp_path / "some.fba", "-o", tmp_path / "shown.fap", "--fill")
    sent, shown = load_fap(tmp_path / "sent.fap"), load_fap(tmp_path / "shown.fap")
    for number in (7, 20, 51, 53, 54):
        assert not sent.mask[:, fap.column(number)].any()
        assert (shown.values[:, fap.column(number)] == 60).all(), number
    assert shown.mask[:, fap.column(3) :].all()


def test_plot_is_a_picture(fap_file: Path, tmp_path: Path) -> None:
    stream, plot = tmp_path / "a.fba", tmp_path / "a.png"
    run("encode", fap_file, "-o", stream)
    run("inspect", stream, "--plot", plot)
    assert load_picture(plot).shape == (600, 960, 3)


VISEMES = "2.1 v 25 3\n" + "".join(f"1{' 0' * 67}\n{n} 10 1 {63 - 21 * n} 0\n" for n in range(3))
"""Viseme 10 that becomes viseme 1."""


def test_visemes_move_what_is_decoded_converted_and_described(tmp_path: Path) -> None:
    source, stream, filled, table = (tmp_path / name for name in ("v.fap", "v.fba", "filled.fap", "v.csv"))
    source.write_text(VISEMES)
    run("encode", source, "-o", stream)
    run("decode", stream, "--fill", "-o", filled)
    opened = [load_motion(path).values[:, 2].tolist() for path in (filled, stream, source)]
    assert opened[0] == opened[1] == opened[2]
    assert opened[0][0] > opened[0][1] > opened[0][2] > 0
    run("convert", stream, "--shapes", "oculus", "-o", table)
    rows = [dict(zip(*pair, strict=True)) for pair in _pairs(table)]
    assert float(rows[0]["aa"]) > 0.5 > float(rows[-1]["aa"])
    for path in (source, stream):
        assert "visemes: PP, aa" in run("inspect", path)
    run("decode", stream, "-o", filled)
    assert filled.read_text().splitlines()[1].startswith("1 0 0")  # as it was sent


def _pairs(table: Path) -> list[tuple[list[str], list[str]]]:
    header, *rows = (line.split(",") for line in table.read_text().splitlines())
    return [(header, row) for row in rows]


def test_a_sentence_as_visemes_and_a_rate_that_is_missed(tmp_path: Path) -> None:
    source, stream = tmp_path / "a.fap", tmp_path / "a.fba"
    moving = 300 * np.sin(np.arange(50) / 5 + np.arange(66)[:, None]).T
    save_fap(source, FapTrack.from_values(np.rint(np.column_stack([np.zeros((50, 2)), moving])), rate_hz=25.0))
    assert float(run("encode", source, "--visemes", "-o", stream).split()[-2]) < 1.0
    told = CliRunner().invoke(app, ["encode", str(source), "--kbps", "1", "-o", str(stream)]).stderr
    assert "is more than the 1 asked for; --moving-only and --visemes" in told
    assert json.loads(ran("encode", source, "--kbps", 1, "-o", stream, "--json").stdout)["missed"]
    assert not json.loads(ran("encode", source, "--kbps", 100, "-o", stream, "--json").stdout)["missed"]


def test_a_table_computes_faps_that_were_not_sent(tmp_path: Path) -> None:
    source, stream, table, out = (tmp_path / name for name in ("a.fap", "a.fba", "a.fit", "out.fap"))
    source.write_text(f"2.1 a 25 1\n0 0 1{' 0' * 65}\n0 400\n")
    run("encode", source, "-o", stream)
    table.write_text("2\n1 3\n2 14 5\n1\n0 1 1\n1 2 0 1 1 0 1 1 0\n1 1 1 1 1 0 1 2 0\n")
    run("decode", stream, "--fit", table, "-o", out)
    values = load_motion(out).values[0]
    assert values[[2, 13, 4]].tolist() == [400, 200, -20]
    table.write_text("2\n1 3\n")
    with pytest.raises(DataError, match=r"a\.fit: the table ends where the number of FAPs is expected"):
        run("decode", stream, "--fit", table, "-o", out)


def test_a_recording_is_not_motion(tmp_path: Path) -> None:
    save_wav(tmp_path / "talk.wav", np.zeros(100, np.int16), 16_000)
    with pytest.raises(DataError, match="fapengine animate"):
        load_motion(tmp_path / "talk.wav")
