"""`physinc scale X.csv`: which of several trajectories agree on one scale."""

from __future__ import annotations

import json as json_text
import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from cyclopts import Parameter, validators
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from ._physinc import ScaleFit, fit_scale, read_positions, split_flights
from .agreement import Group, combine, groups, p_value
from .errors import RecordingError
from .narration import Plain, count
from .options import Flag

INFINITE = float("inf")


class Fall(NamedTuple):
    """How what falls does so."""

    gravity: float
    """Its size, m/s²."""
    drag: float | Path | str
    """k, 1/m, or the configuration that tells it, or `unknown`."""
    sd: float | None
    """Noise of the positions, units an axis."""


@dataclass(frozen=True)
class TrackScale:
    """What one trajectory says."""

    track: int | None
    """As the CSV names it; `None` where it names none."""
    scale: float
    """Metres per unit."""
    sd: float
    """Of `scale`."""
    flights: int
    """Flights that agree on it."""
    positions: int
    """In these flights."""
    gravity_direction: list[float]
    """Unit vector in the trajectory's axes."""
    remarks: list[str]
    """What was left out of it, and why."""


def scale(
    csv: Path,
    /,
    *,
    json: Annotated[bool, Flag] = False,
    gravity: Annotated[float, Parameter(validator=validators.Number(gt=0, lt=INFINITE))] = 9.81,
    drag: Annotated[float | None, Parameter(validator=validators.Number(gte=0, lt=INFINITE), show_default=False)] = None,
    config: Path | None = None,
    sd: Annotated[float | None, Parameter(validator=validators.Number(gte=1e-9, lte=1e6), show_default=False)] = None,
) -> int:
    """Find the metres per unit of the trajectories in CSV, and which of them agree on one scale.

    What falls freely falls at |g| in metres: so trajectories that are known up to scale, as structure from motion knows them, have a
    scale, and those of one scale belong together. Trajectories are parted where they are kicked; what isn't a flight is named.

    Parameters
    ----------
    csv
        Positions in any unit and any inertial axes: header t,x,y,z (t in s) and optionally track, an integer, and covariances
        xx,xy,xz,yy,yz,zz (units²), by which positions are weighed in flights whose every position has one.
    json
        Print one JSON object instead of a table.
    gravity
        Its size, m/s².
    drag
        k of a = g - k |v| v, 1/m; 0 for none. Left out: that of the ball of --config, or else unknown, to be found along.
    config
        TOML file, as for run: radius, mass and drag of the ball.
    sd
        Noise of the positions, units an axis, instead of their covariances. Without either the flights tell it.

    """
    t, positions, covariances, labels = read_positions(csv)
    covariances = covariances.reshape(-1, 3, 3)
    if not len(t):
        raise RecordingError(f"{csv}: there are no positions in it")
    told, refused = [], []
    fall = Fall(gravity, next(known for known in (drag, config, "unknown") if known is not None), sd)
    for label in sorted(set(labels)):
        rows = np.flatnonzero(np.array(labels) == label)
        rows = rows[np.argsort(t[rows], kind="stable")]
        found = _track(None if label < 0 else label, t[rows], positions[rows], covariances[rows], fall)
        if isinstance(found, TrackScale):
            told.append(found)
        else:
            refused.append((None if label < 0 else label, found))
    found_groups = groups([math.log(track.scale) for track in told], [track.sd / track.scale for track in told])
    if json:
        sys.stdout.write(json_text.dumps(_json(told, refused, found_groups), allow_nan=False) + "\n")
    else:
        _print(told, refused, found_groups)
    if not told:
        raise RecordingError(f"{csv}: no trajectory in it flies freely, so nothing tells a scale")
    return 0


