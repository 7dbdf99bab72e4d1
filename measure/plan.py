"""Cost of a frame as `drapery plan` expects it, beside the cost of simulated frames.

The numbers in core/src/simulation/estimate.rs are fitted to this output.
"""

import sys

from measure.page import Table
from measure.runs import LONG, SHORT, plan, run
from measure.scenes import TESTS, draped, hung, mannequin, sample, woman

# Parts of a frame and their stages, as `core/src/simulation/estimate.rs` has them.
PARTS = {
    "solves": ["B.1 velocity", "B.5 velocity"],
    "pairs": ["A neighbours", "B.2 self-repulsion", "B.8 self-repulsion"],
    "collisions": ["C collisions"],
    "bodies": ["bodies and pins", "B.4 body collision", "B.7 body friction"],
}
# A part below this share of a frame has no place in the order.
LEAST = 0.1


def order(parts):
    """Names of the larger parts, the longest first."""
    return [name for name in sorted(parts, key=parts.get, reverse=True) if parts[name] >= LEAST * sum(parts.values())]


def agree(one, other, parts):
    """Whether parts that both have come in the same order; parts within a quarter of each other may change places."""
    common = [name for name in one if name in other]
    in_other = [name for name in other if name in common]
    swapped = [(a, b) for k, a in enumerate(common) for b in common[k + 1:] if in_other.index(a) > in_other.index(b)]
    return all(parts[a] > 0.75 * parts[b] for a, b in swapped) and one[:1] == other[:1]


def compared(make, frames):
    def line(settings):
        expected, made = plan(make(), settings)["frame"]["estimate"], run(make(), frames, settings)
        count = len(made.frames)
        cost = {part: made.spent(*stages) / count for part, stages in PARTS.items()}
        factor = expected["seconds"] * count / made.simulated
        orders = order(expected["parts"]), order(cost)
        # What contact makes again has no bound: there is only a least, which others than the planned frames may stay below a little.
        kept = factor <= 1.25 if expected["is_least"] else 0.5 <= factor <= 2.0
        if not (kept and agree(*orders, cost)):
            print(f"not what the plan promises, or in another order: {settings[0]}, factor {factor:.2f}", file=sys.stderr)
        both = lambda name, found: f"{expected[name]:.0f} / {found / count:.0f}"
        listed = [", ".join(f"{part} {parts[part] / sum(parts.values()):.0%}" for part in names)
                  for parts, names in zip([expected["parts"], cost], orders)]
        least = "at least " if expected["is_least"] else ""
        word = settings[0].split('"')[1]
        return [f"`{word}`", count, both("steps", made.steps), both("solves", made.count("cg_solves")),
                both("iterations", made.count("cg_iterations")), both("collision_steps", made.count("collision_steps")),
                f"{least}{expected['seconds']:.3f} / {made.simulated / count:.3f}", f"{factor:.2f}", *listed]

    return lambda: [line(LONG), line(SHORT)]


TABLES = [Table("dev/measurements/speed.md", "plan", [
    "integrator", "frames", "steps", "solves", "iterations", "`collision_steps`", "CPU s a frame", "factor",
    "longest part first, expected", "simulated"], {
    name: (what, compared(make, frames)) for name, what, make, frames in [
        ("hung", "hung sheet, 5,000 triangles", lambda: hung(50), (0, 12)),
        ("draped", "draped sheet, 5,000 triangles", lambda: draped(50), (0, 24)),
        ("flag", "flag", lambda: sample("flag"), (0, 24)),
        ("twister", "twister, 16 cells", lambda: sample("twister", resolution=16), (0, 100)),
        ("ball", "spinning ball, 40 cells", lambda: sample("spinning_ball", resolution=40), (0, 80)),
        ("two_sheets", "two sheets at 10 m/s", lambda: TESTS / "two_sheets.toml", (0, 48)),
        ("woman_light", "woman, light garments", lambda: woman("light"), (0, 12)),
        ("woman_fine", "woman, fine garments", lambda: woman("fine"), (0, 2)),
        ("demo", "demo, 40 frames", mannequin, (1001, 1040)),
        ("curtain", "curtain and ball", lambda: sample("curtain_and_ball"), (0, 48)),
    ]})]
