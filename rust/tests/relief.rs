//! What is learned of the scene from its depth background, against the truth of simulated scenes, and what follows from it.

mod judge;

use judge::{finals, hold};
use physinc::config::{Config, LawName, ObjectsAssumption, Shape};
use physinc::engine::Engine;
use physinc::event::{Activity, Event, Kind, Position};
use physinc::geometry::environment::{Relief, Space};
use physinc::math::{Mat3, Vec3};
use physinc::seeing::Image;
use physinc::sim::Scene;

/// The engine after the frames of `scene` in which its background is learned, and how many these are.
fn learned(scene: &Scene, config: &Config) -> (Engine<'static>, usize) {
    let mut engine = Engine::new(config, Some(&scene.camera())).unwrap();
    let (mut frames, mut count) = (scene.frames(), 0);
    while let Some(frame) = frames.next_frame().filter(|_| engine.environment().relief().is_none()) {
        engine.frame(frame.timestamp_ns, Image::U16(frame.samples), &mut |_| {}).unwrap();
        count += 1;
    }
    (engine, count)
}

fn planes(relief: &Relief) -> Vec<(Vec3, f64)> {
    (0..).map_while(|number| relief.plane(number)).collect()
}

/// Unit normal and offset of a surface of the scene in the stream's world.
fn surface(scene: &Scene, engine: &Engine, name: &str) -> (Vec3, f64) {
    let truth = scene.truth().surfaces.iter().find(|s| s.name == name).unwrap();
    let pose = engine.world_from_camera();
    let normal = pose.rotation * Vec3::from(truth.normal_in_camera);
    (normal, truth.offset_in_camera + normal.dot(&pose.translation))
}

#[test]
fn floor_and_wall_are_learned() {
    let (mut worst, mut squares) = ((0.0, 0.0), Vec::new());
    for seed in 0..10 {
        for keys in ["pose=1", "pose=1&tilt_deg=35&distance=1.4&height=0.5", "kind=depth&roll_deg=10"] {
            let scene = Scene::parse(&format!("room?seed={seed}&{keys}")).unwrap();
            let (engine, frames) = learned(&scene, &Config::default());
            let relief = engine.environment().relief().unwrap();
            let planes = planes(relief);
            assert!(planes.len() == 2 && frames < 20, "{seed} {keys}: {frames} frames, {planes:?}");
            for name in ["ground", "wall"] {
                let (normal, offset) = surface(&scene, &engine, name);
                let turned = |number: &usize| planes[*number].0.angle(&normal);
                let number = (0..planes.len()).min_by(|a, b| turned(a).total_cmp(&turned(b))).unwrap();
                let (angle, off) = (turned(&number).to_degrees(), 1e3 * (planes[number].1 - offset).abs());
                worst = (f64::max(worst.0, angle), f64::max(worst.1, off));
                // Where the middle ray of the lower half meets it, and where that of the upper half does.
                let camera = scene.camera();
                let row = camera.height as f64 * if name == "ground" { 0.75 } else { 0.25 };
                let (pose, ray) = (engine.world_from_camera(), camera.deproject(camera.cx, row, 1.0));
                let ray = pose.rotation * ray;
                let point = pose.translation + ray * ((offset - normal.dot(&pose.translation)) / normal.dot(&ray));
                let error = planes[number].0.dot(&point) - planes[number].1;
                squares.push((error / relief.sd(number, &point)).powi(2));
            }
        }
    }
    println!("at most {:.3}° and {:.2} mm off; NEES at a point {:.2}", worst.0, worst.1, judge::mean(&squares));
    assert!(worst.0 < 0.5 && worst.1 < 5.0);
}

/// Errors of predictions, m, and their normalised squares an axis.
#[derive(Default)]
struct Errors {
    size: Vec<f64>,
    nees: Vec<f64>,
}

impl Errors {
    fn add(&mut self, off: &Vec3, covariance: &Mat3) {
        self.size.push(off.norm());
        self.nees.push(off.dot(&(covariance.try_inverse().expect("a covariance") * off)) / 3.0);
    }

    fn row(&self) -> String {
        let beyond = self.nees.iter().filter(|x| 3.0 * **x > 7.815).count() as f64 / self.nees.len() as f64;
        format!("{} predictions, {:.1} mm rms, NEES an axis {:.2}, {:.1} % beyond 95 %", self.size.len(), 1e3 * judge::rms(&self.size), judge::mean(&self.nees), 1e2 * beyond)
    }
}

