//! Simulated scenes through the whole engine, against their truth.

mod judge;

use judge::identity::Identities;
use judge::{Score, config, finals, hold, mean, rms, run};
use physinc::config::{KnownBox, KnownPlane, Method};
use physinc::event::{Contact, Inconsistency, Kind, Position, Surface, TrackEnded, TrackStarted};
use physinc::math::Vec3;
use physinc::sim::Scene;

/// Three would leave it to chance whether a height is within its limit.
const SEEDS: usize = 6;

fn bounces(keys: &str, method: Method) -> Score {
    let mut score = Score::default();
    for seed in 0..SEEDS {
        score.add(&format!("bounce?seed={}&distance={}&{keys}", 40 + seed, 1.55 + 0.08 * seed as f64), method);
    }
    score
}

#[test]
fn bounces_surfaces_and_uncertainties_are_right() {
    for keys in ["contact_duration=0", "contact_duration=0.0045"] {
        let score = bounces(keys, Method::Best);
        assert!(score.countable > 30 && score.matched as f64 >= 0.98 * score.countable as f64, "{}", score.row(keys, Method::Best));
        assert!((score.wrong as f64) <= 0.5 * score.minutes, "{}", score.row(keys, Method::Best));
        assert!(rms(&score.center) < 1.8e-3 && rms(&score.time) < 0.5e-3, "{}", score.row(keys, Method::Best));
        assert!(rms(&score.height) < 0.6e-3 && rms(&score.plane) < 0.6, "{}", score.row(keys, Method::Best));
        // 100 squares of normal errors scatter by a seventh; contacts of one throw are not independent.
        assert!((0.6..1.5).contains(&mean(&score.nees)), "{}", score.row(keys, Method::Best));
        assert_eq!(score.surfaces, [2; SEEDS]);
    }
}

#[test]
fn a_camera_that_was_told_nothing_finds_the_same_floor_and_box() {
    let score = bounces("tilt_deg=27", Method::Best);
    assert!(score.matched as f64 >= 0.9 * score.countable as f64 && score.surfaces == [2; SEEDS], "{}", score.row("tilt", Method::Best));
    assert!(rms(&score.height) < 1e-3 && rms(&score.plane) < 1.0 && rms(&score.gravity) < 0.3, "{}", score.row("tilt", Method::Best));
}

#[test]
fn missing_frames_cost_few_contacts() {
    let score = bounces("loss=0.25", Method::Best);
    assert!(score.matched as f64 >= 0.9 * score.countable as f64, "{}", score.row("loss", Method::Best));
    assert!((score.wrong as f64) <= 0.5 * score.minutes && rms(&score.center) < 3e-3, "{}", score.row("loss", Method::Best));
}

#[test]
fn the_papers_method_finds_bounces_less_exactly() {
    let (ours, papers) = (bounces("", Method::Best), bounces("", Method::Paper));
    assert!(papers.matched as f64 >= 0.9 * papers.countable as f64, "{}", papers.row("", Method::Paper));
    assert!(rms(&papers.center) > 2.0 * rms(&ours.center), "{} {}", ours.row("", Method::Best), papers.row("", Method::Paper));
}

#[test]
fn passive_flights_alarm_only_at_a_fixed_threshold() {
    let scene = Scene::parse("passive_flight?seed=4&distance=2").unwrap();
    let (ours, _) = run(&scene, &config(&scene, Method::Best));
    let (papers, _) = run(&scene, &config(&scene, Method::Paper));
    assert_eq!(finals!(ours, Inconsistency).len(), 0);
    assert_eq!(finals!(ours, Contact).len(), 0);
    assert!(finals!(papers, Inconsistency).len() > finals!(papers, TrackStarted).len());
    hold(&ours);
    hold(&papers);
}

