//! Whatever comes in, the engine neither panics nor breaks what INTERFACE promises of its events.

#[path = "judge/mod.rs"]
#[cfg(feature = "sim")]
mod judge;

use physinc::config::{CameraAssumption, Config, LawName, Method};
use physinc::engine::Engine;
use physinc::event::{Counters, Event, GapReason, Kind};
use physinc::math::{Mat3, Vec3};
use physinc::track::Measurement;
use proptest::prelude::*;

fn measurement(time_ns: i64, center: [f64; 3], label: Option<u32>, variance: Option<f64>) -> Measurement {
    Measurement {
        time_ns,
        center: center.into(),
        covariance: variance.map(Mat3::from_diagonal_element),
        drift: Mat3::zeros(),
        center_in_camera: None,
        label,
        radius: 0.033,
        points: None,
        residual_rms: None,
        whole: true,
    }
}

fn stream(config: &Config, inputs: &[(i64, Vec<Measurement>)]) -> (Vec<Event>, Counters) {
    let mut engine = Engine::new(config, None).expect("valid");
    let mut events = Vec::new();
    for (stamp, positions) in inputs {
        engine.positions(*stamp, positions, &mut |e| events.push(e));
    }
    engine.finish(&mut |e| events.push(e));
    (events, engine.counters())
}

/// Coordinates near and far, and what is no number.
fn coordinate() -> impl Strategy<Value = f64> {
    prop_oneof![8 => -3.0..3.0, 1 => -1e12..1e12, 1 => prop::sample::select(vec![f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, -0.0])]
}

/// Stamps that go on, stand, jump and wrap.
fn step() -> impl Strategy<Value = i64> {
    prop_oneof![6 => 1_000_000i64..40_000_000, 1 => Just(0), 1 => -100_000_000i64..0, 1 => 40_000_000i64..10_000_000_000, 1 => prop::sample::select(vec![i64::MAX / 2, i64::MIN / 2])]
}

prop_compose! {
    fn one()(center in prop::array::uniform3(coordinate()), label in prop::option::weighted(0.3, 1u32..20), variance in prop::option::of(prop_oneof![Just(1e-6), Just(0.0), Just(-1.0), Just(f64::NAN)])) -> ([f64; 3], Option<u32>, Option<f64>) {
        (center, label, variance)
    }
}

proptest! {
    #[test]
    #[cfg(feature = "sim")]
    fn any_positions_give_wellformed_events(
        steps in prop::collection::vec((step(), prop::collection::vec(one(), 0..4)), 1..80),
        paper in any::<bool>(),
        camera in prop::sample::select(vec![None, Some(CameraAssumption::Tilted), Some(CameraAssumption::Moving), Some(CameraAssumption::Unknown)]),
    ) {
        let mut config = Config::default();
        config.laws.method = if paper { Method::Paper } else { Method::Best };
        config.assume.camera = camera;
        let mut stamp = 0i64;
        let inputs: Vec<_> = steps.into_iter().map(|(step, positions)| {
            stamp = stamp.wrapping_add(step);
            (stamp, positions.into_iter().map(|(center, label, variance)| measurement(stamp, center, label, variance)).collect::<Vec<_>>())
        }).collect();
        let (events, counters) = stream(&config, &inputs);
        judge::hold(&events);
        prop_assert_eq!(counters.frames as usize, inputs.len());
    }

    #[test]
    fn a_flight_at_any_rate_place_and_time_is_a_flight(
        rate in 20.0..400.0f64, start in -4_000_000_000_000_000_000i64..4_000_000_000_000_000_000, x in -100.0..100.0f64, vz in -3.0..3.0f64, vx in -5.0..5.0f64
    ) {
        let mut config = Config::default();
        config.laws.drag = false;
        let inputs: Vec<_> = (0..(rate * 0.5) as i64).map(|i| {
            let t = i as f64 / rate;
            let stamp = start + (t * 1e9) as i64;
            let center = Vec3::new(x + vx * t, 2.0, 1.0 + vz * t - 4.905 * t * t);
            (stamp, vec![measurement(stamp, center.into(), None, Some(1e-6))])
        }).collect();
        let (events, _) = stream(&config, &inputs);
        let odd = events.iter().find(|e| matches!(e.kind, Kind::Inconsistency(_) | Kind::Contact(_) | Kind::Gap(_)));
        prop_assert!(odd.is_none(), "{odd:?}");
    }
}

/// A ball that falls, bounces with e = 0.7 on z = 0 and flies on, as (t, center of the ball).
fn bounce(t: f64) -> [f64; 3] {
    let impact = 0.5;
    let speed = 0.4 + 9.81 * impact;
    let height = |s: f64| if s < 0.0 { -speed * s - 4.905 * s * s } else { 0.7 * speed * s - 4.905 * s * s };
    [0.3 * t, 1.5, 0.033 + height(t - impact)]
}

fn contacts(events: &[Event]) -> Vec<&physinc::event::Contact> {
    events.iter().filter(|e| e.is_final).filter_map(|e| if let Kind::Contact(c) = &e.kind { Some(c) } else { None }).collect()
}

