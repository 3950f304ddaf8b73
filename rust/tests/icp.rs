//! The motion between two views, against the motion that made them.

mod solids;

use physinc::config::CameraConfig;
use physinc::detect::cloud::{CELLS, Cloud};
use physinc::detect::foreground::Area;
use physinc::detect::icp::{Alignment, align};
use physinc::detect::noise::Noise;
use physinc::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use physinc::geometry::motion::Motion;
use physinc::math::Vec3;
use solids::{Random, Solid, blob, car, disturb, draw};

fn camera() -> Camera {
    Camera::from_config(&CameraConfig::default(), DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).expect("a Kinect's keys")
}

fn cloud(camera: &Camera, image: &[f32], whole: bool) -> Box<Cloud> {
    let width = camera.width;
    let seen = || (0..image.len()).filter(|i| image[*i].is_finite());
    let columns = seen().map(|i| i % width).min().unwrap_or(0)..seen().map(|i| i % width).max().unwrap_or(0) + 1;
    let rows = seen().next().unwrap_or(0) / width..seen().next_back().unwrap_or(0) / width + 1;
    let mut cloud = Box::<Cloud>::default();
    cloud.clear(camera, &Area { rows, columns });
    for (row, pixels) in image.chunks(width).enumerate() {
        let mut start = 0;
        for run in pixels.split(|z| !z.is_finite()) {
            cloud.add(row, start, run.iter().copied().map(f64::from));
            start += run.len() + 1;
        }
    }
    cloud.finish(whole);
    cloud
}

/// Aligns two views without a guess but that their middles are the same.
fn aligned(source: &Cloud, target: &Cloud) -> Option<Alignment> {
    let start = Motion { translation: target.mean() - source.mean(), ..Motion::identity() };
    align(source, target, &start, Noise::default(), 0.0029 * source.mean().z * source.mean().z)
}

/// A body's pose, and where a small motion brings it.
fn poses(random: &mut Random, distance: f64) -> (Motion, Motion) {
    let place = Vec3::new(distance * (0.4 * random.uniform() - 0.2), distance * (0.3 * random.uniform() - 0.15), distance);
    let first = Motion::about(&Vec3::zeros(), &random.vector(), &place);
    let between = Motion::about(&place, &(0.06 * random.vector()), &(0.03 * random.vector()));
    (first, between.after(&first))
}

fn motion(from: &Motion, to: &Motion) -> Motion {
    to.after(&from.inverse())
}

/// Single pixels where there are few; never so small that they share more noise than they add, nor more than there is room for.
#[test]
fn cells_are_as_large_as_their_object_asks() {
    let mut cloud = Box::<Cloud>::default();
    for (extent, stride) in [(1, 1), (51, 1), (52, 2), (152, 2), (153, 3), (228, 3), (229, 4), (480, 7), (640, 9)] {
        cloud.clear(&camera(), &Area { rows: 0..1, columns: 0..extent });
        assert_eq!((cloud.stride(), cloud.cells().count() <= CELLS), (stride, true), "{extent} px");
    }
}

/// Without noise, and where no normal is taken across an edge, only rounding remains.
#[test]
fn the_exact_motion_is_found_without_noise() {
    let camera = camera();
    let place = Vec3::new(0.03, -0.02, 1.0);
    let tilts = [Vec3::new(0.0, 0.5, 0.0), Vec3::new(0.5, -0.3, 0.0), Vec3::new(-0.45, -0.2, 0.1)];
    let offsets = [Vec3::new(-0.18, 0.0, 0.1), Vec3::new(0.0, 0.05, 0.0), Vec3::new(0.18, -0.02, 0.1)];
    let view = |moved: &Motion| {
        let mut image = vec![f32::NAN; camera.width * camera.height];
        for (tilt, offset) in tilts.iter().zip(offsets) {
            let plate = Motion::about(&Vec3::zeros(), tilt, &(place + offset));
            let drawn = draw(&camera, &[Solid::Box(Vec3::zeros(), Vec3::new(0.055, 0.055, 1e-4))], &moved.after(&plate));
            for (pixel, z) in image.iter_mut().zip(drawn) {
                *pixel = pixel.min(z);
            }
        }
        cloud(&camera, &image, false)
    };
    let truth = Motion::about(&place, &Vec3::new(0.03, -0.04, 0.02), &Vec3::new(0.004, -0.003, 0.01));
    let found = aligned(&view(&Motion::identity()), &view(&truth)).expect("they lie on each other");
    let error = motion(&truth, &found.target_from_source);
    let shift = (found.target_from_source.of(&place) - truth.of(&place)).norm();
    println!("{shift:e} m, {:e} rad after {} rounds", error.angle(), found.iterations);
    assert!(shift < 3e-6 && error.angle() < 2e-5, "{shift:e} m, {:e} rad", error.angle());
}

