"""Words that the dictionary lacks, pronounced as words that are spelled like them."""

import pytest

from fapengine.recognition.sphinx import MODEL_PHONES, Neighbours, beside, dictionary

LIPS = ("P", "B", "M")


def test_words_that_are_left_out_of_the_dictionary_are_pronounced_nearly_as_it_does() -> None:
    words = [(word, phones) for word, phones in dictionary() if word.isalpha() and word.isascii()]
    asked = dict(words[37::2000])  # 60 words from all of the alphabet
    neighbours = Neighbours((word, phones) for word, phones in words if word not in asked)
    told = {word: neighbours.pronounce(word) for word in asked}
    assert all(set(phones) <= set(MODEL_PHONES) for phones in told.values())
    lips = [[name for name in told[word] if name in LIPS] == [n for n in asked[word] if n in LIPS] for word in asked]
    assert sum(lips) >= 0.93 * len(asked) > 50  # 56 of 59; of 493 others 99.8 %
    lengths = [abs(len(told[word]) - len(asked[word])) for word in asked]
    assert sum(lengths) <= 0.1 * sum(map(len, asked.values()))


def test_half_of_a_double_letter_is_not_taken() -> None:
    words = [("abbot", ["AE", "B", "AH", "T"]), ("robot", ["R", "OW", "B", "AA", "T"]), ("chat", ["CH", "AE", "T"])]
    assert Neighbours(words).pronounce("Chatbot") == ["CH", "AE", "T", "B", "AA", "T"]


@pytest.mark.parametrize("word", ["", "3", "Größe", "b2b", "a" * 60])
def test_what_has_no_letters_of_the_dictionary_is_not_pronounced(word: str) -> None:
    assert Neighbours([("a", ["AH"])]).pronounce(word) == []


def test_letters_that_no_word_has_are_silent() -> None:
    assert Neighbours([("ab", ["AE", "B"])]).pronounce("abq") == ["AE", "B"]


def test_letters_lie_beside_their_phones() -> None:
    assert beside("phone", ["F", "OW", "N"]) == ["F", "", "OW", "N", ""]
    assert beside("box", ["B", "AA", "K", "S"]) == ["B", "AA", "K S"]
