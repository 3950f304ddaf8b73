"""The configuration as frozen dataclasses: the same keys and defaults as in TOML. `None` leaves a key out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

Vector = Sequence[float]
"""Three numbers."""
Matrix = Sequence[Sequence[float]]
"""Four rows of four numbers."""


@dataclass(frozen=True)
class CameraConfig:
    """`[camera]` and `camera.toml`. Left out: the Kinect v1's values."""

    width: int | None = None
    """Columns, px (640)."""
    height: int | None = None
    """Rows, px (480)."""
    fx: float | None = None
    """Focal length in columns, px (575.8)."""
    fy: float | None = None
    """Focal length in rows, px (575.8)."""
    cx: float | None = None
    """Principal point, column, px (319.5)."""
    cy: float | None = None
    """Principal point, row, px (239.5)."""
    depth_scale: float | None = None
    """Units a metre of a depth image; of disparity it says nothing."""
    disparity: bool | None = None
    """Samples are raw disparity, also where the source takes them for depth; what it knows to be disparity stays so."""
    disparity_law: Sequence[float] | None = None
    """`[c0, c1]` of 1/z = c0 + c1 · raw, in 1/m."""
    max_depth: float | None = None
    """Readings beyond this are ignored, m (10)."""
    readout: float | None = None
    """Seconds from the first row's readout to the last's (0)."""
    world_from_camera: Matrix | None = None
    """Pose, 4 rows of 4, rigid."""
    gravity_in_camera: Vector | None = None
    """Where an accelerometer in the camera says that gravity pulls, m/s²; without a pose the world is level by it, and flights that show
    otherwise are told (`level_disagreement`)."""


@dataclass(frozen=True)
class ObjectConfig:
    """`[object]`: the tracked object; a tennis ball."""

    shape: Literal["sphere", "any"] = "sphere"
    """`any`: whatever the background does not tell of, followed by ICP; `radius` then has no part.

    Its position is that of what was taken for its middle when it was first seen, carried along by its motion. What stands there while the
    background is learned is a part of it."""
    radius: float | Sequence[float] = 0.033
    """Radius of the ball, m; a list for several kinds."""
    mass: float = 0.057
    """Mass, kg."""
    drag_coefficient: float = 0.53
    """Drag coefficient, of the cross section."""
    contact_duration: float = 0.0045
    """How long a bounce touches, s; 0 is an ideal impact."""
    spin_sd: float = 0.0
    """Prior of an unknown spin, rad/s; 0 is no spin."""


@dataclass(frozen=True)
class LawsConfig:
    """`[laws]`: the laws of physics, and how disagreement is tested."""

    gravity: Vector = (0.0, 0.0, -9.81)
    """Gravity in the world, m/s²."""
    law: Literal["free_fall", "constant_velocity", "auto"] = "free_fall"
    """The law of motion: falling through air, constant velocity on a horizontal plane, or what the evidence tells."""
    drag: bool = True
    """Air drag acts."""
    magnus: bool = False
    """The Magnus force acts; not in this version."""
    air_density: float = 1.2
    """Density of the air, kg/m³."""
    theta: float = 0.006
    """θ of Eq. 3, m."""
    false_alarm: float = 1e-3
    """False alarms of the whitened test, a track."""
    method: Literal["best", "paper"] = "best"
    """The best we can, or the paper's own method."""


@dataclass(frozen=True)
class TrackingConfig:
    """`[tracking]`: from frames to tracks."""

    background_frames: int = 15
    """First frames, which show no object; 0 for none."""
    position_sd: float | None = None
    """Standard deviation of positions that come without covariance, m; left out: estimated from flights."""


@dataclass(frozen=True)
class AssumeConfig:
    """`[assume]`: what is taken for granted."""

    camera: Literal["static", "tilted", "moving", "unknown"] | None = None
    """Left out: `static` where `world_from_camera` is given, else `tilted`: fixed, gravity's direction to be found.

    `moving`: orientation as configured, translation free (`camera_motion`). `unknown`: both free. Where the camera moves there is no
    background, and no contact is looked for."""
    scene: Literal["known", "unknown"] = "unknown"
    """Whether the environment is all there is: what was told of it, and what a learned background shows."""
    objects: Literal["passive", "unknown"] = "passive"
    """Whether objects may have a motor: `unknown` tells `activity`."""


@dataclass(frozen=True)
class KnownPlane:
    """A known plane: normal · p = offset."""

    name: str = ""
    """What to call it."""
    normal: Vector = (0.0, 0.0, 1.0)
    """Unit normal; either sign is the same plane, with `offset` turned as well."""
    offset: float = 0.0
    """Offset along the normal, m."""


@dataclass(frozen=True)
class KnownBox:
    """A known box."""

    center: Vector
    """Its middle, m."""
    size: Vector
    """Full edges, m."""
    name: str = ""
    """What to call it."""
    yaw: float = 0.0
    """Turn about world z, rad; 0 beside `rotation`."""
    rotation: Sequence[float] | None = None
    """Or the whole rotation, as a unit quaternion w, x, y, z."""


@dataclass(frozen=True)
class KnownSphere:
    """A known sphere."""

    center: Vector
    """Its middle, m."""
    radius: float
    """Its radius, m."""
    name: str = ""
    """What to call it."""


@dataclass(frozen=True)
class KnownMesh:
    """A known mesh: a closed surface, its triangles counter-clockwise as seen from outside."""

    path: str
    """File (OBJ, STL or PLY, units metres), relative to the configuration's; of a dict or dataclass, to the working directory."""
    name: str = ""
    """What to call it."""
    pose: Matrix | None = None
    """Pose in the world, 4 rows of 4, rigid; left out: the mesh is in world coordinates."""


@dataclass(frozen=True)
class EnvironmentConfig:
    """`[[environment.*]]`: known surfaces, world frame. Their ids are 0, 1, … in a file's order; here they count on from kind to kind."""

    plane: Sequence[KnownPlane] = ()
    """Planes."""
    box: Sequence[KnownBox] = ()
    """Boxes."""
    sphere: Sequence[KnownSphere] = ()
    """Spheres."""
    mesh: Sequence[KnownMesh] = ()
    """Meshes."""


@dataclass(frozen=True)
class Config:
    """Everything that can be configured."""

    camera: CameraConfig = field(default_factory=CameraConfig)
    """The camera; wins over `camera.toml`."""
    object: ObjectConfig = field(default_factory=ObjectConfig)
    """The tracked object."""
    laws: LawsConfig = field(default_factory=LawsConfig)
    """The laws of physics, and how disagreement with them is tested."""
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    """From frames to tracks."""
    assume: AssumeConfig = field(default_factory=AssumeConfig)
    """What is taken for granted."""
    environment: EnvironmentConfig = field(default_factory=EnvironmentConfig)
    """What is known of the scene."""
