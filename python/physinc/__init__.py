"""physinc watches a depth camera and reports what *happened*, physically.

import physinc
for event in physinc.stream("demo"):
    match event:
        case physinc.Contact(point=point, normal=normal): ...
"""

from ._physinc import (
    Above,
    CameraModel,
    CameraOrientation,
    Contact,
    Counters,
    Gap,
    Inconsistency,
    Position,
    Stream,
    StreamEnded,
    StreamStarted,
    Surface,
    Track,
    TrackEnded,
    TrackStarted,
    __version__,
)
from .config import (
    AssumeConfig,
    CameraConfig,
    Config,
    EnvironmentConfig,
    KnownBox,
    KnownMesh,
    KnownPlane,
    KnownSphere,
    LawsConfig,
    ObjectConfig,
    TrackingConfig,
)
from .errors import (
    ConfigError,
    DeviceNotFoundError,
    PhysincError,
    RecordingError,
    RecordingNotFoundError,
    StreamTimeoutError,
)
from .event import Event
from .streaming import stream

__all__ = [
    "Above",
    "AssumeConfig",
    "CameraConfig",
    "CameraModel",
    "CameraOrientation",
    "Config",
    "ConfigError",
    "Contact",
    "Counters",
    "DeviceNotFoundError",
    "EnvironmentConfig",
    "Event",
    "Gap",
    "Inconsistency",
    "KnownBox",
    "KnownMesh",
    "KnownPlane",
    "KnownSphere",
    "LawsConfig",
    "ObjectConfig",
    "PhysincError",
    "Position",
    "RecordingError",
    "RecordingNotFoundError",
    "Stream",
    "StreamEnded",
    "StreamStarted",
    "StreamTimeoutError",
    "Surface",
    "Track",
    "TrackEnded",
    "TrackStarted",
    "TrackingConfig",
    "__version__",
    "stream",
]
