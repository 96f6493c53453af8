"""Options that several verbs share, declared once."""

from pathlib import Path
from typing import Annotated

import typer

Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        help="Video (.mp4, .webm, .mkv), animation (.gif, .webp), numbered pictures (frame_%04d.png, or a folder), or"
        " .fap for the FAPs alone.",
    ),
]
Expressions = Annotated[
    list[str],
    typer.Option(
        "--expression",
        "-e",
        help="joy, sadness, anger, fear, disgust or surprise, with a strength, and when: joy:0.4, joy:0.4@1.5-3 (s),"
        " joy:0.4@word.",
    ),
]
ProfileName = Annotated[str, typer.Option("--profile", help="Whose way of speaking: a shipped name or a folder.")]
HeadName = Annotated[
    str,
    typer.Option(
        "--head", help="Whose face: default, default:hair_colour=red,age=0.8, or a folder of `fapengine head import`."
    ),
]
CameraName = Annotated[
    str,
    typer.Option(
        "--camera",
        help="front, close, three-quarter, profile, mouth, eyes, low, high; three-quarter-right, profile-right; or"
        " YAW,PITCH in degrees.",
    ),
]
BackgroundName = Annotated[
    str,
    typer.Option(
        "--background",
        "-b",
        help="studio, a colour (#f0e8d8), a picture's file, or none for alpha (.webm, .webp, .png).",
    ),
]
Edges = Annotated[
    str,
    typer.Option("--edges", help="fine (several samples a pixel), or soft: in half the time, but hairs are dotted."),
]
Size = Annotated[str, typer.Option("--size", help="Width x height in pixels.")]
Fps = Annotated[float, typer.Option("--fps", help="Frames a second.")]
Articulation = Annotated[float, typer.Option("--articulation", help="Size of mouth movements; 1 is natural.")]
Jaw = Annotated[float, typer.Option("--jaw", help="Size of the jaw's part in them, 0 to 3.")]
Lips = Annotated[
    float, typer.Option("--lips", help="Size of the lips' part, 0 to 3: below 1 mumbles, above exaggerates.")
]
Loudness = Annotated[float, typer.Option("--loudness", help="dB against the recorded speaker; louder opens the jaw.")]
Method = Annotated[str, typer.Option("--method", help="context, paper, minimum-jerk or dominance.")]
Without = Annotated[
    list[str],
    typer.Option("--without", help="What shall not move by itself: blinks, head-motion, gaze, idle, emphasis, or all."),
]
Seed = Annotated[
    int, typer.Option("--seed", help="Chance of blinks, glances and head motion; the same seed, the same face.")
]
Strict = Annotated[bool, typer.Option("--strict", help="An unknown phone is an error, not a neutral vowel.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print the result as JSON.")]
Device = Annotated[
    str | None, typer.Option("--device", help="Where live sound goes out: a number, or a part of a device's name.")
]
Silent = Annotated[bool, typer.Option("--silent", help="Play no sound; the face keeps time by the clock.")]
Sinks = Annotated[
    list[str],
    typer.Option("--sink", help="Where live frames go too, such as vmc://127.0.0.1, vrchat://HOST, osc://HOST:PORT."),
]
