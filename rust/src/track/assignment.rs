//! The pairing of rows with columns whose gains add up to the most, exactly.

/// For each row its column, if any: each column has one row at the most, and no other pairing has a larger sum of gains. Pairs without a gain
/// (0, less, or not finite) are not made.
///
/// The Hungarian method by shortest augmenting paths with potentials (Jonker and Volgenant 1987), on the costs −gain and, for each
/// row, a column of cost 0 that leaves it alone: O(rows² (rows + columns)).
pub fn assign<const ROWS: usize, const COLUMNS: usize>(gains: &[[f64; COLUMNS]], paired: &mut [Option<usize>; ROWS]) {
    let rows = gains.len().min(ROWS);
    *paired = [None; ROWS];
    if each_its_best(gains, paired) {
        return;
    }
    *paired = [None; ROWS];
    // Column of each row, row of each column; rows alone are not in `row_of`, and their potentials are those of a column of cost 0.
    let mut row_of: [Option<usize>; COLUMNS] = [None; COLUMNS];
    let (mut row_price, mut column_price) = ([0.0; ROWS], [0.0; COLUMNS]);
    for start in 0..rows {
        // Shortest ways from `start` to each column, and to being alone: that ends with any row on the way let go.
        let (mut distance, mut before, mut done) = ([f64::INFINITY; COLUMNS], [start; COLUMNS], [false; COLUMNS]);
        let (mut row, mut way, mut entered) = (start, 0.0, None);
        let mut alone = (f64::INFINITY, start, None);
        let end = loop {
            let freed = way - row_price[row];
            if freed < alone.0 {
                alone = (freed, row, entered);
            }
            for (column, gain) in gains[row].iter().enumerate().filter(|(column, gain)| !done[*column] && **gain > 0.0 && gain.is_finite())
            {
                let length = way - gain - row_price[row] - column_price[column];
                if length < distance[column] {
                    (distance[column], before[column]) = (length, row);
                }
            }
            let open = (0..COLUMNS).filter(|column| !done[*column]);
            let nearest = open.min_by(|a, b| distance[*a].total_cmp(&distance[*b])).filter(|column| distance[*column] < alone.0);
            let Some(column) = nearest else { break None };
            (way, done[column], entered) = (distance[column], true, Some(column));
            match row_of[column] {
                Some(next) => row = next,
                None => break Some(column),
            }
        };
        let shortest = end.map_or(alone.0, |column| distance[column]);
        row_price[start] += shortest;
        for column in (0..COLUMNS).filter(|column| done[*column] && distance[*column] < shortest) {
            column_price[column] -= shortest - distance[column];
            if let Some(row) = row_of[column] {
                row_price[row] += shortest - distance[column];
            }
        }
        // Back along the way, each row takes the column that it came by.
        let mut column = end;
        if column.is_none() {
            paired[alone.1] = None;
            column = alone.2;
        }
        while let Some(at) = column {
            let row = before[at];
            column = paired[row].filter(|_| row != start);
            (row_of[at], paired[row]) = (Some(row), Some(at));
        }
    }
}

/// Pairs each row with the column of its largest gain; `false` where two rows have the same one. Otherwise no other pairing gains more.
fn each_its_best<const ROWS: usize, const COLUMNS: usize>(gains: &[[f64; COLUMNS]], paired: &mut [Option<usize>; ROWS]) -> bool {
    let mut taken = [false; COLUMNS];
    for (row, paired) in gains.iter().zip(paired) {
        let mut best = 0.0;
        for (column, gain) in row.iter().enumerate().filter(|(_, gain)| gain.is_finite()) {
            if *gain > best {
                (best, *paired) = (*gain, Some(column));
            }
        }
        if paired.is_some_and(|column| core::mem::replace(&mut taken[column], true)) {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// By trying all.
    fn best(gains: &[[f64; 5]], taken: u32) -> f64 {
        let Some((first, rest)) = gains.split_first() else { return 0.0 };
        let with = (0..5).filter(|column| taken >> column & 1 == 0 && first[*column] > 0.0);
        with.map(|column| first[column] + best(rest, taken | 1 << column)).fold(best(rest, taken), f64::max)
    }

    #[test]
    fn the_nearest_is_not_always_the_best() {
        let mut paired = [None; 2];
        assign(&[[9.0, 8.0], [8.0, 1.0]], &mut paired);
        assert_eq!(paired, [Some(1), Some(0)]);
        assign(&[[9.0, -1.0], [8.0, f64::NAN]], &mut paired);
        assert_eq!(paired, [Some(0), None]);
    }

    proptest! {
        #[test]
        fn no_other_pairing_gains_more(gains in prop::collection::vec(prop::array::uniform5(-3.0..9.0), 0..6)) {
            let mut paired = [None; 6];
            assign(&gains, &mut paired);
            let mut columns: Vec<usize> = paired.iter().flatten().copied().collect();
            columns.sort_unstable();
            prop_assert!(columns.windows(2).all(|w| w[0] != w[1]), "a column twice: {:?}", paired);
            let sum: f64 = gains.iter().zip(&paired).filter_map(|(row, column)| column.map(|c| row[c])).sum();
            prop_assert!((sum - best(&gains, 0)).abs() < 1e-9, "{} of {}: {:?}", sum, best(&gains, 0), paired);
        }
    }
}
