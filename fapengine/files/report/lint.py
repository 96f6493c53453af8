"""Verdicts for continuous integration: JUnit's XML, and SARIF 2.1.0 (OASIS) with the times of faults."""

import json
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from urllib.parse import quote_from_bytes
from xml.etree import ElementTree

from fapengine.scoring.thresholds import LIP_THRESHOLDS, MESH_THRESHOLDS
from fapengine.scoring.verdict import FILE, Fault, Verdict

SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A recording and its verdict."""

    path: PurePath
    verdict: Verdict
    frames: tuple[float, float] = (0.0, 0.0)
    """Time of the first frame, s, and frame rate, Hz, of a table with a line per frame; 0 Hz for other files."""

    def line(self, time_s: float) -> int:
        """Line of the file at a time; 1 if lines are not frames."""
        first_s, rate_hz = self.frames
        return max(2 + round((time_s - first_s) * rate_hz), 1) if rate_hz else 1


def format_junit(results: Sequence[Judged]) -> bytes:
    """Format JUnit XML: a suite for each recording, a case for each check, a failure with the times of its faults."""
    top = ElementTree.Element("testsuites", name="fapengine score")
    for result in results:
        verdict = result.verdict
        suite = ElementTree.SubElement(top, "testsuite", name=_plain(str(result.path)))
        faults = {fault.check: fault for fault in verdict.faults}
        for check in dict.fromkeys((*verdict.checked, *verdict.unchecked, *faults)):
            case = ElementTree.SubElement(suite, "testcase", name=check, classname=_plain(str(result.path)), time="0")
            if check in faults:
                kind = "error" if check == FILE else "failure"
                found = ElementTree.SubElement(case, kind, message=_plain(faults[check].message), type=check)
                found.text = _plain("\n".join([faults[check].message, *map(_spell, faults[check].times_s)]))
            elif check in verdict.unchecked:
                ElementTree.SubElement(case, "skipped", message="could not be measured")
    for owner in (top, *top):
        for name, tag in (("tests", "testcase"), ("failures", "failure"), ("errors", "error"), ("skipped", "skipped")):
            owner.set(name, str(len(list(owner.iter(tag)))))
        owner.set("time", "0")
    ElementTree.indent(top)
    text: bytes = ElementTree.tostring(top, "utf-8", xml_declaration=True)
    return text + b"\n"


def format_sarif(results: Sequence[Judged], *, version: str) -> bytes:
    """Format a SARIF log: a result for each fault, or for each time of one.

    Parameters
    ----------
    version : str
        Version of fapengine.
    """
    rules = {row.name: row.help for row in (*LIP_THRESHOLDS, *MESH_THRESHOLDS)}
    rules[FILE] = "the recording can be read and scored"
    names = list(rules)
    log = {
        "$schema": SCHEMA,
        "version": "2.1.0",
        "runs": [
            {
                "tool": {
                    "driver": {
                        "name": "fapengine score",
                        "version": version,
                        "rules": [
                            {"id": name, "shortDescription": {"text": text[0].upper() + text[1:] + "."}}
                            for name, text in rules.items()
                        ],
                    }
                },
                "columnKind": "unicodeCodePoints",
                "results": [
                    _result(result, fault, time_s, names.index(fault.check))
                    for result in results
                    for fault in result.verdict.faults
                    for time_s in fault.times_s or (None,)
                ],
            }
        ],
    }
    return json.dumps(log, indent=2, ensure_ascii=False).encode(errors="replace") + b"\n"


def _result(result: Judged, fault: Fault, time_s: float | None, rule: int) -> dict[str, object]:
    place: dict[str, object] = {
        "physicalLocation": {
            "artifactLocation": {"uri": quote_from_bytes(os.fsencode(result.path.as_posix()))},
            "region": {"startLine": 1 if time_s is None else result.line(time_s)},
        }
    }
    if time_s is not None:
        place["message"] = {"text": _spell(time_s)}
    return {
        "ruleId": fault.check,
        "ruleIndex": rule,
        "level": "error",
        "message": {"text": fault.message if time_s is None else f"{_spell(time_s)}: {fault.message}"},
        "locations": [place],
        **({} if time_s is None else {"properties": {"time_s": time_s}}),
    }


def _spell(time_s: float) -> str:
    return f"at {time_s:.3f} s"


def _plain(text: str) -> str:
    return NOT_XML.sub("?", text)
