"""The test matrix: ``make matrix``, or one session of it, such as ``nox -s tests-3.12 -- tests/unit/codec``.

The Pythons are those of the classifiers in ``pyproject.toml``. One that is not on the path is skipped with a warning;
where the variable ``CI`` is set, it is an error. With pyenv, ``pyenv local 3.11 3.12 3.13`` puts them there.
"""

import nox

nox.needs_version = ">=2025.2.9"
PROJECT = nox.project.load_toml("pyproject.toml")
PYTHONS = nox.project.python_versions(PROJECT)


@nox.session(python=PYTHONS)
def tests(session: nox.Session) -> None:
    """Unit tests, laws and doctests, or what is named behind ``--``."""
    session.install(
        "--quiet",
        "--editable",
        ".[voice,video,batch,recognizer,recognizer-onnx,fast,lab,live,usd,webrtc,window]",
        "./native",
    )
    session.install("--quiet", *nox.project.dependency_groups(PROJECT, "dev"))
    session.run("pytest", "-q", "-n", "2", *(session.posargs or ("tests/unit", "tests/properties", "fapengine")))


@nox.session(venv_backend="none")
def lint(session: nox.Session) -> None:
    """Format, lint, types and floors: what ``make check`` does, in its environment."""
    session.run("make", "check", external=True)


@nox.session
def wheel(session: nox.Session) -> None:
    """Build, check and install the distribution: what ``make release-check`` does."""
    session.install("--quiet", *nox.project.dependency_groups(PROJECT, "tools"))
    session.run(".ci/release-check", "python", external=True)