def _track(
    label: int | None, t: NDArray[np.float64], positions: NDArray[np.float64], covariances: NDArray[np.float64], fall: Fall
) -> TrackScale | str:
    """Tell the scale of one trajectory by the flights that agree, or say why it has none."""
    if (still := np.flatnonzero(np.diff(t) <= 0)).size:
        return f"two positions at t = {t[still[0]]:.6f} s after the first: are several objects in one track?"
    flights = split_flights(t, positions)
    fits: list[tuple[ScaleFit, int]] = []
    remarks = []
    for start, end in flights:
        told = fall.sd is None and bool(np.isfinite(covariances[start:end]).all())
        fit = fit_scale(t[start:end], positions[start:end], *fall, covariances[start:end] if told else None)
        if isinstance(fit, str):
            remarks.append(f"{t[start]:.3f} to {t[end - 1]:.3f} s: {fit}")
        else:
            fits.append((fit, end - start))
    if not fits:
        few = f"{len(t)} positions, at least 6 between two kicks are needed"
        return "; ".join(remarks) or few
    logs, sds = [math.log(fit.scale) for fit, _ in fits], [fit.sd / fit.scale for fit, _ in fits]
    best = groups(logs, sds)[0]
    if 2 * len(best.members) <= len(fits) and len(fits) > 1:
        shown = ", ".join(f"{fit.scale:.4g}" for fit, _ in fits)
        return f"its {count(len(fits), 'piece')} don't agree on one scale ({shown}): it is no object that flies freely"
    remarks += [f"a piece of another scale, {fits[i][0].scale:.4g}" for i in range(len(fits)) if i not in best.members]
    members = [fits[i] for i in best.members]
    down = np.sum([fit.gravity_direction / (fit.sd / fit.scale) ** 2 for fit, _ in members], axis=0)
    down /= np.linalg.norm(down)
    value = math.exp(best.mean)
    return TrackScale(label, value, value * best.sd, len(members), sum(n for _, n in members), [float(x) for x in down], remarks)


def _p_value(told: list[TrackScale], group: Group, index: int) -> float:
    """Probability that the track `index` has the scale of the rest of `group`."""
    logs, sds = [math.log(track.scale) for track in told], [track.sd / track.scale for track in told]
    rest = [i for i in group.members if i != index]
    if not rest:
        return 1.0
    others = combine(logs, sds, rest)
    return p_value(logs[index], sds[index], others.mean, others.sd)


def _json(told: list[TrackScale], refused: list[tuple[int | None, str]], found: list[Group]) -> dict[str, Any]:
    of = {member: number for number, group in enumerate(found) for member in group.members}
    return {
        "groups": [
            {
                "scale": math.exp(group.mean),
                "sd": math.exp(group.mean) * group.sd,
                "tracks": [told[i].track for i in group.members],
                "p_value": group.p_value,
            }
            for group in found
        ],
        "tracks": [{**asdict(track), "group": of[i], "p_value": _p_value(told, found[0], i)} for i, track in enumerate(told)],
        "refused": [{"track": track, "reason": reason} for track, reason in refused],
    }


def _print(told: list[TrackScale], refused: list[tuple[int | None, str]], found: list[Group]) -> None:
    console = Plain(highlight=False, soft_wrap=True)
    if told:
        table = Table(
            "track",
            "m per unit",
            "± σ",
            "flights",
            "gravity along",
            "group",
            "p",
            box=SIMPLE_HEAD,
            pad_edge=False,
            padding=(0, 1, 0, 0),
        )
        for column in table.columns:
            column.justify, column.no_wrap = "right", True
        of = {member: number for number, group in enumerate(found) for member in group.members}
        for i, track in enumerate(told):
            digits = max(0, 2 - math.floor(math.log10(track.sd))) if track.sd > 0 else 6
            down = " ".join(f"{x:+.2f}" for x in track.gravity_direction)
            numbers = (f"{track.scale:.{digits}f}", f"{track.sd:.{digits}f}", str(track.flights))
            table.add_row(_name(track.track), *numbers, down, _letter(of[i]), _probability(_p_value(told, found[0], i)).removeprefix("= "))
        console.print(table)
        console.print("[dim]p: of having the scale of group A, less the track itself[/]")
    for number, group in enumerate(found):
        names = ", ".join(_name(told[i].track) for i in group.members)
        value = f"{math.exp(group.mean):.5g} ± {math.exp(group.mean) * group.sd:.2g} m per unit"
        if len(group.members) > 1:
            console.print(f"{_letter(number)}: tracks {names} agree on {value} (p {_probability(group.p_value)})")
        elif number:
            other = _probability(_p_value(told, found[0], group.members[0]))
            console.print(f"{_letter(number)}: track {names} has another scale, {value} (p {other})")
        else:
            console.print(f"{_letter(number)}: track {names}: {value}")
    if len(found) > 1 and len(found[0].members) == len(found[1].members):
        console.print("no scale has more tracks than another: nothing tells which one is the scene's")
    for track in told:
        for remark in track.remarks:
            console.print(f"track {_name(track.track)}: left out: {remark}")
    for label, reason in refused:
        console.print(f"track {_name(label)}: no scale: {reason}")


def _name(track: int | None) -> str:
    return "–" if track is None else str(track)


def _probability(p: float) -> str:
    return f"= {p:.2g}" if p > 1e-12 else "< 1e-12"


def _letter(number: int) -> str:
    return chr(ord("A") + number) if number < 26 else f"A{number - 25}"
