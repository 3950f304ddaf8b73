//! Time of packed bytes to ball positions on one core, beside a memcpy of one frame in the same run: `cargo bench --bench speed -- [SCENE …]`.
//!
//! Rounds are interleaved, and each goes through all frames of the scene, so that every frame comes from memory rather than from a cache, for
//! memcpy as for us. Of each frame the median of 7 rounds counts, of these the mean: what else the machine does meanwhile counts little.

use std::hint::black_box;
use std::time::Instant;

use physinc::attention::Attention;
use physinc::config::Config;
use physinc::detect::{Blob, Detection};
use physinc::engine::Engine;
use physinc::geometry::camera::Camera;
use physinc::kinect::disparity::Packing;
use physinc::math::Mat3;
use physinc::reasoning::Reasoning;
use physinc::seeing::{Buffers, Image, Scope, Seeing};
use physinc::sim::Scene;
use physinc::track::Measurement;

const ROUNDS: usize = 7;
const SCENES: [&str; 2] = ["bounce?seed=1&distance=1.5&throws=10", "room?seed=1&distance=1.5&throws=10"];
const PACKING: Packing = Packing::Eleven;
/// 20 s: what is learned once a stream is a small part.
const FRAMES: usize = 600;

struct Frame {
    timestamp_ns: i64,
    samples: Vec<u16>,
    packed: Vec<u8>,
}

impl Frame {
    fn image(&self) -> Image<'_> {
        Image::Packed { packed: black_box(&self.packed), packing: PACKING }
    }
}

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

/// Times of what is counted, µs: in each round the same calls in the same order.
#[derive(Default)]
struct Clock(Vec<f64>);

impl Clock {
    fn add(&mut self, time: f64) {
        self.0.push(time);
    }

    fn time(&mut self, work: impl FnOnce()) {
        self.add(microseconds(work));
    }
}

/// Mean over the calls of their medians over the rounds, µs.
fn mean(rounds: &[&[f64]]) -> f64 {
    let calls = rounds[0].len();
    (0..calls).map(|call| median(rounds.iter().map(|round| round[call]).collect())).sum::<f64>() / calls as f64
}

type Detections = heapless::Vec<Detection, 16>;

fn one_ball(detections: &Detections) -> bool {
    detections.len() == 1 && detections[0].blob == Blob::Whole
}

fn seeing(camera: &Camera, config: &Config) -> Seeing<'static> {
    Seeing::new(camera, &config.object, config.tracking.background_frames, Buffers::owned(camera.width, camera.height))
        .expect("buffers of the camera's size")
}

fn measurement(time_ns: i64, detection: &Detection, reasoning: &Reasoning) -> Measurement {
    let pose = reasoning.world_from_camera();
    Measurement {
        time_ns,
        center: pose.to_world(&detection.center),
        covariance: Some(pose.covariance_to_world(&detection.covariance)),
        drift: pose.covariance_to_world(&detection.drift),
        center_in_camera: Some(detection.center),
        label: None,
        radius: detection.radius,
        points: Some(detection.points),
        residual_rms: Some(detection.residual_rms),
        whole: detection.blob == Blob::Whole,
    }
}

