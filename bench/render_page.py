"""The part of docs/measurements.md about drawing, and its plot, made from what bench/render measured."""

from math import inf
from pathlib import Path

from bench.render_goals import (
    FILM,
    FINE,
    GOALS_FPS,
    MAX_DEFORMING,
    MIN_PEER_RATIO,
    MIN_PEER_RATIOS,
    NATIVE,
    REFERENCE,
    SOFT,
    STAIRS,
)
from design import measurements

OURS = REFERENCE, NATIVE, STAIRS, SOFT, FINE
PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"


def sections(result: dict) -> list[dict]:
    """Sections of docs/measurements.md."""
    machine, best = result["machine"], result["best_ms"]
    speed = {
        "title": "Drawing",
        "text": (
            f"{machine['renderer']}, {machine['driver']}, {machine['cores']} cores without a GPU. The default head"
            f" ({result['vertices']:,} vertices) at 512 × 512 with antialiasing, all FAPs moving, every frame read"
            f" back. With H.264, a frame takes {best[FILM]:.1f} ms. Deforming costs"
            f" {100 * (result['deforming'] - 1):.0f} % over drawing the same mesh without it (goal: at most"
            f" {100 * (MAX_DEFORMING - 1):.0f} %)."
        ),
        "picture": ["render-cost.svg", "Cost against vertices, FAPs and pixels"],
        "table": [
            ["", "ms a frame", "frames a second", "goal"],
            *(
                [name, f"{best[name]:.1f}", f"{1000 / best[name]:.0f}", f"{goal}: {_met(1000 / best[name] >= goal)}"]
                for name, goal in GOALS_FPS.items()
            ),
        ],
        "commands": ["python -m bench.render --page"],
    }
    peers = {
        "title": "Other renderers",
        "level": 3,
        "text": (
            "The same mesh, 512 × 512, read back; others get moved vertices. CPU time. OpenGL: ours with the same light"
            " and antialiasing; native: fapengine-native, antialiased. *Bare*: not antialiased."
            f" Goal: {MIN_PEER_RATIO:g} (three.js: {MIN_PEER_RATIOS['three.js']:g}), {_verdict(result)}"
        ),
        "table": [
            ["", "ms of all cores", "times OpenGL", "times native"],
            *([f"ours, {name}", f"{result['cpu_ms'][name]:.1f}", "", ""] for name in OURS),
            *(_peer(name, result) for name in result["peers"]),
        ],
        "commands": ["python -m bench.render --page --peers PYTHON"],
    }
    return [speed, peers]


def write_page(result: dict) -> None:
    """Write the section of docs/measurements.md about drawing, and docs/pictures/render-cost.svg."""
    measurements.write_sections("drawing", sections(result))
    measurements.PAGE.write_text(measurements.page(), encoding="utf-8")
    plot(result, PICTURES / "render-cost.svg")


def _verdict(result: dict) -> str:
    beyond = [name for name, peer in result["peers"].items() if peer["alike"] >= (_goal(name) or inf)]
    quicker = [name for name, peer in result["peers"].items() if peer["alike"] < 1]
    return (
        f"met against {'; '.join(beyond) or 'none'}."
        f"{' Cheaper than ours: ' + '; '.join(quicker) + '.' if quicker else ''}"
        f"{' Absent: ' + '; '.join(result['absent']) + '.' if result['absent'] else ''}"
    )


def _goal(name: str) -> float | None:
    return MIN_PEER_RATIOS.get(name, MIN_PEER_RATIO)


def _met(met: bool) -> str:
    return "met" if met else "missed"


def _peer(name: str, result: dict) -> list[str]:
    cpu_ms, alike = result["cpu_ms"], result["peers"][name]["alike"]
    return [name, f"{cpu_ms[name]:.1f}", f"{alike:.1f}", f"{cpu_ms[name] / cpu_ms[NATIVE]:.1f}"]


def plot(result: dict, path: Path) -> None:
    """Milliseconds a frame against vertices, FAPs and pixels; the default head is the same point in each."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    labels = {
        "vertices": "vertices, thousands (512 x 512)",
        "faps": "FAPs that the mesh knows (512 x 512)",
        "pixels": "pixels, millions (default head)",
    }
    scale = {"vertices": 1e3, "faps": 1.0, "pixels": 1e6}
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    for axes, (kind, label) in zip(figure.subplots(1, 3), labels.items(), strict=True):
        rows = [(value / scale[kind], ms) for value, ms in result["growth"][kind]]
        axes.plot(*zip(*rows, strict=True), "o-", color="#2f6aa8", markersize=4)
        own = [row for row in rows if row[1] == result["best_ms"][REFERENCE]]
        axes.plot(*own[0], "o", color="#c8543c", markersize=8, label="default head")
        axes.axhline(1000 / 60, color="#a9adb4", linestyle="--", linewidth=1, label="60 frames a second")
        axes.set(xlabel=label, ylabel="ms a frame", xlim=(0, None), ylim=(0, None))
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.3)
    axes.legend(loc="upper left", fontsize=8)
    with mpl.rc_context({"svg.hashsalt": "fapengine", "font.size": 9}):
        figure.savefig(path, metadata={"Date": None})
