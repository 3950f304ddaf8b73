//! What can be told about a scene: `NAME?key=value&key=value`.

use super::SimError;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::borrow::ToOwned;
use std::format;
use std::string::{String, ToString};

/// The scenes there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Six throws over a floor and a box that the camera can't see (sec. 3.2 of the paper).
    Bounce,
    /// The same before a visible wall, with a visible floor, from a camera that looks down.
    Room,
    /// Two balls at a time that cross in the image.
    TwoBalls,
    /// Many balls at a time that cross, hide each other and bounce.
    Many,
    /// Flights that touch nothing.
    PassiveFlight,
    /// A ball let go, which bounces until it lies still.
    Drop,
    /// A ball that rolls on after its last bounce.
    Roll,
    /// Flights that touch nothing, before a camera rolled about its axis (sec. 3.1 (i) of the paper).
    RotatedCamera,
    /// A hand moves the camera in mid-flight (sec. 3.1 (ii)).
    TranslatingCamera,
    /// A robot stands on the floor, takes off, flies around and lands (sec. 3.3).
    FlyingRobot,
    /// A car drives on the floor, straight on but for one turn (sec. 3.3).
    ToyCar,
}

/// Every scene by its name, with what it is.
pub const SCENES: [(&str, Kind); 11] = [
    ("bounce", Kind::Bounce),
    ("room", Kind::Room),
    ("two_balls", Kind::TwoBalls),
    ("many", Kind::Many),
    ("passive_flight", Kind::PassiveFlight),
    ("drop", Kind::Drop),
    ("roll", Kind::Roll),
    ("rotated_camera", Kind::RotatedCamera),
    ("translating_camera", Kind::TranslatingCamera),
    ("flying_robot", Kind::FlyingRobot),
    ("toy_car", Kind::ToyCar),
];

impl Kind {
    /// Whether the pose is told also where the camera is tilted.
    fn is_of_known_orientation(self) -> bool {
        matches!(self, Self::TranslatingCamera | Self::FlyingRobot | Self::ToyCar)
    }
}

/// What the samples are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Samples {
    /// Raw disparity, 2047 = none.
    Disparity,
    /// Depth, mm, 0 = none, by way of the disparity.
    Depth,
}

/// What the camera sees beside the objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Structure {
    /// Nothing.
    #[default]
    None,
    /// The floor.
    Floor,
    /// A wall 1.2 m behind the middle of the scene.
    Wall,
    /// Floor and wall.
    Both,
}

impl Structure {
    pub(super) fn has_floor(self) -> bool {
        matches!(self, Self::Floor | Self::Both)
    }

    pub(super) fn has_wall(self) -> bool {
        matches!(self, Self::Wall | Self::Both)
    }
}

