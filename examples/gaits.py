"""Compare how far two gaits move the simulated robot, and how well its pose is estimated."""

import snakeslam

for gait in ("serpentine", "sidewinding"):
    config = snakeslam.load_config(overrides=[f"gait.name={gait}", "gait.period_s=3", "run.seed=3"])
    try:
        result = snakeslam.run(config, duration_s=4.0)
    except snakeslam.InputError as error:
        raise SystemExit(f"{gait}: {error}") from error
    metrics = result.metrics
    print(f"{gait}: {metrics.path_m:.2f} m of path, error {1000 * metrics.ate_m.posyaw:.1f} mm, files in {result.out}")
    for note in result.notes:
        print(f"  {note}")
