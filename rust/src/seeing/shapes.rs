//! Foreground to things of any shape: which pieces are which thing, and where it is.

use super::image::Source;
use super::search::{AROUND, FEWEST_ROWS};
use super::{Area, Buffers, Scope, Seeing};
use crate::detect::cloud::Cloud;
use crate::detect::components::{Cluttered, Component, Run, connect, root};
use crate::detect::foreground::{Frame, Sample};
use crate::detect::shape::{Shape, Views};
use crate::detect::{Blob, Detection};
use crate::geometry::camera::Camera;
use crate::math::{Mat3, Vec3, sqrt};
use core::cell::Cell;
use core::ops::Range;
use heapless::Vec;

/// Things that are followed at once.
pub const SHAPES: usize = 4;
/// Views that are kept of them, and the one that is looked at.
pub const CLOUDS: usize = 2 * SHAPES + 1;
/// Pieces of foreground that are told apart: the largest.
const PIECES: usize = 16;
/// A thing seen in fewer points can't be measured.
const FEWEST_POINTS: u32 = 30;
/// Fewer than these are noise.
const FEWEST_PIXELS: u32 = 8;
/// Neighbours in the image that differ by more than this in depth, besides noise, are two things, m.
const JUMP: f64 = 0.1;
/// Pixels around a thing that don't become background.
const MARGIN: usize = 4;
/// Pieces that touch in the image, and whose middles are this many times their radii apart, or less, are one thing: its arm, its foot on the floor.
const BESIDE: f64 = 3.0;
/// Without stamps, frames are taken to come at a Kinect's rate, ns.
const FRAME_NS: i64 = 33_333_333;

/// What is remembered of the things that were seen.
#[derive(Clone, Debug, Default)]
pub(super) struct Shapes {
    slots: [Option<Shape>; SHAPES],
    last_id: u32,
    now_ns: i64,
    /// Where they were seen in this frame.
    kept: Vec<Area, PIECES>,
}

/// A piece of foreground.
struct Piece {
    root: usize,
    pixels: u32,
    area: Area,
    /// Its middle, camera frame, m.
    place: Vec3,
    /// Radius of the ball that would fill as many pixels, m.
    radius: f64,
    /// The slot of the thing that it belongs to,
    owner: Option<usize>,
    /// or the root of the largest piece beside it: together they are something new.
    leader: usize,
}

impl Piece {
    fn new(root: usize, component: &Component, camera: &Camera) -> Self {
        let (column, row, depth) = component.mean();
        let span = |[first, last]: [u16; 2]| usize::from(first)..usize::from(last) + 1;
        let area = Area { rows: span(component.rows), columns: span(component.columns) };
        let radius = sqrt(f64::from(component.pixels) / (core::f64::consts::PI * camera.fx * camera.fy)) * depth;
        let place = camera.deproject(column, row, depth);
        Self { root, pixels: component.pixels, area, place, radius, owner: None, leader: root }
    }
}

fn union(a: &Area, b: &Area) -> Area {
    let join = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
    Area { rows: join(&a.rows, &b.rows), columns: join(&a.columns, &b.columns) }
}

/// Whether areas overlap, or nearly.
fn touch(a: &Area, b: &Area) -> bool {
    let near = |a: &Range<usize>, b: &Range<usize>| a.start < b.end + MARGIN && b.start < a.end + MARGIN;
    near(&a.rows, &b.rows) && near(&a.columns, &b.columns)
}

/// Whether no samples are missing in the rows of `area` and those next to them.
fn is_intact(area: &Area, width: usize, missing: &[Range<usize>]) -> bool {
    let (first, end) = (area.rows.start.saturating_sub(1) * width, (area.rows.end + 1) * width);
    !missing.iter().any(|hole| hole.start < end && hole.end > first)
}

/// Something is there that can't be measured.
fn unmeasured(place: Vec3, radius: f64, pixels: u32, camera: &Camera, shape: Option<u32>, blob: Blob) -> Option<Detection> {
    let (_, row) = camera.project(&place)?;
    let covariance = Mat3::from_diagonal_element(radius * radius);
    Some(Detection { center: place, covariance, drift: Mat3::zeros(), radius, points: pixels, residual_rms: 0.0, row, blob, shape })
}

