//! Things of any shape, followed through frames, against where they were put.

mod solids;

use heapless::Vec as Fixed;
use physinc::config::{CameraConfig, Config, ObjectConfig, Shape};
use physinc::detect::{Blob, Detection};
use physinc::engine::Engine;
use physinc::event::{Event, Kind};
use physinc::geometry::camera::{Camera, DepthCode, Pose};
use physinc::geometry::motion::Motion;
use physinc::math::{Mat3, Vec3};
use physinc::seeing::{Buffers, Image, Scope, Seeing};
use physinc::sim::Scene;
use physinc::sim::truth::ObjectTruth;
use solids::{Random, Solid, blob, car, disturb, draw};

const WALL: f32 = 2.5;
const FRAME_NS: i64 = 33_333_333;
const BACKGROUND_FRAMES: u32 = 3;

fn any() -> ObjectConfig {
    ObjectConfig { shape: Shape::Any, ..ObjectConfig::default() }
}

/// 640 / `part` columns.
fn camera(part: u32) -> Camera {
    let (size, focal) = ([640 / part, 480 / part], Some(575.8 / f64::from(part)));
    let middle = size.map(|pixels| Some(f64::from(pixels) / 2.0 - 0.5));
    let keys = CameraConfig {
        width: Some(size[0]),
        height: Some(size[1]),
        fx: focal,
        fy: focal,
        cx: middle[0],
        cy: middle[1],
        ..CameraConfig::default()
    };
    Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 }).expect("a camera")
}

/// Bodies before a wall, with noise if there is a source of it.
fn view(camera: &Camera, bodies: &[(&[Solid], Motion)], random: Option<&mut Random>) -> Vec<f32> {
    let mut image = vec![f32::NAN; camera.width * camera.height];
    for (body, pose) in bodies {
        image.iter_mut().zip(draw(camera, body, pose)).for_each(|(pixel, z)| *pixel = pixel.min(z));
    }
    if let Some(random) = random {
        image = disturb(camera, &image, random);
    }
    image.into_iter().map(|z| z.min(WALL)).collect()
}

struct Watcher {
    seeing: Seeing<'static>,
    now_ns: i64,
}

impl Watcher {
    fn new(camera: &Camera) -> Self {
        let seeing =
            Seeing::new(camera, &any(), BACKGROUND_FRAMES, Buffers::owned(camera.width, camera.height)).expect("buffers of its size");
        let mut watcher = Self { seeing, now_ns: 0 };
        let wall = view(camera, &[], None);
        (0..BACKGROUND_FRAMES).for_each(|_| assert!(watcher.see(&wall).is_empty()));
        watcher
    }

    fn see(&mut self, image: &[f32]) -> Fixed<Detection, 16> {
        let mut found = Fixed::new();
        self.now_ns += FRAME_NS;
        let scope = Scope { timestamp_ns: Some(self.now_ns), ..Scope::default() };
        self.seeing.see_in(Image::F32(image), scope, &mut found).expect("the camera's image");
        found
    }
}

/// A car's drive: straight on, a turn of a quarter circle, straight on; seen from above at an angle.
fn drive(frame: usize) -> Motion {
    let time = frame as f64 / 30.0;
    let (speed, radius): (f64, f64) = (0.4, 0.25);
    let turn = (speed / radius * (time - 1.0)).clamp(0.0, std::f64::consts::FRAC_PI_2);
    let straight = speed * (time.min(1.0));
    let after = (speed * (time - 1.0) - radius * std::f64::consts::FRAC_PI_2).max(0.0);
    let (x, y) = (straight + radius * turn.sin() + after * turn.cos(), radius * (1.0 - turn.cos()) + after * turn.sin());
    let on_floor = Motion::about(&Vec3::zeros(), &Vec3::new(0.0, 0.0, turn), &Vec3::new(x, y, 0.0));
    // World x to the right, y away, z up, to a camera that looks 35° down.
    let tilt = Motion::about(&Vec3::zeros(), &Vec3::new(std::f64::consts::FRAC_PI_2 + 0.6, 0.0, 0.0), &Vec3::new(-0.4, 0.1, 1.6));
    tilt.after(&on_floor)
}

