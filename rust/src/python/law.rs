//! Laws of motion by name, or as a Python callable: of a fit, and of a stream.

use super::array::vector;
use super::config;
use crate::config::Config;
use crate::math::Vec3;
use crate::physics::gravity::Gravity;
use crate::physics::law::{FreeFallWithDrag, Law};
use crate::physics::own::OwnLaw;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::cell::RefCell;
use std::format;
use std::string::String;
use std::sync::{Arc, Mutex, PoisonError};

/// Which law.
pub enum Motion {
    /// Gravity and the air.
    Fall(FreeFallWithDrag),
    /// The user's own: `law(t, position, velocity)` is the whole acceleration.
    Python(Py<PyAny>),
}

impl Motion {
    /// `free_fall`, `free_fall_with_drag` or a callable; `drag` is a number (1/m) or a configuration.
    pub fn new(law: &Bound<'_, PyAny>, drag: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let name = match law.extract::<String>() {
            Ok(name) => name,
            Err(_) if law.is_callable() => String::new(),
            Err(_) => return Err(unknown(law)),
        };
        match (name.as_str(), drag) {
            ("free_fall_with_drag", drag) => Ok(Self::Fall(self::drag(drag)?)),
            (_, Some(_)) => Err(PyValueError::new_err("drag has a part in the law \"free_fall_with_drag\" only")),
            ("free_fall", None) => Ok(Self::Fall(FreeFallWithDrag { drag: 0.0 })),
            ("", None) => Ok(Self::Python(law.clone().unbind())),
            _ => Err(unknown(law)),
        }
    }

    /// What a fit knows of gravity: all (3 numbers), its size (a number), nothing (`None`). Beside a callable it has no part.
    pub fn gravity(&self, gravity: Option<&Bound<'_, PyAny>>) -> PyResult<Gravity> {
        match (self, gravity) {
            (Self::Python(_), _) => Ok(Gravity::known(Vec3::zeros())),
            (_, None) => Ok(Gravity::free(None)),
            (_, Some(gravity)) => match gravity.extract::<f64>() {
                Ok(size) if size > 0.0 && size.is_finite() => Ok(Gravity::free(Some(size))),
                Ok(size) => Err(PyValueError::new_err(format!("gravity = {size}: a size must be above 0 and finite, m/s²"))),
                Err(_) => self.known_gravity(gravity).map(Gravity::known),
            },
        }
    }

    /// Gravity as 3 numbers; zero beside a callable.
    pub fn known_gravity(&self, gravity: &Bound<'_, PyAny>) -> PyResult<Vec3> {
        match self {
            Self::Python(_) => Ok(Vec3::zeros()),
            Self::Fall(_) => vector(gravity, "gravity").and_then(|g| finite(g, "gravity")),
        }
    }

    /// Calls `work` with the law; what the user's own raised meanwhile is raised here.
    pub fn with<T>(&self, py: Python<'_>, work: impl FnOnce(&dyn Law) -> T) -> PyResult<T> {
        match self {
            Self::Fall(law) => Ok(work(law)),
            Self::Python(callable) => {
                let law = PyLaw { callable: callable.bind(py), raised: RefCell::default() };
                let result = work(&law);
                law.raised.into_inner().map_or(Ok(result), Err)
            }
        }
    }

    pub fn is_python(&self) -> bool {
        matches!(self, Self::Python(_))
    }
}

/// The drag of a ball: a number, or as a configuration (by default a tennis ball's) says.
pub fn drag(from: Option<&Bound<'_, PyAny>>) -> PyResult<FreeFallWithDrag> {
    match from.and_then(|from| from.extract::<f64>().ok()) {
        Some(drag) if drag >= 0.0 && drag.is_finite() => Ok(FreeFallWithDrag { drag }),
        Some(drag) => Err(PyValueError::new_err(format!("drag = {drag}: expected a number from 0, 1/m"))),
        None => {
            let config = config::config(from)?;
            let radius = config.object.radius.as_slice().first().copied().unwrap_or_default();
            Ok(FreeFallWithDrag::of(&config.object, &config.laws, radius))
        }
    }
}

fn unknown(law: &Bound<'_, PyAny>) -> PyErr {
    let shown = super::array::shown(law);
    PyValueError::new_err(format!("law must be \"free_fall\", \"free_fall_with_drag\" or law(t, position, velocity), got {shown}"))
}

/// `vector`, if it is finite.
pub fn finite(vector: Vec3, what: &str) -> PyResult<Vec3> {
    if vector.iter().all(|x| x.is_finite()) { Ok(vector) } else { Err(PyValueError::new_err(format!("{what} must be finite"))) }
}

/// A callable as a law. After it raised it isn't called again, and answers NaN.
struct PyLaw<'py> {
    callable: &'py Bound<'py, PyAny>,
    raised: RefCell<Option<PyErr>>,
}

impl Law for PyLaw<'_> {
    /// Its whole acceleration, and `gravity`, which fits hold at zero beside it.
    fn acceleration(&self, gravity: &Vec3, t: f64, position: &Vec3, velocity: &Vec3) -> Vec3 {
        let nowhere = Vec3::from_element(f64::NAN);
        if self.raised.borrow().is_some() {
            return nowhere;
        }
        ask(self.callable, t, position, velocity).map_or_else(
            |error| {
                *self.raised.borrow_mut() = Some(error);
                nowhere
            },
            |a| a + gravity,
        )
    }
}

/// What `law(t, position, velocity)` returns, or raises.
fn ask(law: &Bound<'_, PyAny>, t: f64, position: &Vec3, velocity: &Vec3) -> PyResult<Vec3> {
    let [p, v] = [position, velocity].map(|x| PyArray1::from_slice(law.py(), x.as_slice()));
    let answer = law.call1((t, p, v))?;
    vector(&answer, "what law returns").and_then(|a| finite(a, "what law returns"))
}

/// A callable as the law of a stream, which asks it on whichever thread reads the source.
pub struct StreamLaw {
    callable: Py<PyAny>,
    raised: Raised,
}

/// What the law of a stream raised.
#[derive(Clone, Default)]
pub struct Raised(Arc<Mutex<Option<PyErr>>>);

impl Raised {
    /// Once.
    pub fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

impl StreamLaw {
    /// The law, which `config` must leave room for, and where to find what it raised.
    pub fn new(law: &Bound<'_, PyAny>, config: &Config) -> PyResult<(Self, Raised)> {
        if !law.is_callable() {
            let shown = super::array::shown(law);
            return Err(PyValueError::new_err(format!(
                "law must be a callable law(t, position, velocity), got {shown}; laws by name are the configuration's"
            )));
        }
        config.can_obey()?;
        let raised = Raised::default();
        Ok((Self { callable: law.clone().unbind(), raised: raised.clone() }, raised))
    }
}

impl OwnLaw for StreamLaw {
    fn acceleration(&mut self, t: f64, position: &Vec3, velocity: &Vec3) -> Option<Vec3> {
        // An interpreter that shuts down has no use for an answer.
        Python::try_attach(|py| match ask(self.callable.bind(py), t, position, velocity) {
            Ok(acceleration) => Some(acceleration),
            Err(error) => {
                *self.raised.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
                None
            }
        })?
    }
}