/// Errors over many pairs of views: rms of the shift (m) and of the turn (rad), mean of the shift's NEES over 3.
fn errors(
    body: &[Solid],
    distance: f64,
    noisy: bool,
    whole: bool,
    seeds: std::ops::Range<u64>,
    spoil: impl Fn(&mut Random, &mut [f32]),
) -> [f64; 3] {
    let camera = camera();
    let (mut sums, mut count) = ([0.0; 3], 0.0);
    for seed in seeds {
        let random = &mut Random::new(seed);
        let (first, second) = poses(random, distance);
        let view = |pose: &Motion, random: &mut Random| {
            let image = draw(&camera, body, pose);
            if noisy { disturb(&camera, &image, random) } else { image }
        };
        let (mut source, target) = (view(&first, random), view(&second, random));
        spoil(random, &mut source);
        let [source, target] = [source, target].map(|image| cloud(&camera, &image, whole));
        let Some(found) = aligned(&source, &target) else {
            println!("lost {seed}");
            continue;
        };
        let truth = motion(&first, &second);
        let middle = second.translation;
        let shift = found.target_from_source.of(&first.translation) - middle;
        let nees = shift.dot(&(found.covariance_at(&middle).try_inverse().expect("a covariance") * shift)) / 3.0;
        let turn = motion(&truth, &found.target_from_source).angle();
        for (sum, square) in sums.iter_mut().zip([shift.norm_squared(), turn * turn, nees]) {
            *sum += square;
        }
        count += 1.0;
    }
    let [shift, turn, nees] = sums.map(|sum| sum / count);
    println!("{distance} m: shift {:.2} mm, turn {:.2}°, NEES {nees:.2}", 1e3 * shift.sqrt(), turn.sqrt().to_degrees());
    [shift.sqrt(), turn.sqrt(), nees]
}

/// A ball of 10 cm, and its view without noise.
fn ball() -> (Vec3, f64, Box<Cloud>) {
    let (camera, middle, radius) = (camera(), Vec3::new(0.05, -0.03, 1.0), 0.1);
    let solid = Solid::Ellipsoid(Vec3::zeros(), Vec3::repeat(radius));
    let image = draw(&camera, &[solid], &Motion::about(&Vec3::zeros(), &Vec3::zeros(), &middle));
    (middle, radius, cloud(&camera, &image, true))
}

/// Where neighbours lie to one side of a cell only, their plane lags behind the surface.
#[test]
fn a_round_body_is_known_up_to_its_rim() {
    let (middle, radius, cloud) = ball();
    let vector = |v: [f32; 3]| Vec3::from(v.map(f64::from));
    let rim = cloud.cells().filter(|cell| cell.has_normal() && cell.cover < 0.95);
    let angles: Vec<f64> = rim.map(|cell| (vector(cell.point) - middle).angle(&vector(cell.normal)).to_degrees()).collect();
    let angle = angles.iter().sum::<f64>() / angles.len() as f64;
    // Seen from so near, the rim is before the middle, by this.
    let before = radius * radius / middle.z;
    let apart = cloud.outline().iter().map(|p| f64::from(p[2]) - (middle.z - before)).sum::<f64>() / cloud.outline().len() as f64;
    println!("{} normals off by {angle:.1}°, rim by {:.1} mm", angles.len(), 1e3 * apart);
    // One-sided planes are off by 4.1°, the depth of the nearest cells by 16 mm.
    assert!(angles.len() > 200 && angle < 2.2 && apart.abs() < 8e-3);
}

/// Chords lie behind what is bent towards the camera.
#[test]
fn depth_between_cells_is_the_surfaces() {
    let (middle, radius, cloud) = ball();
    let errors = (0..10_000).map(|i| {
        let ray = Vec3::new(f64::from(i % 100) * 1e-3, f64::from(i / 100) * 1e-3 - 0.08, 1.0);
        let along = ray.dot(&middle) / ray.norm_squared();
        let within = radius * radius - (middle - along * ray).norm_squared();
        let z = along - (within / ray.norm_squared()).sqrt();
        let point = [ray.x * z, ray.y * z, z].map(|x| x as f32);
        1.0 / f64::from(cloud.inverse_depth(cloud.project(&point)).expect("a surface")) - z
    });
    let mean = errors.sum::<f64>() / 1e4;
    // Of plain means and chords, 28 µm.
    assert!(mean.abs() < 1e-5, "{mean} m");
}

