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
    ContactFit,
    Counters,
    FlightFit,
    Frame,
    Gap,
    Inconsistencies,
    Inconsistency,
    PlaneFit,
    Position,
    SphereFit,
    Stream,
    StreamEnded,
    StreamStarted,
    Surface,
    Track,
    TrackEnded,
    TrackStarted,
    __version__,
)
from .arrays import Law, accelerations, find_inconsistencies, fit_flight, fit_planes, fit_sphere, solve_contact
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
from .disparity import unpack_disparity
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
    "ContactFit",
    "Counters",
    "DeviceNotFoundError",
    "EnvironmentConfig",
    "Event",
    "FlightFit",
    "Frame",
    "Gap",
    "Inconsistencies",
    "Inconsistency",
    "KnownBox",
    "KnownMesh",
    "KnownPlane",
    "KnownSphere",
    "Law",
    "LawsConfig",
    "ObjectConfig",
    "PhysincError",
    "PlaneFit",
    "Position",
    "RecordingError",
    "RecordingNotFoundError",
    "SphereFit",
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
    "accelerations",
    "find_inconsistencies",
    "fit_flight",
    "fit_planes",
    "fit_sphere",
    "solve_contact",
    "stream",
    "unpack_disparity",
]
