"""One HTML page that needs nothing else."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from importlib.resources import files

import jinja2

from physinc._physinc import __version__

from .experiment import Section


def page(sections: Sequence[Section], *, command: str, seeds: Sequence[int], seconds: float, left_out: Sequence[str]) -> str:
    """Return the page, its figures inside."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    environment.filters["base64"] = lambda png: base64.b64encode(png).decode("ascii")
    template = environment.from_string(files(__package__).joinpath("page.html.j2").read_text(encoding="utf-8"))
    return template.render(
        sections=sections,
        version=__version__,
        command=command,
        seeds=f"{seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else str(seeds[0]),
        seconds=f"{seconds:.0f}",
        left_out=left_out,
    )
