//! Whatever the image, what is seen makes sense.

use physinc::config::{CameraConfig, Config, ObjectConfig, Radii, TrackingConfig};
use physinc::detect::Detection;
use physinc::detect::components::Run;
use physinc::engine::Engine;
use physinc::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use physinc::kinect::disparity::Packing;
use physinc::math::Vec3;
use physinc::seeing::{Area, Band, Buffers, Image, Scope, SeeError, Seeing, Slice};
use physinc::sim::Scene;
use proptest::prelude::*;
use std::ops::Range;

const SIZE: (u32, u32) = (80, 60);

fn camera(disparity: bool, max_depth: f64) -> Camera {
    let keys = CameraConfig {
        width: Some(SIZE.0),
        height: Some(SIZE.1),
        fx: Some(72.0),
        fy: Some(70.0),
        cx: Some(39.0),
        cy: Some(31.0),
        max_depth: Some(max_depth),
        ..CameraConfig::default()
    };
    let code = if disparity { DepthCode::Disparity { law: KINECT_DISPARITY_LAW } } else { DepthCode::Depth { units_per_metre: 1000.0 } };
    Camera::from_config(&keys, code).unwrap()
}

/// A background of noise or of one value, with rectangles of a value and noise on it.
fn arbitrary_image() -> impl Strategy<Value = Vec<u16>> {
    let pixels = (SIZE.0 * SIZE.1) as usize;
    let ground = prop_oneof![Just(0), Just(2047), 0_u16..2048, any::<u16>()].prop_map(move |value| vec![value; pixels]);
    let ground =
        prop_oneof![4 => ground, 1 => prop::collection::vec(any::<u16>(), pixels), 1 => prop::collection::vec(500_u16..600, pixels)];
    let patch = (0..SIZE.0, 0..SIZE.1, 1..30_u32, 1..30_u32, 300_u16..2047, prop::collection::vec(0_u16..20, 900));
    (ground, prop::collection::vec(patch, 0..5)).prop_map(|(mut image, patches)| {
        for (left, top, width, height, value, noise) in patches {
            for y in top..(top + height).min(SIZE.1) {
                for x in left..(left + width).min(SIZE.0) {
                    image[(y * SIZE.0 + x) as usize] = value + noise[((y - top) * 30 + x - left) as usize];
                }
            }
        }
        image
    })
}

fn makes_sense(detection: &Detection) -> bool {
    detection.center.iter().all(|x| x.is_finite())
        && detection.center.z > 0.0
        && detection.covariance.iter().all(|x| x.is_finite())
        && detection.covariance == detection.covariance.transpose()
        && detection.covariance.cholesky().is_some()
        && detection.residual_rms.is_finite()
        && detection.row.is_finite()
}

proptest! {
    #[test]
    fn any_images_give_detections_that_make_sense(
        images in prop::collection::vec(arbitrary_image(), 1..5),
        disparity: bool,
        floating: bool,
        background_frames in 0_u32..4,
        radii in prop::collection::vec(0.005_f64..0.3, 1..4),
        max_depth in prop_oneof![Just(10.0), 0.1_f64..1000.0],
    ) {
        let object = ObjectConfig { radius: Radii::Many(radii.into_iter().collect()), ..ObjectConfig::default() };
        let camera = camera(disparity, max_depth);
        let mut seeing = Seeing::new(&camera, &object, background_frames, Buffers::owned(camera.width, camera.height)).unwrap();
        let mut detections = heapless::Vec::new();
        for image in &images {
            let metres: Vec<f32> = image.iter().map(|s| if *s == 7 { f32::NAN } else { f32::from(*s) * 1e-3 - 0.1 }).collect();
            seeing.see(if floating { Image::F32(&metres) } else { Image::U16(image) }, &mut detections).unwrap();
            prop_assert!(detections.iter().all(makes_sense), "{detections:?}");
        }
    }

    #[test]
    fn in_a_band_nothing_is_seen_that_the_whole_image_does_not_show(
        images in prop::collection::vec(arbitrary_image(), 1..4),
        disparity: bool,
        radius in 0.02_f64..0.3,
        first in [0_usize..60, 0..80],
        size in [0_usize..40, 0..80],
    ) {
        let camera = camera(disparity, 10.0);
        let object = ObjectConfig { radius: Radii::one(radius), ..ObjectConfig::default() };
        let span = |i: usize, end: usize| first[i]..(first[i] + size[i]).min(end);
        let bands = [Band { area: Area { rows: span(0, 60), columns: span(1, 80) }, balls: 0 }];
        let see = |bands| {
            let mut seeing = Seeing::new(&camera, &object, 1, Buffers::owned(camera.width, camera.height)).unwrap();
            let (mut detections, mut whole) = (heapless::Vec::new(), true);
            for (i, image) in images.iter().enumerate() {
                let scope = Scope { bands: if i + 1 == images.len() { bands } else { &[] }, ..Scope::default() };
                whole = seeing.see_in(Image::U16(image), scope, &mut detections).unwrap();
            }
            (detections, whole, seeing.cluttered())
        };
        let ((some, whole, _), (all, _, cluttered)) = (see(&bands), see(&[]));
        // A band may be clear where the whole image is too full to be told apart.
        prop_assume!(cluttered == 0 && all.len() < 16);
        if whole {
            prop_assert_eq!(&some, &all);
        } else {
            prop_assert!(some.iter().all(|d| all.contains(d)), "{:?} {:?}", some, all);
        }
    }
}

