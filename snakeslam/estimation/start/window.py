"""The input of a start in motion: IMU spans and observed points of the last frames."""

from dataclasses import dataclass

from snakeslam.calibration import ImuCalibration
from snakeslam.estimation.filter.preintegration import ImuSegments, Preintegrated, preintegrate
from snakeslam.estimation.measurements.camera import Observations, ReprojectionModel
from snakeslam.messages import Float


@dataclass(frozen=True, slots=True)
class StartWindow:
    """Times ``t_s`` (n,) since the first of n frames, IMU spans up to each later one, points observed from them."""

    t_s: Float
    spans: list[ImuSegments]
    observed: Observations
    camera: ReprojectionModel
    noise: ImuCalibration
    gravity_m_s2: float

    def motions(self, bias_g: Float, bias_a: Float) -> list[Preintegrated]:
        """Return the pre-integrated measurement, Eq. (26), from the first frame to each later one."""
        return [preintegrate(span, bias_g, bias_a, self.noise) for span in self.spans]
