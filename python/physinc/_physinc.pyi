import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Self

from .arrays import Law
from .config import CameraConfig, Config

__all__ = [
    "PAPER_SIDE",
    "Above",
    "Activity",
    "CameraModel",
    "CameraMotion",
    "CameraOrientation",
    "Contact",
    "ContactFit",
    "Counters",
    "Disconnected",
    "FlightFit",
    "Frame",
    "Gap",
    "Inconsistencies",
    "Inconsistency",
    "LevelDisagreement",
    "PlaneFit",
    "Position",
    "Reconnected",
    "Recording",
    "ScaleFit",
    "SphereFit",
    "Stream",
    "StreamEnded",
    "StreamStarted",
    "Surface",
    "Track",
    "TrackEnded",
    "TrackStarted",
    "VideoFrame",
    "__version__",
    "accelerations",
    "camera_file",
    "dump_config",
    "event_from_toml",
    "find_inconsistencies",
    "fit_flight",
    "fit_from_toml",
    "fit_planes",
    "fit_scale",
    "fit_sphere",
    "level_pose",
    "open_iterable",
    "open_recording",
    "open_source",
    "part_from_toml",
    "read_positions",
    "scenes",
    "simulate",
    "solve_contact",
    "split_flights",
    "truth",
    "unpack_disparity",
]

_Array: TypeAlias = NDArray[np.float64]
_Config: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | Config | None
_Camera: TypeAlias = str | os.PathLike[str] | Mapping[str, Any] | CameraConfig | None
_Side: TypeAlias = tuple[ArrayLike, ArrayLike, ArrayLike | None]
_TrackReason: TypeAlias = Literal["appeared", "lost", "left_view", "merged", "stream_ended"]
_Undetermined: TypeAlias = Literal["heading", "velocity", "acceleration_or_gravity", "unseen_motion"]

