"""A capture session to a profile and its report: read, learn, write."""

import ctypes
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from fapengine.app.performance import pronounced
from fapengine.errors import DataError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.dense import ADAPTED
from fapengine.files.heads.folder import OWNED as HEAD_FILES
from fapengine.files.heads.folder import save_head
from fapengine.files.motion import save_fap
from fapengine.files.paths import replacing_folder
from fapengine.files.profiles import PROFILE_FILES, load_profile, put_profile
from fapengine.files.sessions import load_session
from fapengine.laboratory.dense_file import ARRAYS_NAME as DENSE_ARRAYS
from fapengine.laboratory.dense_file import TOML_NAME as DENSE_TOML
from fapengine.laboratory.dense_file import format_dense
from fapengine.laboratory.densify import MIN_SCANS
from fapengine.laboratory.fit import STEPS, FitOptions, Fitted, fit_session
from fapengine.laboratory.prepare import Prepared, prepare
from fapengine.laboratory.setup import Setup
from fapengine.laboratory.space import captured_faps
from fapengine.mesh.default_head.style import HeadStyle
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.models.adapted_head import Nearness
from fapengine.profiles import TOML_NAME
from fapengine.speaking import DEFAULT_PROFILE

DENSE_FILES = (DENSE_TOML, DENSE_ARRAYS)
REPORT_NAME = "report.html"
OWNED = (*PROFILE_FILES, REPORT_NAME, *DENSE_FILES, "takes/*.fap", *(f"{ADAPTED}/{name}" for name in HEAD_FILES))
"""Files of a fitted profile's folder."""
STANDARD = DEFAULT_PROFILE
"""Profile that supplies the expressions missing in a session."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitJob:
    """Input, output and options of a fit."""

    session: Path
    """Folder of recordings."""
    output: Path
    """Folder of the profile."""
    options: FitOptions = FitOptions()  # noqa: RUF009  frozen
    units: str | None = None
    """mm, cm, m or inch, for recordings without units."""
    up: str | None = None
    """Axis that points up."""
    seed: int = 1
    """Random seed of the split into training and held-out takes."""
    voice: str | None = None
    """Voice that pronounces words where phones are missing."""
    report: bool = True
    """True to write report.html."""
    faps: bool = False
    """True to write every take as captured FAPs."""
    adapt: bool = False
    """True to fit the built-in head, which FAPs move, to the dense face: ``head/``."""


def run_fit(
    job: FitJob,
    *,
    on_take: Callable[[str, int], None] = lambda name, count: None,
    on_step: Callable[[str], None] = lambda step: None,
) -> tuple[Fitted, Nearness | None]:
    """Learn from a session and write the profile; also return the distance of an adapted head from the dense face.

    Parameters
    ----------
    on_take : callable
        Called with the name of each take that is read, and the count of all.
    on_step : callable
        Called with the name of each step of :data:`fapengine.laboratory.fit.STEPS`.
    """
    output = job.output
    check_folder(output)
    rng = np.random.default_rng(job.seed)
    prepared, setup, warnings = _read(job, rng, on_take, on_step)
    _return_memory()
    origin = {"source": f"session {prepared.subject}", "command": _command(job.session, output, job.seed)}
    if setup.attribution:
        origin["attribution"] = setup.attribution
    fitted = fit_session(
        prepared,
        setup,
        profile_id=output.name,
        origin=origin,
        standard=load_profile(STANDARD),
        face_fapu=load_built(HeadStyle()).fapu,
        options=job.options,
        rng=rng,
        on_step=on_step,
        warnings=warnings,
    )
    adapted = _adapt(fitted, job) if job.adapt else None
    _write(output, fitted, adapted, report=job.report, faps=job.faps)
    return fitted, None if adapted is None else adapted[1]


def _read(
    job: FitJob, rng: np.random.Generator, on_take: Callable[[str, int], None], on_step: Callable[[str], None]
) -> tuple[Prepared, Setup, tuple[str, ...]]:
    """Read and prepare; the recordings themselves are freed at the end."""
    head = load_built(HeadStyle())
    face_mm = {name: np.asarray(head.point_mm(name), np.float64) for name in head.feature_points}
    loaded = load_session(
        job.session, units=job.units, up=job.up, on_take=on_take, pronounce=lambda track: pronounced(track, job.voice)
    )
    on_step(STEPS[0])
    return prepare(loaded.session, loaded.setup, face_mm, rng=rng), loaded.setup, loaded.warnings


def _return_memory() -> None:
    """Return the memory of the recordings to the system now: glibc would keep it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def check_folder(output: Path) -> None:
    """Refuse to replace anything but a profile. Raises UsageError."""
    if output.exists() and not (output / TOML_NAME).is_file() and (not output.is_dir() or any(output.iterdir())):
        raise UsageError(f"{output}: is not a profile; expected a new folder, or that of a profile")


