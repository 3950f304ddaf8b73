//! The motor: it tilts the camera, has the LED, and the accelerometer that moves along.

use super::descriptor::Descriptors;
use super::{Answer, Device, Setup, Stall};
use std::vec::Vec;

/// It turns no farther than this from the horizon, and this fast (no source tells how fast it really is), degrees.
const LIMIT: f64 = 31.0;
const DEGREES_PER_SECOND: f64 = 20.0;
/// Counts of the accelerometer in the earth's gravity.
const COUNTS: f64 = 819.0;
/// Values of the LED.
const LED_STATES: u16 = 7;
/// Byte 9 of the accelerometer's answer.
const STOPPED: u8 = 0;
const AT_LIMIT: u8 = 1;
const MOVING: u8 = 4;
/// What stands for the angle while it moves.
const UNKNOWN_ANGLE: i8 = -128;

/// The motor of a Kinect that stands level.
pub struct Motor {
    descriptors: Descriptors,
    answers: bool,
    led: u16,
    /// Where it was at which time of the host, and where it goes, degrees.
    from: (i64, f64),
    to: f64,
}

impl Default for Motor {
    fn default() -> Self {
        Self { descriptors: Descriptors::motor(), answers: true, led: 0, from: (0, 0.0), to: 0.0 }
    }
}

impl Motor {
    /// Of a model whose motor does not answer: it is told through the microphones.
    pub fn silent() -> Self {
        Self { answers: false, ..Self::default() }
    }

    /// 0 off, 1 green, 2 red, 3 yellow, 4 and 5 blinking green, 6 blinking red and yellow.
    pub fn led(&self) -> u16 {
        self.led
    }

    /// Above the horizon, degrees.
    pub fn angle(&self, at_ns: i64) -> f64 {
        let (since, angle) = self.from;
        let farthest = DEGREES_PER_SECOND * 1e-9 * (at_ns - since).max(0) as f64;
        angle + (self.to - angle).clamp(-farthest, farthest)
    }

    /// Counts of the accelerometer, big-endian, between two bytes that say nothing and two of the motor.
    fn sense(&self, at_ns: i64) -> Vec<u8> {
        let angle = self.angle(at_ns);
        let (sin, cos) = angle.to_radians().sin_cos();
        let axes = [0.0, COUNTS * cos, COUNTS * sin].map(|counts| (counts.round() as i16).to_be_bytes());
        let is_moving = (angle - self.to).abs() > 1e-9;
        let (shown, status) = match angle {
            _ if is_moving => (UNKNOWN_ANGLE, MOVING),
            angle if angle.abs() >= LIMIT => ((2.0 * angle).round() as i8, AT_LIMIT),
            angle => ((2.0 * angle).round() as i8, STOPPED),
        };
        let mut answer = std::vec![0, 0];
        answer.extend(axes.concat());
        answer.extend([shown.cast_unsigned(), status]);
        answer
    }
}

impl Device for Motor {
    fn descriptors(&self) -> &Descriptors {
        &self.descriptors
    }

    fn vendor_request(&mut self, setup: Setup, _: &[u8], at_ns: i64) -> Answer {
        match (setup.request_type, setup.request) {
            _ if !self.answers => return Err(Stall),
            (0x40, 0x06) if setup.value < LED_STATES => self.led = setup.value,
            (0x40, 0x31) => {
                self.from = (at_ns, self.angle(at_ns));
                self.to = (f64::from(setup.value.cast_signed()) / 2.0).clamp(-LIMIT, LIMIT);
            }
            (0xc0, 0x32) => return Ok(self.sense(at_ns)),
            _ => return Err(Stall),
        }
        Ok(Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    fn tilt(motor: &mut Motor, degrees: i16, at_ns: i64) {
        let setup = Setup { request_type: 0x40, request: 0x31, value: (2 * degrees).cast_unsigned(), index: 0, length: 0 };
        assert_eq!(motor.control(setup, &[], at_ns), Ok(Vec::new()));
    }

    fn sense(motor: &mut Motor, at_ns: i64) -> Vec<u8> {
        motor.control(Setup { request_type: 0xc0, request: 0x32, value: 0, index: 0, length: 10 }, &[], at_ns).unwrap()
    }

    #[test]
    fn it_turns_slowly_and_the_accelerometer_along() {
        let mut motor = Motor::default();
        assert_eq!(sense(&mut motor, 0), [0, 0, 0, 0, 3, 0x33, 0, 0, 0, 0]);
        tilt(&mut motor, -10, SECOND);
        assert_eq!(sense(&mut motor, SECOND + SECOND / 4)[8..], [0x80, MOVING]);
        let arrived = sense(&mut motor, 2 * SECOND);
        assert_eq!(arrived[8..], [236, STOPPED], "−20 half degrees");
        let [y, z] = [4, 6].map(|at| f64::from(i16::from_be_bytes([arrived[at], arrived[at + 1]])));
        assert!((y.hypot(z) - COUNTS).abs() < 1.0 && (z.atan2(y).to_degrees() + 10.0).abs() < 0.1, "{y} {z}");
        tilt(&mut motor, 90, 2 * SECOND);
        assert_eq!(sense(&mut motor, 9 * SECOND)[8..], [62, AT_LIMIT]);
    }

    #[test]
    fn what_it_does_not_know_stalls() {
        let setup = Setup { request_type: 0x40, request: 0x06, value: 7, index: 0, length: 0 };
        assert_eq!(Motor::default().control(setup, &[], 0), Err(Stall));
        assert_eq!(Motor::default().control(Setup { request: 0x33, ..setup }, &[], 0), Err(Stall));
    }
}
