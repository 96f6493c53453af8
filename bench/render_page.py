"""The page docs/render-speed.md and its plot, made from what bench/render measured."""

# ruff: noqa: E501  a row of a table is one line

from pathlib import Path

from bench.render_goals import (
    BROWSER_PEERS,
    FILM,
    FINE,
    GOALS_FPS,
    MAX_DEFORMING,
    MIN_PEER_RATIO,
    MIN_PEER_RATIOS,
    PEERS,
    REFERENCE,
    SOFT,
    STAIRS,
)

DOCS = Path(__file__).resolve().parent.parent / "docs"

PAGE = """<!-- Made by python -m bench.render --page; do not edit: the words are in bench/render_page.py. -->
# How fast drawing is

Measured with {renderer}, {driver},
on {cores} cores of a shared machine without a GPU, in one run of {rounds} interleaved rounds: every case draws a little
in each round, with the default head before and after it, so that a neighbour on the same cores slows both sides of a
ratio (load average {load[0]:.1f} before and {load[1]:.1f} after; 1 to 2 of it is the run itself). The head has
{vertices:,} vertices and {triangles:,} triangles and is painted; a synthetic talking face moves all FAPs; shading is
full, edges are softened, every frame is read back into an array. Frames a second are of a case's best round, ratios are
medians over the rounds, with the middle half of the rounds in brackets.

## Against the goals

| | ms a frame | frames a second | goal | | ms of all cores |
|---|---|---|---|---|---|
{goals}

The default head is drawn as `say` and `render` do it. {film}

Deforming costs {deforming:.0f} % over drawing the same mesh undeformed, all else equal (goal: at most {ceiling:.0f} %).

The head comes in five levels of detail; these two are its level `fine` with its longest edges halved until there are so
many vertices (`bench/finer.py`).

## What things cost

| | of a frame |
|---|---|
{parts}

A painting costs a reading of it for every pixel that is shaded, and on llvmpipe small triangles shade many a pixel
several times. When light is worked out at vertices is said in [render.md](render.md).

## What a frame's cost grows with

![Cost against vertices, FAPs and pixels](pictures/render-cost.svg)

Pixels cost most; a frame of 128 x 128 is nearly all vertices, a quarter to a third of one of 512 x 512. FAPs cost
nearly nothing, because each vertex knows the few FAPs that move it; in that plot the mesh knows only so many of them.

## Against other renderers

The same mesh, 512 x 512, read back. A peer gets the moved vertices and turned normals ready-made, so it does not
deform, and is coloured at vertices; ours deforms and is painted. *Bare* is without anti-aliasing; PyVista and pygfx have a softening pass (FXAA) like ours, and
pyrender always multisamples. three.js draws in headless Chromium on the same Mesa, with its standard material and its
multisampling; *bare* with Phong and stairs; *morphs* deforms by itself, each channel a morph target. *Our page* is the
page of `fapengine serve` in that browser. Their lights are one to four lamps, ours three with wrapped diffuse and two
highlights. Milliseconds of all cores count every process of a peer: what a frame costs, where the clock also tells how
many cores were free. *Alike* is that time against our head's at the same quality: light at every pixel, as all of them have
it, and stairs, softened edges or four samples a pixel as theirs. Goals are judged by it.

| | ms a frame | ms of all cores | times ours | alike | goal |
|---|---|---|---|---|---|
{own}
{peers}

{verdict} {faster}

Peers are installed into an interpreter of their own: `pip install --group peers`, then
`python -m bench.render --peers PYTHON`. pygfx needs Vulkan, on Debian the package `mesa-vulkan-drivers`: over OpenGL wgpu
lacks the feature `float32-filterable` that it asks for.

## What was tried

Each change was measured against the renderer without it, in interleaved rounds at 512 x 512 unless said otherwise. All
but light at vertices leave 30 pictures as they were, to 1 of 255. What was foreseen is written where it was written
down before.

| idea | foreseen | measured | |
|---|---|---|---|
| find edges in one pass, soften in another, on edges alone | -13 %, 720p -25 % | -13 %, 720p -20 % | kept |
| highlights from cosines that are there already, not from half-way vectors | - | -4 % | kept |
| light at vertices, where these stand closer than 12 pixels | -25 % | -28 % of CPU time, -22 % on the clock | kept |
| one level of the painting for a picture, not a choice for every pixel | -8 % | -10 % | kept |
| soften only in two rectangles, round head and shoulders; copy the wall instead of drawing it | -8 % | -6 % of CPU time, -11 % of level `calls` | kept |
| draw the shirt once, with the wall | -7 % | -3 % of CPU time, -4 % of level `calls` | kept |
| find edges from two pixels read and two that are shaded alongside, not from five read | -7 % | -8 %; lids look rougher | left out |
| triangles and vertices in the order that the driver's cache wants: 1.18 instead of 1.45 shadings a vertex | -3 % | not built: 0.4 s to sort | left out |
| leave out what faces away and never moves | -4 % | -2 % | left out |
| brightness from alpha when finding edges | -3 % | 0 | left out |
| a rational logarithm in place of `pow` | -5 % | -2 % | left out |
| triangles in clusters that suit the driver's vertex cache | -5 % | +3 % | left out |
| near triangles first, the mouth's inside last | -3 % | 0 | left out |
| read the frame before the last, so that vertices overlap with pixels | -20 % | 0: the driver waits | left out |
| read back four components instead of three | - | 0 | left out |
| textures read with a filter instead of fetched | - | 0, 720p +12 % | left out |
| fill and soften only the bands of rows that the head can reach, in this frame or the one before | -12 % | +5 %; -4 % if the bands cost nothing: they are 65 % of the picture | left out |
| leave out the inside of the mouth while the lips are shut | -2 % | -6 % of such frames, but these are 12 % of a text's: -0.7 % | left out |
| leave out what faces away from a front camera, or lies behind the ears | -7 % | 0 to +2 %, processor time | left out |
| hand four components to the film's conversion to YUV | -1 % | 0.65 instead of 0.9 ms, less what four cost before it | left out |
"""


