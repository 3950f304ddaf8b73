"""The functions on arrays, on exact flights and bounces made here with numpy."""

from __future__ import annotations

import contextlib
import copy
import inspect
import pickle
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import physinc
from physinc._physinc import PAPER_SIDE
from physinc.arrays import DOWN

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

G = np.array([0.0, 0.0, -9.81])
RATE = 30.0
HIT = np.array([0.2, 1.6, 0.033])
V_IN, V_OUT = np.array([1.2, 0.3, -3.1]), np.array([0.9, 0.25, 2.3])
T_HIT = 0.2617


def parabola(t: Array, p: Any = (0.1, 1.5, 0.4), v: Any = (1.0, -0.5, 3.0), g: Array = G) -> Array:
    s = t[:, None]
    centers: Array = np.asarray(p) + np.asarray(v) * s + 0.5 * g * s**2
    return centers


def with_drag(t: Array, k: float) -> Array:
    """By many small steps of the midpoint rule."""
    p, v, now = np.array([0.1, 1.5, 0.4]), np.array([4.0, -0.5, 3.0]), t[0]
    centers = []
    for then in t:
        steps = 400
        h = (then - now) / steps
        for _ in range(steps):
            half = v + 0.5 * h * (G - k * np.linalg.norm(v) * v)
            p, v = p + h * half, v + h * (G - k * np.linalg.norm(half) * half)
        centers.append(p)
        now = then
    return np.array(centers)


def bounce(sign: float, count: int, hit: Array = HIT, v: Array | None = None) -> tuple[Array, Array]:
    """`count` frames of the flight before (−) or after (+) the hit at T_HIT."""
    frame = int(T_HIT * RATE) + (1 if sign > 0 else 0)
    t = np.sort((frame + sign * np.arange(count, dtype=np.float64)) / RATE)
    return t, parabola(t - T_HIT, hit, v if v is not None else (V_IN if sign < 0 else V_OUT))


def frames(count: int) -> Array:
    return np.arange(count) / RATE


# Spheres.


def cap(center: Array, radius: float, count: int = 300) -> Array:
    directions = np.random.default_rng(1).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    directions *= -np.sign(directions @ center)[:, None]
    points: Array = center + radius * directions
    return points


@pytest.mark.parametrize("radius", [0.033, None])
def test_a_sphere_is_found_with_and_without_its_radius(radius: float | None) -> None:
    center = np.array([0.1, -0.2, 1.5])
    fit = physinc.fit_sphere(cap(center, 0.033), radius)
    assert fit is not None
    assert np.allclose(fit.center, center, atol=1e-8)
    assert fit.radius == pytest.approx(0.033, abs=1e-8)
    assert fit.covariance.shape == (3, 3)
    assert fit.inliers == 300


def test_what_is_no_sphere_is_none_and_what_is_no_points_an_error() -> None:
    plane = np.c_[np.random.default_rng(2).uniform(size=(50, 2)), np.ones(50)]
    assert physinc.fit_sphere(plane, 0.033) is None
    assert physinc.fit_sphere(np.empty((0, 3))) is None
    for points, match in [(np.zeros((4, 2)), r"\[N, 3\]"), (np.zeros(3), r"\[N, 3\]"), ([[0, 0, np.nan]] * 9, "row 0"), ("x", "N, 3")]:
        with pytest.raises(ValueError, match=match):
            physinc.fit_sphere(points)  # type: ignore[arg-type]
    for radius in [0.0, -1.0, np.nan, np.inf]:
        with pytest.raises(ValueError, match="radius"):
            physinc.fit_sphere(plane, radius)


# Flights.


def test_an_exact_flight_is_found_and_predicted_exactly() -> None:
    t = frames(15)
    fit = physinc.fit_flight(t[:10], parabola(t)[:10])
    assert fit is not None
    center, covariance = fit.predict(t[14])
    assert np.allclose(center, parabola(t)[14], atol=1e-6)
    assert np.all(np.linalg.eigvalsh(covariance) > 0)
    assert fit.residual_rms < 1e-6
    assert fit.dof == 24
    assert fit.covariance.shape == (9, 9)


@pytest.mark.parametrize("size", [9.81, 1.62, 3.7])
def test_gravity_comes_out_where_it_is_free(size: float) -> None:
    g = np.array([0.1, 0.45, -0.89])
    g *= size / np.linalg.norm(g)
    t = frames(15)
    for gravity in (None, size):
        fit = physinc.fit_flight(t, parabola(t, g=g), gravity=gravity)
        assert fit is not None
        assert fit.gravity is not None
        assert np.allclose(fit.gravity, g, atol=1e-4)


