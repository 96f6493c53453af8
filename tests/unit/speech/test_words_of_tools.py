"""Words and phones of recognisers, voices, corpora and songs: what their readers do beyond the samples."""

import json
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fapengine.errors import DataError, UnsupportedError, UsageError
from fapengine.files.timings import load_timings
from fapengine.speech.formats.documents import Node, walk
from fapengine.speech.formats.entries import Entry
from fapengine.speech.formats.registry import FORMATS, ParseOptions, parse_timings
from fapengine.speech.formats.table import parse_columns
from fapengine.speech.formats.word_lists import _cues, seconds, subtitle_text, timed_words
from fapengine.speech.phone_track import PhoneTrack

from .samples import SAMPLES, SHORT_TEXTGRID, lines


def told(track: PhoneTrack) -> list[tuple[str, float, float]]:
    return [(phone.label, round(phone.start_s, 6), round(phone.end_s, 6)) for phone in track.phones]


def read(text: str | bytes, name: str | None = None, ending: str = "", **wishes: str) -> PhoneTrack:
    data = text.encode() if isinstance(text, str) else text
    return parse_timings(data, file_format=name, ending=ending, options=ParseOptions(**wishes))


def test_words_without_times_take_the_time_between_or_go_with_the_word_before() -> None:
    words = [
        {"word": "in", "start": 0.0, "end": 0.4}, {"word": "2014."}, {"word": "we", "start": 1.0, "end": 1.2},
        {"word": "£5"}, {"word": "paid", "start": 1.2, "end": 1.5}, {"word": "—", "start": 1.5, "end": 1.6},
    ]  # fmt: skip
    track = read(json.dumps({"segments": [{"start": 0, "end": 2, "text": "", "words": words}]}))
    assert told(track) == [("in", 0.0, 0.4), ("2014", 0.4, 1.0), ("we £5", 1.0, 1.2), ("paid", 1.2, 1.5)]


