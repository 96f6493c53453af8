"""Checks of what would be published, on the built files: the pages at the index and npm, their links, their versions.

python -m design.release_check dist/*.whl out/fapengine-face-*.tgz    # make release-check does
python -m design.release_check --links    # asks every other site that a page links to; needs a network
python -m design.release_check --address https://github.com/OWNER/NAME    # puts the repository's address everywhere

It imports nothing of the package: it runs in the environment of the tools.
"""

import email
import json
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterable, Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import yaml
from readme_renderer import markdown

ROOT = Path(__file__).resolve().parent.parent
GONE = {404, 410}
"""Answers that mean that a page does not exist; others (403, 429, 503) say nothing about it."""
LABELS = {"Documentation", "Source", "Issues", "Changelog"}
"""Links that the index shows beside the page."""


class _Targets(HTMLParser):
    """Where links and pictures of a page lead."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note the target of a link or a picture."""
        self.found += [value for name, value in attrs if (tag, name) in {("a", "href"), ("img", "src")} and value]


def targets(text: str) -> list[str]:
    """Render Markdown as the index does, and return where its links and pictures lead.

    Raises
    ------
    ValueError
        If the renderer refuses the text.
    """
    page = markdown.render(text)
    if page is None:
        raise ValueError("the renderer of the index refuses the text")
    parser = _Targets()
    parser.feed(page)
    return parser.found


def dead_links(text: str, address: str, root: Path = ROOT) -> Iterator[str]:
    """Links of a page that lead nowhere: relative ones, and those to files of the repository that do not exist.

    Parameters
    ----------
    text : str
        Markdown.
    address : str
        Of the repository, such as https://github.com/OWNER/NAME.
    root : Path
        Checkout.
    """
    owner = address.removeprefix("https://github.com/")
    inside = re.compile(
        rf"https://(?:github\.com/{re.escape(owner)}/(?:blob|tree|raw)|raw\.githubusercontent\.com/{re.escape(owner)})"
        r"/[^/]+/([^#?]+)"
    )
    for target in targets(text):
        if not target.startswith(("https://", "http://", "mailto:", "#")):
            yield f"{target} is relative"
        elif (found := inside.match(target)) and not (root / found[1]).exists():
            yield f"{target}: the repository has no {found[1]}"


def wheel_faults(wheel: Path, address: str) -> Iterator[str]:
    """Return the faults of the page that the index would show of a wheel."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        metadata = email.message_from_bytes(archive.read(name))
    labels = {entry.partition(",")[0] for entry in metadata.get_all("Project-URL", [])}
    if missing := LABELS - labels:
        yield f"links beside the page are missing: {', '.join(sorted(missing))}"
    if metadata["Description-Content-Type"] != "text/markdown":
        yield f"the description is {metadata['Description-Content-Type']}, expected text/markdown"
    for key in ("Summary", "License-Expression", "License-File", "Requires-Python", "Keywords"):
        if not metadata[key]:
            yield f"{key} is missing"
    text = metadata.get_payload(decode=True)
    assert isinstance(text, bytes)
    yield from dead_links(text.decode(), address)
    version = metadata["Version"]
    headings = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    if "dev" not in version:
        if version not in headings:
            yield f"CHANGELOG.md has no section {version}"
        citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
        if citation["version"] != version or "date-released" not in citation:
            yield f"CITATION.cff: version and date-released are not those of {version}"


def npm_faults(package: Path, address: str, version: str) -> Iterator[str]:
    """Return the faults of an npm package whose wheel has this version."""
    with tarfile.open(package) as archive:
        files = {member.name.removeprefix("package/") for member in archive.getmembers()}
        about, readme = (archive.extractfile(f"package/{name}").read() for name in ("package.json", "README.md"))  # type: ignore[union-attr]
    described: dict[str, Any] = json.loads(about)
    if (described.get("repository") or {}).get("url") != f"git+{address}.git":
        yield f"repository: got {described.get('repository')}, expected git+{address}.git"
    number, _, count = version.partition("+")[0].partition(".dev")
    expected = ".".join([*number.split("."), "0", "0"][:3]) + (f"-dev.{count}" if count else "")
    if described["version"] != expected:
        yield f"version: got {described['version']}, expected {expected} as the wheel"
    named = [described["main"], described["types"], "README.md", "LICENSE", "NOTICE"]
    for entry in described["exports"].values():
        named += entry.values() if isinstance(entry, dict) else []
    yield from (f"{name} is not in the package" for name in named if name.removeprefix("./") not in files)
    yield from dead_links(readme.decode(), address)


def addresses(root: Path = ROOT) -> dict[str, str]:
    """The repository's address in each file that states it."""
    citation = yaml.safe_load((root / "CITATION.cff").read_text())
    package = json.loads((root / "fapengine-face" / "package.json").read_text())
    project = tomllib.loads((root / "pyproject.toml").read_text())
    (replacement, *_) = re.findall(
        r"https://github\.com/[^/]+/[^/]+", json.dumps(project["tool"]["hatch"]["metadata"]["hooks"])
    )
    found = {
        "pyproject.toml": project["project"]["urls"]["Source"],
        "pyproject.toml, links of the page": replacement,
        "fapengine-face/package.json": package["repository"]["url"].removeprefix("git+").removesuffix(".git"),
        "CITATION.cff": citation["repository-code"],
    }
    if "GITHUB_REPOSITORY" in os.environ:
        found["this repository"] = f"https://github.com/{os.environ['GITHUB_REPOSITORY']}"
    return found