def test_drag_is_taken_from_a_number_or_a_ball() -> None:
    t = frames(20)
    ball = physinc.ObjectConfig(radius=0.033, mass=0.057, drag_coefficient=0.5)
    k = 0.5 * 1.2 * 0.5 * np.pi * 0.033**2 / 0.057
    for drag in (k, ball, physinc.Config(object=ball)):
        fit = physinc.fit_flight(t, with_drag(t, k), "free_fall_with_drag", drag=drag, gravity=None)
        assert fit is not None
        assert fit.gravity is not None
        assert np.allclose(fit.gravity, G, atol=1e-3)
    bare = physinc.fit_flight(t, with_drag(t, k))
    assert bare is not None
    assert bare.residual_rms > 1e-3


def test_any_callable_is_a_law() -> None:
    t, k = frames(20), 0.02

    def law(now: float, position: Array, velocity: Array) -> Array:
        assert 0 <= now <= 1
        assert position.shape == velocity.shape == (3,)
        acceleration: Array = G - k * np.linalg.norm(velocity) * velocity
        return acceleration

    own = physinc.fit_flight(t, with_drag(t, k), law, sd=1e-3)
    built_in = physinc.fit_flight(t, with_drag(t, k), "free_fall_with_drag", drag=k, sd=1e-3)
    assert own is not None
    assert built_in is not None
    assert own.gravity is None
    assert np.allclose(own.velocity, built_in.velocity, atol=1e-6)
    assert np.allclose(own.predict(0.9)[0], built_in.predict(0.9)[0], atol=1e-6)
    assert own.log_evidence == pytest.approx(built_in.log_evidence, abs=1e-3)


def test_what_a_law_raises_reaches_the_caller_unchanged() -> None:
    t = frames(10)
    error = KeyError("mine")

    def broken(*_state: object) -> Array:
        raise error

    with pytest.raises(KeyError) as raised:
        physinc.fit_flight(t, parabola(t), broken)
    assert raised.value is error
    for answer, match in [([0, 0], "3 numbers"), (None, "3 numbers"), ([0, 0, np.inf], "finite")]:
        with pytest.raises(ValueError, match=match):
            physinc.fit_flight(t, parabola(t), lambda *_, answer=answer: answer)
    for gravity in (None, DOWN, (0.0, 0.0, -9.81)):
        with pytest.raises(ValueError, match="gravity has no part"):
            physinc.fit_flight(t, parabola(t), lambda *_: G, gravity=gravity)
    assert " = (0.0, 0.0, -9.81)" in str(inspect.signature(physinc.fit_flight))
    # A force that turns round within micrometres: nothing converges.
    assert physinc.fit_flight(t, parabola(t), lambda _t, p, _v: 200 * np.sin(1e6 * p)) is None


def test_noise_as_told_and_as_estimated_agree() -> None:
    rng = np.random.default_rng(3)
    t = frames(200) / 10
    noisy = parabola(t) + rng.normal(0, 2e-3, (200, 3))
    estimated = physinc.fit_flight(t, noisy)
    told = physinc.fit_flight(t, noisy, sd=2e-3)
    same = physinc.fit_flight(t, noisy, covariance=np.eye(3) * 4e-6)
    each = physinc.fit_flight(t, noisy, covariance=np.tile(np.eye(3) * 4e-6, (200, 1, 1)))
    assert estimated is not None
    assert told is not None
    assert same is not None
    assert each is not None
    assert estimated.sd == pytest.approx(2e-3, rel=0.1)
    assert told.sd is None
    assert told.chi2 / told.dof == pytest.approx(1, abs=0.2)
    assert np.array_equal(told.covariance, each.covariance)
    assert np.allclose(told.covariance, same.covariance)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**31))
def test_covariances_are_those_of_the_errors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    t = frames(15)
    fit = physinc.fit_flight(t, parabola(t) + rng.normal(0, 1e-3, (15, 3)), sd=1e-3, gravity=None)
    assert fit is not None
    center, covariance = fit.predict(0.6)
    off = center - parabola(np.array([0.6]))[0]
    # χ² of 3 degrees of freedom: beyond 40 once in 10⁸.
    assert off @ np.linalg.solve(covariance, off) < 40