def test_overlaps_of_recognisers_are_cut_and_falling_starts_refused() -> None:
    words = [Entry(0.0, 0.6, "my", "a"), Entry(0.4, 1.0, "oh", "b")]
    assert [(word.start_s, word.end_s) for word in timed_words(words, "x", "")] == [(0.0, 0.4), (0.4, 1.0)]
    two = {
        "segments": [{"words": [{"word": "my", "start": 1.0, "end": 1.5}, {"word": "oh", "start": 0.2, "end": 0.4}]}]
    }
    with pytest.raises(DataError, match=r"'oh' starts at 0\.2 s.*segments\[0\]\.words\[1\]"):
        read(json.dumps(two))


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"segments": [{"start": 0, "end": 2, "text": "my oh my"}]}, "openai-words: contains no word.*word_timestamps"),
        ({"transcription": [{"offsets": {"from": 0, "to": 900}, "text": " my oh"}]}, "'my oh', expected one.*-ml 1"),
        ({"chunks": [{"text": " my oh", "timestamp": [0.0, 2.0]}]}, r"'my oh', expected one.*return_timestamps='word'"),
        ({"fragments": [{"begin": "0", "end": "1", "lines": ["my oh"]}]}, "aeneas: got 'my oh'.*mplain"),
        ({"words": [{"case": "not-found-in-audio", "word": "my"}]}, "Gentle: contains no timed word"),
        ({"timestampInfo": {"characterAlignment": {}}}, "Inworld: wordAlignment is missing; ask for timestampType"),
        ([{"offset": 0, "ph_seq": "m a", "note_dur": "1"}], "DiffSinger: ph_dur is missing"),
        ([{"offset": 0, "ph_seq": "m a", "ph_dur": "1"}], "ph_dur: got 1 durations, expected 2"),
        ([{"offset": 0, "ph_seq": "m", "ph_dur": "x"}], "ph_dur: got 'x'"),
        ([{"type": "SentenceBoundary", "offset": 0, "duration": 9, "text": "my oh"}], "got whole numbers for times"),
    ],
)  # fmt: skip
def test_phrases_are_refused_with_the_way_out(document: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(json.dumps(document))


def test_two_channels_need_a_choice() -> None:
    word = {"word": "my", "start": 0.0, "end": 0.4}
    two = json.dumps({"results": {"channels": [
        {"alternatives": [{"words": [word]}]}, {"alternatives": [{"words": [{**word, "word": "oh"}]}]}]}})  # fmt: skip
    with pytest.raises(DataError, match=r"2 channels.*tier=NUMBER"):
        read(two)
    assert told(read(two, tier="1")) == [("oh", 0.0, 0.4)]


@pytest.mark.parametrize(
    ("text", "ending", "message"),
    [
        ("0 10000 my\n10000 20000 house\n20000 30000 stands\n", "", r"timit .* and align .* format=NAME"),
        (json.dumps({"words": [{"text": "my", "start": 0, "end": 1}]}), "", r"assemblyai .* and elevenlabs"),
        ("start,end,word\n0,1,my\n1,2,oh\n", "", r"seconds or milliseconds.*columns='unit=s'"),
        ("0 5000 ma\n5000 9000 ʃ\n", "", r"are they samples\? say their rate"),
    ],
)  # fmt: skip
def test_where_two_readings_differ_both_are_named(text: str, ending: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(text, ending=ending)


def test_the_ending_the_format_or_the_unit_settles_it() -> None:
    words = "0 16000 my\n16000 32000 house\n32000 48000 stands\n"
    assert read(words, ending=".wrd").duration_s == 3.0
    assert read(words, ending=".align").duration_s == pytest.approx(48 / 25)
    assert read(words, "align").duration_s == pytest.approx(48 / 25)
    unclear = json.dumps({"words": [{"text": "my", "start": 0, "end": 1}]})
    assert (read(unclear, "elevenlabs").duration_s, read(unclear, "assemblyai").duration_s) == (1.0, 0.001)
    assert read("start,end,word\n0,1,my\n1,2,oh\n", columns="unit=s").duration_s == 2.0
    assert read("0 5000 ma\n5000 16000 ʃ\n", columns="hz=16000").duration_s == 1.0


def test_assemblyai_is_milliseconds() -> None:
    words = [{"text": "my", "start": 600_000, "end": 600_400, "confidence": 0.9}]
    assert read(json.dumps({"words": words})).duration_s == pytest.approx(600.4)


@pytest.mark.parametrize(
    ("text", "columns", "expected"),
    [
        ("von;bis;laut\n0,0;0,4;m\n0,4;1,0;a\n", "start=von,end=bis,label=laut", [("m", 0.0, 0.4), ("a", 0.4, 1.0)]),
        ("Phone,Start (s),Length (s)\nm,0,0.4\na,0.4,0.6\n", "", [("m", 0.0, 0.4), ("a", 0.4, 1.0)]),
        ("frame,to,phone\n0,10,m\n10,25,a\n", "start=frame,fps=25", [("m", 0.0, 0.4), ("a", 0.4, 1.0)]),
        ("Dis-moi,0.38,1.1\nvole,1.1,1.5\n", "label=1,start=2,end=3", [
            ("_", 0.0, 0.38), ("Dis-moi", 0.38, 1.1), ("vole", 1.1, 1.5)]),
        (json.dumps({"file": "x", "segs": [{"t0": 0.0, "t1": 0.4, "symbol": "m"}]}), "", [("m", 0.0, 0.4)]),
    ],
)  # fmt: skip
def test_lists_with_declared_columns(text: str, columns: str, expected: list[tuple[str, float, float]]) -> None:
    assert told(read(text, "table", columns=columns)) == expected


@pytest.mark.parametrize("text", ["start", "unit=parsec", "fps=0", "fps=x", "colour=red"])
def test_columns_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match="columns: got"):
        parse_columns(text)


@pytest.mark.parametrize(
    ("text", "columns", "message"),
    [
        ("a,b\n1,2\n", "", r"table: got the columns \['a', 'b'\], expected start and label"),
        ("hello,0.5,1.0\nthere,1.0,1.5\n", "", "no names of columns; say their numbers"),
        ("hello,0.5,1.0\n", "", "no names of columns; say their numbers"),
        ("start,end,phone\n0.0,x,m\n", "", "end: got 'x', expected a time.*row 1"),
        ("start,end,phone\n0.0,0.5,m\n", "end=stop", "columns: got end=stop, but the file has"),
        ("starts,ends,phone\n0,100,m\n100,200,a\n", "", "got whole numbers for times"),
        ('[{"start": 0.5, "end": 1.0, "phone": "m"}, 5]', "", "row: got 5, expected an object"),
        ('{"a": [{"x": 1}], "b": [{"x": 1}]}', "", "got 2 lists of objects, expected one"),
    ],
)  # fmt: skip
def test_lists_that_are_none(text: str, columns: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(text, "table", columns=columns)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("subtitles", "1\n00:00:00,000 --> 00:00:02,000\nmy oh my\n", "'my oh my', expected one word.*one word a cue"),
        ("subtitles", "once", "contains no cue"),
        ("ctm", "a 1 0 1 x\nb 1 0 1 y\n", r"recordings \['a', 'b'\].*tier=NAME"),
        ("ctm", "a 1 0 1 3\na 1 1 1 4\n", "numbers of phones.*phones.txt"),
        ("papagayo", "lipsync version 1\n", "the file ends where the name of the sound"),
        ("papagayo", "lipsync version 2\n", "expected a file that begins"),
        ("papagayo", "lipsync version 1\nx\n0\n", "frames a second: got 0"),
        ("papagayo", "lipsync version 1\nx\nten\n", "frames a second: got 'ten', expected a count"),
        ("moho", "MohoSwitch1\n1 MBP\n", r"columns='fps=24'"),
        ("moho", "x", "begins with MohoSwitch1"),
        ("polly", '{"time": 0, "type": "sentence", "start": 0, "end": 5, "value": "Mary."}', "got sentences alone"),
        ("utau", "[#0000]\nLength=x\nLyric=ま\n", "Length: got 'x'"),
        ("utau", "[#SETTING]\nTempo=0\n[#0000]\nLength=1\n", "Tempo: got '0'"),
        ("utau", "ustx_version: '0.6'\n", "project of OpenUtau"),
        ("htk", "0.0\t0.5\tf000001\n0.5\t1.0\tf000002\n", "numbers of fragments"),
        ("htk", "no such thing as time\n", "got text without times; is it a transcript"),
        ("htk", "1 51.2 43.505477 90.957447\n52 91.2 50.957447 51.085142\n", "got numbers, expected phones or words"),
        ("timit", "0 x b\n", "got 'x', expected a number.*line 1"),
    ],
)  # fmt: skip
def test_texts_that_are_none(name: str, text: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read(text, name)


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("moho", "11 rest", "{} rest"),
        ("papagayo", "my.wav\n10\n10", "my.wav\n10\n{}"),
        ("papagayo", "\t5 AI", "\t{} AI"),
    ],
)
def test_frames_have_nine_digits_at_most(name: str, old: str, new: str) -> None:
    assert old in SAMPLES[name]
    wishes = {"columns": "fps=10"} if name == "moho" else {}
    with pytest.raises(DataError, match="expected at most"):  # it is read, and very long
        read(SAMPLES[name].replace(old, new.format(10**9 - 1)), name, **wishes)
    with pytest.raises(DataError, match=r"got '1000000000.*expected a (frame|count)"):
        read(SAMPLES[name].replace(old, new.format(10**9)), name, **wishes)