/// Motion of the point of reference against the truth, after both begin at one place: the rms, m, and the last errors' mean.
fn follow(camera: &Camera, body: &[Solid], poses: impl Iterator<Item = Motion>, random: &mut Random) -> (f64, Vec3, f64) {
    let mut watcher = Watcher::new(camera);
    let mut first: Option<(Motion, Vec3, u32)> = None;
    let (mut errors, mut nees, mut is_first) = (Vec::new(), 0.0, true);
    for pose in poses {
        let found = watcher.see(&view(camera, &[(body, pose)], Some(random)));
        let whole: Vec<_> = found.iter().filter(|d| d.blob == Blob::Whole).collect();
        if std::mem::take(&mut is_first) {
            assert!(found.is_empty(), "noise may look so once");
            continue;
        }
        assert_eq!(whole.len(), 1, "at frame {}: {found:?}", errors.len());
        let (seen, id) = (whole[0], whole[0].shape.expect("a number"));
        let (start, reference, number) = first.get_or_insert((pose, seen.center, id));
        assert_eq!(*number, id);
        let error = seen.center - pose.of(&start.inverse().of(reference));
        nees += error.dot(&((seen.covariance + seen.drift).try_inverse().expect("a covariance") * error)) / 3.0;
        errors.push(error);
    }
    let squares: f64 = errors.iter().map(Vec3::norm_squared).sum();
    let last = errors.iter().rev().take(10).sum::<Vec3>() / 10.0;
    (f64::sqrt(squares / errors.len() as f64), last, nees / errors.len() as f64)
}

#[test]
fn a_car_is_followed_through_its_turn() {
    let camera = camera(1);
    for seed in 3000..3002 {
        let (rms, last, nees) = follow(&camera, &car(), (0..75).map(drive), &mut Random::new(seed));
        println!("car: {:.1} mm rms, {:.1} mm at the end, NEES {nees:.1}", 1e3 * rms, 1e3 * last.norm());
        assert!(rms < 0.008 && last.norm() < 0.015, "{rms} m rms, {last} m");
    }
}

#[test]
fn a_tumbling_body_is_followed() {
    let camera = camera(1);
    let spin = |frame: usize| {
        let time = frame as f64 / 30.0;
        let place = Vec3::new(-0.3 + 0.4 * time, 0.2 - 1.2 * time + 0.6 * time * time, 1.4);
        Motion::about(&Vec3::zeros(), &(Vec3::new(0.6, 0.8, 0.0) * (2.0 * time)), &place)
    };
    let (rms, last, nees) = follow(&camera, &blob(), (0..45).map(spin), &mut Random::new(3010));
    println!("blob: {:.1} mm rms, {:.1} mm at the end, NEES {nees:.1}", 1e3 * rms, 1e3 * last.norm());
    assert!(rms < 0.012, "{rms} m rms, {last} m");
}

#[test]
fn a_ball_is_only_a_shape_whose_center_is_known() {
    let (camera, radius) = (camera(1), 0.06);
    let ball = [Solid::Ellipsoid(Vec3::zeros(), Vec3::repeat(radius))];
    let mut watcher = Watcher::new(&camera);
    let (mut squares, random) = (0.0, &mut Random::new(3020));
    for frame in 0..30 {
        let time = f64::from(frame) / 30.0;
        let center = Vec3::new(-0.3 + 0.6 * time, 0.2 - 1.2 * time + time * time, 1.3 + 0.2 * time);
        let pose = Motion { translation: center, ..Motion::identity() };
        let found = watcher.see(&view(&camera, &[(&ball, pose)], Some(random)));
        if frame == 0 {
            continue;
        }
        assert!(found.len() == 1 && found[0].blob == Blob::Whole, "{found:?}");
        // Its center itself, not only how it moves.
        squares += (found[0].center - center).norm_squared() / 30.0;
        assert!((found[0].radius - radius).abs() < 0.1 * radius, "{}", found[0].radius);
    }
    println!("ball: {:.1} mm rms", 1e3 * squares.sqrt());
    assert!(squares.sqrt() < 0.006, "{} m", squares.sqrt());
}