def tracked(root: Path = ROOT) -> list[Path]:
    """Files of the repository."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, check=True, text=True).stdout
    return [root / name for name in names.split("\0") if name and (root / name).is_file()]


def dead_sites(pages: Iterable[Path], address: str, timeout_s: float = 30.0) -> Iterator[str]:
    """Ask every address that pages link to, but for those of this repository; yield those that lead nowhere."""
    found: dict[str, Path] = {}
    for page in pages:
        for target in targets(page.read_text()):
            if target.startswith(("https://", "http://")) and not target.startswith(address):
                found.setdefault(target.partition("#")[0], page)
    for target, page in found.items():
        request = urllib.request.Request(target, headers={"User-Agent": "fapengine-release-check"})
        try:
            with urllib.request.urlopen(request, timeout=timeout_s):
                pass
        except urllib.error.HTTPError as error:
            if error.code in GONE:
                yield f"{page.name}: {target} answers {error.code}"
            else:
                print(f"release-check: {page.name}: {target} answers {error.code}; look at it", file=sys.stderr)
        except OSError as error:
            yield f"{page.name}: {target} does not answer ({error})"


def move(address: str, root: Path = ROOT) -> list[str]:
    """Put the repository's address into every file that states it, and return their names."""
    before, after = (each.removeprefix("https://") for each in (addresses(root)["pyproject.toml"], address))
    changed = []
    for path in tracked(root):
        data = path.read_bytes()
        moved = data
        for host in ("github.com", "raw.githubusercontent.com"):
            moved = moved.replace(
                before.replace("github.com", host).encode(), after.replace("github.com", host).encode()
            )
        if moved != data:
            path.write_bytes(moved)
            changed.append(str(path.relative_to(root)))
    return changed


def main(words: list[str]) -> int:
    """Print every fault; 1 if there is one."""
    stated = addresses()
    if words[:1] == ["--address"]:
        if len(words) != 2 or not re.fullmatch(r"https://github\.com/[\w.-]+/[\w-][\w.-]*(?<!\.git)", words[1]):
            print(
                f"release-check: got {' '.join(words)}, expected --address https://github.com/OWNER/NAME",
                file=sys.stderr,
            )
            return 2
        print("\n".join(move(words[1])))
        return 0
    if words == ["--links"]:
        pages = [path for path in tracked() if path.suffix == ".md"]
        faults = list(dead_sites(pages, stated["pyproject.toml"]))
    else:
        faults = package_faults(*map(Path, words), stated)
    for fault in faults:
        print(f"release-check: {fault}", file=sys.stderr)
    return min(len(faults), 1)


def package_faults(wheel: Path, package: Path, stated: dict[str, str]) -> list[str]:
    """Return the faults of what would be published."""
    address = stated["pyproject.toml"]
    faults = [f"{place}: the address is {got}, expected {address}" for place, got in stated.items() if got != address]
    faults += [f"{wheel.name}: {fault}" for fault in wheel_faults(wheel, address)]
    return faults + [f"{package.name}: {fault}" for fault in npm_faults(package, address, wheel.name.split("-")[1])]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
