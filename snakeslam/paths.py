"""Where the configurations that come with the project lie."""

from pathlib import Path


def configs_dir() -> Path:
    """Return the folder of sim.yaml, replay.yaml, calib/, ...: in the wheel, or beside the package in a checkout."""
    package = Path(__file__).resolve().parent
    inside = package / "configs"
    return inside if inside.is_dir() else package.parent / "configs"