#[test]
fn what_stands_still_for_two_minutes_stays_in_sight() {
    let camera = camera(2);
    let mut watcher = Watcher::new(&camera);
    let random = &mut Random::new(3030);
    let pose = drive(20);
    let images: Vec<_> = (0..20).map(|_| view(&camera, &[(&car(), pose)], Some(random))).collect();
    let (mut ids, mut first, mut farthest) = (std::collections::BTreeSet::new(), None, 0.0_f64);
    watcher.see(&images[1]);
    for frame in 0..3600 {
        let found = watcher.see(&images[frame % images.len()]);
        assert!(found.len() == 1 && found[0].blob == Blob::Whole, "at frame {frame}: {found:?}");
        ids.insert(found[0].shape);
        farthest = farthest.max((found[0].center - *first.get_or_insert(found[0].center)).norm());
    }
    assert!(ids.len() == 1 && farthest < 0.02, "{ids:?}, {farthest} m");
    // It drives on, and is still the same.
    let found = watcher.see(&view(&camera, &[(&car(), drive(21))], Some(random)));
    assert_eq!(found[0].shape, ids.into_iter().next().flatten());
}

#[test]
fn what_leaves_and_comes_back_is_a_new_thing() {
    let camera = camera(2);
    let mut watcher = Watcher::new(&camera);
    let random = &mut Random::new(3040);
    let at = |x: f64| Motion::about(&Vec3::zeros(), &Vec3::new(0.4, 0.5, 0.0), &Vec3::new(x, 0.0, 1.5));
    let mut see = |x: f64| watcher.see(&view(&camera, &[(&car(), at(x))], Some(random)));
    let ids = |found: &[Detection]| found.iter().filter(|d| d.blob == Blob::Whole).filter_map(|d| d.shape).collect::<Vec<_>>();
    // Out at the right edge, which is 0.83 m off.
    let (mut before, mut cut, mut worst, mut start) = (Vec::new(), 0, 0.0_f64, f64::NAN);
    for frame in 0..30 {
        let found = see(0.3 + 0.03 * f64::from(frame));
        if frame == 1 {
            start = found[0].center.x - 0.03;
        }
        before.extend(ids(&found));
        cut += found.iter().filter(|d| d.blob == Blob::Cut).count();
        for d in found.iter().filter(|d| d.blob == Blob::Whole) {
            worst = worst.max((d.center.x - start - 0.03 * f64::from(frame)).abs());
        }
    }
    println!("leaving: {:.1} mm at worst, measured {} times, cut {cut} times", 1e3 * worst, before.len());
    assert!(worst < 0.02, "{worst} m");
    assert!(before.len() > 12 && before.iter().all(|id| *id == before[0]), "{before:?}");
    assert!(cut > 0, "at the edge too little is seen of it");
    (0..30).for_each(|_| assert!(see(5.0).is_empty()));
    assert!(see(0.0).is_empty());
    let after = ids(&see(0.0));
    assert!(after.len() == 1 && after[0] != before[0], "{after:?}");
}

/// A square of `edge` pixels at 1.5 m before the wall.
fn square(camera: &Camera, edge: usize, column: usize) -> Vec<f32> {
    let mut image = view(camera, &[], None);
    (0..edge * edge).for_each(|i| image[(100 + i / edge) * camera.width + column + i % edge] = 1.5);
    image
}

