//! Frame rates as fractions.

/// Frame rates with a numerator that is a multiple of this over [`NTSC`] are those of television.
const THOUSAND: f64 = 1000.0;

/// The denominator of the frame rates of television.
const NTSC: u32 = 1001;

/// A frame rate this close to a fraction is that fraction: files hold 23.976 for 24000/1001.
const SAME_RATE: f64 = 1e-5;

/// A frame rate as the fraction that is meant; `None` where it is none that films use.
pub(crate) fn fraction(fps: f64) -> Option<(u32, u32)> {
    let near = |denominator: u32, numerator: f64| {
        let is_near = (numerator / f64::from(denominator) - fps).abs() < SAME_RATE * fps;
        (is_near && (1.0..=f64::from(u32::MAX)).contains(&numerator)).then_some((numerator as u32, denominator))
    };
    let television = (fps * f64::from(NTSC) / THOUSAND).round() * THOUSAND;
    let found = near(1, fps.round()).or_else(|| near(NTSC, television));
    found.or_else(|| near(THOUSAND as u32, (fps * THOUSAND).round()))
}

/// The frame rate that is meant by one in a few digits.
pub(crate) fn film_rate(fps: f64) -> f64 {
    fraction(fps).map_or(fps, |(numerator, denominator)| f64::from(numerator) / f64::from(denominator))
}
