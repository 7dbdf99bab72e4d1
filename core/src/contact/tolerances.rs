//! The small numbers of contact: each says what it means, what it scales with, and which test breaks if it is wrong.

/// Bound on the rounding of a corner's height along a unit vector, relative to the largest component: the analysis in
/// `ccd/motion.rs` needs 46 units of 2⁻⁵³, this is 64. Less finds collisions too late or never, more reports pairs that
/// only come close. Guarded by `generated_queries_have_no_false_negative_and_no_late_time`.
pub(crate) const CCD_ROUNDING: f64 = 32.0 * f64::EPSILON;

/// Largest number of proofs before a pair is reported at the time that is proven. A miss seldom needs more
/// than three, a collision some more; only pairs that turn or graze closely for long need more. Guarded by
/// `a_contact_is_at_the_gap`.
pub(crate) const CCD_ROUNDS: usize = 64;

/// Excess over the gap at which a pair that approaches is in contact, relative to the gap: a thousandth of a
/// micrometre at the gap of the solver. Smaller costs rounds. Guarded by `a_contact_is_at_the_gap`.
pub(crate) const CCD_CLOSE_ENOUGH: f64 = 1e-3;

/// Pairs that stay farther apart than this many gaps are no candidates of collisions: ten times the excess of [`CCD_CLOSE_ENOUGH`] covers that
/// and the rounding of positions. Guarded by `a_search_along_paths_holds_for_nodes_that_stop_anywhere_on_their_paths`.
pub(crate) const BEYOND_GAP: f64 = 1.0 + 10.0 * CCD_CLOSE_ENOUGH;

/// Smallest and largest size of a query \[m\] that is computed as it is: the sixth power of lengths must be an ordinary
/// `f64`. Others are scaled by these powers of two, 2⁻¹⁰⁰ and 2¹⁰⁰. Guarded by
/// `tiny_and_huge_queries_are_answered_like_ordinary_ones`.
pub(crate) const CCD_SMALLEST: f64 = 1.0 / CCD_LARGEST;

/// See [`CCD_SMALLEST`].
pub(crate) const CCD_LARGEST: f64 = (1u128 << 100) as f64;

/// Smallest square of a lever, relative to the largest inverse mass, through which an impulse is tried: at 1e-4, free nodes
/// that share a contact with prescribed ones would move ten thousand times faster than the contact. Guarded by
/// `an_impulse_is_not_tried_on_too_short_a_lever`.
pub(crate) const SHORTEST_LEVER_SQUARED: f64 = 1e-8;

/// Moments of inertia below this share of the largest have no axis to turn about: the nodes lie on a line, or in a point
/// (`docs/theory/self_contact.md#impact-zones`). Squared lengths, so a millionth in length. Guarded by
/// `a_collinear_zone_turns_across_its_line_only`.
pub(crate) const NO_INERTIA: f64 = 1e-12;

/// Error of the rotation of a rigid zone, relative to its angle: some tens of roundings. Guarded by
/// `a_rigid_zone_keeps_linear_and_angular_momentum`.
pub(crate) const ZONE_ROTATION: f64 = 1e-14;

/// Largest error of an impact zone's relative normal velocities, as a share of the largest one at its start. It is a
/// change of the gap, a millionth of a millimetre for a metre of approach. Guarded by
/// `an_inelastic_zone_is_the_solution_of_the_quadratic_program`.
pub(crate) const ZONE_RESIDUAL: f64 = 1e-9;

/// Cosine between the line of closest points of a pair and its normal below which the pair lies beside rather than in front of
/// each other, and has no side yet. Guarded by `a_pair_beside_each_other_has_no_side`.
pub(crate) const TRUSTED_SIDE: f64 = 0.5;

/// Share of its reach that a node may use up: the rest covers the gap of collisions, which is far smaller than an edge, and
/// rounding. Guarded by `a_list_of_neighbours_holds_all_that_brute_force_finds`.
pub(crate) const USABLE_SKIN: f64 = 0.98;

/// Sine of the angle between an edge and a triangle below which they have no clear way out of each other. Guarded by
/// `sheets_that_cross_at_the_start_run_never_cross_more_and_come_apart`.
pub(crate) const ALONG_TRIANGLE: f64 = 1e-3;

/// The gap that collisions keep, in roundings to single precision of the largest distance from the scene's origin. Rounding
/// moves a point by up to √3/2 of one, and two primitives approach by twice that. Guarded by `what_is_written_in_single_precision_does_not_cross`.
pub(crate) const GAP_ROUNDINGS: f64 = 4.0;

/// Pairs closer than this many gaps are opened to it when they meet. Guarded by
/// `a_pair_that_starts_too_close_is_opened_to_the_gap`.
pub(crate) const OPEN_GAP: f64 = 2.0;

/// Share of the gap by which prescribed nodes may miss the motion of the zone that follows them. Guarded by
/// `a_zone_follows_what_is_prescribed_until_that_parts`.
pub(crate) const CARRIED: f64 = 0.05;

/// Share of the spread of prescribed nodes, in squared lengths, up to which they lie on a plane, a line or a point. Guarded by
/// `a_zone_is_carried_as_what_is_prescribed_moves`.
pub(crate) const CARRIED_SPREAD: f64 = 1e-6;

/// A pair that starts closer than the gap may come this much closer, but not meet. Guarded by
/// `a_pair_that_starts_too_close_is_opened_to_the_gap`.
pub(crate) const CLOSER_THAN_GAP: f64 = 0.9;

/// Curvature of an impact zone's energy along a set of impulses, relative to the sum of those of its contacts one by
/// one, that may be rounding: impulses that cancel each other. Guarded by `contradicting_and_hopeless_contacts_are_reported`.
pub(crate) const ZONE_FLAT: f64 = 1e-14;

/// Speed above that with which a node stays on its body, relative to both, that may be rounding: thousands of roundings of the
/// impulses that it has got. Guarded by `a_node_on_a_body_passes_impulses_on_and_the_body_bears_them`.
pub(crate) const RESTING: f64 = 1e-12;

/// Speed below which friction of a pair in a solve grows with the slip instead of being that of Coulomb's law [m/s]: a millimetre a
/// second. Guarded by `friction_of_a_pair_is_that_of_coulomb_and_never_above_what_holds_it`.
pub(crate) const SLOW_SLIP: f64 = 1e-3;

/// Share of a distance at the collision-free state that rounding of it and of displacements since may be. Guarded by
/// `displacements_prove_only_what_is_so`.
pub(crate) const DISTANCE_ROUNDING: f64 = 1e-6;

/// Displacement of a state that was put back to where its list of pairs was made, as a share of edges: rounding. Guarded by
/// `layers_with_one_step_a_frame_never_cross`.
pub(crate) const REWOUND: f64 = 1e-12;
