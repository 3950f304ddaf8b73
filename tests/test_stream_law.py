"""Streams under a law of the user's own."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import physinc

Array = NDArray[np.float64]
DOWN = np.array([0.0, 0.0, -9.81])
MAGNET = np.array([3.0, 0.0, -9.81])
SD, RADIUS = 1e-3, 0.033
WALL = 1.2
"""Position (x, m) of a wall that faces against x."""
VACUUM: dict[str, Any] = {"laws": {"drag": False}, "object": {"contact_duration": 0.0}}


def magnet(t: float, position: Array, velocity: Array) -> Array:
    return MAGNET


def spring(t: float, position: Array, velocity: Array) -> Array:
    return -9.0 * position


def thick(t: float, position: Array, velocity: Array) -> Array:
    return DOWN - 2.0 * velocity


def positions(path: Callable[[float], Array], rate: float = 60.0, until: float = 1.2, seed: int = 1) -> Iterator[physinc.Position]:
    noise = np.random.default_rng(seed)
    for now in np.arange(0.0, until, 1.0 / rate):
        center = path(now) + noise.normal(0.0, SD, 3)
        yield physinc.Position(round(now * 1e9), center, covariance=np.eye(3) * SD**2)


def pulled(t: float, start: tuple[Any, Any] = ([0.0, 2.0, 1.5], [1.0, 0.0, 2.0])) -> Array:
    """The way of a ball that a magnet pulls sideways."""
    position, velocity = map(np.asarray, start)
    return np.asarray(position + velocity * t + 0.5 * MAGNET * t * t)


def touch() -> tuple[float, Array, Array]:
    """When that ball is at the wall, and its velocity before and after (restitution 0.8)."""
    when = (-1.0 + math.sqrt(1.0 + 6.0 * (WALL - RADIUS))) / 3.0
    before = np.array([1.0, 0.0, 2.0]) + MAGNET * when
    return when, before, before * [-0.8, 1.0, 1.0]


def bounced(t: float) -> Array:
    when, _, after = touch()
    return pulled(t) if t < when else pulled(t - when, (pulled(when), after))


def swung(t: float) -> Array:
    return np.asarray(np.array([1.0, 0.2, 0.5]) * np.cos(3.0 * t) + np.array([0.0, 1.0, -0.3]) * np.sin(3.0 * t))


def slowed(t: float) -> Array:
    final = DOWN / 2.0
    way = final * t + (np.array([6.0, 0.0, 5.0]) - final) * ((1.0 - math.exp(-2.0 * t)) / 2.0)
    return np.asarray(way + np.array([0.0, 0.0, 2.0]))


def of_kind(events: list[physinc.Event], kind: type[Any]) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


@pytest.mark.parametrize(("path", "law"), [(pulled, magnet), (swung, spring), (slowed, thick)])
@pytest.mark.parametrize("rate", [30.0, 60.0, 300.0])
def test_what_moves_by_the_law_agrees_with_it(path: Callable[[float], Array], law: Any, rate: float) -> None:
    agreed = list(physinc.stream(positions(path, rate), config=VACUUM, law=law))
    assert [event.event for event in agreed] == ["stream_started", "track_started", "track_ended", "stream_ended"]
    fallen = list(physinc.stream(positions(path, rate), config=VACUUM))
    assert of_kind(fallen, physinc.Inconsistency), "gravity alone does not explain it"


@pytest.mark.parametrize("seed", range(5))
def test_a_contact_under_the_law_is_found(seed: int) -> None:
    when, before, after = touch()
    events = list(physinc.stream(positions(bounced, seed=seed), config=VACUUM, law=magnet))
    (contact,) = of_kind(events, physinc.Contact)
    assert abs(contact.time_ns * 1e-9 - when) < 2e-3
    assert np.linalg.norm(contact.center - bounced(when)) < 3e-3
    assert np.linalg.norm(contact.velocity_before - before) < 0.05
    assert np.linalg.norm(contact.velocity_after - after) < 0.05
    assert contact.normal[0] < -0.99
    assert all(0 <= event.timestamp_ns * 1e-9 - when < 0.05 for event in of_kind(events, physinc.Inconsistency))


def written(path: Path) -> Path:
    rows = (f"{p.timestamp_ns}e-9,{','.join(map(str, p.center))}" for p in positions(bounced))
    path.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    return path


@pytest.fixture(params=["thread", "iterable"])
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Any:
    """A source that a thread of its own reads, and one that the caller's does."""
    return written(tmp_path / "ball.csv") if request.param == "thread" else positions(bounced)


def test_it_is_called_once_for_each_track_and_frame(source: Any) -> None:
    asked: list[tuple[float, Array, Array]] = []

    def law(t: float, position: Array, velocity: Array) -> list[float]:
        asked.append((t, position, velocity))
        return [3.0, 0.0, -9.81]

    measured = of_kind(list(physinc.stream(source, config=VACUUM, positions=True, law=law)), physinc.Position)
    assert len(measured) == 72
    assert [t for t, *_ in asked] == pytest.approx([(p.timestamp_ns - measured[0].timestamp_ns) * 1e-9 for p in measured], abs=1e-9)
    assert all(position.shape == velocity.shape == (3,) for _, position, velocity in asked)
    assert not asked[0][2].any()
    for t, position, velocity in asked[10:30]:
        assert np.linalg.norm(position - pulled(t)) < 5e-3
        assert np.linalg.norm(velocity - ([1.0, 0.0, 2.0] + MAGNET * t)) < 0.1
    when, _, after = touch()
    for t, _, velocity in (call for call in asked if when + 0.06 < call[0] < when + 0.3):
        assert np.linalg.norm(velocity - (after + MAGNET * (t - when))) < 0.2


