//! Predictions among known surfaces, against what simulated balls do there.

use physinc::config::{Config, KnownBox, KnownPlane};
use physinc::engine::Engine;
use physinc::math::{Mat3, Vec3};
use physinc::sim::Scene;
use physinc::track::Measurement;

/// Standard deviation of the positions, m.
const NOISE: f64 = 2e-3;
const RATE: f64 = 30.0;

/// Errors of predictions: normalised squared ones, and how large they are.
#[derive(Default)]
struct Errors {
    nees: Vec<f64>,
    size: Vec<f64>,
}

impl Errors {
    fn add(&mut self, off: Vec3, covariance: &Mat3) {
        self.nees.push(off.dot(&(covariance.try_inverse().expect("a covariance") * off)));
        self.size.push(off.norm());
    }

    fn mean(&self) -> f64 {
        self.nees.iter().sum::<f64>() / self.nees.len() as f64
    }

    /// Part of the errors beyond what χ² of three exceeds once in twenty.
    fn beyond(&self) -> f64 {
        self.nees.iter().filter(|x| **x > 7.815).count() as f64 / self.nees.len() as f64
    }

    fn median(&self) -> f64 {
        let mut sizes = self.size.clone();
        sizes.sort_by(f64::total_cmp);
        sizes[sizes.len() / 2]
    }
}

/// The floor and the box of `bounce` scenes.
fn known(scene: &Scene) -> Config {
    let p = &scene.truth().parameters;
    let mut config = Config::default();
    config.object.contact_duration = p.contact_duration;
    config.environment.plane.push(KnownPlane::default()).unwrap();
    let center = [0.15, p.distance, 0.045];
    config.environment.r#box.push(KnownBox { center, size: [0.44, 0.34, 0.09], yaw: 0.1, ..KnownBox::default() }).unwrap();
    config
}

/// Predictions `ahead` frames: those across a bounce, with the surfaces and by the law alone, and those across none.
fn errors(seeds: core::ops::Range<u32>, ahead: usize) -> [Errors; 3] {
    let [mut across, mut by_law, mut free] = <[Errors; 3]>::default();
    for seed in seeds {
        let scene = Scene::parse(&format!("bounce?seed={seed}&distance={}", 1.5 + 0.02 * f64::from(seed % 25))).unwrap();
        let config = known(&scene);
        let mut engine = Engine::new(&config, None).unwrap();
        let truth: Vec<_> = scene.positions(RATE, 0.0).collect();
        for (i, measured) in scene.positions(RATE, NOISE).enumerate() {
            let now = measured.timestamp_ns;
            let m = Measurement {
                time_ns: now,
                center: measured.center,
                covariance: Some(Mat3::from_diagonal_element(NOISE * NOISE)),
                drift: Mat3::zeros(),
                center_in_camera: None,
                label: Some(measured.ball as u32 + 1),
                radius: 0.033,
                points: None,
                residual_rms: None,
                whole: true,
            };
            engine.positions(now, &[m], &mut |_| {});
            let Some(then) = truth.get(i + ahead).filter(|then| then.ball == measured.ball) else { continue };
            let flown = truth[..i].iter().rev().take_while(|p| p.ball == measured.ball).count();
            let Some(predictor) = engine.predictors().last().filter(|_| flown > 5) else { continue };
            let bounced = |until: i64| {
                let touches = &scene.truth().contacts;
                touches.iter().any(|c| c.ball == measured.ball && c.time_ns > now && c.time_ns < until)
            };
            let (center, covariance) = predictor.predict_among(engine.environment(), then.timestamp_ns);
            let (off, plain) = (then.center - center, predictor.predict(then.timestamp_ns));
            if bounced(then.timestamp_ns) {
                across.add(off, &covariance);
                by_law.add(then.center - plain.0, &plain.1);
            } else {
                free.add(off, &covariance);
            }
        }
    }
    [across, by_law, free]
}

#[test]
fn predictions_across_bounces_are_as_good_as_they_say() {
    // 0.3 s, and the next frame; restitutions are learned on the way.
    for (ahead, limit) in [(9, 0.03), (1, 0.005)] {
        let [across, by_law, free] = errors(900..920, ahead);
        assert!(across.nees.len() > 250 && free.nees.len() > 1000, "{} {}", across.nees.len(), free.nees.len());
        for e in [&across, &free] {
            // Of three degrees of freedom. Predictions of one throw are not independent.
            assert!((2.0..4.0).contains(&e.mean()) && e.beyond() < 0.07, "{ahead}: NEES {} {}", e.mean(), e.beyond());
        }
        assert!(across.median() < limit && across.median() < 0.1 * by_law.median(), "{ahead}: {} {}", across.median(), by_law.median());
    }
}
