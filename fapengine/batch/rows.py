"""A row of a manifest: one utterance, or one speaker's session, and the options that the verbs have for one."""

from dataclasses import dataclass, field, fields
from pathlib import Path

from fapengine.app.fit import OWNED, FitJob
from fapengine.app.manner import manner_of, voice_of
from fapengine.app.outputs import SaveOptions, check_output
from fapengine.codec.encoder import EncoderOptions
from fapengine.errors import UsageError
from fapengine.files.outputs import files_in
from fapengine.laboratory.fit import FitOptions
from fapengine.models.via_points import STRAIGHT
from fapengine.render.drawing import Drawing
from fapengine.speaking import SpeakingOptions

PROFILE = "profile"
KINDS = ("fba", "fap", "mp4", "csv", "glb", PROFILE)
"""Kinds of files that rows may become; a profile is a folder of them."""
FILES = ("session", "timings", "audio", "into", "map")
"""Columns that name files, or a folder of recordings, relative to the manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options(SpeakingOptions):
    """Options of ``say``, ``animate``, ``encode``, ``convert`` and ``fit``, with their names and defaults."""

    language: str = "en-us"
    channel: int | None = None
    format: str | None = None
    tier: str | None = None
    alphabet: str | None = None
    columns: str | None = None
    strict: bool = False
    head: str = "default"
    camera: str = "front"
    background: str = "studio"
    edges: str = "soft"
    size: str = "512x512"
    shapes: str = "arkit"
    quant: int = 1
    kbps: float | None = None
    into: str | None = None
    keys: str = STRAIGHT
    map: str | None = None
    modes: int | None = None
    subset: int | None = None
    tolerance: float = 0.35
    held_out: float = 0.2
    units: str | None = None
    up: str | None = None
    report: bool = True
    faps: bool = False

    def saving(self, kind: str) -> SaveOptions:
        """Return the options of a file of this kind. Raises UsageError for an invalid one."""
        if kind == "mp4":
            drawing = Drawing.parse(size=self.size, camera=self.camera, background=self.background, edges=self.edges)
            return SaveOptions(head=self.head, drawing=drawing)
        if kind == "glb" and self.into:
            from fapengine.app.scene_files import Into  # with scipy

            return SaveOptions(into=Into(Path(self.into), self.keys, Path(self.map) if self.map else None))
        return SaveOptions(
            shapes=self.shapes if kind == "csv" else None,
            encoding=EncoderOptions(quant=self.quant, kbit_s=self.kbps) if kind == "fba" else None,
        )

    def fitting(self, session: Path, output: Path) -> FitJob:
        """Say what is learned from a session. Raises UsageError for what cannot be."""
        return FitJob(
            session=session, output=output, units=self.units, up=self.up, seed=self.seed, voice=self.voice,
            options=FitOptions(
                modes=self.modes, k=self.subset, tolerance_mm=self.tolerance, held_out=self.held_out
            ),
            report=self.report, faps=self.faps,
        )  # fmt: skip

    def check(self, kind: str) -> None:
        """Refuse what cannot be, before anything is done.

        Raises
        ------
        UsageError
            It begins with the option's name.
        """
        manner_of(self)
        voice_of(self)
        if kind == PROFILE:
            self.fitting(Path("a"), Path("b"))
        else:
            check_output(Path(f"a.{kind}"), "", self.saving(kind), rate_hz=self.fps)


OPTION_NAMES = tuple(each.name for each in fields(Options))
LISTS = tuple(each.name for each in fields(Options) if each.default == ())
"""Options that hold several values; in a table they stand apart by ``;``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One utterance: a text; or timings, with their sound or without; or a recording, with its words or without.

    Or a speaker: the session that a profile is learned from.
    """

    id: str
    text: str | None = None
    timings: Path | None = None
    audio: Path | None = None
    session: Path | None = None
    options: Options = field(default_factory=Options)
    line: int = 0
    """Place in the manifest."""

    def __post_init__(self) -> None:
        if self.session is not None:
            if (self.timings, self.audio, self.text) != (None, None, None):
                raise UsageError("session: got one beside text, timings or audio, expected it alone")
            return
        if self.timings is None and self.audio is None and self.text is None:
            raise UsageError("row: got no text, no timings and no audio, expected one")
        if self.timings is not None and self.text is not None:
            raise UsageError("text: got one beside timings, which say themselves what is spoken; expected none")

    def check(self, kind: str) -> None:
        """Refuse what cannot become such a file. Raises UsageError; it begins with the option's name."""
        if (self.session is not None) != (kind == PROFILE):
            raise UsageError(
                "session: got none, expected a folder of recordings for a profile"
                if self.session is None
                else f"session: got one to become {kind}, expected a run to profiles"
            )
        self.options.check(kind)

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Files that it is made of, and names that may be such."""
        options = self.options
        if self.session is not None:
            return (self.session,)
        named = (self.timings, self.audio, options.into, options.map, options.profile, options.head)
        return tuple(Path(path) for path in named if path is not None)

    def output(self, folder: Path, kind: str) -> Path:
        """Name of the file, or of the profile's folder, that the row becomes."""
        return folder / (self.id if kind == PROFILE else f"{self.id}.{kind}")

    def outputs(self, folder: Path, kind: str) -> list[Path]:
        """Names of all files that the row becomes."""
        output = self.output(folder, kind)
        return files_in(output, OWNED) if kind == PROFILE else [output]
