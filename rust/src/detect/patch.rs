//! The pixels around a ball, and the depth that its cap shows them.

#![allow(clippy::inline_always)] // So that loops are compiled for the registers of `widest`.

use super::window::{Grid, PATCH, Plane};
use crate::geometry::camera::Camera;
use crate::math::{Vec3, ceil, floor, sqrtf};

/// Pixels to look at: a rectangle of the image, thinned where it is large.
pub struct Patch {
    /// First column and row, px.
    pub left: usize,
    /// See `left`.
    pub top: usize,
    /// Only every so many columns and rows are read.
    pub stride: usize,
    /// Whether the image's edge cuts the ball.
    pub cut: bool,
    /// Its pixels.
    pub grid: Grid,
}

/// What a ball shows, pixel by pixel.
pub struct Surface<'s> {
    /// Depth less the center's: the mean over the matching window; NaN where it shows no ball. m.
    pub depth: &'s mut Plane,
    /// Squared distance of the ray from the center, m²; infinite where there is no pixel.
    pub offset_square: &'s mut Plane,
}

impl Patch {
    /// All pixels at most `margin` px outside of a ball with this center (camera frame, m) and radius (m); `None` where there are none.
    pub fn around(camera: &Camera, center: &Vec3, radius: f64, margin: f64, window: [usize; 2]) -> Option<Self> {
        let (column, row) = camera.project(center)?;
        // The disc of a ball off the axis is an ellipse, longer by 1/cos of the angle; squared, it is on the safe side.
        let reach = radius * center.norm_squared() / (center.z * center.z * center.z);
        let span = |middle: f64, half: f64, size: usize| {
            let (low, high) = (floor(middle - half - margin), ceil(middle + half + margin) + 1.0);
            let range = low.clamp(0.0, size as f64) as usize..high.clamp(0.0, size as f64) as usize;
            (range, middle - half < 0.0 || middle + half > size as f64 - 1.0)
        };
        let (columns, cut_x) = span(column, reach * camera.fx, camera.width);
        let (rows, cut_y) = span(row, reach * camera.fy, camera.height);
        if columns.is_empty() || rows.is_empty() {
            return None;
        }
        let stride = columns.len().max(rows.len()).div_ceil(PATCH);
        // Odd, or else its mean would lie beside its middle.
        let window = window.map(|edge| (edge / stride) | 1);
        let grid = Grid::new(columns.len().div_ceil(stride), rows.len().div_ceil(stride), window);
        Some(Self { left: columns.start, top: rows.start, stride, cut: cut_x || cut_y, grid })
    }

    /// Column and row of a pixel of the patch, px.
    #[inline]
    pub fn pixel(&self, x: usize, y: usize) -> (usize, usize) {
        (self.left + x * self.stride, self.top + y * self.stride)
    }

    /// Columns and rows of all its pixels, in the patch.
    pub fn places(&self) -> impl Iterator<Item = (usize, usize)> + use<> {
        let Grid { columns, rows, .. } = self.grid;
        (0..rows).flat_map(move |y| (0..columns).map(move |x| (x, y)))
    }

    /// Draws a ball of `radius` (m) around `center` (camera frame, m). `room` are planes to work in.
    #[inline(always)]
    pub fn draw(&self, camera: &Camera, center: &Vec3, radius: f64, surface: &mut Surface, room: [&mut Plane; 5]) {
        let [depth, count, between, depths, counts] = room;
        let Surface { depth: mean, offset_square } = surface;
        let grid = &self.grid;
        let pixels = grid.pixels();
        for (plane, outside) in [(&mut *depth, 0.0), (&mut *count, 0.0), (&mut **mean, f32::NAN), (&mut **offset_square, f32::INFINITY)] {
            grid.clear_ends(plane, outside);
        }
        // All relative to the center's ray, where single precision is plenty.
        let [xc, yc, zc] = [center.x / center.z, center.y / center.z, center.z].map(|x| x as f32);
        let step = self.stride as f64;
        let (across, down) = ((step / camera.fx) as f32, (step / camera.fy) as f32);
        let right = ((self.left as f64 - camera.cx) / camera.fx - center.x / center.z) as f32;
        let below = ((self.top as f64 - camera.cy) / camera.fy - center.y / center.z) as f32;
        let radius_square = (radius * radius) as f32;
        let columns = grid.columns as f32;
        let [offsets, depths_, counts_] =
            [&mut **offset_square, &mut *depth, &mut *count].map(|plane| plane.get_mut(pixels.clone()).unwrap_or_default());
        let rows = (offsets.chunks_exact_mut(grid.width()))
            .zip(depths_.chunks_exact_mut(grid.width()))
            .zip(counts_.chunks_exact_mut(grid.width()));
        for (y, ((offsets, depths), counts)) in rows.enumerate() {
            let dy = below + y as f32 * down;
            for (x, ((offset_square, depth), count)) in offsets.iter_mut().zip(depths).zip(counts).enumerate() {
                let x = x as i32 as f32;
                let dx = right + x * across;
                let (ray_x, ray_y, turn) = (xc + dx, yc + dy, xc * dy - yc * dx);
                let scale = 1.0 / (1.0 + ray_x * ray_x + ray_y * ray_y);
                let square = if x < columns { zc * zc * (dx * dx + dy * dy + turn * turn) * scale } else { f32::INFINITY };
                let inside = radius_square - square;
                let shown = -zc * (ray_x * dx + ray_y * dy) * scale - sqrtf(inside * scale);
                *offset_square = square;
                *depth = if inside > 0.0 { shown } else { 0.0 };
                *count = if inside > 0.0 { 1.0 } else { 0.0 };
            }
        }
        grid.gather(depth, between, depths);
        grid.gather(count, between, counts);
        let windows = pixels.start - grid.to_middle()..pixels.end - grid.to_middle();
        let [depths, counts] = [depths, counts].map(|plane| plane.get(windows.clone()).unwrap_or_default());
        let [mean, offsets] = [&mut **mean, &mut **offset_square].map(|plane| plane.get_mut(pixels.clone()).unwrap_or_default());
        for (((mean, depth), count), offset_square) in mean.iter_mut().zip(depths).zip(counts).zip(offsets) {
            *mean = if *count > 0.5 && *offset_square < f32::INFINITY { depth / count } else { f32::NAN };
        }
    }
}
