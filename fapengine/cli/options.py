"""Options that several commands share: single ones as types, groups as dataclasses."""

from dataclasses import asdict, dataclass, field
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from fapengine.cli._command import MANNER
from fapengine.server.sinks.kinds import SINK_KINDS
from fapengine.speaking import PROVENANCE

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fapengine.app.face import Face
    from fapengine.app.manner import Manner
    from fapengine.app.scene_files import Into
    from fapengine.render.drawing import RenderOptions

_drawing = partial(typer.Option, rich_help_panel="Rendering")
live = partial(typer.Option, rich_help_panel="Live output")
_avatar = partial(typer.Option, rich_help_panel="Avatar output")
SINKS = ", ".join(kind.spelled for kind in SINK_KINDS)
DATAGRAM_SINKS = ", ".join(kind.spelled for kind in SINK_KINDS if kind.medium == "datagrams")
"""Sinks that work without a server."""

Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="Output file. Video: .mp4, .webm, .mkv, .mov. Animation: .gif, .webp. Image sequence: frame_%04d.png or a"
        " folder; one image: .png. FAPs: .fap (- writes them to standard output), .fba. Weights of blendshapes: .csv."
        " Sound: .wav. With --into: .glb, .vrm, .usda, .usdc, .usd. Animation for VRM avatars: .vrma. With --shapes:"
        " .json, .tsv, .xml, .dat.",
    ),
]
HeadName = Annotated[
    str,
    _drawing(
        "--head",
        help="Head to render: default, woman, man, child, older, random:7, woman:hair_colour=red,age=0.8, or a folder"
        " written by `fapengine head import`.",
    ),
]
CameraName = Annotated[
    str,
    _drawing(
        "--camera",
        help="Camera: front, close, three-quarter, three-quarter-right, profile, profile-right, mouth, eyes, low, high,"
        " or YAW,PITCH in degrees.",
    ),
]
Size = Annotated[str, _drawing("--size", help="Image size in pixels, WIDTHxHEIGHT.")]
Shapes = Annotated[
    str | None,
    typer.Option(
        "--shapes",
        help="Weights in a table (.csv): arkit (52, the default), oculus (15 visemes), vrm0, vrm1 (presets). Of .vrma:"
        " vrm1 (the default) or arkit. Visemes with times (.json, .tsv; .csv but for oculus): mpeg4, oculus, azure or"
        " rhubarb (also .xml, .dat).",
    ),
]
Strict = Annotated[
    bool,
    typer.Option("--strict", help="Fail on anything that looks wrong or had to be assumed, such as an unknown phone."),
]
WordsVoice = Annotated[
    str | None,
    typer.Option(
        "--voice", "-v", help="Voice that pronounces timings without phones. Default: the file's language, else en-us."
    ),
]


class _Mark(StrEnum):
    PROVENANCE = PROVENANCE


WithoutMark = Annotated[
    list[_Mark], typer.Option("--without", help="provenance: do not write the mark that says that a file is synthetic.")
]
"""Where nothing else can be left out; :mod:`fapengine.cli._command` acts on it."""
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Device = Annotated[str | None, live("--audio-device", help="Audio output device: its number, or part of its name.")]


def _list_voices(wanted: bool) -> None:
    if wanted:
        from fapengine.voices.espeak import catalogue

        for entry in catalogue().entries:
            others = " ".join(dict.fromkeys(code for _, code in entry.codes if code != entry.code))
            typer.echo(f"{entry.code:<20} {entry.name}{f'  (also {others})' if others else ''}")
        raise typer.Exit


def complete_sink(incomplete: str) -> list[tuple[str, str]]:
    """Shell completion of sink URLs, each with the programs that receive it."""
    return [(f"{kind.name}://", kind.receivers) for kind in SINK_KINDS if f"{kind.name}://".startswith(incomplete)]


def _complete_datagram_sink(incomplete: str) -> list[tuple[str, str]]:
    names = {f"{kind.name}://" for kind in SINK_KINDS if kind.medium == "datagrams"}
    return [(name, receivers) for name, receivers in complete_sink(incomplete) if name in names]


Sinks = Annotated[
    list[str],
    live(
        "--sink",
        help=f"Also send live frames to this URL: {DATAGRAM_SINKS}. Repeatable.",
        autocompletion=_complete_datagram_sink,
    ),
]


