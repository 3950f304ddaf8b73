//! What happened. Plain values with fixed capacity; matrices are rows; what is unknown is `None`.

use heapless::{String, Vec};

#[cfg(feature = "std")]
use serde::{Deserialize, Serialize};

/// One event: when it was known, of which track, whether it can still be refined, and what it says.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize))]
pub struct Event {
    /// Stamp of the newest input that it used, ns on the stream's clock; it never decreases along a stream.
    pub timestamp_ns: i64,
    /// The track, counted from 1 and never reused; `None` where none or all.
    pub track: Option<u32>,
    /// Nothing will replace it.
    #[cfg_attr(feature = "std", serde(rename = "final"))]
    pub is_final: bool,
    /// What it says.
    #[cfg_attr(feature = "std", serde(flatten))]
    pub kind: Kind,
}

/// Declares `Kind`, and a struct for each of its names.
macro_rules! declare_events {
    ($($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* })*) => {
        /// What an event says.
        #[derive(Clone, Debug, PartialEq)]
        #[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(tag = "event", rename_all = "snake_case"))]
        #[allow(clippy::large_enum_variant)] // No heap to put the larger ones on.
        pub enum Kind { $($(#[$meta])* $name($name),)* }
        $($(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        #[cfg_attr(feature = "std", derive(Serialize, Deserialize))]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* }
        impl From<$name> for Kind {
            fn from(event: $name) -> Self { Self::$name(event) }
        })*
    };
}

/// Declares the structs that are part of events.
macro_rules! declare_parts {
    ($($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* })*) => {
        $($(#[$meta])*
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        #[cfg_attr(feature = "std", derive(Serialize, Deserialize))]
        pub struct $name { $($(#[$field_meta])* pub $field: $type,)* })*
    };
}

/// Gives the list of events, each with its fields, to a macro.
macro_rules! events {
    ($declare:ident) => {
        $declare! {
            /// The stream began.
            StreamStarted {
                /// The source, as it was named.
                source: String<512>,
                /// The camera; `None` for positions.
                camera: Option<CameraModel>,
                /// The pose that fixes the stream's world `[4, 4]`.
                world_from_camera: [[f64; 4]; 4],
            }
            /// An object was seen here.
            Position {
                /// Index of the frame as delivered, from 0.
                frame: u64,
                /// Center in the world `[3]`, m.
                center: [f64; 3],
                /// Center in the camera frame `[3]`, m; `None` for positions.
                center_in_camera: Option<[f64; 3]>,
                /// Of `center` `[3, 3]`, m²; `None` where nobody knows.
                ///
                /// Of any shape it includes what has drifted since its first view, which positions near in time have in common: they differ by
                /// less.
                covariance: [[f64; 3]; 3],
                /// Pixels that took part.
                points: Option<u32>,
                /// Root mean square of their distances from the fitted surface, m.
                residual_rms: Option<f64>,
            }
            /// A track began.
            TrackStarted {
                /// Why.
                reason: TrackReason,
            }
            /// A track ended.
            TrackEnded {
                /// Why.
                reason: TrackReason,
            }
            /// Measurement and prediction disagree (Eq. 3, or the whitened test).
            Inconsistency {
                /// Center by the laws of physics `[3]`, world, m.
                predicted: [f64; 3],
                /// Center as measured `[3]`, world, m.
                measured: [f64; 3],
                /// Between the two, m.
                distance: f64,
                /// What `distance` exceeded, m: θ, or the distance in that direction at which the whitened test alarms.
                threshold: f64,
                /// Probability of such a distance without a cause.
                p_value: Option<f64>,
            }
            /// The object touched something.
            Contact {
                /// Unique among contacts.
                id: u32,
                /// First touch, between frames, ns.
                time_ns: i64,
                /// Standard deviation of `time_ns`, s.
                time_sd: Option<f64>,
                /// Center of the ball at first touch `[3]`, world, m.
                center: [f64; 3],
                /// Where it touched `[3]`: center − radius · normal, world, m.
                point: Option<[f64; 3]>,
                /// Of `center` `[3, 3]`, m².
                covariance: [[f64; 3]; 3],
                /// Unit normal of the surface `[3]`, to the side the ball came from, world.
                normal: Option<[f64; 3]>,
                /// The paper's `[3]`: normalised mean of the two unit tangents along the motion; `None` where they cancel.
                direction: Option<[f64; 3]>,
                /// At first touch `[3]`, world, m/s.
                velocity_before: Option<[f64; 3]>,
                /// At last touch `[3]`, world, m/s.
                velocity_after: Option<[f64; 3]>,
                /// Speed away from the surface over speed into it.
                restitution: Option<f64>,
                /// Which surface; `None` on an edge, or where none is known.
                surface: Option<u32>,
            }
            /// A plane that was touched, or is known.
            Surface {
                /// Unique among surfaces.
                id: u32,
                /// As configured.
                name: Option<String<64>>,
                /// Unit normal `[3]`, to the contacts' side, world.
                normal: [f64; 3],
                /// normal · p = offset, m.
                offset: f64,
                /// Of (normal, offset) `[4, 4]`, units of normal 1 and of offset m.
                covariance: Option<[[f64; 4]; 4]>,
                /// Angle between the normal and up, rad.
                tilt: Option<f64>,
                /// Standard deviation of `tilt`, rad.
                tilt_sd: Option<f64>,
                /// How many contacts it rests on.
                contacts: u32,
                /// Convex hull of the touched points on the plane `[N, 3]`, world, m.
                outline: Option<Vec<[f64; 3], 32>>,
                /// The parallel surface below it.
                above: Option<Above>,
                /// The surface that this one turned out to be.
                merged_into: Option<u32>,
            }
            /// Gravity as the flights show it.
            CameraOrientation {
                /// Unique among camera orientations.
                id: u32,
                /// Measured acceleration without drag `[3]`, its length kept, camera frame, m/s².
                gravity_in_camera: [f64; 3],
                /// atan2(gx, gy), rad.
                roll: f64,
                /// atan2(−gz, √(gx² + gy²)), rad.
                pitch: f64,
                /// Of `gravity_in_camera` `[3, 3]`, (m/s²)².
                covariance: [[f64; 3]; 3],
                /// Flights that it rests on.
                flights: u32,
                /// What no flight tells of it.
                undetermined: Vec<Undetermined, 4>,
            }
            /// How far the camera has moved (sec. 3.1 ii): one for each frame in which something was tracked.
            CameraMotion {
                /// Unique among camera motions.
                id: u32,
                /// Index of the frame, as delivered, from 0.
                frame: u64,
                /// Of the optical center since the first frame `[3]`, world axes, m.
                displacement: [f64; 3],
                /// Of `displacement` `[3, 3]`, m²; as far as what is `undetermined` is as was assumed.
                covariance: [[f64; 3]; 3],
                /// What neither objects nor static structure tell of it.
                undetermined: Vec<Undetermined, 4>,
            }
            /// Whether an object moves by a force of its own (sec. 3.3). The final ones of a track cover each of its frames once.
            Activity {
                /// Unique among activities.
                id: u32,
                /// First frame of the interval, ns.
                start_ns: i64,
                /// Last frame of the interval, ns.
                end_ns: i64,
                /// Whether no law of passive objects explains it.
                active: bool,
                /// Of `active` being true of it: near 0 for a passive object.
                probability: f64,
            }
            /// Flights show that the accelerometer's level, `gravity_in_camera` of the configuration, is off. Told once in a stream.
            LevelDisagreement {
                /// As the flights show it `[3]`, camera frame, m/s².
                gravity_in_camera: [f64; 3],
                /// As the accelerometer tells it `[3]`, camera frame, m/s².
                gravity_by_accelerometer: [f64; 3],
                /// Between the two, rad.
                angle: f64,
                /// Standard deviation of `angle` if the two were one, rad: the flights' own, and 0.5° of an accelerometer that is right.
                sd: f64,
                /// Probability of such an angle then.
                p_value: f64,
                /// Flights that it rests on.
                flights: u32,
            }
            /// Input is missing.
            Gap {
                /// Newest input before it, ns.
                start_ns: i64,
                /// Oldest input after it, ns.
                end_ns: i64,
                /// What went missing.
                reason: GapReason,
                /// Frames lost.
                frames: Option<u64>,
                /// Packets lost.
                packets: Option<u64>,
                /// Samples lost.
                samples: Option<u64>,
            }
            /// The device is gone.
            Disconnected {
                /// Why.
                reason: DisconnectReason,
            }
            /// The device is back, and the stream goes on.
            Reconnected {
                /// By what it was recognised.
                reason: ReconnectReason,
            }
            /// The stream is over.
            StreamEnded {
                /// Why.
                reason: EndReason,
                /// What went through it.
                counters: Counters,
            }
        }
    };
}
#[cfg(feature = "python")]
pub(crate) use events;

/// Gives the list of what is part of events to a macro.
macro_rules! parts {
    ($declare:ident) => {
        $declare! {
            /// The intrinsics, px.
            CameraModel {
                /// Columns, px.
                width: u32,
                /// Rows, px.
                height: u32,
                /// Focal length in columns, px.
                fx: f64,
                /// Focal length in rows, px.
                fy: f64,
                /// Principal point, column, px.
                cx: f64,
                /// Principal point, row, px.
                cy: f64,
            }
            /// A parallel surface below.
            Above {
                /// Its id.
                surface: u32,
                /// How far below, m.
                height: f64,
                /// Standard deviation of `height`, m.
                sd: Option<f64>,
            }
            /// What went through a stream.
            Counters {
                /// Frames (or instants of positions) delivered by the source.
                frames: u64,
                /// Of these, not used: their stamp stood still or went back, or they showed more pieces of foreground than can be told apart.
                frames_dropped: u64,
                /// Of these, with samples missing.
                frames_incomplete: u64,
                /// Packets delivered by the source.
                packets: u64,
                /// Packets that never came.
                packets_lost: u64,
                /// Packets that made no sense.
                packets_invalid: u64,
                /// Events told.
                events: u64,
                /// Events that a full queue swallowed (never contacts), and positions of more objects than are tracked at once.
                events_dropped: u64,
            }
        }
    };
}
#[cfg(feature = "python")]
pub(crate) use parts;

events!(declare_events);
parts!(declare_parts);

/// What the laws of physics leave open of a camera's pose, whatever flies before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
pub enum Undetermined {
    /// The turn about gravity.
    Heading,
    /// A constant velocity: taken to be zero at the beginning of each flight.
    Velocity,
    /// A constant acceleration and a gravity that is another look alike: the size of gravity is all that tells them apart.
    AccelerationOrGravity,
    /// Where the camera went while nothing was tracked: taken to be nowhere, less surely the longer it lasts.
    UnseenMotion,
}

/// Why a track began or ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
#[allow(missing_docs)] // The names say it.
pub enum TrackReason {
    Appeared,
    Lost,
    LeftView,
    Merged,
    StreamEnded,
}

/// What went missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
#[allow(missing_docs)] // The names say it.
pub enum GapReason {
    PacketsLost,
    FramesLost,
    Stalled,
    Disconnected,
}

/// Why a device is gone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
#[allow(missing_docs)] // The names say it.
pub enum DisconnectReason {
    Unplugged,
    UsbError,
}

/// By what a device that is back was recognised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
#[allow(missing_docs)] // The names say it.
pub enum ReconnectReason {
    SameSerial,
    SamePort,
}

/// Why a stream ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "std", derive(Serialize, Deserialize), serde(rename_all = "snake_case"))]
#[allow(missing_docs)] // The names say it.
pub enum EndReason {
    EndOfSource,
    Limit,
    Interrupted,
    Disconnected,
}
