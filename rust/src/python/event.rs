//! Events as frozen Python classes.

use super::array::{self, array1, array2, matrix, vector};
use super::error::PhysincError;
use crate::event::{self, Event, Kind, events, parts};
use crate::math::rows;
use pyo3::IntoPyObjectExt;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList, PyTuple};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::format;
use std::hash::{Hash, Hasher};
use std::string::{String, ToString};
use std::vec::Vec;

/// A field as Python sees it: float64 arrays for vectors and matrices, `None` where unknown.
pub trait Field {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>>;
}

macro_rules! plain_fields {
    ($($type:ty),*) => {$(impl Field for $type {
        fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.into_bound_py_any(py) }
    })*};
}
plain_fields!(bool, u32, u64, usize, i64, f64, Vec<usize>);

impl<const N: usize> Field for [f64; N] {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(array1(py, self))
    }
}
impl<const R: usize, const C: usize> Field for [[f64; C]; R] {
    /// A covariance that nobody knows is NaN.
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        if self.as_flattened().iter().all(|x| x.is_nan()) { Ok(py.None().into_bound(py)) } else { array2(py, self) }
    }
}
impl<const N: usize> Field for heapless::Vec<[f64; 3], N> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        array2(py, self)
    }
}
impl<const N: usize> Field for heapless::String<N> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.as_str().into_bound_py_any(py)
    }
}
impl<T: Field> Field for Option<T> {
    fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.as_ref().map_or_else(|| Ok(py.None().into_bound(py)), |value| value.to_python(py))
    }
}

/// Reasons are words, the same as in JSON.
macro_rules! words {
    ($($type:ty),*) => {$(impl Field for $type {
        fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { plain(py, self) }
    })*};
}
words!(heapless::Vec<event::Undetermined, 4>, event::TrackReason, event::GapReason, event::DisconnectReason, event::ReconnectReason, event::EndReason);

/// `value` as dicts, lists, numbers and strings, exactly what its JSON says.
fn plain<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    fn convert<'py>(py: Python<'py>, value: &serde_json::Value) -> PyResult<Bound<'py, PyAny>> {
        use serde_json::Value;
        match value {
            Value::Null => Ok(py.None().into_bound(py)),
            Value::Bool(flag) => flag.into_bound_py_any(py),
            Value::Number(number) => match number.as_i64() {
                Some(integer) => integer.into_bound_py_any(py),
                None => number.as_f64().into_bound_py_any(py),
            },
            Value::String(text) => text.into_bound_py_any(py),
            Value::Array(items) => {
                let items = items.iter().map(|item| convert(py, item)).collect::<PyResult<Vec<_>>>()?;
                Ok(PyList::new(py, items)?.into_any())
            }
            Value::Object(fields) => {
                let dict = PyDict::new(py);
                for (name, field) in fields {
                    dict.set_item(name, convert(py, field)?)?;
                }
                Ok(dict.into_any())
            }
        }
    }
    convert(py, &tree(value)?)
}

/// The JSON of `value`; a matrix of which nothing is known is one `null`.
fn tree(value: &impl Serialize) -> PyResult<serde_json::Value> {
    let mut tree = serde_json::to_value(value).map_err(mistake)?;
    if let Some(fields) = tree.as_object_mut() {
        for field in fields.values_mut() {
            let rows = field.as_array().filter(|rows| !rows.is_empty());
            if rows.is_some_and(|rows| rows.iter().all(|row| row.as_array().is_some_and(|row| row.iter().all(serde_json::Value::is_null))))
            {
                *field = serde_json::Value::Null;
            }
        }
    }
    Ok(tree)
}

#[allow(clippy::needless_pass_by_value)] // As `map_err` gives it.
pub fn mistake(error: impl ToString) -> PyErr {
    PhysincError::new_err(error.to_string())
}

/// What pickling asks for: a function, and what it is to be handed.
pub type Reduced<'py, A> = (Bound<'py, PyAny>, A);

/// Pickled by the function `reader` of this module, which takes `arguments`.
pub fn reduced<'py, A>(py: Python<'py>, reader: &str, arguments: A) -> PyResult<Reduced<'py, A>> {
    Ok((py.import("physinc._physinc")?.getattr(reader)?, arguments))
}

/// What pickling writes: TOML, because it has NaN and writes floats exactly.
pub fn toml(value: &impl Serialize) -> PyResult<String> {
    toml::to_string(value).map_err(mistake)
}

/// What pickling wrote.
pub fn from_toml<T: DeserializeOwned>(text: &str) -> PyResult<T> {
    toml::from_str(text).map_err(mistake)
}

fn repr(name: &str, fields: &Bound<'_, PyAny>) -> PyResult<String> {
    let fields = fields.cast::<PyDict>()?.iter().filter(|(key, _)| !key.eq("event").unwrap_or(false));
    let fields = fields.map(|(key, value)| Ok(format!("{key}={}", value.repr()?))).collect::<PyResult<Vec<_>>>()?;
    Ok(format!("{name}({})", fields.join(", ")))
}

/// Declares classes that are part of events.
macro_rules! part_classes {
    ($($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* })*) => {$(
        $(#[$meta])*
        #[pyclass(frozen, eq, module = "physinc")]
        #[derive(PartialEq)]
        pub struct $name(pub event::$name);

        #[pymethods]
        impl $name {
            $($(#[$field_meta])*
            #[getter]
            fn $field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.0.$field.to_python(py) })*

            /// As plain Python values, the same as in JSON.
            fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { plain(py, &self.0) }

            fn __repr__(&self, py: Python<'_>) -> PyResult<String> { repr(stringify!($name), &self.to_dict(py)?) }

            fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py, (&'static str, String)>> {
                reduced(py, "part_from_toml", (stringify!($name), toml(&self.0)?))
            }
        }

        impl Field for event::$name {
            fn to_python<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { Ok(Bound::new(py, $name(self.clone()))?.into_any()) }
        }
    )*

        /// The part of an event, of the class `name`, that pickling wrote.
        #[pyfunction]
        pub fn part_from_toml<'py>(py: Python<'py>, name: &str, text: &str) -> PyResult<Bound<'py, PyAny>> {
            match name {
                $(stringify!($name) => from_toml::<event::$name>(text)?.to_python(py),)*
                _ => Err(mistake("no such part")),
            }
        }
    };
}
parts!(part_classes);