@dataclass(frozen=True, slots=True)
class DrawingOptions:
    """Rendering options."""

    camera: CameraName = "front"
    background: Annotated[
        str,
        _drawing(
            "--background",
            "-b",
            help="Background: studio, a colour (#f0e8d8), an image file, or none for transparency (.webm,"
            " .mov, .webp, .png).",
        ),
    ] = "studio"
    antialias: Annotated[
        str, _drawing(help="Antialiasing: soft (post-process), fine (4x multisampling, about twice as slow) or none.")
    ] = "soft"
    size: Size = "512x512"
    rest: Annotated[
        float,
        _drawing(
            min=0.0,
            max=1.0,
            help="Strength of the expression of the face at rest; 0 draws the neutral face of the standard.",
        ),
    ] = 1.0
    renderer: Annotated[
        str,
        _drawing(
            help="Renderer: native (on the processor, package fapengine-native), gl (OpenGL), or auto: native if it is"
            " installed and there is no GPU."
        ),
    ] = "auto"

    def value(self, *, wire: bool = False) -> "RenderOptions":
        """Return the drawing that the options describe.

        Raises UsageError if one is out of range or unknown; DataError if the background file is not an image.
        """
        from fapengine.files.pictures import load_picture
        from fapengine.render.drawing import RenderOptions

        is_file = not self.background.startswith("#") and Path(self.background).is_file()
        background = load_picture(Path(self.background)) if is_file else self.background
        return RenderOptions.parse(
            size=self.size, camera=self.camera, background=background, edges=self.antialias, wire=wire,
            rest=self.rest, renderer=self.renderer,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WriteOptions:
    """Options of every command that writes files."""

    no_overwrite: Annotated[
        bool, typer.Option("--no-overwrite", help="Do not overwrite existing files. Checked before any work starts.")
    ] = False

    def check(
        self, outputs: "Iterable[Path]", inputs: "Iterable[Path | str | None]" = (), *, beside: "Iterable[Path]" = ()
    ) -> None:
        """Check the output names; when the command has finished, report which files were replaced.

        Raises UsageError, ResourceError as :func:`fapengine.files.outputs.check_outputs` and ``refuse_foreign`` do.

        Parameters
        ----------
        outputs : iterable of Path
        inputs : iterable of Path or str
            Files and folders that are read; None, and names of other things, are ignored.
        beside : iterable of Path
            Further outputs, which the user did not name: existing ones are replaced only if fapengine wrote them.
        """
        from fapengine.cli._command import running
        from fapengine.files.outputs import check_outputs, listed, marks_of, refuse_foreign
        from fapengine.files.provenance import check_signable

        outputs, beside = list(outputs), list(beside)
        check_signable(*outputs, *beside)
        read = [Path(path) for path in inputs if path is not None]
        before = marks_of(check_outputs([*outputs, *beside], read, overwrite=not self.no_overwrite))
        refuse_foreign(beside)

        def tell() -> None:
            after = marks_of(before)
            if replaced := [path for path, mark in before.items() if after[path] != mark]:
                typer.echo(f"fapengine: replaced {listed(replaced)}", err=True)

        if before:
            running.get().call_on_close(tell)


@dataclass(frozen=True, slots=True)
class TimingOptions:
    """How phone timings are read."""

    format: Annotated[
        str | None, typer.Option(help="Format of the timings, if it cannot be detected: textgrid, htk, ...")
    ] = None
    tier: Annotated[str | None, typer.Option(help="TextGrid: tier with the phones.")] = None
    alphabet: Annotated[
        str | None, typer.Option(help="Alphabet of the labels, if it cannot be detected: ipa, arpabet, pinyin, ...")
    ] = None
    columns: Annotated[
        str | None,
        typer.Option(
            help="Columns of a CSV or JSON list: start=NAME,end=NAME,label=NAME,unit=ms; for frame numbers, fps=24."
        ),
    ] = None

    @property
    def how(self) -> "Mapping[str, str | None]":
        """Options of :func:`fapengine.files.timings.load_timings`."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class AvatarOptions:
    """Options that add the motion to an avatar file."""

    into: Annotated[
        Path | None,
        _avatar(
            metavar="AVATAR",
            help="Add the motion to this avatar as an animation and write the result to --output. A .glb, .vrm or .gltf"
            " file, or the name of a head (default, woman, heads/mine; also written as .usda, .usdc). Drives"
            " blendshapes with ARKit, Oculus or VRM names, head and eyes; leaves everything else unchanged.",
        ),
    ] = None
    keys: Annotated[
        str,
        _avatar(
            "--interpolation", help="Keyframes: linear (one per frame) or cubic (fewer, within 0.01 of each weight)."
        ),
    ] = "linear"
    mapping: Annotated[
        Path | None,
        _avatar("--shape-map", help="TOML file that maps the avatar's own blendshape names, as for `head import`."),
    ] = None

    def value(self) -> "Into | None":
        """Return the avatar and its options; None without an avatar.

        Raises UsageError if there are options for an avatar but no avatar.
        """
        from fapengine.errors import UsageError

        if self.into is None:
            if self.mapping is not None or self.keys != "linear":
                raise UsageError("into: missing; --interpolation and --shape-map need it")
            return None
        from fapengine.app.scene_files import Into  # with the formats of other programs

        return Into(self.into, self.keys, self.mapping)


@dataclass(frozen=True, slots=True)
class VoiceList:
    """The option that lists the voices."""

    voices: Annotated[
        bool,
        typer.Option(
            "--voices",
            help="List the available voices and exit.",
            is_eager=True,
            callback=_list_voices,
            rich_help_panel=MANNER,
        ),
    ] = False


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Where live sound and frames go."""

    device: Device = None
    silent: Annotated[bool, live("--silent", help="Do not play sound. The face follows the system clock.")] = False
    sink: Sinks = field(default_factory=list)

    def open_face(self, manner: "Manner") -> "Face":
        """Create a face with this output. Raises as :class:`fapengine.app.face.Face`."""
        from fapengine.app.face import Face

        return Face(
            manner.profile, style=manner.style, seed=manner.seed, rate_hz=manner.rate_hz, device=self.device,
            silent=self.silent, sinks=self.sink,
        )  # fmt: skip