#[test]
fn fewer_than_thirty_points_are_not_measured() {
    let camera = camera(1);
    let mut watcher = Watcher::new(&camera);
    for edge in [1, 3, 5] {
        assert!(watcher.see(&square(&camera, edge, 300)).is_empty(), "{edge}");
    }
    // What is followed and shrinks is known to be there.
    (0..5).for_each(|_| assert!(watcher.see(&square(&camera, 8, 300)).is_empty(), "one window of noise looks so"));
    let found = watcher.see(&square(&camera, 8, 300));
    assert!(found.len() == 1 && found[0].blob == Blob::Whole, "{found:?}");
    let found = watcher.see(&square(&camera, 5, 302));
    assert!(found.len() == 1 && found[0].blob == Blob::Cut && found[0].points == 25, "{found:?}");
}

#[test]
fn several_things_keep_their_numbers() {
    let camera = camera(1);
    let mut watcher = Watcher::new(&camera);
    let (random, bodies) = (&mut Random::new(3050), [car(), blob(), car()]);
    let place = |i: usize, frame: usize| {
        let time = frame as f64 / 30.0;
        let turn = Vec3::new(0.3, 0.4 + 0.8 * time, 0.2 * i as f64);
        Motion::about(&Vec3::zeros(), &turn, &Vec3::new(-0.5 + 0.5 * i as f64, 0.1 * time * (i as f64 - 1.0), 1.5))
    };
    let mut first = Vec::new();
    for frame in 0..20 {
        let views: Vec<(&[Solid], Motion)> = bodies.iter().enumerate().map(|(i, body)| (&**body, place(i, frame))).collect();
        let found = watcher.see(&view(&camera, &views, Some(random)));
        if frame == 0 {
            continue;
        }
        let mut seen: Vec<_> = found.iter().map(|d| (d.blob, d.shape, d.center.x)).collect();
        seen.sort_by(|a, b| a.2.total_cmp(&b.2));
        assert!(seen.len() == 3 && seen.iter().all(|s| s.0 == Blob::Whole), "at frame {frame}: {seen:?}");
        let ids: Vec<_> = seen.iter().map(|s| s.1).collect();
        if first.is_empty() {
            first.clone_from(&ids);
        }
        assert_eq!(ids, first, "at frame {frame}");
    }
}

/// Through the engine: one track a thing, a new one when it comes back, and no position between.
#[test]
fn no_track_bridges_an_absence() {
    let camera = camera(2);
    let mut config = Config { object: any(), ..Config::default() };
    config.tracking.background_frames = BACKGROUND_FRAMES;
    let mut engine = Engine::new(&config, Some(&camera)).expect("a configuration that can be");
    let random = &mut Random::new(3060);
    let mut events: Vec<Event> = Vec::new();
    for frame in 0..90_i64 {
        let x = match frame {
            0..3 | 40..65 => None,
            3..40 => Some(0.02 * frame as f64 - 0.2),
            _ => Some(-0.5 + 0.02 * (frame - 65) as f64),
        };
        let pose = x.map(|x| Motion::about(&Vec3::zeros(), &Vec3::new(0.4, 0.5, 0.0), &Vec3::new(x, 0.0, 1.5)));
        let body = car();
        let image = match pose {
            Some(pose) => view(&camera, &[(&body, pose)], Some(random)),
            None => view(&camera, &[], None),
        };
        engine.frame(frame * FRAME_NS, Image::F32(&image), &mut |event| events.push(event)).expect("the camera's image");
    }
    engine.finish(&mut |event| events.push(event));
    let started: Vec<_> = events.iter().filter(|e| matches!(e.kind, Kind::TrackStarted(_))).map(|e| e.track).collect();
    let positions: Vec<_> =
        events.iter().filter_map(|e| if let Kind::Position(p) = &e.kind { Some((e.track, p.frame, p.center)) } else { None }).collect();
    assert_eq!(started.len(), 2, "{started:?}");
    assert!(positions.iter().all(|p| (p.0 == started[0]) == (p.1 < 40)), "{positions:?}");
    assert!(positions.len() > 55, "{}", positions.len());
    for pair in positions.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        assert!((Vec3::from(pair[0].2) - Vec3::from(pair[1].2)).norm() < 0.04, "{pair:?}");
    }
}