@final
class CameraModel:
    """The intrinsics, px."""

    @property
    def width(self) -> int:
        """Columns, px."""
    @property
    def height(self) -> int:
        """Rows, px."""
    @property
    def fx(self) -> float:
        """Focal length in columns, px."""
    @property
    def fy(self) -> float:
        """Focal length in rows, px."""
    @property
    def cx(self) -> float:
        """Principal point, column, px."""
    @property
    def cy(self) -> float:
        """Principal point, row, px."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class Above:
    """A parallel surface below."""

    @property
    def surface(self) -> int:
        """Its id."""
    @property
    def height(self) -> float:
        """How far below, m."""
    @property
    def sd(self) -> float | None:
        """Standard deviation of `height`, m."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class Counters:
    """What went through a stream."""

    @property
    def frames(self) -> int:
        """Frames (or instants of positions) delivered by the source."""
    @property
    def frames_dropped(self) -> int:
        """Of these, not used: their stamp stood still or went back, or they showed more pieces of foreground than can be told apart."""
    @property
    def frames_incomplete(self) -> int:
        """Of these, with samples missing."""
    @property
    def packets(self) -> int:
        """Packets delivered by the source."""
    @property
    def packets_lost(self) -> int:
        """Packets that never came."""
    @property
    def packets_invalid(self) -> int:
        """Packets that made no sense."""
    @property
    def events(self) -> int:
        """Events told."""
    @property
    def events_dropped(self) -> int:
        """Events that a full queue swallowed (never contacts), and positions of more objects than are tracked at once."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    __hash__: ClassVar[None]  # type: ignore[assignment]
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class StreamStarted:
    """The stream began."""

    __match_args__ = ("source", "camera", "world_from_camera")
    @property
    def event(self) -> Literal["stream_started"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def source(self) -> str:
        """The source, as it was named."""
    @property
    def camera(self) -> CameraModel | None:
        """The camera; `None` for positions."""
    @property
    def world_from_camera(self) -> _Array:
        """The pose that fixes the stream's world [4, 4]."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Position:
    """An object was seen here.

    Made by a user it is input for a stream: `center` and `covariance` in the world frame, m and m². A center with NaN says that it
    wasn't seen at that instant.
    """

    def __new__(cls, timestamp_ns: int, center: ArrayLike, covariance: ArrayLike | None = None, track: int | None = None) -> Self: ...
    __match_args__ = ("frame", "center", "center_in_camera", "covariance", "points", "residual_rms")
    @property
    def event(self) -> Literal["position"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def frame(self) -> int:
        """Index of the frame as delivered, from 0."""
    @property
    def center(self) -> _Array:
        """Center in the world [3], m."""
    @property
    def center_in_camera(self) -> _Array | None:
        """Center in the camera frame [3], m; `None` for positions."""
    @property
    def covariance(self) -> _Array | None:
        """Of `center` [3, 3], m²; None where nobody knows.

        Of any shape it includes what has drifted since its first view, which positions near in time have in common: they differ by less.
        """
    @property
    def points(self) -> int | None:
        """Pixels that took part."""
    @property
    def residual_rms(self) -> float | None:
        """Root mean square of their distances from the fitted surface, m."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class TrackStarted:
    """A track began."""

    __match_args__ = ("reason",)
    @property
    def event(self) -> Literal["track_started"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def reason(self) -> _TrackReason:
        """Why."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class TrackEnded:
    """A track ended."""

    __match_args__ = ("reason",)
    @property
    def event(self) -> Literal["track_ended"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def reason(self) -> _TrackReason:
        """Why."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Inconsistency:
    """Measurement and prediction disagree (Eq. 3, or the whitened test)."""

    __match_args__ = ("predicted", "measured", "distance", "threshold", "p_value")
    @property
    def event(self) -> Literal["inconsistency"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def predicted(self) -> _Array:
        """Center by the laws of physics [3], world, m."""
    @property
    def measured(self) -> _Array:
        """Center as measured [3], world, m."""
    @property
    def distance(self) -> float:
        """Between the two, m."""
    @property
    def threshold(self) -> float:
        """What `distance` exceeded, m: θ, or the distance in that direction at which the whitened test alarms."""
    @property
    def p_value(self) -> float | None:
        """Probability of such a distance without a cause."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Contact:
    """The object touched something."""

    __match_args__ = (
        "id",
        "time_ns",
        "time_sd",
        "center",
        "point",
        "covariance",
        "normal",
        "direction",
        "velocity_before",
        "velocity_after",
        "restitution",
        "surface",
    )
    @property
    def event(self) -> Literal["contact"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def id(self) -> int:
        """Unique among contacts."""
    @property
    def time_ns(self) -> int:
        """First touch, between frames, ns."""
    @property
    def time_sd(self) -> float | None:
        """Standard deviation of `time_ns`, s."""
    @property
    def center(self) -> _Array:
        """Center of the ball at first touch [3], world, m."""
    @property
    def point(self) -> _Array | None:
        """Where it touched [3]: center − radius · normal, world, m."""
    @property
    def covariance(self) -> _Array:
        """Of `center` [3, 3], m²."""
    @property
    def normal(self) -> _Array | None:
        """Unit normal of the surface [3], to the side the ball came from, world."""
    @property
    def direction(self) -> _Array | None:
        """The paper's [3]: normalised mean of the two unit tangents along the motion; `None` where they cancel."""
    @property
    def velocity_before(self) -> _Array | None:
        """At first touch [3], world, m/s."""
    @property
    def velocity_after(self) -> _Array | None:
        """At last touch [3], world, m/s."""
    @property
    def restitution(self) -> float | None:
        """Speed away from the surface over speed into it."""
    @property
    def surface(self) -> int | None:
        """Which surface; `None` on an edge, or where none is known."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Surface:
    """A plane that was touched, or is known."""

    __match_args__ = (
        "id",
        "name",
        "normal",
        "offset",
        "covariance",
        "tilt",
        "tilt_sd",
        "contacts",
        "outline",
        "above",
        "merged_into",
    )
    @property
    def event(self) -> Literal["surface"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def id(self) -> int:
        """Unique among surfaces."""
    @property
    def name(self) -> str | None:
        """As configured."""
    @property
    def normal(self) -> _Array:
        """Unit normal [3], to the contacts' side, world."""
    @property
    def offset(self) -> float:
        """normal · p = offset, m."""
    @property
    def covariance(self) -> _Array | None:
        """Of (normal, offset) [4, 4], units of normal 1 and of offset m."""
    @property
    def tilt(self) -> float | None:
        """Angle between the normal and up, rad."""
    @property
    def tilt_sd(self) -> float | None:
        """Standard deviation of `tilt`, rad."""
    @property
    def contacts(self) -> int:
        """How many contacts it rests on."""
    @property
    def outline(self) -> _Array | None:
        """Convex hull of the touched points on the plane [N, 3], world, m."""
    @property
    def above(self) -> Above | None:
        """The parallel surface below it."""
    @property
    def merged_into(self) -> int | None:
        """The surface that this one turned out to be."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class CameraOrientation:
    """Gravity as the flights show it."""

    __match_args__ = ("id", "gravity_in_camera", "roll", "pitch", "covariance", "flights", "undetermined")
    @property
    def event(self) -> Literal["camera_orientation"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def id(self) -> int:
        """Unique among camera orientations."""
    @property
    def gravity_in_camera(self) -> _Array:
        """Measured acceleration without drag [3], its length kept, camera frame, m/s²."""
    @property
    def roll(self) -> float:
        """atan2(gx, gy), rad."""
    @property
    def pitch(self) -> float:
        """atan2(−gz, √(gx² + gy²)), rad."""
    @property
    def covariance(self) -> _Array:
        """Of `gravity_in_camera` [3, 3], (m/s²)²."""
    @property
    def flights(self) -> int:
        """Flights that it rests on."""
    @property
    def undetermined(self) -> list[_Undetermined]:
        """What no flight tells of it."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class CameraMotion:
    """How far the camera has moved (sec. 3.1 ii): one for each frame in which something was tracked."""

    __match_args__ = ("id", "frame", "displacement", "covariance", "undetermined")
    @property
    def event(self) -> Literal["camera_motion"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def id(self) -> int:
        """Unique among camera motions."""
    @property
    def frame(self) -> int:
        """Index of the frame, as delivered, from 0."""
    @property
    def displacement(self) -> _Array:
        """Of the optical center since the first frame [3], world axes, m."""
    @property
    def covariance(self) -> _Array:
        """Of `displacement` [3, 3], m²; as far as what is `undetermined` is as was assumed."""
    @property
    def undetermined(self) -> list[_Undetermined]:
        """What neither objects nor static structure tell of it."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Activity:
    """Whether an object moves by a force of its own (sec. 3.3). The final ones of a track cover each of its frames once."""

    __match_args__ = ("id", "start_ns", "end_ns", "active", "probability")
    @property
    def event(self) -> Literal["activity"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def id(self) -> int:
        """Unique among activities."""
    @property
    def start_ns(self) -> int:
        """First frame of the interval, ns."""
    @property
    def end_ns(self) -> int:
        """Last frame of the interval, ns."""
    @property
    def active(self) -> bool:
        """Whether no law of passive objects explains it."""
    @property
    def probability(self) -> float:
        """Of `active` being true of it: near 0 for a passive object."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class LevelDisagreement:
    """Flights show that the accelerometer's level, `gravity_in_camera` of the configuration, is off. Told once in a stream."""

    __match_args__ = ("gravity_in_camera", "gravity_by_accelerometer", "angle", "sd", "p_value", "flights")
    @property
    def event(self) -> Literal["level_disagreement"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def gravity_in_camera(self) -> _Array:
        """As the flights show it [3], camera frame, m/s²."""
    @property
    def gravity_by_accelerometer(self) -> _Array:
        """As the accelerometer tells it [3], camera frame, m/s²."""
    @property
    def angle(self) -> float:
        """Between the two, rad."""
    @property
    def sd(self) -> float:
        """Standard deviation of `angle` if the two were one, rad: the flights' own, and 0.5° of an accelerometer that is right."""
    @property
    def p_value(self) -> float:
        """Probability of such an angle then."""
    @property
    def flights(self) -> int:
        """Flights that it rests on."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Gap:
    """Input is missing."""

    __match_args__ = ("start_ns", "end_ns", "reason", "frames", "packets", "samples")
    @property
    def event(self) -> Literal["gap"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def start_ns(self) -> int:
        """Newest input before it, ns."""
    @property
    def end_ns(self) -> int:
        """Oldest input after it, ns."""
    @property
    def reason(self) -> Literal["packets_lost", "frames_lost", "stalled", "disconnected"]:
        """What went missing."""
    @property
    def frames(self) -> int | None:
        """Frames lost."""
    @property
    def packets(self) -> int | None:
        """Packets lost."""
    @property
    def samples(self) -> int | None:
        """Samples lost."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Disconnected:
    """The device is gone."""

    __match_args__ = ("reason",)
    @property
    def event(self) -> Literal["disconnected"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def reason(self) -> Literal["unplugged", "usb_error"]:
        """Why."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class Reconnected:
    """The device is back, and the stream goes on."""

    __match_args__ = ("reason",)
    @property
    def event(self) -> Literal["reconnected"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def reason(self) -> Literal["same_serial", "same_port"]:
        """By what it was recognised."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

@final
class StreamEnded:
    """The stream is over."""

    __match_args__ = ("reason", "counters")
    @property
    def event(self) -> Literal["stream_ended"]:
        """The event's name."""
    @property
    def timestamp_ns(self) -> int:
        """Stamp of the newest input that it used, ns on the stream's clock."""
    @property
    def track(self) -> int | None:
        """The track, from 1; None where none or all."""
    @property
    def final(self) -> bool:
        """Nothing will replace it."""
    @property
    def reason(self) -> Literal["end_of_source", "limit", "interrupted", "disconnected"]:
        """Why."""
    @property
    def counters(self) -> Counters:
        """What went through it."""
    def to_dict(self) -> dict[str, Any]:
        """As plain Python values, the same as in JSON."""
    def to_json(self) -> str:
        """As one line of JSON."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Any, tuple[str]]: ...

_Event: TypeAlias = (
    StreamStarted
    | Position
    | TrackStarted
    | TrackEnded
    | Inconsistency
    | Contact
    | Surface
    | CameraOrientation
    | CameraMotion
    | Activity
    | LevelDisagreement
    | Gap
    | Disconnected
    | Reconnected
    | StreamEnded
)

@final
class Track:
    """A live track."""

    @property
    def track(self) -> int:
        """Its number in the stream."""
    def predict(self, t: float | None = None, *, timestamp_ns: int | None = None) -> tuple[_Array, _Array]:
        """Where it will be by the laws of physics: center [3] (m, world) and covariance [3, 3] (m²).

        Where the environment is known, told or seen behind all objects, it bounces off what it meets there, and rolls where it bounces no
        more.
        `t` is in seconds on the stream's clock, `timestamp_ns` the same in ns. Raises `ValueError` where that is so far away that no
        finite numbers tell it.
        """

@final
class Frame:
    """A depth image, copied: it stays as it is."""

    @property
    def timestamp_ns(self) -> int:
        """Its stamp, ns on the stream's clock."""
    @property
    def frame(self) -> int:
        """Its index as delivered, from 0."""
    @property
    def depth_mm(self) -> NDArray[np.uint16]:
        """Depth [H, W], uint16, mm; 0 where there is no reading."""
    @property
    def disparity(self) -> NDArray[np.uint16] | None:
        """What the camera sent [H, W], uint16: raw disparity, 2047 where there is no reading; `None` where its images are depth."""

@final
class VideoFrame:
    """An image of the colour or the infra-red camera, copied: it stays as it is."""

    @property
    def timestamp_ns(self) -> int:
        """Its stamp, ns on the stream's clock."""
    @property
    def kind(self) -> Literal["color", "infrared"]:
        """Which camera's: "color" or "infrared"."""
    @property
    def pixels(self) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """The image.

        Colour: a Bayer mosaic [480, 640], uint8 (rows begin green, red and blue, green). Infra-red: [488, 640], uint16, 0 to 1023.
        """
    @property
    def missing(self) -> list[tuple[int, int]]:
        """What was lost on the way, and is all ones: ranges (start, end) of pixels, counted row by row."""

@final
class Stream:
    """An iterator of events, and a context manager."""

    def __iter__(self) -> Self: ...
    def __next__(self) -> _Event: ...
    def __enter__(self) -> Self: ...
    def __exit__(self, *_exception: object) -> None: ...
    def close(self) -> None:
        """Stops reading; no more events. A device can be opened again afterwards, and a recording is complete."""
    def interrupt(self) -> None:
        """Ends the stream as Ctrl-C does: what is known becomes final, and `stream_ended` is the last event."""
    @property
    def stats(self) -> Counters:
        """What went through up to the last event."""
    @property
    def busy(self) -> float:
        """How long the engine worked up to the last event, s."""
    @property
    def arrival_ns(self) -> int | None:
        """When the last packet arrived of the frame that the last event came with, ns; `None` where no packets come.

        Of a live Kinect it is comparable with `time.time_ns()`.
        """
    @property
    def remarks(self) -> list[str]:
        """What the user should know of the source, once the stream is over, a line each."""
    @property
    def frame(self) -> Frame | None:
        """The newest image of a stream with `frames=True`, if there was one; it may be ahead of the events.

        Raises ValueError where images were not asked for.
        """
    @property
    def video(self) -> VideoFrame | None:
        """The newest image of `stream("kinect?video=color")`, or `infrared`, if there was one; it may be ahead of the events.

        Raises ValueError where video was not asked for.
        """
    @property
    def tracks(self) -> dict[int, Track]:
        """The live tracks by number, as of the last event."""

@final
class SphereFit:
    """A sphere through points, in their frame."""

    __match_args__ = ("center", "radius", "covariance", "residual_rms", "inliers")
    @property
    def center(self) -> _Array:
        """Center [3], m."""
    @property
    def radius(self) -> float:
        """As given, or estimated, m."""
    @property
    def covariance(self) -> _Array:
        """Of `center` [3, 3], m²; as if the points erred independently of each other, as neighbouring pixels do not."""
    @property
    def residual_rms(self) -> float:
        """Root mean square distance of the inliers from the sphere, m."""
    @property
    def inliers(self) -> int:
        """Points within three standard deviations."""
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class FlightFit:
    """A flight that one law explains."""

    __match_args__ = (
        "t",
        "position",
        "velocity",
        "gravity",
        "covariance",
        "chi2",
        "dof",
        "sd",
        "residual_rms",
        "log_evidence",
    )
    @property
    def t(self) -> float:
        """Of the last measurement, s."""
    @property
    def position(self) -> _Array:
        """At `t` [3], m."""
    @property
    def velocity(self) -> _Array:
        """At `t` [3], m/s."""
    @property
    def gravity(self) -> _Array | None:
        """As known or estimated [3], m/s²; `None` where a callable was the law."""
    @property
    def covariance(self) -> _Array:
        """Of (position, velocity, gravity), [9, 9]."""
    @property
    def chi2(self) -> float:
        """Weighted sum of squared residuals; about `dof` where the law holds and the noise is known."""
    @property
    def dof(self) -> int:
        """Numbers measured, less those that were found out."""
    @property
    def sd(self) -> float | None:
        """Standard deviation of the positions an axis, m, as the residuals tell it (1e-6 at the least); `None` where it was given."""
    @property
    def residual_rms(self) -> float:
        """Root mean square distance of the measurements from the flight, m."""
    @property
    def log_evidence(self) -> float:
        """Log of the marginal likelihood of the positions: fits of the same ones with the same noise compare by it."""
    def predict(self, t: float) -> tuple[_Array, _Array]:
        """Where it is at `t` (s), before or after (Eq. 2): center [3] (m) and its covariance [3, 3] (m²).

        Raises ValueError where `t` or the prediction isn't finite, and what a callable law raises.
        """

@final
class ScaleFit:
    """Metres per unit of a trajectory that was known up to scale."""

    __match_args__ = ("scale", "sd", "gravity_direction", "drag", "residual_sd", "dof")
    @property
    def scale(self) -> float:
        """Metres per unit."""
    @property
    def sd(self) -> float:
        """Standard deviation of `scale`, metres per unit."""
    @property
    def gravity_direction(self) -> _Array:
        """Where gravity pulls: unit vector [3] in the trajectory's own axes."""
    @property
    def drag(self) -> float:
        """k of a = g − k |v| v, 1/m, as told or as the flight tells it."""
    @property
    def residual_sd(self) -> float:
        """Standard deviation of the positions about the flight, units an axis."""
    @property
    def dof(self) -> int:
        """Numbers measured, less those that were found out."""
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class Inconsistencies:
    """Measurements beside their predictions (Eq. 3); NaN where nothing could be predicted."""

    __match_args__ = ("predicted", "distance", "threshold", "p_value", "moving_average", "inconsistent", "sd")
    @property
    def predicted(self) -> _Array:
        """Centers by the law [N, 3], m."""
    @property
    def distance(self) -> _Array:
        """From the predicted to the measured ones [N], m."""
    @property
    def threshold(self) -> _Array:
        """What `distance` is held against [N], m: θ, or the distance in that direction at which the whitened test alarms."""
    @property
    def p_value(self) -> _Array:
        """Probability of such a distance without a cause [N]; NaN with the paper's method."""
    @property
    def moving_average(self) -> _Array:
        """Mean of the last five distances [N], m."""
    @property
    def inconsistent(self) -> NDArray[np.bool_]:
        """Where prediction and measurement disagree [N]."""
    @property
    def sd(self) -> float | None:
        """Standard deviation of the positions an axis, m, where it was estimated."""
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

@final
class ContactFit:
    """Two flights that share a point and a time."""

    __match_args__ = (
        "time",
        "time_sd",
        "center",
        "point",
        "covariance",
        "state_covariance",
        "normal",
        "direction",
        "velocity_before",
        "velocity_after",
        "restitution",
        "chi2",
        "sd",
    )
    @property
    def time(self) -> float:
        """First touch, s."""
    @property
    def time_sd(self) -> float | None:
        """Standard deviation of `time`, s; `None` with the paper's method."""
    @property
    def center(self) -> _Array:
        """Center of the ball at first touch [3], m."""
    @property
    def point(self) -> _Array | None:
        """Where it touched [3], m: center − radius · normal; `None` where one of them is unknown."""
    @property
    def covariance(self) -> _Array | None:
        """Of `center` [3, 3], m²; `None` with the paper's method."""
    @property
    def state_covariance(self) -> _Array | None:
        """Of (center, velocity before, velocity after), [9, 9]; `None` with the paper's method."""
    @property
    def normal(self) -> _Array | None:
        """Unit normal [3], to the side the ball came from: as given, or as this contact alone shows it."""
    @property
    def direction(self) -> _Array | None:
        """The paper's [3]: normalised mean of the two unit tangents along the motion [3]; `None` where they cancel."""
    @property
    def velocity_before(self) -> _Array:
        """At first touch [3], m/s."""
    @property
    def velocity_after(self) -> _Array:
        """At last touch [3], m/s."""
    @property
    def restitution(self) -> float | None:
        """Speed away from the surface over speed into it."""
    @property
    def chi2(self) -> float | None:
        """Weighted sum of squared residuals; `None` with the paper's method."""
    @property
    def sd(self) -> float | None:
        """Standard deviation of the positions an axis, m, where it was estimated."""

@final
class PlaneFit:
    """A plane that contacts lie on."""

    __match_args__ = ("normal", "offset", "covariance", "contacts", "restitution", "tilt", "tilt_sd", "outline", "above")
    @property
    def normal(self) -> _Array:
        """Unit normal [3], to the contacts' side."""
    @property
    def offset(self) -> float:
        """normal · p = offset, m."""
    @property
    def covariance(self) -> _Array:
        """Of (normal, offset), [4, 4]."""
    @property
    def contacts(self) -> list[int]:
        """Which of the contacts, by index."""
    @property
    def restitution(self) -> float:
        """Of the ball on it."""
    @property
    def tilt(self) -> float:
        """Angle between the normal and up, rad."""
    @property
    def tilt_sd(self) -> float:
        """Standard deviation of `tilt`, rad."""
    @property
    def outline(self) -> _Array:
        """Convex hull of the touched points on the plane [M, 3], m."""
    @property
    def above(self) -> Above | None:
        """The parallel plane below it, by its index in the list."""
    def __reduce__(self) -> tuple[Any, tuple[str, str]]: ...

def open_source(
    source: str,
    *,
    name: str | None,
    config: _Config,
    camera: _Camera,
    positions: bool,
    provisional: bool,
    images: bool,
    gravity: list[float] | None,
    frames: int | None,
    duration: float | None,
    every_frame: bool,
    reconnect: float | None,
    record: str | os.PathLike[str] | None,
    tum: bool,
    timeout: float | None,
    law: Law | None,
) -> Stream: ...
def open_iterable(
    items: Iterable[Any],
    *,
    config: _Config,
    camera: _Camera,
    positions: bool,
    provisional: bool,
    images: bool,
    law: Law | None,
) -> Stream: ...
def dump_config(source: str | None = None, config: _Config = None, camera: _Camera = None) -> str: ...
def camera_file(source: str) -> Path | None: ...
def level_pose(gravity: ArrayLike, known: Sequence[Sequence[float]] | None) -> _Array: ...
def event_from_toml(text: str) -> _Event: ...
def part_from_toml(name: str, text: str) -> Above | CameraModel | Counters: ...
def fit_from_toml(name: str, text: str) -> Inconsistencies | PlaneFit | ScaleFit | SphereFit: ...

@final
class Recording:
    """A source that is being recorded, and a context manager: an iterator over how many frames there are, and the newest's stamp, ns."""

    def __iter__(self) -> Self: ...
    def __next__(self) -> tuple[int, int]: ...
    def __enter__(self) -> Self: ...
    def __exit__(self, *exception: object) -> None: ...
    @property
    def remarks(self) -> list[str]:
        """What the user should know of the source so far, a line each."""
    @property
    def counters(self) -> Counters:
        """Frames, and what was lost of a source of packets."""
    @property
    def bytes(self) -> int:
        """How much was written, bytes."""
    def close(self) -> None:
        """Completes what was recorded; no more frames."""

def open_recording(
    source: str, out: str | os.PathLike[str], *, gravity: list[float] | None, tum: bool, frames: int | None
) -> Recording: ...
def simulate(scene: str, out: str | os.PathLike[str]) -> tuple[int, int, int]: ...
def scenes() -> list[str]: ...
def truth(scene: str) -> str: ...
def read_positions(path: str | os.PathLike[str]) -> tuple[_Array, _Array, _Array, list[int]]: ...
def accelerations(t: ArrayLike, positions: ArrayLike) -> _Array: ...
def fit_sphere(points: ArrayLike, radius: float | None) -> SphereFit | None: ...
def fit_flight(
    t: ArrayLike, positions: ArrayLike, law: Any, gravity: Any, drag: Any, sd: float | None, covariance: ArrayLike | None
) -> FlightFit | None: ...
def fit_scale(
    t: ArrayLike, positions: ArrayLike, gravity: float, drag: Any, sd: float | None, covariance: ArrayLike | None
) -> ScaleFit | str: ...
def split_flights(t: ArrayLike, positions: ArrayLike) -> list[tuple[int, int]]: ...
def find_inconsistencies(
    t: ArrayLike,
    positions: ArrayLike,
    method: Any,
    horizon: Any,
    law: Any,
    gravity: Any,
    drag: Any,
    sd: float | None,
    covariance: ArrayLike | None,
    theta: float,
    false_alarm: float,
) -> Inconsistencies: ...
def solve_contact(
    before: _Side,
    after: _Side,
    method: Any,
    law: Any,
    gravity: Any,
    drag: Any,
    duration: float,
    normal: ArrayLike | None,
    radius: float | None,
    sd: float | None,
) -> ContactFit | None: ...
def fit_planes(contacts: Iterable[Contact | ContactFit], radius: float | None, gravity: Any, spin_sd: float) -> list[PlaneFit]: ...
def unpack_disparity(packed: NDArray[np.uint8], bits: int, samples: NDArray[np.uint16]) -> None: ...

PAPER_SIDE: int
__version__: str
