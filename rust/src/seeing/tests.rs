//! Balls drawn ray by ray, and how they are seen.

use super::*;
use crate::config::{CameraConfig, Radii};
use crate::detect::background::ROUND;
use crate::geometry::camera::DepthCode;
use crate::math::Vec3;
use std::vec::Vec as StdVec;

fn camera() -> Camera {
    Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 }).unwrap()
}

/// Depth in metres of balls (center, radius) before a wall at `wall` m, each reading the mean of its ball over a matching window.
fn image(camera: &Camera, balls: &[(Vec3, f64)], wall: f64) -> StdVec<f32> {
    let (width, height) = (camera.width, camera.height);
    let surface = |i: usize| {
        let ray = camera.deproject((i % width) as f64, (i / width) as f64, 1.0);
        let depth = |(c, r): &(Vec3, f64)| {
            let (a, b) = (ray.norm_squared(), ray.dot(c));
            let square = b * b - a * (c.norm_squared() - r * r);
            (square > 0.0).then(|| (b - crate::math::sqrt(square)) / a)
        };
        balls.iter().enumerate().filter_map(|(ball, b)| Some((ball, depth(b)?))).min_by(|a, b| a.1.total_cmp(&b.1))
    };
    let surfaces: StdVec<_> = (0..width * height).map(surface).collect();
    let reading = |i: usize| {
        let Some((ball, _)) = surfaces[i] else { return wall as f32 };
        let (x, y) = (i % width, i / width);
        let rows = y.saturating_sub(3)..(y + 4).min(height);
        let window = rows.flat_map(|y| (x.saturating_sub(4)..(x + 5).min(width)).map(move |x| y * width + x));
        let depths: StdVec<f64> = window.filter_map(|i| surfaces[i].filter(|s| s.0 == ball)).map(|s| s.1).collect();
        (depths.iter().sum::<f64>() / depths.len() as f64) as f32
    };
    (0..width * height).map(reading).collect()
}

fn balls_seen(camera: &Camera, radius: Radii, images: &[StdVec<f32>]) -> Vec<Detection, 16> {
    let object = ObjectConfig { radius, ..ObjectConfig::default() };
    let frames = images.len() as u32 - 1;
    let mut seeing = Seeing::new(camera, &object, frames, Buffers::owned(camera.width, camera.height)).unwrap();
    let mut found = Vec::new();
    for image in images {
        assert!(found.is_empty());
        seeing.see(Image::F32(image), &mut found).unwrap();
    }
    found
}

#[test]
fn a_perfect_ball_is_where_it_is() {
    let camera = camera();
    for center in [Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.3, -0.2, 1.5), Vec3::new(-0.8, 0.4, 2.0), Vec3::new(0.1, 0.1, 0.5)] {
        let found = balls_seen(&camera, Radii::one(0.033), &[image(&camera, &[(center, 0.033)], f64::NAN)]);
        assert_eq!(found.len(), 1, "{center}");
        assert_eq!(found[0].blob, Blob::Whole, "{center}");
        let error = found[0].center - center;
        // The pixels alone leave 0.1 px of the silhouette open, and linearisation some more.
        assert!(error.norm() < 0.1 * center.z / camera.fx + 1e-4, "{error}");
        assert!((found[0].row - (center.y / center.z * camera.fy + camera.cy)).abs() < 0.1);
    }
}

#[test]
fn a_ball_before_a_wall_is_seen_with_and_without_its_background() {
    let camera = camera();
    let center = Vec3::new(0.1, -0.1, 1.5);
    let (wall, ball) = (image(&camera, &[], 2.5), image(&camera, &[(center, 0.033)], 2.5));
    for images in [StdVec::from([ball.clone()]), StdVec::from([wall.clone(), wall.clone(), wall.clone(), wall, ball.clone()])] {
        let found = balls_seen(&camera, Radii::one(0.033), &images);
        assert_eq!(found.len(), 1);
        assert!((found[0].center - center).norm() < 3e-4);
    }
}

