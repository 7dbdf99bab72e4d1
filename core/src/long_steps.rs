//! Tuned numbers of the implicit step, of its contact and of its solves. Each says what it means, what it scales with, and the test
//! that fails when it is wrong.

// Rounds of a stage.

/// Solves after which a stage ends, unless a pair is unsettled, a solve has not come to its tolerance or, in B.5, a mode is unsettled; each
/// has the contact modes that fit the reactions of the solve before. A mode that is wrong after the last one of B.1 is corrected in B.5.
/// Guarded by `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const MOST_ROUNDS: usize = 4;

/// Most solves of a stage in which the last one has left a pair unsettled or has not come to its tolerance, or, where positions are given,
/// has left a mode unsettled. A step with a stage of which a
/// part has not settled after all of them has gone wrong and is taken back. Guarded by `layers_with_one_step_a_frame_never_cross`.
pub(crate) const MOST_ROUNDS_OF_PAIRS: usize = 8;

/// Times `cg_max_iterations` that a solve may take which nothing corrects but a shorter step: the only one of a stage, or one beyond
/// [`MOST_ROUNDS`]. A push through fifty layers needs them (`docs/dev/decisions/0071-long-solves.md`).
pub(crate) const LATE_ITERATIONS: usize = 5;

/// Share of the reactions of bodies that may be beyond Coulomb's law at the end of the first stage, the second, and B.5. The later ones
/// correct what the earlier ones leave. Guarded by `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const SETTLED: [f64; 3] = [0.1, 0.05, 0.01];

/// Share of the reactions of bodies beyond Coulomb's law in the last round of B.5 above which the step is counted. Guarded by
/// `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const WRONG: f64 = 0.02;

/// Change of a pair's normal velocity in the last round of a stage, times the step and over the pair's thickness, above which the pair
/// is unsettled: its force is not known then. Its distance changes by α, 0.29, times as much. Guarded by `layers_with_one_step_a_frame_never_cross`.
pub(crate) const SETTLED_PAIR: f64 = 0.5;

/// Largest share of the vertices of a part that may belong to unsettled pairs at the end of a stage. A landing unsettles whole parts, and shorter
/// steps settle it. A pinch unsettles a few vertices at any length of the step. Guarded by
/// `layers_with_one_step_a_frame_never_cross` and `layers_of_a_rope_keep_a_distance_in_long_steps`.
pub(crate) const UNSETTLED_SHARE: f64 = 0.05;

/// Cap on the extrapolated displacement per stage, in mean edge lengths. After an impact the acceleration before is a bad prediction.
/// Guarded by `a_square_hung_by_two_corners_converges_with_second_order_from_four_steps_a_frame`.
pub(crate) const EXTRAPOLATED: f64 = 0.04;

/// Extrapolated change of a velocity that may be an error of the solves where layers touch, over the tolerance of solves. A wrong prediction
/// takes pairs that press lightly out of touch, and the first round throws what they hold. Guarded by
/// `layers_at_rest_take_the_steps_asked_for`.
pub(crate) const PREDICTION_NOISE: f64 = 10.0;

/// Change of velocities beyond which a solve may be rough, and the residual at contacts that is taken for an error of the first solve rather
/// than for a wrong mode, over the tolerance of solves. Guarded by `calm_cloth_is_never_tried_again`.
pub(crate) const ROUGH: f64 = 10.0;

/// Change of velocities below which a solve is the last of its stage, over the tolerance of solves. With 10 a stage may leave as much as
/// a step falls freely, and stacks bounce for ever. Guarded by `exactly_the_known_hard_cases_fail_in_long_steps`.
pub(crate) const CONVERGED: f64 = 3.0;

// Contact.

/// Pressure at which a pair that yields by all of its thickness would push if its spring were linear [Pa]. Guarded by
/// `a_pair_in_the_solves_keeps_its_distance_under_pressure`.
pub(crate) const PRESSURE: f64 = 1000.0;

/// Factors of the cube and of the fourth power of the overlap over the thickness in the force of a pair of cloth, of which the linear part has 1: waistbands,
/// which press with kilopascals, keep a distance too, and ropes of cloth, which press with tens of them. Guarded by
/// `a_pair_in_the_solves_keeps_its_distance_under_pressure` and `layers_of_a_rope_keep_a_distance_in_long_steps`.
pub(crate) const STIFFENING: [f64; 2] = [3.0, 50.0];

/// The same of a pair of cloth and a body. Where parts of a body pinch cloth nothing bounds what presses it, and pairs that push more steeply
/// settle less often. Guarded by `a_body_that_presses_cloth_meets_a_push_without_the_fourth_power`.
pub(crate) const STIFFENING_ON_BODIES: [f64; 2] = [3.0, 0.0];

/// Overlap over the thickness up to which the spring's stiffness grows from nothing. With all of it at the first touch, pairs of sheets
/// that slide on each other came and went from round to round. Guarded by `a_pair_in_the_solves_keeps_its_distance_under_pressure`.
pub(crate) const ONSET: f64 = 0.1;

/// Damping time of a pair, times the frequency of its linear spring and the reduced mass of its nodes: 2 is critical. Lighter touches have a
/// softer spring and less damping. Guarded by `a_pair_that_lands_on_its_onset_hardly_bounces`.
pub(crate) const PAIR_DAMPING: f64 = 2.5;

