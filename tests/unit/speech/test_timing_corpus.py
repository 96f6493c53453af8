"""Files in the shapes of public tools: what is read, in which language, what is said and what is refused."""

import re

import pytest

from fapengine.errors import DataError
from fapengine.speech.formats.registry import ParseOptions, parse_timings
from fapengine.speech.plausible import remarks_on

from .timing_corpus import CORPUS, VARIANTS, Case


@pytest.mark.parametrize("case", [*CORPUS, *VARIANTS], ids=lambda case: case.name)
def test_of_a_public_tool(case: Case) -> None:
    data = case.data.encode() if isinstance(case.data, str) else case.data

    if isinstance(case.expected, str):
        with pytest.raises(DataError, match=case.expected):
            parse_timings(data, ending=case.ending, options=ParseOptions(**case.options))
        return
    track = parse_timings(data, ending=case.ending, options=ParseOptions(**case.options))
    spoken = [(phone.label, phone.start_s, phone.end_s) for phone in track.phones if not phone.is_silence]
    assert [label for label, _, _ in spoken] == [label for label, _, _ in case.expected]
    for (_, *times), (_, *right) in zip(spoken, case.expected, strict=True):
        assert times == pytest.approx(right, abs=1e-6)
    assert track.reading.language == case.language
    remarks = [remark for remark in remarks_on(track) if not remark.startswith("alphabet:")]
    assert len(remarks) == (1 if case.remark else 0), remarks
    assert not case.remark or re.search(case.remark, remarks[0])


def test_the_corpus_has_a_hundred_files_of_twenty_tools() -> None:
    assert len(CORPUS) + len(VARIANTS) >= 100
    assert len({case.source.partition(":")[0] for case in CORPUS}) >= 20
