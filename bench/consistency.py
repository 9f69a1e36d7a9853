"""NEES of position and orientation over seeds on simulated measurements: 3 each when the covariance is right."""

import sys

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.simulated import SwingingHead, run

SEEDS = 50
DURATION_S = 10.0
LOWEST, HIGHEST = 2.5, 3.5


def main() -> None:
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else SEEDS
    results = [run(SwingingHead(seed=seed, duration_s=DURATION_S)) for seed in range(seeds)]
    table = Table("", "NEES", "standard error", "RMS error", "wanted", title=f"{seeds} seeds of {DURATION_S:g} s")
    for name, nees, errors, unit, scale in (
        ("position", [result.nees_p for result in results], [result.e_p for result in results], "mm", 1e3),
        ("orientation", [result.nees_theta for result in results], [result.e_theta for result in results], "mrad", 1e3),
    ):
        means = np.array([n.mean() for n in nees])
        rms = scale * np.sqrt(np.mean([np.sum(e**2, axis=1).mean() for e in errors]))
        error = means.std(ddof=1) / np.sqrt(seeds)
        table.add_row(name, f"{means.mean():.2f}", f"{error:.2f}", f"{rms:.1f} {unit}", f"{LOWEST:g} to {HIGHEST:g}")
    Console().print(table)