#[test]
fn balls_beyond_what_there_is_room_for_are_counted() {
    let camera = camera();
    let balls: StdVec<_> = (0..18).map(|i| (Vec3::new(f64::from(i % 6 - 3) * 0.2 + 0.1, f64::from(i / 6 - 1) * 0.3, 1.5), 0.033)).collect();
    let object = ObjectConfig { radius: Radii::one(0.033), ..ObjectConfig::default() };
    let mut seeing = Seeing::new(&camera, &object, 0, Buffers::owned(camera.width, camera.height)).unwrap();
    let mut found = Vec::new();
    for (count, surplus) in [(16, 0), (18, 2), (18, 4), (1, 4)] {
        seeing.see(Image::F32(&image(&camera, &balls[..count], f64::NAN)), &mut found).unwrap();
        assert_eq!((found.len(), seeing.surplus()), (count.min(16), surplus));
    }
}

#[test]
fn a_ball_does_not_burn_into_the_background() {
    let camera = camera();
    let ball = |x: f64| image(&camera, &[(Vec3::new(x, 0.0, 1.5), 0.033)], 2.5);
    let found = balls_seen(&camera, Radii::one(0.033), &[ball(0.0), ball(0.0), ball(0.2), ball(0.3), ball(0.0)]);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].blob, Blob::Whole);
}

#[test]
fn cut_and_merged_balls_are_known_as_such() {
    let camera = camera();
    let blob = |balls: &[(Vec3, f64)]| balls_seen(&camera, Radii::one(0.033), &[image(&camera, balls, f64::NAN)]);
    let at_the_edge = Vec3::new(-319.5 / 575.8 * 1.5, 0.0, 1.5);
    assert!(blob(&[(at_the_edge, 0.033)]).iter().all(|d| d.blob == Blob::Cut));
    let ball = (Vec3::new(0.0, 0.0, 1.5), 0.033);
    let hidden = blob(&[ball, (Vec3::new(0.04, 0.0, 1.0), 0.033)]);
    assert_eq!(hidden.iter().filter(|d| d.blob == Blob::Cut).count(), 1);
    assert_eq!(hidden.iter().filter(|d| d.blob == Blob::Whole).count(), 1);
    let touching = blob(&[ball, (Vec3::new(0.05, 0.0, 1.5), 0.033)]);
    assert!(!touching.is_empty() && touching.iter().all(|d| d.blob == Blob::Merged));
}

#[test]
fn of_several_radii_the_right_one_is_chosen() {
    let camera = camera();
    let balls = [(Vec3::new(-0.2, 0.0, 1.5), 0.02), (Vec3::new(0.2, 0.0, 1.5), 0.033)];
    let mut found = balls_seen(&camera, Radii::Many(Vec::from_slice(&[0.033, 0.02]).unwrap()), &[image(&camera, &balls, f64::NAN)]);
    assert_eq!(found.len(), 2);
    found.sort_by(|a, b| a.center.x.total_cmp(&b.center.x));
    for (detection, (center, radius)) in found.iter().zip(balls) {
        assert_eq!(detection.radius, radius);
        assert!((detection.center - center).norm() < 3e-4);
    }
}

#[test]
fn a_resting_ball_is_seen_for_ever_and_a_box_put_down_is_not() {
    let camera = camera();
    let (at_rest, falling) = ((Vec3::new(-0.2, 0.1, 1.5), 0.033), (Vec3::new(0.2, 0.0, 1.5), 0.033));
    let (wall, scene, both) = (image(&camera, &[], 2.5), image(&camera, &[at_rest], 2.5), image(&camera, &[at_rest, falling], 2.2));
    let with_box = |image: &StdVec<f32>| -> StdVec<f32> {
        let in_box = |i: usize| (400..500).contains(&(i % 640)) && (150..350).contains(&(i / 640));
        image.iter().enumerate().map(|(i, z)| if in_box(i) { z.min(2.0) } else { *z }).collect()
    };
    let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 3, Buffers::owned(camera.width, camera.height)).unwrap();
    let mut found = Vec::new();
    (0..3).for_each(|_| seeing.see(Image::F32(&wall), &mut found).unwrap());
    let scene = with_box(&scene);
    for _ in 0..12 * ROUND {
        seeing.see(Image::F32(&scene), &mut found).unwrap();
        assert!(found.iter().any(|d| d.blob == Blob::Whole && (d.center - at_rest.0).norm() < 1e-3));
    }
    assert_eq!(found.len(), 1);
    // Before the box, as before the wall, a ball is seen at once.
    seeing.see(Image::F32(&with_box(&both)), &mut found).unwrap();
    assert_eq!(found.iter().filter(|d| d.blob == Blob::Whole).count(), 2);
}

