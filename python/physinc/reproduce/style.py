"""One look for all figures: legible at the size shown, colours that differ in grey, and axes that say what they measure."""

from __future__ import annotations

import io
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

TRUE: dict[str, Any] = {"color": "0.0", "lw": 1.2}
"""What is true: a thin black line."""
MEASURED: dict[str, Any] = {"color": "#1b4f9c", "marker": "o", "ms": 4.0, "lw": 0}
"""Measured: dark blue dots, the paper's blue."""
PREDICTED: dict[str, Any] = {"color": "#e4572e", "ls": "--", "lw": 1.8}
"""Predicted: a dashed red line, the paper's red."""
PAPER: dict[str, Any] = {"color": "#e0a100", "marker": "s", "ms": 4.5, "mec": "0.25", "mew": 0.5}
"""By the paper's method: amber squares."""
OURS: dict[str, Any] = {"color": "#0a6e5f", "marker": "D", "ms": 4.5}
"""By ours: green diamonds."""
WIDTH = 7.6
"""Of a figure, inches; the page shows it a little wider."""
DPI = 150


def empty_sheet(height: float) -> Figure:
    """Return a figure of the page's width, which no window knows of."""
    mpl.rcParams.update(
        {
            "font.size": 9.5,
            "axes.titlesize": 10,
            "axes.grid": True,
            "grid.color": "0.88",
            "axes.axisbelow": True,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "legend.frameon": True,
            "legend.framealpha": 0.9,
            "legend.edgecolor": "0.8",
            "legend.fontsize": 8.5,
        }
    )
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def sheet(rows: int = 1, columns: int = 1, height: float = 3.4, **options: Any) -> tuple[Figure, Any]:
    """Return a figure of the page's width and its axes."""
    figure = empty_sheet(height)
    return figure, figure.subplots(rows, columns, **options)


def legend_below(figure: Figure, *axes: Axes, columns: int = 3) -> None:
    """Explain all axes' lines together under them, where they hide nothing."""
    named = {name: line for each in axes for line, name in zip(*each.get_legend_handles_labels(), strict=True)}
    figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=columns)


def label(axes: Any, x: str, y: str, z: str | None = None, title: str | None = None) -> None:
    """Say what the axes measure, in which unit."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if z is not None:
        axes.set_zlabel(z)
    if title is not None:
        axes.set_title(title, loc="left")


def picture_of_depth(axes: Axes, depth: Any, title: str, *, near: float, far: float) -> Any:
    """Show a depth image in grey, near is dark, and what has no reading is hatched."""
    axes.grid(visible=False)
    axes.set_facecolor("#f3e9d2")
    image = axes.imshow(depth, cmap="gray", vmin=near, vmax=far, interpolation="nearest")
    label(axes, "column / px", "row / px", title=title)
    return image


def png(figure: Figure) -> bytes:
    """Render the figure. Every axis must be named, with its unit behind a stroke."""
    unnamed = [text for axes in figure.axes for text in _names(axes) if "/" not in text]
    if unnamed:
        raise ValueError(f"axes without unit: {unnamed}")
    out = io.BytesIO()
    figure.savefig(out, dpi=DPI, format="png", metadata={"Software": None})
    return out.getvalue()


def _names(axes: Any) -> list[str]:
    """Names of the axes that are shown."""
    if not axes.axison:
        return []
    shown = [axes.xaxis, axes.yaxis, *([axes.zaxis] if hasattr(axes, "zaxis") else [])]
    # A colour bar has one axis with ticks.
    return [axis.get_label_text() for axis in shown if axis.get_visible() and len(axis.get_ticklocs()) and axis.get_label_text() != ""] or [
        ""
    ]
