//! Time of a frame and of a position on one core, beside a memcpy of one frame; interleaved, medians of 7.

use std::hint::black_box;
use std::time::Instant;

use physinc::config::Config;
use physinc::seeing::{Buffers, Image, Seeing};
use physinc::sim::Scene;

const ROUNDS: usize = 7;
const SCENE: &str = "bounce?seed=1";

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
    let mut frames: Vec<Vec<u16>> = Vec::new();
    while let Some(frame) = source.next_frame()
        && frames.len() < 150
    {
        frames.push(frame.samples.to_vec());
    }

    let mut copy = frames[0].clone();
    let mut detections = heapless::Vec::new();
    let mut columns: [Vec<f64>; 2] = Default::default();
    for _ in 0..ROUNDS {
        let mut seeing =
            Seeing::new(&camera, &config.object, config.tracking.background_frames, Buffers::owned(camera.width, camera.height))
                .expect("buffers of the camera's size");
        let mut sums = [0.0; 2];
        for samples in &frames {
            sums[0] += microseconds(|| {
                copy.copy_from_slice(black_box(samples));
                black_box(&copy);
            });
            sums[1] += microseconds(|| seeing.see(Image::U16(samples), &mut detections).expect("the camera's image"));
        }
        for (column, sum) in columns.iter_mut().zip(sums) {
            column.push(sum / frames.len() as f64);
        }
    }

    let [memcpy, seeing] = columns.map(median);
    println!("sim:{SCENE}, {} frames, one core, medians of {ROUNDS} interleaved rounds", frames.len());
    println!("memcpy of {} bytes       {memcpy:9.1} µs", copy.len() * 2);
    println!("a frame through Seeing      {seeing:9.1} µs   {:8.2} memcpy", seeing / memcpy);
}