def bad(t: Any, positions: Any, match: str, **options: Any) -> Any:
    return pytest.param(t, positions, options, match, id=match)


@pytest.mark.parametrize(
    ("t", "positions", "options", "match"),
    [
        bad(frames(5), np.zeros((4, 3)), "5 times, positions 4 rows"),
        bad(frames(5), np.zeros((5, 2)), r"positions must be an array \[N, 3\]"),
        bad(frames(5), np.full((5, 3), np.nan), "row 0 is not"),
        bad([0, 1, 1, 2, 3], np.zeros((5, 3)), r"t must rise, but t\[2\] = 1 follows 1"),
        bad([0, 2, 1, 3, 4], np.zeros((5, 3)), r"t must rise, but t\[2\]"),
        bad([0, 1, np.inf, 3, 4], np.zeros((5, 3)), r"t\[2\] is not"),
        bad(np.zeros((5, 1)), np.zeros((5, 3)), r"t must be an array \[N\]"),
        bad(frames(2), np.zeros((2, 3)), "at least 3 positions"),
        bad(frames(5), np.zeros((5, 3)), "sd = 0", sd=0.0),
        bad(frames(5), np.zeros((5, 3)), "give one of them", sd=1.0, covariance=np.eye(3)),
        bad(frames(5), np.zeros((5, 3)), "positive definite, number 0", covariance=-np.eye(3)),
        bad(frames(5), np.zeros((5, 3)), r"\[3, 3\] or \[N, 3, 3\] with N = 5", covariance=np.ones((4, 3, 3))),
        bad(frames(5), np.zeros((5, 3)), "law must be", law="gravity"),
        bad(frames(5), np.zeros((5, 3)), "drag has a part", drag=0.1),
        bad(frames(5), np.zeros((5, 3)), "drag = -1", law="free_fall_with_drag", drag=-1.0),
        bad(frames(5), np.zeros((5, 3)), "gravity must be 3 numbers", gravity=[1, 2]),
        bad(frames(5), np.zeros((5, 3)), "gravity = 0: a size", gravity=0.0),
        bad(frames(5), np.zeros((5, 3)), "gravity must be finite", gravity=[0, 0, np.nan]),
    ],
)
def test_bad_input_is_one_clear_line(t: Any, positions: Any, options: dict[str, Any], match: str) -> None:
    with pytest.raises(ValueError, match=match) as raised:
        physinc.fit_flight(t, positions, **options)
    assert "\n" not in str(raised.value)


# Inconsistencies.


def test_eq_5_lags_by_545_mm_at_30_hz() -> None:
    t = frames(12)
    found = physinc.find_inconsistencies(t, parabola(t), method="paper")
    assert np.all(np.isnan(found.distance[:2]))
    assert np.allclose(found.distance[2:], 5.45e-3, atol=1e-9)
    assert np.allclose(found.moving_average[2:], 5.45e-3, atol=1e-9)
    assert np.all(found.threshold[2:] == 0.006)
    assert np.all(np.isnan(found.p_value))
    assert not found.inconsistent.any()
    assert physinc.find_inconsistencies(t, parabola(t), method="paper", theta=0.005).inconsistent[2:].all()
    # From the start of a flight the lag grows with time.
    whole = physinc.find_inconsistencies(t, parabola(t), method="paper", horizon="flight", theta=1.0)
    assert np.allclose(whole.distance[2:], 5.45e-3 * np.arange(1, 11), atol=1e-9)


@pytest.mark.parametrize(("method", "horizon", "expected"), [("best", "flight", [8]), ("best", "step", [8, 9]), ("paper", "step", [8, 9])])
def test_a_bounce_is_inconsistent(method: Any, horizon: Any, expected: list[int]) -> None:
    (t, p), (u, q) = bounce(-1, 8), bounce(1, 8)
    found = physinc.find_inconsistencies(np.r_[t, u], np.r_[p, q], method=method, horizon=horizon, sd=1e-3)
    assert np.flatnonzero(found.inconsistent).tolist() == expected
    assert found.predicted.shape == (16, 3)
    assert found.inconsistent.dtype == np.bool_
    if method == "best":
        assert found.p_value[8] < 1e-3
        assert found.distance[8] > found.threshold[8]
        assert np.nanmin(np.delete(found.p_value, expected)) > 0.9


