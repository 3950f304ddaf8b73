//! What really happens in a scene, written down for whoever judges an estimator.

use super::parameters::Parameters;
use super::path::{Path, Stage, Touch};
use super::rig::Rig;
use super::rigid::{Part, Rigid};
use super::sensor::Form;
use super::truth::{BallTruth, ContactTruth, FrameTruth, ObjectTruth, PartTruth, RollTruth, ShapeTruth, SurfaceTruth, Truth};
use crate::geometry::camera::Camera;
use crate::math::{Vec3, rows};
use crate::time::after;
use std::borrow::ToOwned;
use std::string::ToString;
use std::vec::Vec;

/// Who sees all of a scene.
pub(super) struct Witness<'a> {
    pub(super) camera: &'a Camera,
    pub(super) rig: &'a Rig,
    pub(super) stage: &'a Stage,
    pub(super) paths: &'a [Path],
    pub(super) things: &'a [Rigid],
    pub(super) start_ns: i64,
}

impl Witness<'_> {
    /// The frame that begins `t` s after the scene.
    pub(super) fn frame(&self, timestamp_ns: i64, t: f64) -> FrameTruth {
        let seen = self.paths.iter().enumerate().filter_map(|(ball, path)| {
            let time = self.row_time(t, |time| Some(path.at(time)?.0))?;
            let (center, velocity) = path.at(time)?;
            Some((ball, time, center, velocity, self.rig.at(time).to_camera(&center), path.ball.radius))
        });
        let seen: Vec<_> = seen.collect();
        let balls = seen.iter().map(|&(ball, time, center, velocity, c, radius)| {
            let others: Vec<(Vec3, f64)> = seen.iter().filter(|o| o.0 != ball && o.4.z < c.z).map(|o| (o.4, o.5)).collect();
            BallTruth {
                ball,
                time_ns: after(self.start_ns, time),
                center: center.into(),
                center_in_camera: c.into(),
                velocity: velocity.into(),
                acceleration: self.paths[ball].acceleration(time).unwrap_or_default().into(),
                active: false,
                in_view: in_view(self.camera, &c, radius, &others),
            }
        });
        FrameTruth {
            timestamp_ns,
            camera_displacement: self.rig.displacement(t).map(Into::into),
            balls: balls.filter(|b| b.in_view > 0.0).collect(),
            objects: (0..self.things.len()).filter_map(|object| self.object(object, t)).filter(|o| o.in_view > 0.0).collect(),
        }
    }

    /// When something is seen in the frame that begins at `t`: the row that shows it depends on when that is, and the other way round; three rounds
    /// settle it.
    fn row_time(&self, t: f64, center: impl Fn(f64) -> Option<Vec3>) -> Option<f64> {
        let camera = self.camera;
        (0..3).try_fold(t, |time, _| {
            let (_, row) = camera.project(&self.rig.at(time).to_camera(&center(time)?))?;
            Some(t + camera.readout * row.clamp(0.0, camera.height as f64 - 1.0) / (camera.height - 1) as f64)
        })
    }

    fn object(&self, object: usize, t: f64) -> Option<ObjectTruth> {
        let thing = &self.things[object];
        let time = self.row_time(t, |time| Some(thing.at(time)?.position))?;
        let state = thing.at(time)?;
        let center_in_camera = self.rig.at(time).to_camera(&state.position);
        Some(ObjectTruth {
            object,
            kind: thing.kind,
            time_ns: after(self.start_ns, time),
            center: state.position.into(),
            center_in_camera: center_in_camera.into(),
            rotation: rows(&state.rotation),
            velocity: state.velocity.into(),
            acceleration: state.acceleration.into(),
            active: state.active,
            in_view: in_view(self.camera, &center_in_camera, thing.reach(), &[]),
        })
    }

    /// All but the frames.
    pub(super) fn scene(&self, scene: &str, parameters: Parameters) -> Truth {
        let (pose, stage, paths) = (&self.rig.pose, self.stage, self.paths);
        let faces = stage.solids.iter().flat_map(|s| (0..s.faces()).map(|f| s.face(f)));
        let surfaces = faces.filter(|(name, ..)| *name != "box bottom").map(|(name, normal, offset)| SurfaceTruth {
            name: name.to_string(),
            normal: normal.into(),
            offset,
            normal_in_camera: (pose.rotation.transpose() * normal).into(),
            offset_in_camera: offset - normal.dot(&pose.translation),
        });
        let contact = |ball: usize, radius: f64, t: &Touch| ContactTruth {
            ball,
            time_ns: after(self.start_ns, t.time),
            center: t.center.into(),
            center_in_camera: self.rig.at(t.time).to_camera(&t.center).into(),
            point: (t.center - t.normal * radius).into(),
            normal: t.normal.into(),
            velocity_before: t.before.into(),
            velocity_after: t.after.into(),
            restitution: t.restitution,
            surface: t.face.map_or(stage.solids[t.solid].name, |f| stage.solids[t.solid].face(f).0).to_owned(),
            on_edge: t.face.is_none(),
        };
        let balls = || paths.iter().enumerate();
        let mut contacts: Vec<ContactTruth> =
            balls().flat_map(|(i, path)| path.touches.iter().map(move |t| contact(i, path.ball.radius, t))).collect();
        contacts.sort_by_key(|c| c.time_ns);
        let rolling = balls().filter_map(|(ball, path)| {
            path.rolling.map(|(t, solid)| RollTruth {
                ball,
                time_ns: after(self.start_ns, t),
                surface: stage.solids[solid].name.to_owned(),
            })
        });
        let shapes = self.things.iter().enumerate().map(|(object, thing)| ShapeTruth {
            object,
            kind: thing.kind,
            parts: thing.parts.iter().map(part).collect(),
        });
        Truth {
            scene: scene.to_owned(),
            parameters,
            world_from_camera: pose.to_rows(),
            gravity_in_camera: (pose.rotation.transpose() * stage.gravity).into(),
            surfaces: surfaces.collect(),
            contacts,
            rolling: rolling.collect(),
            shapes: shapes.collect(),
            frames: Vec::new(),
        }
    }
}

fn part(part: &Part) -> PartTruth {
    let center = part.center.into();
    match part.form {
        Form::Sphere { radius } => PartTruth::Sphere { center, radius },
        Form::Box { half } => PartTruth::Box { center, half: half.into(), rotation: rows(&part.axes) },
    }
}

/// Part of a ball's disc that is inside the image and behind none of the nearer balls `others`.
fn in_view(camera: &Camera, center: &Vec3, radius: f64, others: &[(Vec3, f64)]) -> f64 {
    const POINTS: u32 = 200;
    let Some((x, y)) = camera.project(center) else { return 0.0 };
    let disc = camera.fx * radius / center.z;
    // Vogel's spiral: even over the disc.
    let points = (0..POINTS).map(|i| {
        let (r, angle) = (disc * ((f64::from(i) + 0.5) / f64::from(POINTS)).sqrt(), f64::from(i) * 2.399_963_229_728_653);
        (x + r * angle.cos(), y + r * angle.sin())
    });
    let inside = |u: f64, v: f64| u > -0.5 && v > -0.5 && u < camera.width as f64 - 0.5 && v < camera.height as f64 - 0.5;
    let hidden = |u: f64, v: f64| {
        let ray = camera.deproject(u, v, 1.0).normalize();
        others.iter().any(|(c, r)| c.cross(&ray).norm() < *r)
    };
    points.filter(|&(u, v)| inside(u, v) && !hidden(u, v)).count() as f64 / f64::from(POINTS)
}