/// A ball (a cap in disparity, around a column and a row) before a wall whose noise depends on `seed`, as a Kinect packs it.
fn packed_ball(column: f64, row: f64, seed: usize) -> Vec<u8> {
    let sample = |i: usize| {
        let (dx, dy) = ((i % 640) as f64 - column, (i / 640) as f64 - row);
        let inside = 1.0 - (dx * dx + dy * dy) / 160.0;
        if inside > 0.0 { 850 + (6.0 * (1.0 - inside.sqrt())) as u16 } else { 1000 + (i * seed % 7 / 3) as u16 }
    };
    let samples: Vec<u16> = (0..640 * 480).map(sample).collect();
    let mut packed = vec![0; Packing::Eleven.frame_bytes()];
    Packing::Eleven.pack(&samples, &mut packed).unwrap();
    packed
}

fn band(rows: Range<usize>, columns: Range<usize>, balls: usize) -> Band {
    Band { area: Area { rows, columns }, balls }
}

#[test]
fn a_band_shows_what_the_whole_image_shows_there() {
    let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).unwrap();
    let images: Vec<_> = [(200.0, 100.0, 5), (300.0, 240.0, 11), (310.5, 244.5, 3)].map(|(x, y, seed)| packed_ball(x, y, seed)).into();
    let see = |bands: &[Band]| {
        let mut buffers = Buffers::owned(640, 480);
        // What buffers hold at first, and what earlier balls left there, does not matter.
        buffers.planes.fill([f32::NAN, 1.0][bands.len() % 2]);
        let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 1, buffers).unwrap();
        let (mut detections, mut whole) = (heapless::Vec::new(), true);
        for (i, packed) in [&packed_ball(-100.0, 0.0, 1)].into_iter().chain(&images).enumerate() {
            let image = Image::Packed { packed, packing: Packing::Eleven };
            let scope = Scope { bands: if i == images.len() { bands } else { &[] }, ..Scope::default() };
            whole = seeing.see_in(image, scope, &mut detections).unwrap();
        }
        (detections, whole)
    };
    let (all, _) = see(&[]);
    assert_eq!(all.len(), 1);
    let (mut narrow, columns) = (0, 280..340);
    for rows in (0..30).map(|margin| 232 - margin..258 + margin) {
        let (detections, whole) = see(&[band(0..20, 0..640, 0), band(rows, columns.clone(), 1)]);
        assert_eq!(detections, all);
        narrow += u32::from(!whole);
    }
    // Where rows beyond the band count, the whole image was searched after all.
    assert!((10..30).contains(&narrow), "{narrow}");
    // Columns are searched 32 at a time, and the ball is in 297 to 324.
    for (columns, beyond) in [(288..352, false), (289..321, false), (288..320, true), (320..640, true)] {
        let (detections, whole) = see(&[band(210..280, columns.clone(), 1)]);
        assert_eq!((detections, whole), (all.clone(), beyond), "{columns:?}");
    }
    let (detections, whole) = see(&[band(200..300, columns.clone(), 2)]);
    assert!(whole && detections == all);
    for elsewhere in [band(0..100, columns.clone(), 0), band(200..300, 0..288, 0)] {
        let (detections, whole) = see(&[elsewhere]);
        assert!(!whole && detections.is_empty());
    }
    for rows in [400..500, Range { start: 300, end: 200 }] {
        assert_eq!(see(&[band(rows, columns.clone(), 0)]), (all.clone(), true), "no rows of the image");
    }
    for columns in [600..700, Range { start: 340, end: 280 }] {
        assert_eq!(see(&[band(200..300, columns, 0)]), (all.clone(), true), "no columns of the image");
    }
}

