//! Time of a frame and of a position on one core, beside a memcpy of one frame; interleaved, medians of 7.

use std::hint::black_box;
use std::time::Instant;

use physinc::config::Config;
use physinc::engine::Engine;
use physinc::seeing::{Buffers, Image, Seeing};
use physinc::sim::Scene;
use physinc::track::Measurement;

const ROUNDS: usize = 7;
const SCENE: &str = "bounce?seed=1";
const BALL_RADIUS: f64 = 0.033;

/// µs that one call of `work` takes.
fn microseconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64() * 1e6
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

fn main() {
    let scene = Scene::parse(SCENE).expect("a scene");
    let (camera, config) = (scene.camera(), Config::default());
    let mut source = scene.frames();
    let mut frames: Vec<(i64, Vec<u16>)> = Vec::new();
    while let Some(frame) = source.next_frame()
        && frames.len() < 150
    {
        frames.push((frame.timestamp_ns, frame.samples.to_vec()));
    }
    let positions: Vec<Measurement> = (scene.positions(30.0, 0.001))
        .map(|position| Measurement {
            time_ns: position.timestamp_ns,
            center: position.center,
            covariance: None,
            center_in_camera: None,
            label: None,
            radius: BALL_RADIUS,
            points: None,
            residual_rms: None,
            whole: true,
        })
        .collect();

    let mut copy = frames[0].1.clone();
    let mut detections = heapless::Vec::new();
    let mut columns: [Vec<f64>; 4] = Default::default();
    for _ in 0..ROUNDS {
        let mut seeing =
            Seeing::new(&camera, &config.object, config.tracking.background_frames, Buffers::owned(camera.width, camera.height))
                .expect("buffers of the camera's size");
        let mut whole = Engine::new(&config, Some(&camera)).expect("a configuration that can be");
        let mut reasoning = Engine::new(&config, None).expect("a configuration that can be");
        let mut sums = [0.0; 4];
        for (stamp, samples) in &frames {
            sums[0] += microseconds(|| {
                copy.copy_from_slice(black_box(samples));
                black_box(&copy);
            });
            sums[1] += microseconds(|| seeing.see(Image::U16(samples), &mut detections).expect("the camera's image"));
            sums[2] += microseconds(|| {
                whole.frame(*stamp, Image::U16(samples), &mut |event| drop(black_box(event))).expect("the camera's image");
            });
        }
        for position in &positions {
            let one = std::slice::from_ref(position);
            sums[3] += microseconds(|| reasoning.positions(position.time_ns, one, &mut |event| drop(black_box(event))));
        }
        for (column, (sum, n)) in columns.iter_mut().zip(sums.iter().zip([frames.len(), frames.len(), frames.len(), positions.len()])) {
            column.push(sum / n as f64);
        }
    }

    let [memcpy, rest @ ..] = columns.map(median);
    println!("sim:{SCENE}, {} frames, {} positions, one core, medians of {ROUNDS} interleaved rounds", frames.len(), positions.len());
    println!("memcpy of {} bytes       {memcpy:9.1} µs", copy.len() * 2);
    for (name, time) in ["a frame through Seeing     ", "a frame through Engine     ", "a position through Engine  "].iter().zip(rest) {
        println!("{name} {time:9.1} µs   {:8.2} memcpy", time / memcpy);
    }
}