#[test]
fn a_ball_that_drops_until_it_rests_tells_its_bounces_and_no_more() {
    for name in ["drop", "roll"] {
        let scene = Scene::parse(&format!("{name}?seed=9")).unwrap();
        let (events, _) = run(&scene, &config(&scene, Method::Best));
        hold(&events);
        let truth = &scene.truth().contacts;
        let found = finals!(events, Contact);
        assert!(found.len() <= truth.len(), "{name}: a flood");
        for (_, c) in &found {
            assert!(truth.iter().any(|t| (t.time_ns - c.time_ns).abs() < 20_000_000), "{name}: {c:?}");
        }
        let rest = truth.last().unwrap().time_ns + 300_000_000;
        assert!(finals!(events, Inconsistency).iter().filter(|(e, _)| e.timestamp_ns > rest).count() <= 1, "{name}: rest is quiet");
        assert_eq!(finals!(events, TrackStarted).len(), 1, "{name}");
    }
    let scene = Scene::parse("drop?seed=9").unwrap();
    let (events, _) = run(&scene, &config(&scene, Method::Best));
    assert!(finals!(events, Contact).len() >= 4);
    // It comes straight down and goes straight up: the tangents cancel, the normal is there.
    let (_, first) = finals!(events, Contact)[0];
    assert!(Vec3::from(first.normal.unwrap()).z > 0.99);
}

#[test]
fn two_balls_that_cross_keep_their_tracks() {
    let scene = Scene::parse("two_balls?seed=5&distance=2").unwrap();
    let (events, _) = run(&scene, &config(&scene, Method::Best));
    hold(&events);
    let truth = scene.truth();
    let mut owners = std::collections::HashMap::new();
    for (e, p) in finals!(events, Position) {
        let frame = &truth.frames[p.frame as usize];
        let distance = |c: &[f64; 3]| (Vec3::from(*c) - Vec3::from(p.center)).norm();
        let nearest = frame.balls.iter().min_by(|a, b| distance(&a.center).total_cmp(&distance(&b.center))).unwrap();
        assert!(distance(&nearest.center) < 0.03, "a position where no ball is: {p:?}");
        assert_eq!(*owners.entry(e.track).or_insert(nearest.ball), nearest.ball, "track {:?} swapped balls", e.track);
    }
    assert_eq!(owners.len(), truth.frames.iter().flat_map(|f| &f.balls).map(|b| b.ball).max().unwrap() + 1);
}

#[test]
fn many_balls_that_cross_and_hide_each_other_keep_their_tracks() {
    let mut sum = Identities::default();
    for seed in 0..3 {
        let scene = Scene::parse(&format!("many?balls=8&seed={seed}")).unwrap();
        let (events, _) = run(&scene, &config(&scene, Method::Best));
        hold(&events);
        sum.add(&events, scene.truth());
    }
    assert_eq!((sum.balls, sum.swapped, sum.ghosts), (48, 0, 0), "{}", sum.row("many"));
    assert!(sum.measured as f64 > 0.95 * sum.shown as f64 && sum.tracks < 2 * sum.balls, "{}", sum.row("many"));
}

#[test]
fn known_surfaces_are_announced_and_touched() {
    let scene = Scene::parse("bounce?seed=41&distance=1.7").unwrap();
    let mut config = config(&scene, Method::Best);
    let ground = KnownPlane { name: "ground".try_into().unwrap(), ..KnownPlane::default() };
    config.environment.plane.push(ground).unwrap();
    let (events, _) = run(&scene, &config);
    hold(&events);
    let first = events.iter().find_map(|e| if let Kind::Surface(s) = &e.kind { Some((e, s)) } else { None }).unwrap();
    assert!(!first.0.is_final && first.1.contacts == 0 && first.1.id == 0 && first.1.name.as_deref() == Some("ground"));
    let surfaces = finals!(events, Surface);
    assert_eq!(surfaces.len(), 2);
    assert!(surfaces[0].1.contacts >= 3 && (surfaces[1].1.above.unwrap().height - 0.09).abs() < 2e-3, "{surfaces:?}");
    assert_eq!(surfaces[1].1.above.unwrap().surface, 0);
    let known = KnownBox { center: [9.0; 3], size: [1.0; 3], ..KnownBox::default() };
    config.environment.r#box.push(known).unwrap();
    assert_eq!(finals!(run(&scene, &config).0, Surface).len(), 3);
}

#[test]
fn a_replay_is_exact_to_the_bit() {
    let scene = Scene::parse("bounce?seed=42&throws=2&distance=1.6").unwrap();
    let once = run(&scene, &config(&scene, Method::Best)).0;
    hold(&once);
    assert_eq!(once, run(&scene, &config(&scene, Method::Best)).0);
    assert!(finals!(once, TrackEnded).len() >= 2);
}
