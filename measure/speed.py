"""Today's build, with both integrators, beside an earlier commit that has short steps alone: CPU seconds a frame of whole shots."""

import math

from measure.page import Table
from measure.runs import LONG, SHORT, TODAY, against, alternating, plan, run
from measure.scenes import (HOWTO, TESTS, cape_at_rest, draped, fifty_sheets, hung, layers_on_a_ball, mannequin, poncho, sample, twisted,
                            woman)

PAGE = "dev/measurements/speed.md"
PREVIEW = ('solver.preset="preview"',)
AUTO = ('solver.integrator="auto"',)
# Cells a side by triangles: 2 n².
CELLS = {5_000: 50, 20_000: 100, 80_000: 200}


def seconds(value):
    return f"{value:.3f} s" if value < 1.0 else f"{value:.2f} s"


def yes(is_met):
    return "yes" if is_met else "**no**"


def shot(make, frames, bar, long=LONG, last=0):
    """A whole shot, or its `last` frames; the bar is seconds a frame of long steps, or below a share of short ones where it is "a third"."""

    def measure():
        earlier, short, made = against(make(), frames, [SHORT, long])
        costs = [seconds(each.a_frame(last)) if each else "" for each in (earlier, short, made)]
        most = short.a_frame(last) / 3.0 if bar == "a third" else bar
        factors = [f"{each.a_frame(last) / made.a_frame(last):.1f}" if each else "" for each in (earlier, short)]
        said = "a third of short steps" if bar == "a third" else seconds(bar)
        cells = [len(made.frames[-last:]), *costs, " / ".join(factors), said, yes(made.a_frame(last) <= most), seconds(made.worst(last))]
        return [*cells, f"{made.steps}, {made.retried()}", made.crossings(), f"{short.strain()} → {made.strain()}"]

    return measure


def growth(make, frames, most):
    """Returns the measurement of the exponent of a frame's cost in the triangles: slope of the line of least squares."""

    def measure():
        runs = [(math.log(n), against(make(cells), frames, [SHORT, LONG])) for n, cells in CELLS.items()]
        slopes = [slope([(x, math.log(made[k].a_frame())) for x, made in runs if made[k]]) for k in range(3)]
        return ["", *(f"N^{power:.2f}" for power in slopes), "", f"N^{most}", yes(slopes[2] <= most), "", "", "", ""]

    return measure


def slope(points):
    mean = [sum(point[k] for point in points) / len(points) for k in range(2)]
    return sum((x - mean[0]) * (y - mean[1]) for x, y in points) / sum((x - mean[0]) ** 2 for x, _ in points)


def together(**both):
    """Two of them against one, by the clock of the simulation."""

    def measure():
        kinds = [(TODAY, settings, more) for settings in (SHORT, LONG) for more in ({"threads": 1}, {"threads": 1, **both})]
        made = alternating(woman("fine"), (0, 96), kinds)
        short, long = (one.clock("simulate") / two.clock("simulate") for one, two in (made[:2], made[2:]))
        by_the_clock = " → ".join(seconds(each.clock("simulate") / len(each.frames)) for each in made[2:])
        return [len(made[3].frames), "", f"{short:.2f} times", f"{long:.2f} times", "", "1.8 times", yes(long >= 1.8), by_the_clock,
                f"{made[3].steps}, {made[3].retried()}", made[3].crossings(), ""]

    return measure


def sheets(name, make, bars):
    kind = "hung" if make is hung else "draped over a ball"
    what = f"square metre, {kind}, 1000 N/m, 10 µN·m"
    rows = {f"{name}_{n // 1000}k": (f"{what}, {n:,} triangles", shot(lambda n=n: make(CELLS[n]), (0, 48), bar))
            for n, bar in zip(CELLS, bars)}
    return {**rows, f"growth_{name}": (f"cost of a frame by triangles, {kind}", growth(make, (0, 48), 1.1))}


def price(make, frames, bar):
    """A whole shot of wound or squeezed cloth with the integrator that it takes by itself; the bar is a factor."""

    def measure():
        earlier, made = against(make(), frames, [()])
        factor = earlier.a_frame() / made.a_frame() if earlier else 0.0
        counts = [made.count(name) for name in ("zone_fallbacks", "pairs_pinched")]
        return [len(made.frames), seconds(earlier.a_frame()) if earlier else "", seconds(made.a_frame()), f"{factor:.1f}", bar, yes(factor >= bar),
                f"{made.steps}, {made.retried()}", *counts, made.crossings()]

    return measure


def stiffer(scene, factor):
    """Settings that make what resists stretching stiffer by a factor, from what the plan says that there is."""
    settings = []
    for effect in plan(scene)["effects"]:
        for name, setting in effect["settings"].items() if effect["effect"] in ("stretch", "shear", "membrane") else []:
            is_stiffness = name in ("stiffness", "spring_stiffness", "warp", "weft", "shear")
            if is_stiffness and isinstance(setting["value"], (int, float)):
                settings.append(f"garment.{effect['garment']}.{effect['effect']}.{name}={setting['value'] * factor!r}")
    return settings


def iterations(factor, bar):
    def measure():
        made = run(woman("fine"), (0, 12), [*LONG, *(stiffer(woman("fine"), factor) if factor != 1 else [])])
        mean = made.count("cg_iterations") / made.count("cg_solves")
        how = f"{len(made.frames)} frames, {made.count('cg_iterations'):,} iterations, {made.count('cg_solves'):,} solves"
        return [f"{mean:.1f}", f"at most {bar}", yes(mean <= bar), how]

    return measure