def test_noise_is_told_by_smoothness_and_false_alarms_are_rare() -> None:
    rng = np.random.default_rng(4)
    t = frames(40) / 2
    alarms = 0
    for _ in range(200):
        found = physinc.find_inconsistencies(t, parabola(t) + rng.normal(0, 1e-3, (40, 3)), sd=1e-3)
        alarms += int(found.inconsistent.any())
    assert alarms <= 3
    assert physinc.find_inconsistencies(t, parabola(t) + rng.normal(0, 1e-3, (40, 3))).sd == pytest.approx(1e-3, rel=0.4)


def test_what_inconsistencies_refuse() -> None:
    t = frames(5)
    options: list[tuple[dict[str, Any], str]] = [
        ({}, "8 would"),
        ({"method": "worst"}, "method must be"),
        ({"horizon": "year"}, "horizon must be"),
        ({"horizon": t}, r"^horizon must be \"step\" or \"flight\", got an array of shape \(5,\)$"),
        ({"method": t}, r"^method must be \"best\" or \"paper\", got an array of shape \(5,\)$"),
        ({"method": "paper", "law": t}, "under gravity alone"),
        ({"false_alarm": 0.0, "sd": 1.0}, "false_alarm = 0"),
        ({"method": "paper", "theta": np.nan}, "theta = NaN"),
        ({"method": "paper", "law": "free_fall_with_drag"}, "under gravity alone"),
        ({"gravity": None, "sd": 1.0}, "gravity must be 3 numbers"),
    ]
    for keywords, match in options:
        with pytest.raises(ValueError, match=match):
            physinc.find_inconsistencies(t, parabola(t), **keywords)


def test_accelerations_are_eq_4() -> None:
    t = frames(6)
    found = physinc.accelerations(t, parabola(t))
    assert np.isnan(found[:2]).all()
    assert np.allclose(found[2:], G, atol=1e-9)
    assert physinc.accelerations(t[:0], np.empty((0, 3))).shape == (0, 3)


# Contacts.


@pytest.mark.parametrize("method", ["best", "paper"])
def test_an_exact_bounce_is_recovered_to_micrometres(method: Any) -> None:
    contact = physinc.solve_contact(bounce(-1, 8), bounce(1, 8), method, radius=0.033, normal=[0, 0, 1])
    assert contact is not None
    assert contact.time == pytest.approx(T_HIT, abs=1e-6)
    assert np.allclose(contact.center, HIT, atol=2e-6)
    assert np.allclose(contact.velocity_before, V_IN, atol=1e-4)
    assert np.allclose(contact.velocity_after, V_OUT, atol=1e-4)
    assert contact.restitution == pytest.approx(2.3 / 3.1, abs=1e-4)
    assert contact.point is not None
    assert np.allclose(contact.point, HIT - [0, 0, 0.033], atol=2e-6)
    tangents = V_IN / np.linalg.norm(V_IN) + V_OUT / np.linalg.norm(V_OUT)
    assert contact.direction is not None
    assert np.allclose(contact.direction, tangents / np.linalg.norm(tangents), atol=1e-4)
    assert (contact.covariance is None) == (method == "paper")


def test_the_contact_tells_its_own_normal_and_covariance() -> None:
    rng = np.random.default_rng(5)
    off, chi2 = [], []
    for _ in range(100):
        (t, p), (u, q) = bounce(-1, 8), bounce(1, 8)
        noisy = (t, p + rng.normal(0, 1e-3, p.shape)), (u, q + rng.normal(0, 1e-3, q.shape))
        contact = physinc.solve_contact(*noisy, sd=1e-3)
        assert contact is not None
        assert contact.normal is not None
        assert contact.covariance is not None
        assert contact.state_covariance is not None
        assert contact.state_covariance.shape == (9, 9)
        assert contact.normal[2] > 0.98
        off.append(contact.center - HIT)
        chi2.append(off[-1] @ np.linalg.solve(contact.covariance, off[-1]))
    assert 0.7 < np.mean(chi2) / 3 < 1.4
    assert np.sqrt(np.mean(np.square(off))) < 1e-3


def test_flights_that_do_not_meet_are_no_contact() -> None:
    elsewhere = bounce(1, 8, HIT + np.array([0.0, 0.5, 0.0]))
    assert physinc.solve_contact(bounce(-1, 8), elsewhere) is None
    assert physinc.solve_contact(bounce(-1, 8), elsewhere, sd=1e-3) is None
    late = bounce(1, 8)[0] + 0.2, bounce(1, 8)[1]
    assert physinc.solve_contact(bounce(-1, 8), late) is None


