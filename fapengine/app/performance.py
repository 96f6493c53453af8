"""Text, a recording or phone timings to a performance: FAPs, phones and sound."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from fapengine._arrays import Sound, SoundLike, as_sound
from fapengine._strict_toml import check_fields, checked
from fapengine.app.manner import Expressions, Manner, check_expressions, moods_of
from fapengine.app.outputs import SaveOptions, timed_visemes, write_output
from fapengine.app.report import Report
from fapengine.engine.commands import Express
from fapengine.engine.gestures import command_ramps, commands_of
from fapengine.errors import UsageError
from fapengine.files.paths import naming
from fapengine.files.profiles import load_profile
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.mpeg4.track import FapTrack
from fapengine.profiles import Profile
from fapengine.render.drawing import RenderOptions
from fapengine.speaking import DEFAULT_PROFILE, DEFAULT_VOICE
from fapengine.speech.marks import TimedMark, read_marks
from fapengine.speech.phone_track import PhoneTrack
from fapengine.speech.plausible import refuse, remarks_on, script_remarks, sound_remarks, spoken_end_s
from fapengine.speech.text.normal_form import speakable
from fapengine.trajectory.expression import Mood
from fapengine.trajectory.planner import plan
from fapengine.trajectory.style import Style
from fapengine.voices.choice import VoiceChoice, language_voice, loaded
from fapengine.voices.protocol import SHORT_S, Speech, Voice

if TYPE_CHECKING:
    from fapengine.app.hearing import Hearing, Recognition
    from fapengine.app.motion import Weights
    from fapengine.app.scene_files import Into
    from fapengine.codec.encoder import EncoderOptions

LEAD_S, TAIL_S = 0.3, 0.5
"""Silence before and after a spoken text, in which the face starts and ends at rest."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Performance:
    """A planned utterance: motion, phones and sound.

    Examples
    --------
    >>> hello = speak("Hello.", rate_hz=25.0)
    >>> hello.track.values.shape == (round(25 * hello.duration_s), 68)
    True
    """

    track: FapTrack
    phones: PhoneTrack
    """Phones in the time of the track, which begins at 0."""
    sound: Sound | None = None
    """(N,) int16 mono samples and their rate in Hz; None if it is silent. Other forms of sound are converted."""
    text: str = ""
    """Words that were spoken, where they are known."""
    remarks: tuple[str, ...] = ()
    """Sentences about text that was not spoken as written, timings that look wrong, and what was assumed."""
    marks: tuple[TimedMark, ...] = ()
    """Inline cues of the text, such as ``[laughs]``."""

    def __post_init__(self) -> None:
        if self.sound is not None:
            object.__setattr__(self, "sound", as_sound(self.sound))
        check_fields(self)

    def __repr__(self) -> str:
        return f"Performance({self.text!r:.60}, {self.track!r}, {self.phones!r}, {'no ' * (not self.sound)}sound)"

    @property
    def duration_s(self) -> float:
        """Length of the sound, or of the phones where there is none."""
        return len(self.sound[0]) / self.sound[1] if self.sound else self.phones.duration_s

    @property
    def speech(self) -> Speech:
        """Sound and phones as a voice gives them.

        Raises
        ------
        UsageError
            If there is no sound.
        """
        if self.sound is None:
            raise UsageError("sound: this performance has no sound")
        samples, rate_hz = self.sound
        return Speech(
            samples=samples, sample_rate_hz=rate_hz, phones=self.phones, remarks=self.remarks, text=self.text,
            marks=self.marks,
        )  # fmt: skip

    @property
    def doubts(self) -> tuple[str, ...]:
        """The remarks on what looks wrong or was assumed: all but the notes of the reading."""
        return tuple(remark for remark in self.remarks if remark not in self.phones.reading.notes)

    def weights(self, shapes: str = "arkit") -> Weights:
        """Convert the motion to weights of blendshapes: see :func:`fapengine.weights`."""
        from fapengine.app.motion import weights

        return weights(self.track, shapes)

    def visemes(self, shapes: str = "mpeg4") -> list[tuple[str, float, float]]:
        """List the visemes with their times: see :func:`fapengine.visemes`."""
        return visemes(self, shapes)

    @checked
    def save(
        self,
        path: str | Path,
        *,
        head: str | Path | FaceMesh = "default",
        drawing: RenderOptions | None = None,
        size: tuple[int, int] | None = None,
        at_s: float | None = None,
        shapes: str | None = None,
        kbit_s: float | None = None,
        encoding: EncoderOptions | None = None,
        into: str | Path | Into | None = None,
        provenance: bool = True,
        on_frame: Callable[[], None] = lambda: None,
    ) -> Path:
        """Save it with its sound, in the format that the file name asks for: see :func:`fapengine.save`.

        Mouth shapes (``shapes="rhubarb"``) come from the phones, which say more than the motion.
        """
        options = SaveOptions.of(
            sound=self.sound, phones=self.phones, head=head, drawing=drawing, size=size, at_s=at_s, shapes=shapes,
            kbit_s=kbit_s, encoding=encoding, into=into, provenance=provenance, on_frame=on_frame,
        )  # fmt: skip
        write_output(self.track, Path(path), options)
        return Path(path)


