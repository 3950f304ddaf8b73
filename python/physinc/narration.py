"""What happened, told to people."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape

from . import _physinc as p
from .event import Event

if TYPE_CHECKING:
    from typing_extensions import Self


class Plain(Console):
    """A console that leaves closed pipes to the command line."""

    def on_broken_pipe(self) -> None:
        """Say that nobody reads any more."""
        raise BrokenPipeError


class Progress:
    """A line on stderr that says how much was recorded."""

    def __init__(self, out: Path, frames: int | None) -> None:
        self.out, self.frames = out, frames
        self.count, self.start_ns, self.newest_ns = 0, 0, 0
        self.lost = self.bytes = 0
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.status = self.console.status(self._line())

    def __enter__(self) -> Self:
        self.status.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.status.stop()
        if self.count:
            self.console.print(self._line())

    def tell(self, counters: p.Counters, size: int, timestamp_ns: int | None = None) -> None:
        """Show what came so far, the newest frame of `timestamp_ns` if that is known, and that `size` bytes are written."""
        if timestamp_ns is not None:
            self.start_ns = self.start_ns if self.count else timestamp_ns
            self.newest_ns = timestamp_ns
        self.count, self.lost, self.bytes = counters.frames, counters.packets_lost, size
        self.status.update(self._line())

    def _line(self) -> str:
        of = f" of {self.frames}" if self.frames is not None else ""
        seconds = (self.newest_ns - self.start_ns) * 1e-9
        lost = count(self.lost, "packet")
        return escape(f"{self.out}: {self.count}{of} frames, {seconds:.1f} s, {lost} lost, {self.bytes / 1e6:.1f} MB")


class Narration:
    """Prints bounces and what becomes active as they are told, and at the end the surfaces and a line of counters."""

    def __init__(self, console: Console | None = None) -> None:
        self.console = console or Plain(highlight=False, soft_wrap=True)
        self.start_ns = 0
        self.camera: p.CameraModel | None = None
        self.surfaces: dict[int, p.Surface] = {}
        self.restitutions: list[tuple[int, float]] = []
        self.orientation: p.CameraOrientation | None = None
        self.motion: p.CameraMotion | None = None
        self.moved = 0
        self.bounces = self.lost = 0
        self.active: dict[int | None, bool] = {}
        self.ended: p.StreamEnded | None = None

    def tell(self, event: Event) -> None:
        """Print `event` if people want to read it, and keep what the end will need."""
        match event:
            case p.StreamStarted():
                self.start_ns = event.timestamp_ns
                self.camera = event.camera
                self.console.print(f"[dim]{event.source}[/]")
            case p.Position():
                self._line(event.timestamp_ns, f"[dim]ball {event.track} at {_point(event.center, event.covariance)}[/]")
            case p.Contact():
                self._line(event.time_ns, _bounce(event))
                if event.final:
                    self.bounces += 1
                    if event.restitution is not None and event.surface is not None:
                        self.restitutions.append((event.surface, event.restitution))
            case p.Surface():
                self.surfaces[event.id] = event
            case p.CameraOrientation():
                self.orientation = event
            case p.CameraMotion():
                self.motion = event
                self.moved += 1
            case p.Activity():
                self._activity(event)
            case p.StreamEnded():
                self.ended = event
            case _:
                self._warn(event)

    def _activity(self, event: p.Activity) -> None:
        """Print that an object became active or passive: of its intervals, only what changes."""
        if self.active.get(event.track, False) != event.active:
            self.active[event.track] = event.active
            what = f"[bold]object {event.track} is {'active' if event.active else 'passive'}[/]"
            self._line(event.start_ns, f"{what} (p = {event.probability if event.active else 1 - event.probability:.3f})")

    def _warn(self, event: Event) -> None:
        """Print what is wrong with device or camera."""
        match event:
            case p.LevelDisagreement():
                angle = f"{math.degrees(event.angle):.1f}{_sd(event.sd, 180 / math.pi, 1)}°"
                self._line(event.timestamp_ns, f"[yellow]the accelerometer is {angle} off what {count(event.flights, 'flight')} show[/]")
            case p.Gap():
                if event.reason != "stalled":  # Those are frames that came, and are not used.
                    self.lost += event.frames or 0
                if event.reason == "packets_lost" and not event.frames:
                    return  # Only parts of a frame are missing: the last line counts them.
                seconds = (event.end_ns - event.start_ns) * 1e-9
                self._line(event.start_ns, f"[yellow]nothing for {seconds:.3f} s ({event.reason.replace('_', ' ')})[/]")
            case p.Disconnected() | p.Reconnected():
                self._line(event.timestamp_ns, f"[yellow]the device is {event.event} ({event.reason.replace('_', ' ')})[/]")

    def close(self, busy: float) -> None:
        """Print what was found; the engine worked for `busy` seconds."""
        surfaces = [surface for surface in self.surfaces.values() if surface.merged_into is None]
        for surface in surfaces:
            self.console.print(self._surface(surface))
        if self.orientation is not None:
            roll, pitch = math.degrees(self.orientation.roll), math.degrees(self.orientation.pitch)
            size = float(np.linalg.norm(self.orientation.gravity_in_camera))
            # Positions come in the world: there is no camera to be turned.
            camera = "" if self.camera is None else f"camera: roll {roll:.2f}°, pitch {pitch:.2f}°; "
            self.console.print(f"{camera}gravity {size:.3f} m/s², of {count(self.orientation.flights, 'flight')}")
        if self.motion is not None:
            where = f"camera: {_point(self.motion.displacement, self.motion.covariance)} from where it was at first"
            taken = ", ".join(word.replace("_", " ") for word in self.motion.undetermined)
            open_ = f" (not told by physics: {taken})" if taken else ""
            self.console.print(f"{where}, path of {count(self.moved, 'frame')}{open_}")
        if self.ended is not None:
            counters = self.ended.counters
            rate = f", {busy / counters.frames * 1e6:.0f} µs a frame" if counters.frames else ""
            dropped = f", {counters.frames_dropped} not used" if counters.frames_dropped else ""
            unheard = (
                f", {counters.events_dropped} positions or events dropped (more than 16 objects at once, or a queue that was full)"
                if counters.events_dropped
                else ""
            )
            reason = "" if self.ended.reason == "end_of_source" else f" ({self.ended.reason})"
            lost, holed = counters.packets_lost, counters.frames_incomplete
            packets = f", {lost} of {counters.packets + lost} packets lost, {holed} frames with holes" if lost else ""
            frames = f"{counters.frames} frames, {self.lost} lost{dropped}{packets}{unheard}{rate}"
            self.console.print(f"{count(self.bounces, 'bounce')}, {count(len(surfaces), 'surface')}; {frames}{reason}")

    def _line(self, time_ns: int, text: str) -> None:
        self.console.print(f"{(time_ns - self.start_ns) * 1e-9:9.4f} s  {text}")

    def _surface(self, surface: p.Surface) -> str:
        parts = [f"[bold]{self._name(surface.id)}[/]"]
        if surface.above is not None:
            height = f"{surface.above.height * 1e3:.2f}{_sd(surface.above.sd, 1e3, 2)}"
            parts.append(f"{height} mm above {self._name(surface.above.surface)}")
        if surface.outline is not None and len(surface.outline):
            center = np.mean(surface.outline, axis=0)
            # How well the plane is known there, along its normal.
            across = np.append(center, -1.0)
            sd = None if surface.covariance is None else math.sqrt(max(across @ surface.covariance @ across, 0.0))
            parts.append(f"around {_vector(center, 4)}{_sd(sd, 1e3, 2)}{'' if sd is None else ' mm'}")
        parts.append(f"normal {_vector(surface.normal, 3)}")
        if surface.tilt is not None:
            parts.append(f"tilt {math.degrees(surface.tilt):.2f}{_sd(surface.tilt_sd, 180 / math.pi, 2)}°")
        restitutions = [e for contact, e in self.restitutions if self._merged(contact) == surface.id]
        if restitutions:
            parts.append(f"restitution {np.mean(restitutions):.3f}")
        parts.append(count(surface.contacts, "bounce"))
        return ", ".join(parts)

    def _name(self, surface: int) -> str:
        known = self.surfaces.get(surface)
        return known.name if known is not None and known.name else f"surface {surface}"

    def _merged(self, surface: int) -> int:
        """Return what became of `surface`."""
        known = self.surfaces.get(surface)
        return surface if known is None or known.merged_into is None else self._merged(known.merged_into)


def _bounce(contact: p.Contact) -> str:
    where = _point(contact.center if contact.point is None else contact.point, contact.covariance)
    speeds = ""
    if contact.velocity_before is not None and contact.velocity_after is not None:
        speeds = f"  {np.linalg.norm(contact.velocity_before):.2f} → {np.linalg.norm(contact.velocity_after):.2f} m/s"
    normal = "" if contact.normal is None else f"  normal {_vector(contact.normal, 3)}"
    restitution = "" if contact.restitution is None else f"  restitution {contact.restitution:.3f}"
    surface = "" if contact.surface is None else f"  surface {contact.surface}"
    early = "" if contact.final else "  [dim](so far)[/]"
    return f"[bold]bounce[/] of ball {contact.track} at {where}{speeds}{normal}{restitution}{surface}{early}"


def _point(center: NDArray[np.float64], covariance: NDArray[np.float64] | None) -> str:
    sd = None if covariance is None else math.sqrt(max(np.trace(covariance) / 3, 0.0))
    return f"{_vector(center, 4)}{_sd(sd, 1e3, 1)}{'' if sd is None else ' mm'}"


def _vector(v: NDArray[np.float64], digits: int) -> str:
    return "(" + ", ".join(f"{x:+.{digits}f}" for x in v) + ")"


def _sd(sd: float | None, scale: float, digits: int) -> str:
    return "" if sd is None else f" ± {sd * scale:.{digits}f}"


def count(n: int, noun: str) -> str:
    """`1 flight`, `2 flights`."""
    return f"{n} {noun}{'' if n == 1 else 's'}"


def remark(source: str, remarks: list[str]) -> None:
    """Tell on stderr what the user should know of a source."""
    for line in remarks:
        sys.stderr.write(f"physinc: {source}: {line}\n")
