//! Fewer columns than frames: how a long run fits into a chart.

use std::ops::Range;

use drapery_shot::run_record::reader::FrameRow;

/// Frames that share a column of a chart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Column {
    /// First frame.
    pub(super) first: i64,
    /// Last frame.
    pub(super) last: i64,
    /// Their rows.
    pub(super) rows: Range<usize>,
}

/// Puts rows into at most `most` columns; those of a chart hold the same number of frames, or one more.
pub(super) fn columns(rows: &[FrameRow], most: usize) -> Vec<Column> {
    let count = rows.len().min(most);
    let column = |index: usize| {
        let range = index * rows.len() / count..(index + 1) * rows.len() / count;
        Column { first: rows[range.start].frame, last: rows[range.end - 1].frame, rows: range }
    };
    (0..count).map(column).collect()
}

/// Mean over the frames of a column of what is there; `None` when there is nothing.
pub(super) fn mean(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0);
    for value in values.flatten() {
        sum += value;
        count += 1;
    }
    (count > 0).then(|| sum / f64::from(count))
}

/// Largest value of a column.
pub(super) fn largest(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    values.flatten().max_by(f64::total_cmp)
}

/// Smallest value of a column.
pub(super) fn smallest(values: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    values.flatten().min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(count: i64) -> Vec<FrameRow> {
        (0..count).map(|i| FrameRow { frame: 1001 + i, ..FrameRow::default() }).collect()
    }

    #[test]
    fn columns_hold_every_frame_once() {
        for (count, most) in [(1, 10), (10, 10), (11, 10), (2400, 240), (2399, 240)] {
            let rows = rows(count);
            let columns = columns(&rows, most);
            assert!(columns.len() <= most);
            assert_eq!((columns[0].rows.start, columns[columns.len() - 1].rows.end), (0, rows.len()));
            assert!(columns.windows(2).all(|pair| pair[0].rows.end == pair[1].rows.start));
            let sizes: Vec<usize> = columns.iter().map(|column| column.rows.len()).collect();
            assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 1, "{sizes:?}");
        }
        assert!(columns(&[], 10).is_empty());
    }

    #[test]
    fn what_is_absent_does_not_count() {
        let values = [Some(1.0), None, Some(4.0)];
        assert_eq!(mean(values.into_iter()), Some(2.5));
        assert_eq!((largest(values.into_iter()), smallest(values.into_iter())), (Some(4.0), Some(1.0)));
        assert_eq!(mean([None].into_iter()), None);
    }
}