#[test]
fn what_is_no_image_of_the_camera_is_an_error() {
    let camera = camera(true, 10.0);
    let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(camera.width, camera.height)).unwrap();
    let mut detections = heapless::Vec::new();
    let image = vec![2047; camera.width * camera.height];
    assert_eq!(seeing.see(Image::U16(&image[1..]), &mut detections), Err(SeeError::Size { expected: 4800, found: 4799 }));
    assert_eq!(seeing.see(Image::F32(&[]), &mut detections), Err(SeeError::Size { expected: 4800, found: 0 }));
    assert_eq!(seeing.see(Image::U16(&image), &mut detections), Ok(()));
    assert_eq!(seeing.see(Image::F32(&vec![0.0; 4800]), &mut detections), Err(SeeError::Kind));
    let mut buffers = Buffers::owned(camera.width, camera.height);
    buffers.runs = Slice::Owned(vec![Run::default(); 7]);
    let error = Seeing::new(&camera, &ObjectConfig::default(), 0, buffers).err().expect("too small");
    assert_eq!(error.to_string(), "buffers.runs = 7: expected as many elements as `Buffers::required` says, at least");
    let error = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(79, 60)).err().expect("too small");
    assert_eq!((error.key, error.value), ("buffers.limits", 79.0 * 60.0));
}

#[test]
fn packed_frames_are_seen_as_the_samples_they_hold() {
    let keys = CameraConfig::default();
    let camera = Camera::from_config(&keys, DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).unwrap();
    let ball = |x: usize, y: usize| {
        let (dx, dy) = (x as f64 - 200.0, y as f64 - 150.0);
        if dx * dx + dy * dy < 160.0 { 850 } else { 1000 + (x * y % 3) as u16 }
    };
    let image: Vec<u16> = (0..640 * 480).map(|i| ball(i % 640, i / 640)).collect();
    for packing in [Packing::Eleven, Packing::Ten] {
        let image: Vec<u16> = image.iter().map(|s| if packing == Packing::Ten { *s & 1023 } else { *s }).collect();
        let mut packed = vec![0; packing.frame_bytes()];
        packing.pack(&image, &mut packed).unwrap();
        let seen = |image: Image<'_>| {
            let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(640, 480)).unwrap();
            let mut detections = heapless::Vec::new();
            seeing.see(image, &mut detections).unwrap();
            detections
        };
        let detections = seen(Image::Packed { packed: &packed, packing });
        assert_eq!(detections.len(), 1);
        assert_eq!(detections, seen(Image::U16(&image)));
    }
}

#[test]
fn a_packed_frame_is_a_disparity_cameras_and_has_its_bytes() {
    let kinect = Camera { width: 640, height: 480, ..camera(true, 10.0) };
    let check = |camera: &Camera, bytes: usize| {
        let buffers = Buffers::owned(camera.width, camera.height);
        let seeing = Seeing::new(camera, &ObjectConfig::default(), 0, buffers).unwrap();
        seeing.check(Image::Packed { packed: &vec![0; bytes], packing: Packing::Eleven })
    };
    assert_eq!(check(&kinect, 422_400), Ok(()));
    for bytes in [0, 384_000, 422_399, 422_401] {
        assert_eq!(check(&kinect, bytes), Err(SeeError::Bytes { expected: 422_400, found: bytes }));
    }
    assert_eq!(check(&camera(true, 10.0), 422_400), Err(SeeError::Packed));
    assert_eq!(check(&Camera { code: camera(false, 10.0).code, ..kinect }, 422_400), Err(SeeError::Packed));
}

#[test]
fn frames_too_cluttered_to_be_used_are_counted_as_dropped() {
    let camera = camera(true, 10.0);
    let config = Config { tracking: TrackingConfig { background_frames: 0, ..TrackingConfig::default() }, ..Config::default() };
    let mut engine = Engine::new(&config, Some(&camera)).unwrap();
    let mut random = 1_u32;
    let mut noise = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        400 + (random >> 16) as u16 % 600
    };
    let (calm, noisy) = (vec![700; 4800], (0..4800).map(|_| noise()).collect::<Vec<_>>());
    for (frame, image) in [&calm, &noisy, &noisy, &calm].into_iter().enumerate() {
        engine.frame(frame as i64, Image::U16(image), &mut |_| ()).unwrap();
    }
    engine.frame(3, Image::U16(&noisy), &mut |_| ()).unwrap();
    let counters = engine.counters();
    // Two by their clutter, one by its stamp.
    assert_eq!((counters.frames, counters.frames_dropped, counters.frames_incomplete), (5, 3, 0));
}