def test_chunks_of_fish_begin_where_they_say() -> None:
    text = SAMPLES["fish"].replace('"text": "oh.", "start": 0,', '"text": "oh.", "start": 0.125,')
    assert text != SAMPLES["fish"]
    assert told(read(text)) == [("my", 0.0, 0.4), ("_", 0.4, 0.625), ("oh", 0.625, 1.0)]


def test_papagayo_with_two_voices() -> None:
    voice = SAMPLES["papagayo"].split("\n1\n", 1)[1]
    two = SAMPLES["papagayo"].replace("\n1\n", "\n2\n", 1) + voice.replace("Voice 1", "Voice 2").replace("MBP", "FV")
    with pytest.raises(DataError, match=r"voices \['Voice 1', 'Voice 2'\].*tier=NAME"):
        read(two)
    assert told(read(two, tier="Voice 2"))[0][0] == "f"


def test_kaldi_frames_are_no_phones_of_mbrola() -> None:
    with pytest.raises(DataError, match="expected a known format"):
        read("utterance_1 1 1 1 1 3 3 3 7 7 7 7 7 2 2\n")
    assert read("m 100 0 120 50 130\na 100\n").phones[0].label == "m"


def test_a_ctm_of_many_columns_is_no_list_of_pitches() -> None:
    alternatives = "REC_1 1 0.5 0.2 hello 0.9 lex me\nREC_1 1 * * other 0.9 lex me\n"
    with pytest.raises(DataError, match=r"time: got '\*', expected a number.*line 2"):
        read(alternatives, ending=".ctm")