#[test]
fn views_of_whole_bodies_are_aligned() {
    for body in [car(), blob()] {
        let [shift, turn, _] = errors(&body, 1.2, false, true, 0..20, |_, _| {});
        // Cells of 2 to 4 px and their rims leave an eighth of a pixel of 2 mm.
        assert!(shift < 4e-4 && turn < 5e-3, "{shift} m, {turn} rad");
    }
}

#[test]
fn covariances_are_honest() {
    for (body, distance) in [(car(), 1.2), (blob(), 1.2), (car(), 1.8), (blob(), 1.8)] {
        let [shift, _, nees] = errors(&body, distance, true, true, 1000..1040, |_, _| {});
        assert!(shift < 0.004, "{shift} m");
        assert!((0.5..1.6).contains(&nees), "{nees}");
    }
}

/// What is left of the noise of one view after seven others were taken in: 1/√8 of it, and what their cells smooth.
#[test]
fn views_fused_into_one_err_less() {
    let camera = camera();
    let pose = Motion::about(&Vec3::zeros(), &Vec3::new(0.4, 0.5, 0.1), &Vec3::new(0.05, 0.02, 1.4));
    for body in [car(), blob()] {
        let (image, random) = (draw(&camera, &body, &pose), &mut Random::new(2100));
        let exact = cloud(&camera, &image, true);
        let error = |cloud: &Cloud| {
            let apart = cloud.cells().filter(|cell| cell.is_seen()).filter_map(|cell| {
                let z = 1.0 / exact.inverse_depth(exact.project(&cell.point))?;
                Some(f64::from(z - cell.point[2]).powi(2))
            });
            let squares: Vec<f64> = apart.filter(|square| *square < 0.01 * 0.01).collect();
            (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
        };
        let mut fused = cloud(&camera, &disturb(&camera, &image, random), true);
        let alone = error(&fused);
        for _ in 0..7 {
            fused.fuse(&cloud(&camera, &disturb(&camera, &image, random), true), &Motion::identity(), Noise::default());
        }
        println!("{:.2} mm alone, {:.2} mm fused", 1e3 * alone, 1e3 * error(&fused));
        assert!(error(&fused) < 0.6 * alone, "{} m of {alone} m", error(&fused));
        let view = cloud(&camera, &disturb(&camera, &image, random), true);
        let own = |target: &Cloud| aligned(&view, target).expect("they lie on each other").own;
        // Of the surface 8/9, of the silhouette, which isn't fused, a half.
        assert!((own(&view) - 0.5).abs() < 1e-3 && own(&fused) > 0.75, "{} {}", own(&view), own(&fused));
    }
}

#[test]
fn a_fifth_of_wild_surface_does_no_harm() {
    // Patches of one view that stand before it or behind.
    let patches = |random: &mut Random, image: &mut [f32]| {
        let offsets: Vec<f32> = (0..80 * 60).map(|_| if random.uniform() < 0.2 { (0.1 * random.normal()) as f32 } else { 0.0 }).collect();
        image.iter_mut().enumerate().for_each(|(i, z)| *z += offsets[i / 640 / 8 * 80 + i % 640 / 8]);
    };
    for body in [car(), blob()] {
        let [clean, ..] = errors(&body, 1.2, true, true, 2000..2020, |_, _| {});
        let [shift, turn, _] = errors(&body, 1.2, true, true, 2000..2020, patches);
        assert!(shift < 2.0 * clean && turn < 0.05, "{shift} m instead of {clean}, {turn} rad");
    }
}

#[test]
fn too_little_is_refused() {
    let camera = camera();
    let mut image = vec![f32::NAN; camera.width * camera.height];
    for i in 0..16 {
        image[(200 + i / 4) * camera.width + 300 + i % 4] = 1.5;
    }
    let few = cloud(&camera, &image, true);
    assert!(aligned(&few, &few).is_none());
    let empty = cloud(&camera, &vec![f32::NAN; image.len()], true);
    assert!(aligned(&empty, &empty).is_none() && aligned(&few, &empty).is_none());
}
