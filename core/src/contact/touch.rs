//! Contact of a vertex as a number between 0 and 1, for caches: 1 where it is as close to another surface as contact keeps it, or
//! closer; 0 at twice that distance and beyond; linear in between.
//!
//! It follows from the positions alone, by distances whose greatest number counts: any number of ranks and threads, before and
//! after a stop, gives the same bits.

/// Contact at a distance from a surface that is to be `kept` [m]; both in metres, negative inside of a body.
pub(crate) fn contact_at(distance: f64, kept: f64) -> f64 {
    (2.0 - distance / kept).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contact_is_one_at_the_distance_that_is_kept_and_falls_to_zero_at_twice_that() {
        let at = |distance| contact_at(distance, 0.5);
        assert_eq!([-1.0, 0.0, 0.5, 0.75, 1.0, 9.0].map(at), [1.0, 1.0, 1.0, 0.5, 0.0, 0.0]);
    }
}