def _part(what: str, found: dict[str, float]) -> str:
    low, middle, high = (100 * (found[key] - 1) for key in ("low", "ratio", "high"))
    return f"| {what} | {middle:+.0f} % ({low:+.0f} to {high:+.0f}) |"


def write_page(result: dict) -> None:
    """Write docs/render-speed.md and docs/pictures/render-cost.svg."""
    best = result["best_ms"]
    goals = [
        f"| {name} | {best[name]:.1f} | {1000 / best[name]:.0f} | {goal} | {_met(1000 / best[name] >= goal)} |"
        f" {result['cpu_ms'][name]:.1f} |"
        for name, goal in GOALS_FPS.items()
    ]
    peers = [_peer(name, result) for name in PEERS + BROWSER_PEERS]
    short = [
        name
        for name, peer in result["peers"].items()
        if peer["alike"] < (MIN_PEER_RATIOS.get(name, MIN_PEER_RATIO) or 0)
    ]
    quicker = [name for name, peer in result["peers"].items() if peer["alike"] < 1]
    faster = f"Cheaper than ours, alike: {'; '.join(quicker)}." if quicker else "None is cheaper than ours, alike."
    verdict = f"The goal is missed against {'; '.join(short)}." if short else "The goal is met."
    text = PAGE.format(
        **result["machine"],
        rounds=result["rounds"],
        vertices=result["vertices"],
        triangles=result["triangles"],
        goals="\n".join(goals),
        deforming=100 * (result["deforming"] - 1),
        ceiling=100 * (MAX_DEFORMING - 1),
        peers="\n".join(peers),
        parts="\n".join(_part(what, found) for what, found in result["parts"].items()),
        verdict=verdict,
        faster=faster,
        film=f"Encoded as H.264 besides, a frame takes {best[FILM]:.1f} ms, {result['cpu_ms'][FILM]:.1f} ms of all cores.",
        own="\n".join(
            f"| ours, {name} | {best[name]:.1f} | {result['cpu_ms'][name]:.1f} | {ratio:.1f} | | |"
            for name, ratio in [
                (REFERENCE, 1.0),
                *((name, result["ours"][name]["ratio"]) for name in (STAIRS, SOFT, FINE)),
            ]
        ),
    )
    (DOCS / "render-speed.md").write_text(text)
    plot(result, DOCS / "pictures" / "render-cost.svg")


def _met(met: bool) -> str:
    return "met" if met else "**missed**"


def _peer(name: str, result: dict) -> str:
    if name in result["absent"]:
        return f"| {name} | absent: {result['absent'][name]} | | | | |"
    peer = result["peers"][name]
    goal = MIN_PEER_RATIOS.get(name, MIN_PEER_RATIO)
    judged = f"{goal:g}: {_met(peer['alike'] >= goal)}" if goal else ""
    cpu_ms = result["cpu_ms"][name]
    return f"| {name} | {peer['best_ms']:.1f} | {cpu_ms:.1f} | {peer['ratio']:.1f} | {peer['alike']:.1f} | {judged} |"


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
