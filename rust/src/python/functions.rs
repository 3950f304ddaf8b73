//! The functions on arrays: each converts, asks the core, converts back. Python's signatures and documentation are in `arrays.py`.

use super::array::{array2, points, shown, vector};
use super::law::{Motion, finite};
use super::result::{ContactFit, FlightFit, Inconsistencies, SphereFit};
use super::samples::{Noise, samples};
use crate::detect::sphere;
use crate::math::{Vec3, rows, sqrt};
use crate::physics::contact::{Contact, RESTITUTION, Solver};
use crate::physics::flight::Flight;
use crate::physics::watch::{self, Criterion, Horizon, Watch};
use crate::physics::{Sample, paper};
use crate::track::hypothesis::plausible;
use nalgebra::SVector;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::format;
use std::vec::Vec;

/// A sphere through points.
#[pyfunction]
pub fn fit_sphere(points: &Bound<'_, PyAny>, radius: Option<f64>) -> PyResult<Option<SphereFit>> {
    if let Some(radius) = radius.filter(|radius| !(*radius > 0.0 && radius.is_finite())) {
        return Err(PyValueError::new_err(format!("radius = {radius}: expected a length above 0, m")));
    }
    let fit = sphere::fit_sphere(&self::points(points, "points")?, radius);
    Ok(fit.map(|fit| SphereFit {
        center: fit.center.into(),
        radius: fit.radius,
        covariance: rows(&fit.covariance),
        residual_rms: fit.residual_rms,
        inliers: fit.inliers,
    }))
}

/// Eq. 4.
#[pyfunction]
pub fn accelerations<'py>(t: &Bound<'py, PyAny>, positions: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let samples = samples(t, positions, Noise { sd: None, covariance: None }, 0)?;
    let mut accelerations = std::vec![[f64::NAN; 3]; samples.len()];
    for (window, acceleration) in samples.windows(3).zip(accelerations.iter_mut().skip(2)) {
        if let Some(a) = paper::acceleration(&window[0], &window[1], &window[2]) {
            *acceleration = a.into();
        }
    }
    array2(t.py(), &accelerations)
}

/// One flight.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // They are Python's.
pub fn fit_flight(
    t: &Bound<'_, PyAny>,
    positions: &Bound<'_, PyAny>,
    law: &Bound<'_, PyAny>,
    gravity: Option<&Bound<'_, PyAny>>,
    drag: Option<&Bound<'_, PyAny>>,
    sd: Option<f64>,
    covariance: Option<&Bound<'_, PyAny>>,
) -> PyResult<Option<FlightFit>> {
    let law = Motion::new(law, drag)?;
    let gravity = law.gravity(gravity)?;
    let noise = Noise { sd, covariance };
    let unknowns = 6 + gravity.unknowns() as usize;
    let mut samples = samples(t, positions, noise, (unknowns + usize::from(noise.is_unknown())).div_ceil(3))?;
    let fit = law.with(t.py(), |law| {
        let (flight, estimated) = if noise.is_unknown() {
            Flight::fit_with_noise(law, &mut samples, &gravity).map(|(flight, sd)| (flight, Some(sd)))?
        } else {
            (Flight::fit_fully(law, &samples, &gravity)?, None)
        };
        let squares: f64 = flight.residuals(law, &samples).map(|r| r.norm_squared()).sum();
        Some((flight, estimated, sqrt(squares / samples.len() as f64)))
    })?;
    Ok(fit.map(|(flight, estimated, residual_rms)| FlightFit {
        t: flight.state.t,
        position: flight.state.position.into(),
        velocity: flight.state.velocity.into(),
        gravity: (!law.is_python()).then(|| flight.gravity.into()),
        covariance: rows(&flight.covariance),
        chi2: flight.chi2,
        dof: 3 * samples.len() - unknowns,
        sd: estimated,
        residual_rms,
        log_evidence: flight.log_evidence,
        flight,
        law,
    }))
}