macro_rules! parameters {
    ($($(#[$meta:meta])* $key:ident: $type:ty = $default:expr, $range:expr;)*) => {
        /// The keys of a scene.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields)]
        pub struct Parameters { $($(#[$meta])* pub $key: $type,)* }

        impl Default for Parameters {
            fn default() -> Self { Self { $($key: $default,)* } }
        }

        /// Least and greatest value of each key that is a number.
        const RANGES: &[(&str, [f64; 2])] = &[$((stringify!($key), $range),)*];
    };
}

/// A level camera sees too little of the floor: where that is asked for, it looks down by this, °.
const FLOOR_TILT: f64 = 20.0;

/// No range: not a number.
const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

parameters! {
    /// Of all that is random: the same seed gives the same bytes.
    seed: u64 = 1, [0.0, 1.8e19];
    /// Throws, or pairs of them, or rounds; or robots or cars, one after the other.
    throws: u32 = 6, [1.0, 1000.0];
    /// Balls of a round, where there are many at once.
    balls: u32 = 8, [1.0, 12.0];
    /// From the lens to the middle of the scene, m.
    distance: f64 = 1.75, [0.8, 4.0];
    /// Of the lens over the floor where the camera looks horizontally, m.
    height: f64 = 0.25, [0.05, 2.0];
    /// The camera looks down by this, around the middle of the scene, °.
    tilt_deg: f64 = 0.0, [-10.0, 60.0];
    /// The camera is turned about its axis, clockwise as it sees, °.
    roll_deg: f64 = 0.0, [-180.0, 180.0];
    /// Whether the camera's pose (at the first frame) is told; left out: where it stands level, or the scene is about something else.
    pose: bool = true, ANY;
    /// What the samples are.
    kind: Samples = Samples::Disparity, ANY;
    /// The source `sim:` hands out packets, as a Kinect sends them.
    packets: bool = false, ANY;
    /// Frames a second.
    fps: f64 = 30.0, [5.0, 300.0];
    /// From the first row's readout to the last row's, s.
    readout: f64 = 0.0, [0.0, 0.2];
    /// Part of the frames that is lost.
    loss: f64 = 0.0, [0.0, 0.95];
    /// Factor on the sensor's noise.
    sigma: f64 = 1.0, [0.0, 10.0];
    /// Edge of the matching window, px, odd.
    window: u32 = 9, [1.0, 25.0];
    /// Noise of neighbouring pixels is independent.
    white: bool = false, ANY;
    /// True focal length over the one that is told.
    focal_factor: f64 = 1.0, [0.8, 1.25];
    /// Of the ball, m.
    radius: f64 = 0.033, [0.005, 0.15];
    /// Of the ball, kg.
    mass: f64 = 0.057, [0.0005, 10.0];
    /// Moment of inertia over mass · radius²: tennis ball 0.55, solid ball 0.4.
    inertia: f64 = 0.55, [0.1, 1.0];
    /// Of drag, mean over the balls.
    drag_coefficient: f64 = 0.53, [0.0, 2.0];
    /// Its scatter from throw to throw.
    drag_sd: f64 = 0.024, [0.0, 0.5];
    /// Spin bends the flight.
    magnus: bool = false, ANY;
    /// Of each component of the spin at the throw, rad/s.
    spin_sd: f64 = 0.0, [0.0, 500.0];
    /// Of a touch, s.
    contact_duration: f64 = 0.0045, [0.0, 0.02];
    /// Mean restitution on the floor; the box gives 0.05 less.
    restitution: f64 = 0.75, [0.1, 1.0];
    /// Its scatter from touch to touch.
    restitution_sd: f64 = 0.01, [0.0, 0.2];
    /// Coulomb's coefficient.
    friction: f64 = 0.5, [0.0, 5.0];
    /// Size of gravity, m/s².
    gravity: f64 = 9.81, [0.5, 30.0];
    /// What the camera sees beside the objects, in scenes that have this key.
    #[serde(skip_serializing_if = "Option::is_none")]
    structure: Option<Structure> = None, ANY;
    /// How far a hand moves the camera, m, in scenes that have this key.
    #[serde(skip_serializing_if = "Option::is_none")]
    travel: Option<f64> = None, [0.01, 0.5];
    /// How long that lasts, s, in scenes that have this key; 0: 0.25 to 0.45, drawn for each.
    #[serde(skip_serializing_if = "Option::is_none")]
    move_seconds: Option<f64> = None, [0.0, 2.0];
}

impl Parameters {
    /// Reads `NAME?key=value&…`; a key that is left out has the default of its scene.
    ///
    /// # Errors
    /// A scene or key that does not exist, a key told twice, a value that can't be: the message says what exists.
    pub fn parse(scene: &str) -> Result<(Kind, Self), SimError> {
        let (name, told) = scene.split_once('?').unwrap_or((scene, ""));
        let kind = SCENES
            .iter()
            .find(|s| s.0 == name)
            .ok_or_else(|| SimError::UnknownScene { name: name.to_owned(), known: SCENES.map(|s| s.0).join(", ") })?;
        let Ok(Value::Object(defaults)) = serde_json::to_value(Self::of(kind.1)) else { unreachable!("a struct is an object") };
        let mut values = Map::new();
        for pair in told.split('&').filter(|p| !p.is_empty()) {
            let (key, text) = pair.split_once('=').ok_or_else(|| bad(pair, "", "write key=value"))?;
            let known = || defaults.keys().cloned().collect::<std::vec::Vec<String>>().join(", ");
            let default = defaults.get(key).ok_or_else(|| SimError::UnknownKey { key: key.to_owned(), known: known() })?;
            let value = match default {
                Value::Bool(_) => match text {
                    "1" | "true" => Value::Bool(true),
                    "0" | "false" => Value::Bool(false),
                    _ => return Err(bad(key, text, "must be 0 or 1")),
                },
                Value::Number(_) => in_range(key, text)?,
                _ => Value::String(text.to_owned()),
            };
            if values.insert(key.to_owned(), value).is_some() {
                return Err(bad(key, text, "is told twice"));
            }
        }
        let [pose_told, tilt_told] = ["pose", "tilt_deg"].map(|key| values.contains_key(key));
        let merged: Map<String, Value> = defaults.into_iter().chain(values).collect();
        let mut parameters: Self = serde_json::from_value(Value::Object(merged)).map_err(|e| bad("scene", told, &e.to_string()))?;
        if parameters.window.is_multiple_of(2) {
            return Err(bad("window", &parameters.window.to_string(), "must be odd"));
        }
        if parameters.packets && (parameters.kind != Samples::Disparity || parameters.fps > 32.0) {
            return Err(bad("packets", "1", "a Kinect sends disparity, up to 32 frames a second"));
        }
        let level = parameters.tilt_deg == 0.0 && parameters.roll_deg == 0.0;
        parameters.pose &= pose_told || level || kind.1.is_of_known_orientation();
        if !tilt_told && kind.1 == Kind::TranslatingCamera && parameters.structure.is_some_and(Structure::has_floor) {
            parameters.tilt_deg = FLOOR_TILT;
        }
        Ok((kind.1, parameters))
    }

    fn of(kind: Kind) -> Self {
        let base = Self::default();
        match kind {
            Kind::Bounce => base,
            Kind::Room => Self { tilt_deg: 20.0, ..base },
            Kind::TwoBalls => Self { throws: 3, ..base },
            Kind::Many => Self { throws: 2, ..base },
            Kind::PassiveFlight => Self { throws: 10, ..base },
            Kind::Drop | Kind::Roll => Self { throws: 1, ..base },
            Kind::RotatedCamera => Self { roll_deg: 18.0, pose: false, ..base },
            // Higher, as a hand holds it: the floor lies below the view, and flights are long.
            Kind::TranslatingCamera => {
                Self { throws: 2, height: 0.8, structure: Some(Structure::None), travel: Some(0.155), move_seconds: Some(0.0), ..base }
            }
            Kind::FlyingRobot => Self { throws: 1, tilt_deg: 20.0, structure: Some(Structure::Floor), ..base },
            Kind::ToyCar => Self { throws: 1, tilt_deg: 25.0, structure: Some(Structure::Floor), ..base },
        }
    }
}

fn bad(key: &str, value: &str, why: &str) -> SimError {
    SimError::BadValue { key: key.to_owned(), value: value.to_owned(), why: why.to_owned() }
}

fn in_range(key: &str, text: &str) -> Result<Value, SimError> {
    let number: f64 = text.parse().map_err(|_| bad(key, text, "is not a number"))?;
    let range = RANGES.iter().find(|r| r.0 == key).map_or(ANY, |r| r.1);
    if !(range[0]..=range[1]).contains(&number) {
        return Err(bad(key, text, &format!("must be from {} to {}", range[0], range[1])));
    }
    text.parse::<u64>().map(Value::from).or_else(|_| Ok(Value::from(number)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn told_keys_win_and_others_have_the_scenes_defaults() {
        let (kind, p) = Parameters::parse("room?seed=7&white=1&distance=2&kind=depth&sigma=1.5").unwrap();
        assert_eq!((kind, p.seed, p.white, p.distance, p.kind, p.sigma), (Kind::Room, 7, true, 2.0, Samples::Depth, 1.5));
        assert_eq!((p.tilt_deg, p.pose), (20.0, false));
        assert!(Parameters::parse("bounce").unwrap().1.pose);
        assert!(!Parameters::parse("rotated_camera?roll_deg=0").unwrap().1.pose);
        let (_, p) = Parameters::parse("translating_camera?structure=both").unwrap();
        assert_eq!((p.pose, p.tilt_deg, p.travel), (true, 20.0, Some(0.155)));
        assert!(Parameters::parse("bounce?tilt_deg=27&pose=1").unwrap().1.pose);
    }

    #[test]
    fn what_does_not_exist_is_named_with_what_does() {
        for (scene, words) in [
            ("bunce", ["bunce", "bounce, room"]),
            ("bounce?sede=3", ["sede", "seed"]),
            ("bounce?sigma=-1", ["sigma=-1", "from 0 to 10"]),
            ("bounce?sigma=NaN", ["sigma=NaN", "from 0 to 10"]),
            ("bounce?window=8", ["window=8", "odd"]),
            ("bounce?throws=2.5", ["2.5", "u32"]),
            ("bounce?kind=x", ["x", "disparity"]),
            ("bounce?seed=1&seed=2", ["seed=2", "twice"]),
            ("bounce?seed", ["seed", "key=value"]),
            ("bounce?travel=0.1", ["travel", "seed"]),
            ("toy_car?travel=0.1", ["travel", "structure"]),
            ("translating_camera?structure=roof", ["roof", "both"]),
            ("bounce?packets=1&kind=depth", ["packets=1", "disparity"]),
        ] {
            let message = Parameters::parse(scene).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{scene}: {message}");
        }
    }
}
