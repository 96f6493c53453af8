"""A capture session to a profile and its report: read, learn, write."""

import ctypes
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

import fapengine
from fapengine._strict_toml import checked
from fapengine.app.performance import pronounced
from fapengine.errors import DataError, ResourceError, UsageError
from fapengine.files.heads.built import load_built
from fapengine.files.heads.dense import ADAPTED
from fapengine.files.heads.folder import OWNED as HEAD_FILES
from fapengine.files.heads.folder import save_head
from fapengine.files.motion import save_fap
from fapengine.files.paths import replacing_folder
from fapengine.files.pictures import format_png
from fapengine.files.profiles import PROFILE_FILES, load_profile, put_profile
from fapengine.files.sessions import LoadedSession, load_session
from fapengine.laboratory.dense_file import ARRAYS_NAME as DENSE_ARRAYS
from fapengine.laboratory.dense_file import TOML_NAME as DENSE_TOML
from fapengine.laboratory.dense_file import format_dense
from fapengine.laboratory.densify import MIN_SCANS
from fapengine.laboratory.fit import STEPS, FitOptions, Fitted, fit_session
from fapengine.laboratory.prepare import prepare
from fapengine.laboratory.space import captured_faps
from fapengine.laboratory.tables import tables_of, weights_of_takes
from fapengine.mesh.default_head.style import MEASURED
from fapengine.mesh.face_mesh import FaceMesh
from fapengine.models.adapted_head import Nearness
from fapengine.profiles import TOML_NAME, Record
from fapengine.speaking import DEFAULT_PROFILE

DENSE_FILES = (DENSE_TOML, DENSE_ARRAYS)
REPORT_NAME = "report.html"
OWNED = (
    *PROFILE_FILES, REPORT_NAME, *DENSE_FILES, "takes/*.fap", "tables/*.csv", "weights/*.csv",
    *(f"{ADAPTED}/{name}" for name in HEAD_FILES),
)  # fmt: skip
"""Files of a fitted profile's folder."""
STANDARD = DEFAULT_PROFILE
"""Profile that supplies the expressions missing in a session."""


def run_fit(
    session: Path,
    output: Path,
    options: FitOptions,
    *,
    units: str | None = None,
    up: str | None = None,
    seed: int = 1,
    voice: str | None = None,
    report: bool = True,
    faps: bool = False,
    adapt: bool = False,
    on_take: Callable[[str, int], None] = lambda name, count: None,
    on_step: Callable[[str], None] = lambda step: None,
) -> tuple[Fitted, Nearness | None]:
    """Learn from a folder of recordings and write the profile; also return how far an adapted head is from the scans.

    ``units`` (mm, cm, m or inch) and ``up`` concern recordings that do not state them; ``seed`` splits the takes;
    ``voice`` pronounces words where phones are missing; ``faps`` writes every take as captured FAPs; ``adapt`` fits the
    built-in head, which FAPs move, to the dense face. ``on_take`` is called with the name of each take that is read and
    the count of all, ``on_step`` with each of :data:`fapengine.laboratory.fit.STEPS`.
    """
    check_folder(output)
    if report:  # without its library, the user learns it before minutes of work
        from fapengine.files.report.parts import figure_class

        figure_class()
    sessions = [
        load_session(session, units=units, up=up, on_take=on_take, pronounce=lambda track: pronounced(track, voice))
    ]
    command = _command(session, output, options, seed, units=units, up=up, voice=voice)
    fitted = _fit(sessions, output.name, command, options, seed, on_step)
    adapted = _adapt(fitted, session) if adapt else None
    _write(output, fitted, adapted, report=report, faps=faps)
    return fitted, None if adapted is None else adapted[1]


@checked
def fit(session: LoadedSession, *, name: str = "profile", options: FitOptions | None = None, seed: int = 1) -> Fitted:
    """Learn a face model from a session: marker subset, viseme space, phones, dense face.

    Parameters
    ----------
    session : LoadedSession
        From :func:`fapengine.lab.read`, or made of arrays: ``LoadedSession(Session("S03", takes), Setup(head=(...)))``.
    name : str
        Name of the profile.
    options : FitOptions, optional
        Number of components, size of the marker subset, fraction of takes that is held out.
    seed : int
        Splits the takes, hides entries, draws random subsets; the same seed gives the same result.

    Returns
    -------
    Fitted
        ``profile`` speaks like any other; ``space.space.modes_mm`` is (K, P, 3) mm; :func:`fapengine.lab.tables_of`
        makes the tables, :func:`fapengine.lab.weights_of_takes` the weights of each take.

    Raises
    ------
    DataError
        If the recordings do not suffice; the message says what is missing.
    UsageError
        If an option is out of range.
    """
    return _fit([session], name, f"fapengine.lab.fit(..., seed={seed})", options or FitOptions(), seed)