def _as_long_as_spoken(sound: Sound | None, phones: PhoneTrack) -> Sound | None:
    """Append silence to a sound that ends before its phones do."""
    spoken_s = spoken_end_s(phones)
    if sound is None or len(sound[0]) / sound[1] >= spoken_s - SHORT_S:
        return sound
    samples, rate_hz = sound
    lacking = round(spoken_s * rate_hz) - len(samples)
    return np.concatenate([samples, np.zeros(lacking, samples.dtype)]), rate_hz


def perform(
    phones: PhoneTrack,
    sound: Sound | None,
    manner: Manner,
    *,
    text: str = "",
    remarks: tuple[str, ...] = (),
    marks: tuple[TimedMark, ...] = (),
) -> Performance:
    """Plan the motion of a face that speaks these phones.

    Raises UsageError for an invalid profile, expression or rate.
    """
    profile = manner.profile if isinstance(manner.profile, Profile) else load_profile(manner.profile)
    doubts = (*remarks_on(phones), *sound_remarks(sound, phones))
    sound = _as_long_as_spoken(sound, phones)
    commands = commands_of(marks)
    moods = [
        Mood(command.expression, command.level, at_s, at_s + command.attack_s + command.hold_s + command.release_s)
        for at_s, command in commands
        if isinstance(command, Express)
    ]
    planned = plan(
        phones,
        profile,
        rng=np.random.default_rng(manner.seed),
        rate_hz=manner.rate_hz,
        expressions=[*moods_of(manner.expressions, phones), *moods],
        style=manner.style,
        duration_s=len(sound[0]) / sound[1] if sound else None,
        gestures=[
            ramp
            for at_s, command in commands
            if not isinstance(command, Express)
            for ramp in command_ramps(command, at_s)
        ],
    )
    return Performance(
        track=planned.track, phones=phones, sound=sound, text=text, marks=marks,
        remarks=(*remarks, *phones.reading.notes, *doubts),
    )  # fmt: skip


