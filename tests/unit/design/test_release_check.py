"""The release check fails on what it is for: links, pages, versions and addresses that are wrong."""

import io
import json
import subprocess
import tarfile
import threading
import zipfile
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import pytest

from design import release_check
from design.release_check import addresses, dead_links, dead_sites, move, npm_faults, wheel_faults
from tests.processes import free_port

ADDRESS = "https://github.com/owner/name"
PAGE = f"[index]({ADDRESS}/blob/v1/README.md) ![face](https://raw.githubusercontent.com/owner/name/v1/docs/pictures/demo.webp)"
METADATA = {
    "Metadata-Version": "2.4", "Name": "fapengine", "Version": "0.1.dev3", "Summary": "a", "License-Expression": "MIT",
    "License-File": "LICENSE", "Requires-Python": ">=3.11", "Keywords": "b",
    "Description-Content-Type": "text/markdown",
}  # fmt: skip
PACKAGE: dict[str, Any] = {
    "version": "0.1.0-dev.3", "repository": {"url": f"git+{ADDRESS}.git"}, "main": "./index.js",
    "types": "./index.d.ts", "exports": {"./arkit": {"default": "./arkit.js"}, "./assets/*": "./assets/*"},
}  # fmt: skip
FILES = ("index.js", "index.d.ts", "arkit.js", "README.md", "LICENSE", "NOTICE")


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        (PAGE, ""),
        ("[part](#part) [mail](mailto:a@example.org) [other](https://github.com/owner/other/blob/v1/nowhere.md)", ""),
        ("[docs](docs/index.md)", "docs/index.md is relative"),
        ("![face](docs/pictures/demo.webp)", "docs/pictures/demo.webp is relative"),
        (f"[gone]({ADDRESS}/blob/v1/docs/gone.md#a)", "the repository has no docs/gone.md"),
        ("![gone](https://raw.githubusercontent.com/owner/name/v1/gone.png)", "the repository has no gone.png"),
    ],
)
def test_links_lead_somewhere(text: str, fault: str) -> None:
    assert fault in " ".join(dead_links(text, ADDRESS))
    assert bool(list(dead_links(text, ADDRESS))) is bool(fault)


def wheel(path: Path, page: str = PAGE, labels: tuple[str, ...] = tuple(release_check.LABELS), **changes: str) -> Path:
    rows = METADATA | {key.replace("_", "-"): value for key, value in changes.items()}
    head = [f"{key}: {value}" for key, value in rows.items() if value]
    head += [f"Project-URL: {label}, {ADDRESS}" for label in labels]
    with zipfile.ZipFile(path / "a.whl", "w") as archive:
        archive.writestr("fapengine-0.1.dist-info/METADATA", "\n".join(head) + "\n\n" + page)
    return path / "a.whl"


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, ""),
        ({"page": "[a](b.md)"}, "b.md is relative"),
        ({"labels": ("Source",)}, "Changelog, Documentation, Issues"),
        ({"License_Expression": ""}, "License-Expression is missing"),
        ({"Description_Content_Type": "text/plain"}, "expected text/markdown"),
        ({"Version": "9.9.9"}, "CHANGELOG.md has no section 9.9.9"),
        ({"Version": "9.9.9"}, "date-released"),
    ],
)
def test_the_page_of_the_index_is_complete(changes: dict[str, Any], fault: str, tmp_path: Path) -> None:
    faults = list(wheel_faults(wheel(tmp_path, **changes), ADDRESS))
    assert fault in " ".join(faults)
    assert bool(faults) is bool(fault)


def npm(path: Path, readme: str = PAGE, files: tuple[str, ...] = FILES, **changes: Any) -> Path:
    contents = dict.fromkeys(files, "") | {"README.md": readme, "package.json": json.dumps(PACKAGE | changes)}
    with tarfile.open(path / "a.tgz", "w:gz") as archive:
        for name, text in contents.items():
            row = tarfile.TarInfo(f"package/{name}")
            row.size = len(text)
            archive.addfile(row, io.BytesIO(text.encode()))
    return path / "a.tgz"


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({}, ""),
        ({"readme": "[a](b.md)"}, "b.md is relative"),
        ({"version": "0.0.0"}, "expected 0.1.0-dev.3"),
        ({"repository": None}, f"expected git+{ADDRESS}.git"),
        ({"files": FILES[:-1]}, "NOTICE is not in the package"),
        ({"main": "./lost.js"}, "./lost.js is not in the package"),
    ],
)
def test_the_page_of_npm_is_complete(changes: dict[str, Any], fault: str, tmp_path: Path) -> None:
    faults = list(npm_faults(npm(tmp_path, **changes), ADDRESS, "0.1.dev3+gabc"))
    assert fault in " ".join(faults)
    assert bool(faults) is bool(fault)


def test_every_file_states_one_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GITHUB_REPOSITORY", raising=False)
    assert len(set(addresses().values())) == 1
    monkeypatch.setenv("GITHUB_REPOSITORY", "somebody/fork")
    assert addresses()["this repository"] == "https://github.com/somebody/fork"


class Site(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response({"/gone": 404, "/busy": 503, "/moved": 302}.get(self.path, 200))
        if self.path == "/moved":
            self.send_header("Location", "/here")
        self.end_headers()

    def log_message(self, *args: object) -> None:
        pass


def test_sites_are_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.md"
    silent = f"http://127.0.0.1:{free_port()}/"
    with HTTPServer(("127.0.0.1", 0), Site) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        site = f"http://127.0.0.1:{server.server_port}"
        page.write_text(
            f"[a]({site}/here#part) [b]({site}/moved) [c]({site}/gone) [d]({site}/busy) [e]({silent})"
            f" [f]({ADDRESS}/none) [g](docs/other.md)"
        )
        faults = list(dead_sites([page], ADDRESS))
        server.shutdown()
        thread.join()
    assert faults[0] == f"page.md: {site}/gone answers 404"
    assert faults[1].startswith(f"page.md: {silent} does not answer")
    assert len(faults) == 2
    assert f"{site}/busy answers 503" in capsys.readouterr().err


def test_the_address_is_changed_everywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GITHUB_REPOSITORY", raising=False)
    before = addresses()["pyproject.toml"].removeprefix("https://").encode()
    stated = [path for path in release_check.tracked() if before in path.read_bytes()]
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    for path in stated:
        copy = tmp_path / path.relative_to(release_check.ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(path.read_bytes())
    subprocess.run(["git", "add", "-A"], cwd=tmp_path, check=True)
    assert len(move("https://github.com/some/body", tmp_path)) == len(stated)
    assert set(addresses(tmp_path).values()) == {"https://github.com/some/body"}
    assert "raw.githubusercontent.com/some/body/v" in (tmp_path / "pyproject.toml").read_text()
    assert not any(before.partition(b"/")[2] in path.read_bytes() for path in release_check.tracked(tmp_path))


@pytest.mark.parametrize(
    "address", [[], ["https://github.com/a/b/"], ["https://github.com/a/b.git"], ["gitlab.com/a/b"]]
)
def test_a_bad_address_changes_nothing(address: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(release_check, "move", pytest.fail)
    assert release_check.main(["--address", *address]) == 2