/// Eq. 3 along a recorded motion.
#[pyfunction]
#[allow(clippy::too_many_arguments)] // They are Python's.
pub fn find_inconsistencies(
    t: &Bound<'_, PyAny>,
    positions: &Bound<'_, PyAny>,
    method: &Bound<'_, PyAny>,
    horizon: Option<&Bound<'_, PyAny>>,
    law: &Bound<'_, PyAny>,
    gravity: &Bound<'_, PyAny>,
    drag: Option<&Bound<'_, PyAny>>,
    sd: Option<f64>,
    covariance: Option<&Bound<'_, PyAny>>,
    theta: f64,
    false_alarm: f64,
) -> PyResult<Inconsistencies> {
    let paper = is_paper(method)?;
    if paper && law.extract::<&str>().ok() != Some("free_fall") {
        return Err(PyValueError::new_err("the paper's method predicts by Eq. 5, under gravity alone: law must be \"free_fall\""));
    }
    let law = Motion::new(law, drag)?;
    let gravity = law.known_gravity(gravity)?;
    let horizon = match horizon.map(|horizon| is_second(horizon, "horizon", ["step", "flight"])).transpose()? {
        Some(true) => Horizon::Flight,
        None if !paper => Horizon::Flight,
        _ => Horizon::Step,
    };
    let criterion = match (paper, theta, false_alarm) {
        (true, theta, _) if theta > 0.0 && theta.is_finite() => Criterion::Theta(theta),
        (true, ..) => return Err(PyValueError::new_err(format!("theta = {theta}: expected a distance above 0, m"))),
        (false, _, p) if (1e-12..=0.5).contains(&p) => Criterion::FalseAlarm(p),
        _ => return Err(PyValueError::new_err(format!("false_alarm = {false_alarm}: expected a probability of 1e-12 to 0.5"))),
    };
    let noise = Noise { sd, covariance };
    let mut samples = samples(t, positions, noise, 3)?;
    let mut estimated = None;
    if noise.is_unknown() && !paper {
        let sd = watch::noise(&samples, &mut std::vec![0.0; 3 * samples.len()]).ok_or_else(|| {
            let count = samples.len();
            PyValueError::new_err(format!("{count} positions don't tell their noise, 8 would: give sd or covariance"))
        })?;
        let sd = sd.max(1e-6);
        for s in &mut samples {
            *s = Sample::isotropic(s.t, s.position, sd);
        }
        estimated = Some(sd);
    }
    let mut found = Inconsistencies {
        predicted: Vec::new(),
        distance: Vec::new(),
        threshold: Vec::new(),
        p_value: Vec::new(),
        moving_average: Vec::new(),
        inconsistent: Vec::new(),
        sd: estimated,
    };
    law.with(t.py(), |law| {
        Watch { law, gravity, horizon, criterion }.over(&samples, |verdict| {
            let number = |x: Option<f64>| x.unwrap_or(f64::NAN);
            found.predicted.push(verdict.map_or([f64::NAN; 3], |v| v.comparison.predicted.into()));
            found.distance.push(number(verdict.map(|v| v.comparison.distance)));
            found.threshold.push(number(verdict.map(|v| v.comparison.threshold)));
            found.p_value.push(number(verdict.and_then(|v| v.comparison.p_value)));
            found.moving_average.push(number(verdict.map(|v| v.moving_average)));
            found.inconsistent.push(verdict.is_some_and(|v| v.inconsistent));
        });
    })?;
    Ok(found)
}

/// Times, positions and perhaps covariances of one side of a contact.
type Side<'py> = (Bound<'py, PyAny>, Bound<'py, PyAny>, Option<Bound<'py, PyAny>>);