#[test]
fn images_of_a_few_pixels_are_seen_too() {
    for (width, height) in [(1, 1), (1, 9), (3, 2), (33, 1)] {
        let camera = Camera { width, height, ..camera(true, 10.0) };
        let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 1, Buffers::owned(width, height)).unwrap();
        for value in [2047, 700, 600] {
            seeing.see(Image::U16(&vec![value; width * height]), &mut heapless::Vec::new()).unwrap();
        }
    }
}

/// Depth, m, of a ball of `radius` (m) at `center` (camera frame, m), as each pixel's ray meets it; NaN elsewhere. `noise`: m, by its index.
fn ray_cast(camera: &Camera, center: &Vec3, radius: f64, noise: impl Fn(usize) -> f64) -> Vec<f32> {
    let depth = |i: usize| {
        let ray = camera.deproject((i % camera.width) as f64, (i / camera.width) as f64, 1.0);
        let (along, square) = (ray.dot(center), ray.norm_squared());
        let inside = along * along - square * (center.norm_squared() - radius * radius);
        if inside > 0.0 { ((along - inside.sqrt()) / square + noise(i)) as f32 } else { f32::NAN }
    };
    (0..camera.width * camera.height).map(depth).collect()
}

#[test]
fn a_camera_that_matches_over_no_window_sees_balls_where_they_are() {
    let mut state = 7_u64;
    let mut gaussian = move || {
        (0..12)
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    };
    // A Kinect v1's lens, a time-of-flight camera's, and one with few pixels.
    for (width, height, f, distance) in [(640, 480, 575.8, 1.5), (512, 424, 365.0, 1.5), (320, 240, 288.0, 1.0)] {
        let keys = CameraConfig {
            width: Some(width),
            height: Some(height),
            fx: Some(f),
            fy: Some(f),
            cx: Some(0.5 * f64::from(width)),
            cy: Some(0.5 * f64::from(height)),
            ..CameraConfig::default()
        };
        let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 }).unwrap();
        let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 0, Buffers::owned(camera.width, camera.height)).unwrap();
        let (mut seen, mut bias, mut nees) = (0.0, 0.0, 0.0);
        for i in 0..60 {
            let center = Vec3::new(0.3 * (f64::from(i) * 0.7).sin(), 0.2 * (f64::from(i) * 0.4).cos(), distance + 0.05 * f64::from(i % 5));
            let noise: Vec<f64> = (0..camera.width * camera.height).map(|_| 0.002 * gaussian()).collect();
            let mut detections = heapless::Vec::new();
            seeing.see(Image::F32(&ray_cast(&camera, &center, 0.033, |i| noise[i])), &mut detections).unwrap();
            if let (10.., Some(ball)) = (i, detections.first()) {
                let off = ball.center - center;
                seen += 1.0;
                bias += off.z;
                nees += off.dot(&(ball.covariance.try_inverse().unwrap() * off)) / 3.0;
            }
        }
        let (bias, nees) = (bias / seen, nees / seen);
        println!("f = {f}: {seen} balls, {:.2} mm too far, NEES {nees:.2}", bias * 1e3);
        assert!(seen > 48.0 && bias.abs() < 0.7e-3 && (0.1..2.0).contains(&nees), "f = {f}: {seen} balls, {bias}, NEES {nees}");
    }
}

#[test]
fn what_a_background_flickers_with_is_no_ball() {
    let (mut detections, mut seen) = (heapless::Vec::<Detection, 16>::new(), 0);
    // A floor that is seen so flatly that half of it is holes, which are others in each frame.
    let scene = Scene::parse("room?seed=1&distance=1.5&throws=10").unwrap();
    let (camera, truth) = (scene.camera(), scene.truth());
    let mut seeing = Seeing::new(&camera, &ObjectConfig::default(), 15, Buffers::owned(camera.width, camera.height)).unwrap();
    let mut frames = scene.frames();
    for frame in &truth.frames {
        let image = frames.next_frame().unwrap();
        seeing.see(Image::U16(image.samples), &mut detections).unwrap();
        for detection in &detections {
            let mut off = frame.balls.iter().map(|ball| (Vec3::from(ball.center_in_camera) - detection.center).norm());
            assert!(off.any(|off| off < 0.1), "{detection:?}");
            seen += 1;
        }
    }
    assert!(seen > 300, "{seen}");
}