fn ideal() -> Config {
    let mut config = Config::default();
    config.laws.drag = false;
    config.object.contact_duration = 0.0;
    config
}

#[test]
fn a_contact_in_a_gap_of_150_ms_is_found_at_30_and_at_300_hertz() {
    for rate in [30.0, 300.0] {
        let seen = (0..(rate * 1.1) as i64).map(|i| i as f64 / rate).filter(|t| !(0.43..0.58).contains(t));
        let inputs: Vec<_> = seen.map(|t| ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, bounce(t), None, Some(1e-6))])).collect();
        let (events, _) = stream(&ideal(), &inputs);
        let found = contacts(&events);
        assert_eq!(found.len(), 1, "{rate} Hz");
        assert!((found[0].time_ns - 500_000_000).abs() < 100_000 && found[0].center[2] - 0.033 < 1e-4, "{rate} Hz: {:?}", found[0]);
        assert!((found[0].restitution.unwrap() - 0.7).abs() < 1e-3);
    }
}

#[test]
fn positions_without_covariance_tell_their_noise_themselves() {
    // A fixed pattern of noise with a standard deviation of 2 mm.
    let noise = |i: i64, k: i64| 2e-3 * 1.6 * libm::sin((i * i * (7 + k)) as f64 * 1.3 + k as f64);
    let inputs: Vec<_> = (0..400)
        .map(|i| {
            let t = i as f64 / 300.0;
            let c = bounce(t);
            let center = [c[0] + noise(i, 0), c[1] + noise(i, 1), c[2] + noise(i, 2)];
            ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, center, None, None)])
        })
        .collect();
    let (events, _) = stream(&ideal(), &inputs);
    assert_eq!(contacts(&events).len(), 1);
    let last = events.iter().rev().find_map(|e| if let Kind::Position(p) = &e.kind { Some(p) } else { None }).unwrap();
    let sd = last.covariance[0][0].sqrt();
    assert!((0.5e-3..4e-3).contains(&sd), "{sd}");
}

#[test]
fn a_gap_in_positions_ends_no_track_and_makes_no_contact() {
    // A throw, half a second of nothing, and another throw from elsewhere.
    let throw = |t: f64| [t, 1.5, 1.0 + 2.0 * t - 4.905 * t * t];
    let inputs: Vec<_> = (0..60)
        .filter(|i| !(15..30).contains(i))
        .map(|i| {
            let t = f64::from(i) / 30.0;
            let center = if i < 15 { throw(t) } else { throw(t - 1.0) };
            ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, center, None, Some(1e-6))])
        })
        .collect();
    let (events, _) = stream(&ideal(), &inputs);
    assert!(contacts(&events).is_empty());
    assert_eq!(events.iter().filter(|e| matches!(e.kind, Kind::TrackStarted(_))).count(), 1);
    let gaps: Vec<_> = events.iter().filter_map(|e| if let Kind::Gap(g) = &e.kind { Some(g) } else { None }).collect();
    assert!(gaps.len() == 1 && gaps[0].reason == GapReason::FramesLost && gaps[0].frames == Some(15), "{gaps:?}");
}

#[test]
fn a_ball_held_still_is_carried_and_never_bounces() {
    for rate in [30.0, 300.0] {
        let inputs: Vec<_> = (0..(rate * 20.0) as i64)
            .map(|i| {
                let t = i as f64 / rate;
                let shake = 3e-4 * libm::sin(i as f64 * 1.7);
                ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, [0.1 + shake, 1.0 - shake, 1.9], None, None)])
            })
            .collect();
        let (events, _) = stream(&ideal(), &inputs);
        assert!(contacts(&events).is_empty(), "{rate} Hz");
        assert!(events.iter().filter(|e| matches!(e.kind, Kind::Inconsistency(_))).count() < 4, "{rate} Hz");
    }
}

#[test]
fn two_contacts_in_quick_succession_are_two() {
    // Floor, then a wall 100 ms later.
    let center = |t: f64| {
        let c = bounce(t);
        let x = if t < 0.6 { 2.0 * t } else { 1.2 - 1.4 * (t - 0.6) };
        [x, c[1], c[2]]
    };
    let inputs: Vec<_> = (0..33)
        .map(|i| {
            let t = f64::from(i) / 30.0;
            ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, center(t), None, Some(1e-6))])
        })
        .collect();
    let (events, _) = stream(&ideal(), &inputs);
    let found = contacts(&events);
    let times: Vec<i64> = found.iter().map(|c| c.time_ns / 1_000_000).collect();
    assert!(times.len() == 2 && (times[0] - 500).abs() < 3 && (times[1] - 600).abs() < 3, "{times:?}");
    assert!(Vec3::from(found[1].normal.unwrap()).x < -0.95);
}

