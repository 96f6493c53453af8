"""``fapengine doctor``: check the installation, and show how to fix each problem."""

import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import typer

from fapengine.cli._doctor_live import LackError
from fapengine.errors import FapEngineError

if TYPE_CHECKING:
    from importlib.metadata import Distribution

ESSENTIAL = ("profile", "renderer", "video")
"""Parts that rendering needs; without them ``doctor`` exits with 3."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the report."""

    part: str
    works: bool
    found: str
    """State of the part, or why it does not work."""
    fix: str = ""
    """Command that fixes it; empty if nothing is needed."""


def doctor(
    licences: bool = typer.Option(False, "--licences", help="List the licence of each package that is used instead."),
    as_json: bool = typer.Option(False, "--json", help="Print the findings as JSON."),
) -> None:
    """Check the installation (OpenGL, voices, video, sound, ports, extras) and show how to fix problems.

    Opens the sound card briefly, without playing sound. Exits with 3 if faces cannot be rendered.
    """
    if licences:
        _print_licences(as_json)
        return
    from functools import partial

    from fapengine.cli import _doctor_live as live
    from fapengine.cli._printing import print_result
    from fapengine.server.config import OSC_PORT, WEB_PORT
    from fapengine.wire.vmc import MARIONETTE_PORT

    checks: list[tuple[str, str, Callable[[], str]]] = [
        ("Python", "", _python),
        ("profile", "pip install --force-reinstall fapengine", _profile),
        ("OpenGL", "sudo apt-get install -y libegl1 libgl1", _opengl),
        ("renderer", "sudo apt-get install -y libegl1 libgl1; or make native, in a checkout", _renderer),
        ("window", 'pip install "fapengine[window]"', live.window),
        ("voices", 'pip install "fapengine[voice]"', _voices),
        ("video", 'pip install --upgrade "fapengine[video]"', _video),
        ("sound", "sudo apt-get install -y libportaudio2", live.sound),
        ("recognizer", 'pip install "fapengine[recognizer]"', live.recognizer),
        ("microphone", "connect one; only live input needs it", live.microphone),
        (f"port {OSC_PORT}, OSC in", "fapengine serve --port N", partial(live.port_in, OSC_PORT)),
        (f"port {WEB_PORT}, page", "fapengine serve --web-port N", partial(live.port_in, WEB_PORT)),
        (f"port {MARIONETTE_PORT}, VMC out", "", partial(live.port_out, MARIONETTE_PORT)),
        ("live server", 'pip install "fapengine[live]"', partial(live.extra, "aiohttp", "prometheus_client")),
        ("face detector", "make detector, in a checkout; or FAPENGINE_DETECTOR=PYTHON", live.detector),
        ("calls", 'pip install "fapengine[webrtc]"', partial(live.extra, "aiortc")),
        ("virtual camera", 'pip install "fapengine[camera]"', partial(live.extra, "pyvirtualcam")),
        ("compiled codec", 'pip install "fapengine[fast]"; or make native, in a checkout', _codec),
        ("copyleft packages", "", _copyleft),
        ("USD", 'pip install "fapengine[usd]"', partial(live.extra, "pxr")),
        ("laboratory", 'pip install "fapengine[lab]"', partial(live.extra, "matplotlib", "trimesh")),
    ]
    findings = [_finding(*check) for check in checks]
    if as_json:
        print_result([asdict(finding) for finding in findings], as_json=True)
    else:
        _print_table(findings)
    if any(finding.part in ESSENTIAL and not finding.works for finding in findings):
        raise typer.Exit(3)


def _finding(part: str, fix: str, check: Callable[[], str]) -> Finding:
    try:
        return Finding(part, True, check())
    except LackError as lack:
        return Finding(part, False, *lack.args)
    except (FapEngineError, ImportError, OSError) as error:
        return Finding(part, False, str(error), fix)


def _python() -> str:
    import platform

    from fapengine import __version__

    return f"{platform.python_version()}, fapengine {__version__}, {platform.system()} {platform.machine()}"


