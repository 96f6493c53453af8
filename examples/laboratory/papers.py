"""The figures of the four papers from one session: a notebook in percent format.

Run it cell by cell in an editor that knows such cells (VS Code, Spyder, Jupytext), or as a program::

    python -m design.speech_sample -o out/S01 --sentences 12 --rate 100    # made speech; or a session of yours
    python examples/laboratory/papers.py out/S01 out/figures

``docs/references.md`` names the papers. Figures of apparatus and of scans are left out; the report of ``fit`` has those
of dense faces.
"""

# %%
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from fapengine import lab

session = lab.read(sys.argv[1])
out = Path(sys.argv[2])
out.mkdir(parents=True, exist_ok=True)
fitted = lab.fit(session, name="figures")
tables = lab.tables_of(fitted)


def column(name, key, **chosen):
    """Values of a table's column, of the rows with chosen values in other columns."""
    table = tables[name]
    wanted = {table.columns.index(other): value for other, value in chosen.items()}
    rows = [row for row in table.rows if all(row[at] == value for at, value in wanted.items())]
    return np.array([row[table.columns.index(key)] for row in rows])


def plots(rows=1, columns=1, size=(5.0, 3.2)):
    """A figure, sized in inches, and its plots."""
    figure = Figure(figsize=size, layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False).ravel()


# %% [markdown]
# ## 000, Lucero: figure 1, the markers; the chosen ones are marked

# %%
study = fitted.selection
rest_mm, chosen = study.prepared.neutral_mm, study.swapped.primary
figure, (axes,) = plots(size=(5, 5))
axes.plot(rest_mm[:, 0], rest_mm[:, 1], "k.")
axes.plot(rest_mm[chosen, 0], rest_mm[chosen, 1], "ro", fillstyle="none", markersize=10)
axes.set(aspect="equal", xlabel="left, mm", ylabel="up, mm")
figure.savefig(out / "000-figure-1.png")

# %% [markdown]
# ## Figure 2: the diagonal of R. Figure 3: its first values with more sentences

# %%
figure, (axes,) = plots()
axes.semilogy(column("subset", "k"), np.maximum(column("subset", "r_kk_mm"), 1e-6), ".-")
axes.set(xlabel="k", ylabel="R_kk, mm")
figure.savefig(out / "000-figure-2.png")
figure, (axes,) = plots()
axes.plot(np.arange(1, len(study.by_amount) + 1), study.by_amount, label=range(1, study.by_amount.shape[1] + 1))
axes.set(xlabel="sentences", ylabel="R_kk / norm of R")
axes.legend(title="k", fontsize=6, ncols=2)
figure.savefig(out / "000-figure-3.png")

# %% [markdown]
# ## Table 1: the first markers of ten trials

# %%
for trial in range(1, 11):
    print(trial, *column("trials", "marker", trial=trial))

# %% [markdown]
# ## Figure 4: the region that each chosen marker moves

# %%
across, up = study.grid_mm
figure, panels = plots(1, len(chosen), size=(2 * len(chosen), 2.4))
for axes, weights, marker in zip(panels, study.regions.weights, chosen, strict=True):
    seen = np.where(study.regions.inside, weights, np.nan).reshape(len(up), len(across))
    axes.pcolormesh(across, up, seen, vmin=-1, vmax=1, cmap="RdBu_r")
    axes.plot(*rest_mm[marker, :2], "ko", fillstyle="none")
    axes.set(aspect="equal", xticks=[], yticks=[], title=study.prepared.points[marker] or study.prepared.labels[marker])
figure.savefig(out / "000-figure-4.png")

# %% [markdown]
# ## Figure 5: a frame of the face that they drive (large: driving, grey: recorded)

# %%
driven = lab.drive(session, options=lab.DriveOptions(markers=len(chosen)))
frame = int(np.linalg.norm(driven.recorded_mm, axis=-1).mean(axis=1).argmax())
figure, (axes,) = plots(size=(5, 5))
for motion, style in ((driven.recorded_mm, {"color": "0.7", "s": 40}), (driven.driven_mm, {"color": "k", "s": 8})):
    axes.scatter(*(driven.rest_mm + motion[frame])[:, :2].T, **style)