/// A ball that falls to z = 0 with 1.4 m/s at 0.5 s and leaves with `restitution`, until it rolls.
fn hops(restitution: f64, t: f64) -> [f64; 3] {
    let (mut begin, mut speed) = (0.5, 1.4);
    let height = |s: f64, speed: f64| speed * s - 4.905 * s * s;
    if t < begin {
        return [0.3 * t, 1.5, 0.033 + height(t - begin, -speed)];
    }
    speed *= restitution;
    while t > begin + 2.0 * speed / 9.81 && speed > 1e-2 {
        (begin, speed) = (begin + 2.0 * speed / 9.81, speed * restitution);
    }
    [0.3 * t, 1.5, 0.033 + height(t - begin, speed).max(0.0)]
}

#[test]
fn of_two_contacts_in_one_gap_none_is_told_and_of_one_where_it_must_be() {
    let found = |config: &Config, restitution: f64, gap: std::ops::Range<f64>| {
        let seen = (0..165).map(|i| f64::from(i) / 240.0).filter(|t| !gap.contains(t));
        let inputs: Vec<_> =
            seen.map(|t| ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, hops(restitution, t), None, Some(1e-7))])).collect();
        let events = stream(config, &inputs).0;
        contacts(&events).iter().map(|c| (c.surface, (c.time_ns + 500_000) / 1_000_000)).collect::<Vec<_>>()
    };
    let (open, mut floor) = (ideal(), ideal());
    floor.environment.plane.push(physinc::config::KnownPlane::default()).expect("room for one");
    // At 0.5 and 0.628 s: one contact below the floor would explain it, too.
    assert_eq!(found(&open, 0.45, 0.49..0.64), []);
    assert_eq!(found(&floor, 0.45, 0.49..0.64), []);
    // At 0.5 s alone: of two, the first would have been seen.
    assert_eq!(found(&open, 0.65, 0.49..0.64), [(Some(0), 500)]);
    // At 0.5 s alone: two on a higher floor would do as well, unless it is known where it is.
    assert_eq!(found(&open, 0.65, 0.45..0.64), []);
    assert_eq!(found(&floor, 0.65, 0.45..0.64), [(Some(0), 500)]);
}

#[test]
fn a_low_hop_ends_in_time() {
    for phase in 0..8 {
        let times = (0..30).map(|i| (f64::from(i) + f64::from(phase) / 8.0) / 30.0);
        let inputs: Vec<_> =
            times.map(|t| ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, hops(0.35, t), None, Some(1e-6))])).collect();
        let (events, _) = stream(&ideal(), &inputs);
        // The hop after it takes 0.1 s, and is 12 mm high; the next ones are none that three frames could show.
        let first = contacts(&events)[0].clone();
        assert!((first.center[2] - 0.033).abs() < 1e-3 && (first.time_ns - 500_000_000).abs() < 1_000_000, "{phase}: {first:?}");
    }
}

#[test]
fn a_hop_of_which_one_frame_tells_makes_no_contact_below_the_floor() {
    let at = |t: f64, center| ((t * 1e9) as i64, vec![measurement((t * 1e9) as i64, center, None, Some(2.5e-7))]);
    for (restitution, phase) in [0.4, 0.45, 0.5, 0.55, 0.6].into_iter().flat_map(|e| (0..12).map(move |phase| (e, phase))) {
        // Three throws show where the floor is.
        let throws = (0..3).flat_map(|n| (0..30).map(move |i| (f64::from(n), f64::from(i) / 30.0)));
        let throws = throws.map(|(n, t)| at(2.0 * n + t, bounce(t)));
        let times = (0..45).map(|i| (f64::from(i) + f64::from(phase) / 12.0) / 30.0);
        let inputs: Vec<_> = throws.chain(times.map(|t| at(6.0 + t, hops(restitution, t)))).collect();
        let (events, _) = stream(&ideal(), &inputs);
        let told = contacts(&events);
        let right = |contact: &physinc::event::Contact| contact.center[2] > 0.033 - 4e-3 && contact.surface == Some(0);
        assert!(told.len() > 3 && told.iter().all(|contact| right(contact)), "{restitution}, {phase}: {told:?}");
    }
}

#[test]
fn at_constant_velocity_what_falls_is_inconsistent_and_what_goes_straight_on_is_not() {
    let mut config = Config::default();
    config.laws.law = LawName::ConstantVelocity;
    let odd = |path: fn(f64) -> [f64; 3]| {
        let inputs: Vec<_> =
            (0..60).map(|i| (i * 10_000_000, vec![measurement(i * 10_000_000, path(i as f64 / 100.0), None, Some(1e-7))])).collect();
        let events = stream(&config, &inputs).0;
        events.iter().find_map(|e| if let Kind::Inconsistency(odd) = &e.kind { Some(odd.clone()) } else { None })
    };
    assert_eq!(odd(|t| [3.0 * t, 1.5, 1.0 + 0.5 * t]), None);
    let fell = odd(|t| [3.0 * t, 1.5, 2.0 - 4.905 * t * t]).unwrap();
    assert!(fell.predicted[2] > fell.measured[2] && (fell.predicted[0] - fell.measured[0]).abs() < 1e-3, "{fell:?}");
}
