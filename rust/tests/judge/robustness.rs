//! What lost packets and noise cost: contacts missed and their error.

use super::{Score, config};
use physinc::config::Method;
use physinc::engine::Engine;
use physinc::kinect::disparity::Packing;
use physinc::sim::Scene;
use physinc::source::{Faults, Faulty, Input, Simulated, Source};

/// Faults, as they are told.
pub const LOSSES: [(&str, &str); 6] = [
    ("none", "lose=0"),
    ("2 %", "lose=0.02"),
    ("5 %", "lose=0.05"),
    ("10 %", "lose=0.1"),
    ("20 %", "lose=0.2"),
    ("5 % in bursts of 60", "lose=0.05&burst=60"),
];
/// Factors on the sensor's noise.
pub const NOISE: [f64; 3] = [0.5, 1.0, 2.0];

/// What the engine makes of the packets of scenes `first` to `first + seeds`, `throws` throws each.
pub fn score(faults: &str, sigma: f64, first: u64, seeds: u64, throws: u32) -> Score {
    let mut score = Score::default();
    for seed in first..first + seeds {
        let name = format!("sim:bounce?throws={throws}&seed={seed}&sigma={sigma}&packets=1");
        let scene = Scene::parse(&name["sim:".len()..]).expect("a scene");
        let simulated = Simulated::new(&name).expect("a scene");
        let faults = Faults::parse(&format!("{faults}&seed={seed}")).expect("faults");
        let mut source = Faulty::new(&name, Box::new(simulated), faults).expect("packets");
        let mut engine =
            Engine::new_for_packets(&config(&scene, Method::Best), &scene.camera(), Packing::Eleven).expect("a configuration that can be");
        let mut events = Vec::new();
        while let Some(Input::Packet { bytes, arrival_ns }) = source.next_input().expect("it does not break") {
            engine.packet(bytes, arrival_ns, &mut |e| events.push(e)).expect("a Kinect's packet");
        }
        engine.finish(&mut |e| events.push(e));
        score.judge(&scene, &events, &engine.world_from_camera());
    }
    score
}