def chosen(make, frames):
    """Both integrators beside `integrator = "auto"`, and what it expects."""

    def measure():
        planned = plan(make(), AUTO)
        made = short, long, auto = [run(make(), frames, settings) for settings in (SHORT, LONG, AUTO)]
        expected = planned["expected_seconds"]["semi_implicit"] / planned["expected_seconds"]["tr_bdf2"]
        fastest = min(short.a_frame(), long.a_frame())
        counted = [f"{each.steps / len(each.frames):.0f}" for each in made]
        changes = sum("next_integrator" in frame for frame in auto.frames)
        return [len(short.frames), " / ".join(counted), *(seconds(each.a_frame()) for each in made), f"{expected:.2f}",
                f"{short.a_frame() / long.a_frame():.2f}", f"`{planned['integrator']}`", changes, f"{auto.a_frame() / fastest:.2f}",
                f"{long.retried()}"]

    return measure


TABLES = [
    Table(PAGE, "speed", ["frames", "earlier", "short steps", "long steps", "factors", "bar", "met", "slowest frame", "steps, retried",
                          "crossings", "largest strain"], {
        "woman_fine": ("dressed woman, fine garments (31,984 triangles)", shot(lambda: woman("fine"), (0, 96), 2.0)),
        "woman_light": ("dressed woman, light garments (3,892 triangles)", shot(lambda: woman("light"), (0, 96), 0.25)),
        "demo": ("`make demo`", shot(mannequin, (1001, 1097), 0.13)),
        "demo_preview": ("`make demo`, long steps with `solver.preset = \"preview\"`", shot(mannequin, (1001, 1097), 0.06, PREVIEW)),
        "demo_full": ("`make demo QUALITY=full`", shot(lambda: mannequin("full"), (1001, 1097), 2.0)),
        "poncho": ("poncho of 5,208 triangles on the walking mannequin", shot(poncho, (1001, 1041), 0.15)),
        "cape_at_rest": ("a cape at rest, the last 24 of 289 frames", shot(cape_at_rest, (1001, 1289), 0.01, last=24)),
        "twisted": ("square metre twisted by three turns, 5,000 triangles", shot(lambda: twisted(50), (0, 48), 0.4)),
        "layers": ("eight layers of silk that fall on a ball", shot(layers_on_a_ball, (0, 36), "a third")),
        "fifty_sheets": ("fifty sheets that drop (H28), 40,000 triangles", shot(fifty_sheets, (0, 72), "a third")),
        **sheets("hung", hung, (0.03, 0.13, 0.55)),
        **sheets("draped", draped, (0.06, 0.28, 1.2)),
        "two_threads": ("two threads against one, fine woman", together(threads=2)),
        "two_ranks": ("two ranks against one, fine woman", together(ranks=2)),
    }),
    Table(PAGE, "integrators", ["frames", "steps a frame, short / long / auto", "short steps", "long steps", "auto", "factor expected",
                                "factor", "taken first", "changes", "auto over the faster", "retried"], {
        **{name: (f"`{name}`", chosen(lambda name=name: sample(name), frames)) for name, frames in {
            "hanging_sheet": (1001, 1073), "flag": (0, 72), "drape_sphere": (1, 72), "bias_cut": (0, 72), "pillow": (0, 48),
            "cushion": (0, 48), "sewn_tube": (0, 48)}.items()},
        **{name: (f"how-to `{name}`", chosen(lambda name=name: HOWTO / f"{name}.toml", frames)) for name, frames in {
            "fabric": (0, 24), "motion_blur": (0, 24), "over_time": (0, 42), "painted_maps": (0, 48), "patch": (0, 72),
            "closures": (0, 72), "elastic": (0, 60)}.items()},
        **{name: (f"test `{name}`", chosen(lambda name=name: TESTS / f"{name}.toml", frames)) for name, frames in {
            "storm": (0, 72), "folded_stack": (0, 48)}.items()},
        "layers_of_silk": ("eight layers of silk that fall on a ball", chosen(layers_on_a_ball, (0, 36))),
        "dressed_mannequin": ("`make demo`", chosen(mannequin, (1001, 1040))),
        "dressed_woman": ("dressed woman, light garments", chosen(lambda: woman("light"), (0, 96))),
        "twisted_sheet": ("square metre twisted by three turns, 5,000 triangles", chosen(lambda: twisted(50), (0, 24))),
        "poncho_on_mannequin": ("poncho on the walking mannequin", chosen(poncho, (1001, 1041))),
    }),
    Table(PAGE, "prices", ["frames", "earlier", "today", "factor", "bar", "met", "steps, retried", "`zone_fallbacks`", "`pairs_pinched`",
                           "crossings"], {
        "twister": ("twister, 12,800 triangles, 15 s", price(lambda: sample("twister", resolution=80), (0, 900), 15)),
        "pressed_stack": ("twenty layers under a plate", price(lambda: sample("folded_stack", TESTS), (0, 180), 5)),
        "two_sheets": ("two sheets that strike each other, 46,000 triangles",
                       price(lambda: sample("two_sheets", TESTS).replace("resolution = 24 ", "resolution = 100 "), (0, 72), 5)),
        "ball_10k": ("spinning ball, 10,082 triangles", price(lambda: sample("spinning_ball", resolution=71), (0, 1200), 2)),
        "ball_45k": ("spinning ball, 45,000 triangles", price(lambda: sample("spinning_ball", resolution=150), (0, 1200), 2)),
    }),
    Table(PAGE, "solver", ["iterations", "bar", "met", "how"], {
        "iterations": ("CG iterations a solve, fine woman", iterations(1, 40)),
        "iterations_x10": ("the same, stiffness of stretch ten times larger", iterations(10, 60)),
    }),
]