def test_two_tracks_are_asked_for_each() -> None:
    asked: list[float] = []

    def law(t: float, position: Array, velocity: Array) -> Array:
        asked.append(position[1])
        return MAGNET

    both = zip(positions(pulled), positions(lambda t: pulled(t) + np.array([0.0, 1.0, 0.0]), seed=2), strict=True)
    events = list(physinc.stream(map(list, both), config=VACUUM, law=law))
    assert (len(asked), sum(y > 2.5 for y in asked)) == (144, 72)
    assert not of_kind(events, physinc.Inconsistency)


def test_what_it_raises_reaches_the_caller_after_what_was_told_before(source: Any) -> None:
    mistake = LookupError("no such planet")
    asked: list[float] = []

    def law(t: float, position: Array, velocity: Array) -> Array:
        asked.append(t)
        if len(asked) > 20:
            raise mistake
        return MAGNET

    stream, events = physinc.stream(source, config=VACUUM, positions=True, law=law), list[physinc.Event]()
    with pytest.raises(LookupError) as caught:
        events.extend(stream)
    assert caught.value is mistake
    assert len(asked) == 21
    assert [e.event for e in events] == ["stream_started", "track_started", *["position"] * 20, "track_ended", "stream_ended"]
    assert isinstance(events[-1], physinc.StreamEnded)
    assert events[-1].reason == "disconnected"
    assert list(stream) == []


@pytest.mark.parametrize("answer", [None, [1.0, 2.0], [0.0, 0.0, math.nan], "down"])
def test_answers_that_are_no_acceleration_are_refused(answer: Any) -> None:
    with pytest.raises(ValueError, match="what law returns"):
        list(physinc.stream(positions(pulled), config=VACUUM, law=lambda t, p, v: answer))


@pytest.mark.parametrize(
    "config",
    [{"laws": {"law": "constant_velocity"}}, {"laws": {"law": "auto"}}, {"laws": {"method": "paper"}}, {"assume": {"camera": "moving"}}],
)
def test_another_law_or_a_moving_camera_beside_it_is_refused(config: dict[str, Any], source: Any) -> None:
    with pytest.raises(physinc.ConfigError, match="beside a law of your own") as caught:
        physinc.stream(source, config=config, law=magnet)
    assert "\n" not in str(caught.value)


def test_a_law_that_iterates_or_closes_its_stream_is_told_so() -> None:
    def law(t: float, position: Array, velocity: Array) -> Array:
        with pytest.raises(ValueError, match="already being iterated"):
            next(stream)
        return MAGNET

    def impatient(t: float, position: Array, velocity: Array) -> Array:
        next(stream)
        return MAGNET

    def rude(t: float, position: Array, velocity: Array) -> Array:
        stream.close()
        raise ZeroDivisionError

    stream = physinc.stream(positions(pulled), law=law)
    *_, end = stream
    assert isinstance(end, physinc.StreamEnded)
    assert end.reason == "end_of_source"
    for raises, error in ((impatient, ValueError), (rude, ZeroDivisionError)):
        stream = physinc.stream(positions(pulled), law=raises)
        with pytest.raises(error):
            list(stream)


def test_a_law_is_a_callable() -> None:
    with pytest.raises(ValueError, match=r"law must be a callable law\(t, position, velocity\), got"):
        physinc.stream(positions(pulled), law="free_fall")  # type: ignore[arg-type]


def test_free_fall_and_drag_in_python_tell_of_the_demo_what_they_tell_in_rust() -> None:
    ball, radius = physinc.Config().object, 0.033
    assert ball.radius == radius
    drag = 0.5 * physinc.Config().laws.air_density * ball.drag_coefficient * math.pi * radius**2 / ball.mass

    def law(t: float, position: Array, velocity: Array) -> Array:
        return np.asarray(DOWN - drag * np.linalg.norm(velocity) * velocity)

    built_in, own = (list(physinc.stream("demo", law=law)) for law in (None, law))
    pairs = list(zip(of_kind(built_in, physinc.Contact), of_kind(own, physinc.Contact), strict=True))
    assert len(pairs) > 5
    for theirs, ours in pairs:
        assert np.linalg.norm(theirs.center - ours.center) < 1e-3
    assert of_kind(built_in, physinc.CameraOrientation)
    assert not of_kind(own, physinc.CameraOrientation), "gravity is known"


def test_a_stream_can_be_let_go_of_at_any_time(tmp_path: Path) -> None:
    """While the law is at work on the reader's thread, and at the interpreter's end."""
    script = """
import sys, time, physinc

def law(t, position, velocity):
    until = time.perf_counter() + 0.02
    while time.perf_counter() < until:
        pass
    return [3.0, 0.0, -9.81]

for let_go in (physinc.Stream.close, physinc.Stream.interrupt, lambda stream: None):
    stream = physinc.stream(sys.argv[1], law=law)
    next(stream)
    let_go(stream)
    del stream
stream = physinc.stream(sys.argv[1], law=law)
next(stream)
"""
    subprocess.run([sys.executable, "-c", script, written(tmp_path / "ball.csv")], check=True, timeout=30)