@checked
def visemes(
    source: Performance | PhoneTrack | FapTrack, shapes: str = "mpeg4"
) -> list[tuple[str, float, float]]:  # fmt: skip
    """List visemes with their times.

    Parameters
    ----------
    source : Performance, PhoneTrack or FapTrack
        Phones say more than the motion: for a track, the visemes nearest to its mouth are found.
    shapes : str
        ``"mpeg4"`` (numbers 0 to 14 of the standard's table), ``"oculus"`` (15 names: sil, PP ... ou), ``"azure"`` (ids
        0 to 21) or ``"rhubarb"`` (letters A to H and X).

    Returns
    -------
    list of (str, float, float)
        Name, start and end in s, from 0 to the end without a gap.

    Raises
    ------
    UsageError
        If the set is unknown, or there is nothing.

    Examples
    --------
    >>> from fapengine import Phone
    >>> visemes(PhoneTrack.from_phones([Phone("m", 0.0, 0.1), Phone("a", 0.1, 0.3)]), "oculus")
    [('PP', 0.0, 0.1), ('aa', 0.1, 0.3)]
    """
    if isinstance(source, Performance):
        rows = timed_visemes(source.track, source.phones, shapes, source.sound)
    elif isinstance(source, PhoneTrack):
        rows = timed_visemes(FapTrack.pose(), source, shapes)
    else:
        rows = timed_visemes(source, None, shapes)
    return [(row.name, row.start_s, row.end_s) for row in rows]


def spoken(text: str, voice: str | VoiceChoice | Voice, *, report: Report | None = None) -> Speech:
    """Speak a text between two pauses; the text of the result is what was spoken. Raises as :func:`speak`."""
    ssml = isinstance(voice, VoiceChoice) and voice.ssml
    with (report or Report()).stage("voice"):
        speech = loaded(voice).speak(text).padded(lead_s=LEAD_S, tail_s=TAIL_S)
    shown = speakable(speech.text or read_marks(text, ssml=ssml).text).text
    return replace(speech, text=" ".join(shown.split()) if ssml else shown.strip())


def perform_speech(speech: Speech, manner: Manner) -> Performance:
    """Plan the motion of a face that speaks this. Raises as :func:`perform`."""
    return perform(
        speech.phones, (speech.samples, speech.sample_rate_hz), manner, text=speech.text, remarks=speech.remarks,
        marks=speech.marks,
    )  # fmt: skip


@checked
def speak(
    text: str,
    *,
    voice: str | VoiceChoice | Voice = "en-us",
    strict: bool = False,
    expressions: Expressions = (),
    style: Style | None = None,
    profile: str | Path | Profile = DEFAULT_PROFILE,
    seed: int = 1,
    rate_hz: float = 30.0,
) -> Performance:
    """Say a text.

    Parameters
    ----------
    text : str
    voice : str or Voice
        Language of espeak-ng (``"en-gb"``, ``"de"``), another voice by name (``"piper:model.onnx"``), or anything with
        ``speak(text)`` that gives sound and phones.
    strict : bool
        True to refuse a text with a remark on anything that looks wrong or was assumed.
    expressions : mapping or sequence
        ``{"joy": 0.4}`` from beginning to end, ``["joy:0.4@1.5-3", "surprise@word"]`` with times or words, or
        :class:`fapengine.Mood` objects. Strengths are 0 to 2.
    style : Style, optional
        Style of speaking, and automatic movement.
    profile : str, Path or Profile
        Speaker profile.
    seed : int
        Random seed of blinks, glances and head motion; the same seed gives the same motion.
    rate_hz : float
        Frame rate, 1 to 240 Hz.

    Returns
    -------
    Performance
        0.3 s of rest, the text, 0.5 s of rest.

    Raises
    ------
    UsageError
        If there is nothing to speak, or a parameter is invalid.
    DataError
        If ``strict`` finds a remark.
    ResourceError
        If the voice is not installed.
    """
    check_expressions(expressions)
    manner = Manner(profile=profile, style=style or Style(), expressions=expressions, seed=seed, rate_hz=rate_hz)
    performance = perform_speech(spoken(text, voice), manner)
    if strict:
        refuse(performance.doubts, "speech")
    return performance


