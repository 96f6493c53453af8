# ruff: noqa: E501
"""Write docs/conformance.md: clause, module, vectors, status, and every deviation.

Run ``python -m design.conformance``. Deviations are comments and parts of docstrings that begin ``Deviation:``.
"""

import re
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DOC = ROOT / "docs" / "conformance.md"
MARK = "Deviation:"
SOURCES = ("fapengine/mpeg4", "fapengine/codec", "fapengine/trajectory")


@dataclass(frozen=True, slots=True)
class Clause:
    """One row of the page."""

    clause: str
    """Clause of ISO/IEC 14496-2; not checked against its text, a hint where to look."""
    section: str
    """Section of docs/fba-format.md ("FBA section"), which the code cites."""
    what: str
    modules: str
    proof: str
    status: str = "done"


# fmt: off
CLAUSES: tuple[Clause, ...] = (
    Clause("6.2.2",       "1",    "sequence and visual object headers before a face",   "codec/bits.py",             "test_headers_of_a_visual_stream_are_passed", "done; header fields [MEM]"),
    Clause("6.2.10",      "1, 3", "start codes, stuffing, end code",                    "codec/bits.py, codec/writer.py", "t29, all"),
    Clause("6.2.10",      "2",    "plane and temporal header",                          "codec/header.py",                 "t10, t11, t27"),
    Clause("6.2.10",      "16",   "body parameters (object mask 2, 3)",                 "codec/planes.py",                 "test_bodies.py", "read to their end and left out; a BAP whose ranges were never sent is an UnsupportedError"),
    Clause("6.2.10",      "4",    "masks of types 0 to 3, fap_quant, gender",           "codec/header.py",                 "t02, t05, t06, t07, t09"),
    Clause("6.3.10",      "5",    "symbol ranges: table, sent, persistent",             "codec/fields.py, codec/planes.py", "t08, t14, t19, t21"),
    Clause("7.12",        "6",    "quantiser and prediction",                           "codec/kernels.py",                "t01, t04, t15"),
    Clause("7.12",        "7",    "arithmetic coder: models, stuffing, segment end",    "codec/kernels.py",                "t16, t17, t30"),
    Clause("7.12",        "8",    "order of segments, visemes and expressions",         "codec/kernels.py, codec/fields.py", "t03, t20, t23, t25"),
    Clause("7.12",        "9",    "FAPs that are not sent: held, interpolated",         "codec/fit.py",            "test_what_is_not_sent_is_held_or_taken_from_its_partner", "own rules, see deviations; `decode --fit` applies FIT tables"),
    Clause("6.3.10",      "10",   "frame rate, time codes, skipped frames",             "codec/decoder.py, codec/header.py", "t10, t11, t27"),
    Clause("-",           "11",   "worked example",                                     "-",                               "test_bitstream.py"),
    Clause("7.12",        "13",   "DCT mode",                                           "codec/header.py",                 "test_a_wrong_fixed_bit_is_named", "UnsupportedError: its code tables are not known"),
    Clause("Annex C, C.1", "-",   "68 FAPs",                                            "mpeg4/fap.py",                    "tests/vectors/fap_table.csv"),
    Clause("Annex C, C.2", "-",   "FAPU",                                               "mpeg4/fapu.py",                   "tests/unit/mpeg4"),
    Clause("Annex C",      "-",   "feature points",                                     "mpeg4/fap.py",                    "tests/unit/mpeg4"),
    Clause("Annex C, C.4, C.5", "-", "visemes, expressions",                            "mpeg4/fap.py",                    "tests/unit/mpeg4"),
    Clause("Annex C, C.4, C.5", "9", "visemes and expressions are shown",               "trajectory/high_level.py",        "tests/unit/trajectory/test_high_level.py", "own reading of the definitions and init_face, see deviations"),
    Clause("-",           "-",    ".fap text",                                          "codec/fapfile.py",                "t01 to t30, test_fapfile.py"),
    Clause("-",           "-",    ".epf parameter files",                               "codec/epf.py",                    "t01 to t30"),
)
# fmt: on

HEAD = """<!-- Made by design/conformance.py; do not edit. -->
# Conformance

## Test your own program

If you wrote a program that speaks one of these formats, a suite tests it:

```text
python -m fapengine.conformance osc-server 127.0.0.1:9110
python -m fapengine.conformance osc-sender 9110
python -m fapengine.conformance page-server http://127.0.0.1:8110/
python -m fapengine.conformance page-client 8110
python -m fapengine.conformance fba-decoder 'mydecoder {in} {out}'
python -m fapengine.conformance fba-encoder 'myencoder {in} {out}'
```

| suite | what it does | against |
|---|---|---|
| `osc-server` | sends requests to a server over UDP; `--token` if it has one | [osc.md](osc.md) |
| `osc-sender` | listens for `--seconds` (10 by default) while your sender speaks; it ignores the first hello and the first phones | [osc.md](osc.md) |
| `page-server` | sends requests to a server over its WebSocket | [page.md](page.md) |
| `page-client` | is a server for your client, for `--seconds`; it disconnects once | [page.md](page.md) |
| `fba-decoder` | gives your program streams (`.fba`); each value in the `.fap` that it writes must be right | [fba-format.md](fba-format.md) |
| `fba-encoder` | gives your program `.fap`; its stream must be readable, and near | [fba-format.md](fba-format.md) |

Each case is a line: the result, a number, what is required, and where that is documented. A failure adds what was found.

`--json` prints the same for programs. Exit codes: 0 every case passed or did not occur; 1 one failed; 2 wrong use; 3 no
answer, or the port is taken.

## The face bitstream, clause by clause

"Section" is a section of [fba-format.md](fba-format.md). Clauses are those of ISO/IEC 14496-2; they could not be checked
against its text ([sources](fba-format.md#0-sources)). Vectors t01 to t30 are streams of another encoder, in
tests/vectors/fba. Each is encoded to the same bytes and decoded to the same values: `make conformance`.

| clause | section | what | module | vectors or tests | status |
|---|---|---|---|---|---|
"""


def deviations() -> list[tuple[str, str]]:
    """Find what sources say of deviations: module, and the text up to the end of its paragraph."""
    found = []
    for folder in SOURCES:
        for path in sorted((ROOT / folder).glob("*.py")):
            text = path.read_text()
            for match in re.finditer(rf"[^\n]*{MARK}.*?(?=\n\s*\n|\"\"\"|\Z)", text, re.S):
                words = " ".join(re.sub(r"^\s*#?", "", match.group(), flags=re.M).replace('"""', "").split())
                if "the source" not in words:
                    found.append((str(path.relative_to(ROOT / "fapengine")), words.replace("|", "\\|")))
    return found


def page() -> str:
    """Make the whole page."""
    rows = [f"| {c.clause} | {c.section} | {c.what} | {c.modules} | {c.proof} | {c.status} |\n" for c in CLAUSES]
    items = [f"- `{module}`: {words.removeprefix(MARK).strip()}\n" for module, words in deviations()]
    return "".join([HEAD, *rows, "\n## Deviations\n\n", *items])


if __name__ == "__main__":
    DOC.write_text(page())
    print(f"{DOC.name}: {len(CLAUSES)} clauses")