def test_times_that_are_rounded_to_milliseconds_overlap_by_one() -> None:
    track = read("file 1 11.851 0.204 m 0.5\nfile 1 12.054 0.407 ay 0.5\n")
    assert told(track)[-2:] == [("m", 11.851, 12.055), ("aɪ", 12.055, 12.461)]


@pytest.mark.parametrize("words", ["食 左 啦 我 喺喺", "я и вы он мы", "나 너 밥 집 물"])
def test_words_of_one_letter_are_words_in_other_scripts(words: str) -> None:
    rows = [f"file 1 {at}.0 1.0 {word} 0.5" for at, word in enumerate(words.split())]
    assert read("\n".join(rows)).spelled
    assert not read(
        "\n".join(rows[:2] + [f"file 1 {at}.0 1.0 {phone} 0.5" for at, phone in enumerate("mapti", 2)])
    ).spelled


def test_a_time_of_minus_zero_is_zero() -> None:
    """As praatIO's files have it."""
    assert str(read("-0.0 0.5 m\n0.5 1.0 ay\n").phones[0].start_s) == "0.0"


def test_a_context_of_open_jtalk_says_its_alphabet() -> None:
    contexts = "/A:-5+1+7/B:xx-xx_xx/C:02_xx+xx/D:xx+xx_xx"
    labels = "".join(f"{n}000000 {n + 1}000000 x^x-{phone}+x=x{contexts}\n" for n, phone in enumerate("daNka"))
    assert [phone for phone, *_ in told(read(labels))] == ["d", "a", "ɴ", "k", "a"]
    assert not read(labels).reading.guessed
    assert read(labels.replace("+1+7", "_1_7")).reading.guessed  # an English context


def test_songs() -> None:
    words = "[#SETTING]\nTempo=60\n[#0000]\nLength=480\nLyric=Hello\n[#0001]\nLength=480\nLyric=world\n"
    assert (read(words).spelled, read(words).duration_s) == (True, 2.0)
    shift_jis = "[#SETTING]\r\nTempo=60\r\n[#0000]\r\nLength=480\r\nLyric=か_強\r\n".encode("shift_jis")
    assert told(parse_timings(shift_jis, file_format="utau")) == [("ka", 0.0, 1.0)]
    ds = [
        {"offset": 0.0, "ph_seq": "SP a SP", "ph_dur": "0.1 0.4 0.5"},
        {"offset": 0.8, "ph_seq": "AP b", "ph_dur": "0.2 0.1"},
    ]
    assert [end for *_, end in told(read(json.dumps(ds)))] == [0.1, 0.5, 1.0, 1.1]


