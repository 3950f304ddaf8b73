//! Connected components of the foreground, over runs of pixels in a row: neighbours belong together when their depths may be one ball's.

use super::foreground::{Coding, Frame, Sample};
use super::noise::Noise;
use crate::simd::widest;
use core::ops::Range;

/// Pixels looked at together where most show nothing.
pub const CHUNK: usize = 32;

/// Of a row: whether its samples are at hand, and which of its chunks show foreground.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    /// Whether its samples are.
    pub at_hand: bool,
    /// A bit each.
    chunks: u64,
}

impl Marks {
    /// Looks at `columns` of a row of `width`, for [`crate::simd::widest`]; `samples` and `limits` are those columns', which begin with a
    /// multiple of [`CHUNK`].
    #[inline(always)]
    #[allow(clippy::inline_always)] // So that it is compiled for its caller's registers.
    pub fn of<S: Sample>(samples: &[S], limits: &[u16], first_column: usize, width: usize, coding: &Coding) -> Self {
        let (chunks, rest) = samples.as_chunks::<CHUNK>();
        let (limit_chunks, limit_rest) = limits.as_chunks::<CHUNK>();
        let (shift, first) = (Self::shift(width.div_ceil(CHUNK)), first_column / CHUNK);
        let whole = chunks.iter().zip(limit_chunks).enumerate();
        let marks =
            whole.fold(0, |marks, (i, (samples, limits))| marks | u64::from(any_below(samples, limits, coding)) << ((first + i) >> shift));
        let marks = marks | u64::from(any_below(rest, limit_rest, coding)) << ((first + chunks.len()) >> shift).min(63);
        Self { at_hand: true, chunks: marks }
    }

    /// Whether the row shows no foreground.
    pub fn is_empty(self) -> bool {
        self.chunks == 0
    }

    /// Log2 of the chunks to a bit, in a row of so many.
    fn shift(chunks: usize) -> u32 {
        chunks.div_ceil(64).next_power_of_two().trailing_zeros()
    }

    /// The columns of marked chunks, of `width`, from left to right.
    fn chunks(self, width: usize) -> impl Iterator<Item = Range<usize>> {
        let shift = Self::shift(width.div_ceil(CHUNK));
        let mut left = self.chunks;
        let marked = core::iter::from_fn(move || {
            let bit = left.trailing_zeros() as usize;
            left &= left.checked_sub(1)?;
            Some(bit)
        });
        let chunks = marked.flat_map(move |bit| bit << shift..(bit + 1) << shift);
        chunks.map(move |chunk| chunk * CHUNK..((chunk + 1) * CHUNK).min(width)).filter(|chunk| !chunk.is_empty())
    }
}

/// Foreground pixels side by side in one row, without a jump in depth; the first run of a component also carries its sums.
#[derive(Clone, Copy, Debug, Default)]
pub struct Run {
    row: u16,
    start: u16,
    end: u16,
    parent: u32,
    component: Component,
}

/// A component: how many pixels, where, how deep.
#[derive(Clone, Copy, Debug, Default)]
pub struct Component {
    /// Pixels.
    pub pixels: u32,
    /// First and last row.
    pub rows: [u16; 2],
    /// First and last column.
    pub columns: [u16; 2],
    column_sum: f32,
    row_sum: f32,
    depth_sum: f32,
}

impl Component {
    /// Mean column and row, px, and mean depth, m.
    pub fn mean(&self) -> (f64, f64, f64) {
        let n = f64::from(self.pixels.max(1));
        (f64::from(self.column_sum) / n, f64::from(self.row_sum) / n, f64::from(self.depth_sum) / n)
    }

    fn join(&mut self, other: &Self) {
        self.pixels += other.pixels;
        self.rows = [self.rows[0].min(other.rows[0]), self.rows[1].max(other.rows[1])];
        self.columns = [self.columns[0].min(other.columns[0]), self.columns[1].max(other.columns[1])];
        self.column_sum += other.column_sum;
        self.row_sum += other.row_sum;
        self.depth_sum += other.depth_sum;
    }
}

/// There were more runs than the buffer holds: nothing in such a frame can be told apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cluttered;

/// Whether any sample is foreground. Without an early exit: a fixed loop over a chunk becomes a few wide instructions.
#[inline(always)]
#[allow(clippy::inline_always)]
fn any_below<S: Sample>(samples: &[S], limits: &[u16], coding: &Coding) -> bool {
    samples.iter().zip(limits).fold(0, |below, (sample, limit)| below | limit.saturating_sub(sample.key(coding))) != 0
}

