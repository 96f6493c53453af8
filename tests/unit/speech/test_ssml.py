"""SSML: what is obeyed and what is refused."""

import pytest

from fapengine.errors import FapEngineError, UnsupportedError, UsageError
from fapengine.speech.text.normal_form import check_ssml, find_tag


@pytest.mark.parametrize(
    "text",
    [
        "plain", "<speak>Hello <emphasis>big</emphasis> world</speak>", 'a <break time="1s"/> b', "a &amp; b",
        '<?xml version="1.0"?><speak version="1.1" xmlns="http://www.w3.org/2001/10/synthesis" xml:lang="en">a</speak>',
    ],
)  # fmt: skip
def test_accepts(text: str) -> None:
    assert "<" not in check_ssml(text)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("a & b", UsageError, r"line 1, column 3 \(not well-formed \(invalid token\)\), expected"),
        ("<speak>x", UsageError, "expected well-formed XML"),
        ("x</all><all>", UsageError, "expected"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><speak>&b;</speak>', UsageError, "declaration"),
        ('<audio src="/etc/passwd"/>', UnsupportedError, "'audio'"),
        ("<b>x</b>", UnsupportedError, "'b'"),
        ('<svg xmlns="x"/>', UnsupportedError, "'svg'"),
    ],
)
def test_refuses(text: str, error: type[FapEngineError], message: str) -> None:
    with pytest.raises(error, match=message):
        check_ssml(text)


def test_finds_a_tag() -> None:
    assert find_tag("<speak>a</speak>") == "<speak>"
    assert find_tag("a < b, c > d, <b>e</b>, <3") is None
