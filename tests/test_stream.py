"""Streams: Python iterables, and how a stream begins and ends."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import frames, trajectory

import physinc
from physinc.cli import main


def flight() -> Iterator[physinc.Position]:
    t, centers = trajectory()
    noise = np.random.default_rng(2).normal(0, 1e-3, centers.shape)
    for now, center in zip(t, centers + noise, strict=True):
        yield physinc.Position(round(now * 1e9), center)


def names(events: list[physinc.Event]) -> list[str]:
    return [event.event for event in events]


def test_positions_from_a_csv_and_from_an_iterable_tell_the_same(tmp_path: Path) -> None:
    path = tmp_path / "flight.csv"
    rows = (f"{p.timestamp_ns}e-9," + ",".join(map(repr, p.center.tolist())) for p in flight())
    path.write_text("t,x,y,z\n" + "\n".join(rows) + "\n")
    vacuum = {"laws": {"drag": False}, "object": {"contact_duration": 0}}
    from_csv, from_iterable = (list(physinc.stream(source, config=vacuum)) for source in (path, flight()))
    assert from_csv[1:] == from_iterable[1:]
    assert names(from_csv).count("contact") == 3
    for contact in (event for event in from_csv if isinstance(event, physinc.Contact)):
        assert contact.normal is not None
        assert contact.normal[2] > 0.99
        assert abs(contact.center[2] - 0.033) < 3e-3


def test_frames_of_every_kind_and_layout_are_taken() -> None:
    stamps, depth = frames()["timestamps_ns"], frames()["depth_mm"]
    for image in (depth, depth.astype(np.float32) / 1000, np.asfortranarray(depth[0])[None].repeat(5, 0), depth[:, ::-1, ::-1]):
        events = list(physinc.stream(zip(stamps, image, strict=True)))
        assert names(events) == ["stream_started", "stream_ended"]
        assert isinstance(events[-1], physinc.StreamEnded)
        assert events[-1].counters.frames == 5


@pytest.mark.parametrize("kind", [np.uint16, np.float32])
def test_frames_are_read_row_by_row_in_whatever_order_of_memory(kind: type) -> None:
    rows, columns = np.mgrid[:480, :640]
    depth = (1000 + rows + 2 * columns).astype(np.uint16)
    for image in (np.asfortranarray(depth), np.ascontiguousarray(depth.T).T, depth[::-1][::-1], np.repeat(depth, 2, 1)[:, ::2]):
        given = image if kind is np.uint16 else image.astype(kind) / kind(1000)
        np.testing.assert_array_equal(newest(physinc.stream([(0, given)], frames=True)).depth_mm, depth)


def test_lists_are_instants_and_nan_is_not_seen() -> None:
    nowhere = [float("nan")] * 3
    items = [[physinc.Position(i, [0, 0, 1], track=1), physinc.Position(i, [1, 0, 1], track=2)] for i in range(3)]
    events = list(physinc.stream([*items, physinc.Position(3, nowhere)]))
    assert isinstance(events[-1], physinc.StreamEnded)
    assert events[-1].counters.frames == 4


def test_single_positions_of_equal_stamps_are_one_instant_as_in_a_list_and_in_a_csv(tmp_path: Path) -> None:
    instants = [[physinc.Position(p.timestamp_ns, p.center + np.array([i, 0, 0]), track=i) for i in range(2)] for p in flight()]
    singles = [position for instant in instants for position in instant]
    path = tmp_path / "two.csv"
    rows = (f"{p.timestamp_ns}e-9," + ",".join(map(repr, p.center.tolist())) + f",{p.track}" for p in singles)
    path.write_text("t,x,y,z,track\n" + "\n".join(rows) + "\n")
    one_by_one, in_lists, from_csv = (list(physinc.stream(source, positions=True))[1:] for source in (iter(singles), instants, path))
    assert one_by_one == in_lists == from_csv
    assert names(one_by_one).count("position") == len(singles)
    end = one_by_one[-1]
    assert isinstance(end, physinc.StreamEnded)
    assert (end.counters.frames, end.counters.frames_dropped) == (len(instants), 0)


@pytest.mark.parametrize(
    ("items", "error", "message"),
    [
        (5, TypeError, "is no source"),
        ([5], TypeError, "can't use"),
        ([(0, 1, 2)], TypeError, "can't use"),
        ([("0", np.zeros((480, 640), np.uint16))], TypeError, r"timestamp_ns = '0': expected an integer, ns"),
        ([(0.5, np.zeros((480, 640), np.uint16))], TypeError, r"timestamp_ns = 0\.5: expected an integer, ns"),
        ([(2**63, np.zeros((480, 640), np.uint16))], ValueError, r"timestamp_ns = 9223372036854775808: .* to 2\^63 - 1"),
        ([(0, [[1]])], TypeError, "depth must be"),
        ([(0, np.zeros((480, 640)))], TypeError, "float64"),
        ([(0, np.zeros(640, np.uint16))], TypeError, "depth must be"),
        ([(0, np.zeros((240, 320), np.uint16))], physinc.ConfigError, r"camera\.fx: expected fx, fy, cx and cy"),
        ([(0, np.zeros((480, 640), np.uint16)), (1, np.zeros((640, 480), np.uint16))], ValueError, "the camera is"),
        ([(0, np.zeros((480, 640), np.uint16)), (1, np.zeros((480, 640), np.float32))], ValueError, "integer samples"),
        ([(0, np.zeros((480, 640), np.uint16)), physinc.Position(1, [0, 0, 0])], ValueError, "mixed"),
        ([physinc.Position(0, [0, 0, 0]), (1, np.zeros((480, 640), np.uint16))], ValueError, "mixed"),
        ([[]], ValueError, "empty list"),
        ([[5]], TypeError, "can't use"),
        ([[physinc.Position(0, [0, 0, 0])] * 17], ValueError, "more than 16"),
        ([physinc.Position(0, [0, 0, 0])] * 17, ValueError, "does timestamp_ns stand still"),
        ([[physinc.Position(0, [0, 0, 0]), physinc.Position(1, [0, 0, 0])]], ValueError, "same timestamp_ns"),
        ([], physinc.RecordingError, "empty"),
        ([(0, np.zeros((0, 0), np.uint16))], physinc.ConfigError, r"camera\.width = 0"),
    ],
)
def test_items_that_are_no_input_are_refused(items: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        list(physinc.stream(items))


def test_a_camera_of_another_size_is_told() -> None:
    camera = {"fx": 288, "fy": 288, "cx": 160, "cy": 120}
    events = list(physinc.stream([(0, np.zeros((240, 320), np.uint16))], camera=camera))
    assert isinstance(events[0], physinc.StreamStarted)
    assert events[0].camera is not None
    assert (events[0].camera.width, events[0].camera.height) == (320, 240)


def told_before(error: type[BaseException], stream: physinc.Stream) -> tuple[list[physinc.Event], BaseException]:
    """What `stream` told before it raised `error`."""
    events: list[physinc.Event] = []
    with pytest.raises(error) as raised:
        events.extend(stream)
    assert list(stream) == []
    return events, raised.value


def test_what_an_iterable_raises_passes_unchanged_after_the_end_is_told() -> None:
    failure = RuntimeError("the tracker is gone")

    def tracker() -> Iterator[physinc.Position]:
        yield from flight()
        raise failure

    events, raised = told_before(RuntimeError, physinc.stream(tracker()))
    assert raised is failure
    whole = list(physinc.stream(flight()))
    assert events[:-1] == whole[:-1]
    end, usual = events[-1], whole[-1]
    assert isinstance(end, physinc.StreamEnded)
    assert isinstance(usual, physinc.StreamEnded)
    assert (end.reason, end.counters) == ("disconnected", usual.counters)


def test_an_item_that_is_no_input_ends_the_stream_as_a_broken_csv_does() -> None:
    events, _ = told_before(TypeError, physinc.stream([*flight(), "soon"]))  # type: ignore[list-item]
    assert isinstance(events[-1], physinc.StreamEnded)
    assert events[-1].reason == "disconnected"


def test_what_an_iterable_raises_first_and_ctrl_c_pass_at_once() -> None:
    def tracker(count: int, failure: BaseException) -> Iterator[physinc.Position]:
        yield from list(flight())[:count]
        raise failure

    assert told_before(RuntimeError, physinc.stream(tracker(0, RuntimeError())))[0] == []
    stream = physinc.stream(tracker(9, KeyboardInterrupt()))
    with pytest.raises(KeyboardInterrupt):
        assert "stream_ended" not in names(list(stream))


def test_an_iterable_is_pulled_no_further_than_needed() -> None:
    pulled: list[int] = []

    def tracker() -> Iterator[physinc.Position]:
        for i in range(1000):
            pulled.append(i)
            yield physinc.Position(i, [0, 0, 1])

    stream = physinc.stream(tracker())
    next(stream)
    stream.close()
    assert list(stream) == []
    assert pulled == [0, 1]


def test_a_stream_that_iterates_itself_says_so() -> None:
    streams: list[physinc.Stream] = []

    def tracker() -> Iterator[physinc.Position]:
        yield from (next(stream) for stream in streams)  # type: ignore[misc]

    streams.append(physinc.stream(tracker()))
    with pytest.raises(ValueError, match="already being iterated"):
        list(streams[0])


def test_who_iterates_goes_on_when_another_thread_is_refused() -> None:
    waiting, go_on = threading.Event(), threading.Event()

    def tracker() -> Iterator[physinc.Position]:
        yield physinc.Position(0, [0, 0, 1])
        waiting.set()
        go_on.wait(20)
        yield physinc.Position(1, [0, 0, 1])

    def intrude() -> None:
        waiting.wait(20)
        try:
            next(stream)
        except ValueError as error:
            refused.append(str(error))
        go_on.set()

    refused: list[str] = []
    stream = physinc.stream(tracker())
    other = threading.Thread(target=intrude)
    other.start()
    events = list(stream)
    other.join()
    assert refused == ["the stream is already being iterated"]
    assert isinstance(events[-1], physinc.StreamEnded)
    assert (events[-1].reason, events[-1].counters.frames) == ("end_of_source", 2)


def test_stopping_early_ends_the_thread(csv: Path) -> None:
    before = len(list(Path("/proc/self/task").iterdir())) if Path("/proc/self/task").exists() else None
    for _ in range(50):
        with physinc.stream(csv) as stream:
            next(stream)
        assert list(stream) == []
    if before is not None:
        deadline = time.monotonic() + 5
        while len(list(Path("/proc/self/task").iterdir())) > before and time.monotonic() < deadline:
            time.sleep(0.01)
        assert len(list(Path("/proc/self/task").iterdir())) <= before


def test_an_interrupted_stream_tells_its_end(csv: Path) -> None:
    for source in (csv, flight()):
        # With positions there is more to tell than is read ahead.
        stream = physinc.stream(source, positions=True)
        next(stream)
        stream.interrupt()
        last = list(stream)[-1]
        assert isinstance(last, physinc.StreamEnded)
        assert last.reason == "interrupted"


def test_silence_is_a_timeout_that_may_be_waited_out() -> None:
    script = (
        "import physinc\n"
        "stream = physinc.stream('-', timeout=0.2)\n"
        "try: next(stream)\n"
        "except TimeoutError as error: print(type(error).__name__, error, flush=True)\n"
        "while True:\n"
        "    try: print(next(stream).event, flush=True)\n"
        "    except TimeoutError: continue\n"
        "    except StopIteration: break\n"
    )
    with subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("StreamTimeoutError no input for 0.")
        out, _ = process.communicate("t,x,y,z\n0,0,0,1\n", timeout=20)
    assert out.split()[0] == "stream_started"
    assert out.split()[-1] == "stream_ended"


@pytest.mark.parametrize("timeout", [0, -1, float("nan")])
def test_a_timeout_that_cannot_be(timeout: float) -> None:
    with pytest.raises(ValueError, match="timeout"):
        physinc.stream("demo", timeout=timeout)


def newest(stream: physinc.Stream) -> physinc.Frame:
    """Its newest image, after its end."""
    list(stream)
    assert stream.frame is not None
    return stream.frame


def test_images_are_those_that_were_sent() -> None:
    arrays = frames()
    stamps, depth = arrays["timestamps_ns"], arrays["depth_mm"] + np.arange(5, dtype=np.uint16)[:, None, None]
    depth[:, 0, 0] = 0
    for kind in (depth, np.where(depth == 0, np.nan, depth / 1000).astype(np.float32)):
        frame = newest(physinc.stream(zip(stamps, kind, strict=True), frames=True))
        assert (frame.frame, frame.timestamp_ns, frame.disparity) == (4, stamps[4], None)
        np.testing.assert_array_equal(frame.depth_mm, depth[4])
        assert frame.depth_mm is not frame.depth_mm


def test_images_of_packets_are_disparity(tmp_path: Path) -> None:
    capture, arrays = tmp_path / "packets.pcapng", tmp_path / "frames.npz"
    assert main(["record", "sim:room?packets=true", str(capture), "--frames", "3"]) == 0
    assert main(["record", str(capture), str(arrays)]) == 0
    frame = newest(physinc.stream(capture, frames=True))
    disparity = np.load(arrays)["disparity"][frame.frame]
    np.testing.assert_array_equal(frame.disparity, disparity)
    np.testing.assert_array_equal(frame.depth_mm > 0, disparity < 2047)
    assert 1000 < np.median(frame.depth_mm[frame.depth_mm > 0]) < 4000


def test_images_that_nobody_asked_for() -> None:
    with pytest.raises(ValueError, match=r"frames=True"):
        _ = physinc.stream("demo").frame


def test_other_threads_run_while_a_stream_works() -> None:
    ticks = 0
    done = threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.wait(0.001):
            ticks += 1

    thread = threading.Thread(target=tick)
    thread.start()
    frames_seen = list(physinc.stream("demo"))[-1]
    done.set()
    thread.join()
    assert isinstance(frames_seen, physinc.StreamEnded)
    assert ticks > 0


def test_counters_and_reasons(csv: Path) -> None:
    stream = physinc.stream(csv, positions=True)
    events = list(stream)
    assert isinstance(events[-1], physinc.StreamEnded)
    assert stream.stats == events[-1].counters
    assert stream.stats.events == len(events)
    assert stream.busy > 0


@pytest.mark.parametrize("reconnect", [-1, -0.5, float("nan"), float("-inf")])
def test_nobody_is_away_for_less_than_no_time(csv: Path, reconnect: float) -> None:
    for source in (csv, flight()):
        with pytest.raises(ValueError, match=rf"^reconnect = {reconnect}: expected True, False, or seconds, at least 0$"):
            physinc.stream(source, reconnect=reconnect)
    for seconds in (0, 0.5, True, False):
        assert list(physinc.stream(csv, reconnect=seconds))