@pytest.mark.parametrize("method", ["best", "paper"])
def test_too_few_measurements_are_no_contact(method: Any) -> None:
    for few in (0, 1, 2):
        assert physinc.solve_contact(bounce(-1, few), bounce(1, 8), method) is None
        assert physinc.solve_contact(bounce(-1, 8), bounce(1, few), method) is None
    assert physinc.solve_contact(bounce(-1, 3), bounce(1, 3), method) is not None


def test_what_a_contact_refuses() -> None:
    before, after = bounce(-1, 5), bounce(1, 5)
    cases: list[tuple[Any, Any, dict[str, Any], str]] = [
        (after, before, {}, "after begins at"),
        (before[0], after, {}, "before must be a pair"),
        ((before[0][::-1], before[1]), after, {}, "before: t must rise"),
        (before, (after[0], after[1][:, :2]), {}, "after: positions must be"),
        ((*before, np.eye(3)), after, {}, "before and after, or not at all"),
        (before, after, {"normal": [0, 0, 0]}, "normal must have a length"),
        (before, after, {"duration": -1.0}, "duration = -1"),
        (before, after, {"radius": np.nan}, "radius = NaN"),
        (before, after, {"method": "worst"}, "method must be"),
    ]
    for first, second, keywords, match in cases:
        with pytest.raises(ValueError, match=match):
            physinc.solve_contact(first, second, **keywords)


# Planes.


def contacts(heights: list[float], noise: float = 1e-3) -> list[physinc.ContactFit]:
    rng = np.random.default_rng(6)
    found = []
    for i, height in enumerate(heights):
        hit = np.array([0.3 * (i % 3), 1.2 + 0.25 * (i // 3), height + 0.033])
        incoming = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), -3.1])
        outgoing = incoming * [0.8, 0.8, -0.75]
        (t, p), (u, q) = bounce(-1, 8, hit, incoming), bounce(1, 8, hit, outgoing)
        sides = (t, p + rng.normal(0, noise, p.shape)), (u, q + rng.normal(0, noise, q.shape))
        contact = physinc.solve_contact(*sides, sd=noise, radius=0.033)
        assert contact is not None
        found.append(contact)
    return found


def test_floor_and_box_come_out_as_two() -> None:
    planes = physinc.fit_planes(contacts([0.0, 0.0, 0.09, 0.0, 0.09, 0.0, 0.0, 0.09, 0.0]))
    assert [plane.contacts for plane in planes] == [[0, 1, 3, 5, 6, 8], [2, 4, 7]]
    floor, box = planes
    assert abs(floor.offset) < 3e-3
    assert floor.normal[2] > 0.9999
    assert floor.restitution == pytest.approx(0.75, abs=0.02)
    assert floor.tilt < 0.02
    assert floor.covariance.shape == (4, 4)
    assert floor.outline.shape[1] == 3
    assert floor.above is None
    assert box.above is not None
    assert box.above.surface == 0
    assert box.above.height == pytest.approx(0.09, abs=3e-3)


def test_events_of_a_stream_make_the_planes_that_it_told() -> None:
    events = list(physinc.stream("demo"))
    touched = [event for event in events if isinstance(event, physinc.Contact) and event.final]
    surfaces = [event for event in events if isinstance(event, physinc.Surface) and event.final and event.merged_into is None]
    start = next(event for event in events if isinstance(event, physinc.CameraOrientation))
    assert start.gravity_in_camera.shape == (3,)
    planes = physinc.fit_planes(touched)
    told = sorted(surface.above.height for surface in surfaces if surface.above is not None)
    assert np.allclose(sorted(plane.above.height for plane in planes if plane.above is not None), told, atol=3e-3)


def test_what_planes_refuse() -> None:
    assert physinc.fit_planes([]) == []
    paper = physinc.solve_contact(bounce(-1, 8), bounce(1, 8), "paper", radius=0.033)
    best = physinc.solve_contact(bounce(-1, 8), bounce(1, 8))
    assert paper is not None
    assert best is not None
    with pytest.raises(ValueError, match="no covariance"):
        physinc.fit_planes([paper])
    with pytest.raises(ValueError, match="contact 0 has no point"):
        physinc.fit_planes([best])
    with pytest.raises(ValueError, match="at most 64"):
        physinc.fit_planes([best] * 65, radius=0.033)
    with pytest.raises(TypeError, match="number 0 is of"):
        physinc.fit_planes(["contact"])  # type: ignore[list-item]