def _command(session: Path, output: Path, seed: int) -> str:
    return f"fapengine fit {session.resolve().name} -o {output.name} --seed {seed}"


def _adapt(fitted: Fitted, job: FitJob) -> tuple[FaceMesh, Nearness]:
    """Fit the built-in head to the dense face."""
    from fapengine.files.heads.import_file import adapt_dense_face  # much of scipy

    if fitted.dense is None:
        raise DataError(
            f"adapt: the session has no dense face; it needs {MIN_SCANS} [[scan]] or more", where=str(job.session)
        )
    imported, nearness = adapt_dense_face(fitted.dense.face)
    return imported.mesh, nearness


def _write(
    output: Path, fitted: Fitted, adapted: tuple[FaceMesh, Nearness] | None, *, report: bool, faps: bool
) -> None:
    page = None
    if report:  # before anything is written: its library may be missing
        from fapengine.files.report.page import write_report

        page = write_report(fitted)
    with replacing_folder(output, owned=OWNED) as folder:
        put_profile(folder, fitted.profile)
        if page is not None:
            (folder / REPORT_NAME).write_bytes(page)
        if fitted.dense is not None:
            for name, data in format_dense(fitted.dense.face).items():
                (folder / name).write_bytes(data)
        if fitted.dense is not None and adapted is not None:
            from fapengine.files.heads.import_file import adapted_info

            save_head(folder / ADAPTED, adapted[0], adapted_info(fitted.dense.face))
        if faps:
            for take in fitted.prepared.takes:
                save_fap(folder / "takes" / f"{take.name}.fap", captured_faps(take, fitted.prepared, fitted.profile))


def describe(fitted: Fitted, nearness: Nearness | None = None) -> dict[str, object]:
    """Return the figures of a fit, and of an adapted head, as plain values for JSON."""
    space, selection, prediction = fitted.space, fitted.selection, fitted.prediction
    kept = space.space.mode_count
    return {
        "profile": fitted.profile.id,
        "takes": len(fitted.prepared.takes),
        "held_out_takes": len(fitted.held_out),
        "markers": len(fitted.prepared.labels),
        "modes": kept,
        "variance": round(float(space.share[kept - 1]), 5),
        "marker_error_mm": round(float(space.error_mm[kept - 1]), 4) if len(space.error_mm) else None,
        "subset": None
        if selection is None
        else {
            "k": selection.k,
            "markers": [selection.prepared.labels[index] for index in selection.swapped.primary],
            "error_mm": {name: round(value, 4) for name, value in selection.held_out_mm.items()},
        },
        "phones": {name: study.tokens for name, study in fitted.phones.items()},
        "lips_mm": None if prediction is None else round(prediction.lips_mm, 3),
        "opening_r": None if prediction is None else round(prediction.opening_r, 3),
        "dense_left_out_mm": None if fitted.dense is None else round(fitted.dense.face.left_out_mm[0], 3),
        "adapted": None if nearness is None else asdict(nearness),
        "warnings": list(fitted.warnings),
    }