/// Declares an event class with what all events have, its own fields, and methods.
macro_rules! event_class {
    ($(#[$meta:meta])* $name:ident { $($(#[$field_meta:meta])* $field:ident: $type:ty,)* } $({ $($method:tt)* })?) => {
        $(#[$meta])*
        #[pyclass(frozen, eq, hash, module = "physinc")]
        pub struct $name {
            timestamp_ns: i64,
            track: Option<u32>,
            is_final: bool,
            pub fields: event::$name,
        }

        impl $name {
            fn whole(&self) -> Event {
                Event { timestamp_ns: self.timestamp_ns, track: self.track, is_final: self.is_final, kind: self.fields.clone().into() }
            }
        }

        impl PartialEq for $name {
            /// What is unknown, NaN or not, is the same.
            fn eq(&self, other: &Self) -> bool {
                matches!((tree(&self.whole()), tree(&other.whole())), (Ok(this), Ok(that)) if this == that)
            }
        }

        impl Hash for $name {
            fn hash<H: Hasher>(&self, state: &mut H) {
                (stringify!($name), self.timestamp_ns, self.track, self.is_final).hash(state);
            }
        }

        #[pymethods]
        impl $name {
            #[classattr]
            fn __match_args__(py: Python<'_>) -> PyResult<Py<PyTuple>> {
                Ok(PyTuple::new(py, [$(stringify!($field)),*])?.unbind())
            }
            /// The event's name.
            #[getter]
            fn event<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.to_dict(py)?.get_item("event") }
            /// Stamp of the newest input that it used, ns on the stream's clock.
            #[getter]
            pub fn timestamp_ns(&self) -> i64 { self.timestamp_ns }
            /// The track, from 1; `None` where none or all.
            #[getter]
            pub fn track(&self) -> Option<u32> { self.track }
            /// Nothing will replace it.
            #[getter]
            fn r#final(&self) -> bool { self.is_final }
            $($(#[$field_meta])*
            #[getter]
            fn $field<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { self.fields.$field.to_python(py) })*

            /// As plain Python values, the same as in JSON.
            fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> { plain(py, &self.whole()) }

            /// As one line of JSON.
            fn to_json(&self) -> PyResult<String> { Ok(tree(&self.whole())?.to_string()) }

            fn __repr__(&self, py: Python<'_>) -> PyResult<String> { repr(stringify!($name), &self.to_dict(py)?) }

            fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Reduced<'py, (String,)>> {
                reduced(py, "event_from_toml", (toml(&self.whole())?,))
            }
            $($($method)*)?
        }
    };
}

/// Declares the event classes, and the way from `Event` to them.
macro_rules! event_classes {
    ($($(#[$meta:meta])* $name:ident { $($fields:tt)* })*) => {
        $(class_of! { $(#[$meta])* $name { $($fields)* } })*

        /// The Python object of an event.
        pub fn to_python(py: Python<'_>, event: Event) -> PyResult<Py<PyAny>> {
            let Event { timestamp_ns, track, is_final, kind } = event;
            match kind {
                $(Kind::$name(fields) => Py::new(py, $name { timestamp_ns, track, is_final, fields })?.into_py_any(py),)*
            }
        }
    };
}

/// The class of an event: a position alone can be made in Python.
macro_rules! class_of {
    ($(#[$meta:meta])* Position { $($fields:tt)* }) => {
        event_class! {
            $(#[$meta])*
            ///
            /// Made by a user it is input for a stream: `center` and `covariance` in the world frame, m and m². A center with NaN says that it
            /// wasn't seen at that instant.
            Position { $($fields)* } {
                #[new]
                #[pyo3(signature = (timestamp_ns, center, covariance=None, track=None))]
                fn new(
                    timestamp_ns: &Bound<'_, PyAny>,
                    center: &Bound<'_, PyAny>,
                    covariance: Option<&Bound<'_, PyAny>>,
                    track: Option<&Bound<'_, PyAny>>,
                ) -> PyResult<Self> {
                    let timestamp_ns = array::timestamp_ns(timestamp_ns)?;
                    let track = track.map(|track| array::integer(track, "track", "an integer from 0 to 2^32 - 1, or None")).transpose()?;
                    let center = vector(center, "center")?;
                    let covariance = covariance.map(|covariance| matrix(covariance, "covariance")).transpose()?;
                    if !center.iter().any(|x| x.is_nan()) {
                        crate::source::measurement(timestamp_ns, center, covariance, track, f64::NAN).map_err(PyValueError::new_err)?;
                    }
                    let covariance = covariance.map_or([[f64::NAN; 3]; 3], |covariance| rows(&covariance));
                    let fields =
                        event::Position { frame: 0, center: center.into(), center_in_camera: None, covariance, points: None, residual_rms: None };
                    Ok(Self { timestamp_ns, track, is_final: true, fields })
                }
            }
        }
    };
    ($($class:tt)*) => { event_class! { $($class)* } };
}
events!(event_classes);

/// The event that pickling wrote.
#[pyfunction]
pub fn event_from_toml(py: Python<'_>, text: &str) -> PyResult<Py<PyAny>> {
    to_python(py, from_toml(text)?)
}