@checked
def animate(
    timings: str | Path | PhoneTrack,
    *,
    sound: str | Path | SoundLike | None = None,
    transcript: str | None = None,
    language: str | None = None,
    channel: int | None = None,
    recognizer: str | Path | None = None,
    trust_transcript: bool = False,
    format: str | None = None,  # noqa: A002  as the option of the command line
    tier: str | None = None,
    alphabet: str | None = None,
    columns: str | None = None,
    strict: bool = False,
    voice: str | VoiceChoice | Voice | None = None,
    expressions: Expressions = (),
    style: Style | None = None,
    profile: str | Path | Profile = DEFAULT_PROFILE,
    seed: int = 1,
    rate_hz: float = 30.0,
) -> Performance:
    """Animate a recording, or phone timings that another tool made.

    Parameters
    ----------
    timings : str, Path or PhoneTrack
        A recording (``.wav``, ``.mp3``, a video ...), whose phones are recognized; a file of phone timings in any
        format that ``fapengine animate`` reads, detected from its content; or the phones themselves.
    sound : str, Path or (array_like, int), optional
        The sound that the timings belong to: a file, or samples and their rate in Hz, as of :func:`fapengine.save`.
    transcript : str, optional
        Transcript of a recording; without it, recognition is less accurate.
    language : str, optional
        Language of the transcript, American English by default; or of timed words, by default the one that the file
        names.
    channel : int, optional
        Channel of the sound, 1 for the first; by default the mean of all.
    recognizer : str or Path, optional
        Speech recognizer without a transcript: ``"small"``, ``"sphinx"``, ``"both"``, or an ONNX model of your own.
    trust_transcript : bool
        True to align all words of the transcript, without a check that they are in the recording.
    format, tier, alphabet, columns : str, optional
        How a file of timings is read: see :func:`fapengine.files.timings.load_timings`.
    strict : bool
        True to refuse timings with a remark on anything that looks wrong or was assumed.
    voice : str or Voice, optional
        Pronounces timings that have words only; by default the voice of the language.
    expressions, style, profile, seed, rate_hz
        As of :func:`speak`.

    Raises
    ------
    UsageError
        If a file cannot be read, or a parameter is invalid.
    DataError
        If a file's content is wrong, the transcript is that of another recording, or ``strict`` finds a remark.
    ResourceError
        If a recognizer is needed and not installed.
    """
    from fapengine.app.hearing import Recognition  # with recordings, which a text does not need

    check_expressions(expressions)
    manner = Manner(profile=profile, style=style or Style(), expressions=expressions, seed=seed, rate_hz=rate_hz)
    return animated(
        timings if isinstance(timings, PhoneTrack) else Path(timings),
        Path(sound) if isinstance(sound, str | Path) else sound,
        manner,
        Recognition(
            transcript=transcript, language=language, channel=channel, trust_transcript=trust_transcript,
            recognizer=Path(recognizer) if recognizer is not None else None,
        ),
        voice=voice, strict=strict,
        how={"format": format, "tier": tier, "alphabet": alphabet, "columns": columns},
    )  # fmt: skip


