"""Licences of the installed packages that fapengine uses, from their metadata."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.metadata import Distribution, PackageNotFoundError, distribution

UNSAID = {"espeakng-loader": "GPL-3.0-or-later"}
"""Packages whose metadata name no licence: espeakng-loader contains espeak-ng."""
NO_NAME = 100
"""Longer texts are whole licences; their classifier has the name."""
NAMELESS = ("UNKNOWN", "OSI Approved")


@dataclass(frozen=True, slots=True)
class Package:
    """An installed package, and the licence that it states."""

    name: str
    version: str
    licence: str

    @property
    def is_copyleft(self) -> bool:
        """Whether it is under the GPL, AGPL or LGPL; others that are bundled inside its wheel do not count."""
        return bool(re.search(r"\bA?L?GPL|General Public", self.licence, re.IGNORECASE))


def used_packages(root: str = "fapengine") -> list[Package]:
    """List the installed packages that a package requires, with all of its extras and theirs, by name."""
    found: dict[str, Package] = {}
    waiting = [root]
    while waiting:
        name = _plain(waiting.pop())
        if name in found:
            continue
        try:
            one = distribution(name)
        except PackageNotFoundError:
            continue
        found[name] = Package(name, one.version, _licence(name, one))
        waiting += _required(one, with_extras=name == root)
    return [found[name] for name in sorted(found)]


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _required(one: Distribution, *, with_extras: bool) -> Iterator[str]:
    """Names of what it requires; of its extras only for the first, as nobody knows which of theirs are meant."""
    for line in one.requires or ():
        if with_extras or not re.search(r"\bextra\s*==", line):
            yield re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]


def _licence(name: str, one: Distribution) -> str:
    def stated(key: str) -> list[str]:
        return [text for text in one.metadata.get_all(key) or () if text and len(text) < NO_NAME]

    classifiers = [entry.rpartition(":: ")[2] for entry in stated("Classifier") if entry.startswith("License ::")]
    known = [text for text in (*stated("License-Expression"), *stated("License"), *classifiers) if text not in NAMELESS]
    return next(iter(known), UNSAID.get(name, "not stated"))
