//! The only place with small numbers. Each says what it means, what it scales with, and which test breaks if it is wrong.

/// Distance outside a body's offset surface at which a vertex in contact is parked, as a fraction of the mean rest edge
/// length. It only has to exceed rounding: contact is tested against the same offset
/// (`docs/theory/friction.md#corrections`), so its size does not change how a vertex rests or slides. Guarded by
/// `a_block_sticks_on_an_incline_at_every_step_length`.
pub const CONTACT_GAP: f64 = 1e-5;

/// Rounding that bounds on rigid bodies allow for, as a fraction of the distances from the origin that they are computed
/// from: a hundred times what the few operations can lose. Guarded by
/// `bounds_on_a_rigid_body_hold_at_both_ends_of_a_step`.
pub(crate) const BOUND_ROUNDING: f64 = 1e-12;

/// Speed below which a tangential velocity has no direction worth keeping [m/s]. Guarded by the friction tests.
pub(crate) const NO_DIRECTION: f64 = 1e-300;

/// Shortest rest edge that is not degenerate, relative to the size of its garment. Guarded by the validation tests.
pub(crate) const DEGENERATE_EDGE: f64 = 1e-9;

/// Difference of the sum of barycentric weights from one that counts as rounding. Guarded by
/// `stitches_on_faces_that_cannot_be_are_refused`.
pub(crate) const WEIGHTS_ROUNDING: f64 = 1e-9;

/// Smallest rest area of a triangle relative to the square of its longest edge. Guarded by the validation tests.
pub const DEGENERATE_AREA: f64 = 1e-10;

/// Area of a triangle of a polygon, by the square of its longest edge, up to which its corners count as lying on a line: rounding to
/// single precision a hundred edges away from the origin leaves less. Guarded by
/// `a_polygon_with_corners_on_a_line_has_no_triangle_without_area_however_it_lies`.
pub(crate) const FLAT_CUT: f64 = 1e-5;

/// Displacement into their triangles of vertices in one place that nothing joins, as a share of the way to the
/// middles of the triangles. Rounding to single precision a hundred edges away from the origin is less; the eye sees
/// nothing of it. Guarded by
/// `borders_in_one_place_move_into_their_own_panels_by_a_share_of_their_edges_and_are_named`.
pub(crate) const SET_APART: f64 = 1e-4;

/// Fraction of the remaining time that a step may take when two steps remain before the end of an interval; a little over
/// a half, so that rounding leaves no sliver of a third step (`docs/theory/step.md#the-choice-of-dt`).
pub(crate) const LAST_TWO_STEPS: f64 = 0.51;

/// Share of one step's free fall at which the damping solve stops when the scene gives no tolerance
/// (`docs/theory/step.md#the-damping-solve`). Guarded by `a_swinging_sheet_converges_with_second_order`.
pub(crate) const CG_GRAVITY_FRACTION: f64 = 0.1;

/// Cosine between two contact normals below which the contacts face each other (a pinch) and above which they form a
/// crease that both can be satisfied in. Guarded by the pinch tests.
pub(crate) const FACING: f64 = -0.5;

/// Rate at which a pinched vertex takes the velocity of the surfaces around it [1/s]. Fast enough for its weight not to carry
/// it away (it creeps at g over this, 1 cm/s), slow enough for the springs of cloth, which act at 1e3 to 1e5 1/s, to keep it
/// whole. Guarded by `cloth_between_closing_boxes_is_let_go_and_comes_out_when_they_part`.
pub(crate) const PINCH_DRAG: f64 = 1e3;

/// Distance beside a surface of the place that tells whether another part of the body is there, as a share of the
/// size of the triangles around it. Guarded by
/// `cloth_pinched_by_a_body_that_crosses_itself_is_counted_and_comes_out_when_it_opens`.
pub(crate) const BESIDE_SURFACE: f64 = 1e-3;

/// Depth at which a part of a surface is deep inside another one and no fold, and distance that it moves through the other one between
/// two samples, as a share of the diagonal of the surface's box: 5 cm of a person. Guarded by `cloth_comes_free_of_a_hand_that_was_deep_in_a_torso`.
pub(crate) const DEEP_PART: f64 = 0.025;

/// Smallest eigenvalue of the correlation of the angles around a triangle that counts as it is: below, its six vertices lie near
/// a conic, and the angles hardly tell curvatures apart. A hundredth couples no two angles more than a hundred times as stiffly as
/// each is held alone. Guarded by `a_sheet_of_any_mesh_bends_with_the_rigidity_that_was_asked_for`.
#[cfg(feature = "effects")]
pub(crate) const CONIC_TRIANGLE: f64 = 0.01;

