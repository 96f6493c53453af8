"""The example of ``serve.toml`` in docs/reference/configuration.md: every key with its default, and one sink."""

from pathlib import Path

_PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "configuration.md"
EXAMPLE = _PAGE.read_text(encoding="utf-8").partition("```toml\n")[2].partition("```")[0]
