//! What the array functions return, as frozen Python classes.

use super::array::{array1, array2};
use super::event::Field;
use super::law::{Motion, finite};
use crate::math::{Vec3, rows};
use crate::physics::contact::Contact;
use crate::physics::flight::Flight;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
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

/// Declares classes: fields that Python sees, then those that it doesn't, then methods.
macro_rules! result_classes {
    ($($name:ident { $($field:ident: $type:ty),* } [$($hidden:ident: $hidden_type:ty),*] { $($extra:tt)* })*) => {$(
        #[pyclass(frozen, module = "physinc")]
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
            $(#[getter]
            fn $field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.$field.to_python(py) })*

            fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
                let fields: [(&str, Bound<'_, PyAny>); _] = [$((stringify!($field), self.$field.to_python(py)?)),*];
                let shown = fields.iter().map(|(name, value)| Ok(format!("{name}={}", value.repr()?.to_string())));
                Ok(format!("{}({})", stringify!($name), shown.collect::<PyResult<Vec<_>>>()?.join(", ")))
            }
            $($extra)*
        }
    )*};
}
result_classes! {
    SphereFit { center: [f64; 3], radius: f64, covariance: [[f64; 3]; 3], residual_rms: f64, inliers: usize } [] {}
    FlightFit {
        t: f64, position: [f64; 3], velocity: [f64; 3], gravity: Option<[f64; 3]>, covariance: [[f64; 9]; 9], chi2: f64, dof: usize,
        sd: Option<f64>, residual_rms: f64, log_evidence: f64
    } [flight: Flight, law: Motion] {
        /// Eq. 2: where it is at `t` (s), and how surely.
        fn predict<'py>(&self, py: Python<'py>, t: f64) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
            if !t.is_finite() {
                return Err(PyValueError::new_err("t must be finite"));
            }
            let prediction = self.law.with(py, |law| self.flight.predict(law, t))?;
            let center = finite(prediction.state.position, "the prediction")?;
            Ok((array1(py, center.as_slice()), array2(py, &rows(&prediction.covariance))?))
        }
    }
    Inconsistencies {
        predicted: Vec<[f64; 3]>, distance: Vec<f64>, threshold: Vec<f64>, p_value: Vec<f64>, moving_average: Vec<f64>,
        inconsistent: Vec<bool>, sd: Option<f64>
    } [] {}
    ContactFit {
        time: f64, time_sd: Option<f64>, center: [f64; 3], point: Option<[f64; 3]>, covariance: Option<[[f64; 3]; 3]>,
        state_covariance: Option<[[f64; 9]; 9]>, normal: Option<[f64; 3]>, direction: Option<[f64; 3]>, velocity_before: [f64; 3],
        velocity_after: [f64; 3], restitution: Option<f64>, chi2: Option<f64>, sd: Option<f64>
    } [contact: Contact, radius: Option<f64>] {}
    ScaleFit { scale: f64, sd: f64, gravity_direction: [f64; 3], residual_sd: f64, dof: usize } [] {}
    PlaneFit {
        normal: [f64; 3], offset: f64, covariance: [[f64; 4]; 4], contacts: Vec<usize>, restitution: f64, tilt: f64, tilt_sd: f64,
        outline: Vec<[f64; 3]>, above: Option<crate::event::Above>
    } [] {}
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