impl Shapes {
    /// Forgets what was not seen for long, and tells which piece belongs to what is remembered: to the thing it is nearest to, if it can be there.
    fn assign(&mut self, pieces: &mut [Piece]) {
        let now = self.now_ns;
        for slot in &mut self.slots {
            *slot = slot.filter(|shape| !shape.is_forgotten(now));
        }
        for piece in &mut *pieces {
            let distances = self.slots.iter().enumerate().filter_map(|(i, slot)| {
                let shape = slot.as_ref()?;
                Some((i, (piece.place - shape.middle_at(now)).norm() / shape.reach_at(now)))
            });
            piece.owner = distances.filter(|(_, part)| *part < 1.0).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i);
        }
        // The largest piece is where the thing is; others lie beside it.
        for (i, slot) in self.slots.iter().enumerate() {
            let Some(shape) = slot else { continue };
            let own = |piece: &&Piece| piece.owner == Some(i);
            let Some(main) = pieces.iter().filter(own).max_by_key(|piece| piece.pixels).map(|piece| piece.place) else { continue };
            for piece in pieces.iter_mut().filter(|piece| piece.owner == Some(i) && (piece.place - main).norm() > 1.5 * shape.radius) {
                piece.owner = None;
            }
        }
        pieces.sort_unstable_by_key(|piece| (core::cmp::Reverse(piece.pixels), piece.root));
        for i in 1..pieces.len() {
            let (larger, rest) = pieces.split_at_mut(i);
            let Some(piece) = rest.first_mut().filter(|piece| piece.owner.is_none()) else { continue };
            let beside = |other: &&Piece| {
                touch(&other.area, &piece.area) && (other.place - piece.place).norm() < BESIDE * (other.radius + piece.radius)
            };
            if let Some(other) = larger.iter().find(beside) {
                (piece.owner, piece.leader) = (other.owner, other.leader);
            }
        }
    }

    /// The columns of `row` in which things were seen.
    pub(super) fn kept_in(&self, row: usize) -> Vec<Range<usize>, 16> {
        let around = |range: &Range<usize>| range.start.saturating_sub(MARGIN)..range.end + MARGIN;
        self.kept.iter().filter(|area| around(&area.rows).contains(&row)).map(|area| around(&area.columns)).collect()
    }
}

/// Fills `cloud` with the pieces of roots `roots`, all in `area`.
fn gather<S: Sample>(cloud: &mut Cloud, frame: &Frame<'_, S>, runs: &mut [Run], count: usize, roots: &[usize]) {
    for i in 0..count {
        if !roots.contains(&root(runs, i)) {
            continue;
        }
        let Some((row, columns)) = runs.get(i).map(Run::pixels) else { return };
        let Some((samples, _)) = frame.row(row, columns.clone()) else { continue };
        cloud.add(row, columns.start, samples.iter().map(|sample| sample.depth(&frame.coding, frame.depths)));
    }
}

