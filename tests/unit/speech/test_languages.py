"""The language that a file of timed words names."""

import json

import pytest

from fapengine.speech.formats.registry import language_of, parse_timings

WORD = {"word": "oui", "start": 0.0, "end": 0.4}


@pytest.mark.parametrize(
    ("document", "language"),
    [
        ({"language": "fr", "segments": [{"words": [WORD]}]}, "fr"),
        ({"task": "transcribe", "language": "french", "words": [WORD]}, "french"),
        ({"results": {"channels": [{"detected_language": "fr", "alternatives": [{"words": [WORD]}]}]}}, "fr"),
        ({"results": {"language_code": "fr-FR", "items": []}}, "fr-FR"),
        ({"results": [{"alternatives": [{"words": [WORD]}], "languageCode": "fr-fr"}]}, "fr-fr"),
        ({"language_code": "fr", "words": [{"text": "oui", "start": 0, "end": 400}]}, "fr"),
        ({"params": {"language": "auto"}, "result": {"language": "fr"}, "transcription": []}, "fr"),
        ({"metadata": {"transcription_config": {"language": "fr"}}, "results": []}, "fr"),
        ({"language": "auto", "segments": [{"words": [WORD]}]}, ""),
        ({"language": None, "words": [WORD]}, ""),
        ({"a": {"language": "fr"}, "b": {"language": "de", "languages": ["de", "fr"]}, "c": {"language": "fr"}}, "fr"),
        ({"a": {"languages": ["fr", "de"]}, "b": {"languages": ["it", "de"]}, "c": {"language": "fr"}}, "fr"),
        ([WORD], ""),
    ],
)
def test_language_of_json(document: object, language: str) -> None:
    assert language_of(json.dumps(document).encode()) == language


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_language_of_subtitles(end: str) -> None:
    text = "WEBVTT\nKind: captions\nLanguage: fr\n\n00:00:00.000 --> 00:00:00.400\noui\n".replace("\n", end)
    assert language_of(text.encode()) == "fr"
    assert language_of(text.encode("utf-8-sig")) == "fr"
    assert language_of(text.replace(f"Language: fr{end}", "").encode()) == ""


def test_language_of_anything_else() -> None:
    assert [language_of(data) for data in (b"", b"\xff\xd8\xff", b"0 1 oui", b"{")] == ["", "", "", ""]


def test_words_keep_it_and_phones_need_none() -> None:
    words = parse_timings(json.dumps({"language": "fr", "segments": [{"words": [WORD]}]}).encode())
    assert (words.spelled, words.reading.language) == (True, "fr")
    phones = parse_timings(json.dumps({"language": "fr", "phones": [{"phone": "w", "start": 0, "end": 0.2}]}).encode())
    assert (phones.spelled, phones.reading.language) == (False, "")