# Anything.


@settings(max_examples=100, deadline=None)
@given(
    t=arrays(np.float64, st.integers(0, 12), elements=st.floats(allow_nan=True, allow_infinity=True)),
    positions=arrays(np.float64, st.tuples(st.integers(0, 12), st.integers(0, 4)), elements=st.floats(width=32)),
)
def test_whatever_comes_is_an_answer_or_an_error(t: Array, positions: Array) -> None:
    functions: list[Any] = [
        lambda: physinc.fit_flight(t, positions),
        lambda: physinc.fit_flight(t, positions, gravity=None, sd=1e-3),
        lambda: physinc.fit_flight(t, positions, "free_fall_with_drag", gravity=9.81),
        lambda: physinc.find_inconsistencies(t, positions, sd=1e-3),
        lambda: physinc.find_inconsistencies(t, positions, method="paper", horizon="flight"),
        lambda: physinc.solve_contact((t[:5], positions[:5]), (t[5:], positions[5:])),
        lambda: physinc.solve_contact((t[:5], positions[:5]), (t[5:], positions[5:]), "paper"),
        lambda: physinc.fit_sphere(positions, 0.033),
        lambda: physinc.accelerations(t, positions),
    ]
    for function in functions:
        with contextlib.suppress(ValueError):
            function()


def test_what_is_no_number_is_named() -> None:
    t = np.arange(10) / 30
    positions = np.column_stack([t, t, 1 - 4.9 * t**2])
    text: Any = "a"
    calls: dict[str, Callable[[], object]] = {
        "radius": lambda: physinc.fit_sphere(positions, text),
        "sd": lambda: physinc.fit_flight(t, positions, sd=text),
        "gravity": lambda: physinc.fit_scale(t, positions, gravity=text),
        "theta": lambda: physinc.find_inconsistencies(t, positions, theta=text),
        "false_alarm": lambda: physinc.find_inconsistencies(t, positions, false_alarm=text),
        "duration": lambda: physinc.solve_contact((t, positions), (t + 1, positions), duration=text),
        "spin_sd": lambda: physinc.fit_planes([], spin_sd=text),
    }
    for name, call in calls.items():
        with pytest.raises(TypeError, match=f"^{name} = 'a': expected a number$"):
            call()
    with pytest.raises(TypeError, match="contacts must be an iterable of Contact or ContactFit, got 5"):
        physinc.fit_planes(5)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["best", "paper"])
def test_a_normal_to_the_other_side_is_refused(method: Any) -> None:
    sides = bounce(-1, 8), bounce(1, 8)
    with pytest.raises(ValueError, match=r"^normal points away from the side the ball came from: give it with the other sign$"):
        physinc.solve_contact(*sides, method, normal=[0, 0, -1])
    # A wall that is only passed.
    for normal in ([0, 1, 0], [0, -1, 0]):
        assert physinc.solve_contact(*sides, method, normal=normal) is not None


def test_the_paper_fits_as_many_as_is_said() -> None:
    def solved(far: int) -> Any:
        (t, p), after = bounce(-1, 12), bounce(1, 12)
        p = p + (np.arange(12) == 11 - far)[:, None] * 0.01
        return physinc.solve_contact((t, p), after, "paper").center.tolist()  # type: ignore[union-attr]

    assert solved(7) != solved(8) == solved(9)
    assert PAPER_SIDE == 8
    assert "the eight measurements on" in (physinc.solve_contact.__doc__ or "")


def test_results_of_numbers_alone_are_copied_and_pickled() -> None:
    t = frames(20)
    rng = np.random.default_rng(2)
    directions = rng.normal(size=(50, 3))
    contact = physinc.solve_contact(bounce(-1, 8), bounce(1, 8), radius=0.033, sd=1e-3)
    assert contact is not None
    results = [
        physinc.fit_sphere(directions / np.linalg.norm(directions, axis=1)[:, None]),
        physinc.fit_scale(t, parabola(t)),
        physinc.find_inconsistencies(t, parabola(t)),
        *physinc.fit_planes([contact]),
    ]
    assert len(results) == 4
    for result in results:
        for other in (pickle.loads(pickle.dumps(result)), copy.copy(result), copy.deepcopy(result)):
            assert repr(other) == repr(result)
