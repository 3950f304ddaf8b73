"""What an experiment is made of, and what comes of it."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from physinc.errors import PhysincError

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
    needs: Callable[[], str | None] = lambda: None
    """What else it needs and doesn't find."""

    def lacks(self, scenes: Collection[str]) -> str | None:
        """Say what is missing to run it, where these are all the `scenes` there are."""
        unknown = [scene for scene in self.scenes if scene not in scenes]
        return f"there is no scene {', '.join(unknown)}" if unknown else self.needs()


T = TypeVar("T")


def found(answer: T | None) -> T:
    """Return the answer where physics has one, as it has in every scene that is shown."""
    if answer is None:
        raise PhysincError("a fit that a figure shows found nothing: choose other seeds")
    return answer


def spread(values: Sequence[float], digits: int, unit: str, of: int) -> str:
    """Mean ± standard deviation of what was found, and in how many of the seeds if not in all."""
    finite = np.array([value for value in values if np.isfinite(value)])
    if not len(finite):
        return "not found"
    sd = f" ± {finite.std(ddof=1):.{digits}f}" if len(finite) > 1 else ""
    part = f" ({len(finite)} of {of})" if len(finite) < of else ""
    return f"{finite.mean():.{digits}f}{sd} {unit}{part}"
