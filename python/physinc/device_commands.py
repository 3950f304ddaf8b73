"""`physinc devices` and `physinc doctor`."""

from __future__ import annotations

import json as json_text
import sys
from typing import Annotated, Any

from rich import box
from rich.markup import escape
from rich.table import Table

from . import doctor as doctors
from .attached import Attached, System, attached
from .errors import DeviceNotFoundError
from .narration import Plain
from .options import Flag

SIGNS = {"good": "[green]✓[/]", "note": "[yellow]·[/]", "bad": "[red]✗[/]"}


def devices(*, json: Annotated[bool, Flag] = False) -> int:
    """List the Kinects that are attached.

    Parameters
    ----------
    json
        Print them as one JSON list, and nothing else.

    """
    system = System()
    rows = [row(system, kinect) for kinect in attached(system)]
    if json:
        sys.stdout.write(json_text.dumps(rows) + "\n")
    elif rows:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for title in ("index", "serial", "model", "place", "parts", "driver", "in use by"):
            table.add_column(title, no_wrap=title in {"serial", "place"}, overflow="fold")
        for kinect in rows:
            cells = ("index", "serial", "model", "place", "parts", "driver", "in_use_by")
            table.add_row(*(escape(shown(kinect[name])) for name in cells))
        Plain(highlight=False).print(table)
    if not rows:
        raise DeviceNotFoundError("no Kinect found: `physinc doctor` says what is missing")
    return 0


def row(system: System, kinect: Attached) -> dict[str, Any]:
    """Tell of a Kinect, as plain values."""
    kinds = {"camera": kinect.camera, "motor": kinect.motor}
    named = [name for name, device in kinds.items() if device is not None]
    audio = [device for device in kinect.devices if device not in kinds.values()]
    return {
        "index": kinect.index,
        "serial": kinect.serial,
        "model": kinect.model,
        "place": kinect.main.place,
        "node": kinect.main.node,
        "parts": named + ["audio"] * bool(audio),
        "permission": system.may_use(kinect.main),
        "speed_mbps": kinect.main.speed_mbps,
        "driver": kinect.main.driver,
        "in_use_by": system.holders(kinect.main),
    }


def shown(value: object) -> str:
    """Return a cell of the table."""
    return ", ".join(map(str, value)) if isinstance(value, list) else "" if value is None else str(value)


def doctor(*, udev: Annotated[bool, Flag] = False) -> int:
    """Look at all that may keep a Kinect from working, and say what mends it.

    Exit codes: 0 all is well, 1 something is to be mended, 3 no Kinect with a camera.

    Parameters
    ----------
    udev
        Print the udev rule that lets people use a Kinect without being root, and nothing else.

    """
    if udev:
        sys.stdout.write(doctors.RULE)
        return 0
    system, console, findings = System(), Plain(highlight=False, soft_wrap=True), []
    for finding in doctors.examine(system):
        findings.append(finding)
        console.print(f"{SIGNS[finding.verdict]} [bold]{finding.what}[/]: {escape(finding.evidence)}")
        if finding.fix is not None:
            console.print(f"  {escape(finding.fix)}")
    return doctors.code(attached(system), findings)