/// Predictions 0.2 to 0.3 s before a bounce on the floor, of where the ball is 0.1 s after it: among what is known, and by free fall.
fn across(seeds: std::ops::Range<u32>, keys: &str) -> [Errors; 2] {
    let mut errors = [Errors::default(), Errors::default()];
    for seed in seeds {
        let scene = Scene::parse(&format!("room?seed={seed}&{keys}")).unwrap();
        let mut config = Config::default();
        config.object.contact_duration = scene.truth().parameters.contact_duration;
        let mut engine = Engine::new(&config, Some(&scene.camera())).unwrap();
        let truth = scene.truth();
        let pose = engine.world_from_camera();
        let mut frames = scene.frames();
        while let Some(frame) = frames.next_frame() {
            let now = frame.timestamp_ns;
            let here: Vec<_> = frame.truth.balls.iter().map(|b| (b.ball, pose.to_world(&Vec3::from(b.center_in_camera)))).collect();
            engine.frame(now, Image::U16(frame.samples), &mut |_| {}).unwrap();
            for predictor in engine.predictors() {
                let Some((ball, _)) = here.iter().find(|(_, center)| (predictor.predict(now).0 - center).norm() < 0.02) else { continue };
                let touches = || truth.contacts.iter().filter(|c| c.ball == *ball && c.time_ns > now);
                let Some(next) = touches().next().filter(|c| c.surface == "ground" && (200..300).contains(&((c.time_ns - now) / 1_000_000))) else {
                    continue;
                };
                let states = truth.frames.iter().flat_map(|f| &f.balls).filter(|b| b.ball == *ball);
                let Some(then) = states.clone().find(|b| b.time_ns >= next.time_ns + 100_000_000) else { continue };
                if touches().nth(1).is_some_and(|c| c.time_ns < then.time_ns) || states.filter(|b| b.time_ns <= now).count() < 6 {
                    continue;
                }
                let center = pose.to_world(&Vec3::from(then.center_in_camera));
                let predictions = [predictor.predict_among(engine.environment(), then.time_ns), predictor.predict(then.time_ns)];
                for (errors, (predicted, covariance)) in errors.iter_mut().zip(predictions) {
                    errors.add(&(center - predicted), &covariance);
                }
            }
        }
    }
    errors
}

#[test]
fn a_prediction_goes_through_a_bounce_on_a_floor_that_is_seen() {
    for keys in ["pose=1", ""] {
        let [among, free] = across(0..24, keys);
        println!("{keys}: among {}; free {}", among.row(), free.row());
    }
}

/// Each object's final activities beside the truth: frames that are active or not and told so, 6 frames around each change left out.
#[derive(Default, Debug)]
struct Judged {
    active: (usize, usize),
    passive: (usize, usize),
}

fn judged(scene: &Scene, config: &Config, airborne: Option<f64>) -> Judged {
    let (events, _) = judge::run(scene, config);
    hold(&events);
    let truth = &scene.truth().frames;
    let told = finals!(events, Activity);
    let mut judged = Judged::default();
    for (e, p) in finals!(events, Position) {
        let frame = p.frame as usize;
        // What moves, whether it is active, and how high it is.
        let state = |f: usize| {
            let object = truth[f].objects.first().map(|o| (o.active, o.center[2]));
            object.or_else(|| truth[f].balls.first().map(|b| (b.active, b.center[2])))
        };
        let Some((active, height)) = state(frame) else { continue };
        let changes = (frame.saturating_sub(6)..=(frame + 6).min(truth.len() - 1)).any(|f| state(f).is_some_and(|s| s.0 != active));
        if changes || airborne.is_some_and(|least| active && height < least) {
            continue;
        }
        let told_active = told.iter().any(|(t, a)| t.track == e.track && a.active && (a.start_ns..=a.end_ns).contains(&e.timestamp_ns));
        let (right, all) = if active { &mut judged.active } else { &mut judged.passive };
        *all += 1;
        *right += usize::from(told_active == active);
    }
    judged
}

fn unknown(law: LawName, any: bool) -> Config {
    let mut config = Config::default();
    config.assume.objects = ObjectsAssumption::Unknown;
    config.laws.law = law;
    if any {
        config.object.shape = Shape::Any;
    }
    config
}

#[test]
fn activity() {
    use physinc::config::KnownPlane;
    for (name, law, any, airborne) in [
        ("toy_car?", LawName::Auto, true, None),
        ("flying_robot?", LawName::FreeFall, true, Some(0.25)),
        ("roll?tilt_deg=20&pose=1&", LawName::FreeFall, false, None),
        ("roll?tilt_deg=20&pose=1&", LawName::Auto, false, None),
        ("room?pose=1&", LawName::FreeFall, false, None),
    ] {
        for file in [false, true] {
            let mut sum = Judged::default();
            for seed in 0..8 {
                let scene = Scene::parse(&format!("{name}seed={seed}")).unwrap();
                let mut config = unknown(law, any);
                if file {
                    config.environment.plane.push(KnownPlane::default()).unwrap();
                }
                let j = judged(&scene, &config, airborne);
                sum.active = (sum.active.0 + j.active.0, sum.active.1 + j.active.1);
                sum.passive = (sum.passive.0 + j.passive.0, sum.passive.1 + j.passive.1);
            }
            println!("{name} {law:?} file {file}: {sum:?}");
        }
    }
}

#[test]
fn times() {
    for scene in ["room?pose=1", "bounce", "flying_robot"] {
        let scene = Scene::parse(scene).unwrap();
        let mut engine = Engine::new(&Config::default(), Some(&scene.camera())).unwrap();
        let mut frames = scene.frames();
        let mut n = 0;
        while let Some(frame) = frames.next_frame().filter(|_| n < 25) {
            let t = std::time::Instant::now();
            engine.frame(frame.timestamp_ns, Image::U16(frame.samples), &mut |_| {}).unwrap();
            println!("{n}: {:?} {}", t.elapsed(), engine.environment().relief().is_some());
            n += 1;
        }
    }
    println!("{} {}", size_of::<Engine>(), size_of::<Relief>());
}
