//! The accelerometer's level against thrown balls: told where it is off by 3°, not told where it is right.

use physinc::config::{CameraConfig, Config};
use physinc::engine::Engine;
use physinc::event::{Event, Kind, LevelDisagreement};
use physinc::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW, Pose};
use physinc::math::{Mat3, Vec3};
use physinc::track::Measurement;
use rand::SeedableRng;
use rand::rngs::Xoshiro256PlusPlus;
use rand_distr::{Distribution, StandardNormal};

/// Four throws before a camera that looks 20° down and leans 5° aside, whose accelerometer is off by `degrees` in some direction, or is right
/// to within what makers promise.
fn stream(seed: u64, degrees: Option<f64>) -> Vec<Event> {
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(seed);
    let mut normal = |sd: [f64; 3]| {
        let mut draw = || Distribution::<f64>::sample(&StandardNormal, &mut rng);
        Vec3::new(sd[0] * draw(), sd[1] * draw(), sd[2] * draw())
    };
    let truth = nalgebra::Rotation3::from_euler_angles(-20f64.to_radians(), 0.0, 5f64.to_radians()) * Vec3::new(0.0, 9.81, 0.0);
    let across = truth.cross(&normal([1.0; 3])).normalize();
    let angle = degrees.unwrap_or_else(|| normal([0.5, 0.5, 0.0]).norm()).to_radians();
    let told = nalgebra::Rotation3::from_scaled_axis(across * angle) * truth;

    let keys = CameraConfig { gravity_in_camera: Some(told.into()), ..CameraConfig::default() };
    let camera = Camera::from_config(&keys, DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).unwrap();
    let mut config = Config::default();
    config.laws.drag = false;
    let mut engine = Engine::new(&config, Some(&camera)).unwrap();
    let pose = engine.world_from_camera();
    assert!((pose.rotation * told - Vec3::new(0.0, 0.0, -told.norm())).norm() < 1e-9);

    // What a Kinect's positions are like at 2 m, m.
    let sd = [6e-4, 6e-4, 3e-3];
    let covariance = pose.covariance_to_world(&Mat3::from_diagonal(&Vec3::from(sd.map(|sd| sd * sd))));
    let upright = Pose::level(&truth);
    let mut events = Vec::new();
    for frame in 0..120 {
        let (stamp, t) = (frame * 33_333_333, (frame % 30) as f64 / 30.0);
        let velocity = Vec3::new(1.5, 0.2 * (frame / 30) as f64, 2.5);
        let center = Vec3::new(-0.5, 2.0, -1.0) + velocity * t - Vec3::z() * (4.905 * t * t);
        let seen = upright.to_camera(&center) + normal(sd);
        let measurement = Measurement {
            time_ns: stamp,
            center: pose.to_world(&seen),
            covariance: Some(covariance),
            drift: Mat3::zeros(),
            center_in_camera: Some(seen),
            label: None,
            radius: 0.033,
            points: None,
            residual_rms: None,
            whole: true,
        };
        let measured = if t < 0.5 { std::slice::from_ref(&measurement) } else { &[] };
        engine.positions(stamp, measured, &mut |event| events.push(event));
    }
    engine.finish(&mut |event| events.push(event));
    events
}

fn disagreements(events: &[Event]) -> Vec<&LevelDisagreement> {
    events.iter().filter_map(|e| if let Kind::LevelDisagreement(d) = &e.kind { Some(d) } else { None }).collect()
}

#[test]
fn a_level_that_is_off_by_3_degrees_is_told_once() {
    for seed in 0..200 {
        let events = stream(seed, Some(3.0));
        let told = disagreements(&events);
        assert_eq!(told.len(), 1, "seed {seed}");
        let LevelDisagreement { gravity_in_camera, gravity_by_accelerometer, angle, sd, p_value, flights } = *told[0];
        let between = Vec3::from(gravity_in_camera).angle(&Vec3::from(gravity_by_accelerometer));
        assert!((angle - between).abs() < 1e-9 && p_value < 1e-3 && (1..=4).contains(&flights), "seed {seed}: {:?}", told[0]);
        assert!((angle - 3f64.to_radians()).abs() < 4.0 * sd, "seed {seed}: {:?}", told[0]);
    }
}

#[test]
fn a_level_that_is_right_is_not_told() {
    // 1000 streams, one false alarm of each 1000 allowed: more than 5 would be one of 1700 such tests.
    let alarms = (0..1000).filter(|&seed| !disagreements(&stream(seed, None)).is_empty()).count();
    assert!(alarms <= 5, "{alarms} of 1000");
    assert!((0..100).all(|seed| disagreements(&stream(seed, Some(0.0))).is_empty()));
}

#[test]
fn without_an_accelerometer_nothing_is_held_against_it() {
    let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).unwrap();
    assert_eq!(camera.world(), Pose::renamed_axes());
    let keys = CameraConfig { gravity_in_camera: Some([0.0; 3]), ..CameraConfig::default() };
    assert_eq!(keys.validate().unwrap_err().key, "camera.gravity_in_camera");
}
