"""How long the documentation is: pages, words, and the length of its sentences.

Run ``python -m design.docs_size`` for a row per page.
"""

import re
from pathlib import Path
from statistics import median

DOCS = Path(__file__).resolve().parent.parent / "docs"
FENCE = re.compile(r"^ *```.*?^ *```$", flags=re.S | re.M)
COMMENT = re.compile(r"<!--.*?-->", flags=re.S)
MARKUP = re.compile(r"!?\[([^\]]*)\]\([^)]*\)|[*_`]")
ENDS = re.compile(r"(?<=[.!?])[\"')]*\s+(?=[\"'(A-Z0-9/])")


def pages(docs: Path = DOCS) -> list[Path]:
    """Every page that is kept in the repository."""
    return sorted(docs.rglob("*.md"))


def word_count(text: str) -> int:
    """Words as ``wc -w`` counts them, code and tables included."""
    return len(text.split())


def sentences(text: str) -> list[str]:
    r"""Sentences of paragraphs and list items; no code, tables, headings or pictures.

    >>> sentences("# Title\n\nOne sentence. And\n[another](x.md) one.\n\n- `a.b` is an item\n")
    ['One sentence.', 'And another one.', 'a.b is an item']
    """
    text = COMMENT.sub("", FENCE.sub("", text))
    found = []
    for block in re.split(r"\n\s*\n|\n(?=\s*(?:[-*]|\d+\.) )", text):
        lines = [line.strip() for line in block.splitlines() if line.strip()]
        if not lines or lines[0].startswith(("#", "|", "![", ":::", "<")):
            continue
        prose = re.sub(r"^(?:[-*]|\d+\.) +", "", " ".join(line for line in lines if not line.startswith("|")))
        prose = MARKUP.sub(lambda match: match[1] or "", prose)
        found += [sentence.strip() for sentence in ENDS.split(prose) if sentence.strip()]
    return found


def median_sentence(texts: list[str]) -> float:
    """Median number of words in a sentence."""
    return median(len(sentence.split()) for text in texts for sentence in sentences(text))


def main() -> None:
    texts = {path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8") for path in pages()}
    for name, text in sorted(texts.items(), key=lambda item: -word_count(item[1])):
        found = sentences(text)
        length = (
            f"median {median_sentence([text]):4.1f}, longest {max(len(one.split()) for one in found)}" if found else ""
        )
        print(f"{word_count(text):6} words  {length:28} {name}")
    print(f"{len(texts)} pages, {sum(map(word_count, texts.values())):,} words, ", end="")
    print(f"median sentence {median_sentence(list(texts.values())):g} words")


if __name__ == "__main__":
    main()
