//! Assembling, seeing and reasoning allocate nothing once they are warm.

mod counting;
mod packets;
mod solids;

use counting::allocations;
use physinc::config::{CameraConfig, Config, Shape};
use physinc::engine::Engine;
use physinc::event::{Event, Kind};
use physinc::geometry::camera::{Camera, DepthCode};
use physinc::geometry::motion::Motion;
use physinc::kinect::disparity::Packing;
use physinc::math::Vec3;
use physinc::seeing::Image;
use physinc::sim::Scene;

#[test]
fn the_counter_counts() {
    assert_eq!(allocations(|| drop(std::hint::black_box(vec![1_u8]))), 1);
    let mut vec = vec![1_u8];
    assert_eq!(allocations(|| vec.reserve_exact(4096)), 1, "growing");
    assert_eq!(allocations(|| assert!(std::hint::black_box(vec.len()) == 1)), 0);
}

/// From the first frame on: warm is what `Engine::new` left. Before nothing, and before a wall and a floor that are learned.
#[test]
fn seeing_and_reasoning_allocate_nothing() {
    for (name, planes) in [("bounce?seed=1", 0), ("room?seed=1&throws=2", 2)] {
        let scene = Scene::parse(name).expect("a scene");
        let config = Config::default();
        let mut contacts = 0_u64;
        let mut count_contacts = |event: Event| contacts += u64::from(matches!(event.kind, Kind::Contact(_)));

        let mut engine = Engine::new(&config, Some(&scene.camera())).expect("a configuration that can be");
        let mut frames = scene.frames();
        while let Some(frame) = frames.next_frame() {
            let image = Image::U16(frame.samples);
            let count = allocations(|| {
                engine.frame(frame.timestamp_ns, image, &mut count_contacts).expect("the camera's image");
                for predictor in engine.predictors() {
                    std::hint::black_box(predictor.predict_among(engine.environment(), frame.timestamp_ns + 300_000_000));
                }
            });
            assert_eq!(count, 0, "{name} at {} ns", frame.timestamp_ns);
        }
        assert_eq!(allocations(|| engine.finish(&mut count_contacts)), 0);
        assert!(contacts > 3, "{name}, only {contacts} contacts: reasoning was never at work");
        assert_eq!(engine.environment().relief().map(|relief| relief.planes().len()), Some(planes));
    }
}

/// From the first packet on, with every thirtieth of them lost.
#[test]
fn packets_to_events_allocate_nothing() {
    let scene = Scene::parse("bounce?seed=1&throws=1").expect("a scene");
    let mut contacts = 0_u64;
    let mut count_contacts = |event: Event| contacts += u64::from(matches!(event.kind, Kind::Contact(_)));
    let mut engine = Engine::new_for_packets(&Config::default(), &scene.camera(), Packing::Eleven).expect("a Kinect");
    let (mut frames, mut base) = (scene.frames(), 0_u8);
    while let Some(frame) = frames.next_frame() {
        let sent = packets::packets(Packing::Eleven, frame.samples, packets::ticks(frame.timestamp_ns), base);
        base = base.wrapping_add(sent.len() as u8);
        let arrived = sent.iter().enumerate().filter(|(place, _)| place % 30 != 9);
        let mut push = |packet: &[u8]| engine.packet(packet, frame.timestamp_ns, &mut count_contacts).expect("it is for packets");
        assert_eq!(allocations(|| arrived.for_each(|(_, packet)| push(packet))), 0, "at {} ns", frame.timestamp_ns);
    }
    assert_eq!(allocations(|| engine.finish(&mut count_contacts)), 0);
    assert!(contacts > 1 && engine.counters().frames_incomplete > 20);
}

/// Two things of any shape, one of which turns through several keyframes.
#[test]
fn any_shape_allocates_nothing() {
    let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 }).expect("a camera");
    let mut config = Config::default();
    config.object.shape = Shape::Any;
    let mut engine = Engine::new(&config, Some(&camera)).expect("a configuration that can be");
    let (mut positions, mut tracks, random) = (0_u64, 0_u64, &mut solids::Random::new(1));
    let mut count = |event: Event| match event.kind {
        Kind::Position(_) => positions += 1,
        Kind::TrackStarted(_) => tracks += 1,
        _ => {}
    };
    for frame in 0..45_u32 {
        let time = f64::from(frame) / 30.0;
        let bodies = [
            (solids::car(), Motion::about(&Vec3::zeros(), &Vec3::new(0.4, 1.5 * time, 0.0), &Vec3::new(-0.3, 0.2 * time, 1.4))),
            (solids::blob(), Motion::about(&Vec3::zeros(), &Vec3::new(0.4, 0.5, 0.0), &Vec3::new(0.3, 0.1, 1.5))),
        ];
        let mut image = vec![f32::NAN; camera.width * camera.height];
        for (body, pose) in bodies.iter().filter(|_| frame >= config.tracking.background_frames) {
            image.iter_mut().zip(solids::draw(&camera, body, pose)).for_each(|(pixel, z)| *pixel = pixel.min(z));
        }
        let mut image = solids::disturb(&camera, &image, random);
        for z in &mut image {
            *z = z.min(2.5);
        }
        let mut see = || engine.frame(i64::from(frame) * 33_333_333, Image::F32(&image), &mut count).expect("the camera's image");
        assert_eq!(allocations(&mut see), 0, "at frame {frame}");
    }
    assert!(tracks == 2 && positions == 58, "{tracks} tracks, {positions} positions: ICP was never at work");
}