/// Distance over the thickness up to which pairs that approach each other are looked for: a damper acts before they touch. Guarded by
/// `a_pair_that_approaches_is_pushed_before_it_touches_and_one_that_has_passed_far_through_is_pulled_back`.
pub(crate) const LOOK_AHEAD: f64 = 2.0;

/// Overlap over the thickness about which the law of a pair is linearised at most when a guess first finds it in touch. What it bears is not
/// known then, and most pairs bear little. Guarded by `folded_silk_comes_to_rest_on_a_floor`.
pub(crate) const FIRST_TANGENT: f64 = 0.3;

/// Separation over the thickness up to which a pair that was pressed stays in the law of a guess. A prediction may part layers that press
/// lightly, and the first round, without their force and stiffness, throws what they hold. Guarded by
/// `layers_at_rest_take_the_steps_asked_for`.
pub(crate) const KEPT_APART: f64 = 0.1;

/// Part of an edge at either end in which the spring of a pair of edges becomes softer. Guarded by `folded_silk_comes_to_rest_on_a_floor`.
pub(crate) const EDGE_ENDS: f64 = 0.2;

/// Factor of the spring of a pair of edges at the end of one of them; at the ends of both it is the square. In a mesh of triangles six edges meet
/// in a vertex, and share what one pair would bear. Guarded by `folded_silk_comes_to_rest_on_a_floor`.
pub(crate) const SHARED_END: f64 = 1.0 / 6.0;

/// Sine of the angle between two edges below which their spring becomes softer, to nothing where they are parallel. Guarded by
/// `folded_silk_comes_to_rest_on_a_floor`.
pub(crate) const PARALLEL_EDGES: f64 = 0.2;

/// Distance over the thickness up to which pairs that have passed through each other within a stage are pulled back: as far as a step
/// takes them. Guarded by
/// `a_pair_that_approaches_is_pushed_before_it_touches_and_one_that_has_passed_far_through_is_pulled_back`.
pub(crate) const LOOK_BEHIND: f64 = 20.0;

/// Gap up to which a vertex rests on a body, as a share of the distance at which it is in contact. Guarded by
/// `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const RESTING_GAP: f64 = 0.02;

/// Distance that a resting vertex may go from its body in a step, as a share of the distance at which it is in contact. Guarded by
/// `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const LEAVING: f64 = 0.25;

/// Gap of a vertex that a body bears, over the mean edge of the cloth. A vertex that slides on a curved body goes along the tangent and is
/// off the body by s²/2R after a step, however thin the body is. Four times as much lets a stack of sheets bounce (hard case H28).
/// Guarded by `a_strap_holds_on_the_samples_cylinder_in_long_steps`.
pub(crate) const SLID_OFF: f64 = 0.005;

/// Most of that gap over the thickness that layers keep: with more, a body draws the second layer of a fold onto itself through the first.
/// Guarded by `folded_silk_comes_to_rest_on_a_floor`.
pub(crate) const SLID_OFF_LAYER: f64 = 0.25;

/// Farthest that collisions may move a vertex in a step, over the edges around it: the velocities of a step that ended farther off do
/// not go with its positions, and throw the cloth that lies on the vertex. Guarded by
/// `steps_far_too_long_are_tried_again_with_shorter_ones_and_counted`.
pub(crate) const LARGEST_CORRECTION: f64 = 0.1;

// Solves.

/// Largest share of an error that a solve of a round leaves. Guarded by
/// `a_newton_step_goes_as_far_as_its_forcing_says_and_small_corrections_to_their_end`.
pub(crate) const FORCING: f64 = 0.1;

/// Vertices of an aggregate, by a quarter less or half more. Half of it takes hardly fewer iterations, and half as much time
/// again for each. Guarded by `runs_cover_everything_and_have_about_the_size_asked_for`.
pub(crate) const AGGREGATE: usize = 8;

/// Nodes of an aggregate of a coarser level, likewise. Guarded by `iterations_hardly_grow_with_stiffness_and_mesh`.
pub(crate) const COARSER_AGGREGATE: usize = 4;

/// Largest number of nodes of a level that is solved directly, which takes as long as a product of 2000 vertices. Guarded by
/// `iterations_hardly_grow_with_stiffness_and_mesh`.
pub(crate) const DIRECT: usize = 24;

/// Factor of corrections of coarser levels. Aggregates that move as one are stiffer than the cloth: D. Braess, "Towards algebraic
/// multigrid for elliptic problems of second order", Computing 55, 1995, who takes 1.8. Smaller aggregates need less. Guarded by
/// `iterations_hardly_grow_with_stiffness_and_mesh`.
pub(crate) const OVERCORRECTION: f64 = 1.5;

/// Products in the search for the largest eigenvalue of a level. Guarded by `the_cycle_is_symmetric_and_positive_definite`.
pub(crate) const EIGENVALUE_PRODUCTS: usize = 8;

/// Weight of the smoother times the largest eigenvalue: the best for the upper two thirds of the spectrum. The estimate may be too low by
/// a third before 2, where smoothing would no longer be positive definite, is reached. Guarded by
/// `the_cycle_is_symmetric_and_positive_definite`.
pub(crate) const SMOOTHING: f64 = 4.0 / 3.0;
