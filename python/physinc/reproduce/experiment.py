"""What an experiment is made of, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Task = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function of a module, and its arguments: it can be done in another process."""


@dataclass(frozen=True)
class Picture:
    """A figure."""

    name: str
    """Of its file, without `.png`."""
    title: str
    """Which figure of the paper it stands beside."""
    caption: str
    """What is seen."""
    png: bytes
    """The image."""


@dataclass(frozen=True)
class Table:
    """A table of words and numbers."""

    title: str
    """What it stands beside."""
    header: Sequence[str]
    """Of the columns."""
    rows: Sequence[Sequence[str]]
    """Cells."""
    caption: str
    """What the numbers are."""


@dataclass(frozen=True)
class Section:
    """An experiment, told."""

    title: str
    """What it shows."""
    text: str
    """How it was made."""
    pictures: Sequence[Picture]
    """In the paper's order."""
    tables: Sequence[Table] = ()
    """Numbers over all seeds."""


@dataclass(frozen=True)
class Experiment:
    """One of the paper's."""

    name: str
    """For `--only`."""
    scenes: Sequence[str]
    """Simulated scenes that it needs."""
    tasks: Callable[[Sequence[int]], list[Task]]
    """What is to be done for these seeds."""
    section: Callable[[Sequence[int], list[Any]], Section]
    """Seeds and what the tasks returned, in their order, made into a section."""


def spread(values: Sequence[float], digits: int, unit: str, of: int) -> str:
    """Mean ± standard deviation of what was found, and in how many of the seeds if not in all."""
    found = np.array([value for value in values if np.isfinite(value)])
    if not len(found):
        return "not found"
    sd = f" ± {found.std(ddof=1):.{digits}f}" if len(found) > 1 else ""
    part = f" ({len(found)} of {of})" if len(found) < of else ""
    return f"{found.mean():.{digits}f}{sd} {unit}{part}"