/// Finds the runs in those rows of an image of `width` columns that begin with row `first` and have these `marks`, and joins them; what differs
/// by less than `jump` (m) plus the noise is one. Returns how many runs there are, in the order of their rows.
///
/// # Errors
/// [`Cluttered`] where `runs` are too few.
pub fn connect<S: Sample>(
    frame: &Frame<'_, S>,
    width: usize,
    first_row: usize,
    marks: &[Marks],
    jump: f64,
    noise: Noise,
    runs: &mut [Run],
) -> Result<usize, Cluttered> {
    let one = |a: f64, b: f64| {
        let difference = (a - b).abs();
        difference < jump || difference < jump + 4.0 * noise.axial(a.min(b))
    };
    let joined = |column, row: usize| {
        let depths = (frame.foreground(column, row), frame.foreground(column, row - 1));
        matches!(depths, (Some(a), Some(b)) if one(a, b))
    };
    let (mut above, mut count) = (0..0, 0);
    for (row, marks) in (first_row..).zip(marks) {
        let first = count;
        if marks.is_empty() {
            above = first..first;
            continue;
        }
        let mut open: Option<(Run, f64)> = None;
        let mut close = |run: Run| {
            *runs.get_mut(count).ok_or(Cluttered)? = Run { parent: count as u32, ..run };
            count += 1;
            Ok(())
        };
        for chunk in marks.chunks(width) {
            let Some((samples, limits)) = frame.row(row, chunk.clone()) else { continue };
            let mut left = widest(
                #[inline(always)]
                || shown(samples, limits, &frame.coding),
            );
            while left != 0 {
                let bit = left.trailing_zeros() as usize;
                left &= left - 1;
                let column = chunk.start + bit;
                let Some(z) = samples.get(bit).map(|sample| sample.depth(&frame.coding, frame.depths)).filter(|z| *z > 0.0) else {
                    continue;
                };
                match &mut open {
                    Some((run, last)) if usize::from(run.end) == column && one(z, *last) => {
                        run.push(column, row, z);
                        *last = z;
                    }
                    _ => {
                        if let Some((run, _)) = open.replace((Run::new(column, row, z), z)) {
                            close(run)?;
                        }
                    }
                }
            }
        }
        if let Some((run, _)) = open {
            close(run)?;
        }
        join_rows(runs, above, first..count, |column| joined(column, row));
        above = first..count;
    }
    Ok(count)
}

/// Which of up to 32 pixels are foreground, a bit each.
#[inline(always)]
#[allow(clippy::inline_always)]
fn shown<S: Sample>(samples: &[S], limits: &[u16], coding: &Coding) -> u32 {
    let below = samples.iter().zip(limits).map(|(sample, limit)| sample.key(coding) < *limit);
    (0_u32..32).zip(below).fold(0, |shown, (i, below)| shown | u32::from(below) << i)
}

/// Joins each run of a row with those above it that it touches.
fn join_rows(runs: &mut [Run], above: Range<usize>, below: Range<usize>, joined: impl Fn(usize) -> bool) {
    let (mut a, mut b) = (above.start, below.start);
    while a < above.end && b < below.end {
        let Some((&upper, &lower)) = runs.get(a).zip(runs.get(b)) else { return };
        if (upper.start.max(lower.start)..upper.end.min(lower.end)).any(|column| joined(usize::from(column))) {
            unite(runs, a, b);
        }
        // What ends first touches nothing further to the right.
        if upper.end < lower.end { a += 1 } else { b += 1 }
    }
}

/// The first run of the component that run `i` belongs to; halves the path to it on the way.
pub fn root(runs: &mut [Run], mut i: usize) -> usize {
    loop {
        let parent = runs.get(i).map_or(i, |run| run.parent as usize);
        let Some(grandparent) = runs.get(parent).map(|run| run.parent).filter(|_| parent != i) else { return i };
        if let Some(run) = runs.get_mut(i) {
            run.parent = grandparent;
        }
        i = grandparent as usize;
    }
}

fn unite(runs: &mut [Run], a: usize, b: usize) {
    let (a, b) = (root(runs, a), root(runs, b));
    let (first, second) = (a.min(b), a.max(b));
    if first == second {
        return;
    }
    if let Ok([first_run, second_run]) = runs.get_disjoint_mut([first, second]) {
        first_run.component.join(&second_run.component);
        second_run.parent = first as u32;
    }
}

impl Run {
    fn new(column: usize, row: usize, z: f64) -> Self {
        let (column, row) = (column as u16, row as u16);
        let component = Component {
            pixels: 1,
            rows: [row; 2],
            columns: [column; 2],
            column_sum: f32::from(column),
            row_sum: f32::from(row),
            depth_sum: z as f32,
        };
        Self { row, start: column, end: column + 1, parent: 0, component }
    }

    fn push(&mut self, column: usize, row: usize, z: f64) {
        self.end = column as u16 + 1;
        self.component.pixels += 1;
        self.component.columns[1] = column as u16;
        self.component.column_sum += column as f32;
        self.component.row_sum += row as f32;
        self.component.depth_sum += z as f32;
    }

    /// Its component, where it is the first run of one.
    pub fn component(&self, index: usize) -> Option<&Component> {
        (self.parent as usize == index).then_some(&self.component)
    }

    /// Its row and its columns.
    pub fn pixels(&self) -> (usize, Range<usize>) {
        (self.row.into(), self.start.into()..self.end.into())
    }
}
