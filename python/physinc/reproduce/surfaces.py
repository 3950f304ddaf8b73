"""Sec. 3.2, invisible surfaces: table 1 over all seeds; the figures are in `surface_figures`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from physinc import _physinc as p

from . import surface_figures as figures
from .experiment import Experiment, Section, Table, Task, spread
from .observation import PAPER, Observation, observe

SCENE = "bounce?seed={}"
SHOWN = "bounce?throws=12&seed={}"
"""More throws, so that there is something to see."""


@dataclass(frozen=True)
class Estimate:
    """What one scene tells of its surfaces; NaN where it doesn't."""

    height: float
    """Of the box, m."""
    box_tilt: float
    """Of its top, rad."""
    ground_tilt: float
    """Of the ground, rad."""
    patch_tilt: float
    """Of the patches at single contacts, root mean square, rad."""


def estimate(seed: int, paper: bool) -> Estimate:
    """Watch one scene."""
    return estimated(observe(SCENE.format(seed), PAPER if paper else None), paper=paper)


def estimated(seen: Observation, *, paper: bool) -> Estimate:
    """Tell the two planes that most contacts rest on, as the paper does: the lower is the ground, the upper the top of the box."""
    contacts = seen.of(p.Contact)
    patches = [patch_tilt(contact, paper=paper) for contact in contacts]
    patch = math.sqrt(np.mean(np.square(patches))) if patches else math.nan
    planes = sorted((s for s in seen.of(p.Surface) if s.merged_into is None), key=lambda s: -s.contacts)[:2]
    if not planes:
        return Estimate(math.nan, math.nan, math.nan, patch)
    ground, *above = sorted(planes, key=lambda s: float(np.mean(np.asarray(s.outline)[:, 2])) if s.outline is not None else s.offset)
    tilt = math.nan if ground.tilt is None else ground.tilt
    if not above:
        return Estimate(math.nan, math.nan, tilt, patch)
    (box,) = above
    return Estimate(_height(box, ground), math.nan if box.tilt is None else box.tilt, tilt, patch)


def patch_tilt(contact: p.Contact, *, paper: bool) -> float:
    """Angle from the horizontal, rad: the paper's patch lies along the motion, ours across the normal."""
    if paper:
        return math.nan if contact.direction is None else math.asin(min(abs(float(contact.direction[2])), 1.0))
    return math.nan if contact.normal is None else math.acos(min(float(contact.normal[2]), 1.0))


def _height(box: p.Surface, ground: p.Surface) -> float:
    """As the event says, or, where it tells the height over another plane, of the middle of the box's contacts over the ground."""
    if box.above is not None and box.above.surface == ground.id:
        return box.above.height
    if box.outline is None:
        return math.nan
    return float(np.mean(np.asarray(box.outline), axis=0) @ ground.normal - ground.offset)


def tasks(seeds: Sequence[int]) -> list[Task]:
    """Every seed by both methods."""
    return [(estimate, (seed, paper)) for seed in seeds for paper in (True, False)]


def table(paper: Sequence[Estimate], ours: Sequence[Estimate]) -> Table:
    """Table 1 with four columns."""
    of = len(ours)

    def row(name: str, actual: str, published: str, *, field: str, scale: float, unit: str) -> list[str]:
        columns = [[scale * getattr(estimate, field) for estimate in method] for method in (paper, ours)]
        return [name, actual, published, *(spread(column, 2, unit, of) for column in columns)]

    degrees = 180 / math.pi
    return Table(
        "Table 1",
        ("quantity", "actual", "paper", "paper's method here", "ours"),
        [
            row("box height", "90 mm", "92 mm", field="height", scale=1e3, unit="mm"),
            row("box top orientation", "0°", "4.8°", field="box_tilt", scale=degrees, unit="°"),
            row("ground orientation", "0°", "5.6°", field="ground_tilt", scale=degrees, unit="°"),
            row("single patches' orientation (rms)", "0°", "–", field="patch_tilt", scale=degrees, unit="°"),
        ],
        f"Mean ± standard deviation over {of} seeds of sim:bounce (six throws). By the paper's method: θ = 6 mm on one-step predictions by"
        " Eq. 5, two free parabolas, patches along the motion; planes through contacts are ours in both, and the two with the most"
        " contacts count. Orientation is the angle from the horizontal, which cannot be below 0.",
    )


def section(seeds: Sequence[int], results: Sequence[Any]) -> Section:
    """Figures of the first seed, table over all."""
    scene = SHOWN.format(seeds[0])
    paper, ours = observe(scene, PAPER), observe(scene)
    return Section(
        "Invisible surfaces (sec. 3.2)",
        "A Kinect stands on the ground and looks horizontally: neither the ground nor a box of glass gives it a depth reading. A tennis"
        f" ball is thrown over both, and where its flight is inconsistent with gravity there must be a surface. Figures: sim:{scene}.",
        [
            figures.inconsistency(ours),
            figures.sphere(f"room?throws=1&seed={seeds[0]}"),
            figures.blank(ours),
            figures.reconstruction(paper, ours),
            figures.interactions(ours),
        ],
        [table(results[0::2], results[1::2])],
    )


EXPERIMENT = Experiment("surfaces", ("bounce", "room"), tasks, section)
