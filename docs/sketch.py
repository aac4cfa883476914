"""Draw bodies.png of theory.md: the symbols, on a ball and a half-space by Hertz."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from app import EllipticHertz

BODY, OTHER, INK, RED = "#cfe3f1", "#f3d9c6", "#0072b2", "#d55e00"
exact = EllipticHertz.from_approach(10.0, 10.0, 1.0, 0.5)
a, d = exact.a, exact.approach
x = np.linspace(-2.6 * a, 2.6 * a, 1001)
h, u, p = exact.undeformed_distance(x, 0) - d, exact.displacement(x, 0), exact.pressure(x, 0)
at = 1.7 * a  # where distances are shown


def arrow(axes, start, end, text, where, colour="black", head="<->"):
    """Draw an arrow and its name."""
    style = {"arrowstyle": head, "color": colour, "shrinkA": 0, "shrinkB": 0, "lw": 1.4}
    axes.annotate("", end, start, arrowprops=style)
    axes.text(*where, text, color=colour, ha="left", va="center", fontsize=14)


figure, panels = plt.subplots(1, 2, figsize=(13, 4.6), sharey=True, layout="constrained")
for axes in panels:
    axes.set(xlim=(x[0], x[-1]), ylim=(-1.0, 1.35))
    axes.axis("off")

left, right = panels
left.fill_between(x, h, 1.35, color=OTHER)
left.fill_between(x, -1, 0, color=BODY, alpha=0.8)
left.plot(x, h, color=RED)
left.plot(x, 0 * x, color=INK)
left.plot(x, h + d, ":", color=RED)
arrow(left, (0, 0), (0, -d), "approach d", (0.08 * a, -0.2))
arrow(left, (at, 0), (at, np.interp(at, x, h)), "h > 0", (at * 1.03, 0.16))
arrow(left, (-0.5 * a, 0), (-0.5 * a, np.interp(-0.5 * a, x, h)), "h < 0", (-0.46 * a, -0.2))
left.text(0, 1.2, "body 2, moved through body 1", fontsize=12, ha="center", va="top")
left.text(-2.5 * a, -0.85, "body 1, undeformed", fontsize=12)
left.text(0, 0.1, "dotted: first touch", fontsize=11, ha="center")

right.fill_between(x, h, 1.35, color=OTHER)
right.fill_between(x, -1, -u, color=BODY)
right.plot(x, h, color=RED)
right.plot(x, -u, color=INK)
right.plot(x, 0 * x, ":", color=INK)
place = np.interp(at, x, u)
arrow(right, (at, -place), (at, np.interp(at, x, h)), "gap e = h + u", (at * 1.03, 0.12))
arrow(right, (-at, 0), (-at, -place), "u", (-at * 1.14, -0.12))
for spot in np.linspace(-0.9 * a, 0.9 * a, 9):
    foot = np.interp(spot, x, -u)
    size = 0.4 * np.interp(spot, x, p) / p.max()
    right.annotate("", (spot, foot), (spot, foot + size), arrowprops={"arrowstyle": "-|>", "color": "black"})
right.text(0, 0.02, "pressure p", fontsize=14, ha="center", va="bottom")
right.text(0, -0.72, "contact C: e = 0, p > 0", fontsize=13, ha="center")
right.text(0, 1.2, "body 2", fontsize=12, ha="center", va="top")
right.text(-2.5 * a, -0.85, "body 1, deformed (all of u is drawn on it)", fontsize=12)
figure.savefig(Path(__file__).with_name("bodies.png"), dpi=65)
