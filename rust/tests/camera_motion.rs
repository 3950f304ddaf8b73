//! The path of a camera that moves while balls fly before it: from positions, and from simulated frames.

mod judge;

use judge::{finals, hold};
use physinc::config::{CameraAssumption, Config, Method};
use physinc::engine::Engine;
use physinc::event::{CameraMotion, CameraOrientation, Contact, Event, Kind, Position, Undetermined};
use physinc::math::{Mat3, Vec3};
use physinc::physics::law::{FreeFallWithDrag, Law, State};
use physinc::sim::Scene;
use physinc::track::Measurement;

const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);
const SD: f64 = 1e-3;

/// Numbers like independent normal ones.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A ball's center at `t` (s), by a tracker that knows it as `label`.
fn measured(t: f64, center: Vec3, label: u32) -> Measurement {
    Measurement {
        time_ns: (t * 1e9) as i64,
        center,
        covariance: Some(Mat3::from_diagonal_element(SD * SD)),
        drift: Mat3::zeros(),
        center_in_camera: None,
        label: Some(label),
        radius: 0.033,
        points: None,
        residual_rms: None,
        whole: true,
    }
}

/// Balls, one after the other: each of 24 frames, 0.5 s apart; before a camera whose displacement is `camera`(seconds since the first frame).
fn throw(flights: u32, camera: impl Fn(f64) -> Vec3, config: &Config, seed: u64) -> Vec<Event> {
    let mut engine = Engine::for_positions(config).unwrap();
    let (mut noise, mut events) = (Noise(seed), Vec::new());
    let law = FreeFallWithDrag::of(&config.object, &config.laws, 0.033);
    for flight in 0..flights {
        let begun = f64::from(flight) * 1.3;
        let turn = f64::from(flight);
        let start = State { t: begun, position: Vec3::new(0.1, 1.7, 0.2), velocity: Vec3::new(turn.cos(), 0.5 * turn.sin(), 3.6) };
        for k in 0..24 {
            let t = begun + f64::from(k) / 30.0;
            let off = Vec3::new(noise.next(), noise.next(), noise.next()) * SD;
            let center = start.at(t, &law as &dyn Law, &G).position - camera(t) + off;
            engine.positions((t * 1e9) as i64, &[measured(t, center, flight)], &mut |e| events.push(e));
        }
    }
    engine.finish(&mut |e| events.push(e));
    hold(&events);
    events
}

fn moving(camera: CameraAssumption, method: Method) -> Config {
    let mut config = Config::default();
    config.assume.camera = Some(camera);
    config.laws.method = method;
    config
}

/// 15.5 cm to the right in the middle of the first flight, in a third of a second.
fn pushed(t: f64) -> Vec3 {
    let s = ((t - 0.23) / 0.33).clamp(0.0, 1.0);
    Vec3::new(0.155, 0.0, 0.0) * (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s))
}

/// Root mean square of the path's error in space, m.
fn error(events: &[Event], camera: impl Fn(f64) -> Vec3) -> f64 {
    let motions = finals!(events, CameraMotion);
    let stamp = |frame: u64| {
        let positions = finals!(events, Position);
        positions.iter().find(|(_, p)| p.frame == frame).map(|(e, _)| e.timestamp_ns as f64 * 1e-9).unwrap()
    };
    let squares: f64 = motions.iter().map(|(_, m)| (Vec3::from(m.displacement) - camera(stamp(m.frame))).norm_squared()).sum();
    (squares / motions.len() as f64).sqrt()
}

#[test]
fn every_frame_in_which_something_is_tracked_has_one_displacement_in_time() {
    let events = throw(3, pushed, &moving(CameraAssumption::Moving, Method::Best), 4);
    let (motions, positions) = (finals!(events, CameraMotion), finals!(events, Position));
    let frames: Vec<u64> = motions.iter().map(|(_, m)| m.frame).collect();
    assert_eq!(frames, (0..72).collect::<Vec<u64>>());
    assert!(finals!(events, Contact).is_empty());
    for (told, motion) in &motions {
        assert!(motion.undetermined.contains(&Undetermined::Velocity) && told.track.is_none());
        // 0.27 s after its flight, or with the first frame after that.
        let end = 24 * (motion.frame / 24) + 23;
        let end_ns = positions.iter().find(|(_, p)| p.frame == end).unwrap().0.timestamp_ns;
        let next_ns = positions.iter().map(|(e, _)| e.timestamp_ns).find(|t| *t > end_ns + 200_000_000).unwrap_or(i64::MAX);
        assert!(told.timestamp_ns <= next_ns);
    }
    // Where it went is known less well than from where to where each flight saw it go: its errors add up.
    assert!(error(&events, pushed) < 8.0 * SD, "{}", error(&events, pushed));
}