def _profile() -> str:
    from fapengine.files.profiles import load_profile
    from fapengine.speaking import DEFAULT_PROFILE

    profile = load_profile(DEFAULT_PROFILE)
    return f"{profile.id}, {len(profile.phones)} phones, {len(profile.expressions)} expressions"


def _opengl() -> str:
    from fapengine.render.context import create_context

    context = create_context()
    try:
        return f"{context.info['GL_VERSION']} on {context.info['GL_RENDERER']}"
    finally:
        context.release()


def _renderer() -> str:
    from fapengine.render.drawing import DEFAULT_RENDER_OPTIONS
    from fapengine.render.native import by_renderer, native_build

    return by_renderer(
        DEFAULT_RENDER_OPTIONS, native=lambda: f"native: {native_build()}", gl=lambda: f"gl: {_opengl()}"
    )


def _codec() -> str:
    from fapengine.codec import kernels
    from fapengine.render.native import native_build

    found = native_build()
    if kernels.loops is kernels:
        raise LackError(f"{found}, which is older and has none", "pip install --upgrade fapengine-native")
    return found


def _copyleft() -> str:

    found = [f"{package.name} ({package.licence})" for package in used_packages() if package.is_copyleft]
    return f"{', '.join(found) or 'none'}; --licences lists all"


def _print_licences(as_json: bool) -> None:
    from fapengine.cli._printing import print_result, print_rows

    packages = used_packages()
    if as_json:
        print_result([asdict(package) for package in packages], as_json=True)
    else:
        print_rows((package.name, f"{package.version}  {package.licence}") for package in packages)


def _voices() -> str:
    from fapengine.voices.espeak import voices

    return f"espeak-ng, {len(voices())} voices"


def _video() -> str:
    import av
    import PIL  # noqa: F401

    encoders = [name for name in ("libx264", "libopenh264", "libvpx-vp9", "aac", "libopus") if _can_encode(name)]
    if not any(name in encoders for name in ("libx264", "libopenh264")):
        raise LackError(f"PyAV {av.__version__} has no H.264 encoder", "pip install --force-reinstall av")
    return f"PyAV {av.__version__}: {', '.join(encoders)}"


def _can_encode(name: str) -> bool:
    from av.codec import Codec
    from av.codec.codec import UnknownCodecError

    try:
        Codec(name, "w")
    except UnknownCodecError:
        return False
    return True


def _print_table(findings: list[Finding]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table.grid(padding=(0, 1))
    for finding in findings:
        sign = "[green]✓[/]" if finding.works else "[red]✗[/]" if finding.part in ESSENTIAL else "[dim]–[/]"
        fix = f"\n→ {escape(finding.fix)}" if finding.fix else ""
        table.add_row(sign, finding.part, escape(finding.found) + fix)
    console = Console()
    console.print(table)
    if any(not finding.works and finding.part not in ESSENTIAL for finding in findings):
        console.print("\n– is optional, and missing here; → says how to add it.")


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
    from importlib.metadata import PackageNotFoundError, distribution

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


def _required(one: "Distribution", *, with_extras: bool) -> Iterator[str]:
    """Names of what it requires; of its extras only for the first, as nobody knows which of theirs are meant."""
    for line in one.requires or ():
        if with_extras or not re.search(r"\bextra\s*==", line):
            yield re.split(r"[^A-Za-z0-9._-]", line, maxsplit=1)[0]


def _licence(name: str, one: "Distribution") -> str:
    def stated(key: str) -> list[str]:
        return [text for text in one.metadata.get_all(key) or () if text and len(text) < NO_NAME]

    classifiers = [entry.rpartition(":: ")[2] for entry in stated("Classifier") if entry.startswith("License ::")]
    known = [text for text in (*stated("License-Expression"), *stated("License"), *classifiers) if text not in NAMELESS]
    return next(iter(known), UNSAID.get(name, "not stated"))
