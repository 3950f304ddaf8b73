"""Any event. Events are equal if all they say is equal, and can be kept in sets and as keys."""

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
    | p.CameraMotion
    | p.Activity
    | p.LevelDisagreement
    | p.Gap
    | p.Disconnected
    | p.Reconnected
    | p.StreamEnded
)
"""Any event."""