#[test]
fn before_a_known_environment_a_ball_is_seen_in_the_first_frame() {
    let camera = camera();
    let mut config = crate::config::EnvironmentConfig::default();
    let wall = crate::config::KnownPlane { normal: [0.0, -1.0, 0.0], offset: -2.0, ..Default::default() };
    config.plane.push(wall).unwrap();
    // The box is not where it is said to be: half of it is seen as foreground, and a ball before it is still a ball.
    config.r#box.push(crate::config::KnownBox { center: [0.5, 1.9, 0.0], size: [0.2; 3], ..Default::default() }).unwrap();
    let balls = [(Vec3::new(0.0, 0.0, 1.5), 0.033), (Vec3::new(0.45, 0.0, 1.2), 0.033)];
    let image = image(&camera, &balls, 2.0);
    let see = |known: bool| {
        let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(camera.width, camera.height)).unwrap();
        if known {
            seeing.know(Environment::new(&config), Pose::renamed_axes());
        }
        let mut found = Vec::new();
        seeing.see(Image::F32(&image), &mut found).unwrap();
        found
    };
    let found = see(true);
    assert_eq!(found.len(), 2);
    for (ball, _) in balls {
        assert!(found.iter().any(|d| d.blob == Blob::Whole && (d.center - ball).norm() < 1e-3), "{found:?}");
    }
}

#[test]
fn of_two_balls_that_cross_none_is_wrongly_taken_for_whole() {
    let camera = camera();
    for (depth, gap) in [(1.5, 0.0), (1.52, 0.0), (1.56, 0.002), (1.65, 0.01), (1.9, 0.0)] {
        for step in -20..=20 {
            let balls = [(Vec3::new(0.0, gap, 1.5), 0.033), (Vec3::new(0.004 * f64::from(step), 0.01, depth), 0.033)];
            if (balls[0].0 - balls[1].0).norm() < 0.066 {
                continue;
            }
            for found in balls_seen(&camera, Radii::one(0.033), &[image(&camera, &balls, f64::NAN)]) {
                let error = balls.iter().map(|b| (b.0 - found.center).norm()).fold(f64::INFINITY, f64::min);
                assert!(found.blob != Blob::Whole || error < 3e-3, "{step} at {depth}: {error}");
            }
        }
    }
}

/// What 20 frames of a room show, by every digit that there is.
#[cfg(feature = "sim")]
fn shown_of_a_room(shape: Shape, narrow: bool) -> (usize, StdVec<std::string::String>) {
    crate::simd::NARROW.set(narrow);
    let scene = crate::sim::Scene::parse("room?seed=1&throws=1").unwrap();
    let (camera, object) = (scene.camera(), ObjectConfig { shape, ..ObjectConfig::default() });
    let mut seeing = Seeing::new(&camera, &object, 15, Buffers::owned(camera.width, camera.height)).unwrap();
    let (mut frames, mut count, mut shown) = (scene.frames(), 0, StdVec::new());
    for _ in 0..35 {
        let frame = frames.next_frame().unwrap();
        let mut detections = Vec::new();
        seeing.see(Image::U16(frame.samples), &mut detections).unwrap();
        count += detections.len();
        shown.push(std::format!("{detections:?} {:?}", seeing.factors()));
    }
    shown.push(std::format!("{:?}", &seeing.buffers.limits[..]));
    crate::simd::NARROW.set(false);
    (count, shown)
}

/// Wide registers add in the order in which narrow ones do. Only where there are wide ones does this compare two paths.
#[cfg(feature = "sim")]
#[test]
fn wide_registers_see_to_the_last_bit_what_narrow_ones_see() {
    for shape in [Shape::Sphere, Shape::Any] {
        let (count, wide) = shown_of_a_room(shape, false);
        assert!(count > 5, "{shape:?}: {count} detections");
        for (frame, (wide, narrow)) in wide.iter().zip(&shown_of_a_room(shape, true).1).enumerate() {
            assert!(wide == narrow, "{shape:?}, frame {frame}: {wide} by wide registers, {narrow} by narrow ones");
        }
    }
}