#[test]
fn a_path_in_mid_flight_is_found_within_two_glimpses_errors() {
    let errors: Vec<f64> =
        (0..10).map(|seed| error(&throw(1, pushed, &moving(CameraAssumption::Moving, Method::Best), seed), pushed)).collect();
    // In space a single glimpse is off by 1.7 SD.
    assert!(judge::rms(&errors) < 3.4 * SD, "{errors:?}");
}

/// Errors (m) and their squares by the told covariance, a degree of freedom, of a slide by 15.5 cm in mid-flight that starts and stops at once, at
/// `rate` (Hz).
fn slid(rate: f64, sd: f64, seeds: u64) -> (Vec<f64>, Vec<f64>) {
    let config = moving(CameraAssumption::Moving, Method::Best);
    let (mut errors, mut nees) = (Vec::new(), Vec::new());
    for seed in 0..seeds {
        let mut noise = Noise(seed);
        let way = Vec3::new(noise.next(), noise.next(), noise.next()).normalize() * 0.155;
        let camera = |t: f64| {
            let s = ((t - 0.25) / 0.4).clamp(0.0, 1.0);
            way * (s * s * (3.0 - 2.0 * s))
        };
        let start = State { t: 0.0, position: Vec3::new(0.1, 1.7, 0.2), velocity: Vec3::new(0.4, 0.1, 3.8) };
        let mut engine = Engine::for_positions(&config).unwrap();
        let mut events = Vec::new();
        for k in 0..(0.9 * rate) as u32 {
            let t = f64::from(k) / rate;
            let law = FreeFallWithDrag::of(&config.object, &config.laws, 0.033);
            let off = Vec3::new(noise.next(), noise.next(), noise.next()) * sd;
            let covariance = Some(Mat3::from_diagonal_element(sd * sd));
            let center = start.at(t, &law as &dyn Law, &G).position - camera(t) + off;
            engine.positions((t * 1e9) as i64, &[Measurement { covariance, ..measured(t, center, 1) }], &mut |e| events.push(e));
        }
        engine.finish(&mut |e| events.push(e));
        hold(&events);
        let motions = finals!(events, CameraMotion);
        assert_eq!(motions.iter().map(|(_, m)| m.frame).collect::<Vec<_>>(), (0..(0.9 * rate) as u64).collect::<Vec<_>>());
        for (_, motion) in motions {
            let error = Vec3::from(motion.displacement) - camera(motion.frame as f64 / rate);
            let covariance = Mat3::from_fn(|i, j| motion.covariance[i][j]) + Mat3::identity() * 1e-8;
            errors.push(error.norm());
            nees.push(error.dot(&(covariance.try_inverse().unwrap() * error)) / 3.0);
        }
    }
    (errors, nees)
}

#[test]
fn more_frames_make_a_path_no_worse() {
    let (errors, _) = slid(30.0, 1.5e-3, 12);
    let few = judge::rms(&errors);
    for (rate, sd) in [(60.0, 1.5e-3), (120.0, 1.5e-3), (240.0, 1e-3)] {
        let (errors, nees) = slid(rate, sd, 12);
        assert!(judge::rms(&errors) < few, "{rate} Hz: {} {few}", judge::rms(&errors));
        assert!(judge::mean(&nees) < 2.0, "{rate} Hz: {}", judge::mean(&nees));
    }
}

#[test]
fn the_papers_path_is_far_less_exact() {
    let ours = throw(1, pushed, &moving(CameraAssumption::Moving, Method::Best), 11);
    let papers = throw(1, pushed, &moving(CameraAssumption::Moving, Method::Paper), 11);
    assert_eq!(finals!(papers, CameraMotion).len(), 24);
    assert!(error(&papers, pushed) > 4.0 * error(&ours, pushed), "{} {}", error(&papers, pushed), error(&ours, pushed));
}

#[test]
fn a_bounce_is_no_motion_of_the_camera() {
    // The camera stands; what bounces does so between two flights.
    let mut engine = Engine::for_positions(&moving(CameraAssumption::Moving, Method::Best)).unwrap();
    let (mut noise, mut events) = (Noise(2), Vec::new());
    let mut state = State { t: 0.0, position: Vec3::new(0.0, 1.5, 0.8), velocity: Vec3::new(0.6, 0.1, 0.0) };
    for k in 0..40 {
        let t = f64::from(k) / 30.0;
        state = state.at(t, &FreeFallWithDrag { drag: 0.019 }, &G);
        if state.position.z < 0.033 && state.velocity.z < 0.0 {
            state.velocity.z *= -0.75;
        }
        let off = Vec3::new(noise.next(), noise.next(), noise.next()) * SD;
        engine.positions((t * 1e9) as i64, &[measured(t, state.position + off, 1)], &mut |e| events.push(e));
    }
    engine.finish(&mut |e| events.push(e));
    hold(&events);
    let farthest = finals!(events, CameraMotion).iter().map(|(_, m)| Vec3::from(m.displacement).norm()).fold(0.0, f64::max);
    assert!(farthest < 5e-3, "{farthest}");
}