axes.scatter(*(driven.rest_mm + driven.driven_mm[frame])[driven.choice.subset.primary, :2].T, color="r", s=30)
axes.set(aspect="equal", title=f"others off by {driven.off_mm[:, driven.judged].mean():.2f} mm on average")
figure.savefig(out / "000-figure-5.png")

# %% [markdown]
# ## 001, Kshirsagar: figure 3, what the first four components move

# %%
points = column("loadings", "point", component=1)
place = dict(zip(fitted.prepared.points, fitted.prepared.neutral_mm, strict=True))
figure, panels = plots(1, 4, size=(11, 3))
for component, axes in enumerate(panels, 1):
    x, y = np.array([place[point][:2] for point in points]).T
    u, v = (column("loadings", key, component=component) for key in ("x_mm", "y_mm"))
    axes.quiver(x, y, u, v, color="r")
    axes.quiver(x, y, -u, -v, color="b")
    axes.set(aspect="equal", xticks=[], yticks=[], title=f"{component}: {column('components', 'moves')[component - 1]}")
figure.savefig(out / "001-figure-3.png")

# %% [markdown]
# ## Figures 5 to 7: its own sentence, with joy, with sadness

# %%
for number, expression in ((5, "none"), (6, "joy"), (7, "sadness")):
    figure, (axes,) = plots(size=(8, 3))
    for component in range(1, 5):
        shown = {"expression": expression, "component": component}
        axes.plot(column("sentence", "time_s", **shown), column("sentence", "weight_mm", **shown), label=component)
    axes.set(xlabel="s", ylabel="weight, mm", title=f"Bright sunshine shimmers on the ocean: {expression}")
    axes.legend(title="PC", ncols=4)
    figure.savefig(out / f"001-figure-{number}.png")
for mood, component in fitted.sentence.dominant.items():
    print(f"{mood.label} moves component {component + 1} most: {fitted.space.names[component].name}")

# %% [markdown]
# ## 003, Berger: figure 2, how often each marker is seen

# %%
seen = np.mean([take.markers.valid.mean(axis=0) for take in session.takes], axis=0)
figure, (axes,) = plots()
axes.bar(range(len(seen)), 100 * np.sort(seen))
axes.set(xlabel="markers", ylabel="seen, % of frames", ylim=(0, 100))
figure.savefig(out / "003-figure-2.png")

# %% [markdown]
# ## 004, Kuratate: figure 4, a path through via points. Figure 5: faces between them

# %%
via, rate_hz = fitted.via, fitted.prepared.rate_hz
marker = int(via.motion_mm.std(axis=0).sum(axis=-1).argmax())
times_s = np.arange(0, 1.5, 1 / rate_hz)
figure, panels = plots(2, 1, size=(8, 4))
for axes, axis, name in zip(panels, (1, 2), ("up", "forward"), strict=True):
    axes.plot(times_s, via.motion_mm[: len(times_s), marker, axis], "k.", markersize=2)
    axes.plot(times_s, via.points.sample(times_s)[:, marker, axis])
    early = via.points.times_s < 1.5
    axes.plot(via.points.times_s[early], via.points.positions_mm[early, marker, axis], "ro")
    axes.set(ylabel=f"{name}, mm")
figure.savefig(out / "004-figure-4.png")
first = int(np.linalg.norm(np.diff(via.points.positions_mm, axis=0), axis=-1).sum(axis=1).argmax())
figure, panels = plots(1, 5, size=(11, 2.6))
for axes, time_s in zip(panels, np.linspace(*via.points.times_s[first : first + 2], 5), strict=True):
    axes.plot(*(fitted.prepared.neutral_mm + via.points.positions_mm[first])[:, :2].T, ".", color="0.7")
    axes.plot(*(fitted.prepared.neutral_mm + via.points.sample([time_s])[0])[:, :2].T, "k.", markersize=3)
    axes.set(aspect="equal", xticks=[], yticks=[], title=f"{time_s:.3f} s")
figure.savefig(out / "004-figure-5.png")
print(f"{len(via.points)} of {len(via.motion_mm)} frames are via points at 0.5 mm")
