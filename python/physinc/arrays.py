"""The physics on arrays: sphere, flight, inconsistencies, contact, planes.

Positions are [N, 3] in metres, in any frame that is inertial, times [N] in seconds, rising. What can't be used (shapes that don't fit,
numbers that aren't finite, times that stand still or go back, too few measurements) raises a ValueError that names it; `None` is the
answer where physics says no.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import Enum
from typing import Literal, Protocol, SupportsFloat, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _physinc
from ._physinc import Contact, ContactFit, FlightFit, Inconsistencies, PlaneFit, ScaleFit, SphereFit
from .config import Config, LawsConfig, ObjectConfig

Method: TypeAlias = Literal["best", "paper"]
"""Whitened tests and joint fits, or the paper's own estimators."""
Drag: TypeAlias = float | ObjectConfig | LawsConfig | Config | None
"""k = ½ ρ C_d A / m of a = g − k |v| v (1/m), or what tells it. `None` is a tennis ball's in air."""

DOWN = (0.0, 0.0, -9.81)
"""Gravity where nothing else is said, m/s²: z is up."""


class Unsaid(Enum):
    """What a parameter is where nothing is said."""

    GRAVITY = DOWN

    def __repr__(self) -> str:
        return repr(self.value)


class Law(Protocol):
    """How an object that nobody touches moves."""

    def __call__(self, t: float, position: NDArray[np.float64], velocity: NDArray[np.float64], /) -> ArrayLike:
        """Its whole acceleration [3] (m/s²) at time `t` (s), `position` [3] (m) and `velocity` [3] (m/s): finite, and smooth in all."""


AnyLaw: TypeAlias = Literal["free_fall", "free_fall_with_drag"] | Law
"""A law by name, or any other."""
Side: TypeAlias = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, ArrayLike]
"""Times, positions, and perhaps their covariances ([3, 3] or [N, 3, 3], m²)."""


def fit_sphere(points: ArrayLike, radius: float | None = None) -> SphereFit | None:
    """Fit a sphere of known or unknown `radius` (m) to `points` [N, 3] by robust least squares on the distances from it.

    `None` where no sphere is determined: fewer than 4 points (5 with a free radius), points in a plane or on a line, or nowhere near a
    sphere. A small cap leaves two mirrored spheres of known radius; of two that fit alike, the one farther from the origin is meant,
    where the camera stands.
    """
    _numbers(radius=radius)
    return _physinc.fit_sphere(points, radius)


def accelerations(t: ArrayLike, positions: ArrayLike) -> NDArray[np.float64]:
    """Frame-wise accelerations [N, 3] (m/s²) by Eq. 4, twice; NaN for the first two.

    Their mean telescopes: only the ends count. `fit_flight` with `gravity=None` tells the same several times better.
    """
    return _physinc.accelerations(t, positions)


def fit_flight(
    t: ArrayLike,
    positions: ArrayLike,
    law: AnyLaw = "free_fall",
    *,
    gravity: ArrayLike | float | Unsaid | None = Unsaid.GRAVITY,
    drag: Drag = None,
    sd: float | None = None,
    covariance: ArrayLike | None = None,
) -> FlightFit | None:
    """Fit the flight from one position and one velocity that explains `positions` best under `law`.

    `gravity` is a known vector [3] (m/s²), a known size (its direction is found), or `None`: nothing is known, vector and size come out.
    `law` may be any callable `law(t, position, velocity)` (see `Law`): it is the whole acceleration, so a `gravity` beside it raises
    ValueError; what it raises passes unchanged. The covariance leaves out how the law's own bending changes with the state: small for drag.
    `drag` belongs to `"free_fall_with_drag"`.

    Noise: `sd` (m an axis), or `covariance` [3, 3] or [N, 3, 3] (m²); without either the residuals tell it, as white and even.
    `None` where no flight is found (a law too wild to converge). Least squares of Eq. 5 over the whole history, the f of Eq. 2.
    """
    _numbers(sd=sd)
    return _physinc.fit_flight(t, positions, law, _beside(law, gravity), _drag(drag), sd, covariance)


def split_flights(t: ArrayLike, positions: ArrayLike) -> list[slice]:
    """Find the flights in a motion of which neither unit nor gravity is known: what lies between two kicks, as slices of `positions`.

    A flight has at least 6 positions, and a kick must be plain beside the noise, which third differences tell: fewer than 8 positions are
    taken for one flight.
    """
    return [slice(*flight) for flight in _physinc.split_flights(t, positions)]


def fit_scale(
    t: ArrayLike,
    positions: ArrayLike,
    *,
    gravity: float = 9.81,
    drag: Drag | Literal["unknown"] = "unknown",
    sd: float | None = None,
    covariance: ArrayLike | None = None,
) -> ScaleFit | None:
    """Find the metres per unit of a flight that is known up to scale, as structure from motion knows it, from |a| = g (sec. 3.1).

    `positions` [N, 3] are in any unit and any inertial axes: where gravity pulls is found along. `drag` is in metres, as in `fit_flight`
    (0 for none, `None` for a tennis ball's), so the two are found by turns; unknown, it is found along, from 0.02 ± 0.02 1/m on, and
    what is left open of it is part of the scale's σ. The size of `gravity` (m/s²; on Earth within 0.3 % of 9.81) is taken for exact.

    Noise: `sd` (units an axis) or `covariance` [3, 3] or [N, 3, 3] (units²), widened where the flight fits worse; without either the
    residuals tell it, which takes 6 positions instead of 4. `None` where no flight is seen: a constant velocity, a touch in between
    (`split_flights` parts there), a motion of its own.
    """
    _numbers(gravity=gravity, sd=sd)
    found = _physinc.fit_scale(t, positions, gravity, drag if isinstance(drag, str) else _drag(drag), sd, covariance)
    return None if isinstance(found, str) else found