#[test]
fn with_gravity_unknown_it_is_learned_from_flights_before_a_camera_that_stands() {
    let events = throw(4, |_| Vec3::zeros(), &moving(CameraAssumption::Unknown, Method::Best), 8);
    let learned = finals!(events, CameraOrientation);
    let (_, last) = learned.last().expect("flights tell of gravity");
    assert_eq!((last.flights, last.undetermined.as_slice()), (4, &[Undetermined::Heading][..]));
    assert!((Vec3::from(last.gravity_in_camera) - G).norm() < 0.05, "{:?}", last.gravity_in_camera);
    assert!(finals!(events, CameraMotion).iter().all(|(_, m)| m.undetermined.contains(&Undetermined::AccelerationOrGravity)));
}

#[test]
fn a_camera_that_stands_before_balls_that_bounce_is_never_said_to_have_moved() {
    let mut told = 0;
    for scene in ["bounce?distance=1.75", "many?balls=3"] {
        for seed in 0..6 {
            let mark = if scene.contains('?') { '&' } else { '?' };
            let scene = Scene::parse(&format!("{scene}{mark}seed={seed}")).unwrap();
            let mut config = judge::config(&scene, Method::Best);
            config.assume.camera = Some(CameraAssumption::Moving);
            let (events, _) = judge::run(&scene, &config);
            for (_, motion) in finals!(events, CameraMotion) {
                let covariance = Mat3::from_fn(|i, j| motion.covariance[i][j]) + Mat3::identity() * 1e-8;
                let d = Vec3::from(motion.displacement);
                let sds = d.dot(&(covariance.try_inverse().unwrap() * d)).sqrt();
                assert!(sds < 5.0, "{} frame {}: {d:?} m, {sds} sd", scene.truth().scene, motion.frame);
                told += 1;
            }
        }
    }
    assert!(told > 1000, "{told}");
}

/// Errors (camera axes, mm) of the path in simulated frames of one throw.
fn path_errors(structure: &str) -> Vec<Vec3> {
    let mut errors = Vec::new();
    for seed in 0..3 {
        let scene = Scene::parse(&format!("translating_camera?throws=1&structure={structure}&seed={seed}&distance=1.7")).unwrap();
        let (events, pose) = judge::run(&scene, &moving(CameraAssumption::Moving, Method::Best));
        hold(&events);
        for (_, motion) in finals!(events, CameraMotion) {
            let truth = scene.truth().frames[motion.frame as usize].camera_displacement.unwrap();
            errors.push(pose.rotation.transpose() * (Vec3::from(motion.displacement) - Vec3::from(truth)) * 1e3);
            assert!(!motion.undetermined.is_empty());
        }
    }
    errors
}

fn rms_of(errors: &[Vec3], part: impl Fn(&Vec3) -> f64) -> f64 {
    judge::rms(&errors.iter().map(part).collect::<Vec<_>>())
}

#[test]
fn a_ball_alone_tells_the_path_of_a_camera_that_sees_nothing_else() {
    let errors = path_errors("none");
    assert!(errors.len() > 45 && rms_of(&errors, Vec3::norm) < 5.0, "{}", rms_of(&errors, Vec3::norm));
}

#[test]
fn static_planes_tie_the_camera_down_along_their_normals() {
    let errors = path_errors("both");
    assert!(errors.len() > 45 && rms_of(&errors, |e| e.y) < 0.5 && rms_of(&errors, |e| e.z) < 0.5, "{errors:?}");
    assert!(rms_of(&errors, |e| e.x) < 5.0, "{}", rms_of(&errors, |e| e.x));
}

#[test]
fn a_rolled_camera_is_levelled_by_the_flights_before_it() {
    for (method, one, six) in [(Method::Best, 0.6, 0.15), (Method::Paper, 9.0, 2.0)] {
        let mut config = Config::default();
        config.laws.method = method;
        let scene = Scene::parse("rotated_camera?seed=3").unwrap();
        let (events, _) = judge::run(&scene, &config);
        let truth = Vec3::from(scene.truth().gravity_in_camera);
        let found = finals!(events, CameraOrientation);
        let off = |o: &CameraOrientation| truth.angle(&Vec3::from(o.gravity_in_camera)).to_degrees();
        assert_eq!(found.len(), 6, "{method:?}");
        assert!(off(found[0].1) < one && off(found[5].1) < six, "{method:?}: {} {}", off(found[0].1), off(found[5].1));
        assert!((found[5].1.roll.to_degrees().abs() - 18.0).abs() < six);
    }
}