def _fit(
    sessions: list[LoadedSession],
    name: str,
    command: str,
    options: FitOptions,
    seed: int,
    on_step: Callable[[str], None] = lambda step: None,
) -> Fitted:
    """Learn from the one session, which is taken out of its list, so that its recordings are freed early."""
    loaded, rng, head = sessions.pop(), np.random.default_rng(seed), load_built(MEASURED)
    setup, warnings, inputs = loaded.setup, loaded.warnings, dict(loaded.inputs)
    face_mm = {name: np.asarray(head.point_mm(name), np.float64) for name in head.feature_points}
    on_step(STEPS[0])
    prepared = prepare(loaded.session, setup, face_mm, rng=rng)
    del loaded
    _return_memory()
    origin = {"source": f"session {prepared.subject}", "command": command}
    if setup.attribution:
        origin["attribution"] = setup.attribution
    fitted = fit_session(
        prepared,
        setup,
        profile_id=name,
        origin=origin,
        standard=load_profile(STANDARD),
        face_fapu=head.fapu,
        options=options,
        rng=rng,
        on_step=on_step,
        warnings=warnings,
    )
    record = Record(version=fapengine.__version__, seed=seed, held_out=fitted.held_out, inputs=inputs)
    return replace(fitted, profile=replace(fitted.profile, record=record))


def _return_memory() -> None:
    """Return the memory of the recordings to the system now: glibc would keep it."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)


def check_folder(output: Path) -> None:
    """Refuse to replace anything but a profile. Raises UsageError."""
    if output.exists() and not (output / TOML_NAME).is_file() and (not output.is_dir() or any(output.iterdir())):
        raise UsageError(f"{output}: is not a profile; expected a new folder, or that of a profile")


def _command(session: Path, output: Path, options: FitOptions, seed: int, **others: str | None) -> str:
    """Spell the command that makes the same profile."""
    usual = FitOptions()
    values = {
        "modes": (options.modes, usual.modes), "subset": (options.k, usual.k),
        "tolerance": (options.tolerance_mm, usual.tolerance_mm), "held-out": (options.held_out, usual.held_out),
        **{name: (value, None) for name, value in others.items()},
    }  # fmt: skip
    changed = "".join(f" --{name} {value}" for name, (value, default) in values.items() if value != default)
    return f"fapengine fit {session.resolve().name} -o {output.name} --seed {seed}{changed}"


def _adapt(fitted: Fitted, session: Path) -> tuple[FaceMesh, Nearness]:
    """Fit the built-in head to the dense face."""
    from fapengine.files.heads.import_file import adapt_dense_face  # much of scipy

    if fitted.dense is None:
        raise DataError(
            f"adapt: the session has no dense face; it needs {MIN_SCANS} [[scan]] or more", where=str(session)
        )
    imported, nearness = adapt_dense_face(fitted.dense.face)
    return imported.mesh, nearness


def _write(
    output: Path, fitted: Fitted, adapted: tuple[FaceMesh, Nearness] | None, *, report: bool, faps: bool
) -> None:
    page = None
    if report:
        from fapengine.files.report.page import write_report

        page = write_report(fitted, _faces(fitted, None if adapted is None else adapted[0]))
    with replacing_folder(output, owned=OWNED) as folder:
        put_profile(folder, fitted.profile)
        if page is not None:
            (folder / REPORT_NAME).write_bytes(page)
        for kind, tables in (("tables", tables_of(fitted)), ("weights", weights_of_takes(fitted))):
            (folder / kind).mkdir()
            for name, table in tables.items():
                (folder / kind / f"{name}.csv").write_bytes(table.to_csv())
        if fitted.dense is not None:
            for name, data in format_dense(fitted.dense.face).items():
                (folder / name).write_bytes(data)
        if fitted.dense is not None and adapted is not None:
            from fapengine.files.heads.import_file import adapted_info

            save_head(folder / ADAPTED, adapted[0], adapted_info(fitted.dense.face))
        if faps:
            for take in fitted.prepared.takes:
                save_fap(folder / "takes" / f"{take.name}.fap", captured_faps(take, fitted.prepared, fitted.profile))


def _faces(fitted: Fitted, adapted: FaceMesh | None) -> dict[str, bytes] | str:
    from fapengine.app.fit_faces import draw_faces

    try:
        return {caption: format_png(picture) for caption, picture in draw_faces(fitted, adapted).items()}
    except ResourceError as error:  # no renderer on this machine
        return str(error)


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
        "lips_mm": None if prediction is None else round(prediction.whole.lips_mm.value, 3),
        "lips_interval_mm": None
        if prediction is None or len(prediction.by_take) < 2
        else [round(prediction.whole.lips_mm.low, 3), round(prediction.whole.lips_mm.high, 3)],
        "opening_r": None if prediction is None else round(prediction.whole.opening_r.value, 3),
        "dense_left_out_mm": None if fitted.dense is None else round(fitted.dense.face.left_out_mm[0], 3),
        "adapted": None if nearness is None else asdict(nearness),
        "warnings": list(fitted.warnings),
    }
