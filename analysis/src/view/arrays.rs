//! Arrays of numbers as the page reads them: three numbers of 32 bits (encoding, components, count), then the values, all little-endian.

/// Encodings, by their numbers in the page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Precision {
    /// 32-bit floating-point numbers.
    Full = 0,
    /// 16 bits between the smallest and the largest value of a component, which stand before the values.
    Short = 1,
}

/// Encoding of whole numbers of 32 bits.
const WHOLE: u32 = 2;

/// The short number that stands for "no value".
const NONE: u16 = u16::MAX;

fn header(encoding: u32, components: usize, count: usize) -> Vec<u8> {
    let words = [encoding, components as u32, count as u32];
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// Triangles: three vertices each.
pub(super) fn triangles(triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut bytes = header(WHOLE, 3, triangles.len());
    bytes.extend(triangles.as_flattened().iter().flat_map(|vertex| vertex.to_le_bytes()));
    bytes
}

/// Values of `C` components each; NaN stands for "no value".
pub(super) fn numbers<const C: usize>(values: &[[f32; C]], precision: Precision) -> Vec<u8> {
    let mut bytes = header(precision as u32, C, values.len());
    match precision {
        Precision::Full => bytes.extend(values.as_flattened().iter().flat_map(|value| value.to_le_bytes())),
        Precision::Short => {
            let ranges: [[f32; 2]; C] = std::array::from_fn(|component| range(values.iter().map(|v| v[component])));
            bytes.extend(ranges.as_flattened().iter().flat_map(|bound| bound.to_le_bytes()));
            let short = |value: &[f32; C]| -> [u16; C] { std::array::from_fn(|c| shortened(value[c], ranges[c])) };
            bytes.extend(values.iter().flat_map(|value| short(value).map(u16::to_le_bytes).into_iter().flatten()));
        }
    }
    bytes
}

/// Smallest and largest finite value; zero twice where there is none.
fn range(values: impl Iterator<Item = f32>) -> [f32; 2] {
    let finite = values.filter(|value| value.is_finite());
    let [low, high] =
        finite.fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)]);
    if low > high { [0.0, 0.0] } else { [low, high] }
}

fn shortened(value: f32, [low, high]: [f32; 2]) -> u16 {
    if !value.is_finite() {
        return NONE;
    }
    let steps = f64::from(NONE - 1);
    let share = if high > low { f64::from(value - low) / f64::from(high - low) } else { 0.0 };
    (share * steps).round() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The page's reader, in short: the values of an array.
    fn read(bytes: &[u8]) -> Vec<f32> {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let number = |at: usize| f32::from_bits(word(at));
        let (components, count) = (word(4) as usize, word(8) as usize);
        if word(0) == Precision::Full as u32 {
            return (0..components * count).map(|i| number(12 + 4 * i)).collect();
        }
        let start = 12 + 8 * components;
        let short = |i: usize| u16::from_le_bytes([bytes[start + 2 * i], bytes[start + 2 * i + 1]]);
        let value = |i: usize| {
            let [low, high] = [0, 4].map(|half| number(12 + 8 * (i % components) + half));
            if short(i) == NONE { f32::NAN } else { low + (high - low) * f32::from(short(i)) / 65534.0 }
        };
        (0..components * count).map(value).collect()
    }

    #[test]
    fn full_arrays_keep_every_bit_and_short_ones_a_65534th_of_their_range() {
        let points = [[0.1, -2.0, 1e-6], [1.5, 3.0, 7e-6], [0.7, 0.5, 3e-6]];
        assert_eq!(read(&numbers(&points, Precision::Full)), points.as_flattened());
        let short = numbers(&points, Precision::Short);
        assert_eq!(short.len(), 12 + 24 + 18);
        for (index, (read, written)) in read(&short).iter().zip(points.as_flattened()).enumerate() {
            let range = [1.4, 5.0, 6e-6][index % 3];
            assert!((read - written).abs() <= 0.51 * range / 65534.0 + 1e-7 * range, "{index}: {read} {written}");
        }
    }

    #[test]
    fn no_value_stays_no_value_and_constants_stay_what_they_are() {
        let read = read(&numbers(&[[f32::NAN], [0.25], [0.25]], Precision::Short));
        assert!(read[0].is_nan() && read[1..] == [0.25, 0.25], "{read:?}");
        assert_eq!(range([f32::NAN].into_iter()), [0.0, 0.0]);
    }

    #[test]
    fn triangles_are_whole_numbers_behind_their_header() {
        let bytes = triangles(&[[1, 2, 70_000]]);
        let words: Vec<u32> = bytes.chunks(4).map(|word| u32::from_le_bytes(word.try_into().unwrap())).collect();
        assert_eq!(words, [WHOLE, 3, 1, 1, 2, 70_000]);
    }
}
