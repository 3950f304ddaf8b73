//! The pixels around a ball, and the depth that its cap shows them.

use super::window::{Grid, PATCH};
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
    pub depth: &'s mut [f32],
    /// Squared distance of the ray from the center, m².
    pub offset_square: &'s mut [f32],
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

    /// Draws a ball of `radius` (m) around `center` (camera frame, m). `cells` is room to work in.
    pub fn draw(&self, camera: &Camera, center: &Vec3, radius: f64, cells: &mut [[f32; 2]], surface: &mut Surface) {
        cells.fill([0.0; 2]);
        // All relative to the center's ray, where single precision is plenty.
        let [xc, yc, zc] = [center.x / center.z, center.y / center.z, center.z].map(|x| x as f32);
        let step = self.stride as f64;
        let (across, down) = ((step / camera.fx) as f32, (step / camera.fy) as f32);
        let right = ((self.left as f64 - camera.cx) / camera.fx - center.x / center.z) as f32;
        let below = ((self.top as f64 - camera.cy) / camera.fy - center.y / center.z) as f32;
        let radius_square = (radius * radius) as f32;
        let width = self.grid.width();
        let rows = cells.chunks_exact_mut(width).zip(surface.offset_square.chunks_exact_mut(width)).take(self.grid.rows);
        for (y, (cells, offsets)) in rows.enumerate() {
            let dy = below + y as f32 * down;
            for (x, (cell, offset_square)) in cells.iter_mut().zip(offsets).take(self.grid.columns).enumerate() {
                let dx = right + x as f32 * across;
                let (ray_x, ray_y, turn) = (xc + dx, yc + dy, xc * dy - yc * dx);
                let scale = 1.0 / (1.0 + ray_x * ray_x + ray_y * ray_y);
                *offset_square = zc * zc * (dx * dx + dy * dy + turn * turn) * scale;
                let inside = radius_square - *offset_square;
                if inside > 0.0 {
                    *cell = [-zc * (ray_x * dx + ray_y * dy) * scale - sqrtf(inside * scale), 1.0];
                }
            }
        }
        self.grid.average(cells, surface.depth);
    }

    /// The depth that a pixel of the patch shows less that of `center`, and its derivatives by the center; `None` at the edge.
    #[inline]
    pub fn depth(&self, camera: &Camera, center: &Vec3, surface: &Surface, x: usize, y: usize) -> Option<(f32, [f32; 3])> {
        let (i, width) = (y * self.grid.width() + x, self.grid.width());
        let [left, above] = [i.checked_sub(1)?, i.checked_sub(width)?].map(|i| surface.depth.get(i));
        let [here, right, below] = [i, i + 1, i + width].map(|i| surface.depth.get(i));
        // Moving the ball moves the picture of its cap: by the center's derivatives, the depth changes as it does from pixel to pixel.
        let per_metre = 0.5 / (self.stride as f64 * center.z);
        let slope_x = (left? - right?) * (camera.fx * per_metre) as f32;
        let slope_y = (above? - below?) * (camera.fy * per_metre) as f32;
        let along = 1.0 - slope_x * (center.x / center.z) as f32 - slope_y * (center.y / center.z) as f32;
        let valid = along.is_finite() && x > 0 && x + 1 < self.grid.columns && y + 1 < self.grid.rows;
        valid.then_some((*here?, [slope_x, slope_y, along]))
    }
}