def test_julius_and_points_of_audacity() -> None:
    julius = "0.0000000 0.1000000 silB\n0.1000000 0.4000000 ch\n0.4000000 1.0000000 i:\n1.0000000 1.1000000 silE\n"
    assert told(read(julius)) == [("_", 0.0, 0.1), ("tɕ", 0.1, 0.4), ("iː", 0.4, 1.0), ("_", 1.0, 1.1)]
    assert told(read("0.1\t0.1\tm\n0.4\t0.4\tay\n")) == [("_", 0.0, 0.1), ("m", 0.1, 0.4), ("aɪ", 0.4, 0.5)]


def test_buckeye_and_emu() -> None:
    buckeye = (
        "header_begin\nsignal s0101a\ntype 0\ncolor 121\nseparator ;\nnfields 1\n#\n    0.100000  121 {B_TRANS}\n"
        "    0.400000  121 b; b\n    1.000000  121 ayn\n    1.100000  122 IVER\n"
    )
    assert told(read(buckeye)) == [("_", 0.0, 0.1), ("b", 0.1, 0.4), ("ãɪ̃", 0.4, 1.0), ("_", 1.0, 1.1)]
    assert told(read(buckeye, ending=".lab")) == told(read(buckeye))
    words = "nfields 3\n#\n 0.2 122 {B_TRANS}; B; B; null\n 0.3 122 <IVER>; S; S; null\n 0.7 122 that's; dh\n"
    assert told(read(words, ending=".words")) == [("_", 0.0, 0.3), ("that's", 0.3, 0.7)]


def test_words_that_gentle_did_not_find_are_told() -> None:
    found = {"word": "my", "start": 0.0, "end": 1.0, "phones": [{"phone": "m_B", "duration": 0.4},
             {"phone": "ay_E", "duration": 0.6}]}  # fmt: skip
    lost = {"case": "not-found-in-audio", "word": "oh"}
    assert read(json.dumps({"words": [found]})).reading.remarks == ()
    remarks = ("Gentle: 2 of 3 words were not found in the sound: 'oh'",)
    assert read(json.dumps({"words": [found, lost, lost]})).reading.remarks == remarks


def test_what_brackets_enclose_is_not_spoken() -> None:
    rows = [("[Music]", 0.0, 1.0), ("Hello", 1.0, 1.5), ("(well)", 1.5, 2.0), ("[BLANK_AUDIO]", 2.0, 2.5)]
    spoken = [("_", 0.0, 1.0), ("Hello", 1.0, 1.5), ("well", 1.5, 2.0)]
    words = [{"word": word, "start": start_s, "end": end_s, "score": 0.9} for word, start_s, end_s in rows]
    assert told(read(json.dumps({"segments": [{"words": words}], "word_segments": words}))) == spoken
    assert (
        told(read("".join(f"talk 1 {start_s} {end_s - start_s} {word}\n" for word, start_s, end_s in rows))) == spoken
    )
    text = "[soft laugh] Hi"
    starts_s = [n / 10 for n in range(len(text))]
    times = {"character_start_times_seconds": starts_s, "character_end_times_seconds": [*starts_s[1:], 1.5]}
    assert told(read(json.dumps({"alignment": {"characters": list(text), **times}}))) == [
        ("_", 0.0, 1.3),
        ("Hi", 1.3, 1.5),
    ]


def binary_grid(*tiers: tuple[str, str, list[tuple[object, ...]]]) -> bytes:
    def name(text: str) -> bytes:
        return bytes([len(text)]) + text.encode()

    def text(value: str) -> bytes:
        wide = not value.isascii()
        return struct.pack(">hH", -1, len(value)) + value.encode("utf-16-be") if wide else struct.pack(
            ">h", len(value)) + value.encode()  # fmt: skip

    data = b"ooBinaryFile" + name("TextGrid") + struct.pack(">ddbi", 0.0, 1.0, 1, len(tiers))
    for kind, title, rows in tiers:
        data += name(kind) + text(title) + struct.pack(">ddi", 0.0, 1.0, len(rows))
        for *times, label in rows:
            data += struct.pack(f">{len(times)}d", *times) + text(str(label))
    return data