/// The contact between two flights.
#[pyfunction]
#[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)] // They are Python's.
pub fn solve_contact(
    py: Python<'_>,
    before: Side<'_>,
    after: Side<'_>,
    method: &Bound<'_, PyAny>,
    law: &Bound<'_, PyAny>,
    gravity: Option<&Bound<'_, PyAny>>,
    drag: Option<&Bound<'_, PyAny>>,
    duration: f64,
    normal: Option<&Bound<'_, PyAny>>,
    radius: Option<f64>,
    sd: Option<f64>,
) -> PyResult<Option<ContactFit>> {
    let paper = is_paper(method)?;
    let law = Motion::new(law, drag)?;
    let gravity = law.gravity(gravity)?;
    let radius = length(radius, "radius")?;
    let normal = normal.map(|n| direction(n, "normal")).transpose()?;
    if !(0.0..=0.05).contains(&duration) {
        return Err(PyValueError::new_err(format!("duration = {duration}: expected 0 to 0.05 s")));
    }
    if before.2.is_some() != after.2.is_some() {
        return Err(PyValueError::new_err("covariances must be given before and after, or not at all"));
    }
    let side = |(t, positions, covariance): &Side<'_>, name: &str| {
        let noise = Noise { sd, covariance: covariance.as_ref() };
        samples(t, positions, noise, 0).map_err(|error| PyValueError::new_err(format!("{name}: {}", error.value(py))))
    };
    let (first, second) = (side(&before, "before")?, side(&after, "after")?);
    if let (Some(last), Some(next)) = (first.last(), second.first())
        && next.t <= last.t
    {
        return Err(PyValueError::new_err(format!("after begins at {} s, but before ends at {} s", next.t, last.t)));
    }
    if paper {
        let contact = paper::contact(&first, &second);
        return contact.map(|contact| faced(contact, normal, paper::normal, radius, None)).transpose();
    }
    let unknown = sd.is_none() && before.2.is_none();
    let least = (6 + gravity.unknowns() as usize + usize::from(unknown)).div_ceil(3);
    if first.len().min(second.len()) < least {
        return Ok(None);
    }
    let split = first.len();
    let mut samples = [first, second].concat();
    let found = law.with(py, |law| {
        let solver = Solver { law, gravity: &gravity, duration };
        let estimated = if unknown { Some(solver.noise(&mut samples, split)?) } else { None };
        let contact = plausible(solver.solve(&samples, split, normal.as_ref())?, &samples)?;
        let between = samples[split - 1].t - duration - 2e-3..=samples[split].t + 2e-3;
        between.contains(&contact.time).then_some((contact, estimated))
    })?;
    found.map(|(contact, sd)| faced(contact, normal, |contact| contact.normal(RESTITUTION), radius, sd)).transpose()
}

/// The fit of a contact with a surface of `normal`, or of its `own`; an error where the ball came from behind that, by more than noise tells.
fn faced(
    contact: Contact,
    normal: Option<Vec3>,
    own: impl Fn(&Contact) -> Option<Vec3>,
    radius: Option<f64>,
    sd: Option<f64>,
) -> PyResult<ContactFit> {
    if let Some(normal) = normal {
        let (into, away) = (contact.before.dot(&normal), contact.after.dot(&normal));
        // Of (center, velocity before, velocity after); the paper's contact knows none.
        let across = SVector::<f64, 9>::from_fn(|i, _| [0.0, -1.0, 1.0][i / 3] * normal[i % 3]);
        let noise = Some(across.dot(&(contact.covariance * across))).filter(|variance| variance.is_finite()).map_or(0.0, sqrt);
        if into > 0.0 && away < 0.0 && into - away > 3.0 * noise {
            return Err(PyValueError::new_err("normal points away from the side the ball came from: give it with the other sign"));
        }
    }
    let normal = normal.or_else(|| own(&contact));
    Ok(ContactFit::new(contact, normal, radius, sd))
}

fn is_paper(method: &Bound<'_, PyAny>) -> PyResult<bool> {
    is_second(method, "method", ["best", "paper"])
}

/// Whether `word` is the second of two; what is neither is named `what`.
fn is_second(word: &Bound<'_, PyAny>, what: &str, [first, second]: [&str; 2]) -> PyResult<bool> {
    match word.extract::<&str>() {
        Ok(word) if word == first => Ok(false),
        Ok(word) if word == second => Ok(true),
        _ => Err(PyValueError::new_err(format!("{what} must be \"{first}\" or \"{second}\", got {}", shown(word)))),
    }
}

/// `None`, or from 0 on and finite.
pub fn length(value: Option<f64>, what: &str) -> PyResult<Option<f64>> {
    match value {
        Some(x) if !(x >= 0.0 && x.is_finite()) => Err(PyValueError::new_err(format!("{what} = {x}: expected a length, m"))),
        _ => Ok(value),
    }
}

/// A unit vector.
pub fn direction(value: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec3> {
    let vector = vector(value, what).and_then(|v| finite(v, what))?;
    vector.try_normalize(1e-9).ok_or_else(|| PyValueError::new_err(format!("{what} must have a length")))
}
