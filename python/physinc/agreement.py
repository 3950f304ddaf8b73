"""Which of several numbers, each with its σ, are one number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SIGNIFICANCE = 1e-3
"""Numbers that are one are parted with this probability."""


@dataclass(frozen=True)
class Group:
    """Numbers that agree."""

    members: tuple[int, ...]
    """Their indices."""
    mean: float
    """Weighted by 1/σ²."""
    sd: float
    """Of `mean`."""
    p_value: float
    """Probability that so many numbers that are one scatter so much (χ²); 1 for a single one."""


def groups(values: Sequence[float], sds: Sequence[float]) -> list[Group]:
    """Part numbers into groups that agree, the largest first: each is the largest that the ones before it left."""
    left, found = list(range(len(values))), []
    while left:
        largest = max((_around(values, sds, left, center) for center in left), key=lambda group: (len(group.members), group.p_value))
        found.append(largest)
        left = [i for i in left if i not in largest.members]
    return found


def p_value(value: float, sd: float, mean: float, mean_sd: float) -> float:
    """Probability that two numbers that are one differ so much."""
    return math.erfc(abs(value - mean) / math.sqrt(2 * (sd**2 + mean_sd**2)))


def _around(values: Sequence[float], sds: Sequence[float], among: Sequence[int], center: int) -> Group:
    """Gather what agrees with the number `center`, then with the mean of what was gathered, until nothing changes."""
    group = combine(values, sds, [center])
    for _ in range(20):
        members = [i for i in among if i in group.members or p_value(values[i], sds[i], group.mean, group.sd) > SIGNIFICANCE]
        wider = combine(values, sds, members)
        while wider.p_value < SIGNIFICANCE:
            members.remove(max(members, key=lambda i: abs(values[i] - wider.mean) / sds[i]))
            wider = combine(values, sds, members)
        if set(wider.members) <= set(group.members):
            break
        group = wider
    return group


def combine(values: Sequence[float], sds: Sequence[float], members: Sequence[int]) -> Group:
    """Take the `members` for one number."""
    value, weight = np.array([values[i] for i in members]), np.array([sds[i] for i in members]) ** -2.0
    mean = float(value @ weight / weight.sum())
    chi2 = float((value - mean) ** 2 @ weight)
    return Group(tuple(members), mean, float(weight.sum() ** -0.5), chi2_sf(chi2, len(members) - 1))


def chi2_sf(x: float, dof: int) -> float:
    """Probability that a χ² variable exceeds `x`; 1 without a degree of freedom. By the incomplete gamma function's recurrence."""
    if dof < 1 or x <= 0:
        return 1.0
    half, order = x / 2, 0.5 * (dof % 2) or 1.0
    tail = math.erfc(math.sqrt(half)) if order < 1 else math.exp(-half)
    while order < dof / 2:
        tail += math.exp(order * math.log(half) - half - math.lgamma(order + 1))
        order += 1
    return min(tail, 1.0)
