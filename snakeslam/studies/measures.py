"""What a study may measure in a run: each measure's name, unit and meaning."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from snakeslam.studies.metrics import Metrics

MeasureName = Literal[
    "yaw_rms_deg",
    "peak_yaw_rate_deg_s",
    "sway_pp_m",
    "roll_rms_deg",
    "pitch_rms_deg",
    "speed_m_s",
    "ate_posyaw_m",
    "ate_se3_m",
    "rpe_trans_m",
    "rpe_rot_deg",
    "tracked_fraction",
    "resets",
    "path_m",
    "ate_percent_of_path",
    "nees_position",
    "nees_orientation",
    "ms_per_frame",
    "ms_per_frame_p95",
]


@dataclass(frozen=True, slots=True)
class Measure:
    """One number of a run; ``estimated``: it needs camera and estimator, the others come from the truth alone."""

    label: str
    unit: str
    of: Callable[[Metrics], float | None]
    estimated: bool = False

    @property
    def title(self) -> str:
        """Label with the unit."""
        return f"{self.label} ({self.unit})" if self.unit else self.label


def _ate_percent(metrics: Metrics) -> float | None:
    ate_m, path_m = metrics.ate_m.posyaw, metrics.path_m
    return None if ate_m is None or not path_m else 100.0 * ate_m / path_m


MEASURES: dict[MeasureName, Measure] = {
    "yaw_rms_deg": Measure("head yaw RMS", "deg", lambda m: m.head.yaw_rms_deg),
    "peak_yaw_rate_deg_s": Measure("peak yaw rate", "deg/s", lambda m: m.head.peak_yaw_rate_deg_s),
    "sway_pp_m": Measure("sway, peak to peak", "m", lambda m: m.head.sway_pp_m),
    "roll_rms_deg": Measure("head roll RMS", "deg", lambda m: m.head.roll_rms_deg),
    "pitch_rms_deg": Measure("head pitch RMS", "deg", lambda m: m.head.pitch_rms_deg),
    "speed_m_s": Measure("speed", "m/s", lambda m: m.speed_m_s),
    "ate_posyaw_m": Measure("ATE, posyaw", "m", lambda m: m.ate_m.posyaw, estimated=True),
    "ate_se3_m": Measure("ATE, se3", "m", lambda m: m.ate_m.se3, estimated=True),
    "rpe_trans_m": Measure("RPE over 1 s", "m", lambda m: m.rpe_1s.trans_m, estimated=True),
    "rpe_rot_deg": Measure("RPE over 1 s", "deg", lambda m: m.rpe_1s.rot_deg, estimated=True),
    "tracked_fraction": Measure("tracked frames", "", lambda m: m.tracked_fraction, estimated=True),
    "resets": Measure("resets", "", lambda m: m.resets, estimated=True),
    "path_m": Measure("path", "m", lambda m: m.path_m),
    "ate_percent_of_path": Measure("ATE, posyaw", "% of the path", _ate_percent, estimated=True),
    "nees_position": Measure("NEES of position", "", lambda m: m.nees.position, estimated=True),
    "nees_orientation": Measure("NEES of orientation", "", lambda m: m.nees.orientation, estimated=True),
    "ms_per_frame": Measure("time per frame", "ms", lambda m: m.ms_per_frame.mean, estimated=True),
    "ms_per_frame_p95": Measure("time per frame, 95 %", "ms", lambda m: m.ms_per_frame.p95, estimated=True),
}