def find_inconsistencies(
    t: ArrayLike,
    positions: ArrayLike,
    *,
    method: Method = "best",
    horizon: Literal["step", "flight"] | None = None,
    law: AnyLaw = "free_fall",
    gravity: ArrayLike | Unsaid = Unsaid.GRAVITY,
    drag: Drag = None,
    sd: float | None = None,
    covariance: ArrayLike | None = None,
    theta: float = 0.006,
    false_alarm: float = 1e-3,
) -> Inconsistencies:
    """Hold each measurement against its prediction by `law` (Eq. 3).

    `method="best"`: by least squares, alarming where the innovation, whitened by its covariance, would be so large by chance with
    probability `false_alarm` over the whole of `positions`. `"paper"`: by Eq. 5 under gravity alone, alarming beyond `theta` (m).
    `horizon="step"` predicts from the last two measurements, `"flight"` from all since the flight began (the paper's: from its first
    two), which is at the first measurement and anew at each inconsistent one. Left out: `"flight"` for best, `"step"` for the paper.
    Eq. 5 takes the mean velocity of a step for that at its end, and so lags by ½ g dt² (5.45 mm at 30 Hz): its own approximation.

    Noise as in `fit_flight`; left out, it is told by third differences (from 8 measurements on), which contacts hardly move.
    `gravity` is a vector [3] (m/s²). At least 3 measurements.
    """
    _numbers(sd=sd, theta=theta, false_alarm=false_alarm)
    gravity = np.asarray(_beside(law, gravity))
    return _physinc.find_inconsistencies(t, positions, method, horizon, law, gravity, _drag(drag), sd, covariance, theta, false_alarm)


def solve_contact(
    before: Side,
    after: Side,
    method: Method = "best",
    *,
    law: AnyLaw = "free_fall",
    gravity: ArrayLike | float | Unsaid | None = Unsaid.GRAVITY,
    drag: Drag = None,
    duration: float = 0.0,
    normal: ArrayLike | None = None,
    radius: float | None = None,
    sd: float | None = None,
) -> ContactFit | None:
    """Find where and when an object touched something, from its positions `before` and `after`: pairs (t, positions).

    `method="best"` fits both flights jointly, with a shared point and time, under `law`, `gravity` and `drag` as in `fit_flight`, for a
    touch of `duration` (s; a tennis ball's 0.0045; 0 is an ideal impact). `"paper"` fits two free parabolas to the eight measurements on
    either side and takes the closest points of the curves, however far apart they are (sec. 3.2); it knows no covariance.
    `normal` is the surface's where it is known, to the side the ball came from (ValueError where it came from the other); otherwise the
    contact's own serves. With `radius` (m) the touched point is told too.

    Noise: `sd` (m an axis), or covariances as third members of both pairs; without either the residuals of both flights tell it.
    `None` where the flights don't meet between the two sides, or there are too few measurements: two a side, three where noise has to be
    estimated or the size of gravity alone is known, up to four with free gravity; three for the paper's.
    """
    _numbers(duration=duration, radius=radius, sd=sd)
    first, second = _side(before, "before"), _side(after, "after")
    return _physinc.solve_contact(first, second, method, law, _beside(law, gravity), _drag(drag), duration, normal, radius, sd)


def fit_planes(
    contacts: Iterable[Contact | ContactFit],
    *,
    radius: float | None = None,
    gravity: ArrayLike = DOWN,
    spin_sd: float = 0.0,
) -> list[PlaneFit]:
    """Group `contacts` (events, or what `solve_contact` gave) into planes, each by the covariances of its contacts.

    Contact points, v⁺ + e v⁻ (which lies in the plane for any friction and spin) and the plane of motion tell each; a contact that may
    be on a level plane, across `gravity` [3], is taken to be until others contradict. One alone that isn't level is no plane: it may as
    well be an edge; nor is one without velocities or impulse.

    `radius` (m) is the ball's, 0 for a point; left out, each contact's own. `spin_sd` (rad/s) is that of an unknown spin.
    An event says how sure its center is, not its velocities: these are taken to have 6/T² times the center's covariance with T = 0.27 s
    (straight lines over T on both sides through a shared point), independent of it. `solve_contact` knows better.

    At most 64 contacts. Raises ValueError where a contact has no covariance (`method="paper"`), TypeError where it is none.
    """
    _numbers(radius=radius, spin_sd=spin_sd)
    return _physinc.fit_planes(contacts, radius, gravity, spin_sd)


def _numbers(**given: object) -> None:
    for name, value in given.items():
        if not (value is None or isinstance(value, SupportsFloat)):
            raise TypeError(f"{name} = {value!r}: expected a number")


def _beside(law: AnyLaw, gravity: ArrayLike | float | Unsaid | None) -> ArrayLike | float | None:
    if isinstance(gravity, Unsaid):
        return DOWN
    if callable(law):
        raise ValueError("a callable law is the whole acceleration: gravity has no part beside it")
    return gravity


def _drag(drag: Drag) -> float | Config | None:
    if isinstance(drag, ObjectConfig):
        return Config(object=drag)
    return Config(laws=drag) if isinstance(drag, LawsConfig) else drag


def _side(side: Side, name: str) -> tuple[ArrayLike, ArrayLike, ArrayLike | None]:
    if not isinstance(side, Sequence) or len(side) not in (2, 3):
        raise ValueError(f"{name} must be a pair (t, positions), or (t, positions, covariance)")
    return side[0], side[1], side[2] if len(side) == 3 else None
