//! What losses do to contacts: the table in `loss.md`, of kinds of loss and of noise. `PHYSINC_BLESS=1` writes it anew.

mod judge;

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::{env, fs};

use judge::{Score, config, hold, mean, rms};
use physinc::config::Method;
use physinc::engine::Engine;
use physinc::event::{Counters, Event};
use physinc::geometry::camera::{Camera, Pose};
use physinc::kinect::disparity::Packing;
use physinc::sim::{Packets, Scene};
use physinc::source::{Faults, Faulty, Input, Kinect, Source, SourceError};

/// Kinds of loss, as they are written behind a source.
const LOSSES: [&str; 13] = [
    "lose=0",
    "lose=0.01",
    "lose=0.05",
    "lose=0.2",
    "lose=0.05&burst=60",
    "silence=0.00005",
    "empty=0.05",
    "short=0.05",
    "foreign=0.05",
    "double=0.05",
    "empty=0.02&short=0.02&foreign=0.02&double=0.02",
    "late=0.05",
    "flip=0.01",
];
const NOISES: [f64; 3] = [0.5, 1.0, 2.0];
const SEEDS: [u64; 2] = [1, 2];

/// Hands out packets that were made before.
struct Replay {
    camera: Camera,
    packets: Arc<Vec<(Vec<u8>, i64)>>,
    next: usize,
}

impl Source for Replay {
    fn name(&self) -> &'static str {
        "replay"
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn kinect(&self) -> Option<Kinect> {
        Some(Kinect { packing: Packing::Eleven, zero_plane: None })
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        self.next += 1;
        Ok(self.packets.get(self.next - 1).map(|(bytes, arrival_ns)| Input::Packet { bytes, arrival_ns: *arrival_ns }))
    }
}

fn packets(scene: &Scene) -> Arc<Vec<(Vec<u8>, i64)>> {
    let (mut packets, mut all) = (Packets::new(scene), Vec::new());
    while let Some((bytes, arrival_ns)) = packets.next_packet() {
        all.push((bytes.to_vec(), arrival_ns));
    }
    Arc::new(all)
}

/// What the engine tells of a scene's packets after `faults`.
fn told(scene: &Scene, packets: Arc<Vec<(Vec<u8>, i64)>>, faults: Faults) -> (Vec<Event>, Pose, Counters) {
    let replay = Replay { camera: scene.camera(), packets, next: 0 };
    let mut source = Faulty::new("replay", Box::new(replay), faults).expect("packets");
    let mut engine = Engine::new_for_packets(&config(scene, Method::Best), &scene.camera(), Packing::Eleven).expect("a Kinect");
    let mut events = Vec::new();
    while let Some(Input::Packet { bytes, arrival_ns }) = source.next_input().expect("it does not break") {
        engine.packet(bytes, arrival_ns, &mut |event| events.push(event)).expect("it is for packets");
    }
    engine.finish(&mut |event| events.push(event));
    (events, engine.world_from_camera(), engine.counters())
}

fn table() -> String {
    let mut table = String::from(
        "| loss | noise | frames, incomplete | packets lost, invalid | contacts found | false | center mm | time ms | NEES |\n\
         |---|---|---|---|---|---|---|---|---|\n",
    );
    for noise in NOISES {
        let scenes: Vec<_> = (SEEDS.iter())
            .map(|seed| Scene::parse(&format!("bounce?throws=4&seed={seed}&sigma={noise}")).expect("a scene"))
            .map(|scene| (packets(&scene), scene))
            .collect();
        for loss in LOSSES {
            let (mut score, mut sums) = (Score::default(), Counters::default());
            for ((packets, scene), seed) in scenes.iter().zip(SEEDS) {
                let faults = Faults { seed, ..Faults::parse(loss).expect("faults") };
                let (events, pose, counters) = told(scene, Arc::clone(packets), faults);
                hold(&events);
                score.judge(scene, &events, &pose);
                sums.frames += counters.frames;
                sums.frames_incomplete += counters.frames_incomplete;
                sums.packets_lost += counters.packets_lost;
                sums.packets_invalid += counters.packets_invalid;
            }
            writeln!(
                table,
                "| {loss} | {noise} | {}, {} | {}, {} | {}/{} | {} | {:.2} | {:.2} | {:.2} |",
                sums.frames,
                sums.frames_incomplete,
                sums.packets_lost,
                sums.packets_invalid,
                score.matched,
                score.countable,
                score.wrong,
                rms(&score.center) * 1e3,
                rms(&score.time) * 1e3,
                mean(&score.nees),
            )
            .expect("a string");
        }
    }
    table
}

#[test]
fn contacts_through_losses_are_as_they_were() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/tests/loss.md");
    let found = table();
    if env::var_os("PHYSINC_BLESS").is_some() {
        fs::write(&path, &found).expect("a file");
    }
    let expected = fs::read_to_string(&path).expect("the table");
    assert_eq!(found, expected, "PHYSINC_BLESS=1 writes what is found:\n{found}");
}
