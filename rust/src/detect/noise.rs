//! How much a depth reading may be off.

/// Noise of a depth image: along the ray, across it, and over how many pixels it is shared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Columns and rows of the matching window, px, odd: readings whose windows overlap share noise in proportion. 1 × 1 where each is its own.
    pub window: [usize; 2],
}

impl Default for Noise {
    fn default() -> Self {
        Self { window: Self::KINECT }
    }
}

/// Parts of a reading's variance: what its neighbours share, and what it has to itself; 1 in all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shares {
    /// In proportion to how much their windows overlap.
    pub shared: f64,
    /// Of each pixel alone.
    pub own: f64,
}

impl Noise {
    /// The window of a Kinect v1: 9 × 9 or 9 × 7 (Konolige and Mihelich 2010).
    pub const KINECT: [usize; 2] = [9, 7];

    /// How much more the mean of a large disc scatters if the window is as large both ways as its longer edge.
    pub fn larger_window(self) -> f64 {
        self.window[0] as f64 / self.window[1] as f64
    }

    /// How far, m, a cap of `radius` (m) may be flattened otherwise than thought, at `scale` px a metre, for the same reason: the mean of
    /// (edge / 2)² / 6 over 2 · radius for either edge.
    pub fn flattening_sd(self, scale: f64, radius: f64) -> f64 {
        let [longer, shorter] = self.window.map(|edge| (edge * edge) as f64);
        (longer - shorter) / (24.0 * radius * scale * scale)
    }

    /// Standard deviation of a reading at depth `z`, m: Nguyen, Izadi, Lovell 2012, Eq. 6.
    #[inline]
    pub fn axial(self, z: f64) -> f64 {
        0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)
    }

    /// Depth at which [`Noise::axial`] is `sd`, m.
    pub fn reach(self, sd: f64) -> f64 {
        0.4 + crate::math::sqrt(((sd - 0.0012) / 0.0019).max(0.0))
    }

    /// Standard deviation of a silhouette's edge, px: the same, Eq. 5, of a surface that is met head-on.
    #[inline]
    pub fn lateral(self) -> f64 {
        0.8
    }

    /// How the variance at depth `z` is shared, where samples are rounded to steps of `step`, m. Rounding errs evenly, by step²/12, and by itself
    /// in each pixel; no window is trusted so far that a tenth of the variance would not be each pixel's own.
    pub fn shares(self, z: f64, step: f64) -> Shares {
        let axial = self.axial(z);
        let own = (step * step / (12.0 * axial * axial)).clamp(0.1, 1.0);
        Shares { shared: 1.0 - own, own }
    }
}

/// A factor on a modelled variance, learned from what is seen: the mean of squares over their modelled expectation. It starts at 1, as if that had
/// been seen some times, and forgets slowly.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factor {
    sum: f64,
    weight: f64,
}

impl Default for Factor {
    fn default() -> Self {
        Self { sum: 8.0, weight: 8.0 }
    }
}

impl Factor {
    /// What is known by now.
    pub fn value(self) -> f64 {
        self.sum / self.weight
    }

    /// Learns from one more; a wild one counts as if it were 10 times what is known.
    pub fn learn(&mut self, ratio: f64) {
        let ratio = ratio.clamp(0.0, 10.0 * self.value()).max(1e-3);
        let keep = if self.weight < 200.0 { 1.0 } else { 199.0 / 200.0 };
        self.sum = self.sum * keep + ratio;
        self.weight = self.weight * keep + 1.0;
    }
}

/// Factors on the variance of a ball's depth and of its silhouette.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Factors {
    /// Of the depth of its cap.
    pub cap: Factor,
    /// Of its silhouette.
    pub outline: Factor,
}
