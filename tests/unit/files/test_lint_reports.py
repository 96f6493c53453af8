"""JUnit and SARIF: times, lines, and characters that XML or addresses cannot hold."""

import json
from pathlib import PurePosixPath
from xml.etree import ElementTree

from fapengine.files.report.lint import SCHEMA, Judged, format_junit, format_sarif
from fapengine.scoring.verdict import Fault, Verdict

LATE = Verdict(
    (Fault("lag", "lag 99 ms"), Fault("closures", "closures 0 %", (0.5, 1.25))), ("lag", "closures"), "", ("r",)
)
RESULTS = [
    Judged(PurePosixPath("a b/ä%.csv"), LATE, frames=(-0.5, 30.0)),
    Judged(PurePosixPath("b\x00.fap"), Verdict((Fault("file", "b\x00.fap: broken"),), ("file",), "")),
    Judged(PurePosixPath("\udcff.fap"), Verdict((Fault("file", "\udcff.fap: broken"),), ("file",), "")),
    Judged(PurePosixPath("c.fap"), Verdict((), ("lag",), "lag 1 ms")),
]


def test_junit_counts_and_can_be_parsed() -> None:
    top = ElementTree.fromstring(format_junit(RESULTS))
    assert [top.get(name) for name in ("tests", "failures", "errors", "skipped")] == ["6", "2", "2", "1"]
    assert [suite.get("name") for suite in top] == ["a b/ä%.csv", "b?.fap", "?.fap", "c.fap"]
    found = top.findall("testsuite/testcase/failure")
    assert [each.text for each in found] == ["lag 99 ms", "closures 0 %\nat 0.500 s\nat 1.250 s"]
    assert top.find("testsuite/testcase[@name='r']/skipped") is not None
    assert ElementTree.fromstring(format_junit([])).get("tests") == "0"


def test_sarif_names_rules_files_lines_and_times() -> None:
    log = json.loads(format_sarif(RESULTS, version="1.2"))
    assert (log["$schema"], log["version"]) == (SCHEMA, "2.1.0")
    (run,) = log["runs"]
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    assert len(rules) == len(set(rules))
    assert run["tool"]["driver"]["version"] == "1.2"
    places = []
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        place = result["locations"][0]["physicalLocation"]
        places.append((result["ruleId"], place["artifactLocation"]["uri"], place["region"]["startLine"]))
    uri = "a%20b/%C3%A4%25.csv"
    # the table begins at -0.5 s, with a line for each of 30 frames a second below its header
    assert places == [
        ("lag", uri, 1),
        ("closures", uri, 32),
        ("closures", uri, 54),
        ("file", "b%00.fap", 1),
        ("file", "%FF.fap", 1),
    ]
    assert [result.get("properties") for result in run["results"]] == [
        None,
        {"time_s": 0.5},
        {"time_s": 1.25},
        None,
        None,
    ]
    assert run["results"][2]["message"]["text"] == "at 1.250 s: closures 0 %"