/// Height of a triangle over an edge, relative to the edge, below which the angle there is held more softly: by the square of the height
/// relative to this one; likewise the edge, relative to the height. Triangles of a usual mesh are ten times as high. Guarded by
/// `cloth_with_loops_that_nearly_coincide_falls_as_it_is`.
#[cfg(feature = "effects")]
pub(crate) const LOW_TRIANGLE: f64 = 0.05;

/// Share of its height at rest below which a triangle is too flat for the angle at its base to act. Guarded by
/// `a_squashed_triangle_is_left_out_and_counted`.
#[cfg(feature = "effects")]
pub(crate) const SQUASHED: f64 = 0.1;

/// Strain beyond a limit on strain that counts as keeping it: a hundredth of what cloth does not show. Guarded by
/// `a_chain_under_load_stops_at_its_limit`.
#[cfg(feature = "effects")]
pub(crate) const STRAIN_OVER_LIMIT: f64 = 1e-4;

/// Area of a deformed triangle, by the sum of the squares of its stretches, below which the side that it faces is not known
/// well enough to push along. The rounding of positions metres away from the origin by edges of a millimetre is a thousandth
/// of it. Guarded by `a_triangle_collapsed_to_a_line_or_a_point_has_finite_forces_along_what_is_left`.
#[cfg(feature = "effects")]
pub(crate) const FLAT_TRIANGLE: f64 = 1e-9;

/// Strain of an edge between two pinned vertices above which it counts as torn apart: twice what the most elastic woven cloth
/// gives, and more than skin stretches below a waistband. Guarded by
/// `pinned_neighbours_that_are_torn_apart_are_known_named_and_counted_by_any_ranks`.
pub const STRETCHED_BETWEEN_PINS: f64 = 0.3;

/// Strains of an edge at the start between which it is taken as meant: below, its ends are in one place up to rounding; above, it is
/// more than three times as long as at rest, where the most elastic fabrics break. Guarded by
/// `edges_that_start_collapsed_or_far_too_long_are_counted_and_named_by_any_ranks`.
pub(crate) const COLLAPSED_AT_START: f64 = -0.999;
/// The other of the two. Guarded by the same test,
/// `edges_that_start_collapsed_or_far_too_long_are_counted_and_named_by_any_ranks`.
pub(crate) const STRETCHED_AT_START: f64 = 2.0;

/// Strain above which cloth is longer than cloth can be: the most elastic knits give 0.9. Guarded by
/// `cloth_that_is_pulled_to_more_than_twice_its_length_is_named_and_counted_by_any_ranks`.
pub const OVERSTRETCHED: f64 = 1.0;

/// Distance from the nearest place of a body, in mean edges at the vertex and in thicknesses of garment and body together, above
/// both of which a pinned vertex is far from it: neighbours of a vertex at this distance find places apart from each other, and
/// clothes are modelled a few thicknesses off the skin. Guarded by `vertices_bound_far_from_a_body_are_named_by_any_ranks`.
pub const FAR_BOUND_EDGES: f64 = 3.0;
/// See [`FAR_BOUND_EDGES`].
pub const FAR_BOUND_THICKNESSES: f64 = 10.0;
/// Distance above which a pinned vertex is far from a body however coarse and thick the cloth is [m]: a loose sleeve is modelled some
/// centimetres off the arm, and no hem that a pin is to hold. Guarded by
/// `vertices_bound_far_from_a_body_are_named_however_long_their_edges_are`.
pub const FAR_BOUND: f64 = 0.05;

/// Fraction by which a step that is a whole part of a frame may be longer, so that rounding leaves no sliver of the
/// frame for one more step. Guarded by
/// `a_square_hung_by_two_corners_converges_with_second_order_from_four_steps_a_frame`.
pub(crate) const STEP_OF_A_FRAME: f64 = 1e-9;

/// Residual at which solves of the preset `preview` stop [m/s]: twice the largest that the solver chooses by itself, below what its
/// long steps are off. Guarded by `every_preset_is_what_the_solver_takes_and_each_is_finer_than_the_one_before`.
pub(crate) const PREVIEW_TOLERANCE: f64 = 2e-2;

/// The earth's acceleration [m/s²], with which automatic tolerances and first guesses compare; scenes have their own.
pub(crate) const STANDARD_GRAVITY: f64 = 9.81;

/// Fraction by which a thickness that short edges lower has to differ from the thickness that was asked for: edges of
/// one length differ by their rounding. Guarded by `short_edges_lower_the_thickness_to_their_share_as_any_ranks_say`.
pub(crate) const THICKNESS_ROUNDING: f64 = 1e-9;

/// Stiffness that coarse levels give a vertex in the directions in which it is constrained, over the trace of its block: what is left of
/// an aggregate there would be smaller than the rounding of its blocks, and might be negative. Guarded by
/// `coarse_levels_are_the_matrix_of_vertices_that_move_as_one_where_constraints_let_them`.
pub(crate) const CONSTRAINED_STIFFNESS: f64 = 1e-3;
