//! Planes from contacts, which are events or fits.

use super::event;
use super::functions::{direction, length};
use super::result::{ContactFit, PlaneFit};
use crate::math::Vec3;
use crate::scene::plane::{Patch, Up};
use crate::scene::surfaces::{PATCHES, Surfaces};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use std::boxed::Box;
use std::format;
use std::vec::Vec;

/// The planes that contacts lie on.
#[pyfunction]
pub fn fit_planes(contacts: &Bound<'_, PyAny>, radius: Option<f64>, gravity: &Bound<'_, PyAny>, spin_sd: f64) -> PyResult<Vec<PlaneFit>> {
    let radius = length(radius, "radius")?;
    let up = Up { direction: -direction(gravity, "gravity")?, variance: 0.0 };
    if !(0.0..=1e4).contains(&spin_sd) {
        return Err(PyValueError::new_err(format!("spin_sd = {spin_sd}: expected 0 to 10000 rad/s")));
    }
    let (mut patches, mut indices) = (Vec::new(), Vec::new());
    let shown = super::array::shown(contacts);
    let wrong = |_| PyTypeError::new_err(format!("contacts must be an iterable of Contact or ContactFit, got {shown}"));
    for (index, item) in contacts.try_iter().map_err(wrong)?.enumerate() {
        let (patch, complete) = patch(&item?, index, radius, spin_sd)?;
        if !complete {
            return Err(PyValueError::new_err(format!("contact {index} has no covariance, so nobody knows how near its plane is")));
        }
        if let Some(patch) = patch {
            patches.push(patch);
            indices.push(index);
        }
    }
    if patches.len() > PATCHES {
        return Err(PyValueError::new_err(format!("at most {PATCHES} contacts at a time, got {}", patches.len())));
    }
    let mut surfaces = Box::new(Surfaces::new(&crate::config::EnvironmentConfig::default(), false));
    for patch in patches {
        surfaces.add(patch, &up);
    }
    let mut told = Vec::new();
    surfaces.tell(&up, true, |surface, _| told.push(surface));
    told.retain(|surface| surface.merged_into.is_none());
    let place = |id: u32| told.iter().position(|surface| surface.id == id);
    let plane = |surface: &crate::event::Surface| PlaneFit {
        normal: surface.normal,
        offset: surface.offset,
        covariance: surface.covariance.unwrap_or([[f64::NAN; 4]; 4]),
        contacts: surfaces.members(surface.id).map(|i| indices[i]).collect(),
        restitution: surfaces.restitution(surface.id).unwrap_or(f64::NAN),
        tilt: surface.tilt.unwrap_or(f64::NAN),
        tilt_sd: surface.tilt_sd.unwrap_or(f64::NAN),
        outline: surface.outline.as_ref().map(|corners| corners.to_vec()).unwrap_or_default(),
        above: surface.above.as_ref().and_then(|a| Some(crate::event::Above { surface: place(a.surface)? as u32, ..*a })),
    };
    Ok(told.iter().map(plane).collect())
}

/// What a contact says of its plane (nothing, where it has no velocities or no impulse), and whether it has a covariance.
fn patch(item: &Bound<'_, PyAny>, index: usize, radius: Option<f64>, spin_sd: f64) -> PyResult<(Option<Patch>, bool)> {
    let radius_or = |own: Option<f64>| {
        radius
            .or(own)
            .ok_or_else(|| PyValueError::new_err(format!("contact {index} has no point: give the ball's radius, or 0 for a point")))
    };
    if let Ok(contact) = item.cast::<event::Contact>() {
        let contact = &contact.get().fields;
        let own = contact.point.map(|point| (Vec3::from(contact.center) - Vec3::from(point)).norm());
        let complete = contact.covariance.as_flattened().iter().all(|x| x.is_finite());
        Ok((Patch::told(contact, radius_or(own)?, spin_sd), complete))
    } else if let Ok(contact) = item.cast::<ContactFit>() {
        let contact = contact.get();
        Ok((Patch::new(&contact.contact, radius_or(contact.radius)?, spin_sd), contact.covariance.is_some()))
    } else {
        Err(PyTypeError::new_err(format!("contacts must be of Contact or ContactFit, number {index} is of {}", item.get_type())))
    }
}