def animated(
    source: Path | PhoneTrack,
    sound: Path | SoundLike | None,
    manner: Manner,
    recognition: Recognition,
    *,
    voice: str | VoiceChoice | Voice | None = None,
    how: Mapping[str, str | None] | None = None,
    strict: bool = False,
    report: Report | None = None,
    hears: Callable[..., Hearing] | None = None,
) -> Performance:
    """Animate a recording or timings, as :func:`animate` does, with its errors.

    ``how`` has the options of :func:`fapengine.files.timings.load_timings`; ``hears`` takes the place of
    :func:`fapengine.app.hearing.hear`, to show its progress.
    """
    from fapengine.app.hearing import hear, is_sound, with_loudness
    from fapengine.files.sound import load_sound

    report, how = report or Report(), how or {}
    language, channel = recognition.language, recognition.channel
    listens = not isinstance(source, PhoneTrack) and is_sound(source)
    of_timings = {"sound": sound, "voice": voice, **how}
    of_sound = {
        "recognizer": recognition.recognizer, "transcript": recognition.transcript,
        "trust_transcript": recognition.trust_transcript or None,
    }  # fmt: skip
    for name, value in (of_timings if listens else of_sound).items():
        if value is not None:
            raise UsageError(f"{name}: cannot be used with {'a recording' if listens else 'phone timings'}")
    played: Sound | None = None
    of_file: list[str] = []
    """Remarks on the file of the sound."""
    if listens:
        assert isinstance(source, Path)
        with report.stage("listen"):
            heard = (hears or hear)(source, recognition)
        with report.stage("read"):
            played = load_sound(source, channel=channel, remark=of_file.append)
        notes = tuple(note for note in heard.notes if note not in of_file)
        phones = replace(heard.phones, reading=replace(heard.phones.reading, notes=notes))
    else:
        with report.stage("read"):
            if isinstance(source, PhoneTrack):
                if given := [name for name, value in how.items() if value is not None]:
                    raise UsageError(f"{given[0]}: got {how[given[0]]!r}, but phones are no file that is read")
                phones = pronounced(source, voice, language=language)
            else:
                phones = read_timings(source, voice, language=language, **how)
            if channel is not None and not isinstance(sound, Path):
                raise UsageError(f"channel: got {channel}, which only a file has; give the samples of that channel")
            if isinstance(sound, Path):
                played = load_sound(sound, channel=channel, spoken_s=phones.duration_s, remark=of_file.append)
            elif sound is not None:
                played = as_sound(sound)
            phones = with_loudness(phones, *played) if played else phones
    with report.stage("plan"):
        performance = perform(phones, played, manner, text=recognition.transcript or "", remarks=tuple(of_file))
    if strict:
        refuse(performance.doubts, "timings" if isinstance(source, PhoneTrack) else str(source))
    return performance


def read_timings(
    path: Path, voice: str | VoiceChoice | Voice | None = None, *, language: str | None = None, **how: str | None
) -> PhoneTrack:
    """Read phones from a file of timings, with words pronounced.

    Parameters and errors are those of :func:`fapengine.files.timings.load_timings` and :func:`pronounced`.
    """
    from fapengine.files.timings import load_timings  # all formats; whoever speaks a text needs none

    phones = load_timings(path, **how)
    with naming(path):
        return pronounced(phones, voice, language=language)


def pronounced(
    phones: PhoneTrack, voice: str | VoiceChoice | Voice | None = None, *, language: str | None = None
) -> PhoneTrack:
    """Pronounce a track of words within their times; a track of phones is returned unchanged.

    Raises DataError if the voice was not chosen by the user, and it does not read the script of the words; UsageError
    if there is no voice for ``language``.

    Parameters
    ----------
    phones : PhoneTrack
    voice : str, VoiceChoice or Voice, optional
        By default that of ``language``, else of the language that the file names, else American English.
    language : str, optional
        Language of the words, a code or an English name.
    """
    if not phones.spelled:
        return phones
    from fapengine.voices.espeak import EspeakVoice, catalogue
    from fapengine.voices.pronounce import pronounce

    named, said, remarks = phones.reading.language, "", phones.reading.remarks
    is_chosen = voice is not None or language is not None
    if voice is None and language is not None:
        voice = language_voice(language)
    elif voice is None:
        voice = catalogue().of_language(named) if named else None
        if named and voice is None:
            remarks += (f"words: no voice speaks {named!r}, the language of the file; read in {DEFAULT_VOICE};"
                        " voice=CODE reads them in another",)  # fmt: skip
        elif voice is not None:
            said = f"words read in {voice} (from the file); voice=CODE reads them in another"
        else:
            said = f"words read in {DEFAULT_VOICE}: the file names no language; voice=CODE reads them in another"
        voice = voice or DEFAULT_VOICE
    speaker = loaded(voice)
    if isinstance(speaker, EspeakVoice):
        words = [phone for phone in phones.phones if not phone.is_silence]
        remarks += script_remarks(words, speaker.entry.code, is_chosen=is_chosen)
    track = pronounce(phones, speaker)
    return replace(track, reading=replace(track.reading, notes=(said,) if said else (), remarks=remarks))
