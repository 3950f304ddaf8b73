//! What the array functions return, as frozen Python classes.

use super::array::{array1, array2};
use super::event::{Field, Reduced, from_toml, mistake, reduced, toml};
use super::law::{Motion, finite};
use crate::math::{Vec3, rows};
use crate::physics::contact::Contact;
use crate::physics::flight::Flight;
use numpy::PyArray1;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use serde::{Deserialize, Serialize};
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

impl Field for Vec<f64> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(array1(py, self))
    }
}
impl Field for Vec<[f64; 3]> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array2(py, self)
    }
}
impl Field for Vec<bool> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(PyArray1::from_slice(py, self).into_any())
    }
}

/// What pickling asks a result of the class `name` for.
fn pickled<'py>(py: Python<'py>, name: &'static str, fit: &impl Serialize) -> PyResult<Reduced<'py, (&'static str, String)>> {
    reduced(py, "fit_from_toml", (name, toml(fit)?))
}

/// Declares classes, perhaps `pickled`: fields that Python sees, then those that it doesn't, then methods.
macro_rules! result_classes {
    ($($(#[$meta:meta])* $name:ident $($pickled:ident)? { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* } [$($hidden:ident: $hidden_type:ty),*] { $($extra:tt)* })*) => {$(
        $(#[$meta])*
        #[pyclass(frozen, module = "physinc")]
        #[allow(clippy::unsafe_derive_deserialize)] // What is unsafe is pyo3's, and rests on no field.
        pub struct $name {
            $(pub $field: $type,)*
            $(pub $hidden: $hidden_type,)*
        }

        #[pymethods]
        impl $name {
            #[classattr]
            fn __match_args__(py: Python<'_>) -> PyResult<Py<PyTuple>> {
                Ok(PyTuple::new(py, [$(stringify!($field)),*])?.unbind())
            }
            $($(#[$field_meta])*
            #[getter]
            fn $field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.$field.to_python(py) })*

            fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
                let fields: [(&str, Bound<'_, PyAny>); _] = [$((stringify!($field), self.$field.to_python(py)?)),*];
                let shown = fields.iter().map(|(name, value)| Ok(format!("{name}={}", value.repr()?.to_string())));
                Ok(format!("{}({})", stringify!($name), shown.collect::<PyResult<Vec<_>>>()?.join(", ")))
            }
            $(fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py, (&'static str, String)>> {
                $pickled(py, stringify!($name), self)
            })?
            $($extra)*
        }
    )*};
}
result_classes! {
    /// A sphere through points, in their frame.
    #[derive(Serialize, Deserialize)]
    SphereFit pickled {
        /// Center [3], m.
        center: [f64; 3],
        /// As given, or estimated, m.
        radius: f64,
        /// Of `center` [3, 3], m²; as if the points erred independently of each other, as neighbouring pixels do not.
        covariance: [[f64; 3]; 3],
        /// Root mean square distance of the inliers from the sphere, m.
        residual_rms: f64,
        /// Points within three standard deviations.
        inliers: usize,
    } [] {}
    /// A flight that one law explains.
    FlightFit {
        /// Of the last measurement, s.
        t: f64,
        /// At `t` [3], m.
        position: [f64; 3],
        /// At `t` [3], m/s.
        velocity: [f64; 3],
        /// As known or estimated [3], m/s²; `None` where a callable was the law.
        gravity: Option<[f64; 3]>,
        /// Of (position, velocity, gravity), [9, 9].
        covariance: [[f64; 9]; 9],
        /// Weighted sum of squared residuals; about `dof` where the law holds and the noise is known.
        chi2: f64,
        /// Numbers measured, less those that were found out.
        dof: usize,
        /// Standard deviation of the positions an axis, m, as the residuals tell it (1e-6 at the least); `None` where it was given.
        sd: Option<f64>,
        /// Root mean square distance of the measurements from the flight, m.
        residual_rms: f64,
        /// Log of the marginal likelihood of the positions: fits of the same ones with the same noise compare by it.
        log_evidence: f64,
    } [flight: Flight, law: Motion] {
        /// Where it is at `t` (s), before or after (Eq. 2): center [3] (m) and its covariance [3, 3] (m²).
        ///
        /// Raises `ValueError` where `t` or the prediction isn't finite, and what a callable law raises.
        fn predict<'py>(&self, py: Python<'py>, t: f64) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
            if !t.is_finite() {
                return Err(PyValueError::new_err("t must be finite"));
            }
            let prediction = self.law.with(py, |law| self.flight.predict(law, t))?;
            let center = finite(prediction.state.position, "the prediction")?;
            Ok((array1(py, center.as_slice()), array2(py, &rows(&prediction.covariance))?))
        }
    }
    /// Measurements beside their predictions (Eq. 3); NaN where nothing could be predicted.
    #[derive(Serialize, Deserialize)]
    Inconsistencies pickled {
        /// Centers by the law [N, 3], m.
        predicted: Vec<[f64; 3]>,
        /// From the predicted to the measured ones [N], m.
        distance: Vec<f64>,
        /// What `distance` is held against [N], m: θ, or the distance in that direction at which the whitened test alarms.
        threshold: Vec<f64>,
        /// Probability of such a distance without a cause [N]; NaN with the paper's method.
        p_value: Vec<f64>,
        /// Mean of the last five distances [N], m.
        moving_average: Vec<f64>,
        /// Where prediction and measurement disagree [N].
        inconsistent: Vec<bool>,
        /// Standard deviation of the positions an axis, m, where it was estimated.
        sd: Option<f64>,
    } [] {}
    /// Two flights that share a point and a time.
    ContactFit {
        /// First touch, s.
        time: f64,
        /// Standard deviation of `time`, s; `None` with the paper's method.
        time_sd: Option<f64>,
        /// Center of the ball at first touch [3], m.
        center: [f64; 3],
        /// Where it touched [3], m: center − radius · normal; `None` where one of them is unknown.
        point: Option<[f64; 3]>,
        /// Of `center` [3, 3], m²; `None` with the paper's method.
        covariance: Option<[[f64; 3]; 3]>,
        /// Of (center, velocity before, velocity after), [9, 9]; `None` with the paper's method.
        state_covariance: Option<[[f64; 9]; 9]>,
        /// Unit normal [3], to the side the ball came from: as given, or as this contact alone shows it.
        normal: Option<[f64; 3]>,
        /// The paper's [3]: normalised mean of the two unit tangents along the motion [3]; `None` where they cancel.
        direction: Option<[f64; 3]>,
        /// At first touch [3], m/s.
        velocity_before: [f64; 3],
        /// At last touch [3], m/s.
        velocity_after: [f64; 3],
        /// Speed away from the surface over speed into it.
        restitution: Option<f64>,
        /// Weighted sum of squared residuals; `None` with the paper's method.
        chi2: Option<f64>,
        /// Standard deviation of the positions an axis, m, where it was estimated.
        sd: Option<f64>,
    } [contact: Contact, radius: Option<f64>] {}
    /// Metres per unit of a trajectory that was known up to scale.
    #[derive(Serialize, Deserialize)]
    ScaleFit pickled {
        /// Metres per unit.
        scale: f64,
        /// Standard deviation of `scale`, metres per unit.
        sd: f64,
        /// Where gravity pulls: unit vector [3] in the trajectory's own axes.
        gravity_direction: [f64; 3],
        /// k of a = g − k |v| v, 1/m, as told or as the flight tells it.
        drag: f64,
        /// Standard deviation of the positions about the flight, units an axis.
        residual_sd: f64,
        /// Numbers measured, less those that were found out.
        dof: usize,
    } [] {}
    /// A plane that contacts lie on.
    #[derive(Serialize, Deserialize)]
    PlaneFit pickled {
        /// Unit normal [3], to the contacts' side.
        normal: [f64; 3],
        /// normal · p = offset, m.
        offset: f64,
        /// Of (normal, offset), [4, 4].
        covariance: [[f64; 4]; 4],
        /// Which of the contacts, by index.
        contacts: Vec<usize>,
        /// Of the ball on it.
        restitution: f64,
        /// Angle between the normal and up, rad.
        tilt: f64,
        /// Standard deviation of `tilt`, rad.
        tilt_sd: f64,
        /// Convex hull of the touched points on the plane [M, 3], m.
        outline: Vec<[f64; 3]>,
        /// The parallel plane below it, by its index in the list.
        above: Option<crate::event::Above>,
    } [] {}
}

/// The result, of the class `name`, that pickling wrote.
#[pyfunction]
pub fn fit_from_toml<'py>(py: Python<'py>, name: &str, text: &str) -> PyResult<Bound<'py, PyAny>> {
    match name {
        "SphereFit" => from_toml::<SphereFit>(text)?.into_bound_py_any(py),
        "ScaleFit" => from_toml::<ScaleFit>(text)?.into_bound_py_any(py),
        "PlaneFit" => from_toml::<PlaneFit>(text)?.into_bound_py_any(py),
        "Inconsistencies" => from_toml::<Inconsistencies>(text)?.into_bound_py_any(py),
        _ => Err(mistake("no such result")),
    }
}

impl ContactFit {
    /// Of a contact with a surface of `normal`; `radius` (m) of the ball, `sd` (m) of the positions where it was estimated.
    pub fn new(contact: Contact, normal: Option<Vec3>, radius: Option<f64>, sd: Option<f64>) -> Self {
        let known = |x: f64| x.is_finite().then_some(x);
        let covariance = Some(contact.covariance).filter(|c| c.iter().all(|x| x.is_finite()));
        Self {
            time: contact.time,
            time_sd: known(contact.time_sd),
            center: contact.center.into(),
            point: normal.zip(radius).map(|(normal, radius)| (contact.center - normal * radius).into()),
            covariance: covariance.map(|_| rows(&contact.center_covariance())),
            state_covariance: covariance.map(|c| rows(&c)),
            normal: normal.map(Into::into),
            direction: contact.direction().map(Into::into),
            velocity_before: contact.before.into(),
            velocity_after: contact.after.into(),
            restitution: normal.and_then(|normal| contact.restitution(&normal)),
            chi2: known(contact.chi2),
            sd,
            contact,
            radius,
        }
    }
}
