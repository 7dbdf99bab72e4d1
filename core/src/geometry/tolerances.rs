//! The small numbers of geometry: each says what it means, what it scales with, and which test breaks if it is wrong.

/// Sine of a triangle's corner angle below which its plane is not trusted and only its edges are used. The rounding
/// error of the unit normal is about machine epsilon over this sine: here one part in a million. Guarded by
/// `a_triangle_without_area_is_its_edges`.
pub(crate) const SLIVER_SINE: f64 = 1e-10;

/// Squared sine of the angle between two segments below which they count as parallel (`distance`). Guarded by
/// `segments_are_as_close_as_the_best_sample`.
pub(crate) const PARALLEL_SINE_SQUARED: f64 = 1e-12;

/// Relative excess that covers the rounding of a squared box distance in `f32`: eight operations of 6e-8 each. Guarded by
/// `nearest_is_what_looking_at_every_primitive_finds`.
pub(crate) const BOX_DISTANCE: f64 = 1e-6;

/// Relative slack of the ray against box test, far above the `f64` rounding of its few operations. Guarded by
/// `the_ray_count_equals_the_sum_of_solid_angles`.
pub(crate) const RAY_SLAB: f64 = 1e-12;

/// Distance from the triangle accepted at a root of the volume, relative to the lengths that entered it, so that
/// neighbouring triangles leave no slit between them. A transversal root is placed to about a thousand times machine
/// epsilon. Guarded by `paths_through_the_edges_and_corners_of_a_fan_leave_no_slit`.
pub(crate) const SLIT: f64 = 1e-9;

/// Rounding error of the signed volume of a point and a triangle, relative to the product of its three lengths: the two
/// products and sums behind it. Guarded by `a_point_that_starts_on_the_surface_and_sinks_is_caught_at_once`.
pub(crate) const VOLUME: f64 = 16.0 * f64::EPSILON;

/// Distance from a surface, relative to the size of the coordinates, below which the direction from the surface to a
/// point is lost in rounding and the normal is used: it leaves four digits. Guarded by
/// `the_gradient_on_the_surface_is_its_normal`.
pub(crate) const DIRECTION: f64 = 1e4 * f64::EPSILON;

/// The tree of a surface is built anew when the motion has made it this much more expensive than it was when built.
/// Changes time only, never an answer: `a_refit_tree_answers_like_a_new_one_on_any_number_of_threads`.
pub(crate) const REBUILD_COST: f64 = 1.3;

/// Bound of the rounding when two points are projected on a direction, relative to the direction's sum of sizes and the
/// largest coordinate: a difference, a product and two sums of half an epsilon each, for both points, with room to spare.
/// Above it two sets of points are apart for certain. Guarded by
/// `the_answer_is_that_of_integer_arithmetic_in_any_order_of_the_vertices`.
pub(crate) const SEPARATION: f64 = 8.0 * f64::EPSILON;

/// Volume that a closed surface has to enclose the wrong way round, as a share of the cube over the root of its area, to be taken
/// as inside out: a hundredth of a ball's. Folded flat it is neither. Guarded by
/// `a_closed_surface_that_turns_inside_out_goes_on_with_its_sides_exchanged`.
pub(crate) const INSIDE_OUT: f64 = 1e-3;
