"""Any event."""

from typing import TypeAlias

from . import _physinc as p

Event: TypeAlias = (
    p.StreamStarted
    | p.Position
    | p.TrackStarted
    | p.TrackEnded
    | p.Inconsistency
    | p.Contact
    | p.Surface
    | p.CameraOrientation
    | p.Gap
    | p.StreamEnded
)
"""Any event."""