/// Simulated cars and robots: motion of the point of reference against the truth, after both begin at one place.
#[test]
fn simulated_things_are_followed() {
    for (name, most) in [("toy_car", 0.008), ("flying_robot", 0.012)] {
        let (mut squares, mut nees, mut count, mut in_view, mut ends, mut begun, mut ghosts) = (0.0, 0.0, 0.0, 0, 0.0, 0, 0);
        for seed in 4000..4004 {
            let scene = Scene::parse(&format!("{name}?seed={seed}")).expect("a scene");
            let (camera, truth) = (scene.camera(), scene.truth());
            let world = Pose::from_rows(&truth.world_from_camera).expect("rigid");
            let mut seeing = Seeing::new(&camera, &any(), 15, Buffers::owned(camera.width, camera.height)).expect("buffers of its size");
            let (mut frames, mut index, mut found) = (scene.frames(), 0, Fixed::new());
            // For each number, its object and where on it the point of reference is.
            let mut known: Vec<(u32, usize, Vec3, f64)> = Vec::new();
            while let Some(frame) = frames.next_frame() {
                let scope = Scope { timestamp_ns: Some(frame.timestamp_ns), ..Scope::default() };
                seeing.see_in(Image::U16(frame.samples), scope, &mut found).expect("the camera's image");
                let truth = &truth.frames[index];
                index += 1;
                in_view += truth.objects.iter().filter(|o| o.in_view > 0.99).count();
                for seen in found.iter().filter(|d| d.blob == Blob::Whole) {
                    let center = world.to_world(&seen.center);
                    let distance = |o: &ObjectTruth| (Vec3::from(o.center) - center).norm();
                    let Some(object) = truth.objects.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))) else { continue };
                    if distance(object) > 0.25 {
                        // Noise far behind.
                        ghosts += 1;
                        continue;
                    }
                    let rotation = Mat3::from_fn(|i, j| object.rotation[i][j]);
                    let id = seen.shape.expect("a number");
                    let mine = known.iter().position(|k| k.0 == id).unwrap_or_else(|| {
                        begun += 1;
                        known.push((id, object.object, rotation.transpose() * (center - Vec3::from(object.center)), 0.0));
                        known.len() - 1
                    });
                    assert_eq!(known[mine].1, object.object, "{name}?seed={seed}, frame {index}");
                    let error = center - (Vec3::from(object.center) + rotation * known[mine].2);
                    let covariance = world.covariance_to_world(&(seen.covariance + seen.drift));
                    nees += error.dot(&(covariance.try_inverse().expect("a covariance") * error)) / 3.0;
                    known[mine].3 = error.norm();
                    squares += error.norm_squared();
                    count += 1.0;
                }
            }
            ends += known.iter().map(|k| k.3).sum::<f64>() / known.len().max(1) as f64 / 4.0;
        }
        let rms = f64::sqrt(squares / count);
        println!(
            "{name}: {:.1} mm rms, {:.1} mm at the end, NEES {:.1}, {count} of {in_view} measured, {begun} begun, {ghosts} ghosts",
            1e3 * rms,
            1e3 * ends,
            nees / count
        );
        assert!(f64::from(ghosts) < 0.03 * count, "{name}: {ghosts} ghosts");
        assert!((0.3..2.5).contains(&(nees / count)), "{name}: NEES {}", nees / count);
        assert!(rms < most && count > 0.9 * f64::from(in_view as u32), "{name}: {rms} m rms, {count} of {in_view}");
    }
}