/// Names and times of one round, µs.
fn round(frames: &[Frame], camera: &Camera, config: &Config) -> [(&'static str, Vec<f64>); 9] {
    let [mut memcpy, mut unpack, mut idle, mut full, mut all_whole, mut tracked, mut tracking, mut all, mut engine_time] =
        std::array::from_fn(|_| Clock::default());
    let mut copy = frames[0].samples.clone();
    for frame in frames {
        memcpy.time(|| black_box(&mut copy).copy_from_slice(black_box(&frame.samples)));
    }
    for frame in frames {
        unpack.time(|| PACKING.unpack(black_box(&frame.packed), black_box(&mut copy)).expect("a frame's bytes"));
    }
    let mut detections = Detections::new();
    let mut whole = seeing(camera, config);
    for (i, frame) in frames.iter().enumerate() {
        let learned = i > config.tracking.background_frames as usize;
        let time = microseconds(|| whole.see(frame.image(), &mut detections).expect("the camera's image"));
        all_whole.add(time);
        if one_ball(&detections) {
            full.add(time);
        } else if learned && detections.is_empty() {
            idle.add(time);
        }
    }
    let (mut near, mut attention, mut reasoning) = (seeing(camera, config), Attention::new(config), Reasoning::new(config, Some(camera)));
    for (i, frame) in (0..).zip(frames) {
        let mut everywhere = true;
        let time = microseconds(|| {
            let bands = attention.bands(frame.timestamp_ns, camera, &reasoning);
            let scope = Scope { bands: &bands, ..Scope::default() };
            everywhere = near.see_in(frame.image(), scope, &mut detections).expect("the camera's image");
        });
        all.add(time);
        if reasoning.tracks() == 1 && one_ball(&detections) {
            tracking.add(time);
            if !everywhere {
                tracked.add(time);
            }
        }
        let measured: Vec<_> = detections.iter().map(|d| measurement(frame.timestamp_ns, d, &reasoning)).collect();
        reasoning.push(frame.timestamp_ns, i, &measured, &mut |event| drop(black_box(event)));
        attention.saw(frame.timestamp_ns, everywhere, &detections, reasoning.tracks());
    }
    let mut engine = Engine::new(config, Some(camera)).expect("a configuration that can be");
    for frame in frames {
        let sink = &mut |event| drop(black_box(event));
        engine_time.time(|| engine.frame(frame.timestamp_ns, frame.image(), sink).expect("the camera's image"));
    }
    [
        ("memcpy of 614,400 bytes", memcpy),
        ("11 bits unpacked", unpack),
        ("a frame without ball, whole", idle),
        ("packed → position, whole frame", full),
        ("packed → position, tracked", tracked),
        ("the same, mean while tracking", tracking),
        ("packed → positions, mean of all frames, each whole", all_whole),
        ("packed → positions, mean of all, as on a stream", all),
        ("packed → events, mean of all, as on a stream", engine_time),
    ]
    .map(|(name, clock)| (name, clock.0))
}

fn main() {
    let config = Config::default();
    let asked: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    for name in if asked.is_empty() { SCENES.map(str::to_owned).into() } else { asked } {
        let scene = Scene::parse(&name).expect("a scene");
        let camera = scene.camera();
        let (mut source, mut frames) = (scene.frames(), Vec::new());
        while let Some(frame) = source.next_frame()
            && frames.len() < FRAMES
        {
            let mut packed = vec![0; PACKING.frame_bytes()];
            PACKING.pack(frame.samples, &mut packed).expect("a Kinect's frame");
            frames.push(Frame { timestamp_ns: frame.timestamp_ns, samples: frame.samples.to_vec(), packed });
        }
        let rounds: Vec<_> = (0..ROUNDS).map(|_| round(&frames, &camera, &config)).collect();
        println!("sim:{name}, {} frames, one core, {ROUNDS} interleaved rounds", frames.len());
        let of = |row: usize| mean(&rounds.iter().map(|round: &[(_, Vec<f64>); 9]| &*round[row].1).collect::<Vec<_>>());
        for (row, (name, _)) in rounds[0].iter().enumerate() {
            println!("{name:52} {:8.1} µs  {:6.2} memcpy", of(row), of(row) / of(0));
        }
        println!();
    }
    reasoning_alone(&config);
}

fn reasoning_alone(config: &Config) {
    let scene = Scene::parse(SCENES[0]).expect("a scene");
    let times = (0..ROUNDS)
        .map(|_| {
            let (mut engine, mut clock) = (Engine::new(config, None).expect("a configuration that can be"), Clock::default());
            for position in scene.positions(30.0, 0.001) {
                let one = Measurement {
                    time_ns: position.timestamp_ns,
                    center: position.center,
                    covariance: None,
                    drift: Mat3::zeros(),
                    center_in_camera: None,
                    label: None,
                    radius: config.object.radius.as_slice()[0],
                    points: None,
                    residual_rms: None,
                    whole: true,
                };
                clock.time(|| engine.positions(one.time_ns, &[one], &mut |event| drop(black_box(event))));
            }
            clock.0
        })
        .collect::<Vec<_>>();
    println!("a position through Engine {:8.1} µs", mean(&times.iter().map(|times| &**times).collect::<Vec<_>>()));
}
