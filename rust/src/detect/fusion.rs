//! Several views of one surface in one: each cell the mean of what they tell of it (Curless and Levoy 1996, along the rays of one view).

use super::cloud::Cloud;
use super::icp::{FACING, GRAZING, Moved, dot};
use super::noise::Noise;
use crate::geometry::motion::Motion;
use crate::math::Vec3;

/// What is this many standard deviations off is another surface.
const OFF: f32 = 3.0;
/// Views that a cell is the mean of at the most, a second of a Kinect's. It takes in no more: what stands still would drift with its own noise.
const REMEMBERED: f32 = 30.0;

impl Cloud {
    /// Takes in what `other` shows of the same surface, `other_from_self` away; its silhouette stays its own.
    pub fn fuse(&mut self, other: &Cloud, other_from_self: &Motion, noise: Noise) {
        let moved = Moved::new(other_from_self, &Vec3::zeros());
        for cell in self.cells_mut().filter(|cell| cell.is_seen() && cell.views < REMEMBERED) {
            let p = moved.of(&cell.point);
            if p[2] <= 0.0 || !cell.has_normal() {
                continue;
            }
            let place = other.project(&p);
            let Some(met) = other.at(place).filter(|met| met.has_normal()) else { continue };
            let Some(inverse) = other.inverse_depth(place) else { continue };
            if dot(&moved.turned(&cell.normal), &met.normal) < FACING {
                continue;
            }
            // How far the surfaces are apart across themselves, and along this one's ray.
            let (facing, along) = (dot(&met.normal, &p) / p[2], dot(&met.normal, &moved.turned(&cell.point)));
            let (apart, z) = (facing * (1.0 / inverse - p[2]), cell.point[2]);
            let axial = noise.axial(f64::from(z)) as f32 * facing.abs().max(GRAZING);
            let variance = axial * axial * (1.0 / cell.views + 1.0 / met.views);
            if apart * apart > OFF * OFF * variance || along.abs() < GRAZING * z {
                continue;
            }
            let gain = met.views / (cell.views + met.views);
            cell.point = cell.point.map(|x| x * (1.0 + gain * apart / along));
            cell.views = (cell.views + met.views).min(REMEMBERED);
        }
        self.take_surface();
    }
}
