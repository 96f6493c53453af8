"""Options that several verbs share, declared once: single ones as types, groups as dataclasses with their value."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from fapengine.app.manner import Manner
    from fapengine.app.say_live import LiveOutput
    from fapengine.app.scene_choice import Into
    from fapengine.render.drawing import Drawing
    from fapengine.speech.phone_track import PhoneTrack
    from fapengine.trajectory.style import Style
    from fapengine.voices.choice import VoiceChoice

MANNER, DRAWING, LIVE, AVATAR = "How it speaks", "How it is drawn", "Live", "Into an avatar's file"
"""Titles of the groups in a verb's help."""

Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="Video (.mp4, .webm, .mkv, .mov), animation (.gif, .webp), numbered pictures (frame_%04d.png, or a"
        " folder), or .fap for the FAPs alone (-: to standard output); with --into, an avatar (.glb, .vrm); with"
        " --shapes, mouth shapes (.json, .tsv, .xml, .dat).",
    ),
]
ProfileName = Annotated[
    str,
    typer.Option("--profile", help="Whose way of speaking: a shipped name or a folder.", rich_help_panel=MANNER),
]
HeadName = Annotated[
    str,
    typer.Option(
        "--head",
        help="Whose face: default, woman, man, child, older, random:7, woman:hair_colour=red,age=0.8, "
        "or a folder of `fapengine head import`.",
        rich_help_panel=DRAWING,
    ),
]
CameraName = Annotated[
    str,
    typer.Option(
        "--camera",
        help="front, close, three-quarter, profile, mouth, eyes, low, high; three-quarter-right, profile-right; or"
        " YAW,PITCH in degrees.",
        rich_help_panel=DRAWING,
    ),
]
Size = Annotated[str, typer.Option("--size", help="Width x height in pixels.", rich_help_panel=DRAWING)]
Fps = Annotated[float, typer.Option("--fps", help="Frames a second.", rich_help_panel=MANNER)]
Without = Annotated[
    list[str],
    typer.Option(
        "--without",
        help="What shall not move by itself: blinks, head-motion, gaze, idle, emphasis, or all.",
        rich_help_panel=MANNER,
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        min=0,
        help="Chance of blinks, glances and head motion; the same seed, the same face.",
        rich_help_panel=MANNER,
    ),
]
Shapes = Annotated[
    str | None, typer.Option("--shapes", help="Mouth shapes in place of a moving face: rhubarb, the nine of Rhubarb.")
]
Strict = Annotated[bool, typer.Option("--strict", help="An unknown phone is an error, not a neutral vowel.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Device = Annotated[
    str | None,
    typer.Option(
        "--device",
        help="Where live sound goes out: a number, or a part of a device's name.",
        rich_help_panel=LIVE,
    ),
]


def _list_voices(wanted: bool) -> None:
    if wanted:
        from fapengine.voices.espeak import catalogue

        for entry in catalogue().entries:
            others = " ".join(dict.fromkeys(code for _, code in entry.codes if code != entry.code))
            typer.echo(f"{entry.code:<20} {entry.name}{f'  (also {others})' if others else ''}")
        raise typer.Exit


def _complete_voice(incomplete: str) -> list[tuple[str, str]]:
    """Codes of voices that begin so, each with its name, for the shell."""
    from fapengine.errors import ResourceError
    from fapengine.voices.espeak import voices

    try:
        return [(code, name) for code, name in voices().items() if code.startswith(incomplete.lower())]
    except ResourceError:
        return []


VoiceName = Annotated[
    str,
    typer.Option(
        "--voice",
        "-v",
        help="Language, such as en-gb, de or fr, in any spelling; or a service's voice: elevenlabs:ID, cartesia:ID,"
        " inworld:ID, fish:ID, with the key in ELEVENLABS_API_KEY and so on; or a model of your own:"
        " piper:/path/voice.onnx, kokoro:/path/model.onnx?voices=/path/voices.bin&voice=af_heart.",
        rich_help_panel=MANNER,
        autocompletion=_complete_voice,
    ),
]


def _gain(flag: str, text: str) -> object:
    return typer.Option(flag, help=text, rich_help_panel=MANNER)


@dataclass(frozen=True, slots=True)
class MannerOptions:
    """Options that say how a face speaks."""

    expression: Annotated[
        list[str],
        typer.Option(
            "--expression",
            "-e",
            help="joy, sadness, anger, fear, disgust, surprise, smile_left, smile_right or contempt, with a strength,"
            " and when: joy:0.4, joy:0.4@1.5-3 (s), joy:0.4@word.",
            rich_help_panel=MANNER,
        ),
    ] = field(default_factory=list)
    profile: ProfileName = "grid_s1_en"
    fps: Fps = 30.0
    articulation: Annotated[float, _gain("--articulation", "Size of mouth movements; 1 is natural.")] = 1.0
    jaw: Annotated[float, _gain("--jaw", "Size of the jaw's part in them, 0 to 3.")] = 1.0
    lips: Annotated[float, _gain("--lips", "Size of the lips' part, 0 to 3: below 1 mumbles, above exaggerates.")] = 1.0
    loudness: Annotated[float, _gain("--loudness", "dB against the recorded speaker; louder opens the jaw.")] = 0.0
    method: Annotated[str, _gain("--method", "context, paper, minimum-jerk or dominance.")] = "context"
    without: Without = field(default_factory=list)
    seed: Seed = 1

    def value(self) -> "Manner":
        """Return them as a manner.

        Raises
        ------
        UsageError
            If one is out of range or unknown.
        """
        from fapengine.app.manner import Manner

        return Manner(
            profile=self.profile,
            style=self._style(),
            expressions=tuple(self.expression),
            seed=self.seed,
            rate_hz=self.fps,
        )

    def _style(self) -> "Style":
        from fapengine.trajectory.style import Style, parse_method

        return Style(
            articulation=self.articulation,
            jaw=self.jaw,
            lips=self.lips,
            loudness_db=self.loudness,
            method=parse_method(self.method),
        ).without(self.without)


@dataclass(frozen=True, slots=True)
class DrawingOptions:
    """Options that say how a face is drawn."""

    camera: CameraName = "front"
    background: Annotated[
        str,
        typer.Option(
            "--background",
            "-b",
            help="studio, a colour (#f0e8d8), a picture's file, or none for alpha (.webm, .mov, .webp, .png).",
            rich_help_panel=DRAWING,
        ),
    ] = "studio"
    edges: Annotated[
        str,
        typer.Option(
            "--edges",
            help="soft; fine: four samples a pixel, in twice the time; none: stairs.",
            rich_help_panel=DRAWING,
        ),
    ] = "soft"
    size: Size = "512x512"

    def value(self, *, wire: bool = False) -> "Drawing":
        """Return them as a drawing.

        Raises
        ------
        UsageError
            If one is out of range or unknown.
        DataError
            If the background's file is no picture.
        """
        from fapengine.files.pictures import load_picture
        from fapengine.render.drawing import Drawing

        is_file = not self.background.startswith("#") and Path(self.background).is_file()
        background = load_picture(Path(self.background)) if is_file else self.background
        return Drawing.parse(
            size=self.size, camera=self.camera, background=background, edges=self.edges, wire=wire
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class WriteOptions:
    """Options of every verb that writes."""

    no_overwrite: Annotated[
        bool, typer.Option("--no-overwrite", help="Refuse to replace a file, before any work is done.")
    ] = False

    def check(self, outputs: "Iterable[Path]", inputs: "Iterable[Path | str | None]" = ()) -> None:
        """Look at the names that will be written; when the verb has ended, it is said which files they replaced.

        Parameters
        ----------
        outputs : iterable of Path
        inputs : iterable of Path or str
            Files and folders that are read; None, and names of what is no file, are passed over.

        Raises
        ------
        UsageError, ResourceError
            As :func:`fapengine.files.outputs.check_outputs` does.
        """
        from fapengine.cli._verb import at_end
        from fapengine.files.outputs import check_outputs, listed, marks_of

        read = [Path(path) for path in inputs if path is not None]
        before = marks_of(check_outputs(outputs, read, overwrite=not self.no_overwrite))

        def tell() -> None:
            after = marks_of(before)
            if replaced := [path for path, mark in before.items() if after[path] != mark]:
                typer.echo(f"fapengine: replaced {listed(replaced)}", err=True)

        if before:
            at_end.get()(tell)


@dataclass(frozen=True, slots=True)
class TimingOptions:
    """Options that say how phone timings are read."""

    file_format: Annotated[
        str | None, typer.Option("--format", help="Of the timings, if the content does not tell: textgrid, htk, ...")
    ] = None
    tier: Annotated[str | None, typer.Option("--tier", help="TextGrid: the tier that holds the phones.")] = None
    alphabet: Annotated[
        str | None, typer.Option("--alphabet", help="Of the labels, if not to be guessed: ipa, arpabet, pinyin, ...")
    ] = None
    columns: Annotated[
        str | None,
        typer.Option(
            "--columns", help="Of a CSV or JSON list: start=NAME,end=NAME,label=NAME,unit=ms; of frames: fps=24."
        ),
    ] = None

    @property
    def given(self) -> "Mapping[str, str | None]":
        """Each option's value by its flag; None where it was not given."""
        return {
            "--format": self.file_format,
            "--tier": self.tier,
            "--alphabet": self.alphabet,
            "--columns": self.columns,
        }

    def load(self, path: Path) -> "PhoneTrack":
        """Read timings as the options say; raises what :func:`fapengine.files.timings.load_timings` does."""
        from fapengine.files.timings import load_timings

        return load_timings(
            path, file_format=self.file_format, tier=self.tier, alphabet=self.alphabet, columns=self.columns
        )


@dataclass(frozen=True, slots=True)
class AvatarOptions:
    """Options that put the motion into somebody's avatar."""

    into: Annotated[
        Path | None,
        typer.Option(
            "--into",
            metavar="AVATAR",
            help="Avatar (.glb, .vrm, .gltf), or the name of a head (default, woman, heads/mine), that is written to"
            " --output (.glb, .vrm; a head's also .usda, .usdc) with the motion as an animation: its shapes by ARKit's,"
            " Oculus' or VRM's names, its head and eyes; nothing else in it changes.",
            rich_help_panel=AVATAR,
        ),
    ] = None
    keys: Annotated[
        str,
        typer.Option(
            "--keys",
            help="linear: a key a frame; cubic: few keys with tangents, at most 0.01 of a weight away.",
            rich_help_panel=AVATAR,
        ),
    ] = "linear"
    mapping: Annotated[
        Path | None,
        typer.Option(
            "--map", help="What shapes of other names mean (.toml), as of head import.", rich_help_panel=AVATAR
        ),
    ] = None

    def value(self) -> "Into | None":
        """Return them as one value; None without an avatar.

        Raises
        ------
        UsageError
            If there is no avatar, and something is said of it.
        """
        from fapengine.app.scene_choice import Into
        from fapengine.errors import UsageError

        if self.into is None:
            if self.mapping is not None or self.keys != "linear":
                raise UsageError("into: got none, expected the avatar that --keys and --map are for")
            return None
        return Into(self.into, self.keys, self.mapping)


@dataclass(frozen=True, slots=True)
class VoiceOptions:
    """Options that choose a voice."""

    voice: VoiceName = "en-us"
    rate: Annotated[int, typer.Option("--rate", help="Words a minute, 80 to 449.", rich_help_panel=MANNER)] = 160
    voices: Annotated[
        bool,
        typer.Option(
            "--voices", help="List the voices and stop.", is_eager=True, callback=_list_voices, rich_help_panel=MANNER
        ),
    ] = False
    ssml: Annotated[
        bool,
        typer.Option("--ssml", help="The text is SSML: its tags are obeyed, not spoken.", rich_help_panel=MANNER),
    ] = False

    def value(self) -> "VoiceChoice":
        """Return them as a voice that is not loaded yet."""
        from fapengine.voices.choice import VoiceChoice

        return VoiceChoice(self.voice, self.rate, self.ssml)


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """Options that say where live sound and frames go."""

    device: Device = None
    silent: Annotated[
        bool,
        typer.Option("--silent", help="Play no sound; the face keeps time by the clock.", rich_help_panel=LIVE),
    ] = False
    sink: Annotated[
        list[str],
        typer.Option(
            "--sink",
            help="Where live frames go too, such as vmc://127.0.0.1, vrchat://HOST, osc://HOST:PORT.",
            rich_help_panel=LIVE,
        ),
    ] = field(default_factory=list)

    def value(self) -> "LiveOutput":
        """Return them as one value."""
        from fapengine.app.say_live import LiveOutput

        return LiveOutput(device=self.device, silent=self.silent, sinks=tuple(self.sink))
