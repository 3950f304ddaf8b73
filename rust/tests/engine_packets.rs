//! Packets to events.

mod packets;

use packets::{packets, ticks};
use physinc::config::Config;
use physinc::engine::Engine;
use physinc::event::{Counters, Event, Gap, GapReason, Kind};
use physinc::geometry::camera::Camera;
use physinc::kinect::disparity::Packing;
use physinc::seeing::{Buffers, Image, SeeError, Slice};
use physinc::sim::Scene;

/// Stamp, samples and packets of each frame of a scene, as the device's clock tells the time.
fn sent(scene: &Scene) -> Vec<(i64, Vec<u16>, Vec<Vec<u8>>)> {
    let (mut frames, mut all, mut base) = (scene.frames(), Vec::new(), 0_u8);
    while let Some(frame) = frames.next_frame() {
        let ticks = ticks(frame.timestamp_ns);
        let packets = packets(Packing::Eleven, frame.samples, ticks, base);
        base = base.wrapping_add(packets.len() as u8);
        all.push(((i64::from(ticks) * 100 + 3) / 6, frame.samples.to_vec(), packets));
    }
    all
}

/// Events and counters of a scene whose packet `place` of frame `frame` is lost where `lost` says so.
fn seen(scene: &Scene, lost: impl Fn(usize, usize) -> bool) -> (Vec<Event>, Counters) {
    let mut engine = Engine::new_for_packets(&Config::default(), &scene.camera(), Packing::Eleven).expect("a Kinect");
    let mut events = Vec::new();
    for (frame, (stamp, _, packets)) in sent(scene).iter().enumerate() {
        for (_, packet) in packets.iter().enumerate().filter(|(place, _)| !lost(frame, *place)) {
            engine.packet(packet, *stamp, &mut |event| events.push(event)).expect("it is for packets");
        }
    }
    engine.finish(&mut |event| events.push(event));
    let counters = engine.counters();
    (events, counters)
}

fn gaps(events: &[Event]) -> Vec<&Gap> {
    events.iter().filter_map(|event| if let Kind::Gap(gap) = &event.kind { Some(gap) } else { None }).collect()
}

fn contacts(events: &[Event]) -> usize {
    events.iter().filter(|event| event.is_final && matches!(event.kind, Kind::Contact(_))).count()
}

#[test]
fn whole_packets_tell_what_their_frames_do() {
    let scene = Scene::parse("bounce?throws=1").expect("a scene");
    let mut engine = Engine::new(&Config::default(), Some(&scene.camera())).expect("a camera");
    let mut expected = Vec::new();
    for (stamp, samples, _) in sent(&scene) {
        engine.frame(stamp, Image::U16(&samples), &mut |event| expected.push(event)).expect("the camera's image");
    }
    engine.finish(&mut |event| expected.push(event));
    let (events, counters) = seen(&scene, |_, _| false);
    assert!(contacts(&expected) > 0);
    assert_eq!(events, expected);
    let frames = engine.counters().frames;
    assert_eq!(counters, Counters { frames, packets: 242 * frames, ..Counters::default() });
}

#[test]
fn what_was_lost_is_told_as_a_gap() {
    let scene = Scene::parse("bounce?throws=1").expect("a scene");
    // A hole of two packets; a frame's end with the next one's beginning, which takes the first of the two along; three whole frames.
    let (events, counters) = seen(&scene, |frame, place| match frame {
        3 => place == 10 || place == 11,
        6 => place > 230,
        7 => place < 3,
        20..23 => true,
        _ => false,
    });
    let gaps = gaps(&events);
    assert!(gaps.iter().all(|gap| gap.reason == GapReason::PacketsLost));
    let told: Vec<_> = gaps.iter().map(|gap| (gap.frames, gap.packets, gap.samples)).collect();
    let (hole, start, frame) = (12 * 13984 / 11 - 10 * 13984 / 11 + 1, 3 * 13984 / 11 + 1, 640 * 480);
    assert_eq!(
        told,
        [(Some(0), Some(2), Some(hole)), (Some(1), Some(14), Some(frame + start)), (Some(3), Some(3 * 242), Some(3 * frame)),]
    );
    assert!(gaps.iter().all(|gap| gap.end_ns > gap.start_ns));
    let total = sent(&scene).len() as u64;
    assert_eq!((counters.frames, counters.frames_incomplete), (total - 4, 2));
    assert_eq!((counters.packets_lost, counters.packets_invalid), (2 + 14 + 3 * 242, 0));
    assert_eq!(counters.packets, 242 * total - counters.packets_lost);
}

#[test]
fn holes_neither_break_a_background_nor_bend_a_ball() {
    let scene = Scene::parse("bounce?throws=2").expect("a scene");
    let (whole, _) = seen(&scene, |_, _| false);
    // Another eighth of the packets in every frame: the background has holes everywhere, and so has the ball, often.
    let (holed, counters) = seen(&scene, |frame, place| place != 0 && place != 241 && (place + frame * 3) % 8 == 0);
    assert!(counters.frames_incomplete == counters.frames && counters.frames_dropped == 0);
    let centers = |events: &[Event]| -> Vec<(i64, [f64; 3])> {
        events
            .iter()
            .filter_map(|event| if let Kind::Position(p) = &event.kind { Some((event.timestamp_ns, p.center)) } else { None })
            .collect()
    };
    let (whole_centers, holed_centers) = (centers(&whole), centers(&holed));
    for (stamp, center) in &holed_centers {
        let (_, other) = whole_centers.iter().find(|(other, _)| other == stamp).expect("nothing is seen that is not there");
        let off = center.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(off < 0.002, "{off} m at {stamp}");
    }
    assert!(holed_centers.len() * 10 > whole_centers.len() * 9, "{} of {} positions", holed_centers.len(), whole_centers.len());
    assert_eq!(contacts(&holed), contacts(&whole));
}

#[test]
fn what_an_engine_was_not_made_for_is_said() {
    let (scene, config) = (Scene::parse("bounce").expect("a scene"), Config::default());
    let camera = scene.camera();
    let mut for_frames = Engine::new(&config, Some(&camera)).expect("a camera");
    assert_eq!(for_frames.packet(&[0; 12], 0, &mut |_| {}), Err(SeeError::NoPackets));
    let mut for_positions = Engine::new(&config, None).expect("no camera");
    assert_eq!(for_positions.frame(0, Image::U16(&[0; 16]), &mut |_| {}), Err(SeeError::NoCamera));
    assert_eq!(for_positions.counters(), Counters::default());
    let (buffers, mut packed) = (Buffers::owned(camera.width, camera.height), [0; 100]);
    let error = Engine::for_packets(&config, &camera, Packing::Eleven, buffers, Slice::Borrowed(&mut packed)).err();
    let said = "packed = 100: expected as many bytes as `Packing::frame_bytes` says, at least";
    assert_eq!(error.expect("too small").to_string(), said);
}

/// One row has no next one: its time is the frame's.
#[test]
fn an_image_of_one_row_is_read_at_its_stamp() {
    let camera = Camera { height: 1, readout: 0.03, ..Scene::parse("bounce").expect("a scene").camera() };
    assert!((0.0 * camera.row_time()).abs() < f64::EPSILON);
}
