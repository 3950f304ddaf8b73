//! The motion between two views of one body: error and time, for `benches/icp.py`, which judges `small_gicp` by the same views.
//!
//!     cargo bench --bench icp -- [--seed N] [--dump FILE]
//!
//! Prints a line of JSON a scene: rms of the error of the body's middle (m) and of the turn (rad), the shift's NEES an axis, medians over
//! pairs of the time of a frame's work (pixels to cells, normals, alignment to the view before) and of the alignment alone (µs). FILE is
//! given the views' points: for each pair, little-endian, the scene's number and the sizes of source and target (u32), the true motion (3 × 4 f64), the middle in the source (3 f64), then both views' points (f32).

#[path = "../tests/solids/mod.rs"]
mod solids;

use std::hint::black_box;
use std::io::Write;
use std::time::Instant;

use physinc::config::CameraConfig;
use physinc::detect::cloud::Cloud;
use physinc::detect::foreground::Area;
use physinc::detect::icp::align;
use physinc::detect::noise::Noise;
use physinc::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use physinc::geometry::motion::Motion;
use physinc::math::Vec3;
use solids::{Random, Solid, blob, car, disturb, draw};

const PAIRS: u64 = 240;

/// A view: runs of pixels side by side, as segmentation leaves them.
struct View {
    area: Area,
    runs: Vec<(usize, usize, Vec<f64>)>,
}

impl View {
    fn new(image: &[f32], width: usize) -> Self {
        let mut runs: Vec<(usize, usize, Vec<f64>)> = Vec::new();
        let mut area: Option<Area> = None;
        for (i, z) in image.iter().enumerate().filter(|(_, z)| z.is_finite()) {
            let (row, column) = (i / width, i % width);
            match runs.last_mut().filter(|(r, start, depths)| *r == row && start + depths.len() == column) {
                Some((.., depths)) => depths.push(f64::from(*z)),
                None => runs.push((row, column, vec![f64::from(*z)])),
            }
            let Area { rows, columns } = area.get_or_insert(Area { rows: row..row, columns: column..column });
            (*rows, *columns) = (rows.start..row + 1, columns.start.min(column)..columns.end.max(column + 1));
        }
        Self { area: area.unwrap_or(Area { rows: 0..0, columns: 0..0 }), runs }
    }

    fn fill(&self, camera: &Camera, cloud: &mut Cloud) {
        cloud.clear(camera, &self.area);
        for (row, start, depths) in &self.runs {
            cloud.add(*row, *start, depths.iter().copied());
        }
        cloud.finish(true);
    }

    fn points(&self, camera: &Camera) -> Vec<f32> {
        let pixels = self.runs.iter().flat_map(|(row, start, depths)| depths.iter().enumerate().map(move |(i, z)| (*row, start + i, *z)));
        pixels.flat_map(|(row, column, z)| <[f64; 3]>::from(camera.deproject(column as f64, row as f64, z)).map(|x| x as f32)).collect()
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn scene(number: u32, name: &str, body: &[Solid], distance: f64, first_seed: u64, camera: &Camera, dump: &mut Option<impl Write>) {
    let (mut means, mut frame_times, mut align_times) = ([0.0; 3], Vec::new(), Vec::new());
    let (mut source, mut target) = (Box::<Cloud>::default(), Box::<Cloud>::default());
    for seed in first_seed..first_seed + PAIRS {
        let random = &mut Random::new(seed * 64 + u64::from(number));
        let place = Vec3::new(distance * (0.4 * random.uniform() - 0.2), distance * (0.3 * random.uniform() - 0.15), distance);
        let first = Motion::about(&Vec3::zeros(), &random.vector(), &place);
        // A frame later, at some 2 rad/s and 1 m/s.
        let truth = Motion::about(&place, &(0.04 * random.vector()), &(0.02 * random.vector()));
        let mut view = |pose: &Motion| View::new(&disturb(camera, &draw(camera, body, pose), random), camera.width);
        let (from, to) = (view(&first), view(&truth.after(&first)));
        to.fill(camera, &mut target);
        let mut frame = |only_align: bool| {
            let begin = Instant::now();
            from.fill(camera, &mut source);
            let begin = if only_align { Instant::now() } else { begin };
            let start = Motion { translation: target.mean() - source.mean(), ..Motion::identity() };
            let found = black_box(align(&source, &target, &start, Noise::default(), camera.code.step(distance)));
            (begin.elapsed().as_secs_f64() * 1e6, found)
        };
        // Once to warm up, then the median of some.
        let (_, found) = frame(false);
        frame_times.push(median(&mut (0..9).map(|_| frame(false).0).collect::<Vec<_>>()));
        align_times.push(median(&mut (0..9).map(|_| frame(true).0).collect::<Vec<_>>()));
        let found = found.expect("the views lie on each other");
        let (motion, there) = (found.target_from_source, truth.of(&place));
        let (shift, turn) = (motion.of(&place) - there, motion.after(&truth.inverse()).angle());
        let nees = shift.dot(&(found.covariance_at(&there).try_inverse().expect("a covariance") * shift)) / 3.0;
        means.iter_mut().zip([shift.norm_squared(), turn * turn, nees]).for_each(|(mean, x)| *mean += x / PAIRS as f64);
        if let Some(file) = dump {
            let (a, b) = (from.points(camera), to.points(camera));
            let head = [number, a.len() as u32 / 3, b.len() as u32 / 3].map(u32::to_le_bytes).concat();
            let row = |i: usize| [truth.rotation[(i, 0)], truth.rotation[(i, 1)], truth.rotation[(i, 2)], truth.translation[i]];
            let numbers: Vec<u8> = (0..3).flat_map(row).chain(place.iter().copied()).flat_map(f64::to_le_bytes).collect();
            let points: Vec<u8> = a.iter().chain(&b).flat_map(|x| x.to_le_bytes()).collect();
            file.write_all(&[head, numbers, points].concat()).expect("room for the views");
        }
    }
    let (frame_us, align_us) = (median(&mut frame_times), median(&mut align_times));
    let [shift, turn, nees] = [means[0].sqrt(), means[1].sqrt(), means[2]];
    println!(
        "{{\"scene\": {number}, \"name\": \"{name}, {distance} m\", \"shift\": {shift}, \"turn\": {turn}, \"nees\": {nees}, \"frame_us\": {frame_us}, \"align_us\": {align_us}}}"
    );
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let option = |name: &str| arguments.iter().position(|argument| argument == name).and_then(|i| arguments.get(i + 1));
    let seed = option("--seed").map_or(7000, |seed| seed.parse().expect("a number"));
    let mut dump = option("--dump").map(|path| std::io::BufWriter::new(std::fs::File::create(path).expect("a file that can be written")));
    let camera =
        Camera::from_config(&CameraConfig::default(), DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).expect("a Kinect's keys");
    let bodies = [("car", car()), ("blob", blob())];
    let scenes = bodies.iter().flat_map(|(name, body)| [1.0, 1.5, 2.0].map(|distance| (*name, body, distance)));
    for (number, (name, body, distance)) in (0..).zip(scenes) {
        scene(number, name, body, distance, seed, &camera, &mut dump);
    }
}
