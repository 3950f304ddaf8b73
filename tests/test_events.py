"""Events: classes that work with match, dict, JSON, pickle."""

from __future__ import annotations

import copy
import inspect
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import physinc
from physinc import _physinc


@pytest.fixture(scope="module")
def events() -> list[Any]:
    return list(physinc.stream("demo", positions=True, provisional=True))


def test_the_demo_tells_of_bounces_off_a_floor_and_a_box(events: list[Any]) -> None:
    assert isinstance(events[0], physinc.StreamStarted)
    assert isinstance(events[-1], physinc.StreamEnded)
    assert events[0].source == "demo"
    assert events[-1].counters.events == len(events)
    contacts = [event for event in events if isinstance(event, physinc.Contact) and event.final]
    assert len(contacts) >= 10
    last = {event.id: event for event in events if isinstance(event, physinc.Surface)}
    heights = [surface.above.height for surface in last.values() if surface.above is not None and surface.merged_into is None]
    assert np.allclose(heights, [0.09], atol=3e-3)


def test_every_event_is_the_same_in_each_form(events: list[Any]) -> None:
    for event in events:
        fields = event.to_dict()
        assert json.loads(event.to_json()) == fields
        assert fields["event"] == event.event
        assert list(fields)[4:] == list(type(event).__match_args__)
        assert pickle.loads(pickle.dumps(event)) == event == copy.copy(event)
        assert {event: 1}[pickle.loads(pickle.dumps(event))] == 1
        for name in ("timestamp_ns", "track", "final", *type(event).__match_args__):
            value = getattr(event, name)
            shown = fields[name]
            if isinstance(value, np.ndarray):
                assert value.dtype == np.float64
                assert value.tolist() == shown
            elif hasattr(value, "to_dict"):
                assert value.to_dict() == shown
                assert pickle.loads(pickle.dumps(value)) == value == copy.copy(value) == copy.deepcopy(value)
            else:
                assert value == shown
        with pytest.raises(AttributeError):
            event.track = 7
        assert repr(event).startswith(f"{type(event).__name__}(")


def test_match_takes_fields_by_name_and_by_place(events: list[Any]) -> None:
    match events[0]:
        case physinc.StreamStarted(source, camera=physinc.CameraModel() as camera):
            assert (source, camera.width) == ("demo", 640)
        case _:
            pytest.fail("no match")


def test_every_event_class_is_in_the_union() -> None:
    classes = {kind for kind in vars(_physinc).values() if inspect.isclass(kind) and hasattr(kind, "to_json")}
    assert classes == set(physinc.Event.__args__)


def test_a_position_is_input_and_event() -> None:
    position = physinc.Position(7, [1, 2, 3])
    assert (position.timestamp_ns, position.track, position.covariance) == (7, None, None)
    assert position.center.tolist() == [1, 2, 3]
    assert json.loads(position.to_json())["covariance"] is None
    assert pickle.loads(pickle.dumps(position)) == position
    assert position != physinc.Position(8, [1, 2, 3])
    assert physinc.Position(7, (1, 2, 3), np.eye(3) * 1e-6, track=4).track == 4


@pytest.mark.parametrize(
    ("center", "covariance", "message"),
    [
        ([1, 2], None, "center must be 3 numbers"),
        ("abc", None, "center must be 3 numbers"),
        ([1, 2, np.inf], None, "finite metres"),
        ([1, 2, 1e9], None, "within 1e6"),
        ([1, 2, 3], [1, 2, 3], "3 rows of 3"),
        ([1, 2, 3], -np.eye(3), "positive definite"),
        ([1, 2, 3], np.full((3, 3), np.nan), "finite"),
        ([1, 2, 3], [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]], "symmetric"),
    ],
)
def test_a_position_that_cannot_be_is_refused(center: Any, covariance: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        physinc.Position(0, center, covariance)


@pytest.mark.parametrize(
    ("stamp", "track", "error", "message"),
    [
        (0.5, None, TypeError, r"timestamp_ns = 0\.5: expected an integer, ns"),
        (2**63, None, ValueError, r"timestamp_ns = 9223372036854775808: expected"),
        (0, -1, ValueError, r"track = -1: expected an integer from 0"),
        (0, 2**32, ValueError, r"track = 4294967296: expected an integer from 0"),
        (0, "ball", TypeError, r"track = 'ball': expected an integer from 0"),
    ],
)
def test_stamps_and_tracks_that_cannot_be_are_named(stamp: Any, track: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        physinc.Position(stamp, [0, 0, 1], track=track)


@given(st.lists(st.floats(), min_size=3, max_size=3), st.integers(-(2**63), 2**63 - 1))
def test_any_floats_make_a_position_or_a_value_error(center: list[float], stamp: int) -> None:
    try:
        position = physinc.Position(stamp, center)
    except ValueError:
        assert not np.isnan(center).any()
        assert not (np.abs(center) <= 1e6).all()
    else:
        assert "NaN" not in position.to_json()
        assert pickle.loads(pickle.dumps(position)) == position


def test_tracks_predict_where_the_ball_will_be(csv: Path) -> None:
    predicted = False
    with physinc.stream(csv, positions=True) as stream:
        for event in stream:
            if isinstance(event, physinc.Position) and event.timestamp_ns == 300_000_000:
                assert event.track is not None
                track = stream.tracks[event.track]
                center, covariance = track.predict(0.35)
                assert track.predict(timestamp_ns=350_000_000)[0].tolist() == center.tolist()
                assert np.allclose(center, [0.14, 2.0, 1 - 9.81 / 2 * 0.35**2], atol=0.02)
                assert (np.linalg.eigvalsh(covariance) > 0).all()
                predicted = True
                with pytest.raises(TypeError):
                    track.predict()
                with pytest.raises(TypeError):
                    track.predict(float("nan"))
    assert predicted