def test_binary_textgrids() -> None:
    phones: list[tuple[object, ...]] = [(0.0, 0.4, "m"), (0.4, 1.0, "ˈaɪ")]
    grid = binary_grid(("TextTier", "marks", [(0.2, "here")]), ("IntervalTier", "phones", phones))
    assert told(read(grid)) == [("m", 0.0, 0.4), ("aɪ", 0.4, 1.0)]
    for cut in range(len(grid)):
        with pytest.raises(DataError):
            read(grid[:cut], "textgrid")
    with pytest.raises(DataError, match="tier class: got 'PitchTier'"):
        read(binary_grid(("PitchTier", "x", [])))
    with pytest.raises(DataError, match="number of tiers: got"):
        read(grid[:38] + b"\x7f" + grid[39:])


@pytest.mark.shared
def test_a_binary_textgrid_of_praat_is_the_one_it_wrote_as_text(shared: Path) -> None:
    folder = shared / "data" / "timings"
    binary, text = (load_timings(folder / f"praat_{form}.TextGrid") for form in ("binary", "long"))
    assert told(binary) == told(text)


def test_latin_1_and_collections() -> None:
    latin = SHORT_TEXTGRID.replace("ˈaɪ", "ø").encode("latin-1")
    assert told(read(latin)) == [("m", 0.0, 0.4), ("ø", 0.4, 1.0)]
    one, two = (SHORT_TEXTGRID.split('"TextGrid"\n')[1].replace('"m"', label) for label in ('"m"', '"p"'))
    both = f'"ooTextFile"\n"Collection"\n2\n"TextGrid"\n"A"\n{one}"TextGrid"\n"B"\n{two}'
    with pytest.raises(DataError, match=r"2 tiers for phones.*'A - phones', 'B - phones'"):
        read(both)
    assert told(read(both, tier="B - phones"))[0][0] == "p"
    with pytest.raises(UnsupportedError, match="a collection with a Sound"):
        read('"ooTextFile"\n"Collection"\n1\n"Sound"\n"A"\n')


def test_word_tiers_are_words_and_have_their_own_speaker() -> None:
    tier = SHORT_TEXTGRID[SHORT_TEXTGRID.index('"IntervalTier"') :]
    words = SHORT_TEXTGRID.replace('"phones"', '"words"').replace('"m"', '"montreal"').replace('"ˈaɪ"', '"in"')
    assert (read(words).level, read(words).spelled) == ("word", True)
    unnamed = words.replace('"words"', '"line"')
    assert read(unnamed).spelled
    assert read(unnamed.replace('"montreal"', '"m"')).spelled is False
    owned = SHORT_TEXTGRID.replace("<exists>\n1", "<exists>\n2").replace('"phones"', '"A - phones"') + tier.replace(
        '"phones"', '"B - words"').replace('"m"', '"other"')  # fmt: skip
    assert {phone.word for phone in read(owned).phones} == {""}


def test_paths_into_json() -> None:
    document = Node({"a": [{"b": [{"c": 1}]}, {"b": [{"c": 2}]}]})
    assert [item.value for item in walk(document, "a[].b[].c")] == [1, 2]
    assert [item.value for item in walk(document, "a[0].b[].c")] == [1]
    assert list(walk(document, "a.x[]")) == []


def test_numbers_may_be_spelled() -> None:
    spelled = '{"mouthCues": [{"start": "0.00", "end": "0.40", "value": "A"}]}'
    assert told(read(spelled)) == [("p", 0.0, 0.4)]


def test_server_sent_events_of_one_line() -> None:
    event = {"alignment": {"segments": [{"text": "my", "start": 0, "end": 0.4}]}, "chunk_seq": 0}
    assert told(read(f"data: {json.dumps(event)}\n\n")) == [("my", 0.0, 0.4)]
    assert told(read(lines(event))) == [("my", 0.0, 0.4)]


