#!/usr/bin/env python3
"""Writes the diagrams of the pages of theory, docs/pictures/collision_step.svg, time_step.svg and
coulomb.svg: `make figures`. Needs Python alone."""

from pathlib import Path

PICTURES = Path(__file__).resolve().parent.parent.parent / "docs" / "pictures"
LINES = [("B.1", "velocity,", "half a step"), ("B.2", "repulsion", "with springs"), ("B.3", "positions", ""),
         ("B.4", "bodies:", "positions"), ("B.5", "velocity,", "at the middle"), ("B.6", "extrapolate", ""),
         ("B.7", "bodies:", "friction"), ("B.8", "repulsion", "no springs")]
BLUE, RED, GREY, GREEN = "#1c5fa8", "#b03030", "#777", "#2f8f4e"


def svg(width, height, title, parts):
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif" font-size="13">'
    return "\n".join([head, f"<title>{title}</title>", '<rect width="100%" height="100%" fill="#fff"/>', *parts, "</svg>", ""])


def text(x, y, words, colour="#000", anchor="middle", size=13):
    return f'<text x="{x}" y="{y}" fill="{colour}" text-anchor="{anchor}" font-size="{size}">{words}</text>'


def box(x, y, width, height, colour):
    return f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="4" fill="{colour}" fill-opacity="0.12" stroke="{colour}"/>'


def collision_step():
    """A, K steps, C; and the lines of a step."""
    parts, y = [], 38
    row = [("A", RED)] + [(f"step {k}", BLUE) for k in ("1", "2", "…", "K")] + [("C", RED)]
    for index, (name, colour) in enumerate(row):
        x = 20 + index * 128
        parts += [box(x, y, 110, 44, colour), text(x + 55, y + 27, name, colour, size=15)]
        if index:
            parts.append(f'<path d="M{x - 18} {y + 22}h14m-5 -4l5 4l-5 4" stroke="{GREY}" fill="none"/>')
    parts += [text(75, y + 64, "remember this state,"), text(75, y + 80, "sides of near pairs"),
              text(715, y + 64, "stop what would"), text(715, y + 80, "pass through")]
    parts.append(f'<path d="M660 {y - 4}C560 {y - 34} 180 {y - 34} 80 {y - 6}m7 -7l-7 7l9 2" stroke="{RED}" fill="none" stroke-dasharray="5 4"/>')
    parts.append(text(400, y - 8, "where C cannot end: back to A, with half of K", RED, size=12))
    parts.append(f'<path d="M148 {y + 44}L20 {y + 132}M258 {y + 44}L780 {y + 132}" stroke="#ccc"/>')
    for index, (name, first, second) in enumerate(LINES):
        x = 20 + index * 96
        colour = {"B.2": RED, "B.8": RED, "B.4": GREEN, "B.7": GREEN}.get(name, BLUE)
        parts += [box(x, y + 134, 88, 70, colour), text(x + 44, y + 156, name, colour, size=15),
                  text(x + 44, y + 176, first, size=12), text(x + 44, y + 192, second, size=12)]
    parts.append(text(400, y + 232, "blue: motion of the cloth; red: cloth with cloth; green: cloth with bodies"))
    return svg(800, 290, "A collision step: A, K time steps of eight lines, C", parts)


def time_step():
    """The lines of a step over its time: which moment the velocities and positions of each belong to."""
    left, middle, right, top = 120, 400, 680, 66
    parts = [f'<path d="M{x} {top - 18}V330" stroke="#ccc" stroke-dasharray="4 4"/>' for x in (left, middle, right)]
    parts += [text(x, top - 28, words) for x, words in ((left, "t"), (middle, "t + dt/2"), (right, "t + dt"))]
    parts += [text(left, 20, "A before", RED, size=12), text(right, 20, "C after", RED, size=12)]
    rows = [("B.1", left, middle, "velocity, half a step: v to v½", BLUE), ("B.2", middle, middle, "repulsion with springs, limit on strain: v½", RED),
            ("B.3", left, right, "positions with v½: x to x + dt v½", BLUE), ("B.4", right, right, "bodies: positions x', and v*", GREEN),
            ("B.5", left, middle, "velocity anew, forces at x̄: v* to v½", BLUE),
            ("B.6", middle, right, "extrapolate: v' = 2 v½ − v*", BLUE), ("B.7", right, right, "bodies: friction, v'", GREEN),
            ("B.8", right, right, "repulsion without springs, B.7 again, limit on strain: v'", RED)]
    for index, (name, begin, end, words, colour) in enumerate(rows):
        y = top + 8 + 32 * index
        parts.append(text(20, y + 5, name, colour, "start", 15))
        if end > begin:
            parts.append(f'<path d="M{begin} {y}H{end - 2}m-7 -5l7 5l-7 5" stroke="{colour}" stroke-width="2.5" fill="none"/>')
            parts.append(text((begin + end) / 2, y - 6, words, size=12))
        else:
            parts.append(f'<circle cx="{end}" cy="{y}" r="6" fill="{colour}"/>')
            parts.append(text(end + (14 if end == middle else -14), y + 4, words, anchor="start" if end == middle else "end", size=12))
    parts.append(text(400, 352, "blue: motion of the cloth; red: cloth with cloth; green: cloth with bodies; A and C enclose K such steps", size=12))
    return svg(800, 366, "A time step: the lines B.1 to B.8 over its time, between A and C", parts)


def coulomb():
    """Tangential speed after a contact by that before it: w_t' = max(0, 1 - mu J / |w_t|) w_t."""
    left, bottom, scale = 60.0, 305.0, 60.0
    parts = [f'<path d="M{left} 45V{bottom}H560" stroke="{GREY}" fill="none"/>',
             text(300, bottom + 34, "tangential speed before, in units of the normal impulse per mass J"),
             text(left - 8, 36, "after", anchor="start")]
    for mark in range(9):
        parts.append(text(left + mark * scale, bottom + 16, mark, GREY, size=11))
    for mark in range(1, 5):
        parts.append(text(left - 10, bottom - mark * scale + 4, mark, GREY, "end", 11))
    for index, (mu, colour) in enumerate(((0.0, GREY), (0.5, BLUE), (1.0, GREEN), (2.0, RED))):
        samples = [step / 20 for step in range(0, 161)]
        after = [(w, max(0.0, 1.0 - mu / w) * w if w else 0.0) for w in samples]
        points = " ".join(f"{left + w * scale:.1f},{bottom - a * scale:.1f}" for w, a in after if a <= 4.2)
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2"/>')
        end = 4.2 + mu
        parts.append(text(left + end * scale, bottom - 4.2 * scale - 6 - 16 * (index % 2), f"μ = {mu:g}", colour))
    parts.append(text(left + 6.2 * scale, bottom - 60, "on the axis: it sticks, exactly", anchor="middle"))
    return svg(600, 355, "Coulomb friction in impulse form: speed after by speed before", parts)


def main():
    for name, picture in (("collision_step", collision_step()), ("time_step", time_step()), ("coulomb", coulomb())):
        (PICTURES / f"{name}.svg").write_text(picture)
        print(f"written: docs/pictures/{name}.svg")


if __name__ == "__main__":
    main()