impl Seeing<'_> {
    /// Finds things of any shape in a whole frame.
    pub(super) fn see_shapes<S: Sample>(
        &mut self,
        source: &mut impl Source<S>,
        scope: &Scope<'_>,
        shapes: &mut Shapes,
        detections: &mut Vec<Detection, 16>,
    ) -> Result<(), Cluttered> {
        shapes.now_ns = scope.timestamp_ns.unwrap_or(shapes.now_ns + FRAME_NS);
        shapes.kept.clear();
        let (camera, noise, missing) = (self.camera, self.noise, scope.missing);
        let everywhere = Area { rows: 0..camera.height, columns: 0..camera.width };
        self.look_at(source, &everywhere, FEWEST_ROWS, AROUND);
        let Buffers { limits, marks, depths, runs, clouds, .. } = &mut self.buffers;
        let Some(marks) = marks.get(..camera.height) else { return Ok(()) };
        let frame = Frame {
            samples: source.samples(),
            width: camera.width,
            at_hand: everywhere,
            marks,
            asked_beyond: Cell::new(false),
            limits,
            depths,
            coding: self.coding,
            missing,
        };
        let count = connect(&frame, camera.width, 0, marks, JUMP, noise, runs)?;
        let mut pieces: Vec<Piece, PIECES> = Vec::new();
        for (index, component) in runs.iter().take(count).enumerate().filter_map(|(i, run)| Some((i, run.component(i)?))) {
            if component.pixels < FEWEST_PIXELS {
                continue;
            }
            if pieces.is_full()
                && let Some(smallest) = (0..pieces.len()).min_by_key(|i| pieces[*i].pixels).filter(|i| pieces[*i].pixels < component.pixels)
            {
                pieces.swap_remove(smallest);
            }
            let _ = pieces.push(Piece::new(index, component, &camera));
        }
        shapes.assign(&mut pieces);
        let Some((current, kept_views)) = clouds.split_first_mut() else { return Ok(()) };
        for (slot, views) in shapes.slots.iter_mut().zip(kept_views.chunks_exact_mut(2)).enumerate().map(|(i, (s, v))| ((i, s), v)) {
            let ((index, slot), [key, last]) = (slot, views) else { continue };
            let Some(shape) = slot else { continue };
            let own = || pieces.iter().filter(|piece| piece.owner == Some(index));
            let Some(area) = own().map(|piece| piece.area.clone()).reduce(|a, b| union(&a, &b)) else { continue };
            let (pixels, roots): (u32, Vec<usize, PIECES>) =
                (own().map(|piece| piece.pixels).sum(), own().map(|piece| piece.root).collect());
            let measured = if pixels >= FEWEST_POINTS {
                current.clear(&camera, &area);
                gather(current, &frame, runs, count, &roots);
                current.finish(is_intact(&area, camera.width, missing));
                let views = Views { key, last, current };
                shape.follow(shapes.now_ns, views, &camera, noise)
            } else {
                None
            };
            let _ = shapes.kept.push(area);
            if measured.is_none() && !shape.is_sure() {
                *slot = None;
                continue;
            }
            if !shape.is_sure() {
                continue;
            }
            let detection = measured.or_else(|| {
                let place = own().max_by_key(|piece| piece.pixels)?.place;
                unmeasured(place, shape.radius, pixels, &camera, Some(shape.id), Blob::Cut)
            });
            detections.extend(detection);
        }
        for piece in pieces.iter().filter(|piece| piece.owner.is_none() && piece.leader == piece.root) {
            let own = || pieces.iter().filter(|other| other.owner.is_none() && other.leader == piece.root);
            let pixels: u32 = own().map(|piece| piece.pixels).sum();
            if pixels < FEWEST_POINTS {
                continue;
            }
            let (area, roots): (Area, Vec<usize, PIECES>) =
                (own().fold(piece.area.clone(), |area, other| union(&area, &other.area)), own().map(|piece| piece.root).collect());
            current.clear(&camera, &area);
            gather(current, &frame, runs, count, &roots);
            current.finish(is_intact(&area, camera.width, missing));
            // What is cut off is begun when all of it is seen; until then it is there.
            let free = shapes.slots.iter_mut().zip(kept_views.chunks_exact_mut(2)).find(|(slot, _)| slot.is_none());
            if let Some((slot, views)) = free.filter(|_| current.is_whole())
                && let Some(shape) = Shape::begin(shapes.last_id + 1, shapes.now_ns, current, &camera, noise)
            {
                for view in views {
                    view.copy_from(current);
                }
                (*slot, shapes.last_id) = (Some(shape), shape.id);
                let _ = shapes.kept.push(area);
                continue;
            }
            let detection = unmeasured(piece.place, current.radius(), pixels, &camera, None, Blob::Cut);
            if detections.is_full() {
                break;
            }
            detections.extend(detection);
        }
        Ok(())
    }
}