def test_every_new_format_says_who_writes_it() -> None:
    assert all(each.tool for each in FORMATS.values())
    assert all(name in FORMATS for each in FORMATS.values() for name in each.rivals)


def test_a_moho_file_that_says_its_rate() -> None:
    assert told(read("MohoSwitch1\nFPS 10\n1 MBP\n5 AI\n"))[0] == ("m", 0.0, 0.4)
    with pytest.raises(DataError, match="fps=24"):
        read("MohoSwitch1\nFPS 0\n1 MBP\n")


def test_a_moho_file_of_rhubarb_has_its_shapes() -> None:
    track = read("MohoSwitch1\nFPS 10\n1 X\n3 A\n5 D\n")
    assert track.reading.alphabet == "rhubarb-shapes"
    assert told(track)[:3] == [("_", 0.0, 0.2), ("p", 0.2, 0.4), ("ɑ", 0.4, 0.5)]
    assert read("MohoSwitch1\nFPS 10\n1 rest\n3 E\n").reading.alphabet == "preston-blair"
    assert read("MohoSwitch1\nFPS 10\n3 E\n").reading.alphabet == "preston-blair"


def test_a_grid_of_words_and_phrases_is_one_of_words() -> None:
    words = SHORT_TEXTGRID.replace('"phones"', '"word"').replace("<exists>\n1", "<exists>\n2")
    phrases = SHORT_TEXTGRID[SHORT_TEXTGRID.index('"IntervalTier"') :].replace('"phones"', '"phrase"')
    assert [phone.label for phone in read(words + phrases).phones] == ["m", "ˈaɪ"]
    assert read(words + phrases).spelled


def test_words_without_times_need_room_for_all_of_them() -> None:
    """Two need 0.1 s; in 0.06 s they join the word before."""
    told: list[Entry | tuple[str, str]] = [Entry(0.0, 0.5, "a", ""), ("b", ""), ("c", ""), Entry(0.56, 1.0, "d", "")]
    assert [word.label for word in timed_words(told, "x", "")] == ["a b c", "d"]
    told[3] = Entry(0.62, 1.0, "d", "")
    assert [word.label for word in timed_words(told, "x", "")] == ["a", "b", "c", "d"]


def test_lines_of_subtitles_that_are_numbers_or_stay_for_the_next_cue() -> None:
    cue = "{0}\n00:00:0{0},000 --> 00:00:0{1},000\n{2}\n\n"
    text = cue.format(1, 2, "Platform\n42") + cue.format(2, 3, "42\nleaves") + "3\n" + cue.format(3, 4, "now")[2:]
    assert subtitle_text(text) == "Platform\n42\nleaves\nnow"


@given(st.integers(0, 36_000_000), st.integers(1, 5_000_000), st.sampled_from(",."), st.booleans())
def test_a_clock_of_subtitles_counts_hours_minutes_and_seconds(start_ms: int, ms: int, point: str, short: bool) -> None:
    def clock(at_ms: int) -> str:
        minutes, seconds = divmod(at_ms // 1000, 60)
        hours, minutes = divmod(minutes, 60)
        return ("" if short and not hours else f"{hours}:") + f"{minutes:02}:{seconds:02}{point}{at_ms % 1000:03}"

    (cue,) = _cues([f"{clock(start_ms)} --> {clock(start_ms + ms)}", "oh"])
    assert (cue.start_s, cue.end_s) == pytest.approx((start_ms / 1000, (start_ms + ms) / 1000), abs=1e-6)


@given(st.integers(0, 10**6), st.integers(0, 999_999_999))
def test_seconds_are_the_same_however_they_are_written(whole: int, nanos: int) -> None:
    text = f"{whole}.{nanos:09}"
    for value in (float(text), text, f"{text}s", {"seconds": str(whole), "nanos": nanos}):
        assert seconds(Node(value)) == pytest.approx(whole + 1e-9 * nanos, abs=1e-9)


def test_frames_may_be_longer_than_a_second() -> None:
    assert parse_columns("fps=0.5").unit_s == 2.0
