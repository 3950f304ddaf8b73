"""`physinc reproduce`: every experiment of the paper, and the figures to see it."""

from __future__ import annotations

import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter, validators
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from ._physinc import scenes
from .errors import ConfigError
from .options import whole

FIRST_SEED = 8000
"""No threshold or constant of physinc was chosen on these seeds."""


def reproduce(
    *,
    out: Path = Path("reproduced"),
    seeds: Annotated[int, Parameter(converter=whole, validator=validators.Number(gte=1, lte=1000))] = 20,
    only: Annotated[tuple[str, ...], Parameter(show_default=False, negative="")] = (),
) -> int:
    """Run the paper's experiments on simulated counterparts of its set-ups, and write OUT/index.html with every figure and table.

    Parameters
    ----------
    out
        Folder of the page, which needs nothing beside it, and of the figures as PNG.
    seeds
        Over so many seeds each number's spread is told.
    only
        Experiments, instead of all: rotation, translation, surfaces, activity, laws, recordings.

    """
    missing = [name for name in ("matplotlib", "jinja2") if find_spec(name) is None]
    if missing:
        raise ConfigError(f"physinc reproduce needs {' and '.join(missing)}: pip install 'physinc[report]'")
    # They import matplotlib, which is not everybody's.
    from .reproduce.all import EXPERIMENTS  # noqa: PLC0415
    from .reproduce.page import page  # noqa: PLC0415
    from .reproduce.run import run  # noqa: PLC0415

    names = [experiment.name for experiment in EXPERIMENTS]
    if unknown := [name for name in only if name not in names]:
        raise ConfigError(f"--only {unknown[0]}: the experiments are {', '.join(names)}")
    there = set(scenes())
    wanted = [e for e in EXPERIMENTS if not only or e.name in only]
    lacking = {e.name: e.lacks(there) for e in wanted}
    chosen = [e for e in wanted if lacking[e.name] is None]
    left_out = [f"Not here: {name}: {lack}." for name, lack in lacking.items() if lack is not None]
    out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    numbers = range(FIRST_SEED, FIRST_SEED + seeds)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("starting", total=None)
        sections = run(chosen, numbers, lambda done, steps, what: progress.update(bar, completed=done, total=steps, description=what))
    for section in sections:
        for picture in section.pictures:
            (out / f"{picture.name}.png").write_bytes(picture.png)
    command = " ".join(["physinc reproduce", *([f"--seeds {seeds}"] if seeds != 20 else []), *(f"--only {name}" for name in only)])
    html = page(sections, command=command, seeds=numbers, seconds=time.monotonic() - begin, left_out=left_out)
    (out / "index.html").write_text(html, encoding="utf-8")
    count = sum(len(section.pictures) for section in sections)
    for line in left_out:
        sys.stderr.write(f"{line}\n")
    sys.stdout.write(f"{out / 'index.html'}: {count} figures, {time.monotonic() - begin:.0f} s\n")
    return 0
